"""Resolves settings with a scene: camera, thresholds, sampling and effects, each of them decided, nothing rendered.

:func:`resolve` decides all that a :class:`~davis_rs.Simulator` needs. :func:`view_scene` is its part that a planner of
effects, an estimate of noise and a check of a plan need too.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

from ..._util.argument_error import ArgumentError
from ..._util.memory_forecast import MemoryForecast, simulation_forecast
from ...events.colour import ColourFilter, Weights, as_colour_filter, filter_numbers
from ...events.luma import LUMA_WEIGHTS
from ...geometry.camera import Camera
from ...render.base import Renderer
from ...render.choice import make_renderer
from ...render.mosaic import MosaicRenderer
from ...sampling.presets import ACCURACY, DEFAULT_ACCURACY, pixel_arguments
from ...sampling.rules import FixedRate, MaxDisplacement, TimeSampling
from ...sampling.tolerance import Tolerance
from ...scene.scene import Scene, check_scene
from ...sensor.effects import CustomEffects, Effects
from ...sensor.effects.effects import effects_of
from ...sensor.parameters import SensorParameters
from ...sensor.presets import RECORDED, read_once, recorded_sensor, sensor_parameters
from .image_camera import image_camera
from .simulation_settings import SamplingSettings, SimulatorSettings, ViewSettings

AUTO_RAYS = "auto"
"""In place of the rays per pixel, which ``make_simulator`` then chooses by the noise."""

LOG_EPS = 1e-3
"""The dark level in units of luma where neither settings nor sensor say it."""

_NOT_PLANNED = (
    "must be resolved before a simulator is made: "
    "Simulator(scene, effects=plan_effects(scene, sensor=...).effects), or simulate(scene, effects='auto')"
)


@dataclass(frozen=True)
class ViewedScene:
    """Holds a scene as a sensor sees it: what a planner of effects needs.

    Attributes:
        scene: in the settings' light.
        camera: lens and size of the image.
        sensor: its parameters, those of ideal pixels where none is given.
        contrast_threshold, contrast_threshold_off: C_on and C_off in natural-log units.
        log_eps: dark level in units of luma.
        start_phase: where references lie at the first frame.
        colour_filter: before the pixels; None for a sensor without colour.
    """

    scene: Scene
    camera: Camera
    sensor: SensorParameters
    contrast_threshold: float
    contrast_threshold_off: float
    log_eps: float
    start_phase: str
    colour_filter: ColourFilter | None

    @property
    def sensor_effects(self) -> Effects:
        """Return the effects of the sensor, in this scene's light."""
        return self.sensor.effects(self.scene.lux_per_luma)


@dataclass(frozen=True)
class Resolved:
    """Holds all that a simulator needs, decided; a simulator changes nothing of it.

    Attributes:
        settings: those that were given, the sensor's file read.
        view: the scene as the sensor sees it.
        sampling: when luma is rendered.
        refine: whether event times are refined.
        refine_lines: so where luma of a pixel is taken by lines, which do not jump.
        effects: of the pixels, readout and frames.
        custom_effects: those of the user's own. They may remember what they have seen, and so serve one simulator.
    """

    settings: SimulatorSettings
    view: ViewedScene
    sampling: TimeSampling
    refine: bool
    refine_lines: bool
    effects: Effects
    custom_effects: CustomEffects

    def refines(self, renderer: Renderer) -> bool:
        """Tell whether event times are refined where this renderer takes luma."""
        return self.refine_lines if renderer.pixel == "lines" else self.refine

    def memory(self, renderer: Renderer | None = None) -> MemoryForecast:
        """Forecast what the simulation takes, or takes at least while its renderer is not known; see
        :func:`memory_of`."""
        known = {} if renderer is None else {"ray_bytes": renderer.ray_bytes}
        refine = self.refine_lines if renderer is None else self.refines(renderer)
        return memory_of(self.view.camera, self.settings, self.effects, refine=refine, **known)

    def renderer(self) -> Renderer:
        """Make the renderer, without a lens. Light may be baked here, which takes time.

        Raises:
            ValueError: as :func:`~davis_rs.render.choice.make_renderer`, or where there is not enough memory.
            OSError: if a scene file cannot be read.
        """
        plain = renderer_of(self.view, self.settings, edges=self.sampling.edges, threads=self.settings.threads)
        self.memory(plain).refuse()
        return plain


def resolve(scene: Scene, settings: SimulatorSettings) -> Resolved:
    """Decide what settings leave open, and refuse settings that contradict each other.

    Nothing is rendered, so that a mistake costs no time.

    Raises:
        ValueError: for effects or rays per pixel that are still to be chosen, contradictions, a value out of range, or
            a sensor for which there is not enough memory; else as :func:`view_scene`.
        OSError: as :func:`view_scene`.
    """
    if settings.rays_per_pixel == AUTO_RAYS:
        raise ArgumentError(
            "{rays_per_pixel:auto} must be resolved before a simulator is made: "
            "simulate(scene, rays_per_pixel='auto'), or the number that "
            "estimate_noise(scene).rays_per_pixel_for(0.05) gives"
        )
    settings = replace(settings, sensor=fixed_sensor(scene, settings.sensor))
    view, chosen = view_scene(scene, settings), chosen_sampling(settings)
    camera = view.camera
    effects = effects_of(settings.effects, not_planned=_NOT_PLANNED).with_defaults(view.sensor_effects)
    custom_effects = CustomEffects(
        settings.custom_effects,
        camera.width,
        camera.height,
        settings.seed,
        behind_bus=effects.readout is not None,
    )
    on_light = custom_effects.on_luma or custom_effects.on_log_intensity
    sampling = whole_frame_sampling(settings) if on_light else chosen.sampling
    in_engine = effects.engine_settings()
    _check_exposure(effects, settings.frame_rate_hz, camera.height)
    if settings.refine and in_engine:
        raise ArgumentError(
            "{refine} finds the times of ideal pixels: it cannot be combined with {}", ", ".join(in_engine)
        )
    if settings.refine and on_light:
        raise ArgumentError("{refine} asks the renderer for times: it cannot be combined with custom effects on light")
    if settings.signal_window_us is not None and custom_effects.on_events:
        raise ArgumentError("{signal_window_us} cannot tell which events of {custom_effects} on events are noise")
    if settings.flow_interval_s is not None and settings.flow_rate_hz == 0:
        raise ArgumentError("{flow_interval_s} is that of maps of flow: give {flow_rate_hz}")
    refine = chosen.refine and not in_engine and not on_light
    refine_lines = refine and bool(settings.refine)
    resolved = Resolved(settings, view, sampling, refine, refine_lines, effects, custom_effects)
    resolved.memory().refuse()
    return resolved


def view_scene(scene: Scene, settings: ViewSettings) -> ViewedScene:
    """Decide what :class:`~davis_rs.simulation.settings.ViewSettings` leave open.

    Raises:
        ValueError, OSError: as :func:`~davis_rs.simulation.settings.image_camera.image_camera` and
            :func:`~davis_rs.load_sensor`; ValueError also for an image for which there is not enough memory, whatever
            else is asked for.
    """
    check_scene(scene)
    if settings.lux_per_luma is not None:
        scene = replace(scene, lux_per_luma=settings.lux_per_luma)
    if settings.matte:
        scene = replace(scene, matte=True)
    sensor = sensor_parameters(fixed_sensor(scene, settings.sensor))
    camera = image_camera(scene, settings.camera, settings.size, sensor)
    simulation_forecast((camera.width, camera.height)).refuse()
    log_eps = first_given(settings.log_eps, sensor.dark_luma(scene.lux_per_luma), LOG_EPS)
    on = first_given(settings.contrast_threshold, sensor.contrast_threshold, scene.contrast_threshold)
    off = first_given(settings.contrast_threshold_off, sensor.contrast_threshold_off, on)
    filters = sensor.colour_filter() if settings.colour_filter is None else as_colour_filter(settings.colour_filter)
    start_phase = settings.start_phase or sensor.start_phase
    return ViewedScene(scene, camera, sensor, on, off, log_eps, start_phase, filters)


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
    return recorded_sensor(scene.biases, scene.contrast_threshold)


def renderer_of(
    view: ViewedScene, settings: ViewSettings, *, edges: bool = False, threads: int | None = None
) -> Renderer:
    """Make the renderer that settings ask for, without a lens.

    All that render a scene before its run take it from here, so that they render what the run does, and light is baked
    once. Samples that are to be chosen are left to the renderer. Without ``accuracy`` they are those of the default.

    Args:
        view: what is rendered.
        settings: of the view, or of more.
        edges, threads: as of :func:`~davis_rs.render.choice.make_renderer`.

    Raises:
        ValueError, OSError: as :func:`~davis_rs.render.choice.make_renderer`.
    """
    accuracy = ACCURACY[settings.accuracy if isinstance(settings, SamplingSettings) else DEFAULT_ACCURACY]

    def of_weights(weights: Weights) -> Renderer:
        return make_renderer(
            view.scene,
            view.camera,
            rays_per_pixel=None if isinstance(settings.rays_per_pixel, str) else settings.rays_per_pixel,
            **pixel_arguments(accuracy),
            seed=settings.seed,
            kind=settings.renderer,
            blur=settings.blur,
            bake_error=settings.bake_error,
            pixel=settings.pixel,
            edges=edges,
            threads=threads,
            weights=weights,
        )

    if view.colour_filter is None:
        return of_weights(LUMA_WEIGHTS)
    channels = [of_weights(weights) for weights in view.colour_filter.weights]
    return MosaicRenderer(channels, filter_numbers(view.colour_filter.pattern, view.camera.width, view.camera.height))


@dataclass(frozen=True)
class TimeSamplingChoice:
    """Says how finely a sequence is sampled in time.

    Attributes:
        sampling: in time.
        refine: refine event times, if the pixels are ideal.
    """

    sampling: TimeSampling
    refine: bool


def chosen_sampling(settings: SamplingSettings) -> TimeSamplingChoice:
    """Choose the rule of sampling that the settings ask for, and what belongs to it.

    Raises:
        ValueError: for more than one rule, or a value out of range.
    """
    preset = ACCURACY[settings.accuracy]
    asked: dict[str, object] = {
        "render_rate_hz": settings.render_rate_hz,
        "max_displacement_px": settings.max_displacement_px,
        "tolerance": settings.tolerance,
        "sampling": settings.sampling,
    }
    given = [name for name, value in asked.items() if value is not None]
    if len(given) > 1:
        raise ArgumentError("only one of {rules} may be given, got {given}", rules=list(asked), given=given)
    sampling = preset.sampling if settings.sampling is None else settings.sampling
    if settings.render_rate_hz is not None:
        sampling = FixedRate(settings.render_rate_hz)
    elif settings.max_displacement_px is not None:
        sampling = MaxDisplacement(settings.max_displacement_px)
    elif settings.tolerance is not None:
        sampling = Tolerance(settings.tolerance)
    return TimeSamplingChoice(sampling, preset.refine if settings.refine is None else settings.refine)


def truth_rates_hz(settings: SamplingSettings) -> dict[str, float]:
    """Return the rates of the maps of the ground truth that fall due at rates of their own, by what they show."""
    return {"flow": settings.flow_rate_hz, "mask": settings.mask_rate_hz, "normal": settings.normal_rate_hz}


def memory_of(
    camera: Camera, settings: SamplingSettings, effects: Effects, *, refine: bool, ray_bytes: float = 0.0
) -> MemoryForecast:
    """Forecast what a simulation will take.

    Args:
        camera: its size counts.
        settings: of the sampling in time and of the maps of the ground truth.
        effects: of the pixels, readout and frames.
        refine: event times are refined.
        ray_bytes: what the renderer keeps of the rays of a pixel.
    """
    chosen, in_engine = chosen_sampling(settings), bool(effects.engine_settings())
    return simulation_forecast(
        (camera.width, camera.height),
        cubic=chosen.sampling.interpolation != "linear",
        refine=refine,
        effects=in_engine,
        twin=settings.signal_window_us is not None and effects.noiseless != effects,
        frames=effects.aps is not None,
        truth=any(rate_hz > 0 for rate_hz in truth_rates_hz(settings).values()),
        ray_bytes=ray_bytes,
    )


def whole_frame_sampling(settings: SamplingSettings) -> TimeSampling:
    """Choose a rule that renders whole frames, between which light runs straight.

    Effects of a user's own on light need it. It is the rule that is asked for if it is such a one, or else as many
    renders as keep the image within a third of a pixel from one to the next; half of that with ``exact``.

    Raises:
        ValueError: where another rule is asked for by name.
    """
    sampling = chosen_sampling(settings).sampling
    if sampling.interpolation == "linear":
        return sampling
    if settings.sampling is not None or settings.tolerance is not None:
        raise ArgumentError(
            "custom effects on light need whole frames, between which light runs straight: give {render_rate_hz} or "
            "{max_displacement_px}, got {!r}",
            sampling,
        )
    return MaxDisplacement(1 / 6 if settings.accuracy == "exact" else 1 / 3)


def first_given(*values: float | None) -> float:
    """Return the first value that is not None."""
    return next(value for value in values if value is not None)


def _check_exposure(effects: Effects, frame_rate_hz: float, height: int) -> None:
    """Refuse frames whose exposure, or whose readout row by row, takes longer than the time between them."""
    if effects.aps is None:
        return
    readout_us = effects.aps.readout_us(height)
    for name, length_us in (("exposure", effects.aps.exposure_us), (f"readout of {height} rows", readout_us)):
        if length_us * frame_rate_hz > 1e6:
            raise ValueError(
                f"the {name} of {length_us:g} us must not exceed the frames' period of {1e6 / frame_rate_hz:g} us"
            )
