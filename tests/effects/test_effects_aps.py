"""Frames of active pixels: motion blur that loses no light, and the noise, the steps and the end of an ADC."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from davis_rs import Flicker, LightProfile, SampledProfile, Scene, SegmentTrajectory, Trajectory
from davis_rs.geometry.pose import Pose
from davis_rs.render.choice import make_renderer
from davis_rs.sampling.exposure import SUBFRAME_PX, KeyframeExposure, expose, subframe_instants
from davis_rs.sampling.keyframes import Stretch
from davis_rs.sensor.effects.aps import Aps
from long_form import long_values
from stretches import CAMERA, DOWN, NARROW, built_in, shift, stretch

SIGNIFICANCE = 1e-6
SIZE = (180, 240)
MIDDLE = Pose([0.0, 0.0, 3.0], DOWN.quaternion)
PIXEL_M = 3.0 / NARROW.fx
"""A pixel at the distance of the line."""

SUN = {"type": "directional", "direction": [0.0, 0.0, -1.0], "irradiance": 3.0}
IDEAL = Aps(0, read_noise_dn=0, bits=None, full_scale_luma=None)


def line(lights: dict[str, LightProfile] | None = None, objects: dict[str, Trajectory] | None = None) -> Scene:
    """A bright upright line, as wide as a pixel, before nothing."""
    parts: dict[str, Any] = {
        "type": "scene",
        "sun": SUN,
        "line": {
            "type": "rectangle",
            "to_world": np.diag([PIXEL_M / 2, 5.0, 1.0, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": 0.8},
        },
    }
    return Scene("line", partial(dict, parts), shadows=False, lights=lights or {}, objects=objects or {})


def across(pixels: float, duration_s: float = 0.01) -> SegmentTrajectory:
    """A path that carries the line so far through the image."""
    start = Pose([-pixels / 2 * PIXEL_M, 0.0, 3.0], DOWN.quaternion)
    return shift([pixels * PIXEL_M, 0.0, 0.0], duration_s, start)


def seen(part: Stretch, t_us: int) -> npt.NDArray[np.float32]:
    return part.renderer.luma(part.views([t_us]))[0]


def exposed(parts: list[Stretch], t_us: int, exposure_us: int) -> npt.NDArray[np.float64]:
    return expose(seen(parts[-1], t_us), parts, t_us, exposure_us)


def width_at_half(profile: npt.NDArray[np.float64]) -> float:
    """Between the points where a profile without dents passes half of its height."""
    half, place = profile.max() / 2, np.arange(len(profile))
    top = int(np.flatnonzero(profile > half)[0]), int(np.flatnonzero(profile > half)[-1])
    left = np.interp(half, profile[top[0] - 1 : top[0] + 1], place[top[0] - 1 : top[0] + 1])
    right = np.interp(-half, -profile[top[1] : top[1] + 2], place[top[1] : top[1] + 2])
    return float(right - left)


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("moving", ["camera", "object"])
def test_a_line_that_moves_five_pixels_blurs_over_five_pixels(moving: str) -> None:
    """A box five pixels long through a pixel's square: five wide at half height, a fifth as bright, no light lost."""
    if moving == "camera":
        scene, path = line(), across(5.0)
    else:
        left = Pose([-2.5 * PIXEL_M, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
        scene, path = line(objects={"line": shift([5 * PIXEL_M, 0.0, 0.0], 0.01, left)}), across(0.0)
    part = stretch(make_renderer(scene, NARROW, rays_per_pixel=64), path)
    sharp, blurred = seen(part, 5_000)[15].astype(np.float64), exposed([part], 10_000, 10_000)[15]
    assert sharp.sum() == pytest.approx(0.8 / np.pi * 3.0, rel=0.02)
    assert np.count_nonzero(sharp > 0.01) <= 2
    assert blurred.sum() == pytest.approx(sharp.sum(), rel=0.005)
    assert width_at_half(blurred) == pytest.approx(5.0, abs=0.1)
    lit = np.flatnonzero(blurred > 0.002 * sharp.max())
    assert lit[-1] - lit[0] + 1 in (6, 7)
    middle = blurred[lit[0] + 2 : lit[-1] - 1]
    np.testing.assert_allclose(middle, sharp.sum() / 5, rtol=0.02)
    assert abs((blurred @ np.arange(40)) / blurred.sum() - NARROW.cx) < 0.05


@pytest.mark.usefixtures("llvm")
def test_a_blurred_frame_is_the_mean_over_its_window() -> None:
    """Pixel by pixel that of renders far closer, and of its own sub-frames within rounding."""
    renderer, path = built_in("three_planes", NARROW)
    part = stretch(renderer, path)
    frame = exposed([part], 150_000, 100_000)
    own = renderer.luma(part.views(subframe_instants(part, 50_000, 150_000))).astype(np.float64)
    assert len(own) > 10
    np.testing.assert_allclose(frame, own.mean(0), rtol=1e-12)
    assert frame.mean() == pytest.approx(own.mean(), rel=1e-12)
    close = renderer.luma(part.views(50_000 + np.arange(500, 100_000, 1000))).astype(np.float64).mean(0)
    assert frame.mean() == pytest.approx(close.mean(), rel=1e-3)
    instant = seen(part, 100_000)
    assert np.abs(frame - close).max() < 0.01 * close.max()
    assert np.sqrt(((frame - close) ** 2).mean()) < 0.03 * np.sqrt(((instant - close) ** 2).mean())


@pytest.mark.usefixtures("llvm")
def test_sub_frames_are_as_many_as_flow_and_exposure_need() -> None:
    """Middles of equal parts, each no more than half a pixel of the fastest pixel's motion; at rest a single one."""
    renderer = make_renderer(line(), NARROW, rays_per_pixel=1)
    for pixels, exposure_us in ((5.0, 10_000), (12.5, 10_000), (12.5, 4_000), (0.3, 10_000), (0.0, 10_000)):
        instants = subframe_instants(stretch(renderer, across(pixels)), 10_000 - exposure_us, 10_000)
        needed = pixels * exposure_us / 10_000 / SUBFRAME_PX
        assert max(1, needed) <= len(instants) <= needed + 2
        middles = 10_000 - exposure_us * (1 - (np.arange(len(instants)) + 0.5) / len(instants))
        assert np.abs(instants - middles).max() <= 0.5
    # However fast, no more than one a microsecond.
    assert subframe_instants(stretch(renderer, across(30.0, 2e-5)), 0, 3).tolist() == [1, 2, 3]
    # Of a scene at several depths it is the nearest that counts, at its fastest.
    part = stretch(*built_in())
    flow = np.linalg.norm(part.renderer.flow(part.views([50_000, 100_000, 150_000])), axis=-1)
    assert np.nanmax(flow) * 0.1 / len(subframe_instants(part, 50_000, 150_000)) <= SUBFRAME_PX


@pytest.mark.usefixtures("llvm")
def test_at_rest_and_without_exposure_the_frame_is_the_instant() -> None:
    """Bit by bit what was rendered at the frame's own instant, and nothing else is rendered."""
    renderer = make_renderer(line(), NARROW, rays_per_pixel=8)
    rest, moving = stretch(renderer, across(0.0)), stretch(renderer, across(5.0))
    luma = seen(moving, 7_000)
    for parts, exposure_us in (([rest], 5_000), ([moving], 0)):
        frame = expose(luma, parts, 7_000, exposure_us)
        assert frame.dtype == np.float64
        assert np.array_equal(IDEAL.read_out(frame, frame=0), luma)
    # The very first instant has nothing before it.
    assert np.array_equal(expose(luma, [moving], 0, 5_000), luma)


@pytest.mark.usefixtures("llvm")
def test_the_window_ends_at_the_frame_and_is_cut_at_the_start() -> None:
    """What comes after t does not matter; of an exposure that would begin before the sequence its part from 0 on is."""
    renderer = make_renderer(line(), NARROW, rays_per_pixel=8)
    part = stretch(renderer, across(5.0))
    half = exposed([part], 5_000, 10_000)
    assert np.array_equal(half, exposed([part], 5_000, 5_000))
    assert width_at_half(half[15]) == pytest.approx(2.5, abs=0.1)
    ends_there = stretch(renderer, SegmentTrajectory(part.trajectory.pose(0.0), part.trajectory.pose(0.005), 0.005))
    np.testing.assert_allclose(exposed([ends_there], 5_000, 5_000), half, atol=1e-5)


@pytest.mark.usefixtures("llvm")
def test_an_exposure_reaches_back_over_stretches() -> None:
    """Of a path given step by step: each step has its share by its duration; steps that are too old are ignored."""
    renderer = make_renderer(line(), NARROW, rays_per_pixel=64)
    whole = stretch(renderer, across(5.0, 0.01), start_us=100_000)
    steps, before_us = [], 0
    for step_us in (500, 1_000, 3_000, 4_000, 10_000):
        ends = [whole.trajectory.pose(t_us * 1e-6) for t_us in (before_us, step_us)]
        segment = SegmentTrajectory(ends[0], ends[1], (step_us - before_us) * 1e-6)
        steps.append(stretch(renderer, segment, start_us=100_000 + before_us, first=before_us == 0))
        before_us = step_us
    for t_us, exposure_us in ((110_000, 10_000), (110_000, 8_000), (103_500, 2_600)):
        reached = [step for step in steps if step.start_us < t_us]
        pieces, one = exposed(reached, t_us, exposure_us), exposed([whole], t_us, exposure_us)
        assert pieces.sum() == pytest.approx(one.sum(), rel=2e-3)
        assert np.abs(pieces - one).max() < 0.04 * one.max()
    # A camera that stood still for most of the time has most of the light where it stood.
    rest = stretch(renderer, across(0.0, 0.009))
    left = SegmentTrajectory(rest.trajectory.pose(0.009), across(10.0).pose(0.01), 0.001)
    frame = exposed([rest, stretch(renderer, left, start_us=9_000)], 10_000, 10_000)
    still = seen(rest, 9_000)
    assert frame[15, 19:21].sum() == pytest.approx(0.9 * still[15, 19:21].sum(), rel=0.03)


@pytest.mark.usefixtures("llvm")
def test_launches_do_not_matter() -> None:
    """The same bits, however many sub-frames are rendered in one call."""
    renderer = make_renderer(line(), NARROW, rays_per_pixel=2)
    frames = [exposed([stretch(renderer, across(7.0), batch=batch)], 10_000, 10_000) for batch in (1, 4, 64)]
    assert np.array_equal(frames[0], frames[1])
    assert np.array_equal(frames[0], frames[2])


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(
    ("kind", "exposure_us"), [("table", 5_000), ("integrator", 7_300), *long_values(("table", 10_000))]
)
@pytest.mark.parametrize(
    "profile",
    [
        Flicker(100.0, modulation=1.0),
        Flicker(1000.0, modulation=0.5, phase_rad=0.4, waveform="square"),
        SampledProfile([0.002, 0.004, 0.006], [0.0, 3.0, 1.0]),
    ],
    ids=["sine", "square", "sampled"],
)
def test_flicker_is_averaged(profile: LightProfile, kind: str, exposure_us: int) -> None:
    """Of the light the mean over the exposure, whatever its waveform, at rest by a single render and in motion."""
    fine = 10_000 - exposure_us + (np.arange(100_000) + 0.5) * exposure_us / 100_000
    factor = profile.factor(fine * 1e-6).mean()
    # Not a whole number of sub-frames: rounding, which differs between processors, would decide about one more.
    for pixels in (0.0, 4.8):
        steady, flickering = (
            stretch(make_renderer(scene, NARROW, rays_per_pixel=8, kind=kind), across(pixels))
            for scene in (line(), line({"sun": profile}))
        )
        assert np.array_equal(subframe_instants(steady, 0, 10_000), subframe_instants(flickering, 0, 10_000))
        frame = exposed([flickering], 10_000, exposure_us)
        if pixels == 0:
            np.testing.assert_allclose(frame, factor * exposed([steady], 10_000, exposure_us), rtol=2e-3, atol=1e-7)
        assert frame.sum() == pytest.approx(factor * exposed([steady], 10_000, exposure_us).sum(), rel=3e-3)
        # The renderer itself has its lights as they were.
        luma = seen(flickering, 3_100)
        np.testing.assert_allclose(luma, profile.factor(np.array([0.0031]))[0] * seen(steady, 3_100), rtol=1e-5)


def test_an_adc_has_so_many_levels() -> None:
    """Whole numbers of DN, each luma at the nearest, from 0 to the last."""
    luma = np.linspace(0.0, 2.0, 180 * 240).reshape(SIZE)
    for bits in (1, 8, 10, 16):
        frame = Aps(0, read_noise_dn=0, bits=bits, full_scale_luma=2.0).read_out(luma, frame=0)
        assert frame.dtype == np.float32
        dn = frame.astype(np.float64) * (2**bits - 1) / 2.0
        np.testing.assert_allclose(dn, np.rint(dn), atol=5e-3)
        assert len(np.unique(frame)) == min(2**bits, luma.size)
        assert np.abs(frame - luma).max() <= 2.0 / (2**bits - 1) / 2 + 1e-7
        assert (frame[0, 0], frame[-1, -1]) == (0.0, 2.0)


def test_an_adc_saturates() -> None:
    """Above full scale there is full scale, noise or not; without one nothing is cut, and nothing is ever negative."""
    luma = np.array([[0.0, 0.5, 0.999, 1.0, 1.7, 1e30]])
    clipped = Aps(0, read_noise_dn=0, full_scale_luma=1.0).read_out(luma, frame=0)
    np.testing.assert_allclose(clipped, [[0.0, 0.5, 0.999, 1.0, 1.0, 1.0]], atol=0.5 / 1023)
    assert (clipped[0, 3:] == 1.0).all()
    unlimited = Aps(0, read_noise_dn=0, full_scale_luma=None).read_out(luma, frame=0)
    np.testing.assert_allclose(unlimited, luma, atol=0.5 / 1023, rtol=1e-6)
    noisy = Aps(0, read_noise_dn=50.0, full_well_e=2_000.0, electrons_per_dn=1_000 / 1023, full_scale_luma=1.0)
    frame = noisy.read_out(np.tile(luma, (2_000, 1)), frame=0)
    assert frame.min() == 0.0
    assert frame.max() == 1.0
    assert (frame[:, 4:] == 1.0).all()
    dark = frame[:, 0]
    assert 0.4 < (dark == 0).mean() < 0.6


@pytest.mark.parametrize("sigma", [0.7, 2.9, 20.0])
def test_read_noise_is_gaussian_in_dn(sigma: float) -> None:
    """Mean, standard deviation and shape at a significance of 1e-6, before rounding; rounding adds 1/12 DN^2."""
    grey = np.full(SIZE, 0.4)
    exact = Aps(0, read_noise_dn=sigma, bits=None, full_scale_luma=2.0)
    dn = (exact.read_out(grey, frame=7, seed=5).astype(np.float64) - 0.4).ravel() * 1023 / 2.0
    z = stats.norm.isf(SIGNIFICANCE / 2)
    assert abs(dn.mean()) < z * sigma / np.sqrt(dn.size)
    assert abs(dn.std() / sigma - 1) < z / np.sqrt(2 * dn.size)
    assert stats.kstest(dn, stats.norm(scale=sigma).cdf).pvalue > SIGNIFICANCE
    assert stats.kstest(dn, stats.norm(scale=1.1 * sigma).cdf).pvalue < SIGNIFICANCE  # it would be seen
    rounded = Aps(0, read_noise_dn=sigma, full_scale_luma=2.0).read_out(grey, frame=7, seed=5).astype(np.float64)
    counts = np.rint(rounded * 1023 / 2.0).astype(int).ravel()
    levels = np.arange(counts.min(), counts.max() + 1)
    edges = stats.norm(0.4 * 1023 / 2.0, sigma).cdf(np.append(levels - 0.5, levels[-1] + 0.5))
    edges[0], edges[-1] = 0.0, 1.0
    expected, found = np.diff(edges) * counts.size, np.bincount(counts - counts.min())
    often = expected > 10
    found = np.append(found[often], found[~often].sum())
    expected = np.append(expected[often], expected[~often].sum())
    assert stats.chisquare(found[expected > 0], expected[expected > 0]).pvalue > SIGNIFICANCE


def test_shot_noise_is_poisson_of_electrons() -> None:
    """A photon transfer curve: the variance is the mean, in electrons; with few electrons the counts are Poisson's."""
    for luma, well in ((0.002, 1_000.0), (0.25, 1_000.0), (0.8, 20_000.0)):
        aps = Aps(0, read_noise_dn=0, bits=None, full_scale_luma=None, full_well_e=well)
        electrons = aps.read_out(np.full(SIZE, luma), frame=1).astype(np.float64).ravel() * well
        mean, n = luma * well, electrons.size
        z = stats.norm.isf(SIGNIFICANCE / 2)
        np.testing.assert_allclose(electrons, np.rint(electrons), atol=2e-3)
        assert abs(electrons.mean() - mean) < z * np.sqrt(mean / n)
        assert abs(electrons.var() / mean - 1) < z * np.sqrt((2 + 1 / mean) / n)
        counts = np.bincount(np.rint(electrons).astype(int))
        expected = stats.poisson(mean).pmf(np.arange(len(counts))) * n
        often = expected > 10
        rest = [counts[~often].sum(), n - expected[often].sum()]
        found, wanted = np.append(counts[often], rest[0]), np.append(expected[often], rest[1])
        assert stats.chisquare(found, wanted).pvalue > SIGNIFICANCE
    assert np.isfinite(Aps(full_well_e=1e9, full_scale_luma=None).read_out([[1e30]], frame=0)).all()


QUIET = {"read_noise_dn": 0.0, "bits": None, "full_scale_luma": None}
"""Nothing but what is named besides."""


def frames_of(aps: Aps, level: float, count: int, *, size: tuple[int, int] = SIZE, seed: int = 3) -> Any:
    """Frames of an even grey, in DN."""
    grey = np.full(size, level)
    return np.stack([aps.read_out(grey, frame=k, seed=seed) for k in range(count)]).astype(np.float64) * 1023


def test_the_photon_transfer_curve_is_that_of_the_linear_model() -> None:
    """Variance in time = read noise^2 + mean / K, K electrons a DN, up to the full well, where shot noise ends (1e-6).

    By pairs of frames, as EMVA 1288 has it, so that fixed patterns do not count.
    """
    per_dn, well, read = 20.0, 14_000.0, 3.0
    aps = Aps(0, read, None, None, full_well_e=well, electrons_per_dn=per_dn, prnu=0.02, dsnu_dn=5.0)
    z, levels = stats.norm.isf(SIGNIFICANCE / 2), (0.05, 0.1, 0.3, 0.6)
    for level in levels:
        first, second = frames_of(aps, level, 2)
        mean, variance = (first + second).mean() / 2, np.var(first - second) / 2
        expected = read**2 + mean / per_dn
        assert mean == pytest.approx(level * 1023, rel=0.002, abs=0.1)
        assert abs(variance / expected - 1) < z * np.sqrt(2 / first.size)
    full = frames_of(aps, 1.0, 2)  # 1,023 DN of light, of which the well holds 700
    assert full.mean() == pytest.approx(well / per_dn, rel=1e-4)
    assert np.var(full[0] - full[1]) / 2 == pytest.approx(read**2, rel=0.05)


def test_a_full_well_saturates_before_the_adc_or_after_it() -> None:
    """Whichever is lower: 500 DN of electrons, or full scale; read noise is there in the one, and cut in the other."""
    below = Aps(0, 0, 10, 1.0, full_well_e=5_000.0, electrons_per_dn=10.0)
    assert np.all(below.read_out([[0.9, 5.0]], frame=0) == np.float32(500 / 1023))
    above = Aps(0, 0, 10, 1.0, full_well_e=50_000.0, electrons_per_dn=10.0)
    assert np.all(above.read_out([[1.5, 5.0]], frame=0) == 1.0)
    # Without electrons per DN a full well is full scale; without a full well nothing is cut.
    assert np.all(Aps(0, 0, 10, 1.0, full_well_e=100.0).read_out(np.full((20, 20), 3.0), frame=0) == 1.0)
    free = Aps(0, 0, None, None, electrons_per_dn=1e6).read_out(np.full((20, 20), 30.0), frame=0)
    assert free.mean() == pytest.approx(30.0, rel=1e-3)


@pytest.mark.parametrize("share", [0.01, 0.2])
def test_prnu_is_a_gain_of_each_pixel(share: float) -> None:
    """Its standard deviation is that share of the signal, at any signal; pixel by pixel the same in each frame."""
    aps = Aps(0, prnu=share, **QUIET)  # type: ignore[arg-type]
    dim, bright = (frames_of(aps, level, 2) for level in (0.05, 0.8))
    assert np.array_equal(dim[0], dim[1])
    np.testing.assert_allclose(bright[0] / dim[0], 16, rtol=1e-5)
    gain = bright[0] / (0.8 * 1023)
    z = stats.norm.isf(SIGNIFICANCE / 2)
    assert abs(gain.mean() - 1) < z * share / np.sqrt(gain.size)
    assert gain.std() == pytest.approx(share, rel=0.03)
    assert np.all(gain > 0)
    assert abs(stats.pearsonr(gain[:, 1:].ravel(), gain[:, :-1].ravel())[0]) < z / np.sqrt(gain.size)


def test_dsnu_is_an_offset_of_each_pixel() -> None:
    """Its standard deviation is the same in any light, and it stays from frame to frame."""
    aps = Aps(0, dsnu_dn=4.0, **QUIET)  # type: ignore[arg-type]
    dim, bright = (frames_of(aps, level, 2) - level * 1023 for level in (0.1, 0.8))
    np.testing.assert_allclose(dim[0], bright[1], atol=1e-3)
    z = stats.norm.isf(SIGNIFICANCE / 2)
    assert abs(dim[0].mean()) < z * 4 / np.sqrt(dim[0].size)
    assert abs(dim[0].std() / 4 - 1) < z / np.sqrt(2 * dim[0].size)
    assert stats.kstest(dim[0].ravel() / 4, "norm").pvalue > SIGNIFICANCE


def test_columns_have_offsets_that_stay_and_noise_that_does_not() -> None:
    """All rows alike; the fixed ones alike in all frames, the others independent from frame to frame."""
    aps = Aps(0, column_offset_dn=3.0, column_noise_dn=1.5, **QUIET)  # type: ignore[arg-type]
    frames = frames_of(aps, 0.5, 200) - 0.5 * 1023
    np.testing.assert_allclose(frames - frames[:, :1], 0, atol=1e-3)
    columns = frames[:, 0]
    fixed = columns.mean(0)
    z = stats.norm.isf(SIGNIFICANCE / 2)
    assert abs(fixed.std() / np.hypot(3.0, 1.5 / np.sqrt(200)) - 1) < z / np.sqrt(2 * fixed.size)
    moving = columns - fixed
    assert abs(moving.std() / (1.5 * np.sqrt(1 - 1 / 200)) - 1) < z / np.sqrt(2 * moving.size)
    assert abs(stats.pearsonr(columns[0] - fixed, columns[1] - fixed)[0]) < z / np.sqrt(fixed.size)


def test_fixed_patterns_are_of_seed_and_pixel() -> None:
    """Another seed is another sensor; a row's pixels are those of their number, whatever comes below them."""
    aps = Aps(0, prnu=0.1, dsnu_dn=3.0, column_offset_dn=3.0, **QUIET)  # type: ignore[arg-type]
    one, again, other = (frames_of(aps, 0.5, 1, seed=seed)[0] for seed in (5, 5, 6))
    assert np.array_equal(one, again)
    assert abs(stats.pearsonr(one.ravel(), other.ravel())[0]) < 0.05
    assert np.array_equal(frames_of(aps, 0.5, 1, size=(40, SIZE[1]), seed=5)[0], one[:40])


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("exposure_us", [0, 4_000])
@pytest.mark.parametrize("speed_px_s", [500.0, -300.0])
def test_a_rolling_shutter_skews_a_moving_line(speed_px_s: float, exposure_us: int) -> None:
    """Row y shows the line where it was at the middle of its own exposure: within a tenth of a pixel, row by row."""
    row_us, t_us, height = 100.0, 20_000, NARROW.height
    part = stretch(make_renderer(line(), NARROW, rays_per_pixel=64), across(speed_px_s * 0.02, 0.02))
    frame = expose(seen(part, t_us), [part], t_us, exposure_us, row_us)
    place = (frame @ np.arange(NARROW.width)) / frame.sum(1)
    middle_us = t_us - row_us * np.arange(height - 1, -1, -1) - exposure_us / 2
    # The camera's way is that of its x axis, so the line goes the other way.
    expected = NARROW.cx - speed_px_s * (middle_us - 10_000) * 1e-6
    slope = np.polyfit(np.arange(height), place, 1)[0]
    assert slope == pytest.approx(-speed_px_s * row_us * 1e-6, rel=0.01)
    np.testing.assert_allclose(place, expected, atol=0.05)


@pytest.mark.usefixtures("llvm")
def test_each_row_is_what_a_global_shutter_gathers_at_its_time() -> None:
    """Of a textured scene: rows of global frames that close when the row does; a slow row time is a global shutter."""
    renderer, path = built_in("three_planes", NARROW)
    part = stretch(renderer, path)
    t_us, exposure_us, row_us = 150_000, 20_000, 500
    rolling = expose(seen(part, t_us), [part], t_us, exposure_us, row_us)
    closed = t_us - row_us * np.arange(NARROW.height - 1, -1, -1)
    frames = [expose(seen(part, int(t)), [part], int(t), exposure_us) for t in closed]
    rows = np.stack([frame[y] for y, frame in enumerate(frames)])
    wrong = np.abs(rolling - rows)
    one_time = np.abs(expose(seen(part, t_us), [part], t_us, exposure_us) - rows)
    assert wrong.max() < 0.02 * rows.max()
    assert wrong.mean() < 0.05 * one_time.mean()
    almost = expose(seen(part, t_us), [part], t_us, exposure_us, 1e-3)
    assert np.abs(almost - expose(seen(part, t_us), [part], t_us, exposure_us)).max() < 0.01 * rows.max()


@pytest.mark.usefixtures("llvm")
def test_a_rolling_shutter_shows_flicker_as_bands() -> None:
    """At rest each row has the mean light of its own exposure; at the sequence's start what there is of it."""
    renderer = make_renderer(line({"sun": Flicker(100.0, modulation=0.8)}), NARROW, rays_per_pixel=4)
    still = make_renderer(line(), NARROW, rays_per_pixel=4)
    part, steady = stretch(renderer, across(0.0, 0.05)), stretch(still, across(0.0, 0.05))
    profile, row_us, exposure_us = Flicker(100.0, modulation=0.8), 400.0, 3_000
    for t_us in (40_000, 5_000):
        frame = expose(seen(part, t_us), [part], t_us, exposure_us, row_us)
        lit = seen(steady, t_us)[:, 19].astype(np.float64)
        for y in range(0, NARROW.height, 3):
            close = max(t_us - row_us * (NARROW.height - 1 - y), 0.0)
            fine = np.linspace(max(close - exposure_us, 0.0), close, 2_001)
            mean = profile.factor(fine * 1e-6).mean()
            assert frame[y, 19] == pytest.approx(mean * lit[y], rel=0.03)


def test_keyframes_under_a_rolling_shutter() -> None:
    """Each row is the mean of the straight line between keyframes over its own time, or its instant."""
    times, values = [0, 100, 250, 400], [1.0, 3.0, 2.0, 6.0]
    for exposure_us, row_us in ((0, 40.0), (60, 40.0), (300, 15.5)):
        shutter = KeyframeExposure(exposure_us, row_us, height=5)
        for t_us, value in zip(times, values, strict=True):
            shutter.add(t_us, np.full((5, 2), value, np.float32))
        found = shutter.mean(400)
        for y in range(5):
            close = 400 - row_us * (4 - y)
            fine = np.linspace(max(close - exposure_us, 0), close, 100_001)
            np.testing.assert_allclose(found[y], np.interp(fine, times, values).mean(), rtol=1e-4)
    early = KeyframeExposure(10, 100.0, height=5)
    early.add(0, np.full((5, 2), 1.0, np.float32))
    np.testing.assert_array_equal(early.mean(0), 1.0)
    early.add(100, np.full((5, 2), 3.0, np.float32))
    np.testing.assert_allclose(early.mean(100)[:, 0], [1.0, 1.0, 1.0, 1.0, 2.9])


def test_noise_is_of_seed_and_frame_alone() -> None:
    """The same bits again, in any order of frames; other frames, seeds and kinds of noise have nothing in common."""
    grey = np.full(SIZE, 0.5)
    aps = Aps(0, bits=None)
    keys = [(5, 0), (5, 1), (5, 2), (6, 0), (2**64 - 1, 0), (0, 2**64 - 1)]
    frames = {key: aps.read_out(grey, seed=key[0], frame=key[1]) - 0.5 for key in keys}
    for seed, frame in reversed(keys):
        assert np.array_equal(aps.read_out(grey, seed=seed, frame=frame) - 0.5, frames[seed, frame])
    shot = Aps(0, read_noise_dn=0, bits=None, full_well_e=1e4).read_out(grey, seed=5, frame=0) - 0.5
    noises = [noise.ravel() for noise in (*frames.values(), shot)]
    correlation = np.corrcoef(noises) - np.eye(len(noises))
    pairs = len(noises) * (len(noises) - 1) / 2
    assert np.abs(correlation).max() < stats.norm.isf(SIGNIFICANCE / 2 / pairs) / np.sqrt(grey.size)
    # Nor has a frame with the one before, shifted by however many pixels.
    spectra = [np.fft.rfft(noise / noise.std()) for noise in noises[:2]]
    shifted = np.fft.irfft(spectra[0] * spectra[1].conj(), grey.size) / grey.size
    assert np.abs(shifted).max() < stats.norm.isf(SIGNIFICANCE / 2 / grey.size) / np.sqrt(grey.size)
    # Nor have neighbouring pixels.
    noise = frames[5, 0].astype(np.float64)
    for one, other in ((noise[:, 1:], noise[:, :-1]), (noise[1:], noise[:-1])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < stats.norm.isf(SIGNIFICANCE / 2) / np.sqrt(one.size)
    # Shot noise does not change the draws of read noise.
    both = Aps(0, bits=None, full_well_e=1e4).read_out(grey, seed=5, frame=0) - 0.5
    np.testing.assert_allclose(both, shot + frames[5, 0], atol=1e-6)


@pytest.mark.usefixtures("llvm")
def test_a_frame_from_end_to_end() -> None:
    """With the default sensor the blurred line comes out in whole DN, near what was exposed."""
    part = stretch(make_renderer(line(), CAMERA, rays_per_pixel=8), across(3.0))
    aps = Aps()
    mean = exposed([part], 10_000, round(aps.exposure_us))
    frame = aps.read_out(mean, frame=0, seed=1)
    assert frame.shape == mean.shape
    assert np.abs(frame - mean).max() < 6 * 2.9 / 1023
    assert frame.min() >= 0


def test_neutral_is_off() -> None:
    """All neutral: off, and what goes in comes out bit by bit; each value alone makes it an effect."""
    assert IDEAL.neutral
    luma = np.random.default_rng(0).random(SIZE).astype(np.float32) * 3
    assert np.array_equal(IDEAL.read_out(luma, frame=0), luma)
    for change in (
        {"exposure_us": 1},
        {"read_noise_dn": 0.1},
        {"bits": 16},
        {"full_scale_luma": 1e6},
        {"full_well_e": 1e9},
        {"electrons_per_dn": 3.0},
        {"prnu": 0.01},
        {"dsnu_dn": 0.1},
        {"column_offset_dn": 0.1},
        {"column_noise_dn": 0.1},
        {"row_readout_us": 1.0},
    ):
        assert not replace(IDEAL, **change).neutral
    assert Aps(5_000).settings() == {
        "exposure_us": 5_000,
        "read_noise_dn": 2.9,
        "bits": 10,
        "full_scale_luma": 1.0,
        "full_well_e": None,
        "electrons_per_dn": None,
        "prnu": 0.0,
        "dsnu_dn": 0.0,
        "column_offset_dn": 0.0,
        "column_noise_dn": 0.0,
        "row_readout_us": 0.0,
    }
    assert (Aps.name, Aps.acts_on) == ("aps", "frames")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"exposure_us": -1.0}, r"exposure_us must lie in 0\.\.4\.1943e\+06 us, got -1\.0"),
        ({"exposure_us": float("nan")}, "exposure_us .* got nan"),
        ({"exposure_us": 5_000_000}, "exposure_us .* got 5000000"),
        ({"read_noise_dn": -0.1}, r"read_noise_dn must be finite and >= 0 DN, got -0\.1"),
        ({"read_noise_dn": float("inf")}, "read_noise_dn .* got inf"),
        ({"bits": 0}, r"bits must lie in 1\.\.16, got 0"),
        ({"bits": 17}, r"bits must lie in 1\.\.16, got 17"),
        ({"bits": 9.5}, r"bits must be a whole number in 1\.\.16, got 9\.5"),
        ({"bits": True}, "bits .* got True"),
        ({"full_scale_luma": 0.0}, r"full_scale_luma must lie in 1e-06\.\.1e\+06, got 0\.0"),
        ({"full_scale_luma": float("nan")}, "full_scale_luma .* got nan"),
        ({"full_well_e": 0.5}, r"full_well_e must lie in 1\.\.1e\+09 electrons, got 0\.5"),
        ({"full_well_e": "many"}, "full_well_e .* got 'many'"),
        ({"electrons_per_dn": 0.0}, r"electrons_per_dn must lie in 1e-06\.\.1e\+09 electrons, got 0\.0"),
        ({"prnu": 1.5}, r"prnu must lie in 0\.\.1, got 1\.5"),
        ({"dsnu_dn": -1.0}, r"dsnu_dn must be finite and >= 0 DN, got -1\.0"),
        ({"column_offset_dn": float("inf")}, "column_offset_dn must .* got inf"),
        ({"column_noise_dn": float("nan")}, "column_noise_dn must .* got nan"),
        ({"row_readout_us": 1e6}, r"row_readout_us must lie in 0\.\.100000 us, got 1000000\.0"),
    ],
)
def test_nonsense_is_refused(values: dict[str, Any], message: str) -> None:
    """With name, value and range."""
    with pytest.raises(ValueError, match=message):
        Aps(**values)
