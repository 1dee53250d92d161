"""Event files and dataset folders as windows, for training."""
