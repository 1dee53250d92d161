"""L = ln(luma + log_eps): accurate to an ulp, and the same bits everywhere."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from davis_rs import log_intensity
from strategies import EXAMPLES

LARGEST = float(np.finfo(np.float32).max)


@pytest.fixture(autouse=True)
def many_digits() -> Iterator[None]:
    with mpmath.workdps(60):
        yield


def error_ulps(found: float, argument: float) -> float:
    """Distance of ``found`` from ln(argument), in ulps of the exact logarithm."""
    exact = mpmath.log(mpmath.mpf(argument))
    return float(abs(mpmath.mpf(found) - exact) / mpmath.mpf(math.ulp(float(exact))))


@EXAMPLES
@given(
    st.lists(st.floats(0, LARGEST, width=32), min_size=1, max_size=20),
    st.one_of(st.sampled_from([1e-3, 1e-9, 1.0, 1e-300]), st.floats(1e-12, 10.0)),
)
@example([0.0, -0.0, 1e-45, 1.1754943508222875e-38, 1.0, LARGEST], 1e-3)
@example([0.0, 1e-45], 1e-300)
@example([0.999, 0.9990000128746033, 0.9989999532699585], 1e-3)
def test_within_one_ulp_of_the_exact_logarithm(luma: list[float], log_eps: float) -> None:
    """Against 60 digits, the argument being luma + log_eps as float64 adds them."""
    frame = np.array([luma], np.float32)
    for y, found in zip(frame[0].astype(np.float64), log_intensity(frame, log_eps)[0], strict=True):
        assert error_ulps(float(found), float(y) + log_eps) < 1


def test_within_one_ulp_where_the_logarithm_is_hardest() -> None:
    """Close to 1, where it goes through zero, and close to every power of two, where its reduction changes over."""
    near_one = 1 + np.arange(-300, 300) * np.finfo(np.float32).eps
    powers = 2.0 ** np.arange(-60, 60)
    arguments = np.concatenate([near_one, powers, powers * math.sqrt(0.5)]).astype(np.float32)
    found = log_intensity(arguments[None, :], 1e-300)[0]
    assert max(error_ulps(float(f), float(y)) for f, y in zip(found, arguments, strict=True)) < 1
    assert log_intensity(np.ones((1, 1), np.float32), 1e-300).tolist() == [[0.0]]


def test_the_same_bits_on_every_machine() -> None:
    """The logarithms of 200,000 lumas from 1e-30 to 1e30, by their digest: no C library's or processor's own."""
    mantissas = (np.arange(200_000, dtype=np.uint64) * 2_654_435_761 % (1 << 23)).astype(np.uint32)
    exponents = (np.arange(200_000, dtype=np.uint32) % 200 + 27) << 23
    luma = (mantissas | exponents).view(np.float32).reshape(400, 500)
    digest = hashlib.sha256(log_intensity(luma, 1e-3).astype("<f8").tobytes()).hexdigest()
    assert digest == "d41833e4237c2379317ad922f70200cb348349644d47d6f0c246a0451c71d69e"


def test_any_layout_gives_the_same_logarithms() -> None:
    """F order, strides, read-only memory and float64 are taken as the values they hold, and left untouched."""
    luma = np.linspace(0, 3, 12, dtype=np.float32).reshape(3, 4)
    expected = log_intensity(luma, 1e-3)
    assert expected.shape == (3, 4)
    assert expected.dtype == np.float64
    wide = np.repeat(luma, 2, axis=1)
    read_only = luma.copy()
    read_only.flags.writeable = False
    for array in (np.asfortranarray(luma), wide[:, ::2], read_only, luma.astype(np.float64)):
        before = array.tobytes()
        np.testing.assert_array_equal(log_intensity(array, 1e-3), expected)
        assert array.tobytes() == before


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1e-45, -1.0])
def test_luma_that_has_no_logarithm_is_refused_with_its_pixel(value: float) -> None:
    """NaN, infinite or negative luma is an error that names the first such pixel."""
    luma = np.ones((3, 4), np.float32)
    luma[1, 2] = luma[2, 0] = value
    with pytest.raises(ValueError, match=r"luma must be finite and >= 0, got .* at pixel \(x, y\) = \(2, 1\)$"):
        log_intensity(luma, 1e-3)


@pytest.mark.parametrize("log_eps", [0.0, -1e-3, math.nan, math.inf, 1e-301, 1e301])
def test_a_dark_level_out_of_range_is_refused(log_eps: float) -> None:
    """log_eps = 0 would make black minus infinity; subnormal or near the largest float, the logarithm inexact."""
    with pytest.raises(ValueError, match="log_eps"):
        log_intensity(np.ones((1, 1), np.float32), log_eps)


def test_wrong_arrays_are_refused() -> None:
    """Integers, lists and other shapes are errors, not guesses."""
    with pytest.raises(ValueError, match="must be float32 or float64, got uint8"):
        log_intensity(np.ones((1, 1), np.uint8), 1e-3)
    with pytest.raises(ValueError, match="must be a NumPy array"):
        log_intensity([[1.0]], 1e-3)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"must have shape \(height, width\)"):
        log_intensity(np.ones(3, np.float32), 1e-3)
