"""The interactive page of a sequence: what it holds, that nothing gets into it or out of it, and that it draws."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import re
import shlex
import shutil
import subprocess
import zlib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from command_line import davis_rs
from davis_rs import EVENT_DTYPE, convert, load_scene, open_writer, simulate_to_folder, view_html
from davis_rs._util.srgb import to_srgb
from davis_rs._util.terminal_text import printable
from davis_rs.geometry.camera import Camera
from davis_rs.inspection import html_page, page_layers
from davis_rs.inspection.figure import OFF_RGB, ON_RGB
from davis_rs.inspection.page_layers import layers_of
from davis_rs.inspection.sampling_for_display import evenly_spaced, event_counts, sample_events, span_of_events
from davis_rs.inspection.truth_pictures import depth_picture, normals_picture, shape_colours
from davis_rs.inspection.visual_sequence import VisualSequence
from davis_rs.io.dataset.reader import Dataset
from davis_rs.io.dataset.writer import DatasetWriter
from recording_files import aedat4, aedat4_events, aedat4_frame, aedat4_imu, events_of, frame_of
from written_sequence import HEIGHT, STEPS, WIDTH, packet_of, write_sequence

VOID = {"meta", "input", "br", "link", "img"}


class Page(HTMLParser):
    """A page's elements; the end tags must be those of the elements that are open."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.text = path.read_text("utf-8")
        self.feed(self.text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)
            self.texts.setdefault(tag, []).append("")

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open:
            self.texts[self._open[-1]][-1] += data

    @property
    def data(self) -> dict[str, Any]:
        """What the page's program reads."""
        data: dict[str, Any] = json.loads(self.texts["script"][0])
        return data


def array(text: str, dtype: str) -> npt.NDArray[Any]:
    return np.frombuffer(base64.b64decode(text), dtype)


def events_in(data: dict[str, Any]) -> npt.NDArray[Any]:
    """The page's events as the page's program unpacks them."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(data["events"]["packed"])), np.uint8)
    planes = planes.reshape(8, data["events"]["kept"]).astype(np.int64)
    steps = sum(planes[k] << 8 * k for k in range(4))
    events = np.zeros(data["events"]["kept"], EVENT_DTYPE)
    events["t"] = np.cumsum(steps >> 1) * data["events"]["tick_us"] + data["start_us"]
    events["x"], events["y"], events["p"] = planes[4] | planes[5] << 8, planes[6] | planes[7] << 8, steps & 1
    return events


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset with events, frames and poses, and IMU samples that are not all in its time."""
    path = tmp_path_factory.mktemp("html") / "d"
    write_sequence(path)
    rows = [f"{0.001 * k:.9f} {k} 2 3 0.1 {-0.01 * k} 0.3" for k in range(STEPS + 20)]
    (path / "imu.txt").write_text("\n".join(rows) + "\n")
    return path


def test_the_page_holds_the_sequence(folder: Path, tmp_path: Path) -> None:
    """Where nothing needs to be left out: events, frames as a display wants them, poses, IMU samples of its time."""
    page = view_html(folder, tmp_path / "p.html", t_s=0.02, window_s=0.004)
    dataset, parsed = Dataset(folder), Page(tmp_path / "p.html")
    data = parsed.data
    assert np.array_equal(events_in(data), dataset.events)
    assert (data["width"], data["height"], data["duration_us"]) == (WIDTH, HEIGHT, 1000 * STEPS)
    assert (data["t_us"], data["window_us"]) == (20_000, 4_000)
    assert data["layers"][0]["t"] == [image.t_us for image in dataset.frames]
    for number, png in enumerate(data["layers"][0]["png"]):
        with Image.open(io.BytesIO(base64.b64decode(png))) as image:
            expected = np.rint(255 * to_srgb(dataset.read_image(number) / 255.0))
            assert np.array_equal(np.array(image), expected)
    poses = array(data["path"]["values"], "<f4").reshape(-1, 7)
    assert np.allclose(poses[:, :3], dataset.groundtruth.positions, atol=1e-6)
    assert np.allclose(poses[:, 3:], dataset.groundtruth.quaternions, atol=1e-6)
    imu = array(data["imu"]["values"], "<f4").reshape(-1, 6)
    assert np.allclose(imu[7], [7, 2, 3, 0.1, -0.07, 0.3])
    assert array(data["imu"]["t"], "<f8").max() == 1000 * STEPS
    n = len(dataset.events)
    assert page.kept == {
        "events": (n, n),
        "frames": (7, 7),
        "depth maps": (4, 4),
        "IMU samples": (STEPS + 1, STEPS + 20),
        "poses": (STEPS + 1, STEPS + 1),
    }
    assert page.size_bytes == (tmp_path / "p.html").stat().st_size
    assert (
        f"{n:,} of {n:,} events, 7 of 7 frames, 4 of 4 depth maps, 61 of 80 IMU samples, 61 of 61 poses"
        in parsed.texts["p"][0]
    )


def test_events_are_sampled_and_counted(folder: Path, tmp_path: Path) -> None:
    """The kept ones are of the sequence, in its order; page and command say how many; rates count all."""
    output = tmp_path / "p.html"
    ran = davis_rs("view", folder, "--html", output, "--max-events", "100", "--max-frames", "3")
    all_events, data = Dataset(folder).events, Page(output).data
    assert ran.returncode == 0
    said = f"100 of {len(all_events):,} events, 3 of 7 frames"
    assert said in ran.stdout
    assert said in output.read_text()
    kept = events_in(data)
    assert len(kept) == 100
    known = set(all_events.tolist())
    assert all(event in known for event in kept.tolist())
    assert (np.diff(kept["t"]) >= 0).all()
    assert data["layers"][0]["t"] == [0, 30_000, 60_000]
    counts = [array(data["rate"][name], "<u4").sum() for name in ("off", "on")]
    assert counts == np.bincount(all_events["p"]).tolist()


@given(st.integers(0, 3000), st.integers(1, 400))
def test_a_sample_is_even(count: int, most: int) -> None:
    """No event twice, one of each of as many runs of equal length as are kept, and the same one each time."""
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.arange(count)
    kept = sample_events(events, most)["t"]
    assert len(kept) == min(count, most)
    assert (np.diff(kept) > 0).all()
    assert np.array_equal(kept, sample_events(events, most)["t"])
    if count > most:
        assert np.array_equal(((kept + 1) * most - 1) // count, np.arange(most))
    spaced = evenly_spaced(count, most)
    assert len(set(spaced.tolist())) == len(spaced) == min(count, most)
    if most > 1 and count:
        assert (spaced[0], spaced[-1]) == (0, count - 1)


@given(st.lists(st.tuples(st.integers(5, 500), st.integers(0, 1)), max_size=40), st.integers(1, 30))
def test_every_event_is_counted_once(rows: list[tuple[int, int]], bins: int) -> None:
    """In intervals that cover the sequence exactly."""
    events = np.array([(t, 0, 0, p) for t, p in sorted(rows)], EVENT_DTYPE)
    length_us, on, off = event_counts(events, 5, 500, bins)
    assert on.sum() + off.sum() == len(rows)
    assert on.sum() == events["p"].sum()
    assert length_us * len(on) == pytest.approx(495)


def test_frames_are_left_out_where_the_file_would_be_large(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Evenly, until they fit; one stays in any case."""
    for budget, most in ((1200, 1200), (1, 10_000)):
        monkeypatch.setattr(page_layers, "_FRAME_BYTES", budget)
        page = view_html(folder, tmp_path / "p.html")
        pictures = [base64.b64decode(png) for png in Page(tmp_path / "p.html").data["layers"][0]["png"]]
        assert 1 <= len(pictures) < 7
        assert sum(map(len, pictures)) <= most
        assert page.kept["frames"] == (len(pictures), 7)
        assert f"{len(pictures)} of 7 frames" in str(page)
    assert len(pictures) == 1


def test_a_default_page_stays_below_ten_megabytes(tmp_path: Path) -> None:
    """A million events, as noise."""
    rng, count = np.random.default_rng(1), 1_000_000
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, 10**12, count))  # eleven days: times have ticks of more than a microsecond
    events["x"], events["y"], events["p"] = rng.integers(0, 640, count), rng.integers(0, 480, count), 1
    np.save(tmp_path / "e.npy", events)
    page = view_html(tmp_path / "e.npy", tmp_path / "p.html", size=(640, 480))
    assert page.kept == {"events": (count, count)}
    assert html_page.MAX_EVENTS == 5_000_000
    assert 4_000_000 < page.size_bytes < 10_000_000
    data = Page(tmp_path / "p.html").data
    kept = events_in(data)
    tick_us = data["events"]["tick_us"]
    assert tick_us > 1
    at = np.searchsorted(events["t"], kept["t"])
    assert (np.abs(events["t"][np.minimum(at, count - 1)] - kept["t"]) < tick_us).mean() > 0.999


def test_recordings_and_event_files_become_pages(tmp_path: Path) -> None:
    """Frames and IMU of a recording, in times that count from its start; an event file whose size is given."""
    events = events_of([(1_000_000, 3, 4, 1), (1_000_500, 5, 6, 0)])
    content = aedat4(
        (0, aedat4_events(events)),
        (1, aedat4_frame(frame_of(346, 260, t=1_000_100))),
        (2, aedat4_imu([(1_000_200, (0, 1, 0, 0, 0, 0, 0))])),
    )
    (tmp_path / "r.aedat4").write_bytes(content)
    view_html(tmp_path / "r.aedat4", tmp_path / "r.html")
    data = Page(tmp_path / "r.html").data
    assert events_in(data)["t"].tolist() == [0, 500]
    assert data["layers"][0]["t"] == [100]
    assert array(data["imu"]["t"], "<f8").tolist() == [200]
    assert array(data["imu"]["values"], "<f4")[0] == pytest.approx(9.80665)


@pytest.fixture(scope="module")
def with_truth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short simulation with all maps of the ground truth."""
    folder = tmp_path_factory.mktemp("truth") / "d"
    rates: dict[str, Any] = {f"{name}_rate_hz": 100.0 for name in ("flow", "mask", "normal", "depth", "frame")}
    simulate_to_folder(load_scene("three_planes"), folder, duration_s=0.03, accuracy="fast", **rates)
    return folder


def test_maps_of_the_truth_are_layers(with_truth: Path, tmp_path: Path) -> None:
    """Each with its pictures, in colours that the page explains, and with a limit of its own."""
    page = view_html(with_truth, tmp_path / "p.html", max_frames=3)
    layers = {layer["name"]: layer for layer in Page(tmp_path / "p.html").data["layers"]}
    assert list(layers) == ["frame", "depth", "flow", "shapes", "normals"]
    for layer in layers.values():
        assert layer["t"] == [0, 20_000, 30_000]
    assert page.kept.items() >= {
        ("depth maps", (3, 4)), ("flow maps", (3, 4)), ("masks", (3, 4)), ("normal maps", (3, 4))
    }  # fmt: skip
    assert re.fullmatch(r"from 1\.2 m \(yellow\) to 1\.9\d? m \(violet\)", layers["depth"]["says"])
    assert "full colour at 105 px/s" in layers["flow"]["says"]
    assert layers["shapes"]["says"] == "3 shapes, each in one colour; point at one to read its name"
    assert list(layers["shapes"]["names"].values()) == ["left", "middle", "right"]
    assert layers["depth"]["names"] == {}
    dataset = Dataset(with_truth)
    with Image.open(io.BytesIO(base64.b64decode(layers["depth"]["png"][0]))) as image:
        depth = np.array(image)
    truth = dataset.read_depth(0)
    nearest, farthest = depth[truth < truth.min() * 1.001], depth[truth > truth.max() * 0.999]
    assert (nearest[:, :2] > 200).all()
    assert (nearest[:, 2] < 60).all()
    assert (farthest[:, 1] < 30).all()
    with Image.open(io.BytesIO(base64.b64decode(layers["shapes"]["png"][0]))) as image:
        assert len(np.unique(np.array(image).reshape(-1, 3), axis=0)) == 3


def test_colours_are_those_of_matplotlib() -> None:
    """Which a page does without: depth within 5 of 255, the first shapes exactly, later ones by a shade."""
    depth = np.linspace(1, 2, 101, dtype=np.float32)[None]
    viridis = plt.colormaps["viridis_r"](np.linspace(0, 1, 101))[:, :3]
    assert np.abs(depth_picture(depth, 1.0, 2.0)[0] - viridis).max() < 5 / 255
    np.testing.assert_allclose(shape_colours(40)[1:21], plt.colormaps["tab20"](np.arange(20))[:, :3], atol=1e-9)
    every = np.rint(255 * shape_colours(65_535)).astype(int)
    assert len(np.unique(every, axis=0)) == 65_536
    assert every.min() >= 0
    assert every.max() <= 255
    assert np.abs(every[21:] - every[1 + np.arange(20, 65_535) % 20]).max() < 15


def test_maps_with_nothing_in_them_are_grey() -> None:
    """Depth that is infinite, flow and normals that are not known."""
    nothing = np.full((4, 5), np.inf, np.float32)
    assert np.ptp(depth_picture(nothing, 1.0, 2.0)) == 0
    assert np.ptp(normals_picture(np.full((4, 5, 3), np.nan, np.float32))) == 0
    towards = normals_picture(np.array([[[0, 0, -1], [1, 0, 0], [0, -1, 0]]], np.float32))
    np.testing.assert_allclose(towards[0], [[0.5, 0.5, 1], [1, 0.5, 0.5], [0.5, 1, 0.5]])
    empty = VisualSequence(
        label="",
        size=(5, 4),
        events=np.zeros(0, EVENT_DTYPE),
        start_us=0,
        end_us=10,
        depth_times=[7],
        read_depth=lambda _: nothing,
        flow_times=[0],
        read_flow=lambda _: np.full((4, 5, 2), np.nan, np.float32),
    )
    packed = [layer.packed(5, None, show_progress=False) for layer in layers_of(empty)]
    assert [layer["total"] for layer in packed] == [1, 1]
    assert packed[0]["t"] == [2]


def test_what_a_source_lacks_is_left_out(folder: Path, tmp_path: Path) -> None:
    """An event file has neither frames, nor IMU, nor poses."""
    with pytest.warns(UserWarning, match="leaves out"):
        convert(folder, tmp_path / "e.npy")
    page = view_html(tmp_path / "e.npy", tmp_path / "p.html", size=(WIDTH, HEIGHT))
    data = Page(tmp_path / "p.html").data
    assert page.kept.keys() == {"events"}
    assert data["layers"] == []
    assert data["imu"] is data["path"] is None


def test_names_from_files_stay_text(tmp_path: Path) -> None:
    """A scene's name with markup adds no element, and the text is the name, with its line separator escaped."""
    name = "</title></script><script>alert(1)</script><!--&amp;$label ${script}\u2028'\""
    with DatasetWriter(tmp_path / "d", Camera(WIDTH, HEIGHT, 20, 20, 11.5, 8.5)) as writer:
        writer.write(packet_of(0, 100, (50, 3, 4, 1), (60, 9, 9, 0)))
        writer.finish({})
    meta = json.loads((tmp_path / "d" / "meta.json").read_text())
    (tmp_path / "d" / "meta.json").write_text(json.dumps(meta | {"scene": {"name": name}}))
    view_html(tmp_path / "d", tmp_path / "p.html")
    page = Page(tmp_path / "p.html")
    assert [tag for tag, _ in page.elements].count("script") == 2
    assert page.texts["title"][0].startswith(printable(name))
    assert page.texts["h1"][0].startswith(printable(name))
    assert not set(page.texts["script"][0]) & set("<>&")


def test_names_of_shapes_stay_text(with_truth: Path, tmp_path: Path) -> None:
    name = "</script><script>alert(1)</script>&amp;"
    shutil.copytree(with_truth, tmp_path / "d")
    shapes = (tmp_path / "d" / "shapes.json").read_text()
    (tmp_path / "d" / "shapes.json").write_text(shapes.replace('"left"', json.dumps(name)))
    view_html(tmp_path / "d", tmp_path / "p.html")
    page = Page(tmp_path / "p.html")
    assert [tag for tag, _ in page.elements].count("script") == 2
    assert not set(page.texts["script"][0]) & set("<>&")
    (layer,) = (layer for layer in page.data["layers"] if layer["name"] == "shapes")
    assert list(layer["names"].values()) == [name, "middle", "right"]


def test_the_page_needs_no_network(folder: Path, tmp_path: Path) -> None:
    """No address in it, nothing that is loaded, and a policy that would refuse it; the policy lets the program run."""
    view_html(folder, tmp_path / "p.html")
    page = Page(tmp_path / "p.html")
    assert page.text.startswith("<!DOCTYPE html>\n<html lang=")
    without_data = page.text.replace(page.texts["script"][0], "")
    assert not re.search(r"https?:|//[a-z]+\.|@import|\burl\(|fetch\(|XMLHttpRequest|WebSocket", without_data)
    assert not any({"src", "href", "style"} & attributes.keys() for _, attributes in page.elements)
    assert not any(name.startswith("on") for _, attributes in page.elements for name in attributes)
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'element\("([\w-]+)"\)', page.texts["script"][1])) <= set(ids)
    policy = next(found["content"] for tag, found in page.elements if tag == "meta" and "http-equiv" in found)
    rules = dict(rule.strip().split(" ", 1) for rule in (policy or "").split(";"))
    hashes = {
        name: "'sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() + "'"
        for name, text in (("script", page.texts["script"][1]), ("style", page.texts["style"][0]))
    }
    assert rules == {
        "default-src": "'none'",
        "img-src": "data:",
        "script-src": hashes["script"],
        "style-src": hashes["style"],
    }


@pytest.mark.parametrize(
    ("name", "arguments", "rule"),
    [
        ("p.txt", {}, r"must end in \.html or \.htm"),
        ("p.html", {"t_s": 0.07}, r"t_s must lie in the sequence, 0\.\.0\.06 s, got 0\.07"),
        ("p.html", {"window_s": 0.0}, "window_s must be finite and > 0"),
        ("p.html", {"speed": float("nan")}, "speed must be finite and > 0"),
        ("p.html", {"max_events": 0}, "max_events must be an integer >= 1, got 0"),
        ("p.html", {"max_frames": -1}, "max_frames must be an integer >= 1, got -1"),
    ],
)
def test_senseless_pages_are_refused(
    folder: Path, tmp_path: Path, name: str, arguments: dict[str, Any], rule: str
) -> None:
    """Before a file is made."""
    with pytest.raises(ValueError, match=rule):
        view_html(folder, tmp_path / name, **arguments)
    assert not (tmp_path / name).exists()


def test_nothing_at_all_makes_no_page(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path / "d", Camera(WIDTH, HEIGHT, 20, 20, 11.5, 8.5)):
        pass
    with pytest.raises(ValueError, match="neither events nor frames"):
        view_html(tmp_path / "d", tmp_path / "p.html")


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        (["-o", "a.png", "--html", "p.html"], "-o and --html make different things"),
        (["--video", "v.gif", "--html", "p.html"], "--video and --html make different things"),
        (["--html", "p.html", "--rerun", "r.rrd"], "--html and --rerun make different things"),
        (["-o", "a.png", "--video", "v.gif"], "-o and --video make different things"),
        (["--html", "p.html", "--fps", "30"], "--fps means nothing for --html"),
        (["--video", "v.gif", "--time", "0.1"], "--time means nothing for --video"),
        (["--html", "p.html", "--panels", "frame"], "--panels means nothing for --html"),
        (["--rerun", "r.rrd", "--time", "0.01"], "--time means nothing for --rerun"),
        (["--max-events", "5"], "--max-events means nothing for the picture"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], rule: str
) -> None:
    """Nothing that is given is ignored."""
    monkeypatch.chdir(tmp_path)
    ran = davis_rs("view", folder, *options)
    assert ran.returncode == 1
    assert rule in ran.stderr
    assert not list(tmp_path.iterdir())


def test_the_program_unpacks_the_events(folder: Path, tmp_path: Path) -> None:
    """Its own data.js, run by Node: the same times, polarities and pixels as in the dataset."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs Node, to run the page's program")
    view_html(folder, tmp_path / "p.html")
    (tmp_path / "data.json").write_text(Page(tmp_path / "p.html").texts["script"][0])
    program = (Path(html_page.__file__).parent / "web" / "data.js").read_text()
    (tmp_path / "run.mjs").write_text(
        "import { readFileSync } from 'node:fs';\n"
        "const window = Object.assign(globalThis, { addEventListener: () => {} });\n"
        "const document = { getElementById: () => ({ textContent: readFileSync('data.json', 'utf8') }) };\n"
        f"{program}\n"
        "const { t, xy, on } = events;\n"
        "console.log(JSON.stringify([...t].map((us, i) => [us, xy[2 * i], xy[2 * i + 1], on[i]])));"
    )
    ran = subprocess.run([node, "run.mjs"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert ran.returncode == 0, ran.stderr
    unpacked = [tuple(event) for event in json.loads(ran.stdout)]
    assert unpacked == [tuple(event) for event in Dataset(folder).events[["t", "x", "y", "p"]].tolist()]


def test_a_page_in_a_notebook_is_the_file_in_a_frame(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The frame holds the page to the letter; without a file nothing is written, and with neither it is refused."""
    written = view_html(folder, tmp_path / "p.html")
    assert written._repr_html_() is None
    page = view_html(folder, inline=True)
    assert page.path is None
    shown = page._repr_html_()
    assert shown is not None

    class Frame(HTMLParser):
        srcdoc = ""

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            assert tag == "iframe"
            self.srcdoc = dict(attrs)["srcdoc"] or ""

    frame = Frame()
    frame.feed(shown)
    assert frame.srcdoc == (tmp_path / "p.html").read_text("utf-8")
    assert len(repr(page)) < 200
    monkeypatch.setattr(html_page, "MAX_EVENTS_INLINE", 7)
    assert view_html(folder, inline=True).kept["events"][0] == 7
    assert view_html(folder, inline=True, max_events=9).kept["events"][0] == 9
    both = view_html(folder, tmp_path / "q.html", inline=True, max_events=html_page.MAX_EVENTS)
    assert both.text == (tmp_path / "q.html").read_text("utf-8")
    with pytest.raises(ValueError, match="give output, the file to write, or inline=True for a notebook"):
        view_html(folder)


def near(pixels: npt.NDArray[np.uint8], rgb: tuple[int, int, int], within: int = 2) -> int:
    return int(np.count_nonzero((np.abs(pixels.astype(int) - rgb) <= within).all(-1)))


def browse(page: Path, folder: Path, size: str, output: str, address: str = "") -> str:
    """What a headless browser prints of a page, without an error in its console."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("needs Chromium, to see the page drawn")
    command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr"]
    command += [f"--user-data-dir={folder / 'profile'}", f"--window-size={size}", "--force-device-scale-factor=1"]
    command += ["--virtual-time-budget=3000", output, f"file://{page}{address}"]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert ran.returncode == 0, ran.stderr
    assert "CONSOLE" not in ran.stderr, ran.stderr
    return ran.stdout


def screen(page: Path, folder: Path, size: str, address: str = "") -> npt.NDArray[np.uint8]:
    """What a headless browser shows of a page."""
    browse(page, folder, size, f"--screenshot={folder / 's.png'}", address)
    with Image.open(folder / "s.png") as image:
        return np.array(image.convert("RGB"))


def test_a_browser_shows_depth_behind_the_events(with_truth: Path, tmp_path: Path) -> None:
    """Faded in the panel of the sensor, and as it is in the cloud; the address chooses it."""
    view_html(with_truth, tmp_path / "p.html", t_s=0.005)
    shown = {name: screen(tmp_path / "p.html", tmp_path, "1280,800", f"#behind={name}") for name in ("depth", "frame")}
    for name, pixels in shown.items():
        sensor, cloud = pixels[150:580, 42:630], pixels[150:580, 650:1238]
        assert (near(sensor, (254, 243, 136), 6) > 20_000) == (name == "depth")
        assert (near(cloud, (253, 231, 37), 6) > 2_000) == (name == "depth")


def test_no_event_of_a_large_sensor_falls_between_the_pixels_of_the_screen(tmp_path: Path) -> None:
    """A sensor of 1280 pixels is shown on half as many: each single event is seen, and of no more than its place."""
    rng = np.random.default_rng(5)
    events = np.zeros(300, EVENT_DTYPE)
    events["t"] = 1000
    events["p"] = 1
    places = rng.permutation(64 * 36)[: len(events)]  # cells of 20 x 20 pixels
    events["x"], events["y"] = (
        20 * (places % 64) + rng.integers(4, 16, 300),
        20 * (places // 64) + rng.integers(4, 16, 300),
    )
    with open_writer(tmp_path / "e.raw", (1280, 720)) as writer:
        writer.write(np.sort(events, order=["t", "y", "x"]))
    view_html(tmp_path / "e.raw", tmp_path / "p.html")
    pixels = screen(tmp_path / "p.html", tmp_path, "1280,900", "#t=0.001")[130:560, :640].astype(int)
    rows, columns = np.nonzero((np.abs(pixels - (202, 0, 32)) < 3).all(-1))
    assert len(np.unique((rows // 4) * 1000 + columns // 4)) >= 300
    assert len(rows) < 6 * 300


def with_script(page: Path, script: str) -> Path:
    """The page with one more script before its own, which its content security policy lets run."""
    scripted = page.with_name("scripted.html")
    text = page.read_text("utf-8").replace("script-src '", f"script-src '{html_page._hash(script)}' '")
    own = '<script type="application/json"'
    scripted.write_text(text.replace(own, f"<script>{script}</script>\n{own}"), "utf-8")
    return scripted


def with_pointer(page: Path, x: float, y: float) -> Path:
    """A page over whose sensor the pointer moves, when it is ready, to fractions of width and height."""
    script = f"""const wait = setInterval(() => {{
      if (document.documentElement.dataset.state !== "ready") return;
      clearInterval(wait);
      const canvas = document.getElementById("sensor"), box = canvas.getBoundingClientRect();
      const at = {{ clientX: box.left + {x} * box.width, clientY: box.top + {y} * box.height }};
      canvas.dispatchEvent(new PointerEvent("pointermove", at));
    }}, 20);"""
    return with_script(page, script)


@pytest.mark.parametrize(
    ("x", "behind", "name"), [(0.05, "shapes", "left"), (0.95, "shapes", "right"), (0.05, "depth", None)]
)
def test_a_browser_names_the_shape_at_the_pointer(
    with_truth: Path, tmp_path: Path, x: float, behind: str, name: str | None
) -> None:
    """Over its faded colour and the events; over other maps there is no name."""
    view_html(with_truth, tmp_path / "p.html", t_s=0.005)
    page = with_pointer(tmp_path / "p.html", x, 0.5)
    shown = browse(page, tmp_path, "1280,800", "--dump-dom", f"#behind={behind}")
    found = re.search(r'<span id="shape-name"([^>]*)>([^<]*)</span>', shown)
    assert found is not None
    assert (None if "hidden" in found[1] else found[2]) == name


EVENT_TIMES = st.lists(st.integers(0, 60), min_size=1, max_size=40).map(sorted)


@given(EVENT_TIMES, st.integers(1, 45), st.none() | st.integers(0, 60))
def test_a_span_is_whole(times: list[int], most: int, around_us: int | None) -> None:
    """No more than asked for, and none is missing between its ends; it is the densest, or that around the time."""
    events = np.zeros(len(times), EVENT_DTYPE)
    events["t"], events["x"] = times, np.arange(len(times))
    span = span_of_events(events, most, around_us)
    assert 1 <= len(span) <= most
    if len(events) <= most:
        assert len(span) == len(events)
        return
    first, last = span["t"][0], span["t"][-1]
    if first < last:
        assert np.array_equal(span, events[(events["t"] >= first) & (events["t"] <= last)])
    lengths = events["t"][most - 1 :] - events["t"][: len(events) - most + 1]
    if around_us is None:
        assert last - first <= lengths.min()
    elif len({*times}) == len(times):  # times that differ: the span has as many before as after, where there are
        before, after = np.count_nonzero(span["t"] < around_us), np.count_nonzero(span["t"] >= around_us)
        assert span["x"][0] == 0 or span["x"][-1] == len(times) - 1 or abs(before - after) <= 1


def test_a_page_of_a_span(folder: Path, tmp_path: Path) -> None:
    """All events of it and none of the others; it opens in its middle, or at the time that was asked for."""
    events = Dataset(folder).events
    page = view_html(folder, tmp_path / "p.html", max_events=500, whole=True)
    data = Page(tmp_path / "p.html").data
    kept, (first_us, last_us) = events_in(data), data["events"]["span_us"]
    assert np.array_equal(kept, events[(events["t"] >= first_us) & (events["t"] <= last_us)])
    assert page.kept["events"] == (len(kept), len(events))
    assert data["t_us"] == (first_us + last_us) // 2
    assert 400 < len(kept) <= 500
    ran = davis_rs("view", folder, "--html", tmp_path / "q.html", "--max-events", "500", "--whole", "--time", "0.02")
    assert ran.returncode == 0
    data = Page(tmp_path / "q.html").data
    first_us, last_us = data["events"]["span_us"]
    assert first_us < data["t_us"] == 20_000 < last_us
    assert Page(tmp_path / "q.html").data["window_us"] < last_us - first_us
    view_html(folder, tmp_path / "r.html", whole=True)
    assert Page(tmp_path / "r.html").data["events"]["span_us"] is None


def test_a_page_says_how_to_keep_all(folder: Path, tmp_path: Path) -> None:
    """By a command that does, with all else as it was; one that has all says nothing."""
    output, options = tmp_path / "a page & more.html", ["--time", "0.02", "--speed", "0.1", "--max-frames", "2"]
    ran = davis_rs("view", folder, "--html", output, "--max-events", "100", *options)
    some = Page(output)
    command = "".join(some.texts["code"])
    assert command in ran.stdout
    words = shlex.split(command)
    assert words[:2] == ["davis-rs", "view"]
    assert davis_rs(*words[1:]).returncode == 0
    whole = Page(output)
    assert whole.data["events"]["kept"] == whole.data["events"]["total"] == some.data["events"]["total"]
    assert "code" not in whole.texts
    for name in ("t_us", "speed"):
        assert whole.data[name] == some.data[name]
    assert len(whole.data["layers"][0]["t"]) == 2
    inline = view_html(folder, inline=True, max_events=10, size=(WIDTH, HEIGHT))
    total = len(Dataset(folder).events)
    call = f"davis_rs.view_html({str(folder)!r}, inline=True, max_events={total}, size=({WIDTH}, {HEIGHT}))"
    assert inline.keep_all == call


def test_a_browser_says_where_events_are_kept(folder: Path, tmp_path: Path) -> None:
    view_html(folder, tmp_path / "p.html", max_events=500, whole=True, t_s=0.02)
    first_us, last_us = Page(tmp_path / "p.html").data["events"]["span_us"]
    span = f"from {first_us / 1e6:.4f} s to {last_us / 1e6:.4f} s"
    for address, said in (("", "events of the last"), ("#t=0.06", f"no events are kept here, those {span} are")):
        shown = browse(tmp_path / "p.html", tmp_path, "1280,800", "--dump-dom", address)
        found = re.search(r'id="sensor-says">([^<]*)<', shown)
        assert found is not None
        assert said in found[1]
        assert "sampled" not in found[1]
        assert re.search(rf"Events shown are all [\d,]+ {span}, of [\d,]+; the event rate counts all of them", shown)


@pytest.mark.parametrize("size", [(60, 40), (60, 60), (40, 60)])
def test_a_browser_shows_all_labels_of_the_cloud(size: tuple[int, int], tmp_path: Path) -> None:
    """Of sensors of any shape: no instant below its box is cut off."""
    with open_writer(tmp_path / "e.raw", size) as writer:
        writer.write(np.ones(3, EVENT_DTYPE))
    view_html(tmp_path / "e.raw", tmp_path / "p.html")
    script = """const draw = CanvasRenderingContext2D.prototype.fillText, below = [];
    CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
      if (this.canvas.id === "cloud") below.push(Math.round(this.canvas.clientHeight - y));
      document.body.dataset.below = below.join(" ");
      draw.call(this, text, x, y);
    };"""
    shown = browse(with_script(tmp_path / "p.html", script), tmp_path, "1280,800", "--dump-dom")
    found = re.search(r'data-below="([^"]*)"', shown)
    assert found is not None
    below = [int(pixels) for pixels in found[1].split()]
    assert len(below) >= 4
    assert min(below) >= 4, "the letters reach below their line"


def test_a_browser_draws_many_events_in_parts(tmp_path: Path) -> None:
    """Where something changes some of them, and says so; a little later all: here of ON events, without the others."""
    rng, count, size = np.random.default_rng(3), 131_072, (60, 40)
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(1, 1_000_000, count))
    # Some pixels have few events: only a drawing of all events has theirs.
    events["x"], events["p"] = rng.integers(0, 60, count), rng.integers(0, 2, count)
    events["y"] = np.minimum(39, rng.exponential(4, count)).astype(int)
    with open_writer(tmp_path / "e.raw", size) as writer:
        writer.write(events)
    view_html(tmp_path / "e.raw", tmp_path / "p.html", t_s=events["t"][-1] / 1e6, window_s=2.0)
    # Pictures by a timer, because a headless browser makes them when it likes.
    script = """window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 16);
    const says = document.getElementById("sensor-says"), canvas = document.getElementById("sensor"), said = [];
    new MutationObserver(() => {
      document.body.dataset.said = (said.push(says.textContent), said.join(";"));
      if (said.length !== 3) return;
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      document.body.dataset.reds = data.filter((_, i) => i % 4 === 0);
    }).observe(says, { childList: true });
    new MutationObserver(() => {
      document.getElementById("show-off").checked = false;
      document.getElementById("show-off").dispatchEvent(new Event("change"));
    }).observe(document.documentElement, { attributes: true });"""
    shown = browse(with_script(tmp_path / "p.html", script), tmp_path, "1280,800", "--dump-dom")
    noted = dict(re.findall(r'data-(said|reds)="([^"]*)"', shown))
    on = events[events["p"] == 1]
    assert noted["said"].split(";") == [
        "131,072 events of the last 2.00 s",
        f"{len(on):,} events (1 in 4 drawn while it moves) of the last 2.00 s",
        f"{len(on):,} events of the last 2.00 s",
    ]
    expected = np.full((40, 60), 255)
    expected[on["y"], on["x"]] = 202
    assert np.array_equal(np.array(noted["reds"].split(","), int).reshape(40, 60), expected)


def test_a_browser_draws_the_page(folder: Path, tmp_path: Path) -> None:
    """Headless, without an error in its console: events, the frame, the cloud, the plots and the path are there."""
    view_html(folder, tmp_path / "p.html", t_s=0.03)
    pixels = screen(tmp_path / "p.html", tmp_path, "1280,1300")
    assert near(pixels, (253, 241, 242)) < 5000  # the background of an error, which is as wide as the page
    sensor, cloud, rate = pixels[150:580, 42:630], pixels[150:580, 650:1238], pixels[650:800, 90:1238]
    motion_left, motion_right = pixels[830:1180, 42:630], pixels[860:1180, 650:1238]
    for rgb in (ON_RGB, OFF_RGB):
        assert near(sensor, rgb) > 2000
        assert near(cloud, rgb) > 200
        assert near(rate, rgb, 60) > 500  # thin lines are smoothed
    greys = sensor[(np.ptp(sensor.astype(int), axis=2) == 0)]
    assert len(np.unique(greys)) > 20
    for rgb in ((213, 94, 0), (0, 158, 115), (0, 114, 178)):
        assert near(motion_left, rgb, 60) > 150
    assert near(motion_right, (28, 33, 38), 60) > 100
