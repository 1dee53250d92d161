"""Mitsuba's opacity masks, along whose outlines meshes are cut for the renderers without noise."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from davis_rs import Camera, Pose, Scene, VertexKeyframes
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.srgb import from_srgb
from davis_rs.geometry.trajectory.trajectory import SegmentTrajectory
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.primitives import triangulated
from davis_rs.render.truth.scene_surfaces import SceneSurfaces
from davis_rs.scene.files import alpha_mask
from davis_rs.scene.files.alpha_mask import AlphaMask, Pieces
from davis_rs.scene.meshes import Mesh, mitsuba_mesh

CAMERA = Camera(48, 36, 40.0, 40.0, 23.5, 17.5)
DOWN = Pose([0.0, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0])
"""A camera three metres above the origin, looking down."""

WHITE = {"type": "diffuse", "reflectance": 0.9}


def blobs(texels: int = 96, softness: float = 0.0) -> npt.NDArray[np.float32]:
    """Return opacity (H, W, 1) with holes and islands, the same at no two places; soft edges some texels wide."""
    v, u = (np.mgrid[:texels, :texels] + 0.5) / texels
    height = np.sin(7 * u + 1) * np.cos(5 * v) + 0.4 * np.sin(17 * u * v)
    edges = np.clip(height / softness + 0.5, 0, 1) if softness else (height > 0).astype(float)
    return edges[..., None].astype(np.float32)


def masked(data: npt.NDArray[Any], nested: dict[str, Any] | None = None, **changes: Any) -> dict[str, Any]:
    opacity = {"type": "bitmap", "raw": True, "data": data, **changes}
    return {"type": "mask", "opacity": opacity, "nested": {"type": "twosided", "nested": nested or WHITE}}


def placed(x: float, z: float, scale: float = 1.0) -> npt.NDArray[np.float64]:
    """Return a transform (4, 4) to (x, 0, z)."""
    made = np.diag([scale, scale, scale, 1.0])
    made[:3, 3] = x, 0, z
    return made


def scene_of(bsdf: dict[str, Any], *, lift: float = 0.8, **changes: Any) -> Scene:
    """Return a white card with this material above a dark floor, in the light of the sun.

    Of Mitsuba's integrators only the volumetric ones let light through masks; others have shadows of whole cards.
    """
    card = {"type": "rectangle", "bsdf": bsdf, "to_world": placed(0.1, lift)}
    content = {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 2},
        "sun": {"type": "directional", "direction": [0.5, 0.2, -1.0], "irradiance": 2.0},
        "floor": {
            "type": "rectangle",
            "bsdf": {"type": "diffuse", "reflectance": 0.2},
            "to_world": placed(0, 0, 3.0),
        },
        "card": card,
        **changes,
    }
    path = SegmentTrajectory(DOWN, Pose([0.3, 0.0, 3.0], DOWN.quaternion), 1.0)
    return Scene("made", lambda: content, camera=CAMERA, trajectory=path)


def rms(scene: Scene) -> float:
    """Return how far luma of the native renderer lies from that of Mitsuba's integrator, rms over the pixels."""
    views = Views.at_rest([DOWN])
    ours = make_renderer(scene, CAMERA, rays_per_pixel=64, kind="native").luma(views)[0]
    theirs = make_renderer(scene, CAMERA, rays_per_pixel=512, kind="integrator").luma(views)[0]
    assert np.ptp(theirs) > 0.3, "the test wants cards and holes"
    return float(np.sqrt(np.mean((ours - theirs) ** 2)))


def with_cloth(
    corners: npt.NDArray[np.float64], normals: npt.NDArray[np.float64] | None = None, *, coloured: bool = False
) -> Scene:
    """Return a scene whose card is a mesh of two triangles, with a mask."""
    plain = scene_of(WHITE, lift=-1.0)
    without_cloth = plain.source()
    assert isinstance(without_cloth, dict)

    def source() -> dict[str, Any]:
        import mitsuba as mi

        properties = mi.Properties()
        opacity = {"type": "bitmap", "raw": True, "data": mi.TensorXf(blobs())}
        nested = {"type": "twosided", "nested": WHITE}
        properties["bsdf"] = mi.load_dict({"type": "mask", "opacity": opacity, "nested": nested})
        mesh = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), corners[:, :2] / 2 + 0.5)
        cloth = mitsuba_mesh(mesh, properties, normals)
        if coloured:
            cloth.add_attribute("vertex_color", 3, np.full(12, 0.5, np.float32))
        return {**without_cloth, "cloth": cloth}

    return replace(plain, source=source)


SQUARE = np.array([[-1.0, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
TURNED = np.array([[1.3, 0.4, 0.2], [-0.3, 1.7, -0.4], [0, 0, 1.0]])

MASKS = {
    "bilinear": masked(blobs()),
    "hard texels": masked(blobs(9), filter_type="nearest"),
    "turned, repeat": masked(blobs(), to_uv=TURNED),
    "turned, clamp": masked(blobs(), to_uv=TURNED, wrap_mode="clamp"),
    "turned, mirror": masked(blobs(), to_uv=TURNED, wrap_mode="mirror"),
    "checkerboard within": masked(
        blobs(), {"type": "diffuse", "reflectance": {"type": "checkerboard", "color0": 0.05, "color1": 0.9}}
    ),
}


@pytest.mark.usefixtures("llvm")
@pytest.mark.few(3)
@pytest.mark.parametrize("kind", MASKS)
def test_what_is_left_looks_as_mitsubas(kind: str) -> None:
    """The card, and its shadow on the floor; soft edges of a texel, and random rays, are the difference."""
    assert rms(scene_of(MASKS[kind])) < 0.006


@pytest.mark.parametrize("raw", [True, False])
def test_image_files_are_linearised_unless_raw(tmp_path: Path, raw: bool) -> None:
    """The outline is where the opacity is a half, which is 188 of 255 in sRGB."""
    values = np.round(255 * blobs(48, softness=0.06)[..., 0]).astype(np.uint8)
    Image.fromarray(np.stack([values] * 3, -1)).save(tmp_path / "mask.png")
    opacity = {"type": "bitmap", "raw": raw, "filename": str(tmp_path / "mask.png")}
    nested = {"type": "twosided", "nested": WHITE}
    linear = (values / 255 if raw else from_srgb(values / 255))[..., None]
    views = Views.at_rest([DOWN])
    ours, same, other = (
        make_renderer(scene_of(bsdf), CAMERA, rays_per_pixel=64, kind="native").luma(views)[0]
        for bsdf in (
            {"type": "mask", "opacity": opacity, "nested": nested},
            masked(linear.astype(np.float32)),
            masked((linear**1.5).astype(np.float32)),
        )
    )
    assert np.abs(ours - same).mean() < 1e-4
    assert np.abs(ours - other).mean() > 1e-3


def test_the_test_sees_a_mask_that_is_shifted() -> None:
    """By two texels of 96, a pixel or so."""
    views = Views.at_rest([DOWN])
    shift = np.array([[1, 0, 2 / 96], [0, 1, 0], [0, 0, 1.0]])
    ours, shifted = (
        make_renderer(scene, CAMERA, rays_per_pixel=64, kind="native").luma(views)[0]
        for scene in (scene_of(MASKS["bilinear"]), scene_of(masked(blobs(), to_uv=shift)))
    )
    assert float(np.sqrt(np.mean((ours - shifted) ** 2))) > 0.05


@pytest.mark.usefixtures("llvm")
def test_instances_are_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each copy of a masked card in a group; the card itself is cut once."""
    cuts: list[AlphaMask] = []
    cut = AlphaMask.cut

    def counted(mask: AlphaMask, uv: npt.NDArray[np.float64]) -> Pieces | None:
        cuts.append(mask)
        return cut(mask, uv)

    monkeypatch.setattr(AlphaMask, "cut", counted)
    group = {"type": "shapegroup", "card": {"type": "rectangle", "bsdf": MASKS["bilinear"]}}
    copies = {
        f"copy_{k}": {
            "type": "instance",
            "group": {"type": "ref", "id": "group"},
            "to_world": placed(k - 0.5, 0.4 + 0.5 * k, 0.7),
        }
        for k in range(2)
    }
    scene = scene_of(WHITE, lift=-1.0, group=group, **copies)
    assert rms(scene) < 0.006
    assert len(cuts) == 1


def test_it_is_told_and_truth_knows_the_holes() -> None:
    scene = scene_of(MASKS["bilinear"])
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=1, kind="native")
    assert "1 mesh cut along the outlines of opacity masks" in renderer.reason
    assert "texels" not in renderer.reason
    surfaces = SceneSurfaces(scene, CAMERA)
    depth = renderer.depth(Views.at_rest([DOWN]))[0]
    shown = surfaces.frame(Views.at_rest([DOWN])).shape == surfaces.names.index("card") + 1
    assert 500 < shown.sum() < 900, "about half of the card"
    assert np.array_equal(shown, depth.ravel() < 2.5)


def test_outlines_that_had_to_be_coarse_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alpha_mask, "_MOST_PIECES", 100)
    renderer = make_renderer(scene_of(MASKS["bilinear"]), CAMERA, rays_per_pixel=1, kind="native")
    assert re.search(r"1 mesh cut along the outlines of opacity masks, to less than [\d.]+ texels", renderer.reason)


def test_a_mask_that_is_opaque_everywhere_changes_nothing() -> None:
    views = Views.at_rest([DOWN])
    plain, whole = (
        make_renderer(scene_of(bsdf), CAMERA, rays_per_pixel=4, kind="native")
        for bsdf in ({"type": "twosided", "nested": WHITE}, masked(np.linspace(0.9, 1, 64).reshape(8, 8, 1)))
    )
    assert np.array_equal(plain.luma(views), whole.luma(views))
    assert "cut" not in whole.reason


LEFT = {
    "soft": masked(blobs(96, softness=1.5)),
    "half clear": {"type": "mask", "opacity": 0.5, "nested": WHITE},
    "hidden": masked(np.zeros((8, 8, 1), np.float32)),
    "checkerboard": {"type": "mask", "opacity": {"type": "checkerboard"}, "nested": WHITE},
}


@pytest.mark.parametrize("kind", LEFT)
def test_what_cannot_be_cut_is_left_to_mitsuba(kind: str) -> None:
    with pytest.raises(ValueError, match=r"mask\((twosided\()?diffuse"):
        make_renderer(scene_of(LEFT[kind]), CAMERA, rays_per_pixel=1, kind="native")


def test_what_shines_deforms_or_has_attributes_is_not_cut() -> None:
    """A lamp's mask does not hide its light in Mitsuba; what moves vertices, or has a value for each, knows those of
    the file."""
    lamp = {"type": "rectangle", "bsdf": MASKS["bilinear"], "light": {"type": "area", "radiance": 1.0}}
    with pytest.raises(ValueError, match=r"mask\("):
        make_renderer(scene_of(WHITE, lamp=lamp), CAMERA, rays_per_pixel=1, kind="baked")
    scene = with_cloth(SQUARE)
    waving = VertexKeyframes([0.0, 1.0], np.stack([SQUARE, SQUARE + 0.1]))
    for left in (replace(scene, deformations={"cloth": waving}), with_cloth(SQUARE, coloured=True)):
        with pytest.raises(ValueError, match=r"mask\("):
            make_renderer(left, CAMERA, rays_per_pixel=1, kind="native")
    assert make_renderer(scene, CAMERA, rays_per_pixel=1, kind="native")


@pytest.mark.usefixtures("llvm")
def test_what_is_left_of_a_smooth_mesh_is_smooth() -> None:
    normals = np.array([[-0.6, -0.3, 0.8], [0.6, -0.3, 0.8], [0.6, 0.3, 0.8], [-0.6, 0.3, 0.8]])
    assert rms(with_cloth(SQUARE, normals / np.linalg.norm(normals[0]))) < 0.006


@pytest.mark.parametrize(("softness", "is_kept"), [(1.5, True), (0.0, False)])
def test_a_scene_of_which_nothing_is_cut_is_not_loaded_again(softness: float, is_kept: bool) -> None:
    """Large worlds have many materials that blend, and are large."""
    given = scene_of(masked(blobs(96, softness=softness)))
    with variant(SCALAR) as (mi, _):
        loaded = load_scene_source(given.source(), mi)
        made = triangulated(given, CAMERA, loaded, mi)[0]
        assert (made is loaded) == is_kept
