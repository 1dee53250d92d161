"""A simulator of the DAVIS event camera: 3D scene and camera path in, events, frames, depth and ground truth out."""

from ._core import CrossingEngine, DecodeError, EventTextWriter, __version__, log_intensity, reconstruct
from .camera import Camera, load_camera
from .check import check_dataset
from .clocks import ClockAlignment, align_clocks
from .compare import EventComparison, compare_events
from .dataset import DatasetWriter
from .effects import Effects
from .events import EVENT_DTYPE, as_events
from .imu import IMU_DTYPE, Imu, simulate_imu
from .light_course import Flicker, LightCourse, SampledCourse
from .motion_capture import MocapClock, MocapNoise, MotionCapture
from .packet import Packet
from .plan import EffectPlan, plan_effects
from .pose import GroundTruth, Pose
from .presets import ACCURACY, Accuracy
from .read import Dataset
from .record import record
from .sampled_trajectory import SampledTrajectory
from .sampling import FixedRate, MaxDisplacement
from .scene import Scene
from .scenes import load_scene, start_pose
from .sensor_parameters import SENSORS, SensorParameters
from .simulate import Simulator, simulate
from .tolerance import Tolerance
from .trajectory import CallableTrajectory, SegmentTrajectory, Trajectory, align, interval
from .trajectory_file import read_trajectory
from .video import video_dataset
from .view import view_dataset
from .waypoints import waypoint_trajectory
from .write_trajectory import write_trajectory

__all__ = [
    "ACCURACY",
    "EVENT_DTYPE",
    "IMU_DTYPE",
    "SENSORS",
    "Accuracy",
    "CallableTrajectory",
    "Camera",
    "ClockAlignment",
    "CrossingEngine",
    "Dataset",
    "DatasetWriter",
    "DecodeError",
    "EffectPlan",
    "Effects",
    "EventComparison",
    "EventTextWriter",
    "FixedRate",
    "Flicker",
    "GroundTruth",
    "Imu",
    "LightCourse",
    "MaxDisplacement",
    "MocapClock",
    "MocapNoise",
    "MotionCapture",
    "Packet",
    "Pose",
    "SampledCourse",
    "SampledTrajectory",
    "Scene",
    "SegmentTrajectory",
    "SensorParameters",
    "Simulator",
    "Tolerance",
    "Trajectory",
    "__version__",
    "align",
    "align_clocks",
    "as_events",
    "check_dataset",
    "compare_events",
    "interval",
    "load_camera",
    "load_scene",
    "log_intensity",
    "plan_effects",
    "read_trajectory",
    "reconstruct",
    "record",
    "simulate",
    "simulate_imu",
    "start_pose",
    "video_dataset",
    "view_dataset",
    "waypoint_trajectory",
    "write_trajectory",
]
