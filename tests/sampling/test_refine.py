"""Refined event times: the first microsecond at which the renderer itself has the event's level."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import (
    EVENT_DTYPE,
    CrossingEngine,
    FixedRate,
    MaxDisplacement,
    Simulator,
    Tolerance,
    load_scene,
    log_intensity,
)
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.render.choice import make_renderer
from davis_rs.sampling.event_refinement import EventRefinement
from davis_rs.sampling.keyframes import Keyframe, Stretch
from davis_rs.sampling.rules import TimeSampling
from stretches import CAMERA, LOG_EPS, TINY, built_in, mirror, shift, stretch

pytestmark = pytest.mark.usefixtures("llvm")

C_ON, C_OFF = 0.15, 0.09


class Step(NamedTuple):
    """What happens between two keyframes."""

    last: Keyframe
    new: Keyframe
    reference: npt.NDArray[np.float64]
    crude: EventArray
    refined: EventArray


class Sign(NamedTuple):
    """An event, its level and the samples around its crude time, as worked out one event at a time."""

    t_us: int
    crude_us: int
    pixel: int
    sign: int
    level: float
    low_us: int
    high_us: int
    enclosed: bool


def refined(
    events: EventArray, reference: npt.NDArray[np.float64], last: Keyframe, new: Keyframe, part: Stretch
) -> EventArray:
    """The events between two keyframes, refined alone."""
    refinement = EventRefinement(part, (C_ON, C_OFF))
    refinement.add(events, reference, last, new)
    return refinement.take()


def steps(part: Stretch, sampling: TimeSampling) -> Iterator[Step]:
    height, width = part.renderer.camera.height, part.renderer.camera.width
    engine = CrossingEngine(
        width,
        height,
        contrast_threshold=C_ON,
        contrast_threshold_off=C_OFF,
        log_eps=LOG_EPS,
        interpolation=sampling.interpolation,
    )
    last: Keyframe | None = None
    for new in sampling.keyframes(part):
        reference = engine.reference
        crude = engine.push(new.t_us, new.luma, new.rate, sparse=new.sparse)
        if last is not None:
            yield Step(last, new, reference, crude, refined(crude, reference, last, new, part))
        last = new


def of_pixels(events: EventArray, width: int) -> dict[int, list[tuple[int, int]]]:
    """(t, p) of each pixel's events, in the order of the stream."""
    found = defaultdict(list)
    for t, x, y, p in events.tolist():
        found[y * width + x].append((t, p))
    return found


def signs(step: Step, width: int) -> Iterator[Sign]:
    """The events of a step, with their levels counted up and their samples looked up one by one."""
    last, new = step.last, step.new
    sparse = new.sparse
    crude = of_pixels(step.crude, width)
    for pixel, events in of_pixels(step.refined, width).items():
        own = {last.t_us: last.luma.flat[pixel], new.t_us: new.luma.flat[pixel]}
        if sparse is not None:
            mine = sparse.pixel == pixel
            own |= dict(zip(sparse.t_us[mine].tolist(), sparse.luma[mine], strict=True))
        log = {t_us: float(log_intensity(np.array([[luma]], np.float32), LOG_EPS)[0, 0]) for t_us, luma in own.items()}
        level = float(step.reference.flat[pixel])
        for (t_us, p), (crude_us, crude_p) in zip(events, crude[pixel], strict=True):
            assert p == crude_p
            sign = 1 if p else -1
            level += C_ON if p else -C_OFF
            low_us, high_us = max(s for s in log if s < crude_us), min(s for s in log if s >= crude_us)
            before, after = sign * (log[low_us] - level), sign * (log[high_us] - level)
            # A level met by a sample to within rounding may be taken either way.
            sure = min(abs(before), abs(after)) > 1e-12
            yield Sign(t_us, crude_us, pixel, sign, level, low_us, high_us, sure and before < 0 <= after)


def excess(found: list[Sign], t_us: npt.NDArray[np.int64], part: Stretch) -> npt.NDArray[np.float64]:
    """How far beyond their level, in their direction, log luma is for the renderer at these times."""
    pixel = np.array([one.pixel for one in found])
    luma = part.renderer.samples(part.views(t_us), np.arange(len(t_us)), pixel)
    log = log_intensity(luma[None], LOG_EPS)[0]
    return np.array([one.sign for one in found]) * (log - [one.level for one in found])


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("name", "sampling"),
    [
        ("three_planes", FixedRate(500.0)),
        ("three_walls", MaxDisplacement(0.5, hermite=True)),
        ("three_planes", Tolerance(0.1)),
        ("three_walls", Tolerance(0.3, pixels=1.0)),
    ],
    ids=["lines", "cubics", "sparse", "sparse-walls"],
)
def test_each_event_is_where_the_renderer_reaches_its_level(name: str, sampling: TimeSampling) -> None:
    """At its stamp log luma has reached the level, a microsecond before it has not; levels of unequal thresholds.

    So it is for nearly all, and a microsecond off for nearly all others: light that runs smoothly is not asked until
    the very microsecond. A step along a curve that is not checked would be off by more than 20 us for some.

    Where the samples around the crude time do not enclose the level it stays; where the pixel's event before came
    later, it comes with that one.
    """
    renderer, trajectory = built_in(name)
    part = stretch(renderer, trajectory.crop(0, 0.06), start_us=3_000_000, contrast_threshold=C_OFF)
    width, solved, kept, delayed, moved, by_sparse = CAMERA.width, 0, 0, 0, 0, 0
    right = dict.fromkeys((0, 1, 20), 0)
    for step in steps(part, sampling):
        found = list(signs(step, width))
        assert len(found) == len(step.crude)
        asked: list[Sign] = []
        previous: dict[int, int] = {}
        for one in found:
            floor = previous.get(one.pixel, step.last.t_us)
            previous[one.pixel] = one.t_us
            assert step.last.t_us < one.t_us <= step.new.t_us
            assert one.t_us >= floor
            by_sparse += (one.low_us, one.high_us) != (step.last.t_us, step.new.t_us)
            if one.t_us == floor != one.crude_us:
                delayed += 1
            elif one.enclosed:
                assert one.low_us < one.t_us <= one.high_us
                asked.append(one)
                moved += one.t_us != one.crude_us
            else:
                kept += 1
                assert one.t_us == one.crude_us
        if asked:
            t_us = np.array([one.t_us for one in asked])
            for off_us in right:
                reached = excess(asked, np.minimum(t_us + off_us, part.start_us + 60_000), part) > -1e-12
                before = excess(asked, np.maximum(t_us - 1 - off_us, part.start_us), part) < 1e-12
                right[off_us] += int(np.count_nonzero(reached & before))
            solved += len(asked)
    assert solved > 1000
    for off_us, share in {0: 0.93, 1: 0.996, 20: 0.998}.items():
        assert right[off_us] > share * solved
    assert moved > 0.9 * solved
    assert kept + delayed < 0.05 * solved
    if isinstance(sampling, Tolerance):
        assert by_sparse > 0.1 * solved


@pytest.mark.parametrize(
    "sampling", [FixedRate(60.0), Tolerance(2.0, pixels=2.0, longest=2.0)], ids=["lines", "sparse"]
)
def test_only_times_change(sampling: TimeSampling) -> None:
    """The same events of the same pixels in the same order of crossing; the stream's order is (t, y, x, crossing)."""
    renderer, trajectory = built_in("three_walls")
    part = stretch(renderer, trajectory.crop(0, 0.05), contrast_threshold=C_OFF)
    count, many = 0, 0
    for step in steps(part, sampling):
        assert step.refined.dtype == EVENT_DTYPE
        crude, refined = of_pixels(step.crude, CAMERA.width), of_pixels(step.refined, CAMERA.width)
        assert crude.keys() == refined.keys()
        for pixel, events in refined.items():
            assert [p for _, p in events] == [p for _, p in crude[pixel]]
            many += len(events) > 1
        order = np.lexsort((step.refined["x"], step.refined["y"], step.refined["t"]))
        assert np.array_equal(order, np.arange(len(order)))
        count += len(step.refined)
    assert count > 500
    assert many > 20


def test_coarse_and_dense_sampling_agree() -> None:
    """Refined times no longer depend on when the scene was sampled: nearly all to the microsecond."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory.crop(0, 0.04), contrast_threshold=C_OFF)
    streams = {}
    for name, sampling in {"coarse": FixedRate(500.0), "dense": FixedRate(4000.0)}.items():
        all_steps = list(steps(part, sampling))
        for kind in ("crude", "refined"):
            streams[name, kind] = concatenate_events([getattr(step, kind) for step in all_steps])

    def agreeing(kind: str) -> float:
        coarse, fine = (of_pixels(streams[name, kind], CAMERA.width) for name in ("coarse", "dense"))
        # Pixels that have the same events in both: what one sampling misses is not a matter of its times.
        same = [p for p in coarse if [e[1] for e in coarse[p]] == [e[1] for e in fine[p]]]
        assert len(same) > 0.5 * len(fine)
        off = np.array([a[0] - b[0] for p in same for a, b in zip(coarse[p], fine[p], strict=True)])
        return float((np.abs(off) <= 1).mean())

    assert agreeing("refined") > 0.95
    assert agreeing("crude") < 0.2


def test_levels_that_samples_do_not_enclose_keep_their_times() -> None:
    """References far off: no event can be found, all stay as they are, in order."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory.crop(0, 0.02), contrast_threshold=C_OFF)
    for step in list(steps(part, FixedRate(200.0)))[1:]:
        assert len(step.crude) > 20
        for off in (-5.0, 5.0):
            kept = refined(step.crude, step.reference + off, step.last, step.new, part)
            np.testing.assert_array_equal(kept, step.crude)


def test_an_event_comes_no_earlier_than_the_one_before_it_in_its_pixel() -> None:
    """An ON event that keeps its time holds back the OFF event after it, though its level was reached long before."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory.crop(0, 0.01), contrast_threshold=C_OFF)
    (step,) = steps(part, FixedRate(50.0))
    start, stop = (log_intensity(keyframe.luma, LOG_EPS) for keyframe in (step.last, step.new))
    falls = start - stop
    y, x = np.unravel_index(np.argmax(np.where(falls < C_OFF, falls, 0.0)), falls.shape)
    assert falls[y, x] > 0.01
    reference = step.reference.copy()
    reference[y, x] = (start[y, x] + stop[y, x]) / 2 - C_ON + C_OFF  # OFF comes half-way, ON never
    events = np.array([(10_000, x, y, 1), (10_000, x, y, 0)], EVENT_DTYPE)
    assert refined(events, reference, step.last, step.new, part).tolist() == events.tolist()
    alone = reference.copy()
    alone[y, x] += C_ON
    assert refined(events[1:], alone, step.last, step.new, part)["t"][0] < 10_000


def test_no_events_are_no_work() -> None:
    """A packet without events has none refined; the events that are handed in stay as they were."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory.crop(0, 0.01), contrast_threshold=C_OFF)
    (step,) = steps(part, FixedRate(50.0))
    assert len(refined(step.crude[:0], step.reference, step.last, step.new, part)) == 0
    handed = step.crude.copy()
    refined(handed, step.reference, step.last, step.new, part)
    np.testing.assert_array_equal(handed, step.crude)


@pytest.mark.long
def test_any_renderer_will_do() -> None:
    """A mirror, for Mitsuba's own integrator: its single pixels are those of its frames, so levels are found."""
    renderer = make_renderer(mirror(), TINY, rays_per_pixel=4, kind="integrator")
    assert "PathIntegrator" in renderer.name
    part = stretch(renderer, shift([0.2, 0.0, 0.0], 0.05), contrast_threshold=C_OFF)
    solved = 0
    for step in steps(part, Tolerance(0.3)):
        asked = [one for one in signs(step, TINY.width) if one.enclosed and one.t_us != one.crude_us]
        if asked:
            reached = excess(asked, np.array([one.t_us for one in asked]), part) > -1e-12
            assert reached.mean() > 0.9  # but for those that wait for the one before
            solved += len(asked)
    assert solved > 20


def test_the_simulator_refines_with_its_own_thresholds() -> None:
    """Refined by the simulator: the same events as without, other times, those that EventRefinement gives."""
    _, trajectory = built_in()
    part = trajectory.crop(0, 0.05)
    scene = load_scene("three_planes").with_trajectory(part)
    streams = []
    for polish in (False, True):
        simulator = Simulator(
            scene,
            camera=CAMERA,
            rays_per_pixel=8,
            sampling=FixedRate(500.0),
            contrast_threshold=C_ON,
            contrast_threshold_off=C_OFF,
            refine=polish,
        )
        assert simulator.describe()["parameters"]["refine"] is polish
        streams.append(concatenate_events([packet.events for packet in simulator.run()]))
    renderer, _ = built_in()
    by_hand = list(steps(stretch(renderer, part, range(0, 50_001, 25_000), contrast_threshold=C_OFF), FixedRate(500.0)))
    assert streams[0].tobytes() == concatenate_events([step.crude for step in by_hand]).tobytes()
    assert streams[1].tobytes() == concatenate_events([step.refined for step in by_hand]).tobytes()
    assert len(streams[0]) == len(streams[1]) > 1000
    assert np.all(np.diff(streams[1]["t"]) >= 0)
