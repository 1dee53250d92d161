"""A simulator of the DAVIS event camera: 3D scene and camera path in, events, frames, depth and ground truth out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from . import represent
from ._core import (
    CrossingEngine,
    DecodeError,
    Decoder,
    Device,
    Encoder,
    __version__,
    log_intensity,
    reconstruct,
)
from .biases import BIAS_SETS, CoarseFineBias
from .camera import Camera, load_camera
from .dataset.reader import Dataset
from .dataset.write_trajectory import write_trajectory
from .dataset.writer import DatasetWriter
from .decoded import IMU_COUNTS_DTYPE, IMU_DTYPE, TRIGGER_DTYPE, Decoded, Frame, TriggerKind
from .dtypes import from_structured, to_structured, to_tonic
from .effects import Effects
from .event_files.convert import convert
from .event_files.read import iter_events, open_reader, read_events
from .event_files.write import open_writer
from .event_matching import EventComparison, compare_events
from .events import EVENT_DTYPE, as_events
from .formats import EventReader, EventWriter, TruncatedFileWarning, WriteReport
from .imu import Imu, simulate_imu
from .motion_capture import MocapClock, MocapNoise, MotionCapture
from .packet import Packet
from .plan import EffectPlan, plan_effects
from .pose import GroundTruth, Pose
from .record import record
from .sampling.presets import ACCURACY, Accuracy
from .sampling.rules import FixedRate, MaxDisplacement
from .sampling.tolerance import Tolerance
from .scene.light_course import Flicker, LightCourse, SampledCourse
from .scene.scene import Scene
from .scenes import load_scene, start_pose
from .sensor_parameters import SENSORS, SensorParameters
from .simulate import Simulator, simulate
from .trajectory.sampled_trajectory import SampledTrajectory
from .trajectory.trajectory import CallableTrajectory, SegmentTrajectory, Trajectory, align, interval
from .trajectory.trajectory_file import read_trajectory
from .trajectory.waypoints import waypoint_trajectory

if TYPE_CHECKING:
    from .clocks import ClockAlignment, align_clocks
    from .inspection.check import check_dataset
    from .inspection.figure import view
    from .inspection.video import make_video
    from .recordings import Recording, RecordingWarning, read_recording
    from .usb.davis import Davis
    from .usb.description import DavisDescription
    from .usb.raw_file import RawRecording, RawWriter
    from .usb.settings import DavisSettings

_LATE = {
    "ClockAlignment": "clocks",
    "Davis": "usb.davis",
    "DavisDescription": "usb.description",
    "DavisSettings": "usb.settings",
    "RawRecording": "usb.raw_file",
    "RawWriter": "usb.raw_file",
    "Recording": "recordings",
    "RecordingWarning": "recordings",
    "align_clocks": "clocks",
    "check_dataset": "inspection.check",
    "read_recording": "recordings",
    "make_video": "inspection.video",
    "view": "inspection.figure",
}
"""What a simulation does not need is imported when it is asked for (PEP 562), so that `import davis_rs` is quick."""

__all__ = [
    "ACCURACY",
    "BIAS_SETS",
    "EVENT_DTYPE",
    "IMU_COUNTS_DTYPE",
    "IMU_DTYPE",
    "SENSORS",
    "TRIGGER_DTYPE",
    "Accuracy",
    "CallableTrajectory",
    "Camera",
    "ClockAlignment",
    "CoarseFineBias",
    "CrossingEngine",
    "Dataset",
    "DatasetWriter",
    "Davis",
    "DavisDescription",
    "DavisSettings",
    "DecodeError",
    "Decoded",
    "Decoder",
    "Device",
    "EffectPlan",
    "Effects",
    "Encoder",
    "EventComparison",
    "EventReader",
    "EventWriter",
    "FixedRate",
    "Flicker",
    "Frame",
    "GroundTruth",
    "Imu",
    "LightCourse",
    "MaxDisplacement",
    "MocapClock",
    "MocapNoise",
    "MotionCapture",
    "Packet",
    "Pose",
    "RawRecording",
    "RawWriter",
    "Recording",
    "RecordingWarning",
    "SampledCourse",
    "SampledTrajectory",
    "Scene",
    "SegmentTrajectory",
    "SensorParameters",
    "Simulator",
    "Tolerance",
    "Trajectory",
    "TriggerKind",
    "TruncatedFileWarning",
    "WriteReport",
    "__version__",
    "align",
    "align_clocks",
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
    "make_video",
    "open_reader",
    "open_writer",
    "plan_effects",
    "read_events",
    "read_recording",
    "read_trajectory",
    "reconstruct",
    "record",
    "represent",
    "simulate",
    "simulate_imu",
    "start_pose",
    "to_structured",
    "to_tonic",
    "view",
    "waypoint_trajectory",
    "write_trajectory",
]


def __getattr__(name: str) -> Any:
    if name not in _LATE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_LATE[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
