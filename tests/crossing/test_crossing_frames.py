"""Frames and parameters at the crossing engine's door: what it takes, in any layout, and what it refuses."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import EVENT_DTYPE, CrossingEngine, log_intensity, reconstruct
from strategies import random_paths

LumaFrame = npt.NDArray[np.float32]
Frame = npt.NDArray[np.floating[Any]]


def layouts(frame: LumaFrame) -> dict[str, Frame]:
    """The same values in every layout that ``push`` takes."""
    height, width = frame.shape
    wide = np.full((height * 2, width * 3), np.float32(np.nan))
    wide[1::2, ::3] = frame
    read_only = frame.copy()
    read_only.flags.writeable = False
    return {
        "F order": np.asfortranarray(frame),
        "strided": wide[1::2, ::3],
        "reversed": frame[::-1, ::-1].copy()[::-1, ::-1],
        "read-only": read_only,
        "float64": frame.astype(np.float64),
        "float64, F order": np.asfortranarray(frame.astype(np.float64)),
        "big-endian": frame.astype(">f4"),
        "big-endian float64": frame.astype(">f8"),
    }


@pytest.mark.parametrize("layout", list(layouts(np.zeros((1, 1), np.float32))))
def test_any_layout_of_a_frame_gives_the_same_events(layout: str) -> None:
    """F order, strides, read-only memory and float64 are taken as the values that they hold, and left untouched."""
    frames = np.exp(random_paths(12, 3)).astype(np.float32).reshape(3, 3, 4)
    plain, other = CrossingEngine(4, 3), CrossingEngine(4, 3)
    plain_log, other_log = CrossingEngine(4, 3), CrossingEngine(4, 3)
    for i, frame in enumerate(frames):
        array = layouts(frame)[layout]
        before = (array.tobytes(), array.flags.writeable)
        assert other.push(i * 100, array).tobytes() == plain.push(i * 100, frame).tobytes()
        assert other_log.push_log(i * 100, array).tobytes() == plain_log.push_log(i * 100, frame).tobytes()
        assert (array.tobytes(), array.flags.writeable) == before
    assert (plain.last_event_us >= 0).any()


def test_a_misaligned_frame_is_taken() -> None:
    """A frame at an odd address, as in a file mapped after its header, is a float32 frame like any other."""
    memory = np.zeros(4 * 6 + 1, np.uint8)
    frame = memory[1:].view(np.float32).reshape(2, 3)
    frame[:] = 0.5
    assert not frame.flags.aligned
    engine = CrossingEngine(3, 2)
    engine.push(0, frame)
    np.testing.assert_array_equal(engine.reference, log_intensity(np.full((2, 3), 0.5, np.float32), 1e-3))


def test_float32_log_intensity_is_taken_as_it_is() -> None:
    """push_log widens float32 without a loss: its values are the float64 ones."""
    frame = np.array([[0.1, 0.7]], np.float32)
    engine = CrossingEngine(2, 1)
    engine.push_log(0, frame)
    assert engine.reference.tolist() == [[float(np.float32(0.1)), float(np.float32(0.7))]]


def test_results_are_copies_that_belong_to_the_caller() -> None:
    """Writing into returned references, surfaces or pushed frames changes nothing in the engine."""
    engine = CrossingEngine(1, 1)
    frame = np.ones((1, 1), np.float32)
    engine.push(0, frame)
    frame[:] = 100
    engine.reference[:] = 100.0
    engine.last_event_us[:] = 100
    assert engine.last_event_us.tolist() == [[-1]]
    assert len(engine.push(1, np.ones((1, 1), np.float32))) == 0


# ---- what is refused, and that it changes nothing ----


def spoiled(frame: Frame, value: float) -> Frame:
    """A copy with a bad value at (x, y) = (1, 2) and another further on, where the error need not look."""
    bad = frame.copy()
    bad[2, 1] = bad[3, 2] = value
    return bad


@pytest.mark.parametrize("good_frames", [0, 1, 3])
def test_a_refused_frame_leaves_the_engine_as_it_was(good_frames: int) -> None:
    """After any refusal the next good frame gives what it would have given, for the first frame and for later ones."""
    frames = np.exp(random_paths(12, 6)).astype(np.float32).reshape(6, 4, 3)
    engine, untroubled = CrossingEngine(3, 4), CrossingEngine(3, 4)
    for i in range(good_frames):
        engine.push(100 + i, frames[i])
        untroubled.push(100 + i, frames[i])
    good, pixel = frames[5], r"pixel \(x, y\) = \(1, 2\) of the frame at t = 500 us"
    for value, shown in ((np.nan, "NaN"), (np.inf, "inf"), (-np.inf, "-inf"), (-1e-30, "-")):
        with pytest.raises(ValueError, match=rf"luma must be finite and >= 0, got {shown}.* at {pixel}"):
            engine.push(500, spoiled(good, value))
    for value in (np.nan, np.inf, -np.inf, 746.5, -1e300):
        with pytest.raises(ValueError, match=rf"log intensity must lie within \+-746, got .* at {pixel}"):
            engine.push_log(500, spoiled(good, 0).astype(np.float64) + np.where(good == spoiled(good, 0), 0, value))
    for wrong in (good.T, good[None], good.ravel(), good[:, :2], np.zeros((0, 0), np.float32)):
        with pytest.raises(ValueError, match=r"must have shape \(4, 3\), got"):
            engine.push(500, wrong)
    for dtype in (np.uint8, np.int64, np.float16, np.complex64, np.bool_, object):
        with pytest.raises(ValueError, match="must be float32 or float64, got"):
            engine.push(500, good.astype(dtype))
    with pytest.raises(ValueError, match="must be a NumPy array, got"):
        engine.push(500, good.tolist())
    for late in {-1, *(() if good_frames == 0 else (100, 100 + good_frames - 1))}:
        with pytest.raises(ValueError, match=rf"got {late} us"):
            engine.push(late, good)
    assert engine.reference.tobytes() == untroubled.reference.tobytes()
    assert engine.last_event_us.tobytes() == untroubled.last_event_us.tobytes()
    for i in range(good_frames, 6):
        assert engine.push(100 + i, frames[i]).tobytes() == untroubled.push(100 + i, frames[i]).tobytes()


@pytest.mark.parametrize(("value", "shown"), [(-1e-60, "-"), (1e39, "inf"), (-1e39, "-inf"), (np.nan, "NaN")])
def test_float64_luma_is_refused_for_what_it_is(value: float, shown: str) -> None:
    """Rounding to float32 hides neither a sign nor an overflow, and nothing but the error is said."""
    engine = CrossingEngine(3, 4)
    frame = spoiled(np.ones((4, 3)), value)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match=f"luma must be finite and >= 0, got {shown}"):
            engine.push(0, frame)


def test_a_time_that_no_integer_holds_is_a_values_error() -> None:
    """As every other time out of range; a time that is no number is a TypeError."""
    engine = CrossingEngine(1, 1)
    for t_us in (1 << 63, -(1 << 63) - 1, 10**30):
        with pytest.raises(ValueError, match=rf"must lie in 0..2\^63 us, got {t_us}"):
            engine.push(t_us, np.ones((1, 1), np.float32))
    with pytest.raises(TypeError):
        engine.push("now", np.ones((1, 1), np.float32))  # type: ignore[arg-type]


def test_times_must_increase_and_the_error_tells_both() -> None:
    """A frame at or before the last one is refused, with both times."""
    engine = CrossingEngine(1, 1)
    frame = np.ones((1, 1), np.float32)
    engine.push(1_000, frame)
    for t_us in (1_000, 999, 0):
        with pytest.raises(ValueError, match=rf"must be after the last one \(1000 us\), got {t_us} us"):
            engine.push(t_us, frame)
    with pytest.raises(ValueError, match=r"less than 2\^53 us apart, got 1000 us and 9007199254741992 us"):
        engine.push((1 << 53) + 1_000, frame)
    engine.push((1 << 53) + 999, frame)


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        ({"contrast_threshold": 0.0}, "contrast_threshold must lie in"),
        ({"contrast_threshold": -0.15}, "contrast_threshold must lie in"),
        ({"contrast_threshold": math.nan}, "contrast_threshold must lie in"),
        ({"contrast_threshold": math.inf}, "contrast_threshold must lie in"),
        ({"contrast_threshold_off": 0.0}, "contrast_threshold_off must lie in"),
        ({"contrast_threshold_off": math.nan}, "contrast_threshold_off must lie in"),
        ({"log_eps": 0.0}, "log_eps"),
        ({"log_eps": -1e-3}, "log_eps"),
        ({"log_eps": math.nan}, "log_eps"),
        ({"log_eps": math.inf}, "log_eps"),
        ({"log_eps": 1e-301}, "log_eps"),
        ({"threads": 0}, r"threads must lie in 1\.\.1024, got 0"),
        ({"width": 0}, "at least one pixel, got 0 x 2"),
        ({"height": 0}, "at least one pixel, got 3 x 0"),
    ],
)
def test_parameters_out_of_range_are_refused(arguments: dict[str, Any], rule: str) -> None:
    """A ValueError that names the parameter."""
    with pytest.raises(ValueError, match=rule):
        CrossingEngine(**{"width": 3, "height": 2, **arguments})


def test_parameters_are_keywords_and_c_off_is_c_on_unless_given() -> None:
    """Thresholds cannot be swapped by position, and None means a symmetric pixel."""
    with pytest.raises(TypeError, match="positional"):
        CrossingEngine(3, 2, 0.15)  # type: ignore[call-arg]
    symmetric = CrossingEngine(1, 1, contrast_threshold=0.25)
    symmetric.push_log(0, np.zeros((1, 1)))
    assert symmetric.push_log(4, np.full((1, 1), -1.0))["t"].tolist() == [1, 2, 3, 4]


def test_reconstruct_refuses_what_it_cannot_place() -> None:
    """An event outside of the frame and thresholds out of range are errors; events after t_us are not looked at."""
    events = np.array([(10, 1, 0, 1), (20, 2, 0, 1)], EVENT_DTYPE)
    first = np.zeros((1, 2))
    np.testing.assert_array_equal(reconstruct(events, first, 10, 0.5), [[0.0, 0.5]])
    with pytest.raises(ValueError, match=r"event 1 at \(x, y\) = \(2, 0\) lies outside of the 2 x 1 sensor"):
        reconstruct(events, first, 20, 0.5)
    with pytest.raises(ValueError, match="contrast_threshold_off must lie in"):
        reconstruct(events, first, 20, 0.5, 0.0)
    with pytest.raises(ValueError, match="must have shape"):
        reconstruct(events, np.zeros(2), 20, 0.5)
