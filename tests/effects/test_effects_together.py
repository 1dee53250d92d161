"""Effects together: order, bounds, determinism and state in any combination; none of them disturbs another."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from davis_rs import CrossingEngine, Effects
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.sensor.effects import (
    HotPixels,
    LeakRate,
    PhotoreceptorBandwidth,
    Readout,
    RefractoryPeriod,
    ShotNoise,
    ThresholdMismatch,
)
from davis_rs.sensor.effects.effect import Effect
from effects_reference import collect, constant_corner, scene, shortest_interval_us
from strategies import EPOCH_US, EXAMPLES

FEW = settings(EXAMPLES, max_examples=max(EXAMPLES.max_examples // 2, 1))

STRONG: list[Effect] = [
    PhotoreceptorBandwidth(60.0, source_follower_hz=900.0),
    ThresholdMismatch(0.3),
    RefractoryPeriod(1_700.3),
    LeakRate(40.0),
    ShotNoise(0.06, 0.7, 1e3),
    HotPixels(0.2, 250.0),
    Readout(3e5, 4.5, 20.0, drop_after_us=900.0),
]
"""One of each that the engine carries out, so strong that all of them matter on a scene of 20 ms."""

STEADY: list[Effect] = [
    constant_corner(60.0),
    RefractoryPeriod(1_700.3),
    LeakRate(40.0),
    ShotNoise(0.06, math.inf, 1e3),
    STRONG[5],
]
"""Effects in the pixel that do not depend on how a straight interval is sampled."""

IDLE = Effects(hot_pixels=HotPixels(1e-15, 1.0))
"""On, so that pixels run through all that effects need, and yet there is no hot pixel among any number of sensors."""

FEEDS = [(log, hermite) for log in (False, True) for hermite in (False, True)]


@dataclass(frozen=True)
class Footage:
    """Random log intensity of a sensor, as any feed takes it: with slopes, and with samples between frames."""

    times_us: list[int]
    frames: npt.NDArray[np.float32]
    slopes: npt.NDArray[np.float32]
    sparse: list[tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]]

    @classmethod
    def random(
        cls, seed: int, height: int, width: int, frames: int, *, start_us: int = 0, gap_us: int = 2_000
    ) -> Footage:
        """Walks with jumps; gaps of 2 us to ``gap_us``; in about a fifth of the intervals' pixels a sample or two."""
        random = np.random.default_rng(seed)
        times = start_us + np.concatenate([[0], np.cumsum(random.integers(2, gap_us, frames - 1))])
        shape = (frames, height, width)
        steps = random.normal(0, 0.1, shape) + random.choice([0, -1.2, 1.2], shape, p=[0.9, 0.05, 0.05])
        logs = np.cumsum(steps, axis=0)
        slopes = np.gradient(logs, axis=0) / np.gradient(times * 1e-6)[:, None, None] + random.normal(0, 200, shape)
        slopes[random.random(shape) < 0.05] = np.nan
        sparse = []
        for k in range(1, frames):
            pixel = np.sort(random.integers(0, height * width, height * width // 5))
            at = random.integers(times[k - 1] + 1, times[k], len(pixel)) if times[k] > times[k - 1] + 1 else pixel[:0]
            pixel, at = np.unique(np.stack([pixel[: len(at)], at]), axis=1)
            value = logs[k].ravel()[pixel] + random.normal(0, 0.3, len(pixel))
            sparse.append((pixel.astype(np.uint32), at, value.astype(np.float32)))
        return cls(times.tolist(), logs.astype(np.float32), slopes.astype(np.float32), sparse)

    def push(self, engine: CrossingEngine, k: int, *, log: bool, hermite: bool, sparse: bool) -> EventArray:
        """The k-th frame's events; log intensity is that of luma without log_eps."""
        between = self.sparse[k - 1] if sparse and k else None
        if log:
            slope = self.slopes[k] if hermite else None
            return engine.push_log(self.times_us[k], self.frames[k], slope, sparse=between)
        luma = np.exp(self.frames[k])
        if between is not None:
            between = (*between[:2], np.exp(between[2]))
        return engine.push(self.times_us[k], luma, self.slopes[k] * luma if hermite else None, sparse=between)

    def engine(self, effects: Effects | None, *, hermite: bool = False, **settings: Any) -> CrossingEngine:
        height, width = self.frames.shape[1:]
        interpolation = "hermite" if hermite else "linear"
        return CrossingEngine(width, height, effects=effects, interpolation=interpolation, **settings)

    def run(
        self,
        effects: Effects | None,
        *,
        log: bool = False,
        hermite: bool = False,
        sparse: bool = False,
        **settings: Any,
    ) -> list[EventArray]:
        """The packet of each frame, and last what is flushed."""
        engine = self.engine(effects, hermite=hermite, **settings)
        packets = [self.push(engine, k, log=log, hermite=hermite, sparse=sparse) for k in range(len(self.frames))]
        return [*packets, engine.flush()]

    def still(self, luma: float = 1.0) -> Footage:
        """A scene that does not change, at the same times."""
        log = np.full_like(self.frames, math.log(luma))
        return Footage(self.times_us, log, np.zeros_like(log), [])


def assert_sorted(events: EventArray) -> None:
    """By (t, y, x)."""
    keys = [events[name].astype(np.int64) for name in ("x", "y", "t")]
    np.testing.assert_array_equal(np.lexsort((np.arange(len(events)), *keys)), np.arange(len(events)))


def last_stamps(events: EventArray, shape: tuple[int, int]) -> npt.NDArray[np.int64]:
    """Of each pixel's latest event; -1 where there is none."""
    last = np.full(shape, -1, np.int64)
    np.maximum.at(last, (events["y"], events["x"]), events["t"])
    return last


def assert_same(packets: list[EventArray], others: list[EventArray]) -> None:
    for one, other in zip(packets, others, strict=True):
        np.testing.assert_array_equal(one, other)


@st.composite
def some_effects(draw: st.DrawFn) -> Effects:
    """Any subset, from weak to strong, alone and all at once."""
    rates = st.floats(0.1, 3_000)
    all_effects = st.tuples(
        st.builds(
            PhotoreceptorBandwidth,
            st.floats(1, 1e5),
            source_follower_hz=st.sampled_from([50.0, 3e3, math.inf]),
        ),
        st.builds(ThresholdMismatch, st.floats(0.01, 0.8)),
        st.builds(RefractoryPeriod, st.one_of(st.floats(0.1, 5_000), st.sampled_from([1.0, 100.0, 1e15]))),
        st.builds(LeakRate, rates),
        st.builds(ShotNoise, st.floats(0.02, 0.3), st.floats(0.1, 100), st.floats(10, 3e3)),
        st.builds(HotPixels, st.floats(0, 1), rates),
        st.builds(
            Readout,
            st.sampled_from([1e4, 1e6, 12e6, math.inf]),
            st.floats(0, 100),
            st.sampled_from([0.0, 30.0]),
            st.sampled_from([None, 0.0, 500.0]),
            by_columns=st.integers(0, 1),
        ),
    )
    drawn = draw(all_effects)
    return Effects.of([effect for effect, on in zip(drawn, draw(st.tuples(*[st.booleans()] * 7)), strict=True) if on])


footage = st.builds(
    Footage.random,
    st.integers(0, 2**32),
    st.just(5),
    st.just(7),
    st.integers(3, 12),
    start_us=st.sampled_from([0, 5, EPOCH_US]),
    gap_us=st.sampled_from([3, 200, 5_000]),
)


@FEW
@given(
    some_effects(),
    footage,
    st.sampled_from(FEEDS),
    st.booleans(),
    st.integers(0, 2**64 - 1),
    st.sampled_from(["zero", "stationary"]),
)
def test_any_combination_keeps_order_bounds_and_state(
    effects: Effects, footage: Footage, feed: tuple[bool, bool], sparse: bool, seed: int, start_phase: str
) -> None:
    """Sorted by (t, y, x), or behind a bus by t, in each packet and from packet to packet, stamps within each interval.

    With a bus, no pixel has two events closer than its refractory period, or of one stamp. Stored and taken up before
    each frame, by state and by pickle, it goes on to the byte. The surface of active events is that of the stream.
    """
    log, hermite = feed
    settings: dict[str, Any] = {"hermite": hermite, "seed": seed, "start_phase": start_phase}
    packets = footage.run(effects, log=log, sparse=sparse, **settings)
    stream = concatenate_events(packets)
    if effects.readout is None:
        assert_sorted(stream)
    else:
        assert np.all(np.diff(stream["t"]) >= 0)
        held = effects.refractory_period_us
        assert shortest_interval_us(stream) >= max(0.0 if held is None else held.period_us, 1.0)
    for start_us, end_us, packet in zip([-1, *footage.times_us], footage.times_us, packets, strict=False):
        assert np.all((packet["t"] > start_us) & (packet["t"] <= end_us))
        assert np.all(packet["p"] <= 1)
    assert np.all(packets[-1]["t"] > footage.times_us[-1])
    engine = footage.engine(effects, **settings)
    stored = []
    for k in range(len(footage.frames)):
        engine = pickle.loads(pickle.dumps(engine)) if k % 2 else CrossingEngine.from_state(engine.state())
        stored.append(footage.push(engine, k, log=log, hermite=hermite, sparse=sparse))
    assert_same([*stored, engine.flush()], packets)
    assert engine.state()["seed"] == seed
    if effects.readout is None:
        np.testing.assert_array_equal(engine.last_event_us, last_stamps(stream, (5, 7)))


@pytest.mark.few(1)
@pytest.mark.parametrize("count", [1, 2, 7])
def test_events_do_not_depend_on_threads(count: int) -> None:
    """Each effect, each pair and all at once, on 1, 2 and 3 threads and as many as there are: the same bytes."""
    footage = Footage.random(1, 60, 80, 6)
    for chosen in combinations(STRONG, count):
        effects = Effects.of(chosen)
        packets = footage.run(effects, hermite=True, sparse=True, threads=1, seed=3, start_phase="stationary")
        assert len(collect(packets)) > 1_000
        for threads in (2, 3, None):
            again = footage.run(effects, hermite=True, sparse=True, threads=threads, seed=3, start_phase="stationary")
            assert_same(again, packets)


@pytest.mark.parametrize("feed", FEEDS)
def test_threads_may_change_on_the_way(feed: tuple[bool, bool]) -> None:
    """With all effects on, taken up by another number of threads before each frame: the same bytes and pixels."""
    log, hermite = feed
    footage, effects = Footage.random(2, 60, 80, 6), Effects.of(STRONG)
    whole, parts = (footage.engine(effects, hermite=hermite, threads=threads) for threads in (1, 3))
    for k in range(len(footage.frames)):
        one, other = (footage.push(each, k, log=log, hermite=hermite, sparse=True) for each in (whole, parts))
        assert other.tobytes() == one.tobytes()
        parts = CrossingEngine.from_state(parts.state(), threads=1 + k % 3)
        np.testing.assert_array_equal(parts.reference, whole.reference)
        np.testing.assert_array_equal(parts.last_event_us, whole.last_event_us)
    assert parts.flush().tobytes() == whole.flush().tobytes()
    assert parts.dropped_events == whole.dropped_events > 0


@pytest.mark.parametrize("effect", STRONG, ids=lambda effect: effect.name)
def test_each_effect_matters(effect: Effect) -> None:
    """So that no test here holds only for effects that do nothing; another seed changes what is drawn."""
    footage = Footage.random(3, 20, 20, 10)
    streams = [collect(footage.run(effects)) for effects in (None, Effects.of([effect]))]
    assert streams[0].tobytes() != streams[1].tobytes()
    other = collect(footage.run(Effects.of([effect]), seed=1))
    drawn = not isinstance(effect, PhotoreceptorBandwidth | RefractoryPeriod)
    assert (other.tobytes() != streams[1].tobytes()) == drawn


# Off, neutral, and on without consequence.


@pytest.mark.parametrize("feed", FEEDS)
@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("per_pixel", [False, True])
@pytest.mark.parametrize("asymmetric", [False, True])
def test_an_effect_without_consequence_changes_no_bit(
    feed: tuple[bool, bool], sparse: bool, per_pixel: bool, asymmetric: bool
) -> None:
    """Events, references and last events of pixels under effects, none of which acts, are the ideal pixels'."""
    log, hermite = feed
    footage = Footage.random(4, 40, 60, 12)
    on: Any = np.random.default_rng(1).uniform(0.02, 0.4, (40, 60)) if per_pixel else 0.07
    settings: dict[str, Any] = {"contrast_threshold": on, "contrast_threshold_off": on * 1.3 if asymmetric else None}
    engines = [footage.engine(effects, hermite=hermite, **settings) for effects in (None, IDLE)]
    count = 0
    for k in range(len(footage.frames)):
        ideal, idle = (footage.push(engine, k, log=log, hermite=hermite, sparse=sparse) for engine in engines)
        assert idle.tobytes() == ideal.tobytes()
        count += len(ideal)
    assert count > 25_000
    np.testing.assert_array_equal(engines[0].reference, engines[1].reference)
    np.testing.assert_array_equal(engines[0].last_event_us, engines[1].last_event_us)


@pytest.mark.parametrize(
    "neutral",
    [
        Effects(),
        Effects.of([ThresholdMismatch(0), RefractoryPeriod(0), LeakRate(0), ShotNoise(0), HotPixels(0)]),
        Effects.of([PhotoreceptorBandwidth(math.inf), HotPixels(0.5, 0.0), Readout(math.inf)]),
        {
            "photoreceptor_bandwidth_hz": {"hz": math.inf, "source_follower_hz": math.inf},
            "threshold_mismatch": ThresholdMismatch(0.0).settings(),
            "refractory_period_us": {"period_us": 0.0},
            "leak_rate_hz": LeakRate(0.0).settings(),
            "shot_noise_rms": {"rms": 0.0, "half_luma": 1.0, "bandwidth_hz": 300.0},
            "hot_pixels": HotPixels(0.5, 0.0).settings(),
            "readout": {"events_per_s": math.inf, "latency_us": 0.0, "jitter_us": 0.0}
            | {"drop_after_us": 1.0, "row_us": 0.0, "by_columns": 0},
        },
    ],
)
@pytest.mark.parametrize("feed", FEEDS)
def test_neutral_is_off(neutral: Any, feed: tuple[bool, bool]) -> None:
    """Effects at their neutral values leave the ideal engine, also where the engine itself is given them."""
    log, hermite = feed
    footage = Footage.random(5, 10, 10, 10)
    ideal = footage.run(None, log=log, hermite=hermite, sparse=True)
    assert len(collect(ideal)) > 500
    assert_same(footage.run(neutral, log=log, hermite=hermite, sparse=True), ideal)
    engines = [footage.engine(effects, hermite=hermite) for effects in (None, neutral)]
    for engine in engines:
        footage.push(engine, 0, log=log, hermite=hermite, sparse=False)
    states = [engine.state() for engine in engines]
    assert states[0]["effect_state"] is states[1]["effect_state"] is None


@pytest.mark.parametrize(
    "weak", [RefractoryPeriod(1e-9), PhotoreceptorBandwidth(1e9), ThresholdMismatch(1e-12)], ids=repr
)
def test_next_to_neutral_is_next_to_off(weak: Effect) -> None:
    """Events come a tick later or earlier at most, and hardly any does."""
    footage = Footage.random(6, 20, 20, 10)
    ideal, near = (collect(footage.run(effects, log=True)) for effects in (None, Effects.of([weak])))
    order = [np.lexsort((np.arange(len(e)), e["x"], e["y"])) for e in (ideal, near)]
    assert len(ideal) > 2_000
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(near[name][order[1]], ideal[name][order[0]])
    late = near["t"][order[1]].astype(np.int64) - ideal["t"][order[0]]
    assert np.abs(late).max() <= 1
    assert np.mean(late != 0) < 0.01


# None disturbs another.


@pytest.mark.parametrize("other", [effect for effect in STRONG if not isinstance(effect, ThresholdMismatch)], ids=repr)
def test_thresholds_are_the_same_whatever_else_is_on(other: Effect) -> None:
    """The pattern of a seed is one."""
    alone = CrossingEngine(9, 9, effects=Effects.of([ThresholdMismatch(0.3)]), seed=5)
    both = CrossingEngine(9, 9, effects=Effects.of([ThresholdMismatch(0.3), other]), seed=5)
    np.testing.assert_array_equal(alone.contrast_threshold, both.contrast_threshold)
    np.testing.assert_array_equal(alone.contrast_threshold_off, both.contrast_threshold_off)


@pytest.mark.parametrize(
    "others",
    [
        [PhotoreceptorBandwidth(30.0)],
        [constant_corner(60.0)],
    ],
    ids=repr,
)
def test_noise_of_a_static_scene_is_the_same_with_others(others: list[Effect]) -> None:
    """The same events: others draw nothing from it, and add nothing where nothing moves (mismatch changes the rate)."""
    noise: list[Effect] = [ShotNoise(0.07, 0.7), HotPixels(0.3, 120.0)]
    footage = Footage.random(7, 12, 12, 30, gap_us=20_000).still()
    streams = [collect(footage.run(Effects.of(on), seed=2)) for on in (noise, [*noise, *others])]
    np.testing.assert_array_equal(*streams)  # type: ignore[arg-type]
    assert len(streams[0]) > 1_000


@pytest.mark.parametrize("effects", [[effect] for effect in STRONG] + [STRONG], ids=repr)
def test_start_phases_are_the_same_under_any_effects(effects: list[Effect]) -> None:
    """As shares of the way between each pixel's own levels: those of a seed are one pattern, whatever is on.

    Noise has been there before: it is a part of what comparators see, and has taken some references to their next
    levels.
    """
    shares = []
    for on in ([], effects):
        engine = CrossingEngine(9, 9, effects=Effects.of(on), start_phase="stationary", seed=5)
        engine.push_log(0, scene(0, 9, 9))
        c_on, c_off = (np.broadcast_to(c, (9, 9)) for c in (engine.contrast_threshold, engine.contrast_threshold_off))
        shares.append((c_off - engine.reference) / (c_on + c_off))
    if any(isinstance(effect, ShotNoise) for effect in effects):
        assert 0.1 < np.std(shares[1]) < np.std(shares[0])
    else:
        np.testing.assert_allclose(shares[1], shares[0], rtol=1e-9)
    assert np.ptp(shares[0]) > 0.9
    engine = CrossingEngine(9, 9, effects=Effects.of(effects), seed=5)
    engine.push_log(0, scene(0, 9, 9))
    assert not engine.reference.any()


@pytest.mark.parametrize("start_phase", ["zero", "stationary"])
@pytest.mark.parametrize(
    "weak",
    [
        LeakRate(1e-6),
        RefractoryPeriod(1e-6),
        ShotNoise(1e-8),
        HotPixels(1e-9, 1.0),
        PhotoreceptorBandwidth(1e9),
        ThresholdMismatch(1e-9),
    ],
    ids=repr,
)
def test_an_effect_that_comes_to_nothing_changes_no_count(weak: Effect, start_phase: str) -> None:
    """Steps of a quarter of C in five frames, where most events hang on the first references."""
    frames = 0.05 * np.random.default_rng(0).normal(size=(5, 40, 40)).cumsum(0)
    streams = []
    for effects in (None, Effects.of([weak])):
        engine = CrossingEngine(40, 40, contrast_threshold=0.2, effects=effects, start_phase=start_phase)
        streams.append(collect(engine.push_log(40_000 * k, frame) for k, frame in enumerate(frames)))
    off, on = streams
    assert len(off) > (300 if start_phase == "stationary" else 50)
    assert np.array_equal(off[["x", "y", "p"]], on[["x", "y", "p"]])
    assert np.abs(off["t"] - on["t"]).max() <= 10
    assert 0.4 < on["p"].mean() < 0.6


@pytest.mark.parametrize("effects", [Effects.of(STRONG[:-1]), Effects.of([RefractoryPeriod(300.3), LeakRate(50.0)])])
def test_samples_of_all_pixels_between_frames_are_a_frame(effects: Effects) -> None:
    """Sparse samples in every pixel, or a frame at their time: the same events and the same pixels after it."""
    footage = Footage.random(8, 10, 10, 21)
    whole, parts = footage.engine(effects), footage.engine(effects)
    for engine in (whole, parts):
        footage.push(engine, 0, log=True, hermite=False, sparse=False)
    for k in range(1, 20, 2):
        packets = [footage.push(whole, at, log=True, hermite=False, sparse=False) for at in (k, k + 1)]
        between = np.arange(100, dtype=np.uint32), np.full(100, footage.times_us[k]), footage.frames[k].ravel()
        events = parts.push_log(footage.times_us[k + 1], footage.frames[k + 1], sparse=between)
        np.testing.assert_array_equal(events, concatenate_events(packets))
    np.testing.assert_allclose(parts.reference, whole.reference, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(parts.last_event_us, whole.last_event_us)


@pytest.mark.parametrize(
    "effects", [Effects.of(chosen) for count in (1, 2, 5) for chosen in combinations(STEADY, count)]
)
def test_a_straight_interval_may_be_cut_anywhere(effects: Effects) -> None:
    """Frames on the lines between frames, the corner being constant: the same events but for a tick."""
    footage = Footage.random(13, 12, 12, 12, gap_us=40_000)
    engines = whole, parts = footage.engine(effects), footage.engine(effects)
    for engine in engines:
        footage.push(engine, 0, log=True, hermite=False, sparse=False)
    streams: tuple[list[EventArray], list[EventArray]] = ([], [])
    for k in range(1, len(footage.frames)):
        start_us, end_us = footage.times_us[k - 1 : k + 1]
        start, end = footage.frames[k - 1 : k + 1].astype(np.float64)
        streams[0].append(whole.push_log(end_us, end))
        for t_us in np.unique(np.linspace(start_us, end_us, 9).astype(int))[1:]:
            share = (t_us - start_us) / (end_us - start_us)
            streams[1].append(parts.push_log(int(t_us), end if t_us == end_us else start + (end - start) * share))
    events = [collect(stream) for stream in streams]
    assert len(events[0]) == len(events[1]) > 500
    order = [np.lexsort((np.arange(len(e)), e["x"], e["y"])) for e in events]
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(events[0][name][order[0]], events[1][name][order[1]])
    apart = events[0]["t"][order[0]].astype(np.int64) - events[1]["t"][order[1]]
    assert np.abs(apart).max() <= 1
    assert np.mean(apart != 0) < 1e-3
    np.testing.assert_allclose(parts.reference, whole.reference, rtol=0, atol=1e-9)


def test_all_at_once_at_unix_time_is_as_at_zero() -> None:
    """Draws, leak, holds and filters go by the time since the first frame."""
    effects = Effects.of(STRONG[:-1])
    early, late = (Footage.random(9, 10, 10, 20, start_us=start_us) for start_us in (0, EPOCH_US))
    packets = [collect(each.run(effects)) for each in (early, late)]
    packets[1]["t"] -= EPOCH_US
    np.testing.assert_array_equal(packets[1], packets[0])


def test_a_frame_that_is_refused_changes_nothing() -> None:
    """All effects on; after NaN, an old time and a wrong shape the engine goes on as if they had not been."""
    footage, effects = Footage.random(10, 6, 6, 12), Effects.of(STRONG)
    expected = footage.run(effects)
    engine, got = footage.engine(effects), []
    bad = np.full((6, 6), np.nan, np.float32)
    for k in range(12):
        got.append(footage.push(engine, k, log=False, hermite=False, sparse=False))
        for t_us, frame in ((footage.times_us[k] + 1, bad), (footage.times_us[k], bad * 0), (10**12, bad[:3])):
            with pytest.raises(ValueError, match=r"NaN|after the last|6 x 6|shape"):
                engine.push(t_us, np.nan_to_num(frame) if frame is not bad else frame)
    assert_same([*got, engine.flush()], expected)


def test_an_engine_under_effects_takes_one_kind_of_frames() -> None:
    """Luma or log intensity, as the first frame was, also after it was stored."""
    engine = CrossingEngine(2, 2, effects=Effects.of(STRONG))
    engine.push(0, np.ones((2, 2), np.float32))
    for each in (engine, CrossingEngine.from_state(engine.state())):
        with pytest.raises(ValueError, match="it cannot take log intensity now"):
            each.push_log(10, scene(0, 2, 2))


@pytest.mark.parametrize(
    "entry",
    [
        *[
            "photoreceptor",
            "filtered",
            "held_us",
            "noise_cell",
            "noise_log_light",
            "noise_photoreceptor",
            "noise_filtered",
        ],
        *["hot_wait_us", "hot_index"],
    ],
)
def test_states_without_what_effects_need_are_refused(entry: str) -> None:
    """By the entry's name; as is a state with none of it."""
    engine = CrossingEngine(3, 3, effects=Effects.of(STRONG))
    engine.push(0, np.ones((3, 3), np.float32))
    state = engine.state()
    state["effect_state"][entry] = state["effect_state"][entry][:-1]
    with pytest.raises(ValueError, match=r"_index|_wait_us" if entry.startswith(("shot", "hot")) else entry):
        CrossingEngine.from_state(state)
    state["effect_state"] = None
    with pytest.raises(ValueError, match="under effects"):
        CrossingEngine.from_state(state)


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "bandwidth", [None, PhotoreceptorBandwidth(60.0), PhotoreceptorBandwidth(60.0, source_follower_hz=90.0)]
)
@pytest.mark.parametrize("hermite", [False, True])
def test_noise_and_crossings_of_a_pixel_come_in_their_order(bandwidth: Any, hermite: bool) -> None:
    """Noise among turning curves: each event moves the reference by its threshold, and the last one is the latest."""
    footage = Footage.random(12, 20, 20, 15, gap_us=20_000)
    effects = Effects(
        photoreceptor_bandwidth_hz=bandwidth,
        shot_noise_rms=ShotNoise.of_rate(800.0, 0.15, half_luma=math.inf, bandwidth_hz=1e3),
    )
    engine, reference, made = footage.engine(effects, hermite=hermite), footage.frames[0].astype(np.float64), 0
    for k in range(len(footage.frames)):
        events = footage.push(engine, k, log=True, hermite=hermite, sparse=False)
        np.add.at(reference, (events["y"], events["x"]), np.where(events["p"] == 1, 0.15, -0.15))
        np.testing.assert_allclose(engine.reference, reference, rtol=0, atol=1e-9)
        last = last_stamps(events, (20, 20))
        np.testing.assert_array_equal(engine.last_event_us[last >= 0], last[last >= 0])
        made += len(events)
    assert made > 10_000


def test_events_under_all_effects_lie_a_refractory_period_apart() -> None:
    """In each pixel, whatever makes them: noise, leak, or the scene."""
    footage = Footage.random(11, 20, 20, 40)
    stream = collect(footage.run(Effects.of(STRONG[:-1]), hermite=True))
    order = np.lexsort((stream["t"], stream["x"], stream["y"]))
    events = stream[order]
    same = reduce(np.logical_and, (events[name][1:] == events[name][:-1] for name in ("x", "y")))
    apart = np.diff(events["t"])[same]
    assert len(apart) > 1_000
    assert apart.min() >= math.floor(1_700.3)
