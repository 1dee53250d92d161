"""Imports OpenCV, which calibration alone needs."""

from __future__ import annotations

from typing import Any


def load_opencv() -> Any:
    """Return the module cv2.

    Raises:
        ImportError: where it is not installed, or is OpenCV 5, which lacks the hand-eye solution.
    """
    try:
        import cv2
    except ImportError as error:
        raise ImportError("calibration needs OpenCV: pip install 'davis_rs[calibrate]'") from error
    if not hasattr(cv2, "calibrateHandEye"):
        raise ImportError(
            f"calibration needs OpenCV 4, found {cv2.__version__}: pip install 'opencv-python-headless<5'"
        )
    return cv2
