"""Labels of signal and noise: the best matching with the twin says them, whatever packets the streams come in."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs import EVENT_DTYPE
from davis_rs.events.arrays import EventArray
from davis_rs.events.matching import compare_events
from davis_rs.events.signal_labels import SignalLabels, label_signal
from strategies import EXAMPLES

SIZE = (8, 4)
WINDOW_US = 100


def stream(t_us: npt.ArrayLike, x: npt.ArrayLike = 0, p: npt.ArrayLike = 1) -> EventArray:
    columns = np.broadcast_arrays(np.asarray(t_us, np.int64), x, p)
    events = np.zeros(columns[0].size, EVENT_DTYPE)
    for name, column in zip("txp", columns, strict=True):
        events[name] = column
    return events[np.argsort(events["t"], kind="stable")]


def noisy_pair(seed: int = 1, events: int = 20_000, end_us: int = 1_000_000) -> tuple[EventArray, EventArray]:
    """A twin, and a stream that has most of its events, shifted, and others of its own."""
    rng = np.random.default_rng(seed)
    clean = stream(rng.integers(200, end_us, events), rng.integers(0, SIZE[0], events), rng.integers(0, 2, events))
    kept = clean[rng.random(events) < 0.9]
    kept["t"] += rng.integers(-150, 150, len(kept))
    more = stream(rng.integers(1, end_us, 3000), rng.integers(0, SIZE[0], 3000), rng.integers(0, 2, 3000))
    noisy = np.concatenate([kept, more])
    return noisy[np.argsort(noisy["t"], kind="stable")], clean


def in_packets(
    noisy: EventArray, clean: EventArray, ends_us: Sequence[int], window_us: int = WINDOW_US
) -> tuple[npt.NDArray[np.bool_], int]:
    """The labels, and the most events that had none yet after a packet."""
    labels, told, waiting, before = SignalLabels(SIZE, window_us=window_us), [], 0, -1
    came = 0
    for end_us in ends_us:
        ours, theirs = (each[(each["t"] > before) & (each["t"] <= end_us)] for each in (noisy, clean))
        came += len(ours)
        told.append(labels.add(ours, theirs, end_us))
        waiting, before = max(waiting, came - sum(map(len, told))), end_us
    told.append(labels.finish())
    assert (labels.signal, labels.noise) == (int(np.concatenate(told).sum()), int((~np.concatenate(told)).sum()))
    return np.concatenate(told), waiting


def least_cost(ours: Sequence[int], theirs: Sequence[int], labels: Sequence[bool] | None, window: int) -> float:
    """The least cost of a matching of one pixel, of those with exactly these of ours in pairs, by trying all."""
    cost = np.full((len(ours) + 1, len(theirs) + 1), math.inf)
    alone = (window + 0.5) / 2
    cost[0] = alone * np.arange(len(theirs) + 1)
    for i, t in enumerate(ours):
        may_stay, may_pair = (True, True) if labels is None else (not labels[i], labels[i])
        for j in range(len(theirs) + 1):
            options = [math.inf]
            if may_stay:
                options.append(cost[i, j] + alone)
            if j:
                options.append(cost[i + 1, j - 1] + alone)
            if j and may_pair and abs(t - theirs[j - 1]) <= window:
                options.append(cost[i, j - 1] + abs(t - theirs[j - 1]))
            cost[i + 1, j] = min(options)
    return float(cost[-1, -1])


TIMES = st.lists(st.integers(1, 400), max_size=9).map(sorted)


@given(TIMES, TIMES, st.sets(st.integers(1, 400), max_size=4), st.integers(0, 120))
@EXAMPLES
def test_labels_are_those_of_a_best_matching(
    ours: list[int], theirs: list[int], ends_us: set[int], window_us: int
) -> None:
    """No matching costs less than those in which exactly the signal is in pairs; trying all of them says so."""
    labels, _ = in_packets(stream(ours), stream(theirs), [*sorted(ends_us), 400], window_us)
    best = least_cost(ours, theirs, None, window_us)
    assert least_cost(ours, theirs, labels.tolist(), window_us) == pytest.approx(best)


def test_packets_do_not_matter_and_the_counts_are_those_of_the_comparison() -> None:
    noisy, clean = noisy_pair()
    whole = label_signal(noisy, clean, size=SIZE, window_us=WINDOW_US)
    comparison = compare_events(noisy, clean, size=SIZE, window_us=WINDOW_US)
    assert whole.dtype == np.bool_
    assert len(whole) == len(noisy)
    assert int(whole.sum()) == comparison.matched
    assert int((~whole).sum()) == comparison.spurious
    for ends_us in (range(0, 1_000_400, 1000), range(0, 1_000_400, 377), [1, 500_000]):
        labels, _ = in_packets(noisy, clean, [*ends_us, 1_000_400])
        assert (labels == whole).all()


@pytest.mark.few(1)
@pytest.mark.parametrize("events", [20_000, 100_000])
def test_labels_wait_for_no_more_than_the_longest_run(events: int) -> None:
    """A pixel that never pauses is cut after 100 windows: what waits does not grow with the length of the run."""
    t_us = 40 * np.arange(1, events)
    noisy, clean = stream(t_us + 7), stream(t_us)
    ends_us = [*range(0, 40 * events, 1000), 40 * events]
    labels, waiting = in_packets(noisy, clean, ends_us)
    assert waiting <= (101 * WINDOW_US + 1000) / 40 + 2
    assert labels.mean() > 0.99  # a pair is lost only where a run is cut between its events
    other, _ = in_packets(noisy, clean, ends_us[::3] + ends_us[-1:])
    assert (labels == other).all()


def test_a_long_run_is_cut_at_its_longest_pause() -> None:
    t_us = np.delete(60 * np.arange(400), 130)  # 120 us without an event would end the run: 90 us do not
    t_us[t_us > 130 * 60] -= 30
    labels, _ = in_packets(stream(t_us + 11), stream(t_us), [*range(0, 25_000, 500), 25_000])
    assert labels.all()


def test_all_of_a_stream_is_the_signal_of_itself_and_noise_without_a_twin() -> None:
    noisy, _ = noisy_pair()
    assert label_signal(noisy, noisy, size=SIZE).all()
    assert not label_signal(noisy, noisy[:0], size=SIZE).any()
    assert len(label_signal(noisy[:0], noisy, size=SIZE)) == 0


def test_of_two_events_near_one_of_the_twin_the_nearer_is_signal() -> None:
    assert label_signal(stream([90, 104]), stream([100]), size=SIZE).tolist() == [False, True]
    assert not label_signal(stream([90]), stream([100], p=0), size=SIZE).any()
    assert not label_signal(stream([90]), stream([100], x=1), size=SIZE).any()
    assert label_signal(stream([90]), stream([100]), size=SIZE, window_us=10).all()
    assert not label_signal(stream([90]), stream([100]), size=SIZE, window_us=9).any()


def test_events_of_another_time_are_refused() -> None:
    labels = SignalLabels(SIZE)
    labels.add(stream([5]), stream([6]), 10)
    with pytest.raises(ValueError, match=r"events must lie after 10 us, .* up to until_us, 20 us: got 10 to 10 us"):
        labels.add(stream([10]), stream([]), 20)
    with pytest.raises(ValueError, match=r"noiseless must lie after 10 us, .* up to until_us, 20 us: got 21 to"):
        labels.add(stream([]), stream([21]), 20)
    with pytest.raises(ValueError, match=r"noiseless: event 0 at .* lies outside of the 8 x 4 sensor"):
        labels.add(stream([]), stream([11], x=8), 20)
    with pytest.raises(ValueError, match="noiseless events are missing: simulate with signal_window_us"):
        labels.add(stream([]), None, 20)
    with pytest.raises(ValueError, match="window_us must be"):
        SignalLabels(SIZE, window_us=-1)
