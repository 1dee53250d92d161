"""The rays of a pixel, the weights of luma, and the blur."""

from __future__ import annotations

from math import gcd

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.ndimage import convolve

from davis_rs.events.luma import LUMA_WEIGHTS, LumaFrames, blur_3x3
from davis_rs.geometry.camera import PRESETS, Camera
from davis_rs.geometry.lattice import rank1_lattice, spectral_error
from davis_rs.geometry.pose import FloatArray
from davis_rs.render.rays.camera_rays import ray_table


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 8, 16, 30, 64, 100, 1024])
def test_lattice_points_fill_the_pixel_around_its_centre(n: int) -> None:
    """n points inside the open pixel, n different abscissas and ordinates (rank 1, coprime), mean at the centre."""
    points = rank1_lattice(n)
    assert points.shape == (n, 2)
    assert np.abs(points).max() < 0.5
    np.testing.assert_allclose(points.mean(0), 0, atol=1e-12)
    for axis in (0, 1):
        np.testing.assert_allclose(np.sort(points[:, axis]), (np.arange(n) + 0.5) / n - 0.5, atol=1e-12)


@pytest.mark.parametrize("n", [4, 8, 16, 31])
def test_lattice_is_the_best_of_rank_one(n: int) -> None:
    """No other generator coprime to n keeps its points farther apart on the torus (all pairs compared)."""

    def least_distance(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
        offset = np.abs(points[:, None] - points[None])
        distance = np.hypot(*np.moveaxis(np.minimum(offset, 1 - offset), -1, 0))
        return float(distance[~np.eye(n, dtype=bool)].min())

    i = np.arange(n)
    rivals = [np.stack([i, i * g % n], 1) / n for g in range(1, n) if gcd(g, n) == 1]
    assert least_distance(rank1_lattice(n)) >= max(map(least_distance, rivals)) - 1e-12


@pytest.mark.parametrize(("n", "generator"), [(8, 3), (13, 5), (32, 7), (64, 19)])
def test_the_farthest_lattice_stays_where_no_other_errs_half_as_much(n: int, generator: int) -> None:
    """The numbers of rays of the presets keep the generator whose points are farthest apart."""
    assert rank1_lattice(n)[1].tolist() == [1.5 / n - 0.5, (generator + 0.5) / n - 0.5]


@pytest.mark.parametrize(("n", "farthest"), [(233, 16), (377, 36), (512, 67), (1024, 271)])
def test_large_lattices_integrate_waves(n: int, farthest: int) -> None:
    """They err at most half as much as the generator of largest distance, over waves whose integrals are summed one by
    one."""
    i = np.arange(n)
    rival = (np.stack([i, i * farthest % n], 1) + 0.5) / n - 0.5
    points = rank1_lattice(n)

    def waves(points: FloatArray) -> float:
        total = 0.0
        for a in range(-10, 11):
            for b in range(-10, 11):
                exact = np.prod([np.sin(np.pi * k / 2) / (np.pi * k / 2) if k else 1.0 for k in (a, b)])
                total += abs(np.exp(1j * np.pi * points @ [a, b]).mean() - exact) ** 2 / (1 + a * a + b * b)
        return total

    assert spectral_error(points) == pytest.approx(waves(points), rel=1e-9)
    assert waves(points) < 0.5 * waves(rival)


def test_one_ray_goes_through_the_centre() -> None:
    """With one sample a pixel the lattice is the pixel's centre, exactly."""
    assert rank1_lattice(1).tolist() == [[0.0, 0.0]]


def test_the_lattice_is_fixed() -> None:
    """Every call gives the same points, and no caller can change them for the others."""
    assert np.array_equal(rank1_lattice(8), rank1_lattice(8))
    with pytest.raises(ValueError, match="read-only"):
        rank1_lattice(8)[0, 0] = 0.0


@pytest.mark.parametrize("n", [0, -1, 1025])
def test_sample_counts_out_of_range_are_refused(n: int) -> None:
    """Sample counts outside of 1..1024 raise ValueError with the rule and the value."""
    with pytest.raises(ValueError, match=rf"1\.\.1024, got {n}"):
        rank1_lattice(n)


@pytest.mark.parametrize("camera", [Camera(5, 3, 4.0, 5.0, 1.7, 1.2), PRESETS["davis240c"]])
def test_rays_of_the_table_run_row_by_row(camera: Camera) -> None:
    """ray_table() holds, for sample s and pixel (x, y), the ray through (x, y) + lattice point s at row y W + x."""
    table = ray_table(camera, 4)
    assert table.shape == (4, camera.width * camera.height, 2)
    for s, x, y in ((0, 0, 0), (1, 4, 0), (2, 1, 2), (3, 4, 2)):
        seen = camera.project([*table[s, y * camera.width + x], 1.0])
        np.testing.assert_allclose(seen, (x, y) + rank1_lattice(4)[s], atol=1e-9)


def test_luma_weights_are_those_of_bt601() -> None:
    """0.299, 0.587, 0.114: BT.601, not the BT.709 weights of Mitsuba's own luminance."""
    assert LUMA_WEIGHTS == (0.299, 0.587, 0.114)


frames = hnp.arrays(
    np.float32,
    st.tuples(st.integers(1, 3), st.integers(1, 7), st.integers(1, 7)),
    elements=st.floats(0, 1e3, width=32),
)


@given(luma=frames)
def test_blur_is_the_gaussian_of_the_datasets_simulator(luma: LumaFrames) -> None:
    """[1 2 1] x [1 2 1] / 16 with the edge mirrored (not repeated), frame by frame, in float32."""
    kernel = np.outer([1, 2, 1], [1, 2, 1]) / 16
    expected = np.stack([convolve(frame.astype(np.float64), kernel, mode="mirror") for frame in luma])
    blurred = blur_3x3(luma)
    assert blurred.dtype == np.float32
    np.testing.assert_allclose(blurred, expected, rtol=1e-6, atol=1e-4)


@given(luma=frames)
def test_blur_of_a_frame_knows_no_other(luma: LumaFrames) -> None:
    """A frame's blur has the same bits alone and together with others, and the input is not changed."""
    before = luma.copy()
    together = blur_3x3(luma)
    for index in range(len(luma)):
        assert np.array_equal(blur_3x3(luma[index : index + 1])[0], together[index])
    assert np.array_equal(luma, before)
