"""Imports an OpenCV that can calibrate."""

from __future__ import annotations

from typing import Any

from ..._util import extras


def load_opencv() -> Any:
    """Return the module cv2.

    Raises:
        ImportError: where it is not installed, or is OpenCV 5, which lacks the hand-eye solution.
    """
    cv2 = extras.load_opencv("calibration", "calibrate")
    if not hasattr(cv2, "calibrateHandEye"):
        raise ImportError(
            f"calibration needs OpenCV 4, found {cv2.__version__}: pip install 'opencv-python-headless<5'"
        )
    return cv2
