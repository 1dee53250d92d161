"""The 8-bit frames of a run are neither black nor burnt out, whatever the first one shows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from davis_rs import Dataset, SampledProfile, Scene, simulate_to_folder
from stretches import CAMERA, shift, wall

pytestmark = pytest.mark.without_llvm


def floor(first: float, later: float) -> Scene:
    """A floor under a lamp that is as strong as ``first`` at the beginning, and as ``later`` after 5 ms."""
    profile = SampledProfile([0.0, 0.004, 0.005], [first, first, later])
    return replace(wall(), trajectory=shift([0.2, 0.0, 0.0], 0.1), lights={"lamp": profile})


@pytest.mark.parametrize(("first", "later"), [(0.05, 1.0), (1.0, 0.8)])
def test_frames_show_what_is_seen_along_the_path(first: float, later: float, tmp_path: Path) -> None:
    scene = floor(first, later)
    simulate_to_folder(scene, tmp_path / "d", camera=CAMERA, accuracy="fast", frame_rate_hz=40, quiet=True)
    dataset = Dataset(tmp_path / "d")
    frames = [dataset.read_image(number) for number in range(len(dataset.frames))]
    white = [float(np.mean(frame == 255)) for frame in frames]
    assert len(white) == 5
    assert max(white[1:]) < 0.05, "a first frame that is unlike all others may be white"
    assert float(np.median(frames[-1])) > 80


def test_a_gain_that_is_given_is_kept(tmp_path: Path) -> None:
    simulate_to_folder(floor(1.0, 0.8), tmp_path / "d", camera=CAMERA, accuracy="fast", image_gain=0.25, quiet=True)
    assert Dataset(tmp_path / "d").meta["image_gain"] == 0.25


def test_without_frames_there_is_no_gain(tmp_path: Path) -> None:
    simulate_to_folder(floor(1.0, 0.8), tmp_path / "d", camera=CAMERA, accuracy="fast", frame_rate_hz=0, quiet=True)
    assert Dataset(tmp_path / "d").meta["image_gain"] is None
