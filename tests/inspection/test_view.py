"""The figure and the video of a dataset."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from imageio.plugins.ffmpeg import get_exe
from PIL import Image

from davis_rs import EVENT_DTYPE, RecordingWarning, convert, view_html
from davis_rs._util.srgb import to_srgb
from davis_rs.cli.main import main
from davis_rs.events.packet import Packet
from davis_rs.geometry.camera import Camera
from davis_rs.inspection.figure import OFF_RGB, ON_RGB, event_picture, view
from davis_rs.inspection.video import _even_moments, _moments_of_events, _speed_text, accumulated_picture, make_video
from davis_rs.inspection.visual_sequence import open_visual_sequence
from davis_rs.io.dataset.writer import DatasetWriter
from davis_rs.io.files.sensor_size import SensorSizeWarning
from recording_files import aedat2, aedat2_event
from written_sequence import HEIGHT, STEPS, WIDTH, packet_of, pose_at, write_sequence


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A dataset to look at."""
    write_sequence(tmp_path / "d")
    return tmp_path / "d"


def view_dataset(path: Path, output: Path, **arguments: Any) -> Path:
    """The figure, in a file."""
    view(path, **arguments).savefig(output)
    return output


def pixels_of(path: Path) -> npt.NDArray[np.uint8]:
    with Image.open(path) as image:
        assert image.format == "PNG"
        return np.array(image.convert("RGB"))


def count_of(pixels: npt.NDArray[np.uint8], rgb: tuple[int, int, int], *, within: int = 0) -> int:
    return int(np.count_nonzero((np.abs(pixels.astype(int) - rgb) <= within).all(-1)))


@pytest.mark.long
def test_the_figure_has_its_size_and_colours(folder: Path, tmp_path: Path) -> None:
    """7.2 inches at 200 dpi on white, with ON pixels in red and OFF pixels in blue over a grey frame."""
    assert view_dataset(folder, tmp_path / "figure.png") == tmp_path / "figure.png"
    pixels = pixels_of(tmp_path / "figure.png")
    assert pixels.shape == (1112, 1440, 3)
    assert tuple(pixels[0, 0]) == (255, 255, 255)
    events = pixels[:600, 760:]
    assert count_of(events, ON_RGB) > 2000
    assert count_of(events, OFF_RGB) > 2000
    frame = pixels[110:550, 60:660].astype(int)
    assert np.ptp(frame, axis=2).max() == 0
    assert np.ptp(frame) > 100


@pytest.mark.long
def test_the_moment_and_the_window_can_be_chosen(folder: Path, tmp_path: Path) -> None:
    """Another time and a longer window give another figure, with more events; the same ones give the same bytes."""
    first = pixels_of(view_dataset(folder, tmp_path / "a.png", t_s=0.02, window_s=0.001))[:560, 760:]
    longer = pixels_of(view_dataset(folder, tmp_path / "b.png", t_s=0.02, window_s=0.01))[:560, 760:]
    assert count_of(longer, ON_RGB) > 1.5 * count_of(first, ON_RGB) > 0
    view_dataset(folder, tmp_path / "c.png", t_s=0.02, window_s=0.01)
    assert (tmp_path / "c.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_events_alone_make_a_figure(tmp_path: Path) -> None:
    """Frames and depth maps may be missing."""
    with DatasetWriter(tmp_path / "d", Camera(32, 32, 20, 20, 15.5, 15.5)) as writer:
        writer.write(packet_of(0, 100, (50, 3, 4, 1), (60, 9, 9, 0)))
    pixels = pixels_of(view_dataset(tmp_path / "d", tmp_path / "figure.png"))
    assert count_of(pixels, ON_RGB) > 100
    assert count_of(pixels, OFF_RGB) > 100


def test_what_is_not_there_has_no_panel(folder: Path, tmp_path: Path) -> None:
    """Letters follow the panels that there are; long times are told in seconds."""

    def titles(source: Path, **chosen: Any) -> list[str]:
        shown = (axes.get_title() for axes in view(source, **chosen).axes)
        return [title for title in shown if title.startswith("(")]

    with pytest.warns(UserWarning, match="leaves out"):
        convert(folder, tmp_path / "e.npy")
    alone = titles(tmp_path / "e.npy", size=(WIDTH, HEIGHT), window_s=1.93)
    assert [title[:4] for title in alone] == ["(a) ", "(b) "]
    assert "events in 1.93 s: ON red" in alone[0]
    assert alone[1].endswith(", 1.93 s"), "not twenty windows, of which the sequence would fill a small part"
    assert titles(folder)[0].startswith("(a) intensity frame")
    assert not any("no " in title for title in titles(folder))


def test_an_odd_number_of_panels_leaves_no_quarter_empty(tmp_path: Path) -> None:
    """The last one is the band over time, as wide as two; where there is none it is in the middle."""

    def panels(name: str, *events: tuple[int, int, int, int], **images: Any) -> list[Any]:
        with DatasetWriter(tmp_path / name, Camera(WIDTH, HEIGHT, 20, 20, 11.5, 8.5)) as writer:
            writer.write(packet_of(0, 100, *events, **images))
        return [axes for axes in view(tmp_path / name).axes if axes.get_title().startswith("(")]

    luma, flow = np.ones((HEIGHT, WIDTH), np.float32), np.ones((HEIGHT, WIDTH, 2), np.float32)
    of_rows = (50, 3, HEIGHT // 2, 1)
    even = panels("four", of_rows, luma=luma, flow=flow)
    assert len({axes.get_position().width for axes in even}) == 1
    assert "(d) optical flow" in even[3].get_title()
    *pictures, band = panels("five", of_rows, luma=luma, flow=flow, depth=luma)
    assert band.get_title().startswith("(e) 1 events of rows")
    assert (band.get_position().x0, band.get_position().x1) == pytest.approx(
        (pictures[0].get_position().x0, pictures[1].get_position().x1)
    )
    (alone,) = panels("one")
    assert alone.get_position().x0 == pytest.approx(1 - alone.get_position().x1, abs=0.01)


def test_the_band_is_where_the_events_are(tmp_path: Path) -> None:
    """The middle rows, unless others have more than four times their events; a hot pixel does not count for more."""

    def band(name: str, *events: tuple[int, int, int, int]) -> str:
        with DatasetWriter(tmp_path / name, Camera(WIDTH, HEIGHT, 20, 20, 11.5, 8.5)) as writer:
            writer.write(packet_of(0, 1000, *sorted(events)))
        (title,) = (axes.get_title() for axes in view(tmp_path / name).axes if "of rows" in axes.get_title())
        return title.split("events of ")[1].split(",")[0]

    middle = f"rows {HEIGHT // 2 - 2} to {HEIGHT // 2 + 2}"
    here = [(100 * x + 1, x, HEIGHT // 2, 1) for x in range(5)]
    above = [(10 * x + 2, x, 3, 1) for x in range(20)]
    assert band("few above", *here, *above) == middle
    assert band("many above", *here[:4], *above) == "rows 0 to 4"
    assert band("a hot pixel", *here, *((t, 5, 0, 1) for t in range(1, 501))) == middle
    assert band("none elsewhere", *above) == "rows 0 to 4"


def test_a_dataset_without_events_makes_a_figure(tmp_path: Path) -> None:
    """A camera that rests gives an empty cloud, not an error."""
    with DatasetWriter(tmp_path / "d", Camera(WIDTH, HEIGHT, 20, 20, 11.5, 8.5)) as writer:
        writer.write(Packet(0, 100, np.zeros(0, EVENT_DTYPE), pose_at(0), np.ones((HEIGHT, WIDTH), np.float32)))
    pixels = pixels_of(view_dataset(tmp_path / "d", tmp_path / "figure.png"))
    assert count_of(pixels, ON_RGB) == count_of(pixels, OFF_RGB) == 0


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        ({"t_s": 0.061}, r"t_s must lie in the sequence, 0\.\.0\.06 s, got 0\.061"),
        ({"t_s": float("nan")}, "t_s must lie"),
        ({"window_s": 0.0}, "window_s must be finite and > 0"),
        ({"window_s": float("inf")}, "window_s must be finite and > 0"),
    ],
)
def test_senseless_moments_are_refused(folder: Path, tmp_path: Path, arguments: dict[str, Any], rule: str) -> None:
    """A time outside of the dataset or an empty window is an error that states the limits."""
    with pytest.raises(ValueError, match=rule):
        view_dataset(folder, tmp_path / "figure.png", **arguments)


def test_a_pixel_has_the_colour_of_its_last_event() -> None:
    """Events cover the faded frame; of several in a pixel the last one shows."""
    events = np.array([(1, 0, 0, 1), (2, 1, 0, 0), (3, 0, 1, 1), (4, 0, 1, 0)], EVENT_DTYPE)
    picture = event_picture(np.array([[0.0, 0.0], [0.0, 1.0]]), events)
    assert picture.dtype == np.uint8
    assert picture.tolist() == [[list(ON_RGB), list(OFF_RGB)], [list(OFF_RGB), [255, 255, 255]]]


def test_frames_are_drawn_with_the_srgb_curve() -> None:
    """Black, white, the linear toe and middle grey of IEC 61966-2-1 (linear 0.2140 is 0.5)."""
    grey = to_srgb(np.array([0, 255, 55]) / 255)
    assert grey[:2].tolist() == pytest.approx([0, 1])
    assert grey[2] == pytest.approx(0.5, abs=0.005)


@pytest.mark.few(1)
@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_the_video_shows_frames_and_events(folder: Path, tmp_path: Path, suffix: str) -> None:
    """60 ms, ten times slower, at 25 pictures a second are 15 pictures: panels of 480 x 360, events on the right."""
    video = make_video(folder, tmp_path / f"video{suffix}", fps=25, speed=0.1)
    # imageio's own reader leaves pipes open, which is a warning and so an error here.
    command = [get_exe(), "-v", "error", "-i", video, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    decoded = subprocess.run(command, capture_output=True, check=True).stdout
    pictures = np.frombuffer(decoded, np.uint8).reshape(-1, 388, 968, 3)
    assert len(pictures) == STEPS * 25 // 100
    left, right = pictures[7][:, :476], pictures[7][:, 492:]
    for rgb in (ON_RGB, OFF_RGB):  # with room for the codec
        assert count_of(right, rgb, within=40) > 2000
        assert count_of(left, rgb, within=40) == 0


def test_accumulated_events_are_grey(tmp_path: Path) -> None:
    """ON minus OFF, white and black at full scale; pictures by time reach back as far as asked, others by number."""
    events = np.array([(1, 0, 0, 1), (2, 0, 0, 1), (3, 0, 0, 0), (4, 1, 0, 0), (5, 1, 1, 1)], EVENT_DTYPE)
    assert accumulated_picture((3, 2), events, 2).tolist() == [[192, 64, 128], [128, 192, 128]]
    assert accumulated_picture((3, 2), events[:2], 2)[0, 0] == accumulated_picture((3, 2), events[:2], 1)[0, 0] == 255
    assert accumulated_picture((3, 2), events[3:4], 1)[0, 1] == 1
    random = np.random.default_rng(0)
    many = np.zeros(1000, EVENT_DTYPE)
    many["t"], many["x"] = np.arange(1000) * 100, random.integers(0, 4, 1000)
    np.save(tmp_path / "e.npy", many)
    sequence = open_visual_sequence(tmp_path / "e.npy", size=(4, 1))
    by_number = _moments_of_events(sequence, 300)
    assert [(moment.first, moment.stop) for moment in by_number] == [(0, 300), (300, 600), (600, 900), (900, 1000)]
    assert [moment.t_us for moment in by_number] == [29_900, 59_900, 89_900, 99_900]
    by_time = _even_moments(sequence, 10_000, 0.025)
    assert [(moment.first, moment.stop) for moment in by_time[:4]] == [(0, 101), (0, 201), (51, 301), (151, 401)]
    video = make_video(
        tmp_path / "e.npy", tmp_path / "v.gif", size=(4, 1), panels="accumulated", events_per_picture=300
    )
    with Image.open(video) as picture:
        assert picture.n_frames == 4


@pytest.mark.long
def test_a_video_of_noise_stays_below_five_megabytes(tmp_path: Path) -> None:
    """Ten seconds of what no codec can compress well; the caption says how fast it plays."""
    random, count = np.random.default_rng(1), 400_000
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.sort(random.integers(0, 1_000_000, count))
    events["x"], events["y"], events["p"] = (random.integers(0, most, count) for most in (240, 180, 2))
    np.save(tmp_path / "e.npy", events)
    video = make_video(tmp_path / "e.npy", tmp_path / "v.mp4", size=(240, 180))
    assert 2_000_000 < video.stat().st_size < 5_000_000
    assert [_speed_text(speed) for speed in (0.1, 1, 0.3, 2.5)] == [
        "10 x slower", "real time", "3.33 x slower", "2.5 x faster"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "arguments", "rule"),
    [
        ("v.avi", {}, r"must end in \.mp4 or \.gif"),
        ("v.mp4", {"fps": 0}, "fps must be finite and > 0"),
        ("v.mp4", {"speed": -1.0}, "speed must be finite and > 0"),
        ("v.gif", {"fps": 60}, "more than 50 pictures"),
        ("v.gif", {"panels": "frame,event"}, "panels must be of frame, events, accumulated, got 'event'; did you mean"),
        ("v.gif", {"panels": []}, "panels must name one of frame"),
        ("v.gif", {"window_s": 0.1, "events_per_picture": 5}, "only one of window_s and events_per_picture"),
        ("v.gif", {"full_scale": 0}, "full_scale must be an integer >= 1"),
        ("v.gif", {"events_per_picture": 0.5}, "events_per_picture must be an integer >= 1"),
    ],
)
def test_senseless_videos_are_refused(
    folder: Path, tmp_path: Path, name: str, arguments: dict[str, Any], rule: str
) -> None:
    """Refused before a file is made."""
    with pytest.raises(ValueError, match=rule):
        make_video(folder, tmp_path / name, **arguments)
    assert not (tmp_path / name).exists()


@pytest.mark.few(1)
@pytest.mark.parametrize(("module", "call"), [("matplotlib", "view"), ("imageio", "make_video")])
def test_a_missing_library_says_how_to_get_it(folder: Path, tmp_path: Path, module: str, call: str) -> None:
    """Without the view extra the error names the command that installs it."""
    arguments = repr(str(folder)) if call == "view" else f"{str(folder)!r}, {str(tmp_path / 'v.mp4')!r}"
    program = (
        f"import sys; sys.modules[{module!r}] = None\n"
        "from davis_rs.inspection.figure import view\n"
        "from davis_rs.inspection.video import _speed_text, make_video\n"
        f"try: {call}({arguments})\n"
        "except ImportError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "pip install 'davis_rs[view]'" in done.stdout


# ---- formats, sources and edge cases ----


@pytest.mark.few(1)
@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")])
def test_the_suffix_chooses_the_format(folder: Path, tmp_path: Path, suffix: str, magic: bytes) -> None:
    output = tmp_path / f"figure{suffix}"
    assert main(["view", str(folder), "-o", str(output)]) == 0
    assert output.read_bytes().startswith(magic)


@pytest.mark.parametrize("name", ["figure.foo", "figure", "figure.raw"])
def test_an_unknown_suffix_is_refused(
    folder: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """With a list of those there are, and without a file."""
    assert main(["view", str(folder), "-o", str(tmp_path / name)]) == 1
    assert ".png, .pdf, .svg" in capsys.readouterr().err
    assert not list(tmp_path.glob("figure*"))


def test_an_event_file_and_a_recording_can_be_viewed(folder: Path, tmp_path: Path) -> None:
    """One that does not know its size needs it, or a meta.json next to it; AEDAT 4 and .npy go without a folder."""
    with pytest.warns(UserWarning, match="leaves out"):
        convert(folder, tmp_path / "e.aedat4")
    with pytest.warns(UserWarning, match="leaves out"):
        convert(folder, tmp_path / "e.npy")
    with pytest.raises(ValueError, match="does not say the sensor's size"):
        view(tmp_path / "e.npy")
    with pytest.warns(SensorSizeWarning, match=f"{WIDTH} x {HEIGHT} is taken from .*meta.json"):
        view(folder / "events.txt")
    for source, size in ((folder / "events.txt", (WIDTH, HEIGHT)), (tmp_path / "e.aedat4", None)):
        pixels = pixels_of(view_dataset(source, tmp_path / "figure.png", size=size))
        assert count_of(pixels, ON_RGB) > 100
        assert count_of(pixels, OFF_RGB) > 100
    make_video(tmp_path / "e.aedat4", tmp_path / "v.gif")
    (tmp_path / "cut.aedat").write_bytes(aedat2([(aedat2_event(3, 5, 1), 700)]) + b"cut")
    with pytest.warns(RecordingWarning, match="the last record is cut off"):
        view(tmp_path / "cut.aedat")
    with pytest.raises(ValueError, match=r": event \d+ at .* lies outside of the 3 x 3 sensor: is the size"):
        view(tmp_path / "e.npy", size=(3, 3))


def test_a_figure_shows_itself_in_a_notebook(folder: Path) -> None:
    """By the method that IPython asks for."""
    figure: Any = view(folder)
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_nothing_at_all_makes_no_video(tmp_path: Path) -> None:
    """Neither events nor frames: refused, with the reason, before a file is made."""
    with DatasetWriter(tmp_path / "d", Camera(WIDTH, HEIGHT, 20, 20, 11.5, 8.5)):
        pass
    assert "no events" in str([axes.get_title() for axes in view(tmp_path / "d").axes])
    with pytest.raises(ValueError, match="neither events nor frames"):
        make_video(tmp_path / "d", tmp_path / "v.gif")
    assert not (tmp_path / "v.gif").exists()


@pytest.mark.parametrize(("depth", "said"), [(1.8, "1.800 m everywhere"), (np.inf, "nothing is hit")])
def test_flat_depth_is_told_as_a_number(tmp_path: Path, depth: float, said: str) -> None:
    """A plane's rounding errors are no relief; one frame and one packet make a figure and a video."""
    noise = np.random.default_rng(0).normal(0, 1e-7, (HEIGHT, WIDTH))
    luma = np.ones((HEIGHT, WIDTH), np.float32)
    with DatasetWriter(tmp_path / "d", Camera(WIDTH, HEIGHT, 20, 20, 11.5, 8.5)) as writer:
        map_ = (depth + noise).astype(np.float32)
        writer.write(Packet(0, 0, np.zeros(0, EVENT_DTYPE), pose_at(0), luma, map_))
    figure = view(tmp_path / "d")
    assert said in figure.axes[2].get_title()
    make_video(tmp_path / "d", tmp_path / "v.gif")


def test_frames_of_a_colour_sensor_are_shown_in_colour(tmp_path: Path) -> None:
    """In a figure, a video and a page; a pattern that does not exist is left alone."""
    mosaic = np.full((HEIGHT, WIDTH), 0.1, np.float32)
    mosaic[::2, ::2] = 0.9  # the red pixels
    for name, pattern in (("d", "RGGB"), ("odd", "RGBW")):
        with DatasetWriter(tmp_path / name, Camera(WIDTH, HEIGHT, 20, 20, 11.5, 8.5)) as writer:
            writer.write(packet_of(0, 100, (50, 3, 4, 1), luma=mosaic))
            writer.finish({"parameters": {"colour_filter": {"pattern": pattern}}})
    frame = open_visual_sequence(tmp_path / "d").read_frame(0)
    assert frame.shape == (HEIGHT, WIDTH, 3)
    assert np.ptp(frame, axis=(0, 1)).max() < 0.01
    red, green, blue = frame.mean(axis=(0, 1))
    assert red > 5 * green == pytest.approx(5 * blue)
    assert open_visual_sequence(tmp_path / "odd").read_frame(0).shape == (HEIGHT, WIDTH)
    pixels = pixels_of(view_dataset(tmp_path / "d", tmp_path / "figure.png"))
    shown = tuple(np.rint(255 * to_srgb(frame[0, 0])).astype(int))
    assert count_of(pixels, shown, within=2) > 10_000
    assert event_picture(frame, np.zeros(0, EVENT_DTYPE)).shape == (HEIGHT, WIDTH, 3)
    make_video(tmp_path / "d", tmp_path / "v.gif", panels="frame,events")
    with Image.open(tmp_path / "v.gif") as video:
        assert count_of(np.array(video.convert("RGB")), shown, within=12) > 10_000
    assert view_html(tmp_path / "d", tmp_path / "p.html").kept["frames"] == (1, 1)
