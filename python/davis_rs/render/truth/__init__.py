"""What a camera cannot give: the surfaces that pixels see, frame by frame and event by event."""

from .camera_velocities import camera_velocities
from .event_truth import EVENT_TRUTH_DTYPE, EventTruth, EventTruthArray, event_truth
from .lost_look_shares import lost_look_shares
from .scene_surfaces import SceneSurfaces, Surfaces

__all__ = [
    "EVENT_TRUTH_DTYPE",
    "EventTruth",
    "EventTruthArray",
    "SceneSurfaces",
    "Surfaces",
    "camera_velocities",
    "event_truth",
    "lost_look_shares",
]
