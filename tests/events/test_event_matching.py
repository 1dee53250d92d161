"""The comparison of event streams: the matching is the best one, and says what was done to a stream."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs import EVENT_DTYPE
from davis_rs.events.arrays import EventArray
from davis_rs.events.matching import EventComparison, compare_events
from strategies import EPOCH_US, EXAMPLES

WIDTH, HEIGHT = 40, 30
SIZE = (WIDTH, HEIGHT)
WINDOW_US = 1000
FAR_US = 2 * WINDOW_US + 100
"""More than this lies between two events of a pixel and polarity of :func:`sparse_stream`."""


def stream(t_us: npt.ArrayLike, x: npt.ArrayLike = 0, y: npt.ArrayLike = 0, p: npt.ArrayLike = 1) -> EventArray:
    """Events sorted by time."""
    columns = np.broadcast_arrays(t_us, x, y, p)
    events = np.zeros(columns[0].size, EVENT_DTYPE)
    for name, column in zip("txyp", columns, strict=True):
        events[name] = column
    return events[np.argsort(events["t"], kind="stable")]


def sparse_stream() -> EventArray:
    """60,000 events, of which those that could be confused lie far apart: 25 of each pixel and polarity."""
    rng = np.random.default_rng(1)
    t_us = np.cumsum(rng.integers(FAR_US, 10 * FAR_US, (25, HEIGHT, WIDTH, 2)), axis=0)
    _, y, x, p = np.indices(t_us.shape)
    return stream(t_us.ravel(), x.ravel(), y.ravel(), p.ravel())


def compared(events: npt.ArrayLike, reference: npt.ArrayLike, window_us: int = WINDOW_US) -> EventComparison:
    return compare_events(events, reference, size=SIZE, window_us=window_us)


def counts(comparison: EventComparison) -> tuple[int, int, int]:
    assert comparison.matched == len(comparison.time_error_us) == comparison.reference - comparison.missing
    assert comparison.matched == comparison.compared - comparison.spurious
    return comparison.matched, comparison.missing, comparison.spurious


# ---- what was done to a stream is what is found ----


def test_a_stream_equals_itself() -> None:
    """Nothing is missing, nothing is spurious, no event is off, wherever time begins; equal events count each."""
    events = sparse_stream()
    events["t"] += EPOCH_US
    events = np.repeat(events, 2)
    comparison = compared(events, events)
    assert counts(comparison) == (len(events), 0, 0)
    assert comparison.time_error_us.dtype == np.float64
    assert not comparison.time_error_us.any()
    assert (comparison.median_us, comparison.p99_us) == (0, 0)


@pytest.mark.parametrize("shift_us", [10, -10])
def test_a_shift_is_every_event_s_error(shift_us: int) -> None:
    """Errors are the other stream's time minus the reference's."""
    events, reference = sparse_stream(), sparse_stream()
    events["t"] += shift_us
    comparison = compared(events, reference)
    assert counts(comparison) == (len(events), 0, 0)
    assert (comparison.time_error_us == shift_us).all()
    assert (comparison.median_us, comparison.p99_us) == (10, 10)


def test_dropped_and_added_events_are_counted_and_shift_no_other() -> None:
    """One per cent dropped is missing, two per cent added are spurious, and all others match themselves."""
    reference = sparse_stream()
    rng = np.random.default_rng(2)
    kept = np.ones(len(reference), np.bool_)
    kept[rng.choice(len(reference), len(reference) // 100, replace=False)] = False
    comparison = compared(reference[kept], reference)
    assert counts(comparison) == (kept.sum(), (~kept).sum(), 0)
    assert not comparison.time_error_us.any()
    assert (comparison.missing_percent, comparison.spurious_percent) == (1, 0)

    added = reference[rng.choice(np.flatnonzero(kept), len(reference) // 50, replace=False)]
    added["t"] += FAR_US // 2
    both = np.concatenate([reference[kept], added])
    comparison = compared(both[np.argsort(both["t"], kind="stable")], reference)
    assert counts(comparison) == (kept.sum(), (~kept).sum(), len(added))
    assert not comparison.time_error_us.any()
    assert (comparison.missing_percent, comparison.spurious_percent) == (1, 2)


def test_within_a_burst_a_missing_and_a_spurious_event_shift_none_between_them() -> None:
    """Pairing the n-th with the n-th, or as many as possible, would report 98 errors of a period for two mistakes."""
    period_us = WINDOW_US // 5
    times = np.arange(100) * period_us
    comparison = compared(stream(times[1:]), stream(times[:-1]))
    assert counts(comparison) == (98, 1, 1)
    assert not comparison.time_error_us.any()


def test_jitter_and_a_lost_event_in_a_burst() -> None:
    """In a burst denser than the window every error but that of the lost event is found as it was made."""
    rng = np.random.default_rng(3)
    times = 100_000 + np.arange(500) * 100
    jitter = rng.integers(-20, 21, times.size)
    kept = np.arange(times.size) != 250
    comparison = compared(stream((times + jitter)[kept]), stream(times), 10_000)
    assert counts(comparison) == (499, 1, 0)
    np.testing.assert_array_equal(comparison.time_error_us, jitter[kept])


@pytest.mark.parametrize("field", ["p", "x", "y"])
def test_an_event_of_another_pixel_or_polarity_is_missing_and_spurious(field: str) -> None:
    """Matching never crosses pixels or polarities."""
    reference = sparse_stream()
    reference = reference[(reference["x"] % 2 == 0) & (reference["y"] % 2 == 0) & (reference["p"] == 0)]
    events = reference.copy()
    changed = np.random.default_rng(4).choice(len(events), 300, replace=False)
    events[field][changed] = events[field][changed] + 1  # where no other event is
    comparison = compared(events, reference)
    assert counts(comparison) == (len(events) - 300, 300, 300)
    assert not comparison.time_error_us.any()


@pytest.mark.parametrize("window_us", [0, 1, 7, 10_000, 2**31 - 1])
def test_the_window_includes_its_edge(window_us: int) -> None:
    """At the edge events match, one microsecond further they do not, in either direction."""
    for sign in (1, -1):
        reference = stream(EPOCH_US)
        at_edge, beyond = stream(EPOCH_US + sign * window_us), stream(EPOCH_US + sign * (window_us + 1))
        assert compared(at_edge, reference, window_us).time_error_us.tolist() == [sign * window_us]
        assert counts(compared(beyond, reference, window_us)) == (0, 1, 1)


# ---- the matching is the best one ----


@cache
def all_matchings(
    events: tuple[int, ...], reference: tuple[int, ...], window_us: int
) -> frozenset[tuple[int, tuple[int, ...]]]:
    """(unmatched events, sorted errors) of every one-to-one matching within the window, crossing ones included."""
    if not reference:
        return frozenset({(len(events), ())})
    found = {(rest + 1, errors) for rest, errors in all_matchings(events, reference[1:], window_us)}
    for at, t_us in enumerate(events):
        if abs(error := t_us - reference[0]) <= window_us:
            others = all_matchings(events[:at] + events[at + 1 :], reference[1:], window_us)
            found |= {(rest, tuple(sorted([*errors, error]))) for rest, errors in others}
    return frozenset(found)


def total(unmatched: int, errors: npt.ArrayLike, window_us: int) -> int:
    """What the matching is to make least, in quarters of a microsecond."""
    return 4 * int(np.abs(errors).sum()) + (2 * window_us + 1) * unmatched


TIMES = st.lists(st.integers(0, 40), max_size=5).map(sorted)


@EXAMPLES
@given(TIMES, TIMES, st.integers(0, 25))
def test_no_matching_is_better(ours: list[int], theirs: list[int], window_us: int) -> None:
    """Against every matching there is: the sum is the least, and the errors are those of a matching with that sum."""
    comparison = compared(stream(ours), stream(theirs), window_us)
    _, missing, spurious = counts(comparison)
    matchings = all_matchings(tuple(ours), tuple(theirs), window_us)
    least = min(total(*matching, window_us) for matching in matchings)
    mine = (missing + spurious, tuple(sorted(comparison.time_error_us.astype(int).tolist())))
    assert mine in matchings
    assert total(*mine, window_us) == least


def victor_purpura(ours: npt.NDArray[np.int64], theirs: npt.NDArray[np.int64], window_us: int) -> int:
    """The same least sum by the paper's recurrence."""
    price = 2 * window_us + 1
    row = [price * j for j in range(len(theirs) + 1)]
    for t_us in ours.tolist():
        above, row = row, [row[0] + price]
        for j, other_us in enumerate(theirs.tolist()):
            row.append(min(row[j] + price, above[j + 1] + price, above[j] + 4 * abs(t_us - other_us)))
    return row[-1]


@pytest.mark.parametrize("seed", range(12))
def test_long_bursts_are_aligned_as_by_the_papers_recurrence(seed: int) -> None:
    """Unrelated, distorted and unequally dense bursts, in which hundreds of events compete for partners."""
    rng = np.random.default_rng(seed)
    window_us = int(rng.integers(1, 60))
    theirs = np.sort(rng.integers(0, int(rng.integers(300, 6000)), 200))
    if seed % 2:
        ours = np.sort(rng.integers(0, 3000, int(rng.integers(50, 400))))
    else:
        ours = np.sort(theirs + rng.integers(-20, 60, theirs.size))[rng.random(theirs.size) < 0.9]
    comparison = compared(stream(ours), stream(theirs), window_us)
    _, missing, spurious = counts(comparison)
    assert np.abs(comparison.time_error_us).max() <= window_us
    assert total(missing + spurious, comparison.time_error_us, window_us) == victor_purpura(ours, theirs, window_us)


def random_stream(rng: np.random.Generator, count: int) -> EventArray:
    """Events of a few pixels, many at the same times."""
    return stream(
        rng.integers(0, 5000, count), rng.integers(0, 5, count), rng.integers(0, 4, count), rng.integers(0, 2, count)
    )


def test_each_pixel_and_polarity_is_matched_by_itself() -> None:
    """The whole is the pixels and polarities one after the other, in the order that is documented."""
    rng = np.random.default_rng(5)
    events, reference = random_stream(rng, 3000), random_stream(rng, 2500)
    whole, errors = compared(events, reference, 30), []
    for y, x, p in np.ndindex(4, 5, 2):
        one, other = (s[(s["x"] == x) & (s["y"] == y) & (s["p"] == p)] for s in (events, reference))
        errors.append(compared(one, other, 30).time_error_us)
    np.testing.assert_array_equal(whole.time_error_us, np.concatenate(errors))
    assert 0 < whole.matched < 2500


@pytest.mark.parametrize("seed", range(10))
def test_swapped_streams_swap_roles(seed: int) -> None:
    """Missing becomes spurious and errors change their sign, pair by pair, though many matchings are equally good."""
    rng = np.random.default_rng(seed)
    for _ in range(20):
        ours, theirs = (stream(rng.integers(0, 40, rng.integers(1, 40))) for _ in range(2))
        window_us = int(rng.integers(0, 15))
        there, back = compared(ours, theirs, window_us), compared(theirs, ours, window_us)
        assert counts(there) == (back.matched, back.spurious, back.missing)
        np.testing.assert_array_equal(there.time_error_us, -back.time_error_us)


# ---- inputs ----


def test_empty_streams() -> None:
    """Nothing to match is no error; what has no value is NaN."""
    nothing, something = stream([]), stream([1, 2, 3])
    assert counts(compared(nothing, something)) == (0, 3, 0)
    assert counts(compared(something, nothing)) == (0, 0, 3)
    neither = compared(nothing, nothing)
    assert counts(neither) == (0, 0, 0)
    assert np.isnan([neither.median_us, neither.p99_us, neither.missing_percent, neither.spurious_percent]).all()
    assert compared(nothing, something).missing_percent == 100


def test_times_at_both_ends_of_64_bits() -> None:
    """Differences that exceed 64 bits are no matches, and small ones out there are exact."""
    least, largest = -(2**63), 2**63 - 1
    reference = stream(np.array([least, 0, largest - 5], np.int64))
    events = stream(np.array([least + 3, largest], np.int64))
    comparison = compared(events, reference)
    assert comparison.time_error_us.tolist() == [3, 5]
    assert counts(compared(stream(np.int64(largest)), stream(np.int64(least)))) == (0, 1, 1)


def test_other_layouts_padding_and_strides() -> None:
    """Only the four fields count: padding bytes, another layout or a stride change nothing."""
    reference = sparse_stream()[::7]
    dirty = reference.copy()
    dirty.view(np.uint8).reshape(-1, 16)[:, 13:] = 0xA5
    other = np.zeros(len(reference), [("p", "?"), ("y", "<i4"), ("x", "<i4"), ("t", "<u8")])
    for name in "txyp":
        other[name] = reference[name]
    for events in (dirty, other, np.repeat(reference, 2)[::2]):
        assert counts(compared(events, reference)) == (len(reference), 0, 0)


def test_every_polarity_but_0_is_on() -> None:
    """As for reconstruct(); the field has room for more than two values."""
    assert counts(compared(stream([1, 2, 3], p=[2, 255, 0]), stream([1, 2, 3], p=[1, 1, 1]))) == (2, 1, 1)


def test_events_out_of_order_are_refused() -> None:
    """An unsorted stream would be matched wrongly without a word; the message has the stream and the index."""
    good, bad = stream([1, 2, 3]), stream([1, 2, 3])
    bad["t"] = [1, 7, 6]
    with pytest.raises(ValueError, match="events must be sorted by time: event 2 at 6 us follows one at 7 us"):
        compared(bad, good)
    with pytest.raises(ValueError, match="reference must be sorted by time: event 2"):
        compared(good, bad)


@pytest.mark.parametrize(("x", "y"), [(WIDTH, 0), (0, HEIGHT), (65535, 65535)])
def test_events_outside_of_the_sensor_are_refused(x: int, y: int) -> None:
    """They belong to another sensor; the last pixel is inside."""
    corner, outside = stream([1, 2], WIDTH - 1, HEIGHT - 1), stream([1, 2], [0, x], [0, y])
    assert counts(compared(corner, corner)) == (2, 0, 0)
    with pytest.raises(ValueError, match=rf"reference: event 1 at \(x, y\) = \({x}, {y}\) .* the 40 x 30 sensor"):
        compared(corner, outside)


@pytest.mark.parametrize("window_us", [-1, 2**31, 0.5, float("nan")])
def test_a_window_out_of_range_is_refused(window_us: float) -> None:
    """Rule and value in the message."""
    with pytest.raises(ValueError, match=rf"window_us must be an integer in 0\.\.2147483647, got {window_us}"):
        compared(stream([]), stream([]), window_us)  # type: ignore[arg-type]
