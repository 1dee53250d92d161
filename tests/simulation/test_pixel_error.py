"""How many events will be wrong because of what a pixel is made of: the estimate next to events of whole frames."""

from __future__ import annotations

import numpy as np
import pytest

from davis_rs import Camera, compare_events, load_scene
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.sampling.rules import MaxDisplacement
from davis_rs.simulation import pixel_error
from davis_rs.simulation.followed_pixels import events_of_pixels, stretches_of
from davis_rs.simulation.pixel_error import PixelError, estimate_pixel_error

pytestmark = pytest.mark.without_llvm

CAMERA = Camera(width=64, height=48, fx=55.0, fy=55.0, cx=31.5, cy=23.5)
SCENE = load_scene("three_planes").crop(0.0, 1.0)
LEVELS = {"thresholds": (0.15, 0.15), "log_eps": 1e-3}


def renderer_of(rays: int, pixel: str = "rays") -> NativeRenderer:
    made = make_renderer(SCENE, CAMERA, kind="native", rays_per_pixel=rays, pixel=pixel, blur=False)
    assert isinstance(made, NativeRenderer)
    return made


def estimated(renderer: NativeRenderer) -> PixelError:
    found = estimate_pixel_error(renderer, SCENE.path, **LEVELS)  # type: ignore[arg-type]
    assert found is not None
    return found


@pytest.fixture(autouse=True)
def cost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short runs of small cameras pay for the estimate, too."""
    monkeypatch.setattr(pixel_error, "_COST_SHARE", 1e9)


def test_the_estimate_is_that_of_whole_frames() -> None:
    """Of all pixels in the same stretches, a share that is as large to within a third; more rays make fewer wrong."""
    few, found = renderer_of(4), estimated(renderer_of(4))
    more = few.by_rays(16)
    wrong = right = 0
    for t_us in stretches_of(few, SCENE.path, MaxDisplacement(), 3):
        views = Views.along(SCENE.path, t_us * 1e-6)
        own, reference = (
            events_of_pixels(each.luma(views).reshape(len(views), -1), t_us, (0.15, 0.15), 1e-3) for each in (few, more)
        )
        compared = compare_events(own, reference, size=(64 * 48, 1))
        wrong, right = wrong + compared.missing + compared.spurious, right + compared.reference
    assert found.share == pytest.approx(wrong / right, rel=0.35)
    assert found.events == pytest.approx(right * found.pixels / (64 * 48), rel=0.35)
    assert (found.reference_rays, found.pixel) == (16, "4 rays")
    assert estimated(renderer_of(64)).share < found.share / 2
    assert "% of these events will be wrong (missing or spurious) because a pixel is 4 rays: measured next" in str(
        found
    )


def test_lines_are_compared_with_rays() -> None:
    lines = renderer_of(32, "lines")
    found = estimated(lines)
    assert (found.reference_rays, found.pixel) == (512, "8 lines")
    assert found.share < 0.5 * estimated(renderer_of(8)).share
    views = Views.along(SCENE.path, np.array([0.3]))
    np.testing.assert_array_equal(lines.by_rays(8).luma(views), renderer_of(8).luma(views))
    assert lines.pixel == "lines"


def test_where_nothing_can_be_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the most rays that there are, of a camera at rest, and of runs that are as short as the estimate."""
    assert estimate_pixel_error(renderer_of(1024), SCENE.path, **LEVELS) is None  # type: ignore[arg-type]
    at_rest = SCENE.crop(0.0, 1e-6).path
    assert estimate_pixel_error(renderer_of(4), at_rest, **LEVELS) is None  # type: ignore[arg-type]
    monkeypatch.setattr(pixel_error, "_COST_SHARE", 0.01)
    assert estimate_pixel_error(renderer_of(4), SCENE.path, **LEVELS) is None  # type: ignore[arg-type]
