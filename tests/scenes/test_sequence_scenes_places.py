"""The office, the office with a person, the path outdoors and the city street: what each promises."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Pose, Scene
from davis_rs._mitsuba.variants import default_variant, load_scene_source, variant
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.scene.sequences.dynamic_scene import DURATION_S, dynamic, performance
from davis_rs.scene.sequences.office_scene import office
from davis_rs.scene.sequences.person import ANKLE_M, SHIN_M, parts
from davis_rs.scene.sequences.street_scenes import outdoors, urban

SCENES = [office, dynamic, outdoors, urban]
WIDE = Camera(32, 24, 18.0, 18.0, 15.5, 11.5)
TURNS = [(0, 0, 0), (60, 0, 0), (-60, 0, 0), (0, 60, 0), (0, -60, 0), (0, 0, 60), (0, 0, -60), (40, -40, 40)]


def start(scene: Scene) -> Pose:
    assert scene.start is not None
    return scene.start


def turned(pose: Pose, turn: tuple[int, int, int], shift: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
    rotation = Rotation.from_quat(pose.quaternion)
    own = rotation * Rotation.from_euler("YXZ", turn, degrees=True)
    return Pose(pose.position + rotation.apply(shift), own.as_quat())


def rendered(scene: Scene) -> Renderer:
    return make_renderer(scene, WIDE, rays_per_pixel=4, kind="native")


@functools.cache
def made(make: Callable[[], Scene]) -> tuple[Scene, Renderer]:
    """A scene and its renderer, kept: to load one takes up to a second."""
    scene = make()
    return scene, rendered(scene)


@pytest.mark.few(2)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("make", SCENES)
def test_there_is_something_to_see_wherever_a_hand_turns_the_camera(make: Callable[[], Scene]) -> None:
    """Every view up to 60 degrees from the start is finite, and has contrast of more than twice the threshold."""
    scene, renderer = made(make)
    luma = renderer.luma(Views.at_rest([turned(start(scene), turn) for turn in TURNS], 12.0))
    assert np.isfinite(luma).all()
    assert (luma > 0).all()
    spread = np.log(luma.max((1, 2)) / luma.min((1, 2)))
    assert (spread > 2 * scene.contrast_threshold).all()


@pytest.mark.few(2)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("make", SCENES)
def test_the_same_scene_is_made_each_time(make: Callable[[], Scene]) -> None:
    """Two loads give the same bytes: all randomness is frozen."""
    again = make()
    images = [
        renderer.luma(Views.at_rest([start(scene)], 12.0)).tobytes()
        for scene, renderer in (made(make), (again, rendered(again)))
    ]
    assert images[0] == images[1]


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(("make", "air_m"), [(office, 0.7), (dynamic, 1.1), (urban, 0.9)])
def test_a_hand_has_room_to_move(make: Callable[[], Scene], air_m: float) -> None:
    """Nothing is closer to the start than the hand reaches, in any direction and, with a person about, at any time."""
    scene = make()
    renderer = make_renderer(scene, Camera(24, 24, 12.0, 12.0, 11.5, 11.5), rays_per_pixel=1, kind="native")
    around = [(0, 0, 0), (90, 0, 0), (180, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0)]
    for instant in np.arange(0.0, DURATION_S, 1.0) if scene.objects else [0.0]:
        depth = renderer.depth(Views.at_rest([turned(start(scene), turn) for turn in around], instant))
        # Each face of a cube of views: a plane at depth d is at least d away.
        assert depth.min() > air_m


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_the_path_outdoors_is_free_for_300_m() -> None:
    """Nothing but the ground comes within half a metre of a head that is carried ahead."""
    scene, renderer = made(outdoors)
    with variant(default_variant()[0]) as (mi, _):
        shapes = load_scene_source(scene.source(), mi).shapes()
        vertices = {
            shape.id(): np.array(shape.vertex_positions_buffer(), np.float64).reshape(-1, 3)[
                np.array(shape.faces_buffer()).reshape(-1, 3)
            ]
            for shape in shapes
        }
    assert sum(len(corners) for corners in vertices.values()) < 20_000
    x, _, z = start(scene).position
    along = [Pose([x, y, z], start(scene).quaternion) for y in np.arange(0.0, 300.0, 2.0)]
    assert renderer.depth(Views.at_rest(along)).min() > 0.5
    for name in ("leaves", "trunks", "dark", "cars", "walls"):
        low, high = vertices[name].min(1), vertices[name].max(1)
        near = (low[:, 0] < 0.5) & (high[:, 0] > -0.5) & (low[:, 2] < 2.1) & (np.abs(low[:, 1] - 150) < 160)
        assert not near.any(), name


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_the_light_is_that_of_the_place() -> None:
    """White under the lamp's light is some 500 lx, in the sun above 20,000 lx, and a shadow takes half of that away."""
    for make, least, most in ((office, 400.0, 600.0), (outdoors, 20_000.0, 100_000.0)):
        scene = make()
        x, y, z = (0.0, 2.35, 0.78) if make is office else (1.5, 3.5, 0.1)
        white = {
            "type": "rectangle",
            "to_world": np.array([[0.01, 0, 0, x], [0, 0.01, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}},
        }

        def with_white(scene: Scene = scene, white: dict[str, Any] = white) -> dict[str, Any]:
            source = scene.source()
            assert isinstance(source, Mapping)
            return {**source, "white": white}

        marked = replace(scene, source=with_white)
        above = Pose([x, y, z + 0.1], [1.0, 0.0, 0.0, 0.0])
        luma = make_renderer(marked, Camera(4, 4, 200.0, 200.0, 1.5, 1.5), rays_per_pixel=1).luma(
            Views.at_rest([above])
        )
        assert least < luma.mean() * scene.lux_per_luma < most
    scene, renderer = made(outdoors)
    views = Views.at_rest([start(scene)])
    lit, dark = rendered(replace(scene, shadows=False)).luma(views), renderer.luma(views)
    assert (dark / lit).min() < 0.5


def test_the_person_walks_waves_and_sits() -> None:
    """It sits at both ends of the minute, walks to and fro at a walking pace, and lifts a hand to above its shoulder.

    All its joints stay together: the elbow is where both halves of the arm have it.
    """
    paths = performance()
    t = np.linspace(0.0, DURATION_S, 1201)
    assert {path.duration_s for path in paths.values()} == {DURATION_S}
    hips = paths["torso"].positions(t)
    assert hips[[0, -1], 2] == pytest.approx([SHIN_M + ANKLE_M] * 2, abs=0.06)
    assert np.ptp(hips[:, 0]) > 2.5
    assert 0.9 < np.linalg.norm(paths["torso"].velocities(t), axis=1).max() < 2.0
    left, right = (
        paths[name].positions(t) + np.einsum("nij,j->ni", paths[name].rotations(t), [0.0, 0.0, -0.3])
        for name in ("left_lower_arm", "right_lower_arm")
    )
    assert (right[:, 2] - hips[:, 2]).max() > 0.7
    above_keyboard = np.concatenate([left, right])[np.tile(t < 8, 2), 2] - 0.76
    assert 0.08 < above_keyboard.min() < above_keyboard.max() < 0.2
    for side in ("left", "right"):
        shoulder = paths[f"{side}_upper_arm"]
        elbow = shoulder.positions(t) + np.einsum("nij,j->ni", shoulder.rotations(t), [0.0, 0.0, -0.3])
        np.testing.assert_allclose(elbow, paths[f"{side}_lower_arm"].positions(t), atol=0.001)


def test_the_person_is_as_high_as_an_adult_and_stands_on_the_floor() -> None:
    """1.85 m where it stands and waves; the lower foot is never 1 cm above the floor, walking toes up to 4 cm below."""
    paths = performance()
    t = np.linspace(0.0, DURATION_S, 1201)
    heights = {
        name: np.einsum("nj,kj->nk", paths[name].rotations(t)[:, 2], part.vertices) + paths[name].positions(t)[:, 2:]
        for name, part in parts().items()
    }
    waves = (t > 30) & (t < 35)
    lowest = np.minimum(heights["left_shin"].min(1), heights["right_shin"].min(1))
    high = heights["torso"].max(1)[waves] - lowest[waves]
    np.testing.assert_allclose(high, 1.85, atol=0.01)
    assert lowest.max() < 0.01
    assert -0.04 < lowest.min() < -0.03


@pytest.mark.long
@pytest.mark.parametrize("make", [office, dynamic])
def test_an_integrator_warns_of_black_shadows(make: Callable[[], Scene]) -> None:
    """Constant light comes from without: the walls shut it out. Under a real sky nothing is amiss."""
    scene = make()
    with pytest.warns(
        UserWarning,
        match=rf"scene '{scene.name}' is made for the table kernel or the native renderer.*shadows are black",
    ):
        renderer = make_renderer(scene, WIDE, rays_per_pixel=1, kind="integrator")
    views = Views.at_rest([start(scene)], 12.0)
    assert renderer.luma(views).min() == 0
    make_renderer(outdoors(), WIDE, rays_per_pixel=1, kind="integrator")  # a warning would be an error


@pytest.mark.usefixtures("llvm")
def test_the_person_is_seen_to_move() -> None:
    """A camera at rest sees luma change where the person passes, and nowhere else."""
    scene, renderer = made(dynamic)
    images = renderer.luma(Views.at_rest([start(scene)] * 2, [14.0, 15.0]))
    changed = np.abs(np.log(images[1] / images[0])) > 0.1
    assert 0.03 < changed.mean() < 0.5
