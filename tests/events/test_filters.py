"""Filters of event streams, and davis-rs filter."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import EVENT_DTYPE, filters, open_writer, read_events
from davis_rs.cli.main import main
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.events.filters import BackgroundActivity, DropPixels, EventFilters, Flicker, Refractory, filter_events
from event_files import events_of

SIZE = (60, 40)


def edge_and_noise() -> tuple[EventArray, EventArray]:
    """A vertical edge that crosses the sensor at a column a millisecond, and noise of 0.2 Hz a pixel for as long."""
    edge = np.zeros(60 * 40, EVENT_DTYPE)
    edge["t"] = np.repeat(1000 * np.arange(60), 40) + np.tile(np.arange(40) * 10, 60)
    edge["x"], edge["y"], edge["p"] = np.repeat(np.arange(60), 40), np.tile(np.arange(40), 60), 1
    random, count = np.random.default_rng(0), 30
    noise = np.zeros(count, EVENT_DTYPE)
    noise["t"] = np.sort(random.integers(0, 60_000, count))
    noise["x"], noise["y"] = random.integers(0, 60, count), random.integers(0, 40, count)
    return edge, noise


def merged(*streams: EventArray) -> EventArray:
    joined = concatenate_events(list(streams))
    return joined[np.argsort(joined["t"], kind="stable")]


def flickering(pixels: list[tuple[int, int]], hz: float, seconds: float) -> EventArray:
    """ON at each period's start, OFF in its middle."""
    t_us = np.arange(0, seconds, 0.5 / hz) * 1e6
    events = np.zeros((len(pixels), len(t_us)), EVENT_DTYPE)
    events["t"], events["p"] = t_us.astype(np.int64), np.arange(len(t_us)) % 2 == 0
    for row, (x, y) in zip(events, pixels, strict=True):
        row["x"], row["y"] = x, y
    return merged(*events)


def test_noise_goes_and_an_edge_stays() -> None:
    edge, noise = edge_and_noise()
    passed = filter_events(merged(edge, noise), BackgroundActivity(2000), SIZE)
    assert passed.dtype == EVENT_DTYPE
    assert (passed["p"] == 1).sum() >= len(edge) - 1  # only its very first event was alone
    assert (passed["p"] == 0).sum() < 0.35 * len(noise)  # what falls near the edge
    strict = filter_events(merged(edge, noise), BackgroundActivity(2000, neighbours=3), SIZE)
    assert len(strict) < len(passed)
    assert (strict["p"] == 1).sum() > 0.95 * len(edge)


def test_lamps_go_and_other_frequencies_stay() -> None:
    lamp, wheel = flickering([(3, 4), (3, 5)], 100, 0.4), flickering([(30, 30)], 25, 0.4)
    passed = filter_events(merged(lamp, wheel), Flicker(90, 130, tolerance_us=100, periods=4), SIZE)
    assert (passed["x"] == 30).sum() == len(wheel)
    # The first ON comes at 10 ms (nothing was OFF before), the fourth even period ends 40 ms later.
    left = passed[passed["x"] == 3]
    assert left["t"].max() == 45_000
    assert len(left) == 2 * 10


def test_pixels_rest_and_pixels_are_dropped() -> None:
    events = events_of((0, 1, 1, 1), (5, 1, 1, 0), (6, 2, 1, 1), (10, 1, 1, 1))
    assert filter_events(events, Refractory(10), SIZE)["t"].tolist() == [0, 6, 10]
    assert filter_events(events, DropPixels([1], [1]), SIZE)["t"].tolist() == [6]
    both = filter_events(events, [DropPixels([2], [1]), Refractory(6)], SIZE)
    assert both["t"].tolist() == [0, 10]
    assert len(events) == 4


def test_filters_follow_each_other_and_any_cut_gives_the_same() -> None:
    edge, noise = edge_and_noise()
    stream = merged(edge, noise, flickering([(5, 5)], 100, 0.06))
    chosen = [DropPixels([5], [5]), Refractory(300), BackgroundActivity(1500, 2)]
    whole = filter_events(stream, chosen, SIZE)
    running = EventFilters(chosen, SIZE)
    parts = concatenate_events([running.take(stream[i : i + 100]) for i in range(0, len(stream), 100)])
    assert np.array_equal(parts, whole)
    assert (running.taken, running.passed) == (len(stream), len(whole))
    one_by_one = stream
    for each in chosen:
        one_by_one = filter_events(one_by_one, each, SIZE)
    assert np.array_equal(one_by_one, whole)


BAD: dict[str, tuple[Any, str]] = {
    "window": (lambda: BackgroundActivity(-1), "window_us must be an integer in 0.."),
    "neighbours": (lambda: BackgroundActivity(1, 9), r"neighbours must be an integer in 1\.\.8"),
    "frequencies": (lambda: Flicker(100, 50), "highest_hz must not be below lowest_hz, got 50 and 100"),
    "no frequency": (lambda: Flicker(0, 50), "lowest_hz must lie in"),
    "pixels": (lambda: filter_events(np.zeros(0, EVENT_DTYPE), DropPixels([60], [0]), SIZE), "60 x 40 pixels"),
    "lengths": (lambda: filter_events(np.zeros(0, EVENT_DTYPE), DropPixels([6], [0, 1]), SIZE), "of one length"),
    "no filter": (lambda: EventFilters(["refractory"], SIZE), "must be of davis_rs.filters, got 'refractory'"),  # type: ignore[list-item]
    "outside": (lambda: filter_events(events_of((1, 60, 0, 1)), Refractory(1), SIZE), r"event 0 is at \(60, 0\)"),
    "outside of a map": (lambda: filter_events(events_of((1, 60, 0, 1)), DropPixels([1], [1]), SIZE), "60 x 40 px"),
    "back": (
        lambda: filter_events(events_of((2, 0, 0, 1), (1, 0, 0, 1)), Refractory(1), SIZE),
        "event 1 is at 1 us, after 2",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_senseless_filters_are_refused(name: str) -> None:
    act, said = BAD[name]
    with pytest.raises(ValueError, match=said):
        act()


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same as in Python, with the hot pixel found in a pass of its own."""
    edge, noise = edge_and_noise()
    hot = flickering([(20, 20)], 400, 0.06)
    stream = merged(edge, noise, hot)
    with open_writer(tmp_path / "e.raw", SIZE) as writer:
        writer.write(stream)
    words = ["filter", tmp_path / "e.raw", tmp_path / "f.raw", "--hot-pixels", "--background-activity", "2000"]
    assert main([*map(str, words), "--neighbours", "2", "--refractory", "100"]) == 0
    printed = capsys.readouterr().out
    assert "1 hot pixels\n" in printed
    expected = filter_events(stream, [DropPixels([20], [20]), Refractory(100), BackgroundActivity(2000, 2)], SIZE)
    assert np.array_equal(read_events(tmp_path / "f.raw"), expected)
    assert f"{len(expected):,} of {len(stream):,} events pass" in printed
    assert main(["filter", str(tmp_path / "e.raw"), str(tmp_path / "g.raw")]) == 1
    assert "nothing to filter by: give --hot-pixels" in capsys.readouterr().err
    assert main([*map(str, words[:3]), "--neighbours", "2", "--overwrite"]) == 1
    assert "--neighbours is of --background-activity: give it too" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*map(str, words[:3]), "--flicker", "130:90"])
    assert "highest_hz must not be below lowest_hz" in capsys.readouterr().err
    assert main([*map(str, words[:2]), str(tmp_path / "h.npy"), "--flicker", "300:500", "--quiet"]) == 0
    assert (read_events(tmp_path / "h.npy")["x"] == 20).sum() < len(hot) / 2 + 50


def test_filters_are_a_public_module() -> None:
    assert filters.Refractory is Refractory
