"""Cuts event files and dataset folders into windows, for training."""
