"""A simulator of the DAVIS event camera: 3D scene and camera path in, events, frames, depth and ground truth out."""

from __future__ import annotations

TYPE_CHECKING = False  # as typing's; that is not imported here, because the command line's first line comes after this
if TYPE_CHECKING:
    from typing import Any

    from . import represent
    from ._core import CrossingEngine, DecodeError, Decoder, Device, Encoder, __version__, log_intensity, reconstruct
    from .argument_error import ArgumentError
    from .biases import BIAS_SETS, CoarseFineBias
    from .camera import Camera, load_camera
    from .clocks import ClockAlignment, align_clocks
    from .dataset.reader import Dataset
    from .dataset.write_trajectory import write_trajectory
    from .dataset.writer import DatasetWriter
    from .decoded import IMU_COUNTS_DTYPE, IMU_DTYPE, TRIGGER_DTYPE, Decoded, Frame, TriggerKind
    from .dtypes import from_structured, to_structured, to_tonic
    from .effect_planning import EffectPlan, plan_effects
    from .effects import Effects
    from .event_files.conversion import convert
    from .event_files.read import iter_events, open_reader, read_events
    from .event_files.write import open_writer
    from .event_matching import EventComparison, compare_events
    from .events import EVENT_DTYPE, as_events, event_array
    from .formats import EventReader, EventWriter, TruncatedFileWarning, WriteReport
    from .frames_to_events.events_from_frames import events_from_frames
    from .frames_to_events.frame_values import FrameValuesWarning
    from .frames_to_events.frames_folder import FramesReport, frames_to_folder
    from .frames_to_events.open_frames import open_frames
    from .ground_truth import EVENT_TRUTH_DTYPE, EventTruth, SceneSurfaces, event_truth
    from .imu import Imu, simulate_imu
    from .inspection.check import check_dataset
    from .inspection.figure import view
    from .inspection.html_page import HtmlPage, view_html
    from .inspection.rerun_recording import RerunRecording, view_rerun
    from .inspection.video import make_video
    from .monte_carlo_noise import estimate_noise
    from .motion_capture import MocapClock, MocapNoise, MotionCapture
    from .no_events import NoEventsWarning
    from .noise_estimate import NoiseError, NoiseEstimate, NoiseWarning
    from .packet import Displacement, Packet
    from .pose import GroundTruth, Pose, Velocities, as_pose
    from .recordings import Recording, RecordingWarning, read_recording
    from .sampling.presets import ACCURACY, Accuracy
    from .sampling.rules import FixedRate, MaxDisplacement
    from .sampling.tolerance import Tolerance
    from .scene.light_profile import Flicker, LightProfile, SampledProfile
    from .scene.lost_looks import LostLook, LostLookWarning
    from .scene.repairs import SceneFileWarning
    from .scene.scene import Scene
    from .scenes import load_scene, start_pose
    from .sensor_fit import FrameSource, MeasuredRecording, SensorFit, StampedFrame, fit_sensor, measure_recording
    from .sensor_parameters import SensorParameters
    from .sensors import SENSORS, load_sensor, save_sensor
    from .simulation import simulate
    from .simulation_folder import SimulationReport, simulate_to_folder
    from .simulator import Simulator
    from .stream_statistics import StreamStatistics, compare_streams, measure_stream
    from .trajectory.sampled_trajectory import SampledTrajectory
    from .trajectory.trajectory import CallableTrajectory, SegmentTrajectory, Trajectory, align
    from .trajectory.trajectory_file import read_trajectory
    from .trajectory.waypoints import waypoint_trajectory
    from .usb.davis import Davis
    from .usb.description import DavisDescription
    from .usb.raw_file import RawRecording, RawWriter
    from .usb.settings import DavisSettings
    from .windows.event_windows import EventWindows
    from .windows.window import EventWindow

_MODULES = {
    "ACCURACY": "sampling.presets",
    "Accuracy": "sampling.presets",
    "ArgumentError": "argument_error",
    "BIAS_SETS": "biases",
    "CallableTrajectory": "trajectory.trajectory",
    "Camera": "camera",
    "ClockAlignment": "clocks",
    "CoarseFineBias": "biases",
    "CrossingEngine": "_core",
    "Dataset": "dataset.reader",
    "DatasetWriter": "dataset.writer",
    "Davis": "usb.davis",
    "DavisDescription": "usb.description",
    "DavisSettings": "usb.settings",
    "DecodeError": "_core",
    "Decoded": "decoded",
    "Decoder": "_core",
    "Device": "_core",
    "Displacement": "packet",
    "EVENT_DTYPE": "events",
    "EVENT_TRUTH_DTYPE": "ground_truth",
    "EffectPlan": "effect_planning",
    "Effects": "effects",
    "Encoder": "_core",
    "EventComparison": "event_matching",
    "EventReader": "formats",
    "EventTruth": "ground_truth",
    "EventWindow": "windows.window",
    "EventWindows": "windows.event_windows",
    "EventWriter": "formats",
    "FixedRate": "sampling.rules",
    "Flicker": "scene.light_profile",
    "Frame": "decoded",
    "FrameSource": "sensor_fit",
    "FrameValuesWarning": "frames_to_events.frame_values",
    "FramesReport": "frames_to_events.frames_folder",
    "GroundTruth": "pose",
    "IMU_COUNTS_DTYPE": "decoded",
    "IMU_DTYPE": "decoded",
    "HtmlPage": "inspection.html_page",
    "Imu": "imu",
    "LightProfile": "scene.light_profile",
    "LostLook": "scene.lost_looks",
    "LostLookWarning": "scene.lost_looks",
    "MaxDisplacement": "sampling.rules",
    "MeasuredRecording": "sensor_fit",
    "MocapClock": "motion_capture",
    "MocapNoise": "motion_capture",
    "MotionCapture": "motion_capture",
    "NoEventsWarning": "no_events",
    "NoiseError": "noise_estimate",
    "NoiseEstimate": "noise_estimate",
    "NoiseWarning": "noise_estimate",
    "Packet": "packet",
    "Pose": "pose",
    "RawRecording": "usb.raw_file",
    "RawWriter": "usb.raw_file",
    "Recording": "recordings",
    "RecordingWarning": "recordings",
    "SENSORS": "sensors",
    "RerunRecording": "inspection.rerun_recording",
    "SampledProfile": "scene.light_profile",
    "SampledTrajectory": "trajectory.sampled_trajectory",
    "Scene": "scene.scene",
    "SceneFileWarning": "scene.repairs",
    "SceneSurfaces": "ground_truth",
    "SegmentTrajectory": "trajectory.trajectory",
    "SensorFit": "sensor_fit",
    "SensorParameters": "sensor_parameters",
    "SimulationReport": "simulation_folder",
    "Simulator": "simulator",
    "StampedFrame": "sensor_fit",
    "StreamStatistics": "stream_statistics",
    "TRIGGER_DTYPE": "decoded",
    "Tolerance": "sampling.tolerance",
    "Trajectory": "trajectory.trajectory",
    "TriggerKind": "decoded",
    "TruncatedFileWarning": "formats",
    "Velocities": "pose",
    "WriteReport": "formats",
    "__version__": "_core",
    "align": "trajectory.trajectory",
    "align_clocks": "clocks",
    "as_events": "events",
    "as_pose": "pose",
    "check_dataset": "inspection.check",
    "compare_events": "event_matching",
    "compare_streams": "stream_statistics",
    "convert": "event_files.conversion",
    "estimate_noise": "monte_carlo_noise",
    "event_array": "events",
    "event_truth": "ground_truth",
    "events_from_frames": "frames_to_events.events_from_frames",
    "fit_sensor": "sensor_fit",
    "frames_to_folder": "frames_to_events.frames_folder",
    "from_structured": "dtypes",
    "iter_events": "event_files.read",
    "load_camera": "camera",
    "load_scene": "scenes",
    "load_sensor": "sensors",
    "log_intensity": "_core",
    "make_video": "inspection.video",
    "measure_recording": "sensor_fit",
    "measure_stream": "stream_statistics",
    "open_frames": "frames_to_events.open_frames",
    "open_reader": "event_files.read",
    "open_writer": "event_files.write",
    "plan_effects": "effect_planning",
    "read_events": "event_files.read",
    "read_recording": "recordings",
    "read_trajectory": "trajectory.trajectory_file",
    "reconstruct": "_core",
    "save_sensor": "sensors",
    "simulate": "simulation",
    "simulate_imu": "imu",
    "simulate_to_folder": "simulation_folder",
    "start_pose": "scenes",
    "to_structured": "dtypes",
    "to_tonic": "dtypes",
    "view": "inspection.figure",
    "view_html": "inspection.html_page",
    "view_rerun": "inspection.rerun_recording",
    "waypoint_trajectory": "trajectory.waypoints",
    "write_trajectory": "dataset.write_trajectory",
}
"""Where each name is found when it is asked for (PEP 562), so that `import davis_rs` is quick."""

__all__ = [
    "ACCURACY",
    "BIAS_SETS",
    "EVENT_DTYPE",
    "EVENT_TRUTH_DTYPE",
    "IMU_COUNTS_DTYPE",
    "IMU_DTYPE",
    "SENSORS",
    "TRIGGER_DTYPE",
    "Accuracy",
    "ArgumentError",
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
    "Displacement",
    "EffectPlan",
    "Effects",
    "Encoder",
    "EventComparison",
    "EventReader",
    "EventTruth",
    "EventWindow",
    "EventWindows",
    "EventWriter",
    "FixedRate",
    "Flicker",
    "Frame",
    "FrameSource",
    "FrameValuesWarning",
    "FramesReport",
    "GroundTruth",
    "HtmlPage",
    "Imu",
    "LightProfile",
    "LostLook",
    "LostLookWarning",
    "MaxDisplacement",
    "MeasuredRecording",
    "MocapClock",
    "MocapNoise",
    "MotionCapture",
    "NoEventsWarning",
    "NoiseError",
    "NoiseEstimate",
    "NoiseWarning",
    "Packet",
    "Pose",
    "RawRecording",
    "RawWriter",
    "Recording",
    "RecordingWarning",
    "RerunRecording",
    "SampledProfile",
    "SampledTrajectory",
    "Scene",
    "SceneFileWarning",
    "SceneSurfaces",
    "SegmentTrajectory",
    "SensorFit",
    "SensorParameters",
    "SimulationReport",
    "Simulator",
    "StampedFrame",
    "StreamStatistics",
    "Tolerance",
    "Trajectory",
    "TriggerKind",
    "TruncatedFileWarning",
    "Velocities",
    "WriteReport",
    "__version__",
    "align",
    "align_clocks",
    "as_events",
    "as_pose",
    "check_dataset",
    "compare_events",
    "compare_streams",
    "convert",
    "estimate_noise",
    "event_array",
    "event_truth",
    "events_from_frames",
    "fit_sensor",
    "frames_to_folder",
    "from_structured",
    "iter_events",
    "load_camera",
    "load_scene",
    "load_sensor",
    "log_intensity",
    "make_video",
    "measure_recording",
    "measure_stream",
    "open_frames",
    "open_reader",
    "open_writer",
    "plan_effects",
    "read_events",
    "read_recording",
    "read_trajectory",
    "reconstruct",
    "represent",
    "save_sensor",
    "simulate",
    "simulate_imu",
    "simulate_to_folder",
    "start_pose",
    "to_structured",
    "to_tonic",
    "view",
    "view_html",
    "view_rerun",
    "waypoint_trajectory",
    "write_trajectory",
]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _MODULES and name != "represent":
        from .close_names import did_you_mean

        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{did_you_mean(name, __all__)}", name=name)
    from .stop_requests import interrupts_deferred

    with interrupts_deferred():
        if name == "represent":
            return import_module(".represent", __name__)
        return getattr(import_module(f".{_MODULES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
