"""Frames from files: folders of images of all kinds and layouts, .npy stacks, lists of stamps, and bad ones."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from clips import moving_bars, write_exr, write_images
from davis_rs import DecodeError, check_dataset, frames_to_folder, open_frames
from davis_rs.cli.main import main
from davis_rs.simulation.from_frames.frame_source import StampedFrame

BARS = moving_bars(12)
COLOUR = np.stack([BARS, BARS[::-1], 255 - BARS], -1)


def read(path: Path, **how: Any) -> list[StampedFrame]:
    return list(open_frames(path, **how).frames())


def stamps(path: Path, **how: Any) -> list[int]:
    return [frame.t_ns for frame in read(path, **how)]


@pytest.mark.parametrize("suffix", [".png", ".tif", ".tiff", ".bmp"])
@pytest.mark.parametrize("frames", [BARS, COLOUR], ids=["grey", "colour"])
def test_eight_bits(tmp_path: Path, suffix: str, frames: npt.NDArray[np.uint8]) -> None:
    """By number: frame_10 comes after frame_2."""
    found = read(write_images(tmp_path, frames, suffix), fps=50)
    assert all(np.array_equal(one.image, image) for one, image in zip(found, frames, strict=True))
    assert [one.t_ns for one in found] == [20_000_000 * k for k in range(12)]
    assert f"frame_11{suffix} (frame 11)" in found[11].where


def test_jpeg_is_close(tmp_path: Path) -> None:
    found = read(write_images(tmp_path, BARS, ".jpg"), fps=50)
    assert np.abs(found[3].image.astype(int) - BARS[3]).max() < 30
    assert found[3].image.dtype == np.uint8


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("colour", [False, True])
def test_sixteen_bits_stay(tmp_path: Path, suffix: str, colour: bool) -> None:
    """Pillow alone would keep 8 bits of 16-bit colour without a word."""
    values = np.random.default_rng(0).integers(0, 65536, (20, 30, 3) if colour else (20, 30), np.uint16)
    cv2.imwrite(str(tmp_path / f"a{suffix}"), values[..., ::-1] if colour else values)
    cv2.imwrite(str(tmp_path / f"b{suffix}"), values[..., ::-1] if colour else values)
    found = read(tmp_path, fps=1)
    assert found[0].image.dtype == np.uint16
    assert np.array_equal(found[1].image, values)


def test_float_tiff_and_exr_are_linear(tmp_path: Path) -> None:
    values = np.random.default_rng(0).uniform(0, 50, (20, 30, 3)).astype(np.float32)
    cv2.imwrite(str(tmp_path / "a.tif"), values[..., 0])
    assert np.array_equal(read(tmp_path, fps=1)[0].image, values[..., 0])
    exr = tmp_path / "exr"
    exr.mkdir()
    write_exr(exr / "0.exr", {"RGB": values})
    write_exr(exr / "1.exr", {"RGB": values.astype(np.float16)})
    source = open_frames(exr, fps=1)
    first, second = source.frames()
    assert np.array_equal(first.image, values)
    assert np.array_equal(second.image, values.astype(np.float16).astype(np.float32))
    assert source.encoding(first).transfer == "linear"
    grey = tmp_path / "grey"
    grey.mkdir()
    write_exr(grey / "0.exr", {"Y": values[..., 0]})
    assert np.array_equal(read(grey, fps=1)[0].image, values[..., 0])


def test_palettes_opaque_alpha_and_turned_photographs(tmp_path: Path) -> None:
    image = Image.fromarray(COLOUR[0])
    image.convert("P").save(tmp_path / "0.png")
    opaque = image.copy()
    opaque.putalpha(255)
    opaque.save(tmp_path / "1.png")
    found = read(tmp_path, fps=1)
    assert found[0].image.shape == (32, 48, 3)
    assert np.array_equal(found[1].image, COLOUR[0])
    turned = tmp_path / "turned"
    turned.mkdir()
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise
    image.save(turned / "0.png", exif=exif)
    assert np.array_equal(read(turned, fps=1)[0].image, np.rot90(COLOUR[0], -1))


def _lists(folder: Path) -> None:
    (folder / "images.txt").write_text(
        "# timestamp name\n0.000000 frame_0.png\n0.010000 frame_2.png\n0.03 frame_1.png\n"
    )


def test_a_dataset_folders_list(tmp_path: Path) -> None:
    write_images(tmp_path, BARS[:3])
    _lists(tmp_path)
    found = read(tmp_path)
    assert [one.t_ns for one in found] == [0, 10_000_000, 30_000_000]
    assert np.array_equal(found[1].image, BARS[2])


def test_esims_list(tmp_path: Path) -> None:
    """``images.csv`` of DataProviderFromFolder: nanoseconds, and the file."""
    write_images(tmp_path, BARS[:3])
    (tmp_path / "images.csv").write_text("1,frame_0.png\n1000001,frame_1.png\n2000001,frame_2.png\n")
    assert stamps(tmp_path) == [1, 1_000_001, 2_000_001]
    (tmp_path / "images.csv").write_text("timestamp,image\n1,frame_0.png\n1000001,frame_1.png\n")
    assert stamps(tmp_path) == [1, 1_000_001]


@pytest.mark.parametrize("inside", [True, False], ids=["the sequence's folder", "its imgs"])
def test_vid2es_folders(tmp_path: Path, inside: bool) -> None:
    """``imgs/`` with ``timestamps.txt`` (after upsampling) or ``fps.txt`` (before it) next to it."""
    write_images(tmp_path / "imgs", BARS[:3])
    folder = tmp_path if inside else tmp_path / "imgs"
    (tmp_path / "fps.txt").write_text("25.0\n")
    assert stamps(folder) == [0, 40_000_000, 80_000_000]
    (tmp_path / "timestamps.txt").write_text("0.0\n0.005\n1.25e-2\n")
    assert stamps(folder) == [0, 5_000_000, 12_500_000]


def test_v2es_folder_is_images_and_a_rate(tmp_path: Path) -> None:
    """v2e takes images in the order of their names, at --input_frame_rate."""
    for number, image in enumerate(BARS[:3]):
        Image.fromarray(image).save(tmp_path / f"{number:06d}.png")
    assert stamps(tmp_path, fps=30) == [0, 33_333_333, 66_666_667]


def test_stamps_of_files_and_their_units(tmp_path: Path) -> None:
    folder = write_images(tmp_path / "images", BARS[:3])
    text, array = tmp_path / "times.txt", tmp_path / "times.npy"
    text.write_text("# seconds\n0.5\n0.5000004 left out\n\n7.25\n")
    assert stamps(folder, timestamps=text) == [500_000_000, 500_000_400, 7_250_000_000]
    text.write_text("0\n33333\n66667\n")
    with pytest.raises(ValueError, match="without a decimal point, whose unit is not certain: give time_unit"):
        open_frames(folder, timestamps=text)
    assert stamps(folder, timestamps=text, time_unit="us") == [0, 33_333_000, 66_667_000]
    np.save(array, np.array([0, 33333, 66667]))
    assert stamps(folder, timestamps=array) == [0, 33_333_000, 66_667_000]
    assert stamps(folder, timestamps=array, time_unit="ns") == [0, 33_333, 66_667]
    np.save(array, np.array([0, 0.033, 0.066]))
    assert stamps(folder, timestamps=array) == [0, 33_000_000, 66_000_000]
    assert stamps(folder, timestamps=[0, 1, 2], time_unit="ms") == [0, 1_000_000, 2_000_000]
    with pytest.raises(ValueError, match="time_unit must be one of s, ms, us, ns"):
        open_frames(folder, timestamps=array, time_unit="h")
    with pytest.raises(ValueError, match="give them too"):
        open_frames(folder, time_unit="s")


def test_npy_stacks(tmp_path: Path) -> None:
    np.save(tmp_path / "stack.npy", COLOUR)
    found = read(tmp_path / "stack.npy", fps=100)
    assert np.array_equal(np.stack([one.image for one in found]), COLOUR)
    with pytest.raises(ValueError, match="does not say when its frames were taken: give timestamps or fps"):
        open_frames(tmp_path / "stack.npy")


def _transparent(folder: Path) -> None:
    image = Image.fromarray(COLOUR[0])
    image.putalpha(100)
    image.save(folder / "frame_1.png")


def _transparent_16_bits(folder: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    image = np.full((32, 48, 4), 65535, np.uint16)
    cv2.imwrite(str(folder / "frame_0.png"), image)  # opaque: is taken
    image[3, 4, 3] = 65534
    cv2.imwrite(str(folder / "frame_1.png"), image)


def _exr(folder: Path, channels: dict[str, npt.NDArray[Any]]) -> None:
    for number in range(3):
        (folder / f"frame_{number}.png").unlink()
        write_exr(folder / f"frame_{number}.exr", channels)


def _nan(folder: Path) -> None:
    values = np.ones((4, 5), np.float32)
    _exr(folder, {"Y": values})
    values[2, 3] = np.nan
    write_exr(folder / "frame_1.exr", {"Y": values})


BAD: dict[str, tuple[Any, str]] = {
    "cut short": (lambda f: os.truncate(f / "frame_1.png", 200), r"frame_1\.png: "),
    "no image": (lambda f: (f / "frame_1.png").write_bytes(b"hello"), r"frame_1\.png: not an image"),
    "transparent": (_transparent, r"frame_1\.png: pixels must be opaque"),
    "transparent, 16 bits": (_transparent_16_bits, r"frame_1\.png: pixels must be opaque"),
    "32 bits": (
        lambda f: Image.fromarray(np.full((32, 48), 65536, np.int32)).save(f / "frame_1.png", "TIFF"),
        r"frame_1\.png: an image of integers must have 8 or 16 bits a value",
    ),
    "cmyk": (
        lambda f: Image.new("CMYK", (48, 32)).save(f / "frame_1.png", "JPEG"),
        r"frame_1\.png: .* found mode CMYK",
    ),
    "another size": (
        lambda f: Image.new("L", (5, 5)).save(f / "frame_1.png"),
        r"frame_1\.png .*: all frames must have one",
    ),
    "NaN": (_nan, r"frame_1\.exr: light must be finite and >= 0, found nan at pixel \(3, 2\)"),
    "negative": (
        lambda f: _exr(f, {"Y": -np.ones((4, 5), np.float32)}),
        r"frame_0\.exr: light must be finite and >= 0",
    ),
    "channels": (lambda f: _exr(f, {"Z": np.ones((4, 5), np.float32)}), r"frame_0\.exr: expected channels R, G and B"),
    "alpha": (
        lambda f: _exr(f, {"RGBA": np.full((4, 5, 4), 0.5, np.float32)}),
        r"frame_0\.exr: pixels must be opaque",
    ),
    "integers": (lambda f: _exr(f, {"Y": np.ones((4, 5), np.uint32)}), r"frame_0\.exr: channels must be half or float"),
    "empty": (lambda f: [one.unlink() for one in f.iterdir()], "has no images in it"),
    "kinds": (lambda f: Image.new("L", (48, 32)).save(f / "z.jpg"), r"images of several kinds \(\.jpg, \.png\)"),
    "one": (lambda f: [(f / f"frame_{k}.png").unlink() for k in (1, 2)], "one frame makes no events"),
    "list": (lambda f: (f / "images.txt").write_text("0.0 frame_0.png\n1.0\n"), r"images\.txt, line 2: expected"),
    "leaves": (lambda f: (f / "images.txt").write_text("0.0 ../frame_0.png\n"), r"images\.txt, line 1: expected"),
    "no stamp": (
        lambda f: (f / "images.txt").write_text("0 a.png\nnow frame_1.png\n"),
        r"line 2: expected a time in s",
    ),
    "listed": (lambda f: (f / "images.txt").write_text("0.0 frame_0.png\n1.0 gone.png\n"), r"gone\.png"),
    "empty list": (lambda f: (f / "images.txt").write_text("# nothing\n"), "lists no images"),
    "equal": (
        lambda f: (f / "images.txt").write_text("0.5 frame_0.png\n0.5 frame_1.png\n"),
        r"frame_1\.png .*: stamps must increase, got 0\.5 s after 0\.5 s",
    ),
    "rate": (lambda f: (f / "fps.txt").write_text("fast"), r"fps\.txt: expected a frame rate"),
}
"""What is done to a folder of three images, and what is then said."""


@pytest.mark.parametrize("name", BAD)
def test_bad_folders(name: str, tmp_path: Path) -> None:
    folder = write_images(tmp_path / "in", BARS[:3])
    spoil, said = BAD[name]
    spoil(folder)
    named = name in ("list", "leaves", "no stamp", "listed", "empty list", "equal", "rate")
    with pytest.raises((ValueError, OSError), match=said):
        frames_to_folder(open_frames(folder, fps=None if named else 30), tmp_path / "out", quiet=True)
    assert not (tmp_path / "out").exists()  # the first two frames are read before the folder is made


@pytest.mark.parametrize("name", ["cut short", "another size", "transparent", "NaN"])
def test_what_came_before_a_bad_frame_is_a_valid_dataset(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_images(tmp_path / "in", BARS)
    bad = folder / "frame_7.png"
    if name == "NaN":
        pytest.importorskip("OpenEXR")
        for number, image in enumerate(BARS):
            (folder / f"frame_{number}.png").unlink()
            values = (image / 256).astype(np.float32)
            values[3, 4] = np.nan if number == 7 else values[3, 4]
            write_exr(folder / f"frame_{number}.exr", {"Y": values})
        bad = folder / "frame_7.exr"
    elif name == "cut short":
        os.truncate(bad, 300)
    elif name == "transparent":
        image = Image.fromarray(COLOUR[0])
        image.putalpha(100)
        image.save(bad)
    else:
        Image.new("L", (9, 9)).save(bad)
    assert main(["frames", str(folder), "--fps", "30", "-o", str(tmp_path / "out"), "--quiet"]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"davis-rs: error: {bad}")
    report = check_dataset(tmp_path / "out")
    assert report.ok, report
    assert report.counts["frames"] == 7
    assert report.counts["events"] > 100
    meta = json.loads((tmp_path / "out" / "meta.json").read_text())
    assert (meta["complete"], meta["interrupted"]) == (False, True)
    assert meta["ended_by"] in said


def test_bad_stacks(tmp_path: Path) -> None:
    path = tmp_path / "stack.npy"
    np.save(path, BARS)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(DecodeError, match=re.escape(str(path))):
        open_frames(path, fps=30)
    path.write_bytes(b"no array")
    with pytest.raises(DecodeError, match=re.escape(str(path))):
        open_frames(path, fps=30)
    np.save(path, np.array([{"a": 1}], object))
    with pytest.raises(DecodeError, match=re.escape(str(path))):
        open_frames(path, fps=30)
    np.save(path, BARS[0])
    with pytest.raises(ValueError, match=r"a stack of frames must have the shape"):
        open_frames(path, fps=30)
    with pytest.raises(FileNotFoundError):
        open_frames(tmp_path / "none.npy", fps=30)
    Image.new("L", (4, 4)).save(tmp_path / "a.png")
    with pytest.raises(ValueError, match="is a single image: give the folder"):
        open_frames(tmp_path / "a.png", fps=30)
    with pytest.raises(ValueError, match="12 images need as many stamps, got 2"):
        open_frames(write_images(tmp_path / "in", BARS), timestamps=[0, 1])
    with pytest.raises(ValueError, match="says when its images were taken: give timestamps or fps"):
        open_frames(tmp_path / "in")
    with pytest.raises(ValueError, match="only one of timestamps and fps"):
        open_frames(tmp_path / "in", timestamps=[0], fps=2)
