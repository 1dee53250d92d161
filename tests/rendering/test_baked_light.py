"""Baked light: against closed forms and the path tracer, no seams, the same bits, its cache, and what is refused."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partialmethod
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import Pose, Scene, SegmentTrajectory, Simulator, estimate_noise, load_scene, plan_effects
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs.accuracy.light_accuracy import LightComparison, light_cost
from davis_rs.cli import main
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.baked import bake, baked_scene, cache
from davis_rs.render.baked.irradiance import Irradiance, Surfaces
from davis_rs.render.baked.light_maps import LightMaps, looked_up
from davis_rs.render.baked.lights import irradiance_of
from davis_rs.render.baked.partial import PartialBake
from davis_rs.render.baked.surface_lattice import RefinementRule, SurfaceLattice, refine
from davis_rs.render.choice import make_renderer, why_not_noise_free
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.scene_tables import scene_table
from davis_rs.render.scene_tables.scene_table import SceneTable
from davis_rs.scene.light_profile import SampledProfile
from irradiance_reference import traced_irradiance
from lamp_box import lamp_box
from lit_scenes import (
    CAMERA,
    DIRECT,
    DOWN,
    PATH,
    FloatArray,
    Parts,
    area,
    build,
    colourful,
    diffuse,
    environment,
    lamp,
    luma_of,
    make_scene,
    noise,
    plate,
    shift,
)
from places import HELPERS

pytestmark = pytest.mark.without_llvm


@pytest.fixture
def folder(light_cache: Path) -> Path:
    """Of tests of the cache itself; the others share the session's, so that a scene is baked once."""
    return light_cache


@pytest.mark.parametrize(
    ("reflectance", "depth", "asked", "error"), [(0.5, -1, 0.15, 0.025), (0.9, -1, 0.15, 0.08), (0.9, 12, 0.9, 0.12)]
)
def test_a_furnace_has_the_radiance_of_its_closed_form(
    reflectance: float, depth: int, asked: float, error: float
) -> None:
    """In a closed box whose walls all emit L and reflect rho, all is as bright as L / (1 - rho): direct light, all
    bounces, and what lamps look like themselves; less where the integrator lets light bounce a few times. Direct light,
    and all that bounces of it, may err as is asked for."""
    walls = {"type": "cube", "flip_normals": True, "bsdf": diffuse(reflectance), "emitter": area(0.7)}
    scene = make_scene(walls=walls, integrator={"type": "path", "max_depth": depth})
    luma = luma_of(scene, asked, pose=Pose([0.1, 0.2, 0.3], DOWN.quaternion))
    expected = 0.7 * (1 - (reflectance**depth if depth > 0 else 0)) / (1 - reflectance)
    assert np.median(luma) == pytest.approx(expected, rel=error)
    assert np.ptp(luma) < 0.15 * expected


def test_light_of_a_rectangle_is_that_of_its_form_factor() -> None:
    """A level lamp over a floor: reflectance times radiance times the closed form of the configuration factor."""
    floor, half, height = plate(0, 0, 0, (3, 3)), (0.4, 0.3), 2.0
    scene = make_scene(DIRECT, floor=floor, lamp=lamp(height, 5.0, half))
    x, y = np.meshgrid(*(np.arange(n) for n in (CAMERA.width, CAMERA.height)))
    rays = CAMERA.rays(np.stack([x, y], -1).astype(float))
    # One ray a pixel; the camera looks down, its x along the world's.
    place = np.stack([1.4 * rays[..., 0] - 0.1, -1.4 * rays[..., 1] - 0.2], -1)
    factor = sum(
        sx * sy * _corner_factor((sx * half[0] - place[..., 0]) / height, (sy * half[1] - place[..., 1]) / height)
        for sx in (-1, 1)
        for sy in (-1, 1)
    )
    luma = luma_of(scene, 0.01, rays_per_pixel=1)
    assert luma == pytest.approx(0.6 * 5.0 * factor, rel=0.01)


def _corner_factor(a: FloatArray, b: FloatArray) -> FloatArray:
    """Of a parallel rectangle whose corner is above the place (Howell, catalogue of configuration factors, B-4)."""
    p, q = np.sqrt(1 + a**2), np.sqrt(1 + b**2)
    return np.asarray((a / p * np.arctan(b / p) + b / q * np.arctan(a / q)) / (2 * np.pi))


PLATE = '<shape type="rectangle"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>'
SKY = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
SUN = f"""<emitter type="directional"><vector name="direction" x="0" y="0" z="-1"/>
    <rgb name="irradiance" value="{0.42 * np.pi!r}"/></emitter>"""


def test_lights_without_a_name_shine(tmp_path: Path) -> None:
    """A plate of reflectance 0.5 under what shines, by closed forms: nothing in the file has an id."""
    for lights, luma in ((SKY, 0.5), (SKY + SUN, 0.71)):
        path = tmp_path / "scene.xml"
        path.write_text(f'<scene version="3.0.0">{PLATE}{lights}</scene>')
        renderer = make_renderer(load_scene(path), CAMERA, rays_per_pixel=1, bake_error=0.05)
        assert renderer.luma(Views.at_rest([DOWN])) == pytest.approx(luma, rel=1e-3), lights


def test_light_that_is_baked_nowhere_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Surfaces would be black, and nothing would say so."""
    monkeypatch.setattr(bake._BakeJob, "sampled", lambda self, lights: ([[] for _ in lights], [None for _ in lights]))
    with pytest.raises(RuntimeError, match="baked at no point"):
        build(make_scene(floor=plate(0, 0, 0, (1, 1)), sky={"type": "constant"}))


def test_lamps_without_a_name_are_told_apart(tmp_path: Path) -> None:
    """A large lamp, whose light is baked, and one so small that the renderer has it, neither with an id: together they
    give the sum of each alone."""

    def lamp_at(x: float, half: float) -> str:
        place = f'<scale value="{half}"/><rotate x="1" angle="180"/><translate x="{x}" z="2"/>'
        glows = f'<emitter type="area"><rgb name="radiance" value="{1 / half**2}"/></emitter>'
        return f'<shape type="rectangle"><transform name="to_world">{place}</transform>{glows}</shape>'

    def luma(*lamps: str) -> npt.NDArray[np.float32]:
        path = tmp_path / "scene.xml"
        path.write_text(f'<scene version="3.0.0"><integrator type="direct"/>{PLATE}{"".join(lamps)}</scene>')
        return make_renderer(load_scene(path), CAMERA, kind="baked", rays_per_pixel=1).luma(Views.at_rest([DOWN]))

    large, small = lamp_at(-0.9, 0.3), lamp_at(0.9, 0.005)
    alone = luma(large), luma(small)
    assert min(one.min() for one in alone) > 0.02
    np.testing.assert_allclose(luma(large, small), alone[0] + alone[1], rtol=0.02)


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_coloured_light_that_bounces_is_the_path_tracers(long: bool) -> None:
    """All kinds of light at once, in colour: the path tracer's luma, but for its noise."""
    scene = make_scene(**colourful())
    baked = luma_of(scene, 0.02 if long else 0.05, rays_per_pixel=64)
    traced = luma_of(scene, kind="integrator", rays_per_pixel=1024)
    assert np.median(baked / traced) == pytest.approx(1.0, abs=0.01)
    assert np.quantile(np.abs(baked / traced - 1), 0.9) < 0.04


def lit_by(scene: Scene) -> Irradiance:
    """The light of a scene, all lamps together."""
    with variant(SCALAR) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        table = SceneTable(loaded, mi, shadows=True, any_integrator=True, baked=True)
        return irradiance_of(loaded, mi, table.surfaces, [""], PartialBake())(0.0)[0]


def outdoors() -> dict[str, Parts]:
    """A block on the ground under a sky of gradients with a bright spot, and a spot light."""
    rows, columns = np.meshgrid(np.linspace(1.0, 0.1, 16), np.cos(np.linspace(0, 2 * np.pi, 32)), indexing="ij")
    sky = np.stack([rows, 0.6 * rows + 0.1 * columns * rows, 0.5 + 0.3 * columns * rows], -1)
    sky[3:5, 9:11] = 20.0
    towards = np.array([[1, 0, 0, -0.3], [0, -1, 0, 0.2], [0, 0, -1, 1.2], [0, 0, 0, 1]], float)
    return {
        "floor": plate(0, 0, 0, (0.8, 0.5)),
        "block": colourful()["block"],
        "sky": environment(sky) | {"scale": 0.7},
        "spot": {"type": "spot", "to_world": towards, "cutoff_angle": 25, "beam_width": 10, "intensity": 3.0},
    }


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_an_environment_map_and_a_spot_light_are_the_path_tracers() -> None:
    """Their light on surfaces, together with the sky, and the edges of the beam."""
    scene = make_scene(PATH | {"max_depth": 3}, **outdoors())
    pose = Pose([0.3, -1.6, 1.2], [-0.85, 0.0, 0.0, 0.527])
    baked = luma_of(scene, 0.05, pose, rays_per_pixel=64)
    traced = luma_of(scene, pose=pose, kind="integrator", rays_per_pixel=1024)
    assert traced.max() > 4 * traced.min()
    assert np.median(baked / traced) == pytest.approx(1.0, abs=0.01)
    assert np.quantile(np.abs(baked / traced - 1), 0.9) < 0.04


def test_rates_of_skies_and_beams_are_the_changes_of_luma() -> None:
    """A turning camera sees the environment map move, and comes nearer to a spot light's edge."""
    scene = make_scene(DIRECT, **outdoors())
    turned = Rotation.from_quat([-0.85, 0.0, 0.0, 0.527]) * Rotation.from_rotvec([0.05, 0.1, 0.02])
    path = SegmentTrajectory(
        Pose([0.3, -1.6, 1.2], [-0.85, 0.0, 0.0, 0.527]), Pose([0.2, -1.5, 1.3], turned.as_quat()), 1.0
    )
    renderer = build(scene, 0.2, rays_per_pixel=1)
    step = 2e-3
    luma = renderer.luma(Views.along(path, np.array([0.5 - step, 0.5 + step])))
    _, rate = renderer.luma_and_rate(Views.along(path, np.array([0.5])))
    off = np.abs(rate[0] - (luma[1] - luma[0]) / (2 * step))
    assert np.quantile(off, 0.8) < 0.02 * np.abs(rate).max()


@pytest.mark.usefixtures("llvm")
def test_a_small_block_on_a_wide_ground_has_light_that_bounces() -> None:
    """Its shaded side is lit by the sunny ground alone, and by less of it at its foot."""
    scene = make_scene(
        PATH | {"max_depth": 3},
        floor=plate(0, 0, 0, (6, 6)),
        block={"type": "cube", "to_world": np.diag([0.3, 0.3, 0.3, 1.0]) + shift(0, 0.3, 0.3), "bsdf": diffuse(0.7)},
        sun={"type": "directional", "direction": [0.0, -0.5, -1.0], "irradiance": 3.0},
    )
    pose = Pose([0.0, -0.45, 0.2], [-(0.5**0.5), 0.0, 0.0, 0.5**0.5])  # looks at the shaded side
    baked = luma_of(scene, 0.05, pose, rays_per_pixel=16)
    traced = luma_of(scene, pose=pose, kind="integrator", rays_per_pixel=512)
    rows, true = baked.mean(1), traced.mean(1)
    assert true.max() > 1.5 * true.min() > 0
    assert rows == pytest.approx(true, rel=0.05)


@pytest.mark.usefixtures("llvm")
def test_a_small_lamp_has_sharp_shadows() -> None:
    """A lamp of 2 cm over a screen: the path tracer's luma, but for the lattice's steps in the shadow's edge."""
    scene = make_scene(
        DIRECT,
        floor=plate(0, 0, 0, (1.5, 1.5)),
        screen=plate(0.28, 0, 0.7, (0.2, 0.3)),
        panel=lamp(1.2, 900.0, (0.01, 0.01)),
    )
    baked = luma_of(scene, 0.2, Pose([0.0, 0.0, 0.6], DOWN.quaternion), rays_per_pixel=16)
    traced = luma_of(scene, pose=Pose([0.0, 0.0, 0.6], DOWN.quaternion), kind="integrator", rays_per_pixel=256)
    assert traced.min() < 0.01 * traced.max()
    assert np.quantile(np.abs(baked - traced), 0.95) < 0.02 * traced.max()
    assert baked.mean() == pytest.approx(traced.mean(), rel=0.02)


@pytest.mark.parametrize("shape", ["sphere", "cube"])
def test_a_small_lamp_is_as_bright_from_all_sides(tmp_path: Path, shape: str) -> None:
    """A bulb, and a cube, near a plate: luma by the area that each shows to a place, in closed form."""
    half, radiance = 0.004, 1e4
    for azimuth in np.linspace(0.3, 5.9, 5):
        at = np.array([0.5 * np.cos(azimuth), 0.5 * np.sin(azimuth), 0.6])
        place = f'<scale value="{half}"/><translate x="{at[0]}" y="{at[1]}" z="{at[2]}"/>'
        glows = f'<emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter>'
        bulb = f'<shape type="{shape}"><transform name="to_world">{place}</transform>{glows}</shape>'
        path = tmp_path / "scene.xml"
        path.write_text(f'<scene version="3.0.0"><integrator type="direct"/>{PLATE}{bulb}</scene>')
        renderer = make_renderer(load_scene(path), CAMERA, kind="baked", rays_per_pixel=1)
        assert {light.kind for light in renderer.table.lights} >= {"lamp"}
        luma = renderer.luma(Views.at_rest([DOWN]))[0]
        y, x = (side // 2 for side in luma.shape)
        middle = luma[y - 1 : y + 1, x - 1 : x + 1].mean()
        away = np.array([*DOWN.position[:2], 0.0]) - at
        distance = float(np.linalg.norm(away))
        shown = np.pi * half**2 if shape == "sphere" else 4 * half**2 * np.abs(away / distance).sum()
        expected = 0.5 / np.pi * radiance * shown * (-away[2] / distance) / distance**2
        assert middle == pytest.approx(expected, rel=0.04), azimuth


def moving_camera() -> Scene:
    """A lamp over a patterned floor, and a camera that moves."""
    stripes = {"type": "bitmap", "raw": True, "data": noise(1, 0.2, 0.8, (16, 16, 1))}
    return replace(
        make_scene(PATH | {"max_depth": 3}, floor=plate(0, 0, 0, (1, 1), diffuse(stripes)), panel=lamp()),
        camera=CAMERA,
        trajectory=SegmentTrajectory(DOWN, Pose(np.add(DOWN.position, [0.3, 0, 0]), DOWN.quaternion), 0.05),
    )


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_what_baking_saves_and_errs(folder: Path) -> None:
    """Baked light is nearer to the reference than few samples of the path tracer; runs of the reference are kept."""
    scene = moving_camera()
    kept = folder.parent / "kept"
    settings: Any = {"runs": 2, "reference_samples": 128, "duration_s": 0.05, "bake_error": 0.05, "folder": kept}
    halves, traced, baked = LightComparison(scene, CAMERA, rays=32, **settings).measure((2,))
    assert baked.bake_s is not None
    assert traced.bake_s is None
    assert min(baked.frame_ms or 0, traced.frame_ms or 0) > 0
    assert halves.events > 100
    assert max(halves.wrong_percent, baked.wrong_percent) < 0.5 * traced.wrong_percent
    assert max(halves.log_rms, baked.log_rms) < 0.5 * traced.log_rms
    files = sorted(kept.iterdir())
    assert len(files) == 2
    np.save(files[0], np.full((2, CAMERA.height, CAMERA.width), 1.0, np.float32))
    again = next(LightComparison(scene, CAMERA, rays=32, **settings).measure(()))
    assert again.log_rms > 1.0
    with pytest.raises(ValueError, match="even number from 2 on, got 3"):
        LightComparison(scene, CAMERA, **{**settings, "runs": 3})
    line = light_cost(build(scene), scene)
    assert line is not None
    assert re.match(
        r"baked light: [\d,]+ points, error \S+ %, baked in \S+ s \(now in the cache\); a frame takes", line
    )
    assert light_cost(build(scene, kind="integrator", rays_per_pixel=1), scene) is None


@pytest.mark.usefixtures("llvm")
def test_the_command_line_compares_light(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("davis_rs.cli.accuracy.scene_of", lambda *_: moving_camera())
    monkeypatch.setattr("davis_rs.cli.accuracy.LIGHT_SAMPLES", (2,))
    monkeypatch.setattr(LightComparison, "measure", partialmethod(LightComparison.measure, (2,)))
    monkeypatch.setattr(LightComparison, "__init__", partialmethod(LightComparison.__init__, reference_samples=64))
    out = folder.parent / "out"
    given = ["accuracy", "three_planes", "-o", str(out), "--light", "2", "--duration", "0.05", "--bake-error", "0.2"]
    assert main(given) == 0
    table = (out / "light.md").read_text()
    assert table.count("\n| ") == 4
    assert "baked, error 0.2, 256 rays" in capsys.readouterr().out
    assert main([*given, "--rounds", "2"]) == 1
    assert "--light compares light alone" in capsys.readouterr().err
    assert main([*given[:4], "--bake-error", "0.2"]) == 1
    assert "--bake-error is for --light" in capsys.readouterr().err


@pytest.mark.long
def test_places_apart_err_independently() -> None:
    """A lamp over a floor, from few points: errors average out over the floor, and between neighbours hardly differ."""
    across = np.linspace(-0.95, 0.95, 96)
    x, y = np.meshgrid(across, across[::12])
    places = np.stack([x, y, 0 * x], -1).reshape(-1, 3)
    normals = np.tile([0.0, 0.0, 1.0], (len(places), 1))
    light = lit_by(make_scene(DIRECT, floor=plate(0, 0, 0, (1, 1)), panel=lamp(0.5)))
    truth = light.direct(places, normals, 8192, 100)[:, 0]
    found = np.array([light.direct(places, normals, 64, shift)[:, 0] for shift in range(4)])
    off = (found / truth - 1).reshape(4, *x.shape)
    rms = np.sqrt((off**2).mean())
    assert np.sqrt((off.mean((1, 2)) ** 2).mean()) < 0.2 * rms
    assert np.sqrt((np.diff(off, axis=2) ** 2).mean()) < 0.6 * rms


@pytest.mark.usefixtures("llvm")
@pytest.mark.long
def test_the_error_that_is_told_is_that_of_the_path_tracer() -> None:
    """In the box with a lamp: the run's own estimate against direct light and paths of Mitsuba's own, elsewhere."""
    scene = lamp_box(16)
    captured = list[tuple[Surfaces, LightMaps]]()

    def kept(surfaces: Surfaces, *arguments: Any, **settings: Any) -> LightMaps:
        captured.append((surfaces, bake.bake(surfaces, *arguments, **settings)))
        return captured[0][1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(baked_scene, "bake", kept)
        make_renderer(scene, scene.own_camera, kind="baked", rays_per_pixel=1, bake_error=0.05)
    ((surfaces, maps),) = captured
    random = np.random.RandomState(5)
    triangle = random.randint(len(surfaces.corners), size=300)
    weight = random.dirichlet(np.ones(3), 300)
    places = np.einsum("nk,nkd->nd", weight, surfaces.corners[triangle])
    truth = traced_irradiance(scene, places, surfaces.normals[triangle, 0], 4096, 9)
    found = looked_up(maps.texels[0], maps.layouts[triangle, 0], weight)
    lit = truth[:, 1] > 1e-3 * np.median(truth[:, 1])
    shares = found[lit, 1] / truth[lit, 1]
    off = np.quantile(np.abs(shares - 1), 0.68)
    assert 0.5 * maps.error < off < 2 * maps.error
    assert off < 0.05
    assert np.median(shares) == pytest.approx(1.0, abs=0.006)


def test_light_has_no_seam_where_triangles_meet() -> None:
    """Triangles that are divided differently agree along their common edge, and nothing is lost at a crease."""
    corners = np.array(
        [
            [[0, 0, 0], [2, 0, 0], [0, 2, 0]],
            [[2, 0, 0], [2, 2, 0], [0, 2, 0]],
            [[0, 0, 0], [0, 2, 0], [-0.1, 1, 0]],
            [[2, 0, 0], [2, 0, 2], [2, 2, 0]],
        ],
        float,
    )
    normals = np.repeat(np.array([[0, 0, 1.0]] * 3 + [[-1, 0, 0]])[:, None], 3, 1)
    lattice = SurfaceLattice(corners, normals, np.zeros(4, bool), np.zeros(4, int))

    def light(places: FloatArray, facing: FloatArray, *_: Any) -> tuple[FloatArray, FloatArray]:
        spot = np.exp(-((places[:, 0] - 0.6) ** 2 + (places[:, 1] - 0.8) ** 2) / 0.02)
        return np.repeat((1 + spot + facing[:, :1].T[0])[:, None], 3, 1), np.zeros(len(places))

    sampled = refine(lattice, light, RefinementRule(0.5, 0.02, 0.01, 100_000))
    divisions = sampled.divisions()
    assert len(set(divisions.tolist())) > 1
    grids = {face: grid for faces, grids in sampled.grids(divisions) for face, grid in zip(faces, grids, strict=True)}

    def along(face: int, start: int, end: int, at: FloatArray) -> FloatArray:
        grid = grids[face][..., 0]
        cells = len(grid) - 1
        corner = np.array([[0, 0], [cells, 0], [0, cells]])
        place = corner[start] + at[:, None] * (corner[end] - corner[start])
        i, j = np.minimum(place.astype(int), cells - 1).T
        x, y = (place - np.stack([i, j], 1)).T
        row = grid[i, j] * (1 - x) + grid[i + 1, j] * x, grid[i, j + 1] * (1 - x) + grid[i + 1, j + 1] * x
        return np.asarray(row[0] * (1 - y) + row[1] * y)

    at = np.linspace(0.0, 1.0, 1001)
    assert along(0, 1, 2, at) == pytest.approx(along(1, 0, 2, at), abs=1e-12)
    assert along(0, 0, 2, at) == pytest.approx(along(2, 0, 1, at), abs=1e-12)
    x = np.linspace(0.0, 2.0, 1001)
    truth = light(np.stack([x, 2 - x, 0 * x], 1), np.zeros((1001, 3)), np.zeros(1001, int))[0][:, 0]
    assert along(0, 1, 2, at)[::-1] == pytest.approx(truth, rel=0.01)
    # The upright triangle has the floor's edge, but its own normal and so its own light.
    assert along(3, 0, 2, at).max() < 0.5


def test_a_walk_along_a_seam_makes_no_events() -> None:
    """Two plates without texture that meet under the camera's path: luma changes as smoothly as within one."""
    left, right = plate(-0.7, 0, 0, (0.7, 1.5)), plate(0.9, 0, 0, (0.9, 1.5))
    scene = make_scene(left=left, right=right, panel=lamp())
    path = SegmentTrajectory(Pose([0.0, -0.3, 0.4], DOWN.quaternion), Pose([0.0, 0.3, 0.4], DOWN.quaternion), 1.0)
    luma = build(scene).luma(Views.along(path, np.linspace(0.0, 1.0, 9)))
    across = np.diff(np.log(luma), axis=2)
    assert np.abs(across - across.mean(axis=2, keepdims=True)).max() < 0.01


def test_rates_are_the_changes_of_luma() -> None:
    """The rate of luma under baked light, a lamp's flicker included, is what luma does between two instants."""
    profile = SampledProfile([0.0, 1.0], [0.5, 1.5])
    texture = {"type": "bitmap", "raw": True, "data": noise(0, 0.3, 0.6, (3, 3, 3))}
    scene = make_scene(
        DIRECT, lights={"panel.emitter": profile}, floor=plate(0, 0, 0, (2, 2), diffuse(texture)), panel=lamp()
    )
    path = SegmentTrajectory(DOWN, Pose([0.2, 0.1, 1.3], DOWN.quaternion), 1.0)
    renderer = build(scene, rays_per_pixel=1)
    step = 1e-3
    luma = renderer.luma(Views.along(path, np.array([0.5 - step, 0.5 + step])))
    _, rate = renderer.luma_and_rate(Views.along(path, np.array([0.5])))
    assert np.median(np.abs(rate[0] - (luma[1] - luma[0]) / (2 * step))) < 2e-3 * np.abs(rate).max()


def test_the_rate_of_a_lamp_that_is_seen_is_that_of_its_flicker() -> None:
    """A camera at rest looks up at a lamp that gets brighter: of its own light and of what it lights."""
    profile = SampledProfile([0.0, 1.0], [0.5, 1.5])
    pose = Pose([0.0, 0.0, 0.2], [0.0, 0.0, 0.0, 1.0])
    wall = plate(0, 0, 3, (2, 2), up=False)
    scene = make_scene(DIRECT, lights={"first.emitter": profile}, wall=wall, first=lamp(1.0, 3.0, (0.1, 0.1)))
    renderer = build(scene, 0.2, rays_per_pixel=1)
    path = SegmentTrajectory(pose, pose, 1.0)
    luma = renderer.luma(Views.along(path, np.array([0.25, 0.75])))
    _, rate = renderer.luma_and_rate(Views.along(path, np.array([0.5])))
    assert rate.max() > 1.0
    np.testing.assert_allclose(rate[0], (luma[1] - luma[0]) / 0.5, rtol=1e-3, atol=1e-5)


@pytest.mark.long
def test_lights_flicker_one_by_one() -> None:
    """A lamp on a profile and one without: the first one's light and look change, the other's stay."""
    profile = SampledProfile([0.0, 1.0], [1.0, 0.25])
    parts = {"floor": plate(0, 0, 0, (2, 2)), "wall": plate(0, 0, 3, (2, 2), up=False)}
    first, other = {"first": lamp(1.0, 3.0, (0.1, 0.1))}, {"other": lamp(2.5, 4.0)}
    pose = Pose([0.0, 0.0, 0.2], [0.0, 0.0, 0.0, 1.0])  # looks up

    def seen(t_s: float, **chosen: Parts) -> npt.NDArray[np.float32]:
        lights = {"first.emitter": profile} if "first" in chosen else {}
        path = SegmentTrajectory(pose, pose, 1.0)
        scene = make_scene(PATH | {"max_depth": 3}, lights=lights, **parts, **chosen)
        return build(scene).luma(Views.along(path, np.array([t_s])))[0]

    # The other lamp's body stays where it is: only its light is switched off.
    dark = {"other": lamp(2.5, 0.0)}
    both, alone, later = seen(0.0, **first, **other), seen(0.0, **first, **dark), seen(1.0, **first, **other)
    assert later == pytest.approx(both - 0.75 * alone, rel=0.02)
    assert np.abs(both - later).max() > 1.0


@pytest.mark.long
def test_the_same_bits_with_and_without_cache_and_on_any_threads(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = make_scene(PATH | {"max_depth": 3}, **colourful())
    first = luma_of(scene, 0.2, threads=1)
    assert len(list(folder.iterdir())) == 1
    assert "was baked in" in capsys.readouterr().err
    monkeypatch.setattr(baked_scene, "_known", {})
    assert np.array_equal(luma_of(scene, 0.2, threads=2), first)
    assert "baked before" in capsys.readouterr().err
    parts = colourful()
    texels = parts["floor"]["bsdf"]["reflectance"]
    texels["data"] = texels["data"][::-1].copy()
    assert not np.array_equal(luma_of(make_scene(PATH | {"max_depth": 3}, **parts), 0.2), first)
    assert len(list(folder.iterdir())) == 2
    monkeypatch.setattr(baked_scene, "_known", {})
    monkeypatch.setenv(cache.FOLDER_VARIABLE, "")
    assert np.array_equal(luma_of(scene, 0.2), first)
    assert "was baked in" in capsys.readouterr().err


@pytest.mark.few(2)
@pytest.mark.parametrize("damage", ["bit", "cut", "empty", "other"])
def test_a_damaged_cache_is_rebuilt(
    damage: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = make_scene(DIRECT, floor=plate(0, 0, 0, (1, 1)), panel=lamp())
    first = luma_of(scene, 0.2)
    (file,) = folder.iterdir()
    data = bytearray(file.read_bytes())
    maps = cache._unpacked(bytes(data))
    # Light that is well formed, but not what its checksum was made of.
    other = bytes(data[:32]) + cache._packed(replace(maps, texels=[2 * texels for texels in maps.texels]))[32:]
    data[len(data) // 2] ^= 4
    file.write_bytes({"bit": bytes(data), "cut": bytes(data[:-7]), "empty": b"", "other": other}[damage])
    monkeypatch.setattr(baked_scene, "_known", {})
    capsys.readouterr()
    assert np.array_equal(luma_of(scene, 0.2), first)
    assert "damaged" in capsys.readouterr().err
    monkeypatch.setattr(baked_scene, "_known", {})
    assert np.array_equal(luma_of(scene, 0.2), first)
    assert "baked before" in capsys.readouterr().err


def test_a_cache_that_cannot_be_written_costs_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder.write_text("no folder")
    luma = luma_of(make_scene(DIRECT, floor=plate(0, 0, 0, (1, 1)), panel=lamp()), 0.2)
    assert luma.max() > 0
    assert "cannot be kept in its cache" in capsys.readouterr().err


def test_a_full_disk_costs_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(dir: Path, prefix: str) -> tuple[int, str]:
        handle, name = tempfile.mkstemp(dir=dir, prefix=prefix)
        os.close(handle)
        return os.open("/dev/full", os.O_WRONLY), name

    monkeypatch.setattr(cache, "tempfile", SimpleNamespace(mkstemp=full))
    luma = luma_of(make_scene(DIRECT, floor=plate(0, 0, 0, (1, 1)), panel=lamp()), 0.2)
    assert luma.max() > 0
    assert "cannot be kept in its cache ([Errno 28]" in capsys.readouterr().err
    assert list(folder.iterdir()) == []


def test_a_bake_that_is_stopped_goes_on_where_it_was(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C in the middle: the next run computes only the rest, and has the same bits."""
    scene = make_scene(PATH | {"max_depth": 3}, floor=plate(0, 0, 0, (1, 1)), panel=lamp())
    made = Irradiance._computed
    counts = [0]

    def stopped(limit: float) -> Callable[..., FloatArray]:
        def one(self: Irradiance, *arguments: Any) -> FloatArray:
            if counts[0] == limit:
                raise KeyboardInterrupt
            counts[0] += 1
            return made(self, *arguments)

        return one

    monkeypatch.setattr(Irradiance, "_computed", stopped(np.inf))
    first = luma_of(scene, 0.2)
    whole, counts[0] = counts[0], 0
    (file,) = folder.iterdir()
    file.unlink()
    monkeypatch.setattr(baked_scene, "_known", {})
    monkeypatch.setattr(Irradiance, "_computed", stopped(whole - 3))
    with pytest.raises(KeyboardInterrupt):
        luma_of(scene, 0.2)
    assert "what is baked so far is kept" in capsys.readouterr().err
    assert [file.suffix for file in folder.iterdir()] == [".partial"]
    counts[0] = 0
    monkeypatch.setattr(Irradiance, "_computed", stopped(np.inf))
    assert np.array_equal(luma_of(scene, 0.2), first)
    assert counts[0] == 3
    assert "continues from there" in capsys.readouterr().err
    assert [file.suffix for file in folder.iterdir()] == [".light"]


@pytest.mark.long
def test_two_bakes_at_once_leave_one_whole_file(folder: Path, run_python: Callable[..., str]) -> None:
    program = """
import multiprocessing, sys
sys.path.insert(0, sys.argv[1])

def bake(_):
    from lit_scenes import DIRECT, lamp, luma_of, make_scene, plate
    return luma_of(make_scene(DIRECT, floor=plate(0, 0, 0, (1, 1)), panel=lamp()), 0.2).tobytes()

if __name__ == "__main__":
    with multiprocessing.get_context("fork").Pool(2) as pool:
        one, other = pool.map(bake, range(2))
    print(one == other)
"""
    assert run_python(program, str(HELPERS)).split() == ["True"]
    assert [file.suffix for file in folder.iterdir()] == [".light"]


def test_what_looks_before_a_run_bakes_as_the_run_does(folder: Path) -> None:
    """The estimate of noise and the plan of effects take the error that was asked for: one bake for all."""
    scene = replace(
        make_scene(PATH, floor=plate(0, 0, 0, (1, 1)), panel=lamp()),
        camera=CAMERA,
        trajectory=SegmentTrajectory(DOWN, Pose(np.add(DOWN.position, [0.05, 0, 0]), DOWN.quaternion), 0.05),
    )
    assert estimate_noise(scene, bake_error=0.2) is None
    plan_effects(scene, bake_error=0.2)
    Simulator(scene, bake_error=0.2, rays_per_pixel=1)
    assert len(list(folder.iterdir())) == 1


def test_light_of_another_wrap_mode_is_not_taken_from_the_cache(folder: Path) -> None:
    """Mitsuba tells everything of a texture but this."""
    for wrap in ("repeat", "mirror", "mirror", "clamp"):
        stripes = {"type": "bitmap", "raw": True, "data": noise(1, 0.2, 0.8, (4, 4, 1)), "wrap_mode": wrap}
        scene = make_scene(PATH, floor=plate(0, 0, 0, (1, 1), diffuse(stripes)), panel=lamp())
        make_renderer(scene, CAMERA, kind="baked", rays_per_pixel=1, bake_error=0.3)
    assert len(list(folder.iterdir())) == 3


def test_a_full_cache_loses_what_was_not_used_for_longest(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for radiance in (1.0, 2.0):
        luma_of(make_scene(DIRECT, floor=plate(0, 0, 0, (1, 1)), panel=lamp(2.0, radiance)), 0.2)
    assert len(list(folder.iterdir())) == 2
    monkeypatch.setattr(cache, "MOST_BYTES", 10)
    luma_of(make_scene(DIRECT, floor=plate(0, 0, 0, (1, 1)), panel=lamp(2.0, 3.0)), 0.2)
    assert len(list(folder.iterdir())) == 1


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"panel": lamp(2.0, [1.0, -1.0, 1.0])}, r"'panel\.emitter', a AreaLight, has radiance\.value -1; light is"),
        ({"panel": lamp(2.0, 1.0, (0.4, 0.0))}, "an area light needs a shape with an area"),
        (
            {"bulb": {"type": "point", "intensity": {"type": "rgb", "value": [1.0, -2.0, 0.0]}}},
            r"'bulb', a PointLight, has intensity\.value -2",
        ),
        ({"panel": lamp(2.0, [1.0, np.inf, 1.0])}, r"'panel\.emitter', a AreaLight, has radiance\.value inf"),
        ({"panel": lamp(2.0, [1.0, 1.0, np.nan])}, r"'panel\.emitter', a AreaLight, has radiance\.value nan"),
        ({"sky": environment(np.full((4, 8, 3), np.nan))}, r"'sky', a EnvironmentMapEmitter, has data nan; light is"),
        ({"sky": environment(np.full((4, 8, 3), -2.0))}, r"'sky', a EnvironmentMapEmitter, has data -2; light is"),
        (
            {"panel": plate(0, 0, 2, (1, 1)) | {"emitter": {"type": "directionalarea"}}},
            "'panel.emitter', a DirectionalArea, .*is not baked: projectors, point,",
        ),
        (
            {
                "panel": plate(0, 0, 2, (1, 1))
                | {
                    "emitter": {
                        "type": "area",
                        "radiance": {"type": "bitmap", "raw": True, "data": np.ones((2, 2, 3), np.float32)},
                    }
                }
            },
            "radiance that differs from place to place",
        ),
        (
            {"field": {"type": "sdfgrid", "grid": np.mgrid[:2, :2, :2][0, ..., None] - 0.5, "bsdf": diffuse()}},
            "'field' is a sdfgrid",
        ),
        (
            {"mirror": plate(0, 0, 2, (1, 1), {"type": "principled", "flatness": {"type": "checkerboard"}})},
            "not a diffuse one",
        ),
    ],
)
def test_what_cannot_be_baked_is_refused(parts: Parts, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build(make_scene(floor=plate(0, 0, 0, (1, 1)), **parts))


@pytest.mark.usefixtures("llvm")
def test_what_is_not_baked_is_left_to_mitsuba() -> None:
    """Integrators that do other things, and small lamps that move: refused, and under auto rendered as ever."""
    far = SegmentTrajectory(DOWN, Pose([0.5, 0.0, 1.4], DOWN.quaternion), 1.0)
    floor = plate(0, 0, 0, (1, 1))
    small = replace(make_scene(floor=floor, bulb=lamp(1.2, 9.0, (0.002, 0.002))), objects={"bulb": far})
    for scene, message in (
        (small, "the small lamp 'bulb' moves"),
        (make_scene({"type": "depth"}, floor=floor, panel=lamp()), "DepthIntegrator"),
    ):
        with pytest.raises(ValueError, match=message):
            build(scene)
        assert isinstance(build(scene, kind="auto", rays_per_pixel=1), IntegratorRenderer)


def test_auto_bakes_where_the_light_asks_for_it() -> None:
    scene = make_scene(floor=plate(0, 0, 0, (1, 1)), panel=lamp())
    renderer = build(scene, kind="auto")
    assert renderer.name == "native renderer"
    assert "baked light" in renderer.reason
    assert np.array_equal(renderer.luma(Views.at_rest([DOWN])), build(scene).luma(Views.at_rest([DOWN])))


def test_places_go_where_light_errs_on_large_areas() -> None:
    """A large triangle has a spot of light, next to a carpet of small ones that differ from each other."""
    side = np.linspace(0, 1, 21)
    squares = np.array([[[x, y, 0], [x + 0.05, y, 0], [x, y + 0.05, 0]] for x in side for y in side])
    corners = np.concatenate([squares, np.array([[[2, 0, 0], [6, 0, 0], [2, 4, 0]]], float)])
    count = len(corners)
    lattice = SurfaceLattice(corners, np.tile([0, 0, 1.0], (count, 3, 1)), np.zeros(count, bool), np.zeros(count, int))

    def light(places: FloatArray, *_: Any) -> tuple[FloatArray, FloatArray]:
        spot = np.exp(-((places[:, 0] - 3) ** 2 + (places[:, 1] - 1) ** 2) / 0.1)
        carpet = np.where(places[:, 0] < 1.5, 9 * np.sin(60 * places[:, 0]) ** 2, 0)
        return np.repeat((1 + spot + carpet)[:, None], 3, 1), np.zeros(len(places))

    sampled = refine(lattice, light, RefinementRule(2.0, 0.01, 0.02, 200))
    known, new = len(lattice.positions), len(sampled.values) - len(lattice.positions)
    assert known > 200
    assert not sampled.complete
    assert 100 < new <= 200
    assert (sampled.positions[known:, 0] > 1.5).mean() > 0.9
    assert sampled.divisions()[-1] >= 3


@pytest.mark.parametrize("half", [0.0, 0.05], ids=["its ends", "its ends and its middle"])
def test_a_beam_is_lit_between_the_posts_that_hold(half: float) -> None:
    corners = np.array([[[-0.5, 0, 0], [0.5, 0, 0], [-0.5, 0.05, 0]], [[0.5, 0, 0], [0.5, 0.05, 0], [-0.5, 0.05, 0]]])
    lattice = SurfaceLattice(corners, np.tile([0, 0, 1.0], (2, 3, 1)), np.zeros(2, bool), np.zeros(2, int))

    def light(places: FloatArray, *_: Any) -> tuple[FloatArray, FloatArray]:
        within_a_post = (np.abs(places[:, :1]) > 0.45) | (np.abs(places[:, :1]) < half)
        return np.where(within_a_post, np.nan, np.ones((1, 3))), np.zeros(len(places))

    sampled = refine(lattice, light, RefinementRule(0.4, 0.02, 0.02, 1_000))
    assert (sampled.values == 1.0).all()


def test_points_within_a_solid_do_not_darken_what_is_next_to_it() -> None:
    """A block stands on the floor: the floor is as bright at its foot as a little way off."""
    corners = np.array([[[-1, -1, 0], [1, -1, 0], [-1, 1, 0]], [[1, -1, 0], [1, 1, 0], [-1, 1, 0]]], float)
    lattice = SurfaceLattice(corners, np.tile([0, 0, 1.0], (2, 3, 1)), np.zeros(2, bool), np.zeros(2, int))

    def light(places: FloatArray, *_: Any) -> tuple[FloatArray, FloatArray]:
        within = np.asarray((np.abs(places[:, :2]) < 0.31).all(1))
        return np.where(within[:, None], np.nan, np.ones((1, 3))), np.zeros(len(places))

    sampled = refine(lattice, light, RefinementRule(0.2, 0.02, 0.02, 100_000))
    for faces, grids in sampled.grids(sampled.divisions()):
        for face, grid in zip(faces, grids, strict=True):
            n = len(grid) - 1
            i, j = np.indices((n + 1, n + 1)) / n
            start, right, far = corners[face]
            places = start + i[..., None] * (right - start) + j[..., None] * (far - start)
            outside = np.asarray((np.abs(places[..., :2]) >= 0.31).any(-1))
            inside = np.asarray(i + j <= 1 + 1e-9)
            # Whatever a place outside is interpolated from: its neighbours too.
            near = outside.copy()
            for _ in range(2):
                near[1:] |= outside[:-1]
                near[:-1] |= outside[1:]
                near, outside, inside, grid = near.T, outside.T, inside.T, grid.swapaxes(0, 1)
            assert (~outside).any()
            assert (grid[near & inside] == 1.0).all()


def test_meshes_of_many_corners_are_baked_quickly_unless_a_bake_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Light is baked at every corner at least: that takes hours for millions, which nobody is put through unasked."""
    monkeypatch.setattr(baked_scene, "MOST_CORNERS", 3)
    scene = make_scene(PATH, lamp=lamp(), floor=plate(0, 0, 0, (3, 3)))
    unasked, asked = (make_renderer(scene, CAMERA, kind=kind, rays_per_pixel=4) for kind in ("auto", "baked"))
    assert unasked.name == asked.name == "native renderer"
    assert "it is a quick bake (--renderer baked obeys --bake-error)" in unasked.reason
    assert "quick bake" not in asked.reason
    monkeypatch.undo()
    assert "quick bake" not in make_renderer(scene, CAMERA, kind="auto", rays_per_pixel=4).reason


def test_meshes_of_very_many_triangles_are_baked_on_request_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their tables, which are large, are not made before that is known."""
    scene = make_scene(PATH, lamp=lamp(), floor=plate(0, 0, 0, (3, 3)))
    monkeypatch.setattr(baked_scene, "MOST_CORNERS", 3)
    monkeypatch.setattr(baked_scene, "MOST_QUICK_SIDES", 3)
    monkeypatch.setattr(scene_table, "MeshTriangles", None)
    (obstacle,) = why_not_noise_free(scene)
    assert re.match(r"it has \d+ sides of triangles, and the limit of a quick bake is 3$", obstacle.rule)
    assert "--renderer baked" in obstacle.remedy


def test_large_meshes_are_not_baked_unasked_where_objects_move(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = moving_camera()
    moving = replace(scene, objects={"floor": scene.path})
    monkeypatch.setattr(baked_scene, "MOST_CORNERS", 3)
    assert not why_not_noise_free(moving)
    monkeypatch.setattr(baked_scene, "MOST_CORNERS_WITH_MOTION", 3)
    (obstacle,) = why_not_noise_free(moving)
    assert obstacle.rule.endswith("in meshes of more than 3 corners, is baked on request alone")


def test_what_writes_more_next_to_light_shows_the_light_of_what_is_inside() -> None:
    """``moment`` and ``aov`` are as their first integrator, to any depth: its bounces and obstacles are theirs."""
    parts = {"floor": plate(0, 0, 0, (1, 1)), "panel": lamp(), "side": plate(1, 0, 0.5, (0.5, 1))}
    inside = PATH | {"max_depth": 2}
    depths = {"type": "aov", "aovs": "depth:depth", "first": inside, "second": PATH}
    own = luma_of(make_scene(inside, **parts), 0.5)
    for wrapped in ({"type": "moment", "first": inside}, {"type": "moment", "first": depths}):
        assert not why_not_noise_free(make_scene(wrapped, **parts))
        np.testing.assert_array_equal(luma_of(make_scene(wrapped, **parts), 0.5), own)
    obstacles = why_not_noise_free(make_scene({"type": "moment", "first": {"type": "depth"}}, **parts))
    assert any("DepthIntegrator" in obstacle.rule for obstacle in obstacles)


def test_volumetric_paths_without_media_are_paths() -> None:
    """A light's or a camera's fog, or a solid's inside, is what they are for; without any there is none."""
    parts = {"floor": plate(0, 0, 0, (1, 1)), "panel": lamp(), "side": plate(1, 0, 0.5, (0.5, 1))}
    fog = {"type": "homogeneous"}
    own = luma_of(make_scene(PATH | {"max_depth": 2}, **parts), 0.5)
    for kind in ("volpath", "volpathmis"):
        volumetric = {"type": kind, "max_depth": 2}
        assert not why_not_noise_free(make_scene(volumetric, **parts))
        np.testing.assert_array_equal(luma_of(make_scene(volumetric, **parts), 0.5), own)
        for more in (
            {"milk": plate(0, 1, 0, (1, 1)) | {"interior": fog}},
            {"eye": {"type": "perspective", "fog": fog}},
        ):
            (obstacle,) = why_not_noise_free(make_scene(volumetric, **parts, **more))
            assert "it has a medium (fog, milk)" in obstacle.rule, (kind, more)


@pytest.mark.parametrize("integrator", [PATH, DIRECT], ids=["path", "direct"])
def test_media_that_the_integrator_passes_by_are_told(integrator: dict[str, Any]) -> None:
    """Mitsuba's surface integrators do not render them, and no more do its replacements. The message says so."""
    milk = plate(0, 1, 0, (1, 1)) | {"interior": {"type": "homogeneous"}}
    sun = {"type": "directional", "direction": [0.2, 0.1, -1.0]}
    clear, milky = (
        make_renderer(make_scene(integrator, floor=plate(0, 0, 0, (1, 1)), sun=sun, **more), CAMERA).reason
        for more in ({}, {"milk": milk})
    )
    assert "media (fog, milk) are not rendered" in milky
    assert "media" not in clear
