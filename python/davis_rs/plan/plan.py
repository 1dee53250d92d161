"""The plan: which of a sensor's effects a sequence calls for."""

from __future__ import annotations

import math

from ..camera import Camera
from ..effects import Aps, Effect, Effects
from ..effects.effect import check_range
from ..rendering.render import Renderer
from ..rendering.renderers import make_renderer
from ..sampling.keyframes import Stretch
from ..scene.scene import Scene
from ..trajectory.trajectory import Trajectory
from .aps import frame_change
from .cost import Costs
from .evidence import Judge
from .neglect import NOTHING, Neglect
from .probe import Probe
from .report import EffectPlan, PlannedEffect


def plan_effects(
    scene: Scene,
    trajectory: Trajectory,
    effects: Effects,
    *,
    camera: Camera | None = None,
    contrast_threshold: float | None = None,
    contrast_threshold_off: float | None = None,
    log_eps: float = 1e-3,
    samples: int | None = None,
    seed: int = 0,
    renderer: str = "auto",
    blur: bool | None = None,
    share: float = 0.01,
    shift_us: float = 100.0,
) -> EffectPlan:
    """Find out which effects a sequence calls for, from a cheap probe of it.

    >>> scene = load_scene("three_planes")
    >>> print(plan_effects(scene, scene.trajectory, SENSORS["davis240c"].effects(scene.lux_per_luma)))

    Args:
        scene, trajectory: the sequence.
        effects: the candidates, for example all that a sensor has.
        camera, contrast_threshold, contrast_threshold_off, log_eps, samples, seed, renderer, blur: as for
            :class:`~davis_rs.Simulator`.
        share, shift_us: see :func:`plan_effects_of`.

    Raises:
        ValueError: for a value out of range, or a scene that cannot be rendered.
        OSError: if a scene file cannot be read.
    """
    _check(share, shift_us)
    made = make_renderer(scene, camera or scene.camera, samples=samples, seed=seed, kind=renderer, blur=blur)
    return plan_effects_of(
        made,
        trajectory,
        effects,
        contrast_threshold=scene.contrast_threshold if contrast_threshold is None else contrast_threshold,
        contrast_threshold_off=contrast_threshold_off,
        log_eps=log_eps,
        seed=seed,
        share=share,
        shift_us=shift_us,
    )


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
    :class:`~davis_rs.plan.probe.Probe`), by the crossing engine itself or, of noise, from its known rate. As these are
    a sample, a share that is close to ``share`` may fall on either side of it. Of a sequence of more than 4096
    keyframes only parts are seen: what mismatch and refractory period add up to over more than 170 px is left out.

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
    probe = Probe(stretch, contrast_threshold=contrast_threshold, contrast_threshold_off=off, seed=seed)
    judge, costs = Judge(probe, probe.window_us(shift_us), shift_us), Costs(probe)
    items = tuple(_planned(effect, judge, costs, 100 * share) for effect in effects)
    return EffectPlan(items, share, shift_us, judge.window_us, judge.scene_events, trajectory.duration_s)


def _planned(effect: Effect, judge: Judge, costs: Costs, percent: float) -> PlannedEffect:
    found: Neglect = NOTHING
    frame_percent = math.nan
    if isinstance(effect, Aps):
        frame_percent, blurred_percent, evidence = frame_change(judge.probe, effect)
        called_for = max(frame_percent, blurred_percent) > percent
    else:
        found, evidence = judge(effect)
        called_for = found.worst_percent > percent
    ns_per_pixel, ns_per_event = costs(effect)
    return PlannedEffect(
        effect,
        called_for,
        evidence,
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
