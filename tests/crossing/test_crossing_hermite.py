"""Hermite interpolation against roots found in 50 digits."""

from __future__ import annotations

from typing import NamedTuple

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from davis_rs import CrossingEngine
from davis_rs.events.arrays import EventArray

mpmath.mp.dps = 50
C_ON, C_OFF = 0.25, 0.375


class Knot(NamedTuple):
    """A sample: log intensity, and its rate of change per second."""

    log: float
    rate: float


def engine(**settings_: object) -> CrossingEngine:
    parameters = {"contrast_threshold": C_ON, "contrast_threshold_off": C_OFF, "interpolation": "hermite", "threads": 1}
    return CrossingEngine(1, 1, **{**parameters, **settings_})  # type: ignore[arg-type]


def run(knots: list[Knot], ticks: int, **settings_: object) -> list[tuple[int, int]]:
    """(t, p) of the events of one pixel whose knots are ``ticks`` us apart."""
    pixel = engine(**settings_)
    events: list[EventArray] = [
        pixel.push_log(k * ticks, np.array([[knot.log]]), np.array([[knot.rate]])) for k, knot in enumerate(knots)
    ]
    return [(int(e["t"]), int(e["p"])) for packet in events for e in packet]


class Fall(NamedTuple):
    """An event of the oracle: its exact moment in ticks of the sequence, and its polarity."""

    moment: mpmath.mpf
    p: int


def oracle(knots: list[Knot], ticks: int) -> tuple[list[Fall], mpmath.mpf]:
    """Events by the contract, from exact cubics; and the least distance of any turning value from a level."""
    base = mpmath.mpf(knots[0].log)
    on = off = 0
    falls: list[Fall] = []
    closest = mpmath.mpf(1)

    def level(extra_on: int, extra_off: int) -> mpmath.mpf:
        return base + (on + extra_on) * mpmath.mpf(C_ON) - (off + extra_off) * mpmath.mpf(C_OFF)

    for k in range(1, len(knots)):
        start, end = knots[k - 1], knots[k]
        value, turn = cubic(start, end, ticks)
        pieces = [(mpmath.mpf(0), mpmath.mpf(1))] if turn is None else [(mpmath.mpf(0), turn), (turn, mpmath.mpf(1))]
        for left, right in pieces:
            reach = mpmath.mpf(end.log) if right == 1 else value(right)
            if right < 1:
                closest = min(closest, abs(reach - level(1, 0)), abs(reach - level(0, 1)))
            while True:
                if reach >= level(1, 0):
                    target, p = level(1, 0), 1
                    on += 1
                elif reach <= level(0, 1):
                    target, p = level(0, 1), 0
                    off += 1
                else:
                    break
                if right < 1:
                    closest = min(closest, abs(reach - level(1, 0)), abs(reach - level(0, 1)))
                falls.append(Fall((k - 1) * ticks + root(value, target, left, right, p) * ticks, p))
    return falls, closest


def cubic(start: Knot, end: Knot, ticks: int) -> tuple[mpmath.mpf, mpmath.mpf | None]:
    """The value over s in 0..1 and where it turns; slopes as the engine's rounded product of rate and seconds."""
    a, b = mpmath.mpf(start.log), mpmath.mpf(end.log)
    seconds = ticks * 1e-6
    p, q = mpmath.mpf(start.rate * seconds), mpmath.mpf(end.rate * seconds)
    chord = b - a
    if p * q >= 0:
        if chord != 0 and p * chord >= 0 and q * chord >= 0:
            p, q = (mpmath.sign(chord) * min(abs(m), 3 * abs(chord)) for m in (p, q))
        else:
            p = q = chord
    c2, c3 = 3 * chord - 2 * p - q, p + q - 2 * chord
    turn = None
    if p * q < 0:
        # Of p + 2 c2 s + 3 c3 s^2 exactly one root lies within.
        if c3 == 0:
            turn = -p / (2 * c2)
        else:
            d = mpmath.sqrt(c2 * c2 - 3 * c3 * p)
            turn = next(s for s in ((-c2 + d) / (3 * c3), (-c2 - d) / (3 * c3)) if 0 < s < 1)
    return (lambda s: a + s * (p + s * (c2 + s * c3))), turn


def root(value: mpmath.mpf, target: mpmath.mpf, left: mpmath.mpf, right: mpmath.mpf, p: int) -> mpmath.mpf:
    sign = 1 if p else -1
    for _ in range(110):
        middle = (left + right) / 2
        if sign * (value(middle) - target) >= 0:
            right = middle
        else:
            left = middle
    return right


NUMBERS = st.floats(-3, 3).map(lambda x: round(x, 6))
# Slopes over a whole interval, some far steeper than any chord.
SLOPES = st.one_of(NUMBERS, st.floats(-20, 20).map(lambda x: round(x, 3)))
KNOTS = st.lists(st.tuples(NUMBERS, SLOPES), min_size=2, max_size=4)


@settings(max_examples=100)
@given(KNOTS, st.sampled_from([1, 7, 1000, 50_000, 10_000_000]))
def test_events_are_those_of_the_exact_cubics(samples: list[tuple[float, float]], ticks: int) -> None:
    """Counts and polarities agree, and stamps to the tick, or to its neighbour where the root nearly lies on one."""
    knots = [Knot(log, slope / (ticks * 1e-6)) for log, slope in samples]
    expected, closest = oracle(knots, ticks)
    assume(closest > 1e-12)  # at a tangency either count may come
    got = run(knots, ticks)
    assert [p for _, p in got] == [fall.p for fall in expected]
    for (t, _), fall in zip(got, expected, strict=True):
        exact = int(mpmath.ceil(fall.moment))
        near = abs(fall.moment - mpmath.nint(fall.moment)) < 1e-6
        assert t == exact or (near and abs(t - exact) <= 1) or flat(knots, ticks, fall)


def flat(knots: list[Knot], ticks: int, fall: Fall) -> bool:
    """Is the curve so flat at the event that float64 cannot place it within 1e-6 us?"""
    k = min(int(fall.moment // ticks), len(knots) - 2)
    value, _ = cubic(knots[k], knots[k + 1], ticks)
    s, h = (fall.moment - k * ticks) / ticks, mpmath.mpf("1e-6") / ticks
    return abs(value(s + h) - value(s - h)) < 1e-14


def test_up_and_down_between_two_equal_samples() -> None:
    """A parabola of height 1.5 over one interval: six crossings up, then down, none visible from the samples alone."""
    events = run([Knot(0.0, 6.0), Knot(0.0, -6.0)], 1_000_000)
    assert [p for _, p in events] == [1] * 6 + [0] * 4
    assert events[0][0] == 43565  # 6 s (1 - s) = 0.25
    assert events == sorted(events, key=lambda event: event[0])


def test_a_double_root_comes_once_or_never() -> None:
    """The parabola's top touches the level: at a tangency either count may come, and the next interval is right."""
    touching = [Knot(0.0, 1.0), Knot(0.0, -1.0), Knot(1.0, 0.0)]
    events = run(touching, 1_000_000)
    ups = [t for t, p in events if p]
    assert len(ups) in (4, 5)
    pixel = engine()
    for k, knot in enumerate(touching):
        pixel.push_log(k * 1_000_000, np.array([[knot.log]]), np.array([[knot.rate]]))
    assert -C_OFF < 1.0 - pixel.reference[0, 0] <= 0.0 + C_ON


@pytest.mark.parametrize("rate", [np.nan, np.inf, -np.inf])
def test_a_rate_that_is_not_finite_means_a_line(rate: float) -> None:
    """NaN marks pixels without a derivative, such as occlusion edges."""
    line = CrossingEngine(1, 1, contrast_threshold=C_ON, contrast_threshold_off=C_OFF, threads=1)
    line.push_log(0, np.array([[0.0]]))
    expected = [(int(e["t"]), int(e["p"])) for e in line.push_log(1000, np.array([[1.3]]))]
    assert run([Knot(0.0, rate), Knot(1.3, 5.0)], 1000) == expected
    assert run([Knot(0.0, 5.0), Knot(1.3, rate)], 1000) == expected


def test_slopes_without_support_make_no_extremum() -> None:
    """Wild rates of one sign: the curve stays monotone, so a rising pixel fires no OFF event."""
    for rates in [(4000.0, 9000.0), (-50.0, -50.0), (0.0, 1e6)]:
        events = run([Knot(0.0, rates[0]), Knot(1.0, rates[1])], 1000)
        assert [p for _, p in events] == [1, 1, 1, 1]


def test_luma_rates_are_divided_by_luma() -> None:
    """dL/dt = (dY/dt) / (Y + log_eps): the luma path and the log path give the same events."""
    t = np.arange(0, 100, 10)
    luma = (0.5 + 0.4 * np.sin(t / 13.0)[:, None, None] * np.ones((1, 3, 4))).astype(np.float32)
    rate = (0.4 / 13.0 * 1e3 * np.cos(t / 13.0)[:, None, None] * np.ones((1, 3, 4))).astype(np.float32)
    by_luma = CrossingEngine(4, 3, contrast_threshold=0.05, interpolation="hermite", log_eps=0.01)
    by_log = CrossingEngine(4, 3, contrast_threshold=0.05, interpolation="hermite", log_eps=0.01)
    count = 0
    for k, (y, dy) in enumerate(zip(luma, rate, strict=True)):
        log = np.log(y.astype(np.float64) + 0.01)
        a = by_luma.push(k * 10_000, y, dy)
        b = by_log.push_log(k * 10_000, log, dy.astype(np.float64) / (y.astype(np.float64) + 0.01))
        assert len(a) == len(b)
        assert np.abs(a["t"] - b["t"]).max(initial=0) <= 1
        count += len(a)
    assert count > 300


def test_rates_must_match_the_interpolation() -> None:
    """A forgotten rate would silently become a line."""
    frame = np.zeros((1, 1))
    with pytest.raises(ValueError, match="needs the rate of change"):
        engine().push_log(0, frame)
    with pytest.raises(ValueError, match="interpolation is linear"):
        engine(interpolation="linear").push_log(0, frame, frame)
    with pytest.raises(ValueError, match=r"interpolation must be 'linear' or 'hermite'.*cubic"):
        engine(interpolation="cubic")
    with pytest.raises(ValueError, match=r"slope must have shape \(1, 1\)"):
        engine().push_log(0, frame, np.zeros((2, 1)))
