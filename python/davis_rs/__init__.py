"""A simulator of the DAVIS event camera: 3D scene and camera path in, events, frames, depth and ground truth out."""

from ._core import CrossingEngine, DecodeError, EventTextWriter, __version__, log_intensity, reconstruct
from .camera import Camera, load_camera
from .check import check_dataset
from .dataset import DatasetWriter
from .events import EVENT_DTYPE, as_events
from .packet import Packet
from .pose import Pose
from .read import Dataset
from .record import record
from .sampled_trajectory import SampledTrajectory
from .sampling import FixedRate, MaxDisplacement
from .scene import Scene
from .scenes import load_scene, start_pose
from .simulate import Simulator, simulate
from .trajectory import CallableTrajectory, SegmentTrajectory, Trajectory, align, interval
from .trajectory_file import read_trajectory
from .video import video_dataset
from .view import view_dataset

__all__ = [
    "EVENT_DTYPE",
    "CallableTrajectory",
    "Camera",
    "CrossingEngine",
    "Dataset",
    "DatasetWriter",
    "DecodeError",
    "EventTextWriter",
    "FixedRate",
    "MaxDisplacement",
    "Packet",
    "Pose",
    "SampledTrajectory",
    "Scene",
    "SegmentTrajectory",
    "Simulator",
    "Trajectory",
    "__version__",
    "align",
    "as_events",
    "check_dataset",
    "interval",
    "load_camera",
    "load_scene",
    "log_intensity",
    "read_trajectory",
    "reconstruct",
    "record",
    "simulate",
    "start_pose",
    "video_dataset",
    "view_dataset",
]
