"""Computes ground truth that a camera cannot give: the surfaces that pixels see, by frame and by event."""

from .camera_velocities import camera_velocities
from .event_truth import EVENT_TRUTH_DTYPE, EventTruth, EventTruthArray, event_truth
from .lost_look_fractions import lost_look_fractions
from .scene_surfaces import SceneSurfaces, Surfaces

__all__ = [
    "EVENT_TRUTH_DTYPE",
    "EventTruth",
    "EventTruthArray",
    "SceneSurfaces",
    "Surfaces",
    "camera_velocities",
    "event_truth",
    "lost_look_fractions",
]
