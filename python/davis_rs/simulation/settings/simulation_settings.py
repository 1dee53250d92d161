"""Declares the settings of a simulation, each once, as a field of a frozen dataclass.

Command-line options, keys of plans, the arguments of Python, what meta.json keeps and docs/settings.md all follow from
these fields. A dataclass lists its fields base by base from the last base to the first; tables and ``--help`` keep
that order.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...events.colour import PATTERNS, ColourFilter
from ...events.matching import LARGEST_WINDOW_US
from ...geometry.camera import PRESETS, Camera
from ...io.dataset.files import EVENT_FILES
from ...render.baked.bake import BAKE_ERROR
from ...render.choice import AUTO_RENDERER, AUTOMATIC, RENDERER_KINDS, RENDERERS
from ...render.native.estimators import ESTIMATORS
from ...sampling.presets import ACCURACY, DEFAULT_ACCURACY
from ...sampling.rules import TimeSampling
from ...sensor.effects import Effect, EffectsLike
from ...sensor.imu import IMU_EFFECTS, IMU_MODELS, Imu
from ...sensor.motion_capture import MotionCapture
from ...sensor.parameters import START_PHASES, SensorParameters
from ...sensor.presets import RECORDED, SENSOR_SUFFIXES, SENSORS
from .setting import Declared, Settings, declare

_ACCURACY = "accuracy and cost"
_TRUTH = "ground truth (docs/ground_truth.md)"
_INERTIAL = "IMU and ground truth (docs/trajectories_and_imu.md)"
EFFECTS = "effects (docs/effects.md)"
EFFECTS_TOLERANCE = 0.01
"""Where no tolerance is given."""

SENSOR = Declared(
    "a sensor's size, thresholds and effects: its name, or a sensor file such as mine.yaml (docs/sensor.md)",
    default_help="ideal pixels",
    choices=tuple(SENSORS),
    file_suffixes=SENSOR_SUFFIXES,
    group=EFFECTS,
    text=str,
)

COLOUR_FILTER = Declared(
    "Bayer pattern of colour filters before the pixels, each of which then sees its own colour (docs/colour.md); none: "
    "none, whatever the sensor has",
    default_help="the sensor's",
    choices=("none", *PATTERNS),
    group=EFFECTS,
    text=str,
)

EFFECT_FORM = "NAME[=VALUE[,PARAMETER=VALUE...]]"


@dataclass(frozen=True, kw_only=True)
class PixelSettings(Settings):
    """Declares what the pixels are like, wherever their light comes from."""

    contrast_threshold: float | None = declare(
        None,
        Declared(
            "C of ON events, in natural-log units",
            default_help="the sensor's, or else the scene's; 0.15 for frames",
            low=0,
            above_low=True,
            metavar="C",
        ),
    )
    contrast_threshold_off: float | None = declare(
        None,
        Declared(
            "C of OFF events",
            default_help="the sensor's, or else as ON",
            low=0,
            above_low=True,
            metavar="C",
        ),
    )
    lux_per_luma: float | None = declare(
        None,
        Declared(
            "brightness: illuminance that one unit of luma stands for",
            default_help="the scene's; 1000 for frames",
            unit="lux",
            low=0,
            above_low=True,
            metavar="LUX",
        ),
    )
    start_phase: str | None = declare(
        None,
        Declared(
            "where the pixels' references lie at the first frame: zero, at its log intensity; stationary, anywhere "
            "between both levels, as in a camera that has run before",
            default_help="stationary for a sensor, zero for ideal pixels",
            choices=START_PHASES,
        ),
    )
    seed: int = declare(
        0,
        Declared(
            "random seed of threshold mismatch, start phases, noise, IMU and motion capture, and of Mitsuba's "
            "integrators",
            low=0,
            high=2**64 - 1,
            metavar="N",
            group=_ACCURACY,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class ViewSettings(PixelSettings):
    """Declares how the sensor sees the scene; the planner of effects needs these settings too."""

    sensor: SensorParameters | str | os.PathLike[str] | None = declare(
        None,
        replace(
            SENSOR,
            help=f"{SENSOR.help}; {RECORDED}: of a sequence of the dataset, that of its recording",
            choices=(*SENSORS, RECORDED),
        ),
    )
    camera: Camera | str | os.PathLike[str] | None = declare(
        None,
        Declared(
            f"lens and size of the image: {', '.join(PRESETS)}, or a calib.txt",
            default_help="the scene's",
            metavar="CAMERA",
            text=str,
        ),
    )
    size: tuple[int, int] | str | None = declare(
        None,
        Declared(
            "size of the image in pixels, or of a camera, such as evk4; a calib.txt holds none",
            default_help="the camera's or the sensor's",
            metavar="WxH",
            text=str,
        ),
    )
    log_eps: float | None = declare(
        None,
        Declared(
            "dark level: L = ln(luma + log_eps)",
            default_help="the sensor's dark current, or 0.001",
            unit="luma",
            low=0,
            high=1e3,
            above_low=True,
            metavar="Y",
        ),
    )
    rays_per_pixel: int | str | None = declare(
        None,
        Declared(
            "rays per pixel; auto: as many as keep the noise of Mitsuba's integrators below the noise share, or the "
            "default if there is no noise",
            default_help="those of the accuracy; for Mitsuba's integrators 8, or 2 without LLVM",
            low=1,
            high=1024,
            words=("auto",),
            metavar="N",
            former_name="samples",
            group=_ACCURACY,
            text=int,
        ),
    )
    noise_share: float = declare(
        0.05,
        Declared(
            "share of events that the noise of Mitsuba's integrators may make missing or spurious: the run warns "
            "if there are more, and rays_per_pixel=auto stays below it",
            low=0,
            high=1,
            above_low=True,
            metavar="SHARE",
            group=_ACCURACY,
        ),
    )
    matte: bool = declare(
        False,
        Declared(
            "render materials with highlights or bumps by their diffuse colour alone, so that the native renderer can "
            "render them",
            group=_ACCURACY,
        ),
    )
    renderer: str = declare(
        AUTO_RENDERER,
        Declared(
            f"renderer: {', '.join(f'{kind.name} ({kind.summary})' for kind in RENDERER_KINDS.values())}, or auto: the "
            f"first possible one of {', '.join(kind.name for kind in AUTOMATIC)}",
            choices=RENDERERS,
            group=_ACCURACY,
        ),
    )
    pixel: str | None = declare(
        None,
        Declared(
            "what luma of a pixel is made of: rays, the mean over them; lines, its area by lines through it, without "
            "jumps at edges (the native renderer, diffuse surfaces; in place of 8, 32, 64 or 256 rays per pixel)",
            default_help="lines with balanced and exact, where they are possible and rays_per_pixel is not given; else "
            "rays",
            choices=tuple(ESTIMATORS),
            group=_ACCURACY,
        ),
    )
    colour_filter: ColourFilter | str | None = declare(None, COLOUR_FILTER)
    bake_error: float = declare(
        BAKE_ERROR,
        Declared(
            "relative error of baked light that is allowed (docs/light.md)",
            low=1e-3,
            high=1,
            metavar="SHARE",
            group=_ACCURACY,
        ),
    )
    blur: bool | None = declare(
        None,
        Declared(
            "3 x 3 blur of luma",
            default_help="as the scene has it",
            group=_ACCURACY,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class EffectsToleranceSettings(Settings):
    """Declares how effects are planned."""

    effects_tolerance: float | None = declare(
        None,
        Declared(
            "for planned effects: the relative error in event count, rate or time that leaving an effect out may cause "
            "(docs/effects.md)",
            default_help=str(EFFECTS_TOLERANCE),
            low=0,
            high=1,
            metavar="SHARE",
            group=EFFECTS,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class PlanSettings(EffectsToleranceSettings, ViewSettings):
    """Declares the settings of :func:`~davis_rs.plan_effects`."""


@dataclass(frozen=True, kw_only=True)
class EngineSettings(Settings):
    """Declares how the crossing engine runs, and whether a twin of it does."""

    threads: int | None = declare(
        None,
        Declared(
            "number of threads of the native renderer and of the crossing engine; results do not depend on it",
            default_help="as many as are useful",
            low=1,
            high=1024,
            metavar="N",
            group=_ACCURACY,
        ),
    )
    signal_window_us: int | None = declare(
        None,
        Declared(
            "label each event as signal or noise, in signal.npy: signal is what the same pixels make without noise, at "
            "most this far off; 10000 suits most sensors (docs/ground_truth.md)",
            default_help="no labels",
            unit="us",
            low=0,
            high=LARGEST_WINDOW_US,
            metavar="US",
            group=_TRUTH,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class FolderFileSettings(Settings):
    """Declares how frames and events are written into a folder."""

    events_format: str = declare(
        "text",
        Declared(
            "format of the folder's events: text (events.txt), or another file in its place (docs/formats.md)",
            choices=tuple(EVENT_FILES),
        ),
    )

    image_gain: float | None = declare(
        None,
        Declared(
            "gain of the 8-bit frames: grey = 255 x image gain x luma",
            default_help="chosen so that few pixels are white",
            low=0,
            above_low=True,
            metavar="GAIN",
        ),
    )


@dataclass(frozen=True, kw_only=True)
class SamplingSettings(EngineSettings, ViewSettings):
    """Declares what the sensor records, and how finely time is sampled."""

    frame_rate_hz: float = declare(
        40.0,
        Declared(
            "rate of intensity frames, the first at t = 0; 0 for none",
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
        ),
    )
    depth_rate_hz: float = declare(
        40.0,
        Declared(
            "rate of depth maps; 0 for none",
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
        ),
    )
    flow_rate_hz: float = declare(
        0.0,
        Declared(
            "rate of maps of optical flow; 0 for none",
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
            group=_TRUTH,
        ),
    )
    flow_interval_s: float | None = declare(
        None,
        Declared(
            "write with each map of flow how far points move in the image in this time, and which are then hidden",
            default_help="none",
            unit="s",
            low=1e-6,
            high=1e3,
            metavar="S",
            group=_TRUTH,
        ),
    )
    mask_rate_hz: float = declare(
        0.0,
        Declared(
            "rate of maps of the shapes that the pixels see; 0 for none",
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
            group=_TRUTH,
        ),
    )
    normal_rate_hz: float = declare(
        0.0,
        Declared(
            "rate of maps of the surfaces' normals; 0 for none",
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
            group=_TRUTH,
        ),
    )
    accuracy: str = declare(
        DEFAULT_ACCURACY,
        Declared(
            "a preset of docs/accuracy.md; settings of sampling in time, rays per pixel and refine override their part "
            "of it",
            choices=tuple(ACCURACY),
            group=_ACCURACY,
        ),
    )
    render_rate_hz: float | None = declare(
        None,
        Declared(
            "render at a fixed rate, and also at frames, at depth maps and at the ends of packets (40 per second)",
            unit="Hz",
            low=0,
            high=1e6,
            above_low=True,
            metavar="HZ",
            group=_ACCURACY,
        ),
    )
    max_displacement_px: float | None = declare(
        None,
        Declared(
            "render whenever the image has moved by this many pixels; 1/3 in the paper",
            unit="px",
            low=0,
            high=1e3,
            above_low=True,
            metavar="PX",
            group=_ACCURACY,
        ),
    )
    tolerance: float | None = declare(
        None,
        Declared(
            "render often enough to keep the error of log luma below this share of C",
            low=0,
            high=10,
            above_low=True,
            metavar="SHARE",
            group=_ACCURACY,
        ),
    )
    sampling: TimeSampling | None = declare(
        None,
        Declared(
            "your own rule of sampling in time",
            text=None,
            group=_ACCURACY,
        ),
    )
    refine: bool | None = declare(
        None,
        Declared(
            "refine each event's time to the microsecond with the renderer; slow, ideal pixels only",
            default_help="as the accuracy says: exact refines what rays see, not lines",
            group=_ACCURACY,
        ),
    )
    poses_per_launch: int | None = declare(
        None,
        Declared(
            "poses that are rendered in one call at most; results do not depend on it",
            default_help="the renderer's choice",
            low=1,
            text=None,
            group=_ACCURACY,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class CustomSettings(SamplingSettings):
    """Declares what a user adds of their own."""

    custom_effects: object | None = declare(
        None,
        Declared(
            "an effect of your own, in Python (docs/effects.md): MODULE:NAME or FILE.py:NAME; from Python also objects",
            default_help="none",
            metavar="MODULE:NAME",
            text=list,
            group=EFFECTS,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class SimulatorSettings(CustomSettings):
    """Declares the settings of :class:`~davis_rs.Simulator`."""

    effects: EffectsLike | None = declare(
        None,
        Declared(
            "effects; each is added to the sensor's, or replaces the sensor's of the same name",
            default_help="the sensor's",
            text=None,
            group=EFFECTS,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class SimulationSettings(EffectsToleranceSettings, CustomSettings):
    """Declares the settings of :func:`~davis_rs.simulate`: a simulator's, with effects that may be planned first."""

    effects: EffectsLike | None = declare(
        None,
        Declared(
            f"effects {EFFECT_FORM}; each is added to the sensor's, or replaces the sensor's of the same name. auto "
            "takes those effects of the sensor (davis240c if not given) that matter in this scene",
            default_help="the sensor's",
            metavar=EFFECT_FORM,
            text=list,
            group=EFFECTS,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class FolderSettings(FolderFileSettings, SimulationSettings):
    """Declares the settings of :func:`~davis_rs.simulate_to_folder`: a simulation's, and what is written next to the
    events."""

    accept_noise: bool | None = declare(
        None,
        Declared(
            "run even if the noise of Mitsuba's integrators makes more than 20 % of the events missing or spurious (or "
            "than noise_share, if that is more); if that is not accepted, such a run is refused before it renders",
            default_help="such a run is refused; in Python it only warns",
            group=_ACCURACY,
        ),
    )
    imu: Imu | str | None = declare(
        None,
        Declared(
            "write imu.txt: ideal (at the camera's centre), davis (ideal, where the DAVIS240C has it), mpu6150 (there, "
            "with all of its effects), none",
            default_help="none",
            choices=("none", *IMU_MODELS),
            group=_INERTIAL,
            text=str,
        ),
    )
    imu_rate_hz: float | None = declare(
        None,
        Declared(
            "rate of the IMU's samples",
            default_help="1000",
            unit="Hz",
            low=0,
            above_low=True,
            metavar="HZ",
            group=_INERTIAL,
        ),
    )
    imu_effects: Mapping[str, Any] | str | Sequence[str | Effect] | None = declare(
        None,
        Declared(
            f"imperfections of the IMU, in addition to those of --imu or in place of them: {', '.join(IMU_EFFECTS)}",
            metavar=EFFECT_FORM,
            text=list,
            group=_INERTIAL,
        ),
    )
    flow_png: str | None = declare(
        None,
        Declared(
            "write displacements (flow_interval) as 16-bit PNG too: kitti (steps of 1/64 px, up to 512 px) or dsec "
            "(1/128 px, up to 256 px)",
            default_help="none",
            choices=("kitti", "dsec"),
            group=_TRUTH,
        ),
    )
    event_truth: str | None = declare(
        None,
        Declared(
            "write depth, flow and shape at each event's own pixel and time: into event_truth.h5 or event_truth.npz",
            default_help="none",
            choices=("h5", "npz"),
            group=_TRUTH,
        ),
    )
    velocity_rate_hz: float = declare(
        0.0,
        Declared(
            "write velocity.txt at this rate: the camera's velocities and accelerations; 0 for none",
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
            group=_TRUTH,
        ),
    )
    pose_rate_hz: float = declare(
        200.0,
        Declared(
            "rate of the ground truth's poses; 0 for none",
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
            group=_INERTIAL,
        ),
    )
    pose_noise_m: float | None = declare(
        None,
        Declared(
            "standard deviation of the noise of ground-truth positions",
            default_help="0",
            unit="m",
            low=0,
            metavar="M",
            group=_INERTIAL,
        ),
    )
    rotation_noise_rad: float | None = declare(
        None,
        Declared(
            "standard deviation of the noise of ground-truth rotations",
            default_help="0",
            unit="rad",
            low=0,
            metavar="RAD",
            group=_INERTIAL,
        ),
    )
    clock_offset_s: float | None = declare(
        None,
        Declared(
            "time that the clock of the ground truth shows at the camera's start",
            default_help="0",
            unit="s",
            metavar="S",
            group=_INERTIAL,
        ),
    )
    clock_drift_ms_per_min: float | None = declare(
        None,
        Declared(
            "drift of the clock of the ground truth; 2 in the paper",
            default_help="0",
            unit="ms/min",
            metavar="MS_PER_MIN",
            group=_INERTIAL,
        ),
    )
    motion_capture: MotionCapture | None = declare(
        None,
        Declared(
            "a motion-capture system that gives the ground truth, in place of the five settings above",
            text=None,
            group=_INERTIAL,
        ),
    )
