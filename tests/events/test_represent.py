"""Event frames, count images, time surfaces and voxel grids, against plain Python; and other libraries' layouts."""

from __future__ import annotations

import math
from random import Random
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from davis_rs.events.arrays import EVENT_DTYPE, EventArray
from davis_rs.events.dtypes import LAYOUTS, from_structured, to_structured, to_tonic
from davis_rs.events.represent import (
    count_image,
    event_frame,
    event_spike_tensor,
    last_event_times,
    time_surface,
    voxel_grid,
)
from strategies import EPOCH_US, EXAMPLES

WIDTH, HEIGHT = SIZE = (5, 4)


@st.composite
def streams(draw: st.DrawFn) -> EventArray:
    """Events of a small sensor in order of time, with ties, from 0 and in Unix time."""
    start = draw(st.sampled_from([0, EPOCH_US]))
    event = st.tuples(
        st.sampled_from([0, 1, 7, 1000]), st.integers(0, WIDTH - 1), st.integers(0, HEIGHT - 1), st.integers(0, 1)
    )
    events = np.array(draw(st.lists(event, max_size=40)), EVENT_DTYPE)
    events["t"] = start + np.cumsum(events["t"])
    events.flags.writeable = False
    return events


@EXAMPLES
@given(streams())
def test_counts_and_frames_are_those_of_a_loop(events: EventArray) -> None:
    """OFF before ON; the event frame is ON minus OFF."""
    expected = np.zeros((2, HEIGHT, WIDTH), int)
    for _, x, y, p in events.tolist():
        expected[p, y, x] += 1
    counts, frame = count_image(events, SIZE), event_frame(events, SIZE)
    assert counts.dtype == np.uint32
    assert frame.dtype == np.int32
    np.testing.assert_array_equal(counts, expected)
    np.testing.assert_array_equal(frame, expected[1] - expected[0])


@EXAMPLES
@given(streams(), st.sampled_from([1.0, 30.0, 1e6]), st.sampled_from([None, 0, 3, 2000]))
def test_time_surfaces_are_those_of_a_loop(events: EventArray, tau_us: float, after: int | None) -> None:
    """exp(-(t - t_last) / tau), with events after t left out, to the last digit also in Unix time."""
    if after is None or not len(events):
        t_us, given_us = (int(events["t"][-1]) if len(events) else 0), None
    else:
        t_us = given_us = int(events["t"][0]) + after
    expected = np.zeros((2, HEIGHT, WIDTH))
    for t, x, y, p in events.tolist():
        if t <= t_us:
            expected[p, y, x] = math.exp((t - t_us) / tau_us)
    surface = time_surface(events, SIZE, tau_us, t_us=given_us, dtype=np.float64)
    np.testing.assert_allclose(surface, expected, rtol=1e-15)
    assert time_surface(events, SIZE, tau_us, t_us=given_us).dtype == np.float32


def grid_of_a_loop(
    events: EventArray, bins: int, start_us: int, stop_us: int, endpoint: bool, given: bool
) -> npt.NDArray[np.float64]:
    """The definition: each event times the triangle around each plane; the stop of a given window is not in it."""
    grid = np.zeros((bins, HEIGHT, WIDTH))
    steps = bins - 1 if endpoint else bins
    for t, x, y, p in events.tolist():
        if start_us <= t < stop_us + (not given):
            position = steps * (t - start_us) / max(1, stop_us - start_us)
            for plane in range(bins):
                grid[plane, y, x] += (2 * p - 1) * max(0.0, 1 - abs(position - plane))
    return grid


@EXAMPLES
@given(streams(), st.integers(1, 6), st.booleans(), st.booleans())
def test_voxel_grids_are_the_definitions(events: EventArray, bins: int, endpoint: bool, window: bool) -> None:
    """Zhu et al.'s kernel, for the events' own window and a given one, with both conventions of the last plane."""
    first, last = (int(events["t"][0]), int(events["t"][-1])) if len(events) else (0, 0)
    if window:
        start, stop = first + 3, first + 1003
        grid = voxel_grid(events, SIZE, bins, start_us=start, stop_us=stop, endpoint=endpoint, dtype=np.float64)
    else:
        start, stop = first, last
        grid = voxel_grid(events, SIZE, bins, endpoint=endpoint, dtype=np.float64)
    np.testing.assert_allclose(grid, grid_of_a_loop(events, bins, start, stop, endpoint, window), atol=1e-12)


def test_all_polarity_is_in_the_grid() -> None:
    """With the last plane at the window's end no event fades: the grid's sum is that of the polarities."""
    rng = np.random.default_rng(3)
    events = np.zeros(10_000, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, 1_000_000, len(events)))
    events["x"], events["y"] = rng.integers(0, WIDTH, len(events)), rng.integers(0, HEIGHT, len(events))
    events["p"] = rng.random(len(events)) < 0.7
    grid = voxel_grid(events, SIZE, 5)
    assert grid.dtype == np.float32
    assert grid.sum(dtype=np.float64) == pytest.approx(event_frame(events, SIZE).sum(), rel=1e-6)


@settings(EXAMPLES, max_examples=60)
@given(streams(), st.integers(1, 4), st.sampled_from(["time", "count"]), st.booleans())
def test_spike_tensors_are_the_definitions(
    events: EventArray, bins: int, measurement: Literal["time", "count"], window: bool
) -> None:
    """Gehrig et al.'s trilinear kernel, each polarity by itself; packets add up to the whole."""
    first, last = (int(events["t"][0]), int(events["t"][-1])) if len(events) else (0, 0)
    start, stop = (first + 3, first + 1003) if window else (first, last)

    def tensor_of_a_loop(until: int) -> npt.NDArray[np.float64]:
        expected = np.zeros((2 * bins, HEIGHT, WIDTH))
        for t, x, y, p in events.tolist():
            if start <= t < until:
                position = (t - start) / max(1, stop - start)
                for plane in range(bins):
                    fraction = max(0.0, 1 - abs(position * (bins - 1) - plane))
                    expected[p * bins + plane, y, x] += fraction * (position if measurement == "time" else 1)
        return expected

    def tensor(part: EventArray) -> npt.NDArray[np.float64]:
        return event_spike_tensor(
            part, SIZE, bins, start_us=start, stop_us=stop, measurement=measurement, dtype=np.float64
        )

    np.testing.assert_allclose(tensor(events), tensor_of_a_loop(stop), atol=1e-12)
    np.testing.assert_allclose(tensor(events[:7]) + tensor(events[7:]), tensor_of_a_loop(stop), atol=1e-12)
    if not window:
        own = event_spike_tensor(events, SIZE, bins, measurement=measurement)
        assert own.dtype == np.float32
        np.testing.assert_allclose(own, tensor_of_a_loop(stop + 1), atol=1e-5)


@settings(EXAMPLES, max_examples=60)
@given(streams(), st.integers(1, 3), st.booleans())
def test_last_times_are_those_of_a_loop(events: EventArray, count: int, window: bool) -> None:
    """The last few of each pixel and polarity within the window, the latest first."""
    first, last = (int(events["t"][0]), int(events["t"][-1])) if len(events) else (0, 0)
    start, stop = (first + 3, first + 1003) if window else (first, last)
    expected = np.zeros((2, count, HEIGHT, WIDTH))
    for p, y, x in np.ndindex(2, HEIGHT, WIDTH):
        times = [t for t, *rest in events.tolist() if rest == [x, y, p] and start <= t < stop + (not window)]
        for rank, t in enumerate(sorted(times, reverse=True)[:count]):
            expected[p, rank, y, x] = (t - start) / max(1, stop - start)
    limits: dict[str, Any] = {"start_us": start, "stop_us": stop} if window else {}
    found = last_event_times(events, SIZE, count, **limits)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected.reshape(2 * count, HEIGHT, WIDTH), atol=1e-6)


def test_a_given_window_is_half_open_and_none_has_all_events() -> None:
    """An event at ``stop_us`` counts only where no stop is given: neighbouring windows share no event."""
    events = np.array([(0, 0, 0, 1), (4, 1, 0, 1), (8, 2, 0, 1)], EVENT_DTYPE)
    makers: dict[str, Any] = {
        "voxel_grid": lambda **window: voxel_grid(events, SIZE, 1, **window),
        "est": lambda **window: event_spike_tensor(events, SIZE, 1, measurement="count", **window)[1:],
        "last_times": lambda **window: last_event_times(events, SIZE, **window)[1:] > 0,
    }
    for name, make in makers.items():
        first = 0 if name == "last_times" else 1  # an event at the start is at position 0
        for window, counted in (
            ({}, [first, 1, 1]),
            ({"start_us": 0}, [first, 1, 1]),
            ({"start_us": 0, "stop_us": 8}, [first, 1, 0]),
            ({"start_us": 4, "stop_us": 9}, [0, first, 1]),
            ({"stop_us": 4}, [first, 0, 0]),
            ({"stop_us": 0}, [0, 0, 0]),
            ({"start_us": 8, "stop_us": 8}, [0, 0, 0]),
            ({"start_us": 8}, [0, 0, first]),
        ):
            assert make(**window)[0, 0, :3].tolist() == counted, (name, window)


def test_strangers_and_impossible_arguments_are_refused() -> None:
    """With the rule, the value and the event's index."""
    outside = np.array([(0, 0, 0, 1), (1, 5, 0, 1)], EVENT_DTYPE)
    for represent in (
        event_frame,
        count_image,
        lambda e, s: time_surface(e, s, 1.0),
        lambda e, s: voxel_grid(e, s, 3),
        lambda e, s: event_spike_tensor(e, s, 3),
        last_event_times,
    ):
        with pytest.raises(ValueError, match=r"5 x 4 sensor: event 1 is at \(5, 0\)"):
            represent(outside, SIZE)
    inside = outside[:1]
    with pytest.raises(ValueError, match="bins must be an integer >= 1, got 0"):
        voxel_grid(inside, SIZE, 0)
    with pytest.raises(ValueError, match="bins must be an integer >= 1, got 0"):
        event_spike_tensor(inside, SIZE, 0)
    with pytest.raises(ValueError, match="must be time or count, got 'polarity'"):
        event_spike_tensor(inside, SIZE, 1, measurement="polarity")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="count must be an integer >= 1, got 0"):
        last_event_times(inside, SIZE, 0)
    with pytest.raises(ValueError, match=r"must not end before it starts: got 5\.\.4"):
        last_event_times(inside, SIZE, start_us=5, stop_us=4)
    with pytest.raises(ValueError, match=r"window that does not end before it starts: got 2 bins in 5\.\.4"):
        voxel_grid(inside, SIZE, 2, start_us=5, stop_us=4)
    with pytest.raises(ValueError, match="> 0 us, got 0"):
        time_surface(inside, SIZE, 0.0)
    for size in ((0, 4), (5, 65_536)):
        with pytest.raises(ValueError, match=r"size must lie in 1\.\.65535 pixels each way"):
            count_image(inside, size)


# ---- other libraries' layouts ----


@pytest.mark.parametrize("name", sorted(LAYOUTS))
@EXAMPLES
@given(events=streams())
def test_layouts_there_and_back(name: str, events: EventArray) -> None:
    """The same events, in a copy."""
    there = to_structured(events, name)
    assert there.dtype == LAYOUTS[name]
    assert from_structured(there).tolist() == events.tolist()


def test_tonics_layout_is_tonics() -> None:
    """x, y int16, t int64, p bool, in this order."""
    events = to_tonic(np.array([(7, 1, 2, 1)], EVENT_DTYPE))
    assert events.dtype.descr == [("x", "<i2"), ("y", "<i2"), ("t", "<i8"), ("p", "|b1")]
    assert events.tolist() == [(1, 2, 7, True)]


def test_what_a_layout_cannot_hold_is_refused() -> None:
    """With field, index and value; a layout without a time is none."""
    wide = np.array([(0, 1, 1, 1), (0, 32_768, 1, 1)], EVENT_DTYPE)
    with pytest.raises(ValueError, match="x of event 1 is 32768, which int16"):
        to_tonic(wide)
    with pytest.raises(ValueError, match="needs one field that is one of t, ts, timestamp, time"):
        to_structured(wide, np.dtype([("x", "i4"), ("y", "i4"), ("p", "i1")]))
    signed = np.array([(0, 1, 1, -1)], np.dtype([("t", "i8"), ("x", "i2"), ("y", "i2"), ("p", "i1")]))
    with pytest.raises(ValueError, match="p of event 0 is -1"):
        from_structured(signed)
    signed["p"] = 2
    with pytest.raises(ValueError, match="polarity must be 0 or 1: event 0 has 2"):
        from_structured(signed)


# ---- order ----


@EXAMPLES
@given(streams(), st.randoms())
def test_the_order_of_events_does_not_matter(events: EventArray, random: Random) -> None:
    """The window without limits is that of the earliest and the latest event."""
    order = list(range(len(events)))
    random.shuffle(order)
    mixed = events[order]
    np.testing.assert_allclose(voxel_grid(mixed, SIZE, 4), voxel_grid(events, SIZE, 4), atol=1e-5)
    np.testing.assert_allclose(event_spike_tensor(mixed, SIZE, 4), event_spike_tensor(events, SIZE, 4), atol=1e-5)
    np.testing.assert_array_equal(time_surface(mixed, SIZE, 30.0), time_surface(events, SIZE, 30.0))
    np.testing.assert_array_equal(last_event_times(mixed, SIZE), last_event_times(events, SIZE))
