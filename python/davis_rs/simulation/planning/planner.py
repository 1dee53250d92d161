"""Plans: which of a sensor's effects a sequence calls for."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..._util.progress import doing
from ...geometry.trajectory.trajectory import Trajectory
from ...render.base import Renderer
from ...sampling.keyframes import Stretch
from ...scene.scene import Scene
from ...sensor.effects import Aps, Effect, Effects, EffectsLike
from ...sensor.effects.effect import check_range
from ...sensor.effects.effects import effects_of
from ...sensor.presets import SENSORS
from ..settings import EFFECTS_TOLERANCE, PlanSettings, complete, renderer_of, takes_settings, view_scene
from .aps import frame_change
from .cost import Costs
from .effect_plan import EffectPlan, PlannedEffect
from .effects_together import EffectsTogether
from .luma_sample import event_intervals_us
from .omission_error import NO_ERROR, OmissionError, TimeScale
from .omission_estimator import OmissionEstimator
from .sequence_sample import SequenceSample

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..settings.keywords import PlanKeywords

_NOT_PLANNED = "is what this finds out: name the candidates, or leave them out for those of the sensor"


@takes_settings(PlanSettings)
def plan_effects(
    scene: Scene,
    effects: EffectsLike | None = None,
    *,
    keep: EffectsLike | None = None,
    **settings: Unpack[PlanKeywords],
) -> EffectPlan:
    """Find out which effects a scene calls for along its camera path, from a cheap sample of it.

    >>> plan = plan_effects(load_scene("three_planes"), sensor="davis240c")
    >>> print(plan)
    >>> simulator = Simulator(scene, sensor="davis240c", effects=plan.effects)

    Args:
        scene: with the camera path.
        effects: the candidates, over those of ``sensor``; where neither is given, those of the DAVIS240C.
        keep: effects that are on (or, with neutral values, off) whatever the plan says; they are no candidates.
        {settings}

    Raises:
        TypeError: for a setting that does not exist.
        ValueError: for a value out of range, a scene without a camera path, or one that cannot be rendered.
        OSError: if a scene file or a calibration cannot be read.
    """
    return planned_effects(scene, complete(PlanSettings, settings, taker=plan_effects), effects, keep=keep)


def planned_effects(
    scene: Scene, settings: PlanSettings, effects: EffectsLike | None = None, *, keep: EffectsLike | None = None
) -> EffectPlan:
    """Plan as :func:`plan_effects` does, by settings that are complete."""
    viewed = view_scene(scene, settings)
    candidates = viewed.sensor_effects
    if effects is None and settings.sensor is None:
        candidates = SENSORS["davis240c"].effects(viewed.scene.lux_per_luma)
    candidates = effects_of(effects, not_planned=_NOT_PLANNED).with_defaults(candidates)
    kept = effects_of(keep, not_planned=_NOT_PLANNED)
    named = {effect.name for effect in kept} | kept.switched_off
    return plan_effects_of(
        renderer_of(viewed, settings),
        viewed.scene.path,
        Effects.of(effect for effect in candidates if effect.name not in named),
        contrast_threshold=viewed.contrast_threshold,
        contrast_threshold_off=viewed.contrast_threshold_off,
        log_eps=viewed.log_eps,
        start_phase=viewed.start_phase,
        seed=settings.seed,
        keep=kept,
        effects_tolerance=settings.effects_tolerance,
    )


def plan_effects_of(
    renderer: Renderer,
    trajectory: Trajectory,
    effects: Effects,
    *,
    contrast_threshold: float,
    contrast_threshold_off: float | None = None,
    log_eps: float = 1e-3,
    start_phase: str = "zero",
    seed: int = 0,
    keep: Effects | None = None,
    effects_tolerance: float | None = None,
) -> EffectPlan:
    """Plan as :func:`plan_effects` does, with an existing renderer, one without a lens.

    An effect is called for where leaving it out errs by more than ``effects_tolerance`` (by default
    ``EFFECTS_TOLERANCE``) in any of three, compared with ideal pixels (see :class:`OmissionError`):

    - count: the number of all events, as a share of it;
    - rate: the number of events of each pixel and polarity, the differences added up, as a share of all events;
    - time: the mean shift of an event, as a share of the median interval between events of a pixel. Shifts below the
      stream's own sampling error count as none.

    An APS changes no events: it is called for where more than the tolerance's share of the pixels move by more than
    half a pixel in the exposure, or of the pixels of 8-bit frames change by more than one grey value.

    Each effect is judged alone. Then the set of them is compared with all candidates at once; while it errs by more
    than the tolerance, others join it, those first that err most when they alone are left out of all. At last the
    comparison is made on pixels that the choice was not made on: :class:`~davis_rs.simulation.planning.SetForecast`.

    What an effect in the pixel or on the stream does is seen on a few pixels that are followed all the time (see
    :class:`~davis_rs.simulation.planning.sequence_sample.SequenceSample`), by the crossing engine itself or, of
    noise, from its known rate. Because these pixels are a sample, a result that is close to the tolerance may fall on
    either side of it. Of a sequence of more than 4096 keyframes only parts are seen: what mismatch and refractory
    period add up to over more than 170 px is left out.

    Raises:
        ValueError: for a value out of range, or a renderer with a lens.
    """
    tolerance = EFFECTS_TOLERANCE if effects_tolerance is None else effects_tolerance
    check_range("effects_tolerance", tolerance, 0.0, 1.0)
    kept = Effects() if keep is None else keep
    if renderer.optics is not None:
        raise ValueError(f"{renderer.name} renders through a lens; plan with the renderer without it")
    end_us = round(trajectory.duration_s * 1e6)
    off = contrast_threshold if contrast_threshold_off is None else contrast_threshold_off
    stretch = Stretch(
        renderer=renderer,
        trajectory=trajectory,
        start_us=0,
        end_us=end_us,
        first=True,
        due=[0, end_us],
        contrast_threshold=min(contrast_threshold, off),
        log_eps=log_eps,
        batch=renderer.poses_per_launch,
    )
    doing("rendering a sample of the sequence")
    sequence = SequenceSample(
        stretch,
        contrast_threshold=contrast_threshold,
        contrast_threshold_off=off,
        start_phase=start_phase,
        seed=seed,
    )
    window_us = sequence.window_us
    intervals_us = event_intervals_us(sequence.pixels.ideal)
    interval_us = max(float(np.median(intervals_us)), 1.0) if len(intervals_us) else float(sequence.duration_us)
    scale = TimeScale(window_us, interval_us, sequence.sampling_error_us(window_us))
    estimator, costs = OmissionEstimator(sequence, scale), Costs(sequence)
    candidates, planned = tuple(effects), []
    for number, effect in enumerate(candidates, 1):
        doing(f"effect {number} of {len(candidates)}, {effect.name}")
        planned.append(_planned(effect, estimator, costs, 100 * tolerance))
    items = tuple(planned)
    chosen = Effects.of(item.effect for item in items if item.called_for)
    runs = EffectsTogether(estimator, kept=kept, candidates=effects)
    together = None
    if runs.worth_running:
        doing("the effects together")
        joined = runs.called_for(chosen, 100 * tolerance)
        items = tuple(
            replace(item, called_for=True, with_others=True) if item.effect.name in joined else item for item in items
        )
        together = runs.forecast(costs, Effects.of(item.effect for item in items if item.called_for))
    return EffectPlan(items, tolerance, scale, estimator.scene_events, trajectory.duration_s, together, kept)


def _planned(effect: Effect, estimator: OmissionEstimator, costs: Costs, percent: float) -> PlannedEffect:
    error: OmissionError = NO_ERROR
    frame_percent = math.nan
    if isinstance(effect, Aps):
        frame_percent, blurred_percent, observation = frame_change(estimator.sequence, effect)
        called_for = max(frame_percent, blurred_percent) > percent
    else:
        error, observation = estimator(effect)
        called_for = error.worst_percent > percent
    return PlannedEffect(effect, called_for, False, observation, error, frame_percent, *costs(effect))
