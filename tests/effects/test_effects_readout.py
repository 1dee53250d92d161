"""The readout bus: whose row is read and when, that order stays, and that what it cannot carry waits or is counted."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from davis_rs import CrossingEngine, Effects
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.sensor.effects import HotPixels, Readout, ShotNoise
from effects_reference import collect, read_out, scene, shortest_interval_us
from strategies import EPOCH_US, EXAMPLES, random_paths

UNLIKELY = 1e-6
"""The significance of every statistical test here; seeds are fixed."""

eighths = st.integers(0, 800).map(lambda n: n / 8)
"""Waits in microseconds that make no rounding error."""

LogFrames = npt.NDArray[np.float64]


def texture(frames: int, height: int, width: int) -> LogFrames:
    """Random walks of log intensity with jumps, (frames, height, width)."""
    return random_paths(height * width, frames).reshape(frames, height, width)


def engines(height: int, width: int, bus: Readout, **effects: Any) -> tuple[CrossingEngine, CrossingEngine]:
    """The same pixels without the bus and with it."""
    return (
        CrossingEngine(width, height, effects=Effects(**effects)),
        CrossingEngine(width, height, effects=Effects(readout=bus, **effects)),
    )


def run(engine: CrossingEngine, frames: LogFrames, gap_us: int) -> tuple[list[EventArray], EventArray]:
    """The packet of each frame, and what is flushed at the end."""
    packets = [engine.push_log(k * gap_us, frame) for k, frame in enumerate(frames)]
    return packets, engine.flush()


def assert_a_part(left: EventArray, came: EventArray) -> None:
    """Each that left is one that came, not later, and in its pixel's order: of its last request before it left."""
    for y, x in {(int(e["y"]), int(e["x"])) for e in left}:
        requests, rest = (events[(events["x"] == x) & (events["y"] == y)] for events in (came, left))
        at = 0
        for event in rest:
            at += (
                next(k for k, one in enumerate(requests[at:]) if one["p"] == event["p"] and one["t"] <= event["t"]) + 1
            )


@EXAMPLES
@given(
    st.integers(0, 5),
    st.sampled_from([(1, 1), (3, 4), (5, 2)]),
    st.sampled_from([3, 20, 300]),
    st.sampled_from([1.0, 1e4, 2.5e5, 1e6, 8e6, math.inf]),
    eighths,
    st.one_of(st.none(), eighths),
    st.sampled_from([0.0, 0.5, 12.25]),
    st.sampled_from([0.0, 3.37, 40.0]),
    st.integers(0, 1),
)
def test_the_stream_is_that_of_a_plain_bus(
    seed: int,
    size: tuple[int, int],
    gap_us: int,
    rate: float,
    latency_us: float,
    drop_after_us: float | None,
    row_us: float,
    period_us: float,
    by_columns: int,
) -> None:
    """Every stamp, every drop and every miss, in their order, against a bus that looks through all requests at each
    grant.

    No number rounds. Pixels wait for the bus and their reset: none has two events closer than that.
    """
    bus = Readout(rate, latency_us, drop_after_us=drop_after_us, row_us=row_us, by_columns=by_columns)
    plain, read = engines(*size, bus, refractory_period_us=period_us)
    frames = texture(30, 6, 6)[seed : seed + 12, : size[0], : size[1]]
    expected, dropped, missed = read_out(
        collect(run(plain, frames, gap_us)[0]),
        events_per_s=rate,
        row_us=row_us,
        latency_us=latency_us,
        drop_after_us=math.inf if drop_after_us is None else drop_after_us,
        period_us=period_us,
        by_columns=bool(by_columns),
    )
    packets, rest = run(read, frames, gap_us)
    left = concatenate_events([*packets, rest])
    if not bus.neutral:
        np.testing.assert_array_equal(left, expected)
        assert (read.dropped_events, read.missed_events) == (dropped, missed)
        assert shortest_interval_us(left) >= max(period_us, 1.0)
    for k, packet in enumerate(packets):
        assert np.all((packet["t"] > (k - 1) * gap_us) & (packet["t"] <= k * gap_us))
    assert np.all(rest["t"] > (len(frames) - 1) * gap_us)
    # What the pixels do does not depend on the bus.
    np.testing.assert_array_equal(read.reference, plain.reference)
    np.testing.assert_array_equal(read.last_event_us, plain.last_event_us)


@pytest.mark.parametrize("latency_us", [0.0, 3.0, 250.5])
@pytest.mark.parametrize("jitter_us", [0.0, 5.0, 400.0])
@pytest.mark.parametrize("rate", [2e4, 12e6])
def test_no_event_is_lost_or_out_of_order(rate: float, latency_us: float, jitter_us: float) -> None:
    """Each event leaves once, after it came, in its pixel's order, or is counted as missed.

    The stream is sorted by time over all packets. Stamps of a push lie after the last push's and not beyond its
    own time. Whatever the jitter, no pixel has two events of one stamp.
    """
    plain, read = engines(12, 9, Readout(rate, latency_us, jitter_us))
    frames = texture(60, 12, 9)
    came = collect(run(plain, frames, 500)[0])
    packets, rest = run(read, frames, 500)
    left = concatenate_events([*packets, rest])
    assert np.all(np.diff(left["t"]) >= 0)
    for k, packet in enumerate(packets):
        assert np.all((packet["t"] > (k - 1) * 500) & (packet["t"] <= k * 500))
    assert_a_part(left, came)
    assert len(left) + read.missed_events == len(came)
    assert shortest_interval_us(left) >= 1 + (math.floor(latency_us) if jitter_us == 0 else 0)
    assert len(rest) > 0 or rate > 1e6
    assert len(read.flush()) == read.dropped_events == 0


@pytest.mark.parametrize("rate", [1e5, 3e6, 12e6])
@pytest.mark.long
def test_a_megahertz_of_noise_leaves_at_the_pace_of_the_bus(rate: float) -> None:
    """64 pixels at 1e6 Hz each, five times what the bus of a DAVIS240 carries and more: as many come as it carries.

    The rest is missed, because each pixel waits for the bus before it makes its next event: so no more than an event of
    each pixel waits at the end. From any stamp to any other there are no more events than the bus carries in that time,
    and one burst.
    """
    _, read = engines(
        8, 8, Readout(rate), shot_noise_rms=ShotNoise.of_rate(1e6, 0.2, half_luma=math.inf, bandwidth_hz=1e7)
    )
    plain, _ = engines(
        8, 8, Readout(rate), shot_noise_rms=ShotNoise.of_rate(1e6, 0.2, half_luma=math.inf, bandwidth_hz=1e7)
    )
    packets = [read.push_log(t, scene(-50, 8, 8)) for t in range(0, 1_001, 50)]
    came = collect(plain.push_log(t, scene(-50, 8, 8)) for t in range(0, 1_001, 50))
    during, rest = collect(packets), read.flush()
    assert len(during) + len(rest) + read.missed_events == len(came) > 60_000
    assert len(rest) <= 64
    # The last burst of the recording may be carried after its end.
    largest = np.unique(concatenate_events([during, rest])["t"], return_counts=True)[1].max()
    assert len(during) <= rate * 1e-3 + largest
    assert len(during) > 0.9 * rate * 1e-3 - 64
    stamps, burst = np.unique(concatenate_events([during, rest])["t"], return_counts=True)
    before = np.cumsum(burst) - burst
    # Events of bursts k to m-1 are carried between the stamps of k and m.
    for ahead in (1, 2, 5, 20):
        if len(stamps) > ahead:
            assert np.all(before[ahead:] - before[:-ahead] <= (stamps[ahead:] - stamps[:-ahead] + 1) * rate * 1e-6)


@pytest.mark.parametrize("drop_after_us", [0.0, 20.0, 150.0])
def test_what_waits_too_long_is_dropped_and_counted(drop_after_us: float) -> None:
    """Those that leave and those that are counted are all that came, and none that leaves waited longer."""
    plain, read = engines(6, 6, Readout(2e4, drop_after_us=drop_after_us))
    frames = texture(50, 6, 6)
    came = collect(run(plain, frames, 300)[0])
    packets, rest = run(read, frames, 300)
    left = concatenate_events([*packets, rest])
    assert read.dropped_events > 50
    assert len(left) + read.dropped_events + read.missed_events == len(came)
    for y, x in np.ndindex(6, 6):
        requests = came[(came["x"] == x) & (came["y"] == y)]
        for event in left[(left["x"] == x) & (left["y"] == y)]:
            waits = event["t"] - requests["t"][requests["p"] == event["p"]].astype(float)
            assert np.any((waits >= 0) & (waits <= drop_after_us + 1))


def test_latency_is_added_to_each_stamp() -> None:
    """On a bus without limit: its whole microseconds, and one more as often as its fraction says.

    Requests lie anywhere in their microsecond. A pixel's next event is one that comes after that.
    """
    for latency_us in (0.25, 7.0, 123.4):
        plain, read = engines(1, 1, Readout(math.inf, latency_us))
        frames = [(t, scene(0.151 * (t // 1_000))) for t in range(0, 2_000_000, 1_000)]
        came = collect(plain.push_log(*frame) for frame in frames)
        left = concatenate_events([*(read.push_log(*frame) for frame in frames), read.flush()])
        whole = math.floor(latency_us)
        later = left["t"] - came["t"] - whole
        assert set(later) <= {0, 1}
        assert stats.binomtest(int(later.sum()), len(later), latency_us - whole).pvalue > UNLIKELY
        assert len(left) > 1_000
        assert read.missed_events == 0


def test_jitter_is_normal_with_the_given_deviation() -> None:
    """Of 4,000 events far apart: mean latency, standard deviation (chi-square, 1e-6), normal (Kolmogorov-Smirnov)."""
    latency_us, jitter_us, count = 5_000.0, 700.0, 4_000
    read = CrossingEngine(1, 1, contrast_threshold=0.5, effects=Effects(readout=Readout(12e6, latency_us, jitter_us)))
    # A step of C within a microsecond, every 20 ms.
    packets = [read.push_log(20_000 * (k // 2) + k % 2, scene(0.6 * ((k + 1) // 2 % 2))) for k in range(2 * count + 2)]
    stamps = concatenate_events([*packets, read.flush()])["t"]
    delay = stamps % 20_000 - 1 - latency_us
    assert len(delay) >= count
    assert abs(delay.mean()) < 5 * jitter_us / math.sqrt(len(delay))
    spread = delay.var(ddof=1) * (len(delay) - 1) / jitter_us**2
    assert UNLIKELY < stats.chi2.cdf(spread, len(delay) - 1) < 1 - UNLIKELY
    assert stats.kstest(delay / jitter_us, "norm").pvalue > UNLIKELY
    assert stats.pearsonr(delay[1:], delay[:-1]).pvalue > UNLIKELY


def test_a_stamp_is_never_before_its_grant() -> None:
    """However much larger than the latency the jitter is: half of the events have the microsecond of their request."""
    plain, read = engines(1, 1, Readout(math.inf, 0.0, 50.0))
    times = range(0, 2_000_000, 1_000)
    frames = [(t, scene(0.151 * (t // 1_000))) for t in times]
    came = collect(plain.push_log(*frame) for frame in frames)
    left = concatenate_events([*(read.push_log(*frame) for frame in frames), read.flush()])
    waited = left["t"] - came["t"]
    assert waited.min() == 0
    assert stats.binomtest(int((waited == 0).sum()), len(waited), 0.5).pvalue > UNLIKELY


@pytest.mark.parametrize("cut", [1, 17, 39])
def test_a_stored_bus_goes_on(cut: int) -> None:
    """Requests that wait, events with stamps ahead, the bus's time and the count of drops: all are in the state."""
    bus = Readout(3e4, 40.0, 30.0, drop_after_us=700.0)
    _, whole = engines(7, 7, bus)
    _, parts = engines(7, 7, bus)
    frames = texture(40, 7, 7)
    expected = [whole.push_log(k * 250, frame) for k, frame in enumerate(frames)]
    got = [parts.push_log(k * 250, frame) for k, frame in enumerate(frames[:cut])]
    parts = pickle.loads(pickle.dumps(parts))
    got += [parts.push_log((cut + k) * 250, frame) for k, frame in enumerate(frames[cut:])]
    for one, other in zip([*expected, whole.flush()], [*got, parts.flush()], strict=True):
        assert one.tobytes() == other.tobytes()
    assert parts.dropped_events == whole.dropped_events > 0


def test_after_a_flush_the_bus_goes_on_in_order() -> None:
    """Later events are stamped after those that were flushed, though these lie ahead of the frames."""
    _, read = engines(6, 6, Readout(1e4))
    frames = texture(30, 6, 6)
    first = [read.push_log(k * 100, frame) for k, frame in enumerate(frames[:15])]
    flushed = read.flush()
    second = [read.push_log((15 + k) * 100, frame) for k, frame in enumerate(frames[15:])]
    stream = concatenate_events([*first, flushed, *second, read.flush()])
    plain, _ = engines(6, 6, Readout(1e4))
    assert len(flushed) > 0
    assert flushed["t"][-1] > 30 * 100
    came = collect(run(plain, frames, 100)[0])
    assert_a_part(stream, came)
    assert len(stream) + read.missed_events == len(came)
    assert np.all(np.diff(stream["t"]) >= 0)


@pytest.mark.long
@pytest.mark.parametrize("rate", [1e6, 12e6])
def test_at_a_unix_time_it_is_the_same(rate: float) -> None:
    """From 0 and from 1.7e15 us: the same events, shifted, at the same pace."""
    early, late = (
        concatenate_events([*(read.push_log(start + t, scene(0, 8, 8)) for t in range(0, 1_001, 50)), read.flush()])
        for start in (0, EPOCH_US)
        for read in [
            engines(
                8,
                8,
                Readout(rate, 0.3),
                shot_noise_rms=ShotNoise.of_rate(1e6, 0.2, half_luma=math.inf, bandwidth_hz=1e7),
            )[1]
        ]
    )
    late["t"] -= EPOCH_US
    np.testing.assert_array_equal(late, early)


def test_an_engine_without_a_bus_holds_nothing_back() -> None:
    """Nothing to flush, nothing dropped."""
    plain = CrossingEngine(6, 6, effects=Effects(leak_rate_hz=1.0))
    run(plain, texture(10, 6, 6), 100)
    assert len(plain.flush()) == plain.dropped_events == 0


def most_bursts(events: EventArray, window_us: int) -> int:
    """The most bursts (rows of one stamp) in any window of ``window_us``."""
    bursts = np.unique(events[["t", "y"]])["t"].astype(np.int64)
    return int((np.searchsorted(bursts, bursts + window_us) - np.arange(len(bursts))).max())


def test_the_address_of_a_row_costs_time() -> None:
    """Rows of a DAVIS240C all of which ask at once: with its preset's bus at most 3 bursts leave in a microsecond.

    Without the cost of rows there are as many as the columns' pace allows: 9 events in a microsecond.
    """
    made = {}
    for row_us in (0.0, 0.32):
        plain, read = engines(180, 240, Readout(9e6, row_us=row_us), hot_pixels=HotPixels(0.02, 3e4))
        came = collect(plain.push_log(t, scene(0, 180, 240)) for t in (0, 2_000))
        left = collect([*(read.push_log(t, scene(0, 180, 240)) for t in (0, 2_000)), read.flush()])
        assert len(left) + read.missed_events == len(came)
        made[row_us] = most_bursts(left, 1), most_bursts(left, 10)
    assert made[0.32][0] == 3
    assert 15 < made[0.32][1] <= 24  # bursts of one event each would be 24
    assert made[0.0][0] >= 8


def test_a_whole_row_costs_its_address_once() -> None:
    """Two rows of 240 events: the second's stamp comes after the first's address and its columns."""
    for row_us in (0.0, 30.0):
        _, read = engines(2, 240, Readout(1e6, row_us=row_us))
        read.push_log(0, scene(0, 2, 240))
        events = collect([read.push_log(10, scene(0.15, 2, 240)), read.flush()])
        first, second = np.unique(events["t"])
        assert second - first == pytest.approx(240 + row_us, abs=1)


@pytest.mark.parametrize("by_columns", [0, 1])
def test_rows_that_ask_together_are_read_in_any_order(by_columns: int) -> None:
    """200 rows ask in one microsecond: each is read in one burst, and half of the steps between them go up.

    Another seed has another order.
    """
    orders = []
    for seed in (0, 1):
        size = (200, 3) if by_columns else (3, 200)
        read = CrossingEngine(*size, effects=Effects(readout=Readout(math.inf, 3.0, by_columns=by_columns)), seed=seed)
        read.push_log(0, scene(0.0, *size[::-1]))
        left = collect([read.push_log(10, scene(0.15, *size[::-1])), read.flush()])
        assert len(np.unique(left["t"])) == 1
        row, column = (left["x"], left["y"]) if by_columns else (left["y"], left["x"])
        bursts = row.reshape(200, 3)
        assert np.all(bursts == bursts[:, :1])
        assert np.array_equal(column.reshape(200, 3), np.tile(np.arange(3), (200, 1)))
        up = int(np.count_nonzero(np.diff(bursts[:, 0].astype(int)) > 0))
        assert stats.binomtest(up, 199, 0.5).pvalue > UNLIKELY
        orders.append(bursts[:, 0].tolist())
    assert sorted(orders[0]) == sorted(orders[1]) == list(range(200))
    assert orders[0] != orders[1]


def test_requests_come_at_any_time_in_their_microsecond() -> None:
    """Two rows that ask 1 us apart, each burst 0.4 us long: they share a stamp where the first comes late in its own.

    The first asks at u, the second at 1 + v; with a latency of half a microsecond their stamps are floor(u + 0.5) and
    floor(1 + v + 0.5), and alike where u >= 0.5 > v. That is a quarter of all.
    """
    shared = 0
    for seed in range(400):
        read = CrossingEngine(1, 2, effects=Effects(readout=Readout(math.inf, 0.5, row_us=0.4)), seed=seed)
        read.push_log(0, np.zeros((2, 1)))
        packets = [read.push_log(10, np.array([[0.15], [0.0]])), read.push_log(11, np.array([[0.15], [0.15]]))]
        first, second = collect([*packets, read.flush()])["t"]
        shared += first == second
    assert stats.binomtest(shared, 400, 0.25).pvalue > UNLIKELY
