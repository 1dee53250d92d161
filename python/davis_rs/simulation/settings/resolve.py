"""What settings stand for with a given scene: camera, thresholds, sampling and effects, each of them decided."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import Any, cast

from ..._util.argument_error import ArgumentError
from ..._util.memory_forecast import MemoryForecast, simulation_forecast
from ...geometry.camera import Camera
from ...sampling.presets import ACCURACY, DEFAULT_ACCURACY
from ...sampling.rules import FixedRate, MaxDisplacement, TimeSampling
from ...sampling.tolerance import Tolerance
from ...scene.scene import Scene, check_scene
from ...sensor.effects import Effects
from ...sensor.parameters import SensorParameters
from ...sensor.presets import RECORDED, read_once, recorded_sensor, sensor_parameters
from .image_camera import image_camera
from .simulation_settings import SimulatorSettings, ViewSettings

AUTO = "auto"
"""In place of a number of samples: chosen by the noise, see :mod:`~davis_rs.simulation.monte_carlo_noise`."""

LOG_EPS = 1e-3
"""The dark level in units of luma where neither settings nor sensor say it."""

_RULES = {"render_rate_hz": FixedRate, "max_displacement_px": MaxDisplacement, "tolerance": Tolerance}


@dataclass(frozen=True)
class ViewedScene:
    """A scene as a sensor sees it: what a planner of effects needs.

    Attributes:
        scene: in the settings' light.
        camera: lens and size of the image.
        sensor: its parameters, those of ideal pixels where none is given.
        contrast_threshold, contrast_threshold_off: C_on and C_off in natural-log units.
        log_eps: dark level in units of luma.
        start_phase: where references lie at the first frame.
    """

    scene: Scene
    camera: Camera
    sensor: SensorParameters
    contrast_threshold: float
    contrast_threshold_off: float
    log_eps: float
    start_phase: str

    @property
    def sensor_effects(self) -> Effects:
        """The settings of the sensor, in this scene's light."""
        return self.sensor.effects(self.scene.lux_per_luma)


def view_scene(scene: Scene, settings: ViewSettings) -> ViewedScene:
    """Decide what :class:`~davis_rs.simulation.settings.ViewSettings` leave open.

    Raises:
        ValueError, OSError: as :func:`~davis_rs.simulation.settings.image_camera.image_camera` and
            :func:`~davis_rs.load_sensor`; ValueError also for an image for which there is not enough memory, whatever
            else is asked for.
    """
    check_scene(scene)
    if settings["lux_per_luma"] is not None:
        scene = replace(scene, lux_per_luma=settings["lux_per_luma"])
    if settings["matte"]:
        scene = replace(scene, matte=True)
    sensor = sensor_parameters(fixed_sensor(scene, settings["sensor"]))
    camera = image_camera(scene, settings["camera"], settings["size"], sensor)
    simulation_forecast((camera.width, camera.height)).refuse()
    log_eps = _first(settings["log_eps"], sensor.dark_luma(scene.lux_per_luma), LOG_EPS)
    on = _first(settings["contrast_threshold"], sensor.contrast_threshold, scene.contrast_threshold)
    off = _first(settings["contrast_threshold_off"], sensor.contrast_threshold_off, on)
    return ViewedScene(scene, camera, sensor, on, off, log_eps, settings["start_phase"] or sensor.start_phase)


def fixed_sensor(
    scene: Scene, sensor: str | os.PathLike[str] | SensorParameters | None
) -> str | SensorParameters | None:
    """Resolve a sensor that is a file or the recording's to its parameters; leave any other as it is.

    A run decides it once, so that all of its parts, and its record, have the same one.

    Raises:
        ValueError: for the recorded sensor of a scene without a recording; else as :func:`~davis_rs.load_sensor`.
        OSError: as there.
    """
    if sensor != RECORDED:
        return read_once(sensor)
    if scene.biases is None:
        raise ArgumentError(
            "{sensor} {!r} is that of a recorded sequence of the dataset (davis-rs sequences), "
            "but scene {!r} has no recording",
            *(RECORDED, scene.name),
        )
    return recorded_sensor(scene.biases)


def renderer_settings(settings: ViewSettings) -> dict[str, Any]:
    """What :func:`~davis_rs.render.choice.make_renderer` takes of :class:`~davis_rs.simulation.settings.ViewSettings`.

    All that render a scene before its run take it from here, so that they render what the run does, and light is baked
    once. Samples that are to be chosen are left to the renderer. Without ``accuracy`` they are those of the default.
    """
    return {
        "samples": None if settings["samples"] == AUTO else settings["samples"],
        "lattice_samples": ACCURACY[cast(SimulatorSettings, settings).get("accuracy", DEFAULT_ACCURACY)].samples,
        "seed": settings["seed"],
        "kind": settings["renderer"],
        "blur": settings["blur"],
        "bake_error": settings["bake_error"],
    }


@dataclass(frozen=True)
class TimeSamplingChoice:
    """How finely a sequence is sampled in time.

    Attributes:
        sampling: in time.
        refine: polish event times, if the pixels are ideal.
    """

    sampling: TimeSampling
    refine: bool


def chosen_sampling(settings: SimulatorSettings) -> TimeSamplingChoice:
    """The rule of sampling that the settings ask for, and what belongs to it.

    Raises:
        ValueError: for more than one rule, or a value out of range.
    """
    preset = ACCURACY[settings["accuracy"]]
    rules: dict[str, TimeSampling | float | None] = {
        "render_rate_hz": settings["render_rate_hz"],
        "max_displacement_px": settings["max_displacement_px"],
        "tolerance": settings["tolerance"],
        "sampling": settings["sampling"],
    }
    given = {name: value for name, value in rules.items() if value is not None}
    if len(given) > 1:
        raise ArgumentError("only one of {rules} may be given, got {given}", rules=list(rules), given=list(given))
    sampling = preset.sampling
    for name, value in given.items():
        sampling = _RULES[name](value) if isinstance(value, int | float) else value
    return TimeSamplingChoice(
        sampling,
        preset.refine if settings["refine"] is None else settings["refine"],
    )


def truth_rates_hz(settings: SimulatorSettings) -> dict[str, float]:
    """The rates of the maps of the ground truth that fall due at rates of their own, by what they show."""
    return {
        "flow": settings["flow_rate_hz"],
        "mask": settings["mask_rate_hz"],
        "normal": settings["normal_rate_hz"],
    }


def memory_of(
    camera: Camera, settings: SimulatorSettings, effects: Effects, *, ray_bytes: float = 0.0
) -> MemoryForecast:
    """What a simulation will take.

    Args:
        settings: complete ones of :class:`~davis_rs.simulation.settings.SimulatorSettings`.
        effects: of the pixels, readout and frames.
        ray_bytes: what the renderer keeps of the rays of a pixel.
    """
    chosen, in_engine = chosen_sampling(settings), bool(effects.engine_settings())
    return simulation_forecast(
        (camera.width, camera.height),
        cubic=chosen.sampling.interpolation != "linear",
        refine=chosen.refine and not in_engine,
        effects=in_engine,
        frames=effects.aps is not None,
        truth=any(rate_hz > 0 for rate_hz in truth_rates_hz(settings).values()),
        ray_bytes=ray_bytes,
    )


def whole_frame_sampling(settings: SimulatorSettings) -> TimeSampling:
    """A rule that renders whole frames, between which light runs straight, as effects of a user's own on light need.

    It is the one that is asked for if it is such a one, or else as many renders as keep the image within a third of a
    pixel from one to the next; half of that with ``exact``.

    Raises:
        ValueError: where another rule is asked for by name.
    """
    sampling = chosen_sampling(settings).sampling
    if sampling.interpolation == "linear":
        return sampling
    if settings["sampling"] is not None or settings["tolerance"] is not None:
        raise ArgumentError(
            "custom effects on light need whole frames, between which light runs straight: give {render_rate_hz} or "
            "{max_displacement_px}, got {!r}",
            sampling,
        )
    return MaxDisplacement(1 / 6 if settings["accuracy"] == "exact" else 1 / 3)


def _first(*values: float | None) -> float:
    """The first that is given."""
    return next(value for value in values if value is not None)
