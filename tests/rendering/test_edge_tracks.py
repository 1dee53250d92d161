"""Pixels that edges pass: what the tracks say must be what the renderer shows, at each microsecond."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Effects, Scene, load_scene
from davis_rs.accuracy.hard_case_scenes import sideways, wires
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.render.edges.edge_tracks import EdgeTracks, instants_of_spans
from davis_rs.sampling.observe import CountedRenderer
from davis_rs.sensor.effects.lens_blur import LensBlur
from davis_rs.sensor.effects.optics import with_optics
from davis_rs.sensor.effects.vignetting import Vignetting

LOG_EPS, TOLERATED = 1e-3, 0.05 * 0.15
START_US = np.array([3000, 5000])
LENGTH_US = 400


def renderer_of(scene: Scene, *, blur: bool = False, kind: str = "native") -> Renderer:
    return make_renderer(scene, scene.own_camera, rays_per_pixel=16, blur=blur, kind=kind)


def tracks_of(renderer: Renderer, scene: Scene) -> list[EdgeTracks]:
    instants = instants_of_spans(START_US, START_US + LENGTH_US)
    views = Views.along(scene.path, instants.ravel() * 1e-6)
    found = renderer.edge_tracks(views, instants, tolerated=TOLERATED, log_eps=LOG_EPS)
    assert found is not None
    return found


def microseconds_off(tracks: EdgeTracks, renderer: Renderer, scene: Scene, start_us: int) -> npt.NDArray[np.int64]:
    """Of each pixel all of which is known: at how many microseconds log luma errs more than is tolerated."""
    t_us = np.arange(start_us, start_us + LENGTH_US + 1)
    log = np.log(renderer.luma(Views.along(scene.path, t_us * 1e-6)).astype(np.float64) + LOG_EPS).reshape(
        len(t_us), -1
    )
    found = []
    for pixel in np.setdiff1d(tracks.pixels, tracks.unknown):
        own = tracks.pixel == pixel
        times = np.concatenate([t_us[:1], tracks.t_us[own], t_us[-1:]])
        assert (np.diff(times) > 0).all()
        values = np.concatenate([log[:1, pixel], np.log(tracks.luma[own] + LOG_EPS), log[-1:, pixel]])
        found.append(np.count_nonzero(np.abs(np.interp(t_us, times, values) - log[:, pixel]) > TOLERATED))
    return np.array(found)


@pytest.mark.few(2)
@pytest.mark.parametrize("through", ["bare", "blur", "vignetting", "lens"])
def test_tracks_are_what_the_renderer_shows(through: str) -> None:
    """At every microsecond a known pixel is within the tolerance, but for a jump that rounding puts in the next one."""
    scene = wires(sideways(0.006, 1.0), shadows=False)
    renderer = renderer_of(scene, blur=through == "blur")
    if through in ("vignetting", "lens"):
        renderer = with_optics(
            renderer, Effects(vignetting=Vignetting(), lens_blur_px=LensBlur(0.7) if through == "lens" else None)
        )
    for start_us, tracks in zip(START_US.tolist(), tracks_of(renderer, scene), strict=True):
        off = microseconds_off(tracks, renderer, scene, start_us)
        assert len(off) > 100
        assert through != "bare" or len(tracks.unknown) < 0.3 * len(tracks.pixels)
        assert np.count_nonzero(off) < 0.03 * len(off)
        assert off.max() <= 1


def test_other_pixels_see_no_edge() -> None:
    """What is not tracked changes evenly over the span: with flat colours all that is not even is an edge."""
    scene = wires(sideways(0.006, 1.0), shadows=False)
    renderer = renderer_of(scene)
    start_us, tracks = int(START_US[0]), tracks_of(renderer, scene)[0]
    t_us = np.arange(start_us, start_us + LENGTH_US + 1)
    luma = renderer.luma(Views.along(scene.path, t_us * 1e-6)).reshape(len(t_us), -1)
    # In one microsecond a texture changes luma by little, an edge a ray's at once.
    jumps = (np.abs(np.diff(luma, axis=0)) > 0.02 * luma[:-1]).any(0)
    assert np.count_nonzero(jumps) > 100
    assert np.isin(np.flatnonzero(jumps), tracks.pixels).all()


@pytest.mark.long
def test_moving_objects_have_edges_too() -> None:
    scene = load_scene("dynamic_translation").crop(1.0, 0.01)
    renderer = renderer_of(scene)
    for start_us, tracks in list(zip(START_US.tolist(), tracks_of(renderer, scene), strict=True))[:1]:
        off = microseconds_off(tracks, renderer, scene, start_us)
        assert len(off) > 100  # they go slowly: float32 does not tell one microsecond from the next
        # A ray that an edge passes may go into a shadow before: shadows' edges are not followed.
        assert np.count_nonzero(off > 2) < 0.02 * len(off)


def test_what_observes_a_renderer_has_its_tracks() -> None:
    scene = wires(sideways(0.006, 1.0), shadows=False)
    renderer = renderer_of(scene, blur=True)
    counted = CountedRenderer(renderer)
    for own, observed in zip(tracks_of(renderer, scene), tracks_of(counted, scene), strict=True):
        assert own.rendered == observed.rendered
        assert np.array_equal(own.pixels, observed.pixels)
        assert np.array_equal(own.luma, observed.luma)
    assert counted.count > 16 * 3 * 100


def test_others_do_not_know_their_rays() -> None:
    scene = wires(sideways(0.006, 1.0), shadows=False)
    instants = instants_of_spans(START_US, START_US + LENGTH_US)
    renderer = renderer_of(scene, kind="integrator")
    views = Views.along(scene.path, instants.ravel() * 1e-6)
    assert renderer.edge_tracks(views, instants, tolerated=TOLERATED, log_eps=LOG_EPS) is None


def test_bad_instants_are_refused() -> None:
    scene = wires(sideways(0.006, 1.0), shadows=False)
    renderer = renderer_of(scene)
    instants = np.array([[0, 1, 1, 2, 3]])
    views = Views.along(scene.path, instants.ravel() * 1e-6)
    with pytest.raises(ValueError, match="increasing instants"):
        renderer.edge_tracks(views, instants, tolerated=TOLERATED, log_eps=LOG_EPS)
