"""A camera's path: trajectories of any kind, motions by rule, files."""
