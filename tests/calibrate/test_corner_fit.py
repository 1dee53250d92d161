"""Corners of a checkerboard are fitted to what pixels integrate."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs.calibrate.camera.corner_fit import _model, fit_corners

FloatArray = npt.NDArray[np.float64]

SIZE, HALF, FINE = 21, 5, 24


def crossing(corner: FloatArray, angles: FloatArray, *, bend: float = 0.0, reverse: bool = False) -> FloatArray:
    """The mean light of each pixel (SIZE, SIZE) where two sharp edges cross, by many points a pixel."""
    offsets = (np.arange(SIZE * FINE) + 0.5) / FINE - 0.5
    dx, dy = offsets[None] - corner[0], offsets[:, None] - corner[1]
    sides = []
    for angle in angles:
        along, across = np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx
        sides.append(across > bend * along**2)
    light = np.where((sides[0] == sides[1]) != reverse, 200.0, 20.0)
    return np.asarray(light.reshape(SIZE, FINE, SIZE, FINE).mean((1, 3)))


def random_corner(random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Anywhere in a pixel, at any angle; the edges cross at 60 to 120 degrees."""
    first = random.uniform(-np.pi, np.pi)
    return 10 + random.uniform(-0.5, 0.5, 2), np.array([first, first + np.radians(random.uniform(60, 120))])


def fitted_off(seed: int, *, bend: float = 0.0, noise: float = 0.0, reverse: bool = False) -> FloatArray:
    """By how much a corner is off that was first known to 0.3 px, and its edges to 6 degrees."""
    random = np.random.default_rng(seed)
    corner, angles = random_corner(random)
    light = crossing(corner, angles, bend=bend, reverse=reverse)
    image = np.clip(np.round(light + noise * random.standard_normal(light.shape)), 0, 255).astype(np.uint8)
    start = corner + 0.3 * random.uniform(-1, 1, 2)
    near = angles + np.radians(6) * random.uniform(-1, 1, 2)
    return np.asarray(fit_corners(image, start[None], near[None], HALF)[0] - corner)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("bend", [0.0, 0.004, -0.004])
def test_a_corner_is_found_to_hundredths_of_a_pixel(bend: float, reverse: bool) -> None:
    """Wherever it lies in its pixel and however its edges lie, straight or bent: 0.004 px rms, without a bias."""
    off = np.array([fitted_off(seed, bend=bend, reverse=reverse) for seed in range(60)])
    assert np.sqrt(np.mean(off**2)) < 0.004
    assert np.abs(off).max() < 0.03
    assert np.abs(off.mean(0)).max() < 0.002


def test_noise_moves_it_little() -> None:
    """By 5 levels of 180 between dark and bright: 0.02 px rms."""
    off = np.array([fitted_off(seed, noise=5.0) for seed in range(60)])
    assert 0.005 < np.sqrt(np.mean(off**2)) < 0.02


def test_derivatives_are_those_of_the_model() -> None:
    """Each of the eleven, against central differences."""
    state = np.array([[0.2, -0.1, 0.4, 1.9, 0.7, 100.0, 60.0, 2.0, -3.0, 0.01, -0.02]])
    offsets = (np.arange(3 * 7) + 0.5) / 3 - 3.5
    y, x = (axis.ravel() for axis in np.meshgrid(offsets, offsets, indexing="ij"))
    derivative = _model(state, x, y, 3)[1][0]
    for number in range(11):
        step = np.zeros_like(state)
        step[0, number] = 1e-5
        difference = (_model(state + step, x, y, 3)[0] - _model(state - step, x, y, 3)[0])[0] / 2e-5
        np.testing.assert_allclose(derivative[:, number], difference, atol=1e-5 * np.abs(difference).max())


def test_corners_are_kept_where_the_fit_leads_nowhere() -> None:
    """Where there is no corner, or another one than the one meant; others beside them are fitted nevertheless."""
    corner, angles = np.array([10.2, 9.7]), np.array([0.3, 1.8])
    image = np.full((SIZE, 3 * SIZE), 77, np.uint8)
    image[:, :SIZE] = np.round(crossing(corner, angles))
    image[:, 2 * SIZE :] = np.round(crossing(corner + np.array([0.9, 0.0]), angles))
    starts = np.array([corner + 0.2, corner + np.array([SIZE, 0]), corner + np.array([2 * SIZE, 0])])
    found = fit_corners(image, starts, np.tile(angles, (3, 1)), HALF)
    np.testing.assert_allclose(found[0], corner, atol=0.02)
    assert np.array_equal(found[1:], starts[1:])


def test_a_corner_next_to_the_border_is_fitted_within_the_image() -> None:
    """Its window is moved inwards."""
    corner, angles = np.array([10.3, 10.1]), np.array([0.2, 1.7])
    image = np.round(crossing(corner, angles)).astype(np.uint8)[7:, 7:]
    found = fit_corners(image, corner[None] - 7 + 0.1, angles[None], HALF)
    np.testing.assert_allclose(found[0], corner - 7, atol=0.02)
