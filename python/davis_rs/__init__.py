"""A simulator of the DAVIS event camera: 3D scene and camera path in, events, frames, depth and ground truth out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._core import CrossingEngine, DecodeError, Decoder, Device, Encoder, __version__, log_intensity, reconstruct
    from ._util.argument_error import ArgumentError
    from .calibrate.sensor import FrameSource, MeasuredRecording, SensorFit, StampedFrame, fit_sensor, measure_recording
    from .data.windows.event_windows import EventWindows
    from .data.windows.window import EventWindow
    from .events import represent
    from .events.arrays import EVENT_DTYPE, as_events, event_array
    from .events.decoded import IMU_COUNTS_DTYPE, IMU_DTYPE, TRIGGER_DTYPE, Decoded, Frame, TriggerKind
    from .events.dtypes import from_structured, to_structured, to_tonic
    from .events.matching import EventComparison, compare_events
    from .events.packet import Displacement, Packet
    from .geometry.camera import Camera, load_camera
    from .geometry.pose import GroundTruth, Pose, Velocities, as_pose
    from .geometry.trajectory.sampled_trajectory import SampledTrajectory
    from .geometry.trajectory.trajectory import CallableTrajectory, SegmentTrajectory, Trajectory, align
    from .geometry.trajectory.trajectory_file import read_trajectory
    from .geometry.trajectory.waypoints import waypoint_trajectory
    from .inspection.check import check_dataset
    from .inspection.figure import view
    from .inspection.html_page import HtmlPage, view_html
    from .inspection.rerun_recording import RerunRecording, view_rerun
    from .inspection.statistics import StreamStatistics, compare_streams, measure_stream
    from .inspection.video import make_video
    from .io.dataset.reader import Dataset
    from .io.dataset.write_trajectory import write_trajectory
    from .io.dataset.writer import DatasetWriter
    from .io.files.conversion import convert
    from .io.files.read import iter_events, open_reader, read_events
    from .io.files.write import open_writer
    from .io.formats import EventReader, EventWriter, TruncatedFileWarning, WriteReport
    from .io.recordings import Recording, RecordingWarning, read_recording
    from .render.truth import EVENT_TRUTH_DTYPE, EventTruth, SceneSurfaces, event_truth
    from .sampling.presets import ACCURACY, Accuracy
    from .sampling.rules import FixedRate, MaxDisplacement
    from .sampling.tolerance import Tolerance
    from .scene.light_profile import Flicker, LightProfile, SampledProfile
    from .scene.load import load_scene, start_pose
    from .scene.lost_looks import LostLook, LostLookWarning
    from .scene.repairs import SceneFileWarning
    from .scene.scene import Scene
    from .sensor.biases import BIAS_SETS, CoarseFineBias
    from .sensor.clocks import ClockAlignment, align_clocks
    from .sensor.effects import Effects
    from .sensor.imu import Imu, simulate_imu
    from .sensor.motion_capture import MocapClock, MocapNoise, MotionCapture
    from .sensor.parameters import SensorParameters
    from .sensor.presets import SENSORS, load_sensor, save_sensor
    from .simulation.folder import SimulationReport, simulate_to_folder
    from .simulation.from_frames.events_from_frames import events_from_frames
    from .simulation.from_frames.frame_values import FrameValuesWarning
    from .simulation.from_frames.frames_folder import FramesReport, frames_to_folder
    from .simulation.from_frames.open_frames import open_frames
    from .simulation.monte_carlo_noise import estimate_noise
    from .simulation.no_events import NoEventsWarning
    from .simulation.noise_estimate import NoiseError, NoiseEstimate, NoiseWarning
    from .simulation.planning import EffectPlan, plan_effects
    from .simulation.simulate import simulate
    from .simulation.simulator import Simulator
    from .usb.davis import Davis
    from .usb.description import DavisDescription
    from .usb.raw_file import RawRecording, RawWriter
    from .usb.settings import DavisSettings

_MODULES = {
    "ACCURACY": "sampling.presets",
    "Accuracy": "sampling.presets",
    "ArgumentError": "_util.argument_error",
    "BIAS_SETS": "sensor.biases",
    "CallableTrajectory": "geometry.trajectory.trajectory",
    "Camera": "geometry.camera",
    "ClockAlignment": "sensor.clocks",
    "CoarseFineBias": "sensor.biases",
    "CrossingEngine": "_core",
    "Dataset": "io.dataset.reader",
    "DatasetWriter": "io.dataset.writer",
    "Davis": "usb.davis",
    "DavisDescription": "usb.description",
    "DavisSettings": "usb.settings",
    "DecodeError": "_core",
    "Decoded": "events.decoded",
    "Decoder": "_core",
    "Device": "_core",
    "Displacement": "events.packet",
    "EVENT_DTYPE": "events.arrays",
    "EVENT_TRUTH_DTYPE": "render.truth",
    "EffectPlan": "simulation.planning",
    "Effects": "sensor.effects",
    "Encoder": "_core",
    "EventComparison": "events.matching",
    "EventReader": "io.formats",
    "EventTruth": "render.truth",
    "EventWindow": "data.windows.window",
    "EventWindows": "data.windows.event_windows",
    "EventWriter": "io.formats",
    "FixedRate": "sampling.rules",
    "Flicker": "scene.light_profile",
    "Frame": "events.decoded",
    "FrameSource": "calibrate.sensor",
    "FrameValuesWarning": "simulation.from_frames.frame_values",
    "FramesReport": "simulation.from_frames.frames_folder",
    "GroundTruth": "geometry.pose",
    "IMU_COUNTS_DTYPE": "events.decoded",
    "IMU_DTYPE": "events.decoded",
    "HtmlPage": "inspection.html_page",
    "Imu": "sensor.imu",
    "LightProfile": "scene.light_profile",
    "LostLook": "scene.lost_looks",
    "LostLookWarning": "scene.lost_looks",
    "MaxDisplacement": "sampling.rules",
    "MeasuredRecording": "calibrate.sensor",
    "MocapClock": "sensor.motion_capture",
    "MocapNoise": "sensor.motion_capture",
    "MotionCapture": "sensor.motion_capture",
    "NoEventsWarning": "simulation.no_events",
    "NoiseError": "simulation.noise_estimate",
    "NoiseEstimate": "simulation.noise_estimate",
    "NoiseWarning": "simulation.noise_estimate",
    "Packet": "events.packet",
    "Pose": "geometry.pose",
    "RawRecording": "usb.raw_file",
    "RawWriter": "usb.raw_file",
    "Recording": "io.recordings",
    "RecordingWarning": "io.recordings",
    "SENSORS": "sensor.presets",
    "RerunRecording": "inspection.rerun_recording",
    "SampledProfile": "scene.light_profile",
    "SampledTrajectory": "geometry.trajectory.sampled_trajectory",
    "Scene": "scene.scene",
    "SceneFileWarning": "scene.repairs",
    "SceneSurfaces": "render.truth",
    "SegmentTrajectory": "geometry.trajectory.trajectory",
    "SensorFit": "calibrate.sensor",
    "SensorParameters": "sensor.parameters",
    "SimulationReport": "simulation.folder",
    "Simulator": "simulation.simulator",
    "StampedFrame": "calibrate.sensor",
    "StreamStatistics": "inspection.statistics",
    "TRIGGER_DTYPE": "events.decoded",
    "Tolerance": "sampling.tolerance",
    "Trajectory": "geometry.trajectory.trajectory",
    "TriggerKind": "events.decoded",
    "TruncatedFileWarning": "io.formats",
    "Velocities": "geometry.pose",
    "WriteReport": "io.formats",
    "__version__": "_core",
    "align": "geometry.trajectory.trajectory",
    "align_clocks": "sensor.clocks",
    "as_events": "events.arrays",
    "as_pose": "geometry.pose",
    "check_dataset": "inspection.check",
    "compare_events": "events.matching",
    "compare_streams": "inspection.statistics",
    "convert": "io.files.conversion",
    "estimate_noise": "simulation.monte_carlo_noise",
    "event_array": "events.arrays",
    "event_truth": "render.truth",
    "events_from_frames": "simulation.from_frames.events_from_frames",
    "fit_sensor": "calibrate.sensor",
    "frames_to_folder": "simulation.from_frames.frames_folder",
    "from_structured": "events.dtypes",
    "iter_events": "io.files.read",
    "load_camera": "geometry.camera",
    "load_scene": "scene.load",
    "load_sensor": "sensor.presets",
    "log_intensity": "_core",
    "make_video": "inspection.video",
    "measure_recording": "calibrate.sensor",
    "measure_stream": "inspection.statistics",
    "open_frames": "simulation.from_frames.open_frames",
    "open_reader": "io.files.read",
    "open_writer": "io.files.write",
    "plan_effects": "simulation.planning",
    "read_events": "io.files.read",
    "read_recording": "io.recordings",
    "read_trajectory": "geometry.trajectory.trajectory_file",
    "reconstruct": "_core",
    "save_sensor": "sensor.presets",
    "simulate": "simulation.simulate",
    "simulate_imu": "sensor.imu",
    "simulate_to_folder": "simulation.folder",
    "start_pose": "scene.load",
    "to_structured": "events.dtypes",
    "to_tonic": "events.dtypes",
    "view": "inspection.figure",
    "view_html": "inspection.html_page",
    "view_rerun": "inspection.rerun_recording",
    "waypoint_trajectory": "geometry.trajectory.waypoints",
    "write_trajectory": "io.dataset.write_trajectory",
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
    if name == "represent":
        return import_module(".events.represent", __name__)
    if name not in _MODULES:
        from ._util.close_names import did_you_mean

        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{did_you_mean(name, __all__)}", name=name)
    return getattr(import_module(f".{_MODULES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
