"""Centre-surround pixels against the resistive grid, stepped in time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Simulator, load_scene
from davis_rs.sensor.effects.centre_surround import CentreSurround

Frame = npt.NDArray[np.float64]


def laplacian(h: Frame) -> Frame:
    """Neighbours less the pixel, without current across the border."""
    padded = np.pad(h, 1, mode="edge")
    return padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:] - 4 * h


@pytest.mark.long
def test_it_is_the_grid() -> None:
    """Frames that are held between keyframes: small explicit steps give the same surround."""
    random = np.random.default_rng(0)
    frames = [random.normal(size=(9, 13)) for _ in range(4)]
    times = [0, 700, 2500, 2600]
    effect = CentreSurround(lambda_px=1.5, tau_ms=2.0)
    effect.begin(13, 9, 0)
    found = [effect.log_intensity(t, frame) for t, frame in zip(times, frames, strict=True)]
    h = frames[0].copy()
    for _ in range(20_000):  # settles
        h += 0.02 * (frames[0] - h + 1.5**2 * laplacian(h))
    assert np.allclose(found[0], frames[0] - h, atol=1e-9)
    for number in (1, 2, 3):
        light = 0.5 * (frames[number - 1] + frames[number])
        for _ in range(times[number] - times[number - 1]):
            for _ in range(10):
                h += 0.1e-3 / 2.0 * (light - h + 1.5**2 * laplacian(h))
        assert np.allclose(found[number], frames[number] - h, atol=2e-3)


def test_steps_are_forgotten_and_fine_detail_stays() -> None:
    effect = CentreSurround(lambda_px=4, tau_ms=1)
    effect.begin(64, 64, 0)
    bars = np.tile(np.cos(2 * np.pi * (np.arange(64) + 0.5) / 8), (64, 1))
    first = effect.log_intensity(0, bars)
    steepness = 2 - 2 * np.cos(2 * np.pi / 8)  # of the grid, at a wavelength of 8 pixels
    assert np.allclose(first, bars * (1 - 1 / (1 + 16 * steepness)), atol=1e-9)
    brighter = effect.log_intensity(1, bars + 1)
    assert np.allclose(brighter - first, 1, atol=2e-3)
    later = effect.log_intensity(20_001, bars + 1)
    assert np.allclose(later, first, atol=1e-6)
    at_once = CentreSurround(lambda_px=4, tau_ms=0)
    at_once.begin(64, 64, 0)
    assert np.allclose(at_once.log_intensity(0, bars), first)
    assert np.allclose(at_once.log_intensity(1, bars + 1), first, atol=1e-9)


def test_a_simulation_takes_it_by_name_and_as_an_object() -> None:
    scene = load_scene("three_planes").crop(0.0, 0.03)
    named = "davis_rs.sensor.effects.centre_surround:CentreSurround"
    counts = []
    for effect in (None, named, CentreSurround(), CentreSurround(lambda_px=0, tau_ms=0)):
        simulator = Simulator(scene, size=(24, 18), rays_per_pixel=1, custom_effects=effect)
        counts.append(sum(len(packet.events) for packet in simulator.run()))
    assert counts[0] > counts[1] == counts[2] > 0
    assert counts[3] == 0  # nothing is left of a pixel that is its own surround


@pytest.mark.parametrize("settings", [{"lambda_px": -1}, {"tau_ms": float("nan")}])
def test_senseless_grids_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must be finite and >= 0"):
        CentreSurround(**settings)
