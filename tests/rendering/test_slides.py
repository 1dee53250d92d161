"""Projectors, and spots with a texture: the pictures that they throw, next to Mitsuba's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Flicker, Pose, Scene, SegmentTrajectory, load_scene
from davis_rs._core import SceneRenderer
from davis_rs._mitsuba.variants import FAST, load_scene_source, variant
from davis_rs.differentiable.event_jacobian import EventTimeModel
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import RENDERER_KINDS, NoiseFreeKind, make_renderer, why_not_noise_free
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.native.renderer import NativeRenderer
from one_triangle import one_triangle

FloatArray = npt.NDArray[np.float64]
Parts = dict[str, Any]

CAMERA = Camera(32, 24, 26.0, 26.0, 15.5, 11.5)
POSE = Pose(
    [0.2, -0.3, 1.9], (Rotation.from_euler("x", 180, degrees=True) * Rotation.from_rotvec([0.15, -0.1, 0.3])).as_quat()
)
VIEWS = Views.at_rest([POSE])
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
TEXELS = np.random.RandomState(5).uniform(0.05, 1.0, (4, 7, 3)).astype(np.float32)
WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.8, 0.8]}}
TURNED = Rotation.from_euler("xyz", [168, 9, 25], degrees=True).as_matrix()


def bitmap(data: npt.NDArray[Any] = TEXELS, **more: Any) -> Parts:
    return {"type": "bitmap", "raw": True, "data": data, "to_uv": np.eye(3), **more}


def placed(linear: FloatArray = TURNED, position: tuple[float, ...] = (0.3, 0.2, 1.6)) -> FloatArray:
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = linear, position
    return to_world


def projector(picture: Parts | None = None, **more: Any) -> Parts:
    picture = bitmap() if picture is None else picture
    return {"type": "projector", "irradiance": picture, "scale": 3.0, "fov": 52.0, "to_world": placed(), **more}


def spot(picture: Parts | None = None, **more: Any) -> Parts:
    picture = bitmap() if picture is None else picture
    intensity = {"type": "rgb", "value": [9.0, 6.0, 4.0]}
    return {
        "type": "spot",
        "texture": picture,
        "intensity": intensity,
        "cutoff_angle": 35.0,
        "beam_width": 28.0,
        "to_world": placed(),
        **more,
    }


def rectangle(half: float = 3.0, z: float = 0.0, bsdf: Parts = WHITE, **more: Any) -> Parts:
    return {"type": "rectangle", "to_world": placed(np.diag([half, half, 1.0]), (0.0, 0.0, z)), "bsdf": bsdf, **more}


def scene_of(integrator: Parts = DIRECT, floor: Parts | None = None, **parts: Parts) -> Scene:
    floor = rectangle() if floor is None else floor
    source = {"type": "scene", "integrator": integrator, "floor": floor, **parts}
    return Scene("slides", lambda: dict(source))


def native(scene: Scene, **settings: Any) -> NativeRenderer:
    renderer = make_renderer(scene, CAMERA, **{"rays_per_pixel": 1, "blur": False, **settings})
    assert isinstance(renderer, NativeRenderer)
    return renderer


def mitsubas(scene: Scene, rays: int = 1) -> npt.NDArray[np.float32]:
    with variant(FAST) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
    return IntegratorRenderer(loaded, CAMERA, rays_per_pixel=rays, blur=False, seed=0, reason="").luma(VIEWS)[0]


def assert_alike(scene: Scene, *, edges: int = 0, tolerance: float = 3e-4, **settings: Any) -> npt.NDArray[np.float32]:
    """Both follow one ray a pixel; all pixels but a few at edges have the same luma, and so has their mean."""
    ours, theirs = native(scene, **settings).luma(VIEWS)[0], mitsubas(scene)
    off = np.abs(ours - theirs) > tolerance * theirs.max()
    assert off.sum() <= edges, f"{off.sum()} pixels differ, by up to {np.abs(ours - theirs).max() / theirs.max()}"
    assert ours.mean() == pytest.approx(theirs.mean(), rel=tolerance + 0.01 * edges)
    assert theirs.std() > 0.1 * theirs.mean() > 0
    return theirs


TURNED_TEXTURE = np.array([[1.7, 0.4, 0.3], [-0.5, 2.1, 0.2], [0.0, 0.0, 1.0]])
GREY = TEXELS[..., :1]
LIGHTS: dict[str, Parts] = {
    "bilinear": projector(),
    "grey": projector(bitmap(GREY)),
    "fov of y": projector(fov_axis="y", fov=30.0),
    "fov of the diagonal": projector(fov_axis="diagonal"),
    "focal length": {key: value for key, value in projector(focal_length="35mm").items() if key != "fov"},
    "nearest": projector(bitmap(filter_type="nearest")),
    "repeat": projector(bitmap(to_uv=TURNED_TEXTURE, wrap_mode="repeat")),
    "mirror": projector(bitmap(to_uv=TURNED_TEXTURE, wrap_mode="mirror")),
    "clamp": projector(bitmap(to_uv=TURNED_TEXTURE, wrap_mode="clamp")),
    "sRGB": projector(bitmap((255 * TEXELS).astype(np.uint8), raw=False)),
    "faint": projector(bitmap(1e-5 * TEXELS, to_uv=TURNED_TEXTURE, wrap_mode="mirror"), scale=2e5),
    "bright": projector(bitmap(2e4 * TEXELS, to_uv=TURNED_TEXTURE, wrap_mode="clamp"), scale=1e-4),
    "one colour": projector({"type": "rgb", "value": [25.0, 38.0, 20.0]}),
    "checkerboard": projector(
        {"type": "checkerboard", "to_uv": np.diag([3.0, 2.0, 1.0]), "color1": {"type": "rgb", "value": [0.9, 0.3, 0.1]}}
    ),
    "mirrored": projector(to_world=placed(TURNED @ np.diag([-1.0, 1.0, 1.0]))),
    "larger": projector(to_world=placed(2.5 * TURNED)),
    "wide": projector(fov=150.0),
    "spot": spot(),
    "grey spot": spot(bitmap(GREY)),
    "nearest spot": spot(bitmap(filter_type="nearest")),
    "turned spot": spot(bitmap(to_uv=TURNED_TEXTURE, wrap_mode="mirror"), to_world=placed(0.5 * TURNED)),
}


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
def test_pictures_are_mitsubas(light: Parts) -> None:
    """Each pixel of a white floor; where light jumps, a pixel's ray may fall on the other side."""
    assert_alike(scene_of(lamp=light), edges=4)


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("light", [projector(), spot()], ids=["projector", "spot"])
def test_coloured_surfaces_and_shadows_are_mitsubas(light: Parts) -> None:
    """Each channel of the picture falls on that of the surface; a small screen throws its shadow, and is lit."""
    stripes = np.random.RandomState(6).uniform(0.1, 0.9, (6, 6, 3)).astype(np.float32)
    floor = rectangle(bsdf={"type": "diffuse", "reflectance": bitmap(stripes)})
    screen = rectangle(0.15, 0.5)
    with_screen = scene_of(floor=floor, lamp=light, screen=screen)
    theirs = assert_alike(with_screen, edges=3)
    assert (np.abs(theirs - mitsubas(scene_of(floor=floor, lamp=light))) > 0.1 * theirs.max()).sum() > 10


def test_a_shadow_ends_where_geometry_has_it() -> None:
    """On the line from the light past the edge of a half plane: on a pixel's scale of 0.3 mm, at two edges of it."""
    down = np.diag([1.0, -1.0, -1.0])
    light = projector({"type": "rgb", "value": [1.0, 1.0, 1.0]}, to_world=placed(down, (0.0, 0.0, 2.0)), fov=60.0)
    screen = {"type": "rectangle", "to_world": placed(np.diag([0.5, 0.5, 1.0]), (0.6, 0.0, 1.0)), "bsdf": WHITE}
    camera = Camera(201, 1, 5000.0, 5000.0, 100.0, 0.0)
    below = Pose([0.2, 0.0, 0.9], [1.0, 0.0, 0.0, 0.0])
    renderer = make_renderer(scene_of(lamp=light, screen=screen), camera, rays_per_pixel=1, blur=False)
    luma = renderer.luma(Views.at_rest([below]))[0, 0]
    lit = luma > 0.5 * luma.max()
    # The screen begins at x = 0.1, half-way down: its shadow begins at 0.2, in the middle of the image.
    assert lit[:100].all()
    assert not lit[102:].any()
    # The picture ends at tan 30 degrees.
    beyond = Pose([2 * np.tan(np.radians(30)), 0.9, 0.9], [1.0, 0.0, 0.0, 0.0])
    luma = make_renderer(scene_of(lamp=light), camera, rays_per_pixel=1, blur=False).luma(Views.at_rest([beyond]))[0, 0]
    assert luma[:99] == pytest.approx(3.0 * 0.8 / 4, rel=1e-4)
    assert not luma[102:].any()


GLOSSY: dict[str, Parts] = {
    "gold": {"type": "roughconductor", "material": "Au", "alpha": 0.3, "distribution": "ggx"},
    "plastic": {"type": "roughplastic", "alpha": 0.2, "diffuse_reflectance": {"type": "rgb", "value": [0.6, 0.3, 0.1]}},
}


@pytest.mark.few(4)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("bsdf", GLOSSY.values(), ids=GLOSSY)
@pytest.mark.parametrize("light", [projector(), projector(bitmap(filter_type="nearest")), spot()])
def test_glossy_surfaces_are_mitsubas(light: Parts, bsdf: Parts) -> None:
    assert_alike(scene_of(floor=rectangle(bsdf=bsdf), lamp=light), edges=4, tolerance=1e-3)


@pytest.mark.usefixtures("llvm")
def test_smooth_meshes_are_mitsubas() -> None:
    """On surfaces whose normal changes, light from a position takes other steps."""
    ball = {"type": "sphere", "center": [0.1, 0.1, 0.3], "radius": 0.3, "bsdf": WHITE}
    scene = scene_of(lamp=projector(), ball=ball)
    ours, theirs = native(scene).luma(VIEWS)[0], mitsubas(scene)
    # The outline of its triangles is another than the ball's.
    assert (np.abs(ours - theirs) > 0.02 * theirs.max()).mean() < 0.06


@pytest.mark.few(1)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("light", [projector(scale=20.0), spot()], ids=["projector", "spot"])
def test_bounces_are_the_path_tracers(light: Parts) -> None:
    """A red picture on the floor reddens a wall that the light does not see."""
    wall = {
        "type": "rectangle",
        "to_world": placed(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), (-0.7, 0.0, 1.0)),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.9, 0.2, 0.1]}},
    }
    scene = scene_of({"type": "path", "max_depth": 3}, floor=rectangle(1.0), lamp=light, wall=wall)
    ours, theirs = native(scene, kind="baked", bake_error=0.03, rays_per_pixel=16).luma(VIEWS)[0], mitsubas(scene, 1024)
    direct = native(scene_of(floor=rectangle(1.0), lamp=light, wall=wall), rays_per_pixel=16).luma(VIEWS)[0]
    bounced = theirs - direct
    unlit = direct < 1e-3 * direct.max()
    assert unlit.sum() > 50
    assert bounced.mean() > 0.02 * direct.mean()
    assert (ours - direct)[unlit].mean() == pytest.approx(bounced[unlit].mean(), rel=0.03)
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.01)


FILE = """<scene version="3.0.0"><default name="angle" value="40"/><default name="integrator" value="direct"/>
<shape type="rectangle" id="floor"><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></shape>
<emitter type="KIND" id="lamp"><float name="ANGLE" value="$angle"/>
<texture type="bitmap" name="PICTURE"><string name="filename" value="picture.png"/></texture>
<transform name="to_world"><lookat origin="0.3,0.2,2" target="0,0,0" up="0,1,0"/></transform></emitter>
<integrator type="$integrator"/></scene>"""


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(
    ("kind", "angle", "picture"), [("projector", "fov", "irradiance"), ("spot", "cutoff_angle", "texture")]
)
def test_scene_files(kind: str, angle: str, picture: str, tmp_path: Path) -> None:
    """With an image in sRGB: no renderer with noise is taken, and luma is Mitsuba's, also by other variables."""
    Image.fromarray((255 * TEXELS).astype(np.uint8)).save(tmp_path / "picture.png")
    file = tmp_path / "scene.xml"
    file.write_text(FILE.replace("KIND", kind).replace("ANGLE", angle).replace("PICTURE", picture))
    seen = []
    for variables in ({}, {"angle": "25"}):
        scene = load_scene(file, variables=variables)
        assert f"triangles under {kind} light, with shadows" in native(scene).reason
        seen.append(assert_alike(scene, edges=4))
    assert not np.allclose(seen[0], seen[1])
    path = load_scene(file, variables={"integrator": "path"})
    free = {name: kind for name, kind in RENDERER_KINDS.items() if isinstance(kind, NoiseFreeKind) and name != "table"}
    assert [name for name, kind in free.items() if not kind.why_not(path)] == ["baked"]


def test_baked_light_is_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Light of another picture, filter, wrap mode or field of view is not taken from the cache."""
    monkeypatch.setenv("DAVIS_RS_CACHE_DIR", str(tmp_path))
    pictures = [bitmap(), bitmap(TEXELS[::-1]), bitmap(filter_type="nearest"), bitmap(wrap_mode="mirror")]
    lights = [*map(projector, pictures), projector(fov=52.001), spot(), spot(bitmap(wrap_mode="clamp"))]
    contents = set()
    for light in lights:
        baked = native(scene_of(floor=rectangle(0.2), lamp=light), kind="baked", bake_error=0.3).baked
        assert baked is not None
        contents.add(baked.content)
    assert len(contents) == len(lights)


PATH = SegmentTrajectory(
    POSE,
    Pose(
        [0.25, -0.2, 1.85], (Rotation.from_quat(POSE.quaternion) * Rotation.from_rotvec([0.03, 0.05, 0.08])).as_quat()
    ),
    0.1,
)


@pytest.mark.parametrize(
    ("bsdf", "pixel"),
    [(WHITE, "rays"), (WHITE, "lines"), *((bsdf, "rays") for bsdf in GLOSSY.values())],
    ids=["diffuse", "lines", *GLOSSY],
)
@pytest.mark.parametrize("light", [projector(), spot()], ids=["projector", "spot"])
def test_rates_are_the_changes_of_luma(light: Parts, bsdf: Parts, pixel: str) -> None:
    """Along a path, but where light jumps; luma with and without rates has the same bits."""
    scene = scene_of(floor=rectangle(bsdf=bsdf), lamp=light)
    settings = {"pixel": pixel} | ({} if pixel == "rays" else {"rays_per_pixel": 8})
    renderer, step = native(scene, **settings), 2e-4
    luma = renderer.luma(Views.along(PATH, np.array([0.05 - step, 0.05, 0.05 + step])))
    at, rate = renderer.luma_and_rate(Views.along(PATH, np.array([0.05])))
    assert np.array_equal(at[0], luma[1])
    off = np.abs(rate[0] - (luma[2] - luma[0]) / (2 * step))
    assert np.quantile(off, 0.9) < 0.02 * np.abs(rate).max()


def test_lights_flicker() -> None:
    """A light's profile multiplies all channels of its picture."""
    scene = replace(scene_of(lamp=projector()), lights={"lamp": Flicker(3.0, modulation=0.5)})
    renderer = native(scene)
    t_s = np.array([0.0, 0.07])
    luma = renderer.luma(Views.along(SegmentTrajectory(POSE, POSE, 1.0), t_s))
    factors = renderer.motion.at(t_s).factors[:, 0]
    assert factors[0] != pytest.approx(factors[1], rel=0.05)
    plain = native(scene_of(lamp=projector())).luma(VIEWS)[0]
    np.testing.assert_allclose(luma, plain * factors[:, None, None], rtol=1e-5)


@pytest.mark.parametrize(
    "light", [spot(), spot(bitmap(GREY), beam_width=5.0), projector()], ids=["colours", "grey", "projector"]
)
def test_derivatives_are_the_changes_of_luma(light: Parts) -> None:
    """By the camera's position, in float64; a projector's but for its edges."""
    renderer, step = native(scene_of(lamp=light)), 1e-5
    count = CAMERA.width * CAMERA.height
    pixel, view = np.arange(count, dtype=np.uint32)[:, None], np.zeros(count, np.uint32)

    def at(shift: FloatArray) -> FloatArray:
        moved = Views.at_rest([Pose(np.asarray(POSE.position) + shift, POSE.quaternion)])
        return renderer.gradients(moved, view, pixel, np.ones(1))

    here = at(np.zeros(3))
    np.testing.assert_allclose(here[:, 0], renderer.luma(VIEWS)[0].ravel(), rtol=2e-3, atol=1e-5)
    for axis in range(3):
        change = (at(step * np.eye(3)[axis])[:, 0] - at(-step * np.eye(3)[axis])[:, 0]) / (2 * step)
        off = np.abs(here[:, 2 + axis] - change)
        assert np.quantile(off, 0.97) < 1e-4 * np.abs(change).max()


def test_times_of_events_have_no_derivatives_at_the_edges_of_a_picture() -> None:
    """Of pictures without edges they have."""
    small = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
    for light in (projector(), spot(bitmap(filter_type="nearest"))):
        scene = replace(scene_of(lamp=light), camera=small, trajectory=PATH)
        with pytest.raises(ValueError, match="the edges of what light 'lamp' throws"):
            EventTimeModel(scene, accuracy="fast")
    EventTimeModel(replace(scene_of(lamp=spot()), camera=small, trajectory=PATH), accuracy="fast")


@pytest.mark.parametrize(
    ("light", "message"),
    [
        (
            projector(to_world=placed(TURNED @ np.diag([2.0, 1.0, 1.0]))),
            "the projector 'lamp' is stretched by its transform: turn",
        ),
        (
            spot(to_world=placed(TURNED @ np.diag([2.0, 1.0, 1.0]))),
            "the spot light 'lamp' is stretched by its transform",
        ),
        (spot(cutoff_angle=90.0), "has a texture and a cutoff_angle of 90 degrees or more: make it narrower"),
        (
            projector({"type": "checkerboard", "color0": bitmap()}),
            "the projector 'lamp' throws a checkerboard, which is no bitmap: give it as one",
        ),
    ],
)
def test_what_is_refused(light: Parts, message: str) -> None:
    """With the reason and the remedy; auto takes Mitsuba's integrators."""
    scene = scene_of(lamp=light)
    for kind in ("native", "baked"):
        with pytest.raises(ValueError, match=message):
            make_renderer(scene, CAMERA, kind=kind)
    assert [message in str(obstacle) for obstacle in why_not_noise_free(scene)] == [True]


def test_impossible_light_is_an_error() -> None:
    for light, name in ((projector(bitmap(-TEXELS)), "irradiance.data"), (spot(bitmap(-TEXELS)), "texture.data")):
        with pytest.raises(ValueError, match=rf"light 'lamp', a \w+, has {name} -.*; light is finite and not negative"):
            make_renderer(scene_of(lamp=light), CAMERA, kind="baked")
        with pytest.raises(ValueError, match="a slide is finite, and its texels are not negative"):
            make_renderer(scene_of(lamp=light), CAMERA, kind="native")
    with pytest.raises(ValueError, match=r"'lamp', a Projector, has scale -1"):
        make_renderer(scene_of(lamp=projector(scale=-1.0)), CAMERA, kind="baked")


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(("light", "kind"), [(projector(), "a projector"), (spot(), "a spot light")])
def test_the_table_kernel_has_none(light: Parts, kind: str) -> None:
    with pytest.raises(ValueError, match=f"a light is {kind}, which only the native renderer has"):
        make_renderer(scene_of(lamp=light), CAMERA, kind="table")


def one_slide(**more: Any) -> SceneRenderer:
    """A core whose only light has a slide of one texel."""
    given = {
        "rows": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        "map": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        "projected": True,
        "nearest": False,
        "layout": [1, 1, 0],
        "texels": np.ones(9, np.float32),
        "light": (0, 0),
        "kind": "point",
    } | more
    light = (given.pop("kind"), 0, 1.0, 0.0, [0.0, 0.0, 0.0], None, given.pop("light"))
    return one_triangle(lights=[light], slides=[tuple(given.values())])


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"texels": np.ones(8, np.float32)}, "a slide of 1 x 1 texels has 9 in a frame, once or three times, got 8"),
        ({"texels": np.full(9, np.nan, np.float32)}, "a slide is finite"),
        ({"texels": np.full(9, -1.0, np.float32)}, "its texels are not negative"),
        ({"rows": [[np.inf, 0.0, 0.0]] * 3}, "a slide is finite"),
        ({"layout": [0, 1, 0]}, "a side of 1"),
        ({"layout": [1, 1, 3]}, "a wrap mode of 0..2"),
        ({"light": (1, 0)}, "a slide is that of a light at a position, and one of 1"),
        ({"light": (0, 1)}, "a slide is that of a light at a position, and one of 1"),
        ({"kind": "constant"}, "a slide is that of a light at a position"),
    ],
)
def test_the_core_refuses_slides_that_do_not_fit(more: Parts, message: str) -> None:
    one_slide()
    one_slide(texels=np.ones(27, np.float32), light=(0, 2))
    with pytest.raises(ValueError, match=message):
        one_slide(**more)
