"""Declares rigs: several cameras and IMUs on one body, and the file that says so.

``rig`` has the dataclasses; ``transforms`` finds where each sensor is on the body from what a file says of pairs of
them; ``rig_file`` reads and writes ``rig.yaml``, Kalibr's camchain with sensors, IMUs and mounts; ``presets`` are such
files in the package, so that a value is written once, next to its source. ``stereo`` computes disparities from depth.
"""

from .presets import RIGS, load_rig
from .rig import CameraClock, Rig, RigCamera, RigImu
from .rig_file import kalibr_rig_chain, read_rig_file, rig_yaml
from .stereo import Rectification, StereoTruth, rectify, stereo_truth

__all__ = [
    "RIGS",
    "CameraClock",
    "Rectification",
    "Rig",
    "RigCamera",
    "RigImu",
    "StereoTruth",
    "kalibr_rig_chain",
    "load_rig",
    "read_rig_file",
    "rectify",
    "rig_yaml",
    "stereo_truth",
]
