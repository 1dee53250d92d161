"""Statistics of streams: against plain loops, on streams whose parameters are known, and from whatever can be read."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from itertools import accumulate, groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import davis_rs
from command_line import davis_rs as command
from davis_rs import compare_streams, measure_stream, open_writer
from davis_rs.cli.main import main
from davis_rs.events.arrays import EVENT_DTYPE, EventArray
from davis_rs.inspection.statistics import StreamMeter, StreamStatistics, bursts
from davis_rs.inspection.statistics.counts import Histogram, bin_edges
from davis_rs.inspection.statistics.stream_statistics import Measured
from davis_rs.usb.raw_file import RawWriter
from recording_files import DESCRIPTION, aedat2, aedat2_event


def events_of(t: npt.ArrayLike, x: npt.ArrayLike, y: npt.ArrayLike, p: npt.ArrayLike) -> EventArray:
    """Events from columns, sorted by time."""
    events = np.zeros(np.size(t), EVENT_DTYPE)
    for name, column in (("t", t), ("x", x), ("y", y), ("p", p)):
        events[name] = column
    return events[np.argsort(events["t"], kind="stable")]


def poisson(
    rng: np.random.Generator, rates_hz: npt.NDArray[np.float64], on_share: float, duration_s: float
) -> EventArray:
    """Pixels that fire at random, at these rates (H, W)."""
    counts = rng.poisson(rates_hz * duration_s)
    y, x = (np.repeat(axis.ravel(), counts.ravel()) for axis in np.indices(counts.shape))
    total = int(counts.sum())
    return events_of(rng.integers(0, round(duration_s * 1e6), total), x, y, rng.random(total) < on_share)


def metered(events: EventArray, size: tuple[int, int], cuts: list[int]) -> StreamStatistics:
    """Measured in pieces that end at these places."""
    meter = StreamMeter(*size)
    for piece in np.split(events, sorted(cuts)):
        meter.add(piece)
    return meter.finish("one", "array")


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (137.0, 10.0, "137 +- 10"),
        (1374.0, 96.0, "1370 +- 100"),
        (0.02514, 0.0031, "0.0251 +- 0.003"),
        (4e7, 2e6, "4e+07 +- 2e+06"),
        (12.0, math.inf, "12"),
        (math.nan, 1.0, "-"),
    ],
)
def test_a_number_with_its_error_is_easy_to_read(value: float, sigma: float, text: str) -> None:
    """Three digits of the value and one of its error, without exponents where few zeros do."""
    assert str(Measured(value, sigma)) == text


STREAMS = st.lists(
    st.tuples(st.integers(0, 40), st.integers(0, 3), st.integers(0, 2), st.integers(0, 1)), min_size=1, max_size=60
)
CUTS = st.lists(st.integers(0, 60), max_size=4)


@pytest.mark.long
@settings(max_examples=60)
@given(rows=STREAMS, cuts=CUTS, scale=st.sampled_from([1, 7, 100_000]))
def test_sums_are_those_of_plain_loops(rows: list[tuple[int, int, int, int]], cuts: list[int], scale: int) -> None:
    """Whatever the stream is cut into: intervals, bursts, orders of columns and shared stamps."""
    rows = sorted(((t * scale, x, y, p) for t, x, y, p in rows), key=lambda row: row[0])
    found = metered(np.array(rows, EVENT_DTYPE), (4, 3), [cut for cut in cuts if cut <= len(rows)])
    same, either = [], []
    last: dict[Any, int] = {}
    for t, x, y, p in rows:
        same += [t - last[x, y, p]] if (x, y, p) in last else []
        either += [t - last[x, y]] if (x, y) in last else []
        last[x, y, p] = last[x, y] = t
    assert histogram_of(same) == list(found.same.counts)
    assert histogram_of(either) == list(found.any.counts)
    runs = [(stamp, [row[1] for row in run]) for (stamp, _), run in groupby(rows, key=lambda row: (row[0], row[2]))]
    stamps = [stamp for stamp, _ in runs]
    firsts = [0, *accumulate(len(run) for _, run in runs)][:-1]
    assert histogram_of([len(run) for _, run in runs]) == list(found.bursts.events_per_row.counts)
    assert histogram_of(list(Counter(stamps).values())) == list(found.bursts.rows_per_us.counts)
    windows = [sum(begin <= other < begin + 10 for other in stamps[place:]) for place, begin in enumerate(stamps)]
    assert histogram_of(windows) == list(found.bursts.rows_per_window.counts)
    windows = [sum(t <= row[0] < t + 10 for row in rows[first:]) for t, first in zip(stamps, firsts, strict=True)]
    assert histogram_of(windows) == list(found.bursts.events_per_window.counts)
    in_row = [(t, row) for (t, row), _ in groupby(rows, key=lambda row: (row[0], row[2]))]
    steps = [after[1] - before[1] for before, after in pairwise(in_row) if after[0] == before[0]]
    assert found.bursts.rows_up == sum(step > 0 for step in steps)
    assert found.bursts.rows_down == sum(step < 0 for step in steps)
    several = [columns for _, columns in runs if len(columns) > 1]
    up = sum(all(a < b for a, b in pairwise(columns)) for columns in several)
    down = sum(all(a > b for a, b in pairwise(columns)) for columns in several)
    assert (found.bursts.ascending, found.bursts.descending) == (up, down)
    assert found.bursts.unordered == len(several) - up - down
    times = Counter(t for t, *_ in rows)
    assert found.bursts.sharing == sum(count for count in times.values() if count > 1)
    counts = Counter((p, y, x) for _, x, y, p in rows)
    assert {place: int(n) for place, n in np.ndenumerate(found.counts) if n} == dict(counts)
    assert found.describe() == metered(np.array(rows, EVENT_DTYPE), (4, 3), []).describe()


def test_bursts_of_a_davis346_run_along_columns() -> None:
    """Its bus has 346 rows: bursts are those of a stream with x and y exchanged, as another camera has them."""
    events = small_stream()
    events["t"] //= 1000
    events["y"] //= 20
    turned = events.copy()
    turned["x"], turned["y"] = events["y"], events["x"]
    one, other = measure_stream(events, size=(260, 346)), measure_stream(turned, size=(346, 260))
    shared = ("rows_per_us", "rows_per_10_us", "events_per_10_us", "events_per_row", "column_order", "rows_up_share")
    assert (one.bursts.events_per_row.most or 0) > 3
    for name in shared:
        assert one.describe()[name] == other.describe()[name]
    assert (one.describe()["rows_of_bus"], other.describe()["rows_of_bus"]) == ("rows", "columns")


def histogram_of(values: list[int]) -> list[int]:
    histogram = Histogram()
    for value in values:
        histogram.add(np.array([value], np.int64))
    return list(histogram.counts)


@given(values=st.lists(st.integers(0, 2**63 - 1), min_size=1, max_size=50))
def test_every_integer_has_its_bin(values: list[int]) -> None:
    """Up to the largest there is; small ones a bin each, large ones bins of 1.6 %."""
    histogram, edges = Histogram(), bin_edges()
    histogram.add(np.array(values, np.int64))
    for place in np.flatnonzero(histogram.counts):
        assert sum(edges[place] <= value < edges[place + 1] or value == edges[-1] for value in values)
    expected = np.zeros(len(edges) - 1, np.int64)
    for value in values:
        expected[min(int(np.searchsorted(edges, value, side="right")) - 1, len(expected) - 1)] += 1
    np.testing.assert_array_equal(histogram.counts, expected)
    assert (histogram.least, histogram.most, histogram.total) == (min(values), max(values), len(values))
    for share in (0.1, 10, 50, 99, 100):
        exact = sorted(values)[max(math.ceil(share / 100 * len(values)) - 1, 0)]
        assert histogram.percentile(share) == pytest.approx(exact, rel=0.008, abs=0)
    wide = edges[1:-1] / edges[:-2].clip(1)
    assert wide[130:].max() < 1.0157


def test_a_stamp_of_millions_of_events_is_not_held() -> None:
    """A stream may have but one stamp: memory must not grow with it."""
    meter, piece = StreamMeter(64, 1), np.zeros(1 << 19, EVENT_DTYPE)
    piece["x"] = np.arange(len(piece)) % 64
    for _ in range(8):
        meter.add(piece)
        assert sum(map(len, meter._bursts._held)) <= bursts._MOST_HELD
        assert len(meter._bursts._rows) <= bursts._MOST_HELD
    found = meter.finish()
    assert found.events == found.bursts.sharing == 8 << 19


@pytest.fixture(scope="module")
def noisy() -> tuple[EventArray, list[tuple[int, int, float, float]]]:
    """20 s of 160 x 120 pixels: leak, an edge that passes again and again, odd columns weaker, hot pixels."""
    rng = np.random.default_rng(20)
    hot = [(10, 10, 25.0, 0.05), (80, 70, 30.0, 0.3), (150, 20, 3.0, 1.0), (40, 40, 60.0, 0.1)]
    parts = [poisson(rng, np.full((120, 160), 0.02), 0.8, 20.0)]
    for k in range(40):  # an edge from left to right in the lower half, in each half second
        y, x = np.indices((50, 160))
        fires = rng.random(x.shape) < np.where(x % 2, 0.7, 0.8)
        t = 500_000 * k + 1000 * x + rng.integers(0, 500, x.shape)
        parts.append(events_of(t[fires], x[fires], y[fires] + 60, np.full(fires.sum(), k % 2)))
    for x0, y0, rate_hz, scatter in hot:
        count = int(20 * rate_hz)
        waits = rng.exponential(1 / rate_hz, count) if scatter == 1 else rng.normal(1, scatter, count) / rate_hz
        t = np.cumsum(np.abs(waits))
        t = (t[t < 20] * 1e6).astype(np.int64)
        parts.append(events_of(t, np.full(len(t), x0), np.full(len(t), y0), np.ones(len(t))))
    for begin_us in (3_000_000, 15_000_000):  # something passes by
        parts.append(events_of(begin_us + 3000 * np.arange(20), np.full(20, 100), np.full(20, 20), np.ones(20)))
    events = np.concatenate(parts)
    return events[np.argsort(events["t"], kind="stable")], hot


def test_hot_pixels_are_found_with_their_regularity(noisy: tuple[EventArray, Any]) -> None:
    """All of them, clocks and Poisson processes, and nothing of the edge or of what passes by."""
    events, hot = noisy
    found = measure_stream(events, size=(160, 120)).hot_pixels
    places = dict(zip(zip(found.x.tolist(), found.y.tolist(), strict=True), range(len(found)), strict=True))
    assert set(places) == {(x, y) for x, y, _, _ in hot}
    for x, y, rate_hz, scatter in hot:
        at = places[x, y]
        assert found.rate_hz[at] == pytest.approx(rate_hz, rel=0.25)
        others = scatter if (x, y) != (80, 70) else None  # the edge passes there too
        if others is not None and rate_hz > 5:
            assert found.variation[at] == pytest.approx(scatter, rel=0.25)
    assert found.variation[places[150, 20]] == pytest.approx(1, abs=0.35)
    assert found.on_share[places[40, 40]] > 0.95


def test_quiet_pixels_are_measured_without_the_bias_of_choosing_them(noisy: tuple[EventArray, Any]) -> None:
    """The choice is made by other pixels, so that what happened to be quiet counts for nothing."""
    events, _ = noisy
    found = measure_stream(events, size=(160, 120))
    assert found.quiet[:60].any()
    assert not found.quiet[64:104].any()
    assert abs(found.quiet_rate_hz.value - 0.02) < 4 * found.quiet_rate_hz.sigma
    assert abs(found.quiet_on_share.value - 0.8) < 4 * found.quiet_on_share.sigma
    assert found.quiet_rate_hz.sigma < 0.002
    band = measure_stream(events, size=(160, 120), quiet=(0, 0, 160, 50))
    assert band.quiet[:50].sum() == 160 * 50 - 3  # without the hot ones
    assert not band.quiet[50:].any()
    assert abs(band.quiet_rate_hz.value - 0.02) < 4 * band.quiet_rate_hz.sigma
    assert band.quiet_rate_hz.sigma == pytest.approx(math.sqrt(0.02 / (20 * 8000)), rel=0.1)


def test_a_hot_pixel_is_not_quiet() -> None:
    """Also where its neighbours are."""
    hot = events_of(np.arange(0, 2_000_000, 20_000), np.full(100, 30), np.full(100, 20), np.ones(100))
    found = measure_stream(hot, size=(64, 48))
    assert len(found.hot_pixels) == 1
    assert not found.quiet[20, 30]
    assert found.quiet.sum() == 64 * 48 - 1
    assert found.quiet_rate_hz.value == 0


def test_the_quiet_rate_is_right_over_many_streams() -> None:
    """Its errors are as large as it says, and have no common sign: 40 streams of noise alone."""
    rng = np.random.default_rng(3)
    pulls = []
    for _ in range(40):
        found = measure_stream(poisson(rng, np.full((48, 64), 0.5), 0.6, 4.0), size=(64, 48))
        pulls.append((found.quiet_rate_hz.value - 0.5) / found.quiet_rate_hz.sigma)
    assert abs(np.mean(pulls)) < 3.5 / math.sqrt(40)
    assert 0.5 < np.var(pulls) < 1.8


def test_the_parity_of_columns_has_its_uncertainty(noisy: tuple[EventArray, Any]) -> None:
    """Where odd columns are weaker, and none where they are not: in rows."""
    events, _ = noisy
    found = measure_stream(events, size=(160, 120))
    for ratio in found.column_parity:
        assert abs(ratio.value - 0.8 / 0.7) < 4 * ratio.sigma
        assert ratio.sigma < 0.02
    for ratio in found.row_parity:
        assert abs(ratio.value - 1) < 4 * ratio.sigma


def test_what_is_out_of_order_or_outside_is_counted_and_left_out(tmp_path: Path) -> None:
    """Nothing is dropped without a word."""
    events = np.array([(5, 0, 0, 1), (3, 0, 0, 1), (9, 4, 0, 1), (9, 1, 1, 0), (8, 1, 1, 0)], EVENT_DTYPE)
    for cuts in ([], [1], [2, 4]):
        found = metered(events, (4, 3), cuts)
        assert (found.events, found.backward, found.outside) == (2, 2, 1)
    np.save(tmp_path / "events.npy", events)
    assert "2 / 1" in str(compare_streams(tmp_path / "events.npy", tmp_path / "events.npy", size=(4, 3)))


def test_a_part_of_a_stream_is_measured() -> None:
    """From an instant after the first event up to another one, which belongs to what follows."""
    events = events_of(1000 + 500_000 * np.arange(9), np.arange(9) % 4, np.zeros(9), np.ones(9))
    parts = [measure_stream(events, size=(4, 3), start_s=a, stop_s=b) for a, b in ((0, 1), (1, 2.5), (2.5, None))]
    assert [part.events for part in parts] == [2, 3, 4]
    assert [part.first_us for part in parts] == [1000, 1_001_000, 2_501_000]
    assert measure_stream(events, size=(4, 3), start_s=50).events == 0
    for start_s, stop_s in ((-1.0, None), (2.0, 2.0), (math.nan, None)):
        with pytest.raises(ValueError, match=r"a part must have 0 <= start_s < stop_s, got"):
            measure_stream(events, size=(4, 3), start_s=start_s, stop_s=stop_s)


def test_no_events_are_no_error() -> None:
    """Every number is absent, and the table says so."""
    nothing = np.zeros(0, EVENT_DTYPE)
    comparison = compare_streams(nothing, nothing, size=(16, 12))
    found = json.loads(json.dumps(comparison.real.describe(), allow_nan=False))
    assert (found["events"], found["on_share"], found["quiet"]["rate_hz"]["value"]) == (0, None, None)
    assert "nan" not in str(comparison)


@pytest.mark.parametrize("size", [(0, 5), (3000, 2000)])
def test_sizes_that_are_none_are_refused(size: tuple[int, int]) -> None:
    """Sums of each pixel need memory: the size is that of a file's header, which may say anything."""
    with pytest.raises(ValueError, match=rf"a sensor must have 1\.\.4194304 pixels to be measured, got {size[0]} x"):
        measure_stream(np.zeros(1, EVENT_DTYPE), size=size)


def test_what_is_missing_or_wrong_is_told() -> None:
    """The size of an array, and a region beyond the sensor."""
    with pytest.raises(ValueError, match="an array does not say the sensor's size"):
        measure_stream(np.zeros(1, EVENT_DTYPE))
    with pytest.raises(ValueError, match=re.escape("the quiet region (0, 0, 5, 3) must lie in the sensor's 4 x 3")):
        measure_stream(np.zeros(1, EVENT_DTYPE), size=(4, 3), quiet=(0, 0, 5, 3))


def small_stream() -> EventArray:
    """Events in the corner of a DAVIS240C."""
    rng = np.random.default_rng(0)
    events = np.zeros(3000, EVENT_DTYPE)
    for name, end in (("t", 200_000), ("x", 240), ("y", 180), ("p", 2)):
        events[name] = rng.integers(0, end, len(events))
    return np.sort(events, order=("t", "y", "x"))


@pytest.mark.parametrize("name", ["one.txt", "one.npy", "one.raw", "one.aedat4", "one.bag", "one.h5", "one.aedat"])
def test_any_file_gives_the_same_numbers(name: str, tmp_path: Path) -> None:
    """Of an event file, a bag, a recording."""
    events, path = small_stream(), tmp_path / name
    if name == "one.aedat":
        path.write_bytes(aedat2([(aedat2_event(int(x), int(y), int(p)), int(t)) for t, x, y, p in events]))
    else:
        with open_writer(path, (240, 180)) as writer:
            writer.write(events)
    expected = measure_stream(events, size=(240, 180)).describe()
    found = measure_stream(path, size=(240, 180)).describe()
    for one in (expected, found):
        assert one.pop("name") in ("events", name)
        one.pop("kind")
    assert found == expected


def test_a_cameras_bytes_and_a_folder_are_read(tmp_path: Path) -> None:
    """The bytes as the USB stream has them, and the events of a dataset folder."""
    events = small_stream()
    with RawWriter(tmp_path / "one.davis", DESCRIPTION) as writer:
        writer.write(davis_rs.Encoder("DAVIS240C").encode(events))
    found = measure_stream(tmp_path / "one.davis")
    assert (found.size, found.kind, found.backward) == ((240, 180), "camera bytes, DAVIS240C", 0)
    assert found.counts.sum() == len(events)
    (tmp_path / "folder").mkdir()
    with open_writer(tmp_path / "folder" / "events.txt", (240, 180)) as writer:
        writer.write(events)
    folder = measure_stream(tmp_path / "folder", size=(240, 180))
    np.testing.assert_array_equal(folder.counts, found.counts)
    with pytest.raises(ValueError, match=r"folder: neither meta.json nor frames say the sensor's size: give"):
        measure_stream(tmp_path / "folder")


@pytest.mark.long
def test_the_command_prints_writes_and_draws(tmp_path: Path, noisy: tuple[EventArray, Any]) -> None:
    """A table with both streams, all numbers as JSON, and a page of pictures."""
    for name, events in (("real.npy", noisy[0]), ("simulated.npy", noisy[0][noisy[0]["t"] < 5_000_000])):
        with open_writer(tmp_path / name, (160, 120)) as writer:
            writer.write(events)
    files = [tmp_path / "real.npy", tmp_path / "simulated.npy"]
    written = ["--figure", tmp_path / "page.png", "--json", tmp_path / "both.json"]
    done = command("compare", *files, "--size", "160x120", "--quiet", *written)
    assert (done.returncode, done.stderr) == (0, "")
    lines = {line[:48].strip(): line[48:].split("  ") for line in done.stdout.splitlines()}
    assert [cell.strip() for cell in lines["stream"] if cell] == ["real.npy", "simulated.npy"]
    assert "4 (0.021 %)" in done.stdout
    both = json.loads((tmp_path / "both.json").read_text())
    assert both["real"] == measure_stream(files[0], size=(160, 120)).describe()
    assert both["simulated"]["events"] < both["real"]["events"] / 3
    picture = (tmp_path / "page.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    half = command("compare", *files, "--size", "160x120", "--quiet", "--stop", "2.5", "--json", tmp_path / "half.json")
    assert half.returncode == 0
    assert json.loads((tmp_path / "half.json").read_text())["real"]["duration_s"] == pytest.approx(2.5, abs=0.01)
    refused = command("compare", *files, "--size", "160x120", "--quiet", "--quiet-region", "500x1+0+0")
    assert refused.returncode == 1
    assert "must lie in the sensor's 160 x 120 pixels" in refused.stderr


def test_maps_of_the_page_have_the_colours_and_marks_of_what_they_show() -> None:
    """Colours span the rates that there are, and at most three decades; a title names only marks that are drawn."""
    from matplotlib.figure import Figure

    from davis_rs.inspection.statistics import comparison_figure as page

    even = np.linspace(20.0, 80.0, 1000).reshape(20, 50)
    low, high = page._map_limits([even, np.zeros((20, 50))])
    assert 20 < low < 21
    assert 79 < high < 80
    assert page._map_limits([np.array([[1e-4, 1e3] * 1000])]) == (1.0, 1e3)
    assert page._map_limits([np.zeros((2, 2))])[0] > 0
    axes = Figure().subplots()
    page._draw_map(axes, measure_stream(small_stream(), size=(240, 180)), "real", (1.0, 2.0))
    assert axes.get_title().startswith("real: ")
    assert "hot" not in axes.get_title()
    axes.set_xscale("log")
    axes.set_xlim(5, 50)
    page._plain_ticks(axes.xaxis)
    named = {label.get_text() for label in axes.get_xticklabels()}
    assert {"5", "10", "20", "50"} <= named <= {"1", "2", "5", "10", "20", "50", "100"}
    assert not any(label.get_text() for label in axes.get_xticklabels(minor=True))


@pytest.mark.long
def test_a_page_of_nothing_is_drawn(tmp_path: Path) -> None:
    """Streams without events, and a sensor of one row, draw too."""
    from davis_rs.inspection.statistics.comparison_figure import draw_comparison

    nothing, few = np.zeros(0, EVENT_DTYPE), np.array([(5, 0, 0, 1), (7, 3, 0, 0)], EVENT_DTYPE)
    for size in ((16, 12), (5, 1)):
        draw_comparison(compare_streams(nothing, few, size=size), tmp_path / "page.png")
        assert (tmp_path / "page.png").stat().st_size > 10_000


def test_an_array_must_be_sorted() -> None:
    events = events_of([5, 9, 9, 12], [0, 1, 2, 3], [0, 0, 0, 0], [1, 0, 1, 0])[[0, 2, 3, 1]]
    with pytest.raises(ValueError, match="must be sorted by time: event 3 at 9 us follows one at 12 us"):
        measure_stream(events, size=(4, 1))


def test_the_simulated_stream_has_the_recording_s_size(tmp_path: Path) -> None:
    """Where it does not say one itself; a repr names what was measured, without its arrays."""
    events = events_of([5, 9, 12], [0, 1, 2], [0, 0, 0], [1, 0, 1])
    with open_writer(tmp_path / "real.raw", (4, 3)) as writer:
        writer.write(events)
    np.save(tmp_path / "simulated.npy", events)
    for simulated in (tmp_path / "simulated.npy", events):
        assert compare_streams(tmp_path / "real.raw", simulated).simulated.size == (4, 3)
    assert main(["compare", str(tmp_path / "real.raw"), str(tmp_path / "simulated.npy"), "--quiet"]) == 0
    assert repr(measure_stream(events, size=(4, 3))) == "<StreamStatistics of events, 4 x 3 px, 3 events, 7e-06 s>"
    with pytest.raises(ValueError, match="size"):
        compare_streams(events, tmp_path / "real.raw")
