"""Light from values: transfer functions, white levels, and what grey levels do in the dark."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import davis_rs
from clips import write_images
from davis_rs import Frame, FrameValuesWarning, NoEventsWarning, events_from_frames, frames_to_folder, open_frames
from davis_rs.events.arrays import EVENT_DTYPE, EventArray, concatenate_events
from davis_rs.simulation.from_frames.frame_source import Encoding
from davis_rs.simulation.from_frames.frame_values import FrameValues
from davis_rs.simulation.from_frames.light import Light, parse_transfer
from davis_rs.simulation.from_frames.quantisation import QuantisationCount, dark_level
from recording_files import aedat4, aedat4_frame, aedat4_xml


def light(dtype: Any, transfer: str | None = None, white_level: float | None = None) -> Light:
    return Light(Encoding.of(np.dtype(dtype), "test"), transfer, white_level)


def test_the_curves_are_those_of_the_standards() -> None:
    """Values of IEC 61966-2-1 and of BT.709-6, worked out by their encoding formulas, the other way round."""
    linear = np.array([0.0, 0.001, 0.0031308, 0.01, 0.018, 0.18, 0.5, 1.0])
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    rec709 = np.where(linear < 0.018, 4.5 * linear, 1.099 * linear**0.45 - 0.099)
    # The standards round their constants, so their two pieces meet to about 1e-4 of full scale.
    assert np.allclose(parse_transfer("srgb")(srgb), linear, rtol=1e-9, atol=3e-8)
    assert np.allclose(parse_transfer("rec709")(rec709), linear, rtol=1e-9, atol=3e-4)
    assert np.allclose(parse_transfer("rec709")(np.array([4.5 * 0.01])), 0.01)
    assert np.allclose(parse_transfer("gamma=2.2")(np.array([0.0, 0.5])), [0, 0.5**2.2])
    assert np.array_equal(parse_transfer("linear")(linear), linear)
    for name in ("sRGB", "gamma", "gamma=", "gamma=0", "gamma=20", "gamma=-1", "gamma=1e3", "pq"):
        with pytest.raises(ValueError, match=r"transfer must be .*, got"):
            parse_transfer(name)


def test_luma_has_the_weights_of_bt601_on_linear_light() -> None:
    colours = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [128, 128, 128]]], np.uint8)
    found = light(np.uint8).luma(colours, "test")[0]
    grey = ((128 / 255 + 0.055) / 1.055) ** 2.4
    assert np.allclose(found, [0.299, 0.587, 0.114, 1, grey], atol=1e-7)
    assert light(np.uint8).luma(colours[..., 0], "test")[0, 4] == pytest.approx(grey)


def test_sixteen_bits_float_and_white_levels() -> None:
    deep = np.array([[0, 65535, 32768]], np.uint16)
    assert np.allclose(light(np.uint16, "linear").luma(deep, "t"), [[0, 1, 32768 / 65535]])
    assert np.allclose(light(np.uint16, "linear", 4095).luma(np.array([[4095, 8190]], np.uint16), "t"), [[1, 2]])
    assert np.allclose(light(np.float32, None, 4.0).luma(np.array([[2.0, 8.0]]), "t"), [[0.5, 2]])
    for dtype in (np.float16, np.float32, np.float64):
        values = np.array([[0, 0.25, 40.0]], dtype)
        assert np.allclose(light(dtype).luma(values, "t"), values)  # linear, and HDR stays
    assert np.allclose(light(np.float32, "srgb").luma(np.array([[0.5]]), "t"), ((0.5 + 0.055) / 1.055) ** 2.4)
    colour = np.random.default_rng(0).random((3, 4, 3))
    assert np.allclose(light(np.float64).luma(colour, "t"), colour @ [0.299, 0.587, 0.114])
    with pytest.raises(ValueError, match="white_level must be > 0"):
        events_from_frames(np.zeros((2, 4, 4)), fps=1, white_level=0)


@given(
    st.sampled_from(["srgb", "rec709", "linear", "gamma=2.2"]),
    st.floats(0.01, 2.0),
    st.sampled_from([np.uint8, np.uint16]),
)
def test_with_the_default_dark_level_no_grey_level_is_as_much_as_c(transfer: str, c: float, dtype: Any) -> None:
    levels = light(dtype, transfer).levels
    assert levels is not None
    eps = dark_level(levels, c, 1e-3)
    assert np.diff(np.log(levels + eps)).max() < c
    if eps > 1e-3:  # and it is the least: a hundredth less would let one through
        assert np.diff(np.log(levels + 0.97 * eps)).max() > c * 0.98
    assert dark_level(None, c, 1e-3) == 1e-3


def test_flicker_of_one_grey_level_in_the_dark_makes_no_events() -> None:
    """With the dark level of a simulation it would make an event a frame."""
    frames = np.zeros((20, 4, 4), np.uint8)
    frames[1::2] = 1
    settings: dict[str, Any] = {"fps": 100, "interpolation": "linear"}

    def count(**more: Any) -> int:
        return sum(len(packet.events) for packet in events_from_frames(frames, **settings, **more))

    with pytest.warns(NoEventsWarning, match="0 events in 0.19 s: .* 0.15 in log intensity, and all frames .* 0.149"):
        assert count() == 0
    assert count(log_eps=1e-3) >= 16 * 19
    # Linear 8 bits are worse: all of the lower levels are large steps.
    with pytest.warns(NoEventsWarning):
        assert count(transfer="linear") == 0


def test_events_of_one_grey_level_are_counted() -> None:
    levels = light(np.uint8).levels
    assert levels is not None
    count = QuantisationCount(levels)
    before = levels[np.array([[10, 100, 200]])].astype(np.float32)
    after = levels[np.array([[11, 102, 199]])].astype(np.float32)
    events = np.array([(1, 0, 0, 1), (1, 1, 0, 1), (2, 2, 0, 0), (3, 2, 0, 0)], EVENT_DTYPE)
    count.add(events, before, after)
    assert (count.suspect, count.total) == (3, 4)
    assert str(count).startswith("3 of 4 events (75 %) came where the pixel changed by one grey level or less")
    none = QuantisationCount(None)
    none.add(events, before, after)
    assert (none.suspect, none.total, none.counts) == (0, 4, False)


def test_a_large_threshold_needs_no_more() -> None:
    assert math.isclose(dark_level(light(np.uint8).levels, 900.0, 1e-3), 1e-3)


SCENE = 0.02 + 0.9 * np.abs(np.sin(np.add.outer(0.031 * np.arange(40), 0.047 * np.arange(60)))) ** 3
"""Light in [0, 1] with many grey levels, most of them dark."""


def noisy_frames(bits: int = 8, count: int = 4) -> npt.NDArray[np.uint16]:
    """Integers (n, H, W) of a still scene with noise of about one grey level."""
    noise = np.random.default_rng(3).normal(0, 0.5, (count, *SCENE.shape))
    return np.rint(SCENE * ((1 << bits) - 1) + noise).clip(0, (1 << bits) - 1).astype(np.uint16)


def events_of(frames: Any, **settings: Any) -> EventArray:
    how: dict[str, Any] = {"fps": 25, "interpolation": "linear", "transfer": "linear", **settings}
    return concatenate_events([packet.events for packet in events_from_frames(frames, **how)])


def test_eight_bits_in_a_recording_make_the_events_of_eight_bit_images(tmp_path: Path) -> None:
    """``read_recording`` brings 8 bits to 16, in steps of 256. Noise of one grey level is no contrast in either."""
    eight = noisy_frames().astype(np.uint8)
    frames = [Frame(t, t, t + 500, t + 900, 0, 0, image.astype(np.uint16) << 8) for t, image in enumerate(eight)]
    file = tmp_path / "a.aedat4"
    xml = aedat4_xml(size=eight.shape[:0:-1])
    file.write_bytes(aedat4(*((1, aedat4_frame(frame)) for frame in frames), xml=xml))
    recorded = np.stack([frame.pixels for frame in davis_rs.read_recording(file).frames])
    assert np.array_equal(recorded, eight.astype(np.uint16) << 8)
    expected = events_of(eight)
    with pytest.warns(
        FrameValuesWarning, match=r"steps of 256 in the first frame, so that 65280 .* log_eps is 0\.0245"
    ):
        found = events_of(recorded)
    assert np.array_equal(found, expected)
    assert len(events_of(recorded, log_eps=1e-3)) > 1.5 * len(expected)  # what a step of 1 would give


@pytest.mark.parametrize("bits", [8, 10, 12, 14])
@pytest.mark.parametrize("how", ["shifted", "stretched"])
def test_the_steps_of_integers_are_found(bits: int, how: str) -> None:
    """Levels are those of the converter, whether its values were shifted to 16 bits or stretched and rounded."""
    values, most = noisy_frames(bits)[0], (1 << bits) - 1
    image = values << (16 - bits) if how == "shifted" else np.rint(values * (65535 / most)).astype(np.uint16)
    found = FrameValues(Encoding.of(image.dtype, "test"), image, white_level=None, log_eps=None)
    assert found.encoding.levels == pytest.approx(most, rel=0.003)
    assert found.encoding.white == (most << (16 - bits) if how == "shifted" else 65535)
    assert list(found.doubts()) == []


FEW = {
    "one value": np.full((9, 9), 25_600, np.uint16),
    "two values": np.where(np.eye(9) > 0, 51_200, 256).astype(np.uint16),
    "a chart of 17 shades": np.tile(np.arange(17, dtype=np.uint16) * 3840, (3, 1)),
    "a chart of 18 shades, 8 bits": np.tile(np.arange(18, dtype=np.uint8) * 15, (3, 1)),
    "values at random": np.random.default_rng(1).integers(0, 65536, (4, 5), np.uint16),
    "16 bits": noisy_frames(16)[0],
    "8 bits": noisy_frames(8)[0].astype(np.uint8),
}


@pytest.mark.parametrize("name", FEW)
def test_few_values_and_fine_ones_are_no_steps(name: str) -> None:
    """A drawn image uses few of its type's values: that says nothing of how finely it was digitised."""
    stated = Encoding.of(FEW[name].dtype, "test")
    found = FrameValues(stated, FEW[name], white_level=None, log_eps=None)
    assert found.encoding == stated
    assert not found.step_found
    assert list(found.doubts()) == []


def test_what_the_first_frame_cannot_show_is_said_at_the_end() -> None:
    """From black frames nothing can be told, and a title in 8 bits says nothing of the 16 bits that follow."""
    eight, sixteen = noisy_frames() << 8, noisy_frames(16)
    black = np.zeros_like(eight[:1])
    with pytest.warns(
        FrameValuesWarning, match=r"in steps of 256, and the first frame .* log_eps 0\.0245 fits .* 0\.001"
    ):
        late = events_of(np.concatenate([black, eight]))
    assert len(late) > 0
    with pytest.warns(FrameValuesWarning) as said:
        events_of(np.concatenate([eight, sixteen]))
    assert "values come in steps of 256 in the first frame" in str(said[0].message)
    assert "in steps of 1, and the first frame did not show it" in str(said[1].message)
    with warnings.catch_warnings():  # the user's own dark level needs neither
        warnings.simplefilter("error")
        events_of(np.concatenate([black, eight]), log_eps=0.02)
        events_of(np.concatenate([eight, sixteen]), log_eps=0.02)


def test_a_folder_of_16_bit_images_says_its_step_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = noisy_frames() << 8
    source = open_frames(write_images(tmp_path / "in", frames), fps=25)
    frames_to_folder(source, tmp_path / "out", interpolation="linear", transfer="linear")
    said = capsys.readouterr().err
    assert "values 0 to 65280 in steps of 256, as in the first frame, are luma 0 to 1, transfer linear (given)" in said
    assert "log_eps 0.0245: with 0.001 one grey level in the dark" in said
    meta = json.loads((tmp_path / "out" / "meta.json").read_text())
    assert meta["parameters"]["log_eps"] == pytest.approx(0.0245, abs=5e-5)
    assert [meta["frames"][key] for key in ("white_level", "value_step", "value_step_of_all_frames")] == [
        65280,
        256,
        256,
    ]


@pytest.mark.parametrize(
    ("frames", "remedy", "said"),
    [
        (noisy_frames(12), {"white_level": 4095}, r"65535 is taken for white, .* above 3\d\d\d: for 12 bits .* 4095"),
        (
            255 * (SCENE + 0.1 * np.eye(40, 60)[None]),
            {"white_level": 255},
            r"1 is taken for white, but values .* 2\d\d",
        ),
        (noisy_frames() / 255, {"log_eps": 0.02}, "multiples of white / 255"),
        (noisy_frames().astype(np.float32), {"white_level": 255, "log_eps": 0.02}, "1 is taken for white"),
    ],
    ids=["12 bits", "floating point to 255", "8 bits over 255", "8 bits as floating point"],
)
def test_a_doubtful_white_is_said(frames: npt.NDArray[Any], remedy: dict[str, Any], said: str) -> None:
    frames = np.concatenate([frames, frames[..., ::-1]])
    with pytest.warns(FrameValuesWarning, match=said) as warned:
        events_of(frames)
    assert len(warned) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        events_of(frames, **remedy)


def test_a_lamp_may_be_brighter_than_white() -> None:
    frames = np.stack([SCENE, SCENE[:, ::-1]])
    frames[:, 10:14, 20:24] = 50.0
    assert len(events_of(frames)) > 0  # a warning would be an error
