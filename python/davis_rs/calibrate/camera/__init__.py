"""Calibration of a camera from views of a checkerboard."""
