"""Calibrates a camera from views of a checkerboard: intrinsics, hand-eye, camera and IMU by splines.

Corners, intrinsics and Tsai's equations are OpenCV's; the refinement over poses (``levenberg_marquardt``) is ours.
"""
