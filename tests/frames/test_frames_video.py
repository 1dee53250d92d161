"""Frames from video: the container's own stamps, range, matrix and transfer function; and bad videos."""

from __future__ import annotations

import os
import re
import wave
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from clips import FULL, LIMITED, moving_bars, write_video
from davis_rs import DecodeError, check_dataset, events_from_frames, frames_to_folder, open_frames
from davis_rs.events.arrays import concatenate_events
from davis_rs.simulation.from_frames.frame_run import FrameRun
from davis_rs.simulation.from_frames.frame_source import StampedFrame
from davis_rs.simulation.from_frames.video import Video
from davis_rs.simulation.settings import FrameSettings, complete

BARS = moving_bars(8)
STAMPS_MS = [0, 33, 50, 117, 150, 151, 200, 300]
RAMP = np.tile(np.arange(256, dtype=np.uint8), (16, 1))


def read(path: Path, **how: Any) -> list[StampedFrame]:
    return list(open_frames(path, **how).frames())


def first_luma(path: Path) -> npt.NDArray[np.float32]:
    packet = next(events_from_frames(open_frames(path)))
    assert packet.luma is not None
    return packet.luma


@pytest.mark.parametrize(
    ("name", "codec", "pixel_format"),
    [
        ("clip.mkv", "ffv1", "yuv444p"),
        ("clip.mkv", "ffv1", "gray"),
        ("clip.mp4", "libx264", "yuv420p"),
        ("clip.mp4", "mpeg4", "yuv420p"),
        ("clip.webm", "libvpx-vp9", "yuv420p"),
        ("clip.mov", "prores", "yuv422p10le"),
        ("clip.mkv", "ffv1", "yuv444p16le"),
        ("clip.mkv", "ffv1", "bgra"),
    ],
)
def test_the_stamps_are_the_containers(tmp_path: Path, name: str, codec: str, pixel_format: str) -> None:
    """A variable rate, also where frames are stored in another order than they are shown in (H.264's B-frames)."""
    shift = 40 if name.endswith("mkv") else 0  # they count from the first frame on
    path = write_video(
        tmp_path / name,
        BARS,
        [shift + t for t in STAMPS_MS],
        codec=codec,
        pixel_format=pixel_format,
        colour_range=LIMITED,
    )
    found = read(path)
    assert [round(frame.t_ns / 1e6) for frame in found] == STAMPS_MS
    for frame, image in zip(found, BARS, strict=True):
        grey = frame.image if frame.image.ndim == 2 else frame.image[..., 1]
        assert np.abs(grey / np.iinfo(grey.dtype).max * 255 - image).mean() < 8
    assert found[3].where == f"{path}, frame 3"


@pytest.mark.parametrize("colour_range", [FULL, LIMITED])
@pytest.mark.parametrize("pixel_format", ["gray", "yuv444p", "yuv420p", "yuv444p10le", "yuv420p12le"])
def test_range_and_bits_come_out_as_light(tmp_path: Path, pixel_format: str, colour_range: int) -> None:
    """Grey values are what they were, to half of a step of what is stored."""
    path = write_video(tmp_path / "a.mkv", [RAMP, RAMP], [0, 10], pixel_format=pixel_format, colour_range=colour_range)
    source = open_frames(path)
    frame = next(iter(source.frames()))
    values = frame.image.astype(np.float64) / 65535 * 255
    values = values if values.ndim == 3 else values[..., None]
    step = 255 / (219 if colour_range == LIMITED else 255)
    assert np.abs(values - RAMP[..., None]).max() <= step / 2 + 0.51
    if colour_range == FULL and pixel_format in ("gray", "yuv444p"):
        assert np.abs(values - RAMP[..., None]).max() < 0.01
    assert np.ptp(values, axis=2).max() < 0.01  # grey stays grey
    bits = source.describe()["bits"]
    assert isinstance(bits, int)
    assert source.encoding(frame).levels == {
        (FULL, 8): 255, (LIMITED, 8): 219, (FULL, 10): 1023, (LIMITED, 10): 876, (FULL, 12): 4095, (LIMITED, 12): 3504,
    }[colour_range, bits]  # fmt: skip
    assert source.describe()["range"] == ("full" if colour_range == FULL else "limited")


@pytest.mark.parametrize(
    ("matrix", "weights"),
    [
        (5, (0.299, 0.587, 0.114)),
        (1, (0.2126, 0.7152, 0.0722)),
        (7, (0.212, 0.701, 0.087)),
        (9, (0.2627, 0.678, 0.0593)),
    ],
)
def test_colours_go_through_the_streams_matrix(tmp_path: Path, matrix: int, weights: tuple[float, ...]) -> None:
    """Planes that are written by hand, by the definition of Y'CbCr, come back as the R'G'B' that they stand for."""
    import av

    colours = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0.2, 0.5, 0.8], [1, 1, 1], [0, 0, 0]])
    y = colours @ weights
    cb, cr = (colours[:, 2] - y) / (2 - 2 * weights[2]), (colours[:, 0] - y) / (2 - 2 * weights[0])
    planes = [16 + 219 * y, 128 + 224 * cb, 128 + 224 * cr]
    stored = [np.repeat(np.repeat(np.rint(plane).astype(np.uint8), 16)[None], 16, 0) for plane in planes]
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = stored[0].shape[1], 16, "yuv444p"
        stream.codec_context.color_range, stream.codec_context.colorspace = LIMITED, matrix
        for number in range(2):
            frame: Any = av.VideoFrame.from_ndarray(np.stack(stored), format="yuv444p")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    image = read(path)[0].image[8, 8::16] / 65535
    assert np.abs(image - colours).max() < 1.2 / 219
    assert open_frames(path).describe()["matrix_stated"]


def test_the_transfer_function_is_the_streams_or_the_users(tmp_path: Path) -> None:
    grey = np.full((16, 16), 128, np.uint8)
    plain = write_video(tmp_path / "a.mkv", [grey, grey], [0, 10])
    tagged = write_video(tmp_path / "b.mkv", [grey, grey], [0, 10], colour={"color_trc": 1})
    value = 128 / 255
    srgb, rec709 = ((value + 0.055) / 1.055) ** 2.4, ((value + 0.099) / 1.099) ** (1 / 0.45)
    assert first_luma(plain)[0, 0] == pytest.approx(srgb, rel=1e-4)
    assert first_luma(tagged)[0, 0] == pytest.approx(rec709, rel=1e-4)
    packet = next(events_from_frames(open_frames(tagged), transfer="linear"))
    assert packet.luma is not None
    assert packet.luma[0, 0] == pytest.approx(value, rel=1e-4)
    hdr = write_video(tmp_path / "c.mkv", [grey, grey], [0, 10], colour={"color_trc": 16})
    with pytest.raises(ValueError, match=r"transfer must be one of .*PQ"):
        events_from_frames(open_frames(hdr))


@pytest.mark.parametrize(
    ("pixel_format", "colour_range", "black", "white", "step"),
    [
        ("yuv444p", LIMITED, 16, 235, 1),
        ("yuv444p", FULL, 0, 255, 1),
        ("gray", FULL, 0, 255, 1),
        ("yuv420p10le", LIMITED, 64, 940, 876 / 256),  # of the ramp's 8 bits
    ],
)
def test_white_is_a_value_of_the_video_itself(
    tmp_path: Path, pixel_format: str, colour_range: int, black: int, white: int, step: float
) -> None:
    """Frames are decoded to 16 bits, but what is said of 8 bits, and what a user says of them, is in 8 bits."""
    path = write_video(tmp_path / "a.mkv", [RAMP, RAMP], [0, 10], pixel_format=pixel_format, colour_range=colour_range)

    def run(**settings: Any) -> FrameRun:
        settings = {"interpolation": "linear", "transfer": "linear", **settings}
        return FrameRun(open_frames(path), complete(FrameSettings, settings, taker="a test"))

    def luma(**settings: Any) -> npt.NDArray[np.float32]:
        image = next(run(**settings).packets()).luma
        assert image is not None
        return image

    steps = "" if step == 1 else f" in steps of {step:.4g}, as in the first frame,"
    assert f", values {black} to {white}{steps} are luma 0 to 1, " in next(run().notes())
    frames = run().describe_frames()
    assert [frames[key] for key in ("black_level", "white_level", "value_step")] == [black, white, step]
    assert np.array_equal(luma(white_level=white), luma())
    half = black + (white - black) / 2
    assert np.allclose(luma(white_level=half), 2 * luma(), rtol=1e-6)
    assert run(white_level=half).log_eps == pytest.approx(2 * run().log_eps, rel=0.02)


def test_given_stamps_take_the_place_of_the_containers(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mkv", BARS, STAMPS_MS)
    assert [frame.t_ns for frame in read(path, fps=1000)] == [1_000_000 * k for k in range(8)]
    times = [5, 6, 8, 9, 11, 12, 13, 14]
    assert [frame.t_ns for frame in read(path, timestamps=times)] == [1000 * t for t in times]
    with pytest.raises(ValueError, match="there are only 7 stamps, and more frames"):
        read(path, timestamps=times[:-1])
    with pytest.raises(ValueError, match="there are only 8 frames, and more stamps"):
        read(path, timestamps=[*times, 20])


def test_events_of_a_video_are_those_of_its_frames(tmp_path: Path) -> None:
    """A lossless video makes the events of the array, at the video's stamps."""
    path = write_video(tmp_path / "a.mkv", BARS, STAMPS_MS)
    settings: dict[str, Any] = {"interpolation": "linear", "log_eps": 2e-3}
    by_array = events_from_frames(BARS.astype(np.uint8), [1000 * t for t in STAMPS_MS], **settings)
    by_video = events_from_frames(open_frames(path), **settings)
    a, b = (concatenate_events([packet.events for packet in packets]) for packets in (by_array, by_video))
    assert len(a) > 1000
    # The array's 8-bit values, and the same as 16 bits: the same light to float32.
    assert len(a) == len(b)
    assert np.abs(a["t"] - b["t"]).max() <= 1


@pytest.mark.parametrize("degrees", [-90, 90, 180])
def test_a_video_is_turned_upright(tmp_path: Path, degrees: int) -> None:
    """As players do: a telephone's -90 degrees are a quarter turn clockwise."""
    import av

    image = np.random.default_rng(0).integers(0, 256, (16, 32), np.uint8)
    path = tmp_path / "a.mov"
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("png", rate=30)
        stream.width, stream.height, stream.pix_fmt = 32, 16, "gray"
        stream.set_display_rotation(degrees)
        for number in range(2):
            frame: Any = av.VideoFrame.from_ndarray(image, format="gray")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with av.open(str(path)) as container:
        assert next(container.decode(video=0)).rotation % 360 == degrees % 360
    found = read(path)[0].image / 65535 * 255
    assert np.abs(found - np.rot90(image, degrees // 90)).max() < 0.01  # NumPy's turns are counterclockwise too


def _cut(path: Path, share: float) -> None:
    os.truncate(path, int(path.stat().st_size * share))


def _h264(path: Path, **how: Any) -> Path:
    frames = moving_bars(60, 64, 48)
    return write_video(
        path, frames, [33 * k for k in range(60)], codec="libx264", pixel_format="yuv420p", colour_range=LIMITED, **how
    )


def _mp4(folder: Path) -> Path:
    path = _h264(folder / "a.mp4")
    _cut(path, 0.6)
    return path


def _mkv(folder: Path) -> Path:
    path = _h264(folder / "a.mkv")
    _cut(path, 0.6)
    return path


def _avi(folder: Path) -> Path:
    path = write_video(
        folder / "a.avi", BARS, [0, 40, 80, 120, 160, 200, 240, 280], codec="mjpeg", pixel_format="yuvj420p"
    )
    _cut(path, 0.5)
    return path


def _unknown_codec(folder: Path) -> Path:
    path = write_video(
        folder / "a.avi", BARS, [0, 40, 80, 120, 160, 200, 240, 280], codec="mjpeg", pixel_format="yuvj420p"
    )
    path.write_bytes(path.read_bytes().replace(b"MJPG", b"QQQQ"))
    return path


def _text(folder: Path) -> Path:
    path = folder / "a.mp4"
    path.write_text("not a video\n" * 100)
    return path


def _sound(folder: Path) -> Path:
    path = folder / "a.wav"
    with wave.open(str(path), "wb") as sound:
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(16000))
    return path


def _alpha(folder: Path) -> Path:
    return write_video(folder / "a.mkv", [COLOUR, COLOUR], [0, 10], pixel_format="yuva420p")


def _bayer(folder: Path) -> Path:
    import av

    path = folder / "a.nut"
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("rawvideo", rate=30)
        stream.width, stream.height, stream.pix_fmt = 32, 16, "bayer_rggb8"
        for number in range(2):
            frame: Any = av.VideoFrame(32, 16, "bayer_rggb8")
            frame.pts = number
            container.mux(stream.encode(frame))
    return path


def _interlaced(folder: Path) -> Path:
    return _h264(folder / "a.mkv", options={"x264-params": "tff=1"})


COLOUR = np.stack([BARS[0], BARS[1], BARS[2]], -1)

BAD: dict[str, tuple[Callable[[Path], Path], str]] = {
    "mp4 cut short": (_mp4, "a.mp4: "),
    "mkv cut short": (_mkv, r"a.mkv.*: (cut short: its header says 1\.9\d+ s|.*)"),
    "avi cut short": (_avi, "a.avi"),
    "unknown codec": (_unknown_codec, "a.avi: its codec is not one that FFmpeg knows"),
    "text": (_text, "a.mp4: it is no video, or a damaged one; frames must be a video, a folder of images or a .npy"),
    "sound": (_sound, "a.wav: it is no video of a kind that is read"),
    "alpha": (_alpha, "pixel format yuva420p has an alpha channel"),
    "bayer": (_bayer, "pixel format bayer_rggb8 cannot be taken"),
    "interlaced": (_interlaced, "frame 0: it is interlaced"),
}


@pytest.mark.parametrize("name", BAD)
def test_videos_that_cannot_be_taken(name: str, tmp_path: Path) -> None:
    make, said = BAD[name]
    path = make(tmp_path)
    with pytest.raises(DecodeError, match=said):
        read(path)


@pytest.mark.parametrize("make", [_mkv, _avi], ids=["mkv", "avi"])
def test_what_a_cut_video_still_has_is_a_valid_dataset(make: Callable[[Path], Path], tmp_path: Path) -> None:
    path = make(tmp_path)
    with pytest.raises(DecodeError, match=re.escape(str(path))):
        frames_to_folder(path, tmp_path / "out", quiet=True, interpolation="linear")
    report = check_dataset(tmp_path / "out")
    assert report.ok, report
    assert report.counts["frames"] >= 2
    assert report.counts["events"] > 100


def test_a_video_without_pyav_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_video(tmp_path / "a.mkv", BARS, STAMPS_MS)
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    with pytest.raises(ImportError, match=r"needs PyAV: pip install 'davis_rs\[video\]'"):
        Video(path)


def test_no_file_and_no_regular_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        open_frames(tmp_path / "none.mp4")
    os.mkfifo(tmp_path / "pipe.mp4")
    with pytest.raises(OSError, match="not a regular file"):
        open_frames(tmp_path / "pipe.mp4")
