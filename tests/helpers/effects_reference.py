"""Pixels and a bus under effects, slow and plain: the oracles that the engine's effects are tested against.

Written from what the effects' classes say, not from the engine.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import mpmath
import numpy as np
import numpy.typing as npt

from davis_rs import EVENT_DTYPE
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.sensor.effects import LeakRate, PhotoreceptorBandwidth

Corner = Callable[[float, float], Any]
"""The corner frequency in Hz of an interval, by log intensity at both its ends."""

FIRST = 1e-6
"""A crossing within this many microseconds of a tick may be stamped with that tick, the next or the one before."""

_mp = mpmath.MPContext()
_mp.dps = 40


def scene(value: float, height: int = 1, width: int = 1) -> npt.NDArray[np.float64]:
    """A frame that has one value everywhere."""
    return np.full((height, width), float(value))


def collect(packets: Any) -> EventArray:
    """The events of all packets."""
    return concatenate_events([packet for packet in packets if len(packet)])


def of_pixel(events: EventArray, x: int, y: int = 0) -> EventArray:
    """Those of one pixel, in their order."""
    return events[(events["x"] == x) & (events["y"] == y)]


def shortest_interval_us(events: EventArray) -> float:
    """From an event of a pixel to its next one, in the order of the stream; infinite if no pixel has two."""
    ordered = events[np.lexsort((np.arange(len(events)), events["x"], events["y"]))]
    same = (ordered["x"][1:] == ordered["x"][:-1]) & (ordered["y"][1:] == ordered["y"][:-1])
    return min(np.diff(ordered["t"])[same].tolist(), default=math.inf)


def may_be_tick(stamp_us: int, at_us: Any, doubt_us: Any = FIRST) -> bool:
    """Whether a stamp is the first tick at or after a time that is known within a doubt."""
    return bool(at_us - doubt_us <= stamp_us < at_us + doubt_us + 1)


def constant_corner(hz: float) -> PhotoreceptorBandwidth:
    """A low-pass whose corner does not depend on irradiance."""
    return PhotoreceptorBandwidth(math.inf, source_follower_hz=hz)


def corner_of(bandwidth: PhotoreceptorBandwidth) -> Corner:
    """The documented rule: proportional to exp(mean log intensity), or the source follower's where that is alone."""

    def corner_hz(start: float, end: float) -> Any:
        if math.isinf(bandwidth.hz):
            return _mp.mpf(bandwidth.source_follower_hz)
        return _mp.mpf(bandwidth.hz) * _mp.exp((_mp.mpf(start) + _mp.mpf(end)) / 2)

    return corner_hz


class Crossing(NamedTuple):
    """A crossing at a real time, its polarity, and how fast the curve goes through the level (1 / us)."""

    t_us: Any
    p: int
    slope: Any

    def may_have(self, stamp_us: int) -> bool:
        """Whether a stamp is right, given that the curve's value is a float64: within some ulp, over its slope."""
        return may_be_tick(stamp_us, self.t_us, FIRST + 1e-13 / self.slope)


class FilteredPixel:
    """A pixel behind dy/dt = w (x - y), solved in 40 digits for x that runs straight; otherwise ideal.

    With a source follower it is behind dv/dt = w2 (y - v) as well.

    Attributes:
        nearest: how near an end of a monotone piece came to a level; a float64 cannot tell on which side much less is.
    """

    def __init__(
        self, t_us: int, log_intensity: float, c_on: float, c_off: float, corner: Corner, follower_hz: float = math.inf
    ) -> None:
        self.t_us, self.input = t_us, log_intensity
        self.base = self.output = self.photoreceptor = _mp.mpf(log_intensity)
        self.follower_hz = follower_hz
        self.c_on, self.c_off = _mp.mpf(c_on), _mp.mpf(c_off)
        self.corner = corner
        self.n_on = self.n_off = 0
        self.nearest = math.inf

    @property
    def reference(self) -> Any:
        return self.base + self.n_on * self.c_on - self.n_off * self.c_off

    def advance(self, t_us: int, log_intensity: float) -> list[Crossing]:
        """The crossings in (self.t_us, t_us], over which the input runs straight to its new value."""
        start_us, ticks = self.t_us, t_us - self.t_us
        w = 2 * _mp.pi * self.corner(self.input, log_intensity) * _mp.mpf("1e-6")
        x, rate = _mp.mpf(self.input), (_mp.mpf(log_intensity) - _mp.mpf(self.input)) / ticks
        first = self.output if math.isinf(self.follower_hz) else self.photoreceptor
        transient = first - x + rate / w

        def photoreceptor(u: Any) -> Any:
            return x + rate * u - rate / w + transient * _mp.exp(-w * u)

        if math.isinf(self.follower_hz):
            value, slopes = photoreceptor, [(_mp.zero, rate), (w, -w * transient)]
        else:
            w2 = 2 * _mp.pi * _mp.mpf(self.follower_hz) * _mp.mpf("1e-6")
            w2 *= 1 + _mp.mpf("1e-18") * (abs(w2 / w - 1) < _mp.mpf("1e-18"))  # not a double root
            passed = transient * w2 / (w2 - w)
            own = self.output - x + rate / w + rate / w2 - passed
            slopes = [(_mp.zero, rate), (w, -w * passed), (w2, -w2 * own)]

            def value(u: Any) -> Any:
                late = x + rate * u - rate / w - rate / w2
                return late + passed * _mp.exp(-w * u) + own * _mp.exp(-w2 * u)

        def slope(u: Any) -> Any:
            return sum(size * _mp.exp(-decay * u) for decay, size in slopes)

        ends = [_mp.zero, *_turns(slopes, ticks), _mp.mpf(ticks)]
        found: list[Crossing] = []
        for start, end in pairwise(ends):
            last = value(end)
            while True:
                up, down = self.reference + self.c_on, self.reference - self.c_off
                self.nearest = min(self.nearest, float(abs(last - up)), float(abs(last - down)))
                if last >= up:
                    self.n_on += 1
                elif last <= down:
                    self.n_off += 1
                else:
                    break
                at = _root(lambda u: value(u) - self.reference, slope, start, end)
                found.append(Crossing(start_us + at, int(last >= up), abs(slope(at))))
        self.t_us, self.input, self.output = t_us, log_intensity, value(ticks)
        self.photoreceptor = photoreceptor(ticks)
        return found


def _turns(slopes: list[tuple[Any, Any]], ticks: int) -> list[Any]:
    """Where a sum of exponentials (decay, size) changes its sign in (0, ticks): between the zeros of its derivative.

    Times exp(a u), a being the smallest decay, the sum has one exponential less in its derivative, and so on: by Rolle
    it has one zero at most between two zeros of that.
    """
    slopes = [(decay, size) for decay, size in slopes if size != 0]
    if len(slopes) < 2:
        return []
    least = min(decay for decay, _ in slopes)
    inner = _turns([(decay - least, -(decay - least) * size) for decay, size in slopes], ticks)

    def total(u: Any) -> Any:
        return sum(size * _mp.exp(-(decay - least) * u) for decay, size in slopes)

    def rate(u: Any) -> Any:
        return sum(-(decay - least) * size * _mp.exp(-(decay - least) * u) for decay, size in slopes)

    ends = [_mp.zero, *inner, _mp.mpf(ticks)]
    return [_root(total, rate, low, high) for low, high in pairwise(ends) if total(low) * total(high) < 0]


def _root(of: Callable[[Any], Any], slope: Callable[[Any], Any], low: Any, high: Any) -> Any:
    """The root of a monotone function whose sign changes, to 1e-9: Newton's steps, halves where they lead astray."""
    rises = of(high) >= 0
    at = (low + high) / 2
    while high - low > 1e-9:
        excess = of(at)
        if (excess >= 0) == rises:
            high = at
        else:
            low = at
        newton = at - excess / slope(at)
        if abs(newton - at) < 1e-12:
            return newton
        at = newton if low < newton < high else (low + high) / 2
    return at


def philox(key: tuple[int, int], counter: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """Philox 4x32 with ten rounds, by its definition (Salmon et al., SC 2011)."""
    (k0, k1), (c0, c1, c2, c3) = key, counter
    for _ in range(10):
        p0, p2 = c0 * 0xD2511F53, c2 * 0xCD9E8D57
        c0, c1, c2, c3 = p2 >> 32 ^ c1 ^ k0, p2 & 0xFFFFFFFF, p0 >> 32 ^ c3 ^ k1, p0 & 0xFFFFFFFF
        k0, k1 = (k0 + 0x9E3779B9) & 0xFFFFFFFF, (k1 + 0xBB67AE85) & 0xFFFFFFFF
    return c0, c1, c2, c3


class Draw:
    """The draw of (seed, purpose, pixel, index): two uniform numbers and a coin."""

    def __init__(self, seed: int, purpose: int, pixel: int, index: int) -> None:
        words = philox((seed, 0), (index, 0, pixel, purpose))
        self.uniform = (words[0] * 2**20 + (words[1] >> 12) + 0.5) / 2**52
        self.second_uniform = (words[2] + 0.5) / 2**32
        self.normal = math.sqrt(-2 * math.log(self.uniform)) * math.cos(2 * math.pi * self.second_uniform)


START_PHASE, LEAK_SPREAD, LEAK_JITTER, READOUT_REQUEST = 3, 8, 9, 14


def start_distance(start_phase: str, *, pixel: int, seed: int, c: tuple[float, float]) -> float:
    """How far a pixel's log intensity lies above its reference at the first frame."""
    if start_phase == "zero":
        return 0.0
    return Draw(seed, START_PHASE, pixel, 0).uniform * (c[0] + c[1]) - c[1]


def leaky_pixel(
    path: list[tuple[int, float]],
    leak: LeakRate,
    stamps: list[int],
    *,
    pixel: int,
    seed: int,
    c: tuple[float, float],
    period_us: float = 0.0,
    start_phase: str = "zero",
) -> list[tuple[float, int]]:
    """Times and polarities of the events that a leaking pixel makes along a path of (microseconds, log intensity).

    As :class:`~davis_rs.sensor.effects.LeakRate` says. ``stamps`` are those of the engine, which name the draws of
    jitter.
    """
    deviation = math.sqrt(math.log1p(leak.spread**2))
    factor = math.exp(deviation * Draw(seed, LEAK_SPREAD, pixel, 0).normal - deviation**2 / 2)
    per_us = c[0] * leak.rate_hz * factor * 1e-6
    seen, rates = [path[0][1]], []
    for (start, low), (end, high) in pairwise(path):
        light = (math.exp(low) + math.exp(high)) / 2
        rates.append(per_us * (2 ** ((leak.temperature_c - 25) / leak.doubling_c) + light / leak.double_luma))
        seen.append(seen[-1] + high - low + rates[-1] * (end - start))
    times = [t for t, _ in path]
    now, last = 0.0, 0
    reference = seen[0] - start_distance(start_phase, pixel=pixel, seed=seed, c=c)
    found: list[tuple[float, int]] = []
    while True:
        crossing = None
        for k, (start, end) in enumerate(pairwise(times)):
            for level, p in ((reference + c[0], 1), (reference - c[1], 0)):
                if end > now and crossing is None and (seen[k + 1] >= level if p else seen[k + 1] <= level):
                    at = start + (level - seen[k]) / (seen[k + 1] - seen[k]) * (end - start)
                    crossing = max(now, at), p, level, rates[k]
        if crossing is None:
            return found
        now, p, reference, rate = crossing
        found.append((now, p))
        tick = stamps[len(found) - 1] if len(found) <= len(stamps) else math.ceil(now)
        error = leak.jitter * rate * (tick - last) * Draw(seed, LEAK_JITTER, pixel, tick).normal
        last = tick
        if period_us:
            now += period_us
            reference = float(np.interp(now, times, seen))
        reference += min(max(error, -min(c) / 2), min(c) / 2)


def read_out(
    events: EventArray,
    *,
    events_per_s: float,
    row_us: float = 0.0,
    latency_us: float = 0.0,
    drop_after_us: float = math.inf,
    period_us: float = 0.0,
    by_columns: bool = False,
    seed: int = 0,
) -> tuple[EventArray, int, int]:
    """What a bus makes of events, how many it drops, and how many are missed.

    It grants the row with the oldest request, and carries all of it, in order of columns. When within its microsecond
    a row asks is drawn. A pixel asks no more until its event was carried and its reset, of the refractory period and at
    least a microsecond, is over.
    """
    if by_columns:
        turned, dropped, missed = read_out(
            _turned(events[np.lexsort((events["y"], events["x"], events["t"]))]),
            events_per_s=events_per_s,
            row_us=row_us,
            latency_us=latency_us,
            drop_after_us=drop_after_us,
            period_us=period_us,
            seed=seed,
        )
        return _turned(turned), dropped, missed

    @cache
    def asked_us(t_us: int, row: int) -> float:
        return t_us + Draw(seed, READOUT_REQUEST, row, t_us).uniform

    coming = [(int(e["t"]), int(e["y"]), int(e["x"]), int(e["p"])) for e in events]
    pending: list[tuple[int, int, int, int]] = []
    ready_us: dict[tuple[int, int], float] = {}
    free_us, dropped, missed = 0.0, 0, 0
    carried: list[tuple[int, int, int, int]] = []
    while coming or pending:
        first_us, row = min((asked_us(*event[:2]), event[1]) for event in pending) if pending else (math.inf, -1)
        now_us = max(free_us, first_us)
        if coming and coming[0][0] <= now_us:
            event = coming.pop(0)
            if event[0] < ready_us.get(event[1:3], 0):
                missed += 1
            else:
                pending.append(event)
                ready_us[event[1:3]] = math.inf
            continue
        granted = [event for event in pending if event[1] == row]
        pending = [event for event in pending if event[1] != row]
        in_time = [event for event in granted if now_us - asked_us(*event[:2]) <= drop_after_us]
        dropped += len(granted) - len(in_time)
        stamp_us = math.floor(now_us + latency_us)
        for event in granted:
            read_us = stamp_us if event in in_time else math.floor(now_us)
            ready_us[event[1:3]] = read_us + math.ceil(max(period_us, 1.0))
        if in_time:
            carried += sorted((stamp_us, x, y, p) for _, y, x, p in in_time)
            free_us = now_us + row_us + len(in_time) * (1e6 / events_per_s)
    return np.array(carried, EVENT_DTYPE), dropped, missed


def _turned(events: EventArray) -> EventArray:
    """Events with x and y exchanged."""
    turned = events.copy()
    turned["x"], turned["y"] = events["y"], events["x"]
    return turned
