"""A simulator of the DAVIS event camera: 3D scene and camera path in, events, frames, depth and ground truth out."""

from . import represent
from ._core import CrossingEngine, DecodeError, __version__, log_intensity, reconstruct
from .camera import Camera, load_camera
from .check import check_dataset
from .compare import EventComparison, compare_events
from .convert import convert
from .dataset import DatasetWriter
from .dtypes import from_structured, to_structured, to_tonic
from .events import EVENT_DTYPE, as_events
from .formats import EventReader, EventWriter, TruncatedFileWarning, WriteReport
from .light_course import Flicker, LightCourse, SampledCourse
from .packet import Packet
from .pose import Pose
from .presets import ACCURACY, Accuracy
from .read import Dataset
from .read_events import iter_events, open_reader, read_events
from .record import record
from .sampled_trajectory import SampledTrajectory
from .sampling import FixedRate, MaxDisplacement
from .scene import Scene
from .scenes import load_scene, start_pose
from .simulate import Simulator, simulate
from .tolerance import Tolerance
from .trajectory import CallableTrajectory, SegmentTrajectory, Trajectory, align, interval
from .trajectory_file import read_trajectory
from .video import video_dataset
from .view import view_dataset
from .write import open_writer

__all__ = [
    "ACCURACY",
    "EVENT_DTYPE",
    "Accuracy",
    "CallableTrajectory",
    "Camera",
    "CrossingEngine",
    "Dataset",
    "DatasetWriter",
    "DecodeError",
    "EventComparison",
    "EventReader",
    "EventWriter",
    "FixedRate",
    "Flicker",
    "LightCourse",
    "MaxDisplacement",
    "Packet",
    "Pose",
    "SampledCourse",
    "SampledTrajectory",
    "Scene",
    "SegmentTrajectory",
    "Simulator",
    "Tolerance",
    "Trajectory",
    "TruncatedFileWarning",
    "WriteReport",
    "__version__",
    "align",
    "as_events",
    "check_dataset",
    "compare_events",
    "convert",
    "from_structured",
    "interval",
    "iter_events",
    "load_camera",
    "load_scene",
    "log_intensity",
    "open_reader",
    "open_writer",
    "read_events",
    "read_trajectory",
    "reconstruct",
    "record",
    "represent",
    "simulate",
    "start_pose",
    "to_structured",
    "to_tonic",
    "video_dataset",
    "view_dataset",
]
