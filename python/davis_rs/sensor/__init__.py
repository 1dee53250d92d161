"""A sensor: parameters, presets, effects of its pixels, and the inertial and motion-capture sensors next to it."""
