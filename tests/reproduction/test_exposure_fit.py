"""Thresholds of short and of blurred recordings, and the noise of frames, of simulated recordings."""

from __future__ import annotations

import numpy as np
import pytest

from davis_rs.calibrate.sensor.exposure_fit import GROUPS, ExposureFit, fit_exposures
from davis_rs.calibrate.sensor.exposure_pairs import exposure_pairs
from davis_rs.simulation.from_frames.luma_noise import luma_noise
from recorded_clips import SENSOR, Scene, clip_of


@pytest.mark.few(1)
@pytest.mark.parametrize("scene", [Scene(), Scene(exposure_us=19_000), Scene(black=30.0)])
def test_thresholds_and_black_level_are_found(scene: Scene) -> None:
    """Of sharp frames, of frames that are blurred over nearly all of the time, and of frames above a black level."""
    clip = clip_of(scene=scene)
    found = fit_exposures(exposure_pairs(clip.events, clip.source.frames(), clip.size[0], groups=GROUPS))
    assert isinstance(found, ExposureFit)
    assert abs(found.on.value - (SENSOR.contrast_threshold or 0)) < 3 * found.on.sigma < 0.03
    assert abs(found.off.value - (SENSOR.contrast_threshold_off or 0)) < 3 * found.off.sigma < 0.04
    assert found.black.value == pytest.approx(scene.black, abs=8)


@pytest.mark.parametrize(("read", "moved"), [(0.004, 0), (0.004, 1), (0.01, 3)])
def test_noise_of_frames_is_found_next_to_a_texture_that_moves(read: float, moved: int) -> None:
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(0)
    texture = gaussian_filter(rng.random((160, 200)), 3)
    texture = (texture - texture.min()) / (texture.max() - texture.min())
    before, after = (
        image + read * rng.standard_normal(image.shape) for image in (texture, np.roll(texture, moved, axis=1))
    )
    found = luma_noise(before, after)
    assert found is not None
    assert abs(found.read - read) < 4 * found.read_sigma < read
    assert luma_noise(texture, np.roll(texture, moved, axis=1)) is None
