"""Holds a camera's path: trajectories of any kind, motions by rule, files.

``trajectory`` (the classes) <- ``sampled_trajectory`` (measured poses) <- ``sample_noise``; ``trajectory_file``,
``waypoints`` and ``motions`` make them; ``steered`` is the path of what a caller moves; ``views`` are a path's poses
and rates at some instants.

Measured poses are smoothed by splines as far as their estimated noise allows; exact poses have none. A top speed is
a mean over 100 ms, because momentary speeds of a measured path are mostly noise. By this definition the recording
poster_6dof agrees with the paper's table within 2 %.
"""
