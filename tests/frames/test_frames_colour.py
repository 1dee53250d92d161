"""Colour frames behind a Bayer pattern: each pixel sees the light that its own filter passes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from clips import texture
from davis_rs import ColourFilter, Dataset, SensorParameters, events_from_frames, save_sensor
from davis_rs.cli.main import main
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.events.colour import filter_numbers
from davis_rs.simulation.from_frames.optical_flow import FlowFinder

WIDTH, HEIGHT, FRAME_US = 64, 48, 10_000
STEP_PX = 3.0
OVERLAPPING = ColourFilter("GBRG", red=(0.8, 0.15, 0.05), green=(0.2, 0.7, 0.1), blue=(0.0, 0.2, 0.8))
Colours = npt.NDArray[np.float32]


def colours_at(moved_px: float) -> Colours:
    """A frame (H, W, 3) whose three colours have textures of their own, which move together."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    planes = [texture(x - moved_px + 31.0 * colour, y + 17.0 * colour) for colour in range(3)]
    return np.stack(planes, axis=-1).astype(np.float32)


FRAMES = np.stack([colours_at(STEP_PX * k) for k in range(4)])
T_US = FRAME_US * np.arange(len(FRAMES))


def events(frames: npt.NDArray[Any], **settings: Any) -> EventArray:
    return concatenate_events([packet.events for packet in events_from_frames(frames, T_US, **settings)])


def lumas(frames: npt.NDArray[Any], **settings: Any) -> list[Colours]:
    packets = events_from_frames(frames, T_US, **settings)
    return [packet.luma for packet in packets if packet.luma is not None]


def mosaic(image: Colours, filters: ColourFilter) -> npt.NDArray[np.float64]:
    """What each pixel sees of a frame (H, W, 3) of linear light."""
    weights = np.array(filters.weights)[filter_numbers(filters.pattern, WIDTH, HEIGHT)]
    return np.asarray((weights * image).sum(-1), np.float64)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_each_pixel_has_the_events_of_a_sensor_of_its_own_colour(interpolation: str) -> None:
    found = events(FRAMES, colour_filter="GRBG", interpolation=interpolation)
    numbers = filter_numbers("GRBG", WIDTH, HEIGHT)
    assert len(found) > 1000
    for colour in range(3):
        alone = events(np.ascontiguousarray(FRAMES[..., colour]), interpolation=interpolation)
        own = [stream[numbers[stream["y"], stream["x"]] == colour] for stream in (found, alone)]
        np.testing.assert_array_equal(own[0], own[1])


@pytest.mark.parametrize("dtype", [np.float32, np.uint8, np.uint16])
def test_filters_weigh_linear_light(dtype: Any) -> None:
    largest = 1 if dtype == np.float32 else np.iinfo(dtype).max
    frames = (FRAMES * largest).astype(dtype)
    light = (frames / largest).astype(np.float32)
    seen = lumas(frames, colour_filter=OVERLAPPING, interpolation="linear", transfer="linear")
    for luma, image in zip(seen, light, strict=True):
        np.testing.assert_allclose(luma, mosaic(image, OVERLAPPING), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("interpolation", ["flow", "auto"])
def test_what_moves_goes_from_the_pixels_of_one_filter_to_those_of_another(interpolation: str) -> None:
    """Half-way between two frames the pixels see what has come there, and not a mixture of before and after."""
    half = lumas(FRAMES, colour_filter=OVERLAPPING, interpolation=interpolation, image_rate_hz=2e6 / FRAME_US)[1::2]
    inner = (slice(12, -12), slice(12, -12))
    assert len(half) == len(FRAMES) - 1
    for k, luma in enumerate(half):
        truth = mosaic(colours_at(STEP_PX * (k + 0.5)), OVERLAPPING)
        mixed = (mosaic(FRAMES[k], OVERLAPPING) + mosaic(FRAMES[k + 1], OVERLAPPING)) / 2
        assert np.abs(luma - truth)[inner].mean() < 0.35 * np.abs(mixed - truth)[inner].mean()


@pytest.mark.parametrize("interpolation", ["flow", "auto"])
def test_motion_is_not_sought_in_the_pattern_of_filters(interpolation: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It does not move: in flat red light, flow is computed of flat frames."""
    sought: list[Colours] = []
    flow = FlowFinder.flow

    def noted(finder: FlowFinder, before: Colours, after: Colours) -> Any:
        sought.extend([before, after])
        return flow(finder, before, after)

    monkeypatch.setattr(FlowFinder, "flow", noted)
    red = np.broadcast_to(np.array([0.5, 0.1, 0.02], np.float32), FRAMES[0].shape)
    seen = lumas(np.stack([red * k for k in (1, 1.2, 1.4, 1.6)]), colour_filter="RGGB", interpolation=interpolation)
    assert np.ptp(seen[0]) > 0.4
    assert len(sought) >= 6
    assert all(np.ptp(frame) == 0 for frame in sought)


def test_an_interpolator_gets_the_light_of_each_filter() -> None:
    """One that knows the motion: from the pattern of filters alone it could not be told."""
    asked: list[Colours] = []

    def known(before: Colours, after: Colours, shares: npt.NDArray[np.float64]) -> list[Colours]:
        asked.extend([before, after])
        return [np.asarray((1 - share) * before + share * after, np.float32) for share in shares]

    half = lumas(FRAMES, colour_filter="RGGB", interpolation=known, image_rate_hz=2e6 / FRAME_US)[1::2]
    np.testing.assert_array_equal(asked[0], FRAMES[0, ..., 0])
    np.testing.assert_array_equal(asked[3], FRAMES[1, ..., 1])
    eps = 1e-3
    for k, luma in enumerate(half):
        ends = [np.log(mosaic(FRAMES[at], ColourFilter("RGGB")) + eps) for at in (k, k + 1)]
        line = np.exp(sum(ends) / 2) - eps
        middle = mosaic((FRAMES[k] + FRAMES[k + 1]) / 2, ColourFilter("RGGB"))
        assert (np.abs(luma - middle) <= np.abs(line - middle) + 1e-5).all()
        assert np.abs(luma - middle).mean() < 0.1 * np.abs(line - middle).mean()


def test_frames_are_brought_to_the_sensors_size_before_the_filters() -> None:
    """A frame of one colour stays one, whatever its size."""
    one_colour = np.broadcast_to(np.array([0.5, 0.3, 0.1], np.float32), (2 * HEIGHT, 2 * WIDTH, 3))
    frames = np.stack([one_colour * brightness for brightness in (1, 1.2, 1.5, 2)]).astype(np.float32)
    seen = lumas(frames, colour_filter="BGGR", interpolation="linear", size=(WIDTH, HEIGHT))
    for luma, frame in zip(seen, frames, strict=True):
        np.testing.assert_allclose(luma, mosaic(frame[:HEIGHT, :WIDTH], ColourFilter("BGGR")), rtol=1e-5)


def test_a_sensor_brings_its_filters_and_none_leaves_them_out() -> None:
    sensor = SensorParameters(colour_pattern="GBRG")
    alike: dict[str, Any] = {"interpolation": "linear", "start_phase": "zero"}
    own = events(FRAMES, sensor=sensor, **alike)
    np.testing.assert_array_equal(own, events(FRAMES, colour_filter="GBRG", **alike))
    grey = events(FRAMES, **alike)
    np.testing.assert_array_equal(events(FRAMES, sensor=sensor, colour_filter="none", **alike), grey)
    assert len(own) != len(grey)


def test_grey_frames_have_no_colours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Asked for, that is an error; filters that only the sensor has are left out, and it is said."""
    grey = np.ascontiguousarray(FRAMES[..., 0])
    with pytest.raises(ValueError, match="colour_filter needs frames of red, green and blue"):
        list(events_from_frames(grey, T_US, colour_filter="RGGB"))
    np.save(tmp_path / "grey.npy", grey)
    save_sensor(tmp_path / "colour.yaml", SensorParameters(colour_pattern="RGGB"))
    frames, out, sensor = (str(tmp_path / name) for name in ("grey.npy", "out", "colour.yaml"))
    assert main(["frames", frames, "--fps", "100", "-o", out, "--sensor", sensor]) == 0
    assert "the sensor's colour filters are left out: the frames are grey" in capsys.readouterr().err
    assert json.loads((tmp_path / "out" / "meta.json").read_text())["parameters"]["colour_filter"] is None


def test_the_command_writes_raw_images_and_records_the_filter(tmp_path: Path) -> None:
    """The images are those of a grey clip of what the pixels see."""
    raw = np.stack([mosaic(frame, ColourFilter("GRBG")) for frame in FRAMES]).astype(np.float32)
    np.save(tmp_path / "colour.npy", FRAMES)
    np.save(tmp_path / "raw.npy", raw)
    for name, options in (("colour", ["--colour-filter", "GRBG"]), ("raw", [])):
        frames, out = str(tmp_path / f"{name}.npy"), str(tmp_path / name)
        assert main(["frames", frames, "--fps", "100", "-o", out, "--quiet", *options]) == 0
    images, expected = (Dataset(tmp_path / name).frames for name in ("colour", "raw"))
    assert len(images) == len(FRAMES)
    assert [frame.path.read_bytes() for frame in images] == [frame.path.read_bytes() for frame in expected]
    described = json.loads((tmp_path / "colour" / "meta.json").read_text())["parameters"]["colour_filter"]
    assert described["pattern"] == "GRBG"
