"""The settings of a simulation, each declared once.

Command-line options, keys of plans, the arguments of Python, what meta.json keeps and docs/settings.md all follow from
these declarations.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, TypedDict

from ...geometry.camera import PRESETS, Camera
from ...io.dataset.files import EVENT_FILES
from ...render.baked.bake import BAKE_ERROR
from ...render.choice import AUTOMATIC, KINDS, RENDERERS
from ...sampling.presets import ACCURACY, DEFAULT_ACCURACY
from ...sampling.rules import TimeSampling
from ...sensor.effects import Effect, EffectsLike
from ...sensor.imu import IMU_EFFECTS, Imu
from ...sensor.motion_capture import MotionCapture
from ...sensor.parameters import START_PHASES, SensorParameters
from ...sensor.presets import RECORDED, SENSOR_SUFFIXES, SENSORS
from .setting import Declared

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

EFFECT_FORM = "NAME[=VALUE[,PARAMETER=VALUE...]]"


class PixelSettings(TypedDict, total=False):
    """What the pixels are like, wherever their light comes from."""

    contrast_threshold: Annotated[
        float | None,
        Declared(
            "C of ON events, in natural-log units",
            default_help="the sensor's, or else the scene's; 0.15 for frames",
            low=0,
            above_low=True,
            metavar="C",
        ),
    ]
    contrast_threshold_off: Annotated[
        float | None,
        Declared("C of OFF events", default_help="the sensor's, or else as ON", low=0, above_low=True, metavar="C"),
    ]
    lux_per_luma: Annotated[
        float | None,
        Declared(
            "brightness: illuminance that one unit of luma stands for",
            default_help="the scene's; 1000 for frames",
            unit="lux",
            low=0,
            above_low=True,
            metavar="LUX",
        ),
    ]
    start_phase: Annotated[
        str | None,
        Declared(
            "where the pixels' references lie at the first frame: zero, at its log intensity; stationary, anywhere "
            "between both levels, as in a camera that has run before",
            default_help="stationary for a sensor, zero for ideal pixels",
            choices=START_PHASES,
        ),
    ]
    seed: Annotated[
        int,
        Declared(
            "random seed of threshold mismatch, start phases, noise, IMU and motion capture, and of Mitsuba's "
            "integrators",
            0,
            low=0,
            high=2**64 - 1,
            metavar="N",
            group=_ACCURACY,
        ),
    ]


class ViewSettings(PixelSettings, total=False):
    """How the sensor sees the scene; the planner of effects needs these settings too."""

    sensor: Annotated[
        SensorParameters | str | os.PathLike[str] | None,
        replace(
            SENSOR,
            help=f"{SENSOR.help}; {RECORDED}: of a sequence of the dataset, that of its recording",
            choices=(*SENSORS, RECORDED),
        ),
    ]
    camera: Annotated[
        Camera | str | os.PathLike[str] | None,
        Declared(
            f"lens and size of the image: {', '.join(PRESETS)}, or a calib.txt",
            default_help="the scene's",
            metavar="CAMERA",
            text=str,
        ),
    ]
    size: Annotated[
        tuple[int, int] | str | None,
        Declared(
            "size of the image in pixels, which a calib.txt does not hold",
            default_help="the camera's or the sensor's",
            metavar="WxH",
            text=str,
        ),
    ]
    log_eps: Annotated[
        float | None,
        Declared(
            "dark level: L = ln(luma + log_eps)",
            default_help="the sensor's dark current, or 0.001",
            unit="luma",
            low=0,
            high=1e3,
            above_low=True,
            metavar="Y",
        ),
    ]
    samples: Annotated[
        int | str | None,
        Declared(
            "rays per pixel; auto: as many as keep the noise of Mitsuba's integrators below the noise share, or the "
            "default if there is no noise",
            default_help="those of the accuracy; for Mitsuba's integrators 8, or 2 without LLVM",
            low=1,
            high=1024,
            words=("auto",),
            metavar="N",
            group=_ACCURACY,
            text=int,
        ),
    ]
    noise_share: Annotated[
        float,
        Declared(
            "share of events that the noise of Mitsuba's integrators may make missing or spurious: the run warns "
            "if there are more, and samples=auto stays below it",
            0.05,
            low=0,
            high=1,
            above_low=True,
            metavar="SHARE",
            group=_ACCURACY,
        ),
    ]
    matte: Annotated[
        bool,
        Declared(
            "render materials with highlights or bumps by their diffuse colour alone, so that the native renderer can "
            "render them",
            False,
            group=_ACCURACY,
        ),
    ]
    renderer: Annotated[
        str,
        Declared(
            f"renderer: {', '.join(f'{kind.name} ({kind.summary})' for kind in KINDS.values())}, or auto: the first "
            f"possible one of {', '.join(kind.name for kind in AUTOMATIC)}",
            "auto",
            choices=RENDERERS,
            group=_ACCURACY,
        ),
    ]
    bake_error: Annotated[
        float,
        Declared(
            "relative error of baked light that is allowed (docs/light.md)",
            BAKE_ERROR,
            low=1e-3,
            high=1,
            metavar="SHARE",
            group=_ACCURACY,
        ),
    ]
    blur: Annotated[bool | None, Declared("3 x 3 blur of luma", default_help="as the scene has it", group=_ACCURACY)]


class EffectsToleranceSettings(TypedDict, total=False):
    """How effects are planned."""

    effects_tolerance: Annotated[
        float | None,
        Declared(
            "for planned effects: the relative error in event count, rate or time that leaving an effect out may cause "
            "(docs/effects.md)",
            default_help=str(EFFECTS_TOLERANCE),
            low=0,
            high=1,
            metavar="SHARE",
            group=EFFECTS,
        ),
    ]


class PlanSettings(ViewSettings, EffectsToleranceSettings, total=False):
    """The settings of :func:`~davis_rs.plan_effects`."""


class EngineSettings(TypedDict, total=False):
    """How the crossing engine runs."""

    threads: Annotated[
        int | None,
        Declared(
            "number of threads of the native renderer and of the crossing engine; results do not depend on it",
            default_help="as many as are useful",
            low=1,
            high=1024,
            metavar="N",
            group=_ACCURACY,
        ),
    ]


class FolderFileSettings(TypedDict, total=False):
    """How frames and events are written into a folder."""

    events_format: Annotated[
        str,
        Declared(
            "format of the folder's events: text (events.txt), or another file in its place (docs/formats.md)",
            "text",
            choices=tuple(EVENT_FILES),
        ),
    ]

    image_gain: Annotated[
        float | None,
        Declared(
            "gain of the 8-bit frames: grey = 255 x image gain x luma",
            default_help="chosen from the first frame",
            low=0,
            above_low=True,
            metavar="GAIN",
        ),
    ]


class SamplingSettings(ViewSettings, EngineSettings, total=False):
    """What the sensor records, and how finely time is sampled."""

    frame_rate_hz: Annotated[
        float,
        Declared(
            "rate of intensity frames, the first at t = 0; 0 for none",
            40.0,
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
        ),
    ]
    depth_rate_hz: Annotated[
        float, Declared("rate of depth maps; 0 for none", 40.0, unit="Hz", low=0, high=1e6, metavar="HZ")
    ]
    flow_rate_hz: Annotated[
        float,
        Declared(
            "rate of maps of optical flow; 0 for none", 0.0, unit="Hz", low=0, high=1e6, metavar="HZ", group=_TRUTH
        ),
    ]
    flow_interval_s: Annotated[
        float | None,
        Declared(
            "write with each map of flow how far points move in the image in this time, and which are then hidden",
            default_help="none",
            unit="s",
            low=1e-6,
            high=1e3,
            metavar="S",
            group=_TRUTH,
        ),
    ]
    mask_rate_hz: Annotated[
        float,
        Declared(
            "rate of maps of the shapes that the pixels see; 0 for none",
            0.0,
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
            group=_TRUTH,
        ),
    ]
    normal_rate_hz: Annotated[
        float,
        Declared(
            "rate of maps of the surfaces' normals; 0 for none",
            0.0,
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
            group=_TRUTH,
        ),
    ]
    accuracy: Annotated[
        str,
        Declared(
            "a preset of docs/accuracy.md; settings of sampling in time, samples and refine override their part of it",
            DEFAULT_ACCURACY,
            choices=tuple(ACCURACY),
            group=_ACCURACY,
        ),
    ]
    render_rate_hz: Annotated[
        float | None,
        Declared(
            "render at a fixed rate, and also at frames, at depth maps and at the ends of packets (40 per second)",
            unit="Hz",
            low=0,
            high=1e6,
            above_low=True,
            metavar="HZ",
            group=_ACCURACY,
        ),
    ]
    max_displacement_px: Annotated[
        float | None,
        Declared(
            "render whenever the image has moved by this many pixels; 1/3 in the paper",
            unit="px",
            low=0,
            high=1e3,
            above_low=True,
            metavar="PX",
            group=_ACCURACY,
        ),
    ]
    tolerance: Annotated[
        float | None,
        Declared(
            "render often enough to keep the error of log luma below this share of C",
            low=0,
            high=10,
            above_low=True,
            metavar="SHARE",
            group=_ACCURACY,
        ),
    ]
    sampling: Annotated[TimeSampling | None, Declared("your own rule of sampling in time", text=None, group=_ACCURACY)]
    refine: Annotated[
        bool | None,
        Declared(
            "refine each event's time to the microsecond with the renderer; slow, ideal pixels only",
            default_help="as the accuracy says",
            group=_ACCURACY,
        ),
    ]
    poses_per_launch: Annotated[
        int | None,
        Declared(
            "poses that are rendered in one call; results do not depend on it",
            default_help="the renderer's choice",
            low=1,
            text=None,
            group=_ACCURACY,
        ),
    ]


class CustomSettings(SamplingSettings, total=False):
    """What a user adds of their own."""

    custom_effects: Annotated[
        object | None,
        Declared(
            "an effect of your own, in Python (docs/effects.md): MODULE:NAME or FILE.py:NAME; from Python also objects",
            default_help="none",
            metavar="MODULE:NAME",
            text=list,
            group=EFFECTS,
        ),
    ]


class SimulatorSettings(CustomSettings, total=False):
    """The settings of :class:`~davis_rs.Simulator`."""

    effects: Annotated[
        EffectsLike | None,
        Declared(
            "effects; each is added to the sensor's, or replaces the sensor's of the same name",
            default_help="the sensor's",
            text=None,
            group=EFFECTS,
        ),
    ]


class SimulationSettings(CustomSettings, EffectsToleranceSettings, total=False):
    """The settings of :func:`~davis_rs.simulate`: a simulator's, with effects that may be planned first."""

    effects: Annotated[
        EffectsLike | None,
        Declared(
            f"effects {EFFECT_FORM}; each is added to the sensor's, or replaces the sensor's of the same name. auto "
            "takes those effects of the sensor (davis240c if not given) that matter in this scene",
            default_help="the sensor's",
            metavar=EFFECT_FORM,
            text=list,
            group=EFFECTS,
        ),
    ]


class FolderSettings(SimulationSettings, FolderFileSettings, total=False):
    """The settings of :func:`~davis_rs.simulate_to_folder`: a simulation's, and what is written next to the events."""

    accept_noise: Annotated[
        bool | None,
        Declared(
            "run even if the noise of Mitsuba's integrators makes more than 20 % of the events missing or spurious (or "
            "than noise_share, if that is more); if that is not accepted, such a run is refused before it renders",
            default_help="such a run is refused; in Python it only warns",
            group=_ACCURACY,
        ),
    ]
    imu: Annotated[
        Imu | str | None,
        Declared(
            "write imu.txt: ideal (at the camera's centre), davis (ideal, where the DAVIS240C has it), mpu6150 (there, "
            "with all of its effects), none",
            default_help="none",
            choices=("none", "ideal", "davis", "mpu6150"),
            group=_INERTIAL,
            text=str,
        ),
    ]
    imu_rate_hz: Annotated[
        float | None,
        Declared(
            "rate of the IMU's samples",
            default_help="1000",
            unit="Hz",
            low=0,
            above_low=True,
            metavar="HZ",
            group=_INERTIAL,
        ),
    ]
    imu_effects: Annotated[
        Mapping[str, Any] | str | Sequence[str | Effect] | None,
        Declared(
            f"imperfections of the IMU, in addition to those of --imu or in place of them: {', '.join(IMU_EFFECTS)}",
            metavar=EFFECT_FORM,
            text=list,
            group=_INERTIAL,
        ),
    ]
    flow_png: Annotated[
        str | None,
        Declared(
            "write displacements (flow_interval) as 16-bit PNG too: kitti (steps of 1/64 px, up to 512 px) or dsec "
            "(1/128 px, up to 256 px)",
            default_help="none",
            choices=("kitti", "dsec"),
            group=_TRUTH,
        ),
    ]
    event_truth: Annotated[
        str | None,
        Declared(
            "write depth, flow and shape at each event's own pixel and time: into event_truth.h5 or event_truth.npz",
            default_help="none",
            choices=("h5", "npz"),
            group=_TRUTH,
        ),
    ]
    velocity_rate_hz: Annotated[
        float,
        Declared(
            "write velocity.txt at this rate: the camera's velocities and accelerations; 0 for none",
            0.0,
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
            group=_TRUTH,
        ),
    ]
    pose_rate_hz: Annotated[
        float,
        Declared(
            "rate of the ground truth's poses; 0 for none",
            200.0,
            unit="Hz",
            low=0,
            high=1e6,
            metavar="HZ",
            group=_INERTIAL,
        ),
    ]
    pose_noise_m: Annotated[
        float | None,
        Declared(
            "standard deviation of the noise of ground-truth positions",
            default_help="0",
            unit="m",
            low=0,
            metavar="M",
            group=_INERTIAL,
        ),
    ]
    rotation_noise_rad: Annotated[
        float | None,
        Declared(
            "standard deviation of the noise of ground-truth rotations",
            default_help="0",
            unit="rad",
            low=0,
            metavar="RAD",
            group=_INERTIAL,
        ),
    ]
    clock_offset_s: Annotated[
        float | None,
        Declared(
            "time that the clock of the ground truth shows at the camera's start",
            default_help="0",
            unit="s",
            metavar="S",
            group=_INERTIAL,
        ),
    ]
    clock_drift_ms_per_min: Annotated[
        float | None,
        Declared(
            "drift of the clock of the ground truth; 2 in the paper",
            default_help="0",
            unit="ms/min",
            metavar="MS_PER_MIN",
            group=_INERTIAL,
        ),
    ]
    motion_capture: Annotated[
        MotionCapture | None,
        Declared(
            "a motion-capture system that gives the ground truth, in place of the five settings above",
            text=None,
            group=_INERTIAL,
        ),
    ]
