"""Frames that are not what their names say, or claim any size, and interpolators that do not keep to what is asked."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from clips import moving_bars, write_exr, write_video
from davis_rs import DecodeError, events_from_frames, open_frames
from davis_rs._util.budget import VARIABLE
from davis_rs.events.arrays import concatenate_events
from davis_rs.simulation.from_frames import optical_flow
from davis_rs.simulation.from_frames.image_file import read_frame_image

BARS = moving_bars(3)


def png_header(width: int, height: int, depth: int) -> bytes:
    """Of colour; hardly any pixels follow."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")


def tiff_header(width: int, height: int) -> bytes:
    """16-bit colour of a compression that Pillow does not have."""
    tags = [(256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 16), (259, 3, 1, 34712), (262, 3, 1, 2),
            (273, 4, 1, 8), (277, 3, 1, 3), (278, 4, 1, height), (279, 4, 1, 100)]  # fmt: skip
    rows = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    return b"II*\0" + struct.pack("<I", 8) + struct.pack("<H", len(tags)) + rows + bytes(4)


def hdr(width: int, height: int) -> bytes:
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width) + b"\2\2\1\1" * 64


def exr_bytes(folder: Path) -> bytes:
    write_exr(folder / "a.exr", {"Y": np.ones((4, 5), np.float32)})
    return (folder / "a.exr").read_bytes()


UNKNOWN: dict[str, Callable[[Path], bytes]] = {
    "Radiance": lambda folder: hdr(30_000, 8_000),
    "large Radiance": lambda folder: hdr(70_000, 70_000),
    "PFM": lambda folder: b"PF\n70000 70000\n-1.0\n" + bytes(64),
    "PAM": lambda folder: b"P7\nWIDTH 70000\nHEIGHT 70000\nDEPTH 3\nMAXVAL 255\nTUPLTYPE RGB\nENDHDR\n" + bytes(64),
    "OpenEXR": exr_bytes,
    "text": lambda folder: b"hello",
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_kinds_that_are_not_read_are_refused_before_a_library_guesses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    content = UNKNOWN[name](tmp_path)
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "frame_0.png").write_bytes(content)
    guessed = []
    monkeypatch.setattr(cv2, "imdecode", lambda *given: guessed.append(given))
    with pytest.raises(DecodeError, match=r"frame_0\.png: not an image of a kind that is read: PNG, JPEG, TIFF, BMP"):
        list(open_frames(folder, fps=30).frames())
    assert not guessed


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.png", png_header(8192, 8192, 8)), ("a.png", png_header(8192, 8192, 16)), ("a.tif", tiff_header(8192, 8192))],
    ids=["png", "deep png", "tiff"],
)
def test_sizes_are_charged_before_pixels_are_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: bytes
) -> None:
    monkeypatch.setenv(VARIABLE, "bytes=1GiB")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DecodeError, match=rf"{name}: a frame of 8192 x 8192 pixels needs 2 GiB, .* 1 GiB may be held"):
        list(open_frames(tmp_path, fps=30).frames())


def test_many_pixels_are_the_budgets_matter_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pillow would warn of an image that the budget allows or refuses: the refusal is all that is said."""
    path = tmp_path / "0.png"
    path.write_bytes(png_header(10_000, 9_000, 8))
    monkeypatch.setenv(VARIABLE, "bytes=1MiB")
    with pytest.raises(DecodeError, match="may be held in memory"):
        read_frame_image(path)


def test_channels_of_an_exr_are_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of them are decoded."""
    channels = {f"c{k}": np.zeros((64, 64), np.float32) for k in range(40)}
    write_exr(tmp_path / "frame_0.exr", {"Y": np.ones((64, 64), np.float32), **channels})
    monkeypatch.setenv(VARIABLE, "bytes=400KiB")
    with pytest.raises(DecodeError, match="its 41 channels of 64 x 64 pixels needs"):
        list(open_frames(tmp_path, fps=30).frames())


def test_libraries_errors_about_an_image_name_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise cv2.error("it is too large")

    cv2.imwrite(str(tmp_path / "frame_0.png"), np.zeros((4, 5, 3), np.uint16))
    monkeypatch.setattr(cv2, "imdecode", fail)
    with pytest.raises(DecodeError, match=r"frame_0\.png: it is too large"):
        list(open_frames(tmp_path, fps=30).frames())


def test_frames_that_are_too_wide_for_flow_say_so() -> None:
    wide = np.tile(BARS[:2, :2, :1], (1, 1, 32_767))
    with pytest.raises(ValueError, match="optical flow takes frames of up to 32766 pixels on a side, got 32767 x 2"):
        list(events_from_frames(wide, fps=30, interpolation="flow"))


def elsewhere(folder: Path) -> None:
    write_video(folder / "a.mkv", BARS, [0, 40, 80], pixel_format="gray")


PLAYLISTS = {
    "x.m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\na.mkv\n#EXT-X-ENDLIST\n",
    "x.ffconcat": "ffconcat version 1.0\nfile a.mkv\n",
    "x.mp4": "ffconcat version 1.0\nfile a.mkv\n",
}


@pytest.mark.parametrize("name", PLAYLISTS)
def test_lists_of_other_files_are_no_videos(tmp_path: Path, name: str) -> None:
    elsewhere(tmp_path)
    assert len(list(open_frames(tmp_path / "a.mkv").frames())) == 3
    (tmp_path / name).write_text(PLAYLISTS[name])
    with pytest.raises(DecodeError, match=rf"{name}: it is no video of a kind that is read: MP4"):
        open_frames(tmp_path / name)


@pytest.mark.parametrize("fps", [5e-324, 1e-10])
def test_a_rate_without_a_second_stamp_is_refused(fps: float) -> None:
    with pytest.raises(ValueError, match=f"fps must be above 2.17e-10, .* got {fps}"):
        events_from_frames(BARS, fps=fps)


def test_a_frame_without_a_stamp_is_refused() -> None:
    with pytest.raises(ValueError, match=r"frame 2 at fps='3e-10' has no stamp that fits 64 bits"):
        list(events_from_frames(BARS, fps=3e-10))


def sparse_image(low: int, high: int) -> npt.NDArray[np.uint8]:
    """Two frames of 2^17 pixels."""
    return np.stack([np.full((256, 512), level, np.uint8) for level in (low, high)])


def test_events_that_would_fill_memory_are_refused_before_flow_is_sought(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the change of light alone; a refractory period that leaves few of them is heeded."""
    sought = []
    flow = optical_flow.FlowFinder.flow

    def noted(*given: Any) -> Any:
        sought.append(given)
        return flow(*given)

    monkeypatch.setattr(optical_flow.FlowFinder, "flow", noted)
    how: dict[str, Any] = {"fps": 30, "interpolation": "flow", "contrast_threshold": 1e-3, "log_eps": 1e-3}
    with pytest.raises(ValueError, match=r"frame 1: .* 512 x 256 pixels would make about \d\.\d+e\+08 events: .*size"):
        list(events_from_frames(sparse_image(0, 255), **how))
    assert not sought
    packets = list(events_from_frames(sparse_image(0, 255), **how, effects={"refractory_period_us": 1e4}))
    assert 0 < sum(len(packet.events) for packet in packets) <= 5 * 512 * 256


def of_events(interpolator: Any) -> Any:
    rng = np.random.default_rng(2)
    frames = np.repeat(np.repeat(rng.integers(0, 256, (2, 8, 12), np.uint8), 8, 1), 8, 2)
    frames[1] = np.roll(frames[0], 3, 1)
    packets = events_from_frames(frames, fps=30, interpolation=interpolator)
    return concatenate_events([packet.events for packet in packets])


def mixed(before: Any, after: Any, shares: Any) -> list[Any]:
    return [(1 - share) * before + share * after for share in shares]


def test_an_interpolator_that_writes_into_what_it_is_given_changes_nothing() -> None:
    def writing(before: Any, after: Any, shares: Any) -> list[Any]:
        found = mixed(before, after, shares)
        before[:], after[:], shares[:] = 9.0, 0.0, 0.5
        return found

    expected = of_events(mixed)
    assert len(expected)
    np.testing.assert_array_equal(of_events(writing), expected)


def test_an_interpolator_may_use_one_array_for_all() -> None:
    def reusing(before: Any, after: Any, shares: Any) -> Any:
        image = np.empty_like(before)
        for share in shares:
            image[:] = (1 - share) * before + share * after
            yield image

    np.testing.assert_array_equal(of_events(reusing), of_events(mixed))


BAD: dict[str, tuple[Any, str]] = {
    "None": (lambda a, b, s: None, r"it must give \d+ frames, got NoneType"),
    "None for a frame": (lambda a, b, s: [None] * len(s), r"frames must have the shape \(64, 96\), got None"),
    "complex": (lambda a, b, s: [a * 1j] * len(s), "frames must be real numbers, got dtype complex"),
    "text": (lambda a, b, s: [np.full(a.shape, "1.0")] * len(s), "frames must be real numbers, got dtype <U3"),
    "too bright": (lambda a, b, s: [np.full(a.shape, 1e300)] * len(s), "luma must be finite and >= 0, got inf"),
}


@pytest.mark.parametrize("name", BAD)
def test_interpolators_that_give_no_luma(name: str) -> None:
    interpolator, said = BAD[name]
    with pytest.raises(ValueError, match=f"the interpolator, between frames, frame 0 and frames, frame 1: .*{said}"):
        of_events(interpolator)


def test_kinds_that_are_read_go_by_their_bytes(tmp_path: Path) -> None:
    """A JPEG that is named .png."""
    Image.fromarray(BARS[0]).save(tmp_path / "frame_0.png", "JPEG")
    (frame,) = open_frames(tmp_path, fps=30).frames()
    assert frame.image.shape == BARS[0].shape
