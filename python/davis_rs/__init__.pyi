"""What ``davis_rs`` exports: the only list of it. Each name is imported when it is asked for."""

from ._core import (
    CrossingEngine as CrossingEngine,
)
from ._core import (
    DecodeError as DecodeError,
)
from ._core import (
    Decoder as Decoder,
)
from ._core import (
    Device as Device,
)
from ._core import (
    Encoder as Encoder,
)
from ._core import (
    __version__ as __version__,
)
from ._core import (
    log_intensity as log_intensity,
)
from ._core import (
    reconstruct as reconstruct,
)
from ._util.argument_error import ArgumentError as ArgumentError
from .calibrate.sensor import (
    FrameSource as FrameSource,
)
from .calibrate.sensor import (
    MeasuredRecording as MeasuredRecording,
)
from .calibrate.sensor import (
    SensorFit as SensorFit,
)
from .calibrate.sensor import (
    StampedFrame as StampedFrame,
)
from .calibrate.sensor import (
    fit_sensor as fit_sensor,
)
from .calibrate.sensor import (
    measure_recording as measure_recording,
)
from .data.windows.event_windows import EventWindows as EventWindows
from .data.windows.window import EventWindow as EventWindow
from .events import filters as filters
from .events import represent as represent
from .events.arrays import EVENT_DTYPE as EVENT_DTYPE
from .events.arrays import as_events as as_events
from .events.arrays import event_array as event_array
from .events.colour import ColourFilter as ColourFilter
from .events.colour import demosaic as demosaic
from .events.decoded import (
    IMU_COUNTS_DTYPE as IMU_COUNTS_DTYPE,
)
from .events.decoded import (
    IMU_DTYPE as IMU_DTYPE,
)
from .events.decoded import (
    TRIGGER_DTYPE as TRIGGER_DTYPE,
)
from .events.decoded import (
    Decoded as Decoded,
)
from .events.decoded import (
    Frame as Frame,
)
from .events.decoded import (
    TriggerKind as TriggerKind,
)
from .events.dtypes import from_structured as from_structured
from .events.dtypes import to_structured as to_structured
from .events.dtypes import to_tonic as to_tonic
from .events.matching import EventComparison as EventComparison
from .events.matching import compare_events as compare_events
from .events.packet import Displacement as Displacement
from .events.packet import Packet as Packet
from .events.signal_labels import SignalLabels as SignalLabels
from .events.signal_labels import label_signal as label_signal
from .geometry.camera import Camera as Camera
from .geometry.camera import load_camera as load_camera
from .geometry.pose import GroundTruth as GroundTruth
from .geometry.pose import Pose as Pose
from .geometry.pose import Velocities as Velocities
from .geometry.pose import as_pose as as_pose
from .geometry.trajectory.sampled_trajectory import SampledTrajectory as SampledTrajectory
from .geometry.trajectory.trajectory import (
    CallableTrajectory as CallableTrajectory,
)
from .geometry.trajectory.trajectory import (
    SegmentTrajectory as SegmentTrajectory,
)
from .geometry.trajectory.trajectory import (
    Trajectory as Trajectory,
)
from .geometry.trajectory.trajectory import (
    align as align,
)
from .geometry.trajectory.trajectory_file import read_trajectory as read_trajectory
from .geometry.trajectory.waypoints import waypoint_trajectory as waypoint_trajectory
from .inspection.check import check_dataset as check_dataset
from .inspection.event_image import EventImage as EventImage
from .inspection.event_image import show as show
from .inspection.figure import view as view
from .inspection.html_page import HtmlPage as HtmlPage
from .inspection.html_page import view_html as view_html
from .inspection.live_view import LiveView as LiveView
from .inspection.rerun_recording import RerunRecording as RerunRecording
from .inspection.rerun_recording import view_rerun as view_rerun
from .inspection.statistics import (
    StreamStatistics as StreamStatistics,
)
from .inspection.statistics import (
    compare_streams as compare_streams,
)
from .inspection.statistics import (
    measure_stream as measure_stream,
)
from .inspection.video import make_video as make_video
from .io.dataset.reader import Dataset as Dataset
from .io.dataset.rig_folder import RigDataset as RigDataset
from .io.dataset.write_trajectory import write_trajectory as write_trajectory
from .io.dataset.writer import DatasetWriter as DatasetWriter
from .io.files.conversion import convert as convert
from .io.files.read import iter_events as iter_events
from .io.files.read import open_reader as open_reader
from .io.files.read import read_events as read_events
from .io.files.rig_layouts import RigConversionReport as RigConversionReport
from .io.files.rig_layouts import convert_rig as convert_rig
from .io.files.write import open_writer as open_writer
from .io.formats import (
    EventReader as EventReader,
)
from .io.formats import (
    EventWriter as EventWriter,
)
from .io.formats import (
    TruncatedFileWarning as TruncatedFileWarning,
)
from .io.formats import (
    WriteReport as WriteReport,
)
from .io.recordings import (
    Recording as Recording,
)
from .io.recordings import (
    RecordingWarning as RecordingWarning,
)
from .io.recordings import (
    read_recording as read_recording,
)
from .render.truth import (
    EVENT_TRUTH_DTYPE as EVENT_TRUTH_DTYPE,
)
from .render.truth import (
    EventTruth as EventTruth,
)
from .render.truth import (
    SceneSurfaces as SceneSurfaces,
)
from .render.truth import (
    event_truth as event_truth,
)
from .reproduction import (
    Reproduction as Reproduction,
)
from .reproduction import (
    reproduce as reproduce,
)
from .sampling.presets import ACCURACY as ACCURACY
from .sampling.presets import Accuracy as Accuracy
from .sampling.rules import FixedRate as FixedRate
from .sampling.rules import MaxDisplacement as MaxDisplacement
from .sampling.tolerance import Tolerance as Tolerance
from .scene.default_motion import with_default_motion as with_default_motion
from .scene.deformation import Deformation as Deformation
from .scene.deformation import DeformedMesh as DeformedMesh
from .scene.deformation import MovingPoints as MovingPoints
from .scene.light_profile import Flicker as Flicker
from .scene.light_profile import LightProfile as LightProfile
from .scene.light_profile import SampledProfile as SampledProfile
from .scene.load import load_scene as load_scene
from .scene.load import start_pose as start_pose
from .scene.lost_looks import LostLook as LostLook
from .scene.lost_looks import LostLookWarning as LostLookWarning
from .scene.repairs import SceneFileWarning as SceneFileWarning
from .scene.scene import Scene as Scene
from .scene.vertex_keyframes import VertexKeyframes as VertexKeyframes
from .sensor.biases import BIAS_SETS as BIAS_SETS
from .sensor.biases import CoarseFineBias as CoarseFineBias
from .sensor.clocks import ClockAlignment as ClockAlignment
from .sensor.clocks import align_clocks as align_clocks
from .sensor.effects import Effects as Effects
from .sensor.imu import Imu as Imu
from .sensor.imu import simulate_imu as simulate_imu
from .sensor.motion_capture import MocapClock as MocapClock
from .sensor.motion_capture import MocapNoise as MocapNoise
from .sensor.motion_capture import MotionCapture as MotionCapture
from .sensor.parameters import SensorParameters as SensorParameters
from .sensor.presets import SENSORS as SENSORS
from .sensor.presets import load_sensor as load_sensor
from .sensor.presets import save_sensor as save_sensor
from .sensor.rig import RIGS as RIGS
from .sensor.rig import CameraClock as CameraClock
from .sensor.rig import Rig as Rig
from .sensor.rig import RigCamera as RigCamera
from .sensor.rig import RigImu as RigImu
from .sensor.rig import load_rig as load_rig
from .simulation.folder import SimulationReport as SimulationReport
from .simulation.folder import simulate_to_folder as simulate_to_folder
from .simulation.from_frames.events_from_frames import events_from_frames as events_from_frames
from .simulation.from_frames.frame_values import FrameValuesWarning as FrameValuesWarning
from .simulation.from_frames.frames_folder import FramesReport as FramesReport
from .simulation.from_frames.frames_folder import frames_to_folder as frames_to_folder
from .simulation.from_frames.open_frames import open_frames as open_frames
from .simulation.jumps import JumpWarning as JumpWarning
from .simulation.monte_carlo_noise import estimate_noise as estimate_noise
from .simulation.no_events import NoEventsWarning as NoEventsWarning
from .simulation.noise_estimate import (
    NoiseError as NoiseError,
)
from .simulation.noise_estimate import (
    NoiseEstimate as NoiseEstimate,
)
from .simulation.noise_estimate import (
    NoiseWarning as NoiseWarning,
)
from .simulation.planning import EffectPlan as EffectPlan
from .simulation.planning import plan_effects as plan_effects
from .simulation.rig import RigReport as RigReport
from .simulation.rig import RigSimulator as RigSimulator
from .simulation.rig import simulate_rig as simulate_rig
from .simulation.rig import simulate_rig_to_folder as simulate_rig_to_folder
from .simulation.simulate import simulate as simulate
from .simulation.simulator import Simulator as Simulator
from .usb.davis import Davis as Davis
from .usb.description import DavisDescription as DavisDescription
from .usb.raw_file import RawRecording as RawRecording
from .usb.raw_file import RawWriter as RawWriter
from .usb.settings import DavisSettings as DavisSettings

__all__: list[str]
from .sensor.rig import Rectification as Rectification
from .sensor.rig import StereoTruth as StereoTruth
from .sensor.rig import rectify as rectify
from .sensor.rig import stereo_truth as stereo_truth
