"""Materials of glTF files that are not double-sided: from behind, one sees through them."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Scene, Simulator, load_scene
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.truth import SceneSurfaces
from davis_rs.scene.lost_looks import BACKS, LostLookWarning
from gltf_files import CORNERS, FACES, UV, Gltf, quad

CAMERA = Camera(width=32, height=24, fx=160.0, fy=160.0, cx=15.5, cy=11.5)
SHEET, FAR, NEAR = 0.25, 1.0, 0.5
"""Luma of a sheet between two walls, and of these: one lies beyond its front, the other beyond its back."""
FRONT = np.diag([1.0, -1.0, -1.0])
"""A camera's axes in the file's, where it looks along -z, at the fronts of squares."""
BACK = np.diag([-1.0, -1.0, 1.0])


def unlit(gltf: Gltf, name: str, luma: float, *, double_sided: bool = True) -> int:
    more: dict[str, Any] = {"extensions": {"KHR_materials_unlit": {}}}
    return gltf.material(name, double_sided=double_sided, more=more, baseColorFactor=[luma, luma, luma, 1])


def walls(gltf: Gltf) -> None:
    for name, luma, z in (("far", FAR, -4.0), ("near", NEAR, 6.0)):
        square = gltf.mesh(CORNERS * [9, 9, 1], FACES, material=unlit(gltf, name, luma))
        gltf.node(mesh=square, translation=[0, 0, z])
    gltf.light({"type": "point", "intensity": 1e-12})


def world(folder: Path, gltf: Gltf | None = None, *, material: int | None = None, **node: Any) -> Scene:
    """A sheet, one-sided and of its own luma unless it has another material, between the walls."""
    gltf = Gltf() if gltf is None else gltf
    material = unlit(gltf, "sheet", SHEET, double_sided=False) if material is None else material
    number = gltf.node(mesh=quad(gltf, uv=UV, material=material), **node)
    gltf.document["nodes"][number]["name"] = "sheet"
    walls(gltf)
    return load_scene(gltf.save(folder / "scene.glb"))


def views(axes: npt.NDArray[np.float64], z: float) -> Views:
    """A camera at a height z of the file, whose z is the world's -y."""
    matrix, turn = np.eye(4), np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    matrix[:3, :3], matrix[:3, 3] = turn @ axes, turn @ [0.0, 0.0, z]
    return Views.at_rest([matrix])


def luma(scene: Scene, seen: Views, pixel: str = "rays", kind: str = "native") -> float:
    renderer = make_renderer(scene, CAMERA, lattice_rays_per_pixel=8, kind=kind, blur=False, pixel=pixel)
    frame = renderer.luma(seen)
    single = renderer.samples(seen, np.zeros(1, np.int64), np.array([12 * 32 + 16]))
    assert single[0] == frame[0, 12, 16]
    return float(single[0])


@pytest.mark.without_llvm
@pytest.mark.parametrize("pixel", ["rays", "lines"])
@pytest.mark.parametrize(("scale", "turned"), [([1, 1, 1], False), ([-1, 1, 1], False), ([-1, 1, -1], True)])
def test_what_is_seen_from_each_side(scale: list[int], turned: bool, pixel: str, tmp_path: Path) -> None:
    """A mirror image has its front on the same side."""
    scene = world(tmp_path, scale=scale)
    assert scene.one_sided == ("mesh_sheet",)
    front, back = views(FRONT, 3.0), views(BACK, -3.0)
    if turned:
        assert (luma(scene, back, pixel), luma(scene, front, pixel)) == pytest.approx((SHEET, FAR))
    else:
        assert (luma(scene, front, pixel), luma(scene, back, pixel)) == pytest.approx((SHEET, NEAR))


@pytest.mark.without_llvm
def test_all_that_is_told_of_a_pixel_is_of_what_it_shows(tmp_path: Path) -> None:
    """Depth, the shape's number and derivatives are those of the wall behind."""
    scene = world(tmp_path)
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=1, kind="native", blur=False)
    for seen, name, depth in ((views(FRONT, 3.0), "mesh_sheet", 3.0), (views(BACK, -3.0), "mesh_near", 9.0)):
        surfaces = SceneSurfaces(scene, CAMERA)
        truth = surfaces.frame(seen)
        assert surfaces.names[truth.shape[400] - 1] == name
        assert (truth.depth[400], renderer.depth(seen)[0].flat[400]) == pytest.approx((depth, depth))
        assert isinstance(renderer, NativeRenderer)
        shape, back = renderer.shapes_seen(seen, np.zeros(1, np.int64), np.array([400]))
        assert (renderer.table.names[shape[0]], back[0]) == (name, name == "mesh_near")
        triangle = renderer.ray_hits(seen, np.zeros(1, np.uint32), np.array([400], np.uint32))[0]
        assert np.repeat(renderer.table.names, renderer.table.counts)[triangle[0, 0]] == name
    shown = SceneSurfaces(scene, CAMERA, culled=False)
    assert shown.frame(views(BACK, -3.0)).depth[400] == pytest.approx(3.0)


@pytest.mark.without_llvm
def test_a_mirror_sees_no_backs_either(tmp_path: Path) -> None:
    """A mirror on the far wall's side shows the sheet's back: what lies beyond it, the near wall."""
    gltf = Gltf()
    chrome: dict[str, Any] = {"metallicFactor": 1.0, "roughnessFactor": 0.0}
    mirror = gltf.material("mirror", baseColorFactor=[1, 1, 1, 1], **chrome)
    gltf.node(mesh=quad(gltf, uv=UV, material=mirror), translation=[0, 0, -2])
    # The camera stands between mirror and sheet.
    seen = views(FRONT, -1.0)
    assert luma(world(tmp_path, gltf), seen) == pytest.approx(NEAR, rel=1e-3)
    gltf.document["materials"][1]["doubleSided"] = True
    assert luma(load_scene(gltf.save(tmp_path / "both.glb")), seen) == pytest.approx(SHEET, rel=1e-3)


@pytest.mark.without_llvm
def test_what_moves_is_culled_by_where_it_is(tmp_path: Path) -> None:
    """A sheet that turns round: its front, then what lies behind its back; its light and its edges go with it."""
    gltf = Gltf()
    scene = world(tmp_path, gltf)
    gltf.animate(0, "rotation", [0.0, 1.0], np.array([[0, 0, 0, 1], [0, 1, 0, 0]]), "STEP")
    scene = load_scene(gltf.save(tmp_path / "turning.glb"))
    assert "mesh_sheet" not in scene.objects
    assert len(scene.objects) == 1
    seen = views(FRONT, 3.0)
    assert [luma(scene, seen.moved([t_s])) for t_s in (0.0, 1.5)] == pytest.approx([SHEET, FAR])


@pytest.mark.without_llvm
def test_a_culled_back_throws_its_shadow(tmp_path: Path) -> None:
    """A lamp behind the sheet lights the wall before its front, but for its shadow."""
    gltf = Gltf()
    paint = gltf.material("paint", double_sided=False)
    ground = gltf.material("ground")
    gltf.node(mesh=gltf.mesh(CORNERS * [9, 9, 1], FACES, material=ground), translation=[0, 0, -3])
    gltf.node(mesh=gltf.mesh(CORNERS * [0.2, 0.2, 1], FACES, material=paint), rotation=[0, 1, 0, 0])
    gltf.light({"type": "point", "intensity": 1e4}, translation=[0, 0, 4])
    scene = load_scene(gltf.save(tmp_path / "scene.glb"))
    seen = views(FRONT, 3.0)
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=1, kind="native", blur=False)
    frame = renderer.luma(seen)[0]
    assert frame[12, 16] == 0
    assert frame[0, 0] > 0


def test_renderers_that_show_backs_say_so(tmp_path: Path) -> None:
    """The native renderer loses nothing; Mitsuba's show the sheet from both sides, and the run tells it."""
    gltf = Gltf()
    camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.15, "aspectRatio": 4 / 3}})
    gltf.node(camera=camera, translation=[0, 0, -3], rotation=[0, 1, 0, 0], name="eye")
    gltf.animate(0, "translation", [0.0, 0.01], np.array([[0, 0, -3], [0, 0.01, -3]]))
    scene = world(tmp_path, gltf)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        native = Simulator(scene, rays_per_pixel=1, renderer="native", flow_rate_hz=100.0)
    with pytest.warns(LostLookWarning, match=BACKS.split()[0]):
        other = Simulator(scene, rays_per_pixel=1, renderer="integrator", flow_rate_hz=100.0)
    seen = views(BACK, -3.0)
    for simulator, depth in ((native, 9.0), (other, 3.0)):
        assert simulator.surfaces is not None
        middle = simulator.surfaces.frame(seen).depth[90 * 240 + 120]
        assert middle == pytest.approx(depth)
