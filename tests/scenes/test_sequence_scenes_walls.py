"""The scenes in rooms: what they show, from how far, and under how much light."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import find_objects, label
from scipy.spatial.transform import Rotation

from davis_rs import Pose, Scene
from davis_rs.geometry.pose import hamilton
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.scene.load import start_pose
from davis_rs.scene.sequences.boxes_scene import boxes
from davis_rs.scene.sequences.prints import blocks, plain_shapes, stones, text
from davis_rs.scene.sequences.slider_scenes import slider_depth, slider_wall
from davis_rs.scene.sequences.wall_scenes import poster, shapes

FloatArray = npt.NDArray[np.float64]

SCENES: dict[str, Callable[[], Scene]] = {
    "shapes": shapes,
    "poster": poster,
    "hdr_poster": lambda: poster(hdr=True),
    "boxes": boxes,
    "hdr_boxes": lambda: boxes(hdr=True),
    "slider_close": lambda: slider_wall(0.231),
    "slider_hdr_close": lambda: slider_wall(0.232, hdr=True),
    "slider_hdr_far": lambda: slider_wall(0.584, hdr=True),
    "slider_depth": slider_depth,
}
DARKEST_LUX = {"hdr_poster": 105, "hdr_boxes": 85, "slider_hdr_close": 85, "slider_hdr_far": 95}
"""The least that is seen: from the start, or along the slide."""

HAND_HELD = ("shapes", "poster", "hdr_poster", "boxes", "hdr_boxes")
PINNED_PRINTS = "02bf758af24526725ffdaa09ef0b8a40b6fc7ee0253868e99fb071f6db01132d"


def mapping(source: Any) -> Mapping[str, Any]:
    assert isinstance(source, Mapping)
    return source


def renderer_of(scene: Scene) -> Renderer:
    renderer = make_renderer(scene, scene.own_camera, rays_per_pixel=1)
    assert renderer.name == "native renderer"
    return renderer


def poses(scene: Scene, shifts: FloatArray, turns_deg: FloatArray) -> Views:
    """Poses shifted (n, 3) and turned (n, 3) from the start, in camera axes."""
    start = start_pose(scene)
    turns = Rotation.from_rotvec(turns_deg, degrees=True).as_quat()
    return Views.at_rest(
        [
            Pose(start.position + start.rotation @ shift, hamilton(start.quaternion, turn))
            for shift, turn in zip(shifts, turns, strict=True)
        ]
    )


def along_the_slide(scene: Scene, metres: float) -> Views:
    shifts = np.linspace(0, metres, 14)[:, None] * (1.0, 0.0, 0.0)
    return poses(scene, shifts, np.zeros((14, 3)))


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.usefixtures("llvm")
def test_there_is_something_to_see_all_around(name: str) -> None:
    """Turned by 60 degrees about any axis, shifted by 0.2 m any way, each pixel sees a lit surface."""
    scene = SCENES[name]()
    axes = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    views = poses(scene, np.concatenate([0.2 * axes, np.zeros((7, 3))]), np.concatenate([0 * axes, 60 * axes]))
    renderer = renderer_of(scene)
    luma, depth = renderer.luma(views), renderer.depth(views)
    assert np.isfinite(depth).all()
    assert (depth > 0.02).all()
    assert (luma > 0.002).all()
    assert (luma < 3).all()
    assert luma[0].std() > 0.02


@pytest.mark.few(4)
@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_the_same_each_time(name: str) -> None:
    """Two scenes have the same parts, to the last texel; settings are those that a DAVIS240C's sequence has."""
    first, second = SCENES[name](), SCENES[name]()
    assert repr_of(first.source()) == repr_of(second.source())
    assert (first.own_camera.width, first.own_camera.fx) == (240, 199.371)
    assert 0.15 <= first.contrast_threshold <= 0.5
    assert first.trajectory is None
    np.testing.assert_allclose(start_pose(first).rotation[:, 0], [1, 0, 0], atol=1e-12)


def repr_of(node: Any) -> Any:
    if isinstance(node, Mapping):
        return {key: repr_of(value) for key, value in node.items()}
    return (node.shape, node.tobytes()) if isinstance(node, np.ndarray) else node


def test_prints_are_pinned() -> None:
    """The same texels on every machine."""
    made = (
        stones(96, 128, 1, low=0.1, high=0.8, stone=12.0),
        blocks(64, 2, low=0.1, high=0.9, count=20),
        text(96, 3, line=12, ink=0.1, paper=0.9),
        plain_shapes(96, 128, 4, cell=32, radius=(4.0, 10.0), fraction=0.8, ink=0.1, paper=0.9),
    )
    for print_ in made:
        assert print_.dtype == np.float32
        assert 0.02 < print_.min() < 0.3
        assert 0.5 < print_.max() <= 1
    levels = b"".join(np.round(print_ * 255).astype(np.uint8).tobytes() for print_ in made)
    assert hashlib.sha256(levels).hexdigest() == PINNED_PRINTS


def test_shapes_are_plain_black_few_and_apart() -> None:
    """A few dozen, of 4 to 26 cm, on one white: between them nothing but the soft edge of a texel."""
    sheet = mapping(shapes().source())["shapes"]
    printed = sheet["bsdf"]["nested"]["reflectance"]["data"][..., 0]
    found, count = label(printed < 0.4, np.ones((3, 3)))
    sizes = [max(side.stop - side.start for side in places) for places in find_objects(found)]
    assert 24 <= count <= 60
    texel = 2 * sheet["to_world"][0, 0] / printed.shape[1]
    assert texel == pytest.approx(0.005)
    assert 0.04 < texel * min(sizes) < 0.06
    assert 0.22 < texel * max(sizes) < 0.26
    plain = (printed == printed.min()) | (printed == printed.max())
    assert plain.mean() > 0.98


@pytest.mark.long
@pytest.mark.parametrize("name", HAND_HELD)
def test_a_hand_has_room(name: str) -> None:
    """Nothing comes within 0.3 m of a camera that is up to 0.7 m from its start along every axis."""
    scene = SCENES[name]()
    eye = start_pose(scene).position
    for part, (low, high) in bounds(scene).items():
        gap = np.maximum(np.maximum(low - (eye + 0.7), (eye - 0.7) - high), 0)
        assert np.linalg.norm(gap) > 0.3, part


def bounds(scene: Scene) -> dict[str, tuple[FloatArray, FloatArray]]:
    """The corners, lowest and highest along each axis, of the boxes around a scene's shapes."""
    cube = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), -1).reshape(-1, 3)
    found = {}
    for name, part in mapping(scene.source()).items():
        if isinstance(part, Mapping) and "to_world" in part:
            corners = cube * (1, 1, part["type"] == "cube")
            placed = corners @ part["to_world"][:3, :3].T + part["to_world"][:3, 3]
            found[name] = (placed.min(0), placed.max(0))
    return found


def test_boxes_are_many_and_stand_apart() -> None:
    """20 to 60 boxes of 10 to 60 cm; each stands on the floor or on one box, and no two are within each other."""
    placed = {name: box for name, box in bounds(boxes()).items() if name.startswith("box")}
    assert 20 <= len(placed) <= 60
    for name, (low, high) in placed.items():
        assert (high - low > 0.1).all()
        assert (high - low < 0.6).all()
        for other, (other_low, other_high) in placed.items():
            apart = np.maximum(low - other_high, other_low - high).max()
            assert other == name or apart > -1e-9, (name, other)
        tops = [other_high[2] for _, other_high in placed.values()]
        assert low[2] == pytest.approx(0, abs=1e-9) or np.isclose(tops, low[2]).any()


@pytest.mark.few(2)
@pytest.mark.parametrize("name", [name for name, make in SCENES.items() if not make().shadows])
@pytest.mark.usefixtures("llvm")
def test_no_shadow_is_missed(name: str) -> None:
    """Where none is traced, tracing them changes nothing."""
    scene = SCENES[name]()
    views = poses(scene, np.zeros((3, 3)), np.array([[0.0, 0, 0], [0, 50, 0], [-40, -30, 0]]))
    traced = renderer_of(replace(scene, shadows=True)).luma(views)
    np.testing.assert_allclose(renderer_of(scene).luma(views), traced, rtol=1e-5)


@pytest.mark.parametrize("distance", [0.231, 0.584])
@pytest.mark.usefixtures("llvm")
def test_the_slider_goes_along_the_wall(distance: float) -> None:
    """All along its 1.04 m the prints are exactly that far away; the wall shows 0.1 mm behind them."""
    scene = slider_wall(distance)
    depth = renderer_of(scene).depth(along_the_slide(scene, 1.04))
    assert depth.min() == pytest.approx(distance, abs=1e-5)
    assert depth.max() == pytest.approx(distance + 1e-4, abs=1e-5)
    assert (depth < distance + 5e-5).mean() > 0.85


@pytest.mark.usefixtures("llvm")
def test_the_slider_passes_many_depths() -> None:
    """The nearest is 0.584 m away, the wall two metres behind it, and at least six depths lie between."""
    scene = slider_depth()
    depth = renderer_of(scene).depth(along_the_slide(scene, 1.09))
    fronts, counts = np.unique(np.round(depth, 3), return_counts=True)
    fronts = fronts[counts > 300]
    assert depth.max() == pytest.approx(2.601, abs=1e-4)
    assert np.isclose(fronts, 0.584).any()
    assert ((fronts > 0.6) & (fronts < 2.5)).sum() >= 6


@pytest.mark.parametrize("distance", [0.0, 2.5, np.nan])
def test_walls_at_impossible_distances_are_refused(distance: float) -> None:
    """The camera would be in the wall, or see past the prints."""
    with pytest.raises(ValueError, match="distance_m"):
        slider_wall(distance)


@pytest.mark.few(5)
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.usefixtures("llvm")
def test_light_is_what_it_is_said_to_be(name: str) -> None:
    """With all painted white luma is illuminance: about 500 lux in the middle, or some 80 to 2400 in scenes of HDR."""
    scene = SCENES[name]()
    white = replace(scene, source=lambda: painted_white(mapping(scene.source())))
    views = along_the_slide(scene, 1.04) if "slider" in name else poses(scene, np.zeros((1, 3)), np.zeros((1, 3)))
    lux = renderer_of(white).luma(views) * scene.lux_per_luma
    if name in DARKEST_LUX:
        assert 79.9 < lux.min() < DARKEST_LUX[name]
        assert 2350 < lux.max() < 2450
    else:
        assert 250 < np.median(lux) < 550
        assert lux.max() / lux.min() < 8


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_rooms_are_lit_from_all_sides(name: str) -> None:
    """Each says so of itself: a renderer that shuts their constant light out warns."""
    scene = SCENES[name]()
    assert scene.ambient
    with pytest.warns(UserWarning, match=f"scene '{scene.name}' is made for the table kernel or the native renderer"):
        make_renderer(scene, scene.own_camera, rays_per_pixel=1, kind="integrator")


def painted_white(node: Mapping[str, Any]) -> dict[str, Any]:
    white = {"type": "rgb", "value": 1.0}
    return {
        key: white if key == "reflectance" else painted_white(value) if isinstance(value, Mapping) else value
        for key, value in node.items()
    }
