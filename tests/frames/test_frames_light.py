"""Light from values: transfer functions, white levels, and what grey levels do in the dark."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs import events_from_frames
from davis_rs.events import EVENT_DTYPE
from davis_rs.frames_to_events.frame_source import Encoding
from davis_rs.frames_to_events.light import Light, parse_transfer
from davis_rs.frames_to_events.quantisation import QuantisationCount, dark_level


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
    assert sum(len(packet.events) for packet in events_from_frames(frames, **settings)) == 0
    loud = events_from_frames(frames, **settings, log_eps=1e-3)
    assert sum(len(packet.events) for packet in loud) >= 16 * 19
    # Linear 8 bits are worse: all of the lower levels are large steps.
    assert sum(len(p.events) for p in events_from_frames(frames, **settings, transfer="linear")) == 0


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
