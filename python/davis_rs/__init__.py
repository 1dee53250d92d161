"""A simulator of the DAVIS event camera: 3D scene and camera path in, events, frames, depth and ground truth out."""

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
from .clocks import ClockAlignment, align_clocks
from .dataset.reader import Dataset
from .dataset.write_trajectory import write_trajectory
from .dataset.writer import DatasetWriter
from .decoded import IMU_COUNTS_DTYPE, IMU_DTYPE, TRIGGER_DTYPE, Decoded, Frame, TriggerKind
from .dtypes import from_structured, to_structured, to_tonic
from .effects import Effects
from .event_files.convert import convert
from .event_files.read import iter_events, open_reader, read_events
from .event_files.write import open_writer
from .events import EVENT_DTYPE, as_events
from .formats import EventReader, EventWriter, TruncatedFileWarning, WriteReport
from .generate import Generated, SequencePlan, generate_sequences, load_sequence_plan, verify_sequences
from .imu import Imu, simulate_imu
from .inspection.check import check_dataset
from .inspection.compare import EventComparison, compare_events
from .inspection.video import video_dataset
from .inspection.view import view_dataset
from .motion_capture import MocapClock, MocapNoise, MotionCapture
from .packet import Packet
from .plan import EffectPlan, plan_effects
from .pose import GroundTruth, Pose
from .record import record
from .recordings import Recording, RecordingWarning, read_recording
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
from .usb.davis import Davis
from .usb.description import DavisDescription
from .usb.raw_file import RawRecording, RawWriter
from .usb.settings import DavisSettings

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
    "Generated",
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
    "SequencePlan",
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
    "generate_sequences",
    "interval",
    "iter_events",
    "load_camera",
    "load_scene",
    "load_sequence_plan",
    "log_intensity",
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
    "verify_sequences",
    "video_dataset",
    "view_dataset",
    "waypoint_trajectory",
    "write_trajectory",
]
