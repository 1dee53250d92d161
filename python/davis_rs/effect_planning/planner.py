"""The plan: which of a sensor's effects a sequence calls for."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from ..effects import Aps, Effect, Effects
from ..effects.effect import check_range
from ..rendering.render import Renderer
from ..rendering.renderers import make_renderer
from ..sampling.keyframes import Stretch
from ..scene.scene import Scene
from ..sensors import SENSORS
from ..settings import ViewSettings, complete, renderer_settings, takes_settings, view_scene
from ..trajectory.trajectory import Trajectory
from .aps import frame_change
from .cost import Costs
from .effect_plan import EffectPlan, PlannedEffect
from .omission_error import NO_ERROR, OmissionError
from .omission_estimator import OmissionEstimator
from .sequence_sample import SequenceSample

if TYPE_CHECKING:
    from typing_extensions import Unpack


@takes_settings(ViewSettings)
def plan_effects(
    scene: Scene,
    effects: Effects | None = None,
    *,
    keep: Effects | None = None,
    share: float = 0.01,
    shift_us: float = 100.0,
    **settings: Unpack[ViewSettings],
) -> EffectPlan:
    """Find out which effects a scene calls for along its camera path, from a cheap sample of it.

    >>> plan = plan_effects(load_scene("three_planes"), sensor="davis240c")
    >>> print(plan)
    >>> simulator = Simulator(scene, sensor="davis240c", effects=plan.effects)

    Args:
        scene: with the camera path.
        effects: the candidates, over those of ``sensor``; where neither is given, those of the DAVIS240C.
        keep: effects that are on (or, with neutral values, off) whatever the plan says; they are no candidates.
        share, shift_us: see :func:`plan_effects_of`.
        {settings}

    Raises:
        TypeError: for a setting that does not exist.
        ValueError: for a value out of range, a scene without a camera path, or one that cannot be rendered.
        OSError: if a scene file or a calibration cannot be read.
    """
    _check(share, shift_us)
    given = complete(ViewSettings, settings, of="plan_effects")
    viewed = view_scene(scene, given)
    candidates = viewed.sensor_effects
    if effects is None and given["sensor"] is None:
        candidates = SENSORS["davis240c"].effects(viewed.scene.lux_per_luma)
    candidates = (effects or Effects()).with_defaults(candidates)
    kept = keep or Effects()
    named = {effect.name for effect in kept} | kept.switched_off
    made = make_renderer(viewed.scene, viewed.camera, **renderer_settings(given))
    plan = plan_effects_of(
        made,
        viewed.scene.path,
        Effects.of(effect for effect in candidates if effect.name not in named),
        contrast_threshold=viewed.contrast_threshold,
        contrast_threshold_off=viewed.contrast_threshold_off,
        log_eps=viewed.log_eps,
        seed=given["seed"],
        share=share,
        shift_us=shift_us,
    )
    return replace(plan, kept=kept)


def plan_effects_of(
    renderer: Renderer,
    trajectory: Trajectory,
    effects: Effects,
    *,
    contrast_threshold: float,
    contrast_threshold_off: float | None = None,
    log_eps: float = 1e-3,
    seed: int = 0,
    share: float = 0.01,
    shift_us: float = 100.0,
) -> EffectPlan:
    """As :func:`plan_effects`, with a renderer that there is already, one without a lens.

    An effect is called for where leaving it out would make more than ``share`` of the events missing, spurious or
    shifted by more than ``shift_us``. Each is judged alone, against ideal pixels. An APS changes no events: it is
    called for where more than ``share`` of the pixels move by more than half a pixel in the exposure, or of the pixels
    of 8-bit frames change by more than one grey value.

    What an effect in the pixel or on the stream does is seen on a few pixels that are followed all the time (see
    :class:`~davis_rs.effect_planning.sequence_sample.SequenceSample`), by the crossing engine itself or, of noise, from
    its known rate. Because these pixels are a sample, a result that is close to ``share`` may fall on either side of
    it. Of a sequence of more than 4096 keyframes only parts are seen: what mismatch and refractory period add up to
    over more than 170 px is left out.

    Raises:
        ValueError: for a value out of range, or a renderer with a lens.
    """
    _check(share, shift_us)
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
    sequence = SequenceSample(stretch, contrast_threshold=contrast_threshold, contrast_threshold_off=off, seed=seed)
    estimator, costs = OmissionEstimator(sequence, sequence.window_us(shift_us), shift_us), Costs(sequence)
    items = tuple(_planned(effect, estimator, costs, 100 * share) for effect in effects)
    return EffectPlan(items, share, shift_us, estimator.window_us, estimator.scene_events, trajectory.duration_s)


def _planned(effect: Effect, estimator: OmissionEstimator, costs: Costs, percent: float) -> PlannedEffect:
    found: OmissionError = NO_ERROR
    frame_percent = math.nan
    if isinstance(effect, Aps):
        frame_percent, blurred_percent, observation = frame_change(estimator.sequence, effect)
        called_for = max(frame_percent, blurred_percent) > percent
    else:
        found, observation = estimator(effect)
        called_for = found.worst_percent > percent
    ns_per_pixel, ns_per_event = costs(effect)
    return PlannedEffect(
        effect,
        called_for,
        observation,
        found.missing_percent,
        found.spurious_percent,
        found.shifted_percent,
        found.event_change_percent,
        found.median_us,
        found.p99_us,
        frame_percent,
        ns_per_pixel,
        ns_per_event,
    )


def _check(share: float, shift_us: float) -> None:
    check_range("share", share, 0.0, 1.0)
    check_range("shift_us", shift_us, 0.0, 1e6, "us")
