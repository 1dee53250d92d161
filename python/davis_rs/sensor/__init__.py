"""A sensor: its parameters and presets, the effects of its pixels, and the inertial and motion-capture sensors next to it."""
