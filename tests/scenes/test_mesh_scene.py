"""Meshes from OBJ and PLY files as scenes: what is shown, and what is said of files that break the rules."""

from __future__ import annotations

import contextlib
import hashlib
import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from command_line import davis_rs
from davis_rs import Scene, SceneFileWarning, load_scene
from davis_rs._util.budget import Budget
from davis_rs._util.srgb import from_srgb
from davis_rs.events.luma import LUMA_WEIGHTS
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene.files.mesh_scene import colours_as_texture
from davis_rs.scene.files.obj_file import read_obj
from davis_rs.scene.files.ply_file import read_ply
from davis_rs.scene.lost_looks import MIRRORS, MISSING, TRANSPARENCY, UNKNOWN, UNPLACED, LostLook
from davis_rs.scene.mesh_part import MeshPart
from davis_rs.scene.texel_lookup import bilinear
from davis_rs.scene.texture_file import EncodedTexture

SKY = 0.3
QUADS = (
    "f 5/1 6/2 7/3 8/4\nf 2/1 1/2 4/3 3/4\nf 6/1 2/2 3/3 7/4\nf 1/1 5/2 8/3 4/4\nf 8/1 7/2 3/3 4/4\nf 1/1 2/2 6/3 5/4\n"
)
CORNERS = [(x, y, z) for z, y, x in [(-1, -1, -1), (-1, -1, 1), (-1, 1, 1), (-1, 1, -1)]]
CORNERS += [(x, y, 1) for x, y, _ in CORNERS]


def cube(faces: str = QUADS, before: str = "", vertices: list[tuple[int, int, int]] = CORNERS) -> str:
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    return before + "\n".join([*lines, "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", faces])


def painted(
    folder: Path, image: npt.NDArray[np.uint8], mtl: str = "newmtl paint\nKd 0.8 0.8 0.8\nmap_Kd paint.png\n"
) -> Path:
    """A cube with an image on every side."""
    Image.fromarray(image).save(folder / "paint.png")
    (folder / "cube.mtl").write_text(mtl)
    path = folder / "cube.obj"
    path.write_text(cube(before="mtllib cube.mtl\nusemtl paint\n"))
    return path


def first_frame(scene: Scene) -> npt.NDArray[np.float32]:
    renderer = make_renderer(scene, scene.own_camera, kind="native", rays_per_pixel=1)
    assert renderer.name == "native renderer"
    return renderer.luma(Views.at_rest([scene.path.pose(0.0)]))[0].astype(np.float32)


def ply(kind: str, *, faces: list[list[int]], colours: bool = False, element: str = "face") -> bytes:
    """The cube's vertices with these faces, in ASCII or binary; strips have lists of more than 255 numbers."""
    length, code = ("uchar", "B") if element == "face" else ("int", "i")
    paint = "property uchar red\nproperty uchar green\nproperty uchar blue\n" if colours else ""
    header = (
        f"ply\nformat {kind} 1.0\ncomment made for a test\nelement vertex 8\nproperty float x\nproperty float y\n"
        f"property float z\n{paint}element {element} {len(faces)}\n"
        f"property list {length} int vertex_indices\nend_header\n"
    ).encode()
    order = ">" if kind == "binary_big_endian" else "<"
    body = b""
    for corner in CORNERS:
        red = [255, 0, 0] if colours else []
        if kind == "ascii":
            body += " ".join(map(str, [*corner, *red])).encode() + b"\n"
        else:
            body += struct.pack(f"{order}3f{len(red)}B", *corner, *red)
    for face in faces:
        if kind == "ascii":
            body += " ".join(map(str, [len(face), *face])).encode() + b"\n"
        else:
            body += struct.pack(f"{order}{code}{len(face)}i", len(face), *face)
    return header + body


MIXED = [[0, 1, 2], [0, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]


@pytest.mark.usefixtures("llvm")
def test_a_texture_shows_its_reflectance(tmp_path: Path) -> None:
    """Red below, green above: the front shows both, the right way up, at the luma of lit paint; before the sky."""
    image = np.zeros((32, 32, 3), np.uint8)
    image[:16], image[16:] = (0, 255, 0), (255, 0, 0)
    frame = first_frame(load_scene(painted(tmp_path, image)))
    assert frame[5, 5] == pytest.approx(SKY, rel=1e-5)
    ratio = frame[90 + 4, 120] / frame[90 + 34, 120]
    assert ratio == pytest.approx(LUMA_WEIGHTS[1] / LUMA_WEIGHTS[0], rel=1e-3)
    # Paint that is lit by the sky alone, and by the sun straight on: between SKY and SKY + 2 / pi of its reflectance.
    assert SKY * LUMA_WEIGHTS[0] < frame[90 + 34, 120] < (SKY + 2 / np.pi) * LUMA_WEIGHTS[0]


@pytest.mark.usefixtures("llvm")
def test_srgb_is_decoded(tmp_path: Path) -> None:
    """A grey of 188 of 255 reflects half as much as white."""
    values = []
    for grey in (255, 188):
        values.append(first_frame(load_scene(painted(tmp_path, np.full((4, 4, 3), grey, np.uint8))))[100, 120])
    assert values[1] / values[0] == pytest.approx(0.5, abs=0.005)


@pytest.mark.few(2)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_shows_colours_of_vertices(tmp_path: Path, kind: str) -> None:
    """Red vertices give the luma of red, whatever the file's byte order, triangles and quads mixed."""
    (tmp_path / "red.ply").write_bytes(ply(kind, faces=MIXED, colours=True))
    (tmp_path / "grey.ply").write_bytes(ply(kind, faces=MIXED))
    red, grey = (first_frame(load_scene(tmp_path / name)) for name in ("red.ply", "grey.ply"))
    seen = grey != grey[0, 0]
    assert 0.05 < seen.mean() < 0.6
    np.testing.assert_allclose(red[seen], grey[seen] / 0.5 * LUMA_WEIGHTS[0], rtol=1e-3)


def test_every_part_has_its_material(tmp_path: Path) -> None:
    """Faces are split by material; negative indices count back from the last vertex before them."""
    (tmp_path / "a b.mtl").write_text("newmtl one\nKd 1 0 0\nnewmtl two\nKd 0 0 0.5\n")
    faces = "usemtl two\nf 1 2 3\nusemtl one\nf -8 -7 -6 -5\nusemtl two\nf 1//1 2//1 3//1\n"
    (tmp_path / "m.obj").write_text(cube(faces, before="mtllib a b.mtl\nvn 0 0 1\n"))
    two, one = read_obj(tmp_path / "m.obj", Budget(tmp_path / "m.obj"))
    assert (two.material, len(two.corners), one.material, len(one.corners)) == ("two", 2, "one", 2)
    np.testing.assert_array_equal(one.corners[1], np.array(CORNERS)[[0, 2, 3]])
    np.testing.assert_array_equal(one.reflectance, [1, 0, 0])
    np.testing.assert_array_equal(two.reflectance, [0, 0, 0.5])
    assert two.normals is None  # only some corners have one
    scene = load_scene(tmp_path / "m.obj")
    make_renderer(replace(scene, objects=dict.fromkeys(["mesh_one", "mesh_two"], scene.path)), scene.own_camera)


def test_comments_at_the_ends_of_lines(tmp_path: Path) -> None:
    """Behind numbers, # begins a comment; in names it is a letter."""
    (tmp_path / "a#1.mtl").write_text("newmtl no #1\nKd 1 0 0.5  # pink\nd 0.25 # mostly clear\n")
    text = cube("usemtl no #1\nf 1/1 2/2 3/3 # front\n", before="mtllib a#1.mtl\n").replace(
        "v -1 -1 1", "v -1 -1 1 # low"
    )
    (tmp_path / "m.obj").write_text(text)
    (part,) = read_obj(tmp_path / "m.obj", Budget(tmp_path / "m.obj"))
    np.testing.assert_array_equal(part.reflectance, [1, 0, 0.5])
    assert part.blend is not None
    assert part.blend.opacity == 0.25
    assert part.corners.shape == (1, 3, 3)


def test_lines_that_go_on(tmp_path: Path) -> None:
    """After a backslash, as older programs write faces with many corners."""
    (tmp_path / "m.obj").write_text(cube("f 1/1 2/2 \\\n3/3 \\ \n 4/4 # front\nf 1 2 3\n"))
    (part,) = read_obj(tmp_path / "m.obj", Budget(tmp_path / "m.obj"))
    assert part.corners.shape == (3, 3, 3)


def test_mirrors_and_glass_are_told(tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_text("newmtl pane\nillum 4 # glass\nnewmtl wall\nillum 2\n")
    path = tmp_path / "m.obj"
    path.write_text(cube("usemtl pane\nf 1 2 3\nusemtl wall\nf 1 3 4\n", before="mtllib m.mtl\n"))
    assert load_scene(path).lost_looks == (LostLook(MIRRORS, ("pane",), ("mesh_pane",)),)


MISSING_LOOKS = {
    "material file": ("mtllib none.mtl\nusemtl gold\n", UNKNOWN, "gold"),
    "material": ("mtllib m.mtl\nusemtl gold\n", UNKNOWN, "gold"),
    "texture": ("mtllib m.mtl\nusemtl paint\n", MISSING, "paint"),
}


@pytest.mark.parametrize(("before", "look", "material"), MISSING_LOOKS.values(), ids=MISSING_LOOKS)
def test_what_is_missing_is_grey_if_asked(tmp_path: Path, before: str, look: str, material: str) -> None:
    """Else the file is refused, and the message names the option."""
    (tmp_path / "m.mtl").write_text("newmtl paint\nKd 1 0 0\nmap_Kd C:\\none.png\n")
    path = tmp_path / "m.obj"
    path.write_text(cube(before=before))
    with pytest.raises((ValueError, OSError), match=r"grey: --grey-unknown \(load_scene\(..., grey_unknown=True\)\)"):
        load_scene(path)
    (part,) = read_obj(path, Budget(path), grey_unknown=True)
    np.testing.assert_array_equal(part.reflectance, [0.5, 0.5, 0.5])
    assert load_scene(path, grey_unknown=True).lost_looks == (LostLook(look, (material,), ("mesh",)),)


def test_a_texture_of_a_ply_file_that_is_missing_is_grey_if_asked(tmp_path: Path) -> None:
    path = tmp_path / "m.ply"
    path.write_text(
        "ply\nformat ascii 1.0\ncomment TextureFile none.png\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nproperty float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\n"
        "end_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    )
    with pytest.raises(FileNotFoundError, match=r"none\.png is not there; .* as grey: --grey-unknown"):
        load_scene(path)
    (part,) = read_ply(path, Budget(path), grey_unknown=True)
    np.testing.assert_array_equal(part.reflectance, [0.5, 0.5, 0.5])
    assert load_scene(path, grey_unknown=True).lost_looks == (LostLook(MISSING, ("none.png",), ("mesh",)),)


def test_materials_without_a_material_file_are_told(tmp_path: Path) -> None:
    path = tmp_path / "m.obj"
    path.write_text(cube(before="usemtl gold\n"))
    assert load_scene(path).lost_looks == (LostLook(UNKNOWN, ("gold",), ("mesh",)),)


def test_normals_that_no_line_gives_are_left_out(tmp_path: Path) -> None:
    """Faces of some exporters name normals and texture coordinates that the file does not have; it is told."""
    path = tmp_path / "m.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1/1 2/2/1 3/3/1\nf 1 3 2\n")
    told = r"coordinates \(vt\), of which the file has none: 1 .* normals \(vn\), .* none: 1 \(the first: line 4\)"
    with pytest.warns(SceneFileWarning, match=told):
        (part,) = read_obj(path, Budget(path))
    assert part.uv is None
    assert part.normals is None
    assert part.corners.shape == (2, 3, 3)


@given(st.data())
def test_colours_as_texture_are_linear_between_corners(data: st.DataObject) -> None:
    """The bilinear lookup at any point of a triangle gives the mixture of its corners' colours."""
    colours = np.random.RandomState(data.draw(st.integers(0, 99))).uniform(size=(data.draw(st.integers(1, 9)), 3, 3))
    texture, uv = colours_as_texture(colours)
    weights = np.random.RandomState(1).dirichlet([1, 1, 1], len(colours))
    at = np.einsum("mi,mij->mj", weights, uv)
    shown = bilinear(texture.astype(np.float64), np.stack([at[:, 0], 1 - at[:, 1]]), 0)
    np.testing.assert_allclose(shown, np.einsum("mi,mij->mj", weights, colours), atol=1e-6)


def test_axes_units_and_path(tmp_path: Path) -> None:
    """OBJ's y points up, PLY's z; the path goes once around, looking at a place above or below the middle; the note
    tells the size."""
    path = tmp_path / "long.obj"
    path.write_text(cube("f 1 2 3\nf 1 2 6\n"))
    stretched = path.read_text().replace("v 1 ", "v 5 ").replace("v -1 1", "v -1 3").replace("v 5 1", "v 5 3")
    path.write_text(stretched)
    assert "6 m x 2 m wide and 4 m high" in load_scene(path).note
    assert "6 m x 4 m wide and 2 m high" in load_scene(path, up="z").note
    assert "0.006 m x 0.002 m wide and 0.004 m high" in load_scene(path, scale=1e-3).note
    scene = load_scene(path)
    t = np.linspace(0, scene.path.duration_s, 41)
    places, turns = scene.path.positions(t), scene.path.rotations(t)
    np.testing.assert_allclose(places[0], places[-1], atol=1e-9)
    across = np.linalg.norm(places[0, :2] - [2.0, 0.0])
    centre = np.array([2.0, 0.0, places[0, 2] - across * np.tan(np.radians(30.0))])
    assert -1.0 <= centre[2] <= 3.0
    towards = (centre - places) / np.linalg.norm(centre - places, axis=1, keepdims=True)
    np.testing.assert_allclose(turns[:, :, 2], towards, atol=1e-12)
    slope = (scene.path.positions(t[1:-1] + 1e-6) - scene.path.positions(t[1:-1] - 1e-6)) / 2e-6
    np.testing.assert_allclose(scene.path.velocities(t[1:-1]), slope, atol=1e-6)
    step = np.einsum("nji,njk->nik", turns[1:-1], scene.path.rotations(t[1:-1] + 1e-6))
    rates = np.stack([step[:, 2, 1], step[:, 0, 2], step[:, 1, 0]], 1) / 1e-6
    np.testing.assert_allclose(scene.path.angular_rates(t[1:-1]), rates, atol=1e-5)


BROKEN_OBJ = {
    "no faces": ("v 0 0 0\n", "has no faces"),
    "empty": ("", "has no faces"),
    "index too large": (cube("f 1 2 9\n"), r":13: a face names v 9, but the file has 8"),
    "index 0": (cube("f 1 2 0\n"), r":13: a corner's index counts from 1"),
    "index before the first": (cube("f 1 2 -9\n"), r":13: a corner's index counts from 1"),
    "no texture coordinate 7": (cube("f 1/7 2/1 3/1\n"), r":13: a face names vt 7, but the file has 4"),
    "two corners": (cube("f 1 2\n"), r":13: a face needs at least 3 corners"),
    "word": ("v 0 zero 0\n", r":1: v needs numbers, got .0 zero 0."),
    "no number": ("v 1.#IND 0 0\n", r":1: v needs numbers, got '1.#IND 0 0'"),
    "nan": (cube().replace("v -1 -1 -1", "v nan -1 -1"), r"vertex 1 must be finite, got \(nan"),
    "no area": (cube("f 1 1 1\nf 1 2 1\n"), r"has no faces .* without area are left out: 2 \(the first: line 13\)"),
    "points": ("v 0 0 0\np 1\np 1\n", r"has no faces .*: points \(p\) have no surface .*: 2 \(the first: line 2\)"),
    "colours of 255": (
        "v 0 0 0 0 0 0\nv 1 0 0 0 255 0\nv 0 1 0 0 0 0\nf 1 2 3\n",
        r"colours of vertices must lie in 0 to 1, vertex 2 has \(0, 255, 0\)",
    ),
    "no mtl": (cube(before="mtllib none.mtl\n"), r":1: the material file 'none.mtl' is not next to the mesh"),
    "curve": ("curv 0 1 1 2\n", "curves and surfaces"),
}


@pytest.mark.parametrize(("text", "said"), BROKEN_OBJ.values(), ids=BROKEN_OBJ)
def test_broken_obj(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "m.obj"
    path.write_text(text)
    with pytest.raises(ValueError, match=said) as caught:
        load_scene(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


BROKEN_MTL = {
    "texture": ("newmtl paint\nmap_Kd other.png\n", "cube.mtl:2: the texture .*other.png is not there"),
    "material": ("newmtl gold\n", "has the material 'paint' that faces use"),
    "colour": ("newmtl paint\nKd 1 2 3\n", "cube.mtl:2: Kd must be three numbers from 0 to 1"),
    "option": ("newmtl paint\nmap_Kd -s 2 2 2 paint.png\n", "cube.mtl:2: options of map_Kd are not read"),
    "no image": ("newmtl paint\nmap_Kd cube.mtl\n", "not an image that can be read"),
}


@pytest.mark.parametrize(("mtl", "said"), BROKEN_MTL.values(), ids=BROKEN_MTL)
def test_broken_materials(tmp_path: Path, mtl: str, said: str) -> None:
    path = painted(tmp_path, np.zeros((4, 4, 3), np.uint8), mtl)
    with pytest.raises((ValueError, FileNotFoundError), match=said):
        load_scene(path)


def test_what_is_not_shown_is_known(tmp_path: Path) -> None:
    """Of which materials and shapes: glass, a lamp, metal, bumps, and a cut-out texture; nothing of a plain one."""
    looks = "newmtl {}\nKd 1 1 1\n{}\n"
    lines = {
        "glass": "Tr -halo 0.4",
        "lamp": "Ke spectral lamp.rfl",
        "steel": "Pm 1",
        "hammered": "bump b.png",
        "plain": "d 0.9999999\nKe 0",
    }
    (tmp_path / "looks.mtl").write_text("".join(looks.format(*one) for one in lines.items()))
    faces = "".join(f"usemtl {name}\n{face}\n" for name, face in zip(lines, QUADS.splitlines(), strict=False))
    (tmp_path / "looks.obj").write_text(cube(faces, before="mtllib looks.mtl\n"))
    found = {look.what: (look.of, look.shapes) for look in load_scene(tmp_path / "looks.obj").lost_looks}
    assert found == {
        "transparency": (("glass",), ("mesh_glass",)),
        "light of their own": (("lamp",), ("mesh_lamp",)),
        "metal": (("steel",), ("mesh_steel",)),
        "normal maps": (("hammered",), ("mesh_hammered",)),
    }
    path = painted(tmp_path, np.zeros((4, 4, 4), np.uint8))
    assert [str(look) for look in load_scene(path).lost_looks] == ["transparency of paint"]


def test_what_has_no_surface_is_left_out_in_one_line(tmp_path: Path) -> None:
    """Points, lines and faces without area of an OBJ file; edges of a PLY file. What is left is simulated."""
    path = tmp_path / "m.obj"
    path.write_text(cube("f 1 2 3\nl 1 2\np 1\nf 1 1 2\nl 3 4\nf 5 5 5\n"))
    with pytest.warns(SceneFileWarning) as caught:
        scene = load_scene(path)
    (warning,) = caught
    assert str(warning.message) == (
        f"{path}: lines (l) have no surface and are left out: 2 (the first: line 14); points (p) have no surface and "
        "are left out: 1 (the first: line 15); faces without area are left out: 2 (the first: line 16)"
    )
    assert scene.name == "m"
    edges = b"element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header"
    path = tmp_path / "m.ply"
    path.write_bytes(ply("ascii", faces=MIXED).replace(b"end_header", edges) + b"0 1\n")
    with pytest.warns(SceneFileWarning, match=r"m\.ply: edges have no surface and are left out: 1"):
        load_scene(path)


@pytest.mark.parametrize("suffix", ["obj", "ply"])
def test_polygons_that_are_not_convex_are_cut_as_they_are(tmp_path: Path, suffix: str) -> None:
    """A dart next to a square: its triangles lie within it, with the texture coordinates of its own corners."""
    outline = [(0, 0), (2, 0), (0.2, 0.2), (0, 2)]
    path = tmp_path / f"dart.{suffix}"
    if suffix == "obj":
        places = "".join(f"v {x} {y} 0\nvt {x} {y}\n" for x, y in outline)
        path.write_text(places + "f 2/2 3/3 4/4 1/1\n")
        (part,) = read_obj(path, Budget(path))
    else:
        header = "ply\nformat ascii 1.0\nelement vertex 4\n" + "".join(f"property float {name}\n" for name in "xyzuv")
        header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        path.write_text(header + "".join(f"{x} {y} 0 {x} {y}\n" for x, y in outline) + "4 1 2 3 0\n")
        (part,) = read_ply(path, Budget(path))
    first, second, third = part.corners.swapaxes(0, 1)
    areas = np.cross(second - first, third - first)[:, 2] / 2
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(0.4)
    assert part.uv is not None
    np.testing.assert_allclose(part.uv, part.corners[..., :2])


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_strips_of_stanfords_files(tmp_path: Path, kind: str) -> None:
    """One list of vertices with -1 between the strips, longer than any polygon may be."""
    strips = [0, 1, 3, 2, -1, 4, 5, 7, 6]
    (tmp_path / "s.ply").write_bytes(ply(kind, faces=[[-1] * 70_000 + strips], element="tristrips"))
    (part,) = read_ply(tmp_path / "s.ply", Budget(tmp_path / "s.ply"))
    corners = np.array(CORNERS)
    np.testing.assert_array_equal(part.corners, corners[[[0, 1, 3], [1, 2, 3], [4, 5, 7], [5, 6, 7]]])


def test_normals_without_direction_are_those_of_the_triangle(tmp_path: Path) -> None:
    """Zero and not finite: one line; all others are of unit length."""
    path = tmp_path / "m.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 -3\nvn 0 0 0\nvn nan 0 0\nf 1//1 2//2 3//3\n")
    with pytest.warns(SceneFileWarning, match="normal has no direction take that of their triangle: 2"):
        (part,) = read_obj(path, Budget(path))
    np.testing.assert_array_equal(part.normals, [[[0, 0, -1]] * 3])  # on the side of the normal that is there


def test_numbers_that_only_rounding_put_beyond_their_bounds_are_taken(tmp_path: Path) -> None:
    """Kd, and colours of vertices in OBJ and PLY, by less than 1e-5; by more they are refused (see BROKEN)."""
    (tmp_path / "m.mtl").write_text("newmtl paint\nKd 1.000001 -1e-7 0.5\n")
    (tmp_path / "m.obj").write_text(cube(before="mtllib m.mtl\nusemtl paint\n"))
    (part,) = read_obj(tmp_path / "m.obj", Budget(tmp_path / "m.obj"))
    np.testing.assert_array_equal(part.reflectance, [1, 0, 0.5])
    (tmp_path / "c.obj").write_text("v 0 0 0 1.000001 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 -1e-7\nf 1 2 3\n")
    (part,) = read_obj(tmp_path / "c.obj", Budget(tmp_path / "c.obj"))
    np.testing.assert_array_equal(part.colours, [[[1, 0, 0], [0, 1, 0], [0, 0, 0]]])
    header = "ply\nformat ascii 1.0\nelement vertex 3\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "red", "green", "blue", "alpha"))
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = "0 0 0 1.000001 0 0 1\n1 0 0 0 1 0 {}\n0 1 0 0 0 -1e-7 1\n3 0 1 2\n"
    (tmp_path / "c.ply").write_text(header + rows.format(0.9999999))
    (part,) = read_ply(tmp_path / "c.ply", Budget(tmp_path / "c.ply"))
    np.testing.assert_array_equal(part.colours, [[[1, 0, 0], [0, 1, 0], [0, 0, 0]]])
    assert part.lost == ()
    (tmp_path / "c.ply").write_text(header + rows.format(0.5))
    assert read_ply(tmp_path / "c.ply", Budget(tmp_path / "c.ply"))[0].lost == ("transparency",)


@pytest.mark.parametrize(("colour", "lost"), [("1 1 1", ()), ("1 1 0.5", ("colours of vertices",))])
def test_colours_of_vertices_next_to_a_material_are_told_as_lost(
    tmp_path: Path, colour: str, lost: tuple[str, ...]
) -> None:
    """The material's are shown; white ones say nothing."""
    (tmp_path / "m.mtl").write_text("newmtl paint\nKd 0.2 0.4 0.6\n")
    (tmp_path / "m.obj").write_text(
        f"mtllib m.mtl\nv 0 0 0 {colour}\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nusemtl paint\nf 1 2 3\n"
    )
    (part,) = read_obj(tmp_path / "m.obj", Budget(tmp_path / "m.obj"))
    np.testing.assert_array_equal(part.reflectance, [0.2, 0.4, 0.6])
    assert part.colours is None
    assert tuple(what.split(" (")[0] for what in part.lost) == lost


BROKEN_PLY = {
    "not ply": (b"plyx\n", "not a PLY file"),
    "no end": (b"ply\nformat ascii 1.0\n", "not a PLY file"),
    "type": (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n", "ply:4: not a line"),
    "no faces": (ply("ascii", faces=[]), "it has 8 points and no faces: a cloud of points has no surface"),
    "index too large": (ply("ascii", faces=[[0, 1, 8]]), r"face 1 names the vertices \[0, 1, 8\], but the file has 8"),
    "index that is none": (
        ply("ascii", faces=[[0, 1, 2]])
        .replace(b"int vertex_ind", b"float vertex_ind")
        .replace(b"\n3 0 1 2", b"\n3 0 1 nan"),
        r"face 1 names the vertices \[0, 1, nan\]",
    ),
    "binary index": (ply("binary_little_endian", faces=[[0, 1, 2], [0, 1, -3]]), "face 2 names the vertices"),
    "cut": (ply("binary_little_endian", faces=MIXED)[:-3], "the file ends within the element 'face'"),
    "ascii cut": (ply("ascii", faces=MIXED)[:-8], "the file ends within the element 'face'"),
    "billions": (
        ply("binary_little_endian", faces=MIXED).replace(b"vertex 8", b"vertex 4000000000"),
        "the file ends within the element 'vertex'",
    ),
    "nan": (ply("ascii", faces=MIXED).replace(b"\n-1 -1 -1", b"\n-1 nan -1"), "vertex 1 must be finite"),
    "two corners": (ply("ascii", faces=[[0, 1]]), "face 1 needs a list of at least 3"),
    "strip": (
        ply("ascii", faces=[[0, 1, 2, -1, 2, 8]], element="tristrips"),
        r"strip 1 names the vertices \[0, 1, 2, -1, 2, 8\], but the file has 8",
    ),
    "strip below -1": (
        ply("ascii", faces=[[0, 1, 2, -2]], element="tristrips"),
        "strip 1 names",
    ),
}


@pytest.mark.parametrize(("data", "said"), BROKEN_PLY.values(), ids=BROKEN_PLY)
def test_broken_ply(tmp_path: Path, data: bytes, said: str) -> None:
    path = tmp_path / "m.ply"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=said) as caught:
        load_scene(path)
    assert str(path) in str(caught.value)


@given(st.data())
def test_any_bytes_give_parts_or_a_value_error(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """A file with some bytes changed or cut never ends in another exception."""
    kind = data.draw(st.sampled_from(["obj", "ascii", "binary_little_endian", "binary_big_endian"]))
    whole = cube().encode() if kind == "obj" else ply(kind, faces=MIXED, colours=True)
    changed = bytearray(whole[: data.draw(st.integers(0, len(whole)))])
    for _ in range(data.draw(st.integers(0, 4)) if changed else 0):
        changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.mktemp("any") / "m"
    path.write_bytes(changed)
    with contextlib.suppress(ValueError):
        parts = read_obj(path, Budget(path)) if kind == "obj" else read_ply(path, Budget(path))
        assert all(np.isfinite(part.corners).all() for part in parts)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("robot.fbx", r"\.fbx files are not read; import the file in Blender and choose File, Export"),
        ("robot.blend", r"Blender's files are not read; in Blender choose File, Export"),
        ("three_plains", "did you mean three_planes"),
        ("poster_6dog", "did you mean poster_6dof"),
        ("plans/slider_depht", "did you mean slider_depth"),
        ("there_is_none.obj", "there is no such scene file"),
        ("readme.txt", r"a scene file must be a Mitsuba scene \(.xml\), glTF \(.gltf, .glb\) or a mesh"),
    ],
)
def test_other_names_and_files(tmp_path: Path, name: str, said: str) -> None:
    given_name = tmp_path / name if "." in name and "none" not in name else name
    if isinstance(given_name, Path):
        given_name.write_bytes(b"glTF")
    with pytest.raises(ValueError, match=said) as caught:
        load_scene(given_name)
    assert "\n" not in str(caught.value)
    assert "Parsing" not in str(caught.value)


def test_axis_and_scale_are_for_meshes_alone() -> None:
    with pytest.raises(ValueError, match="up and scale are for a mesh"):
        load_scene("fence", up="y")
    with pytest.raises(ValueError, match="up and scale are for a mesh"):
        load_scene("fence", scale=1.0)


@pytest.mark.usefixtures("llvm")
def test_simulate_a_mesh_from_the_command_line(tmp_path: Path) -> None:
    """One command from a mesh and a texture to a dataset with events, which says how large it took the mesh to be."""
    image = np.zeros((32, 32, 3), np.uint8)
    image[::2] = 255
    path = painted(tmp_path, image)
    command = ("simulate", path, "-o", tmp_path / "out", "--duration", 0.05, "--rays-per-pixel", 1)
    done = davis_rs(*command, "--scale", 0.1, "--up", "z")
    assert done.returncode == 0, done.stderr
    assert "cube.obj is 0.2 m x 0.2 m wide and 0.2 m high" in done.stderr
    events = np.loadtxt(tmp_path / "out" / "events.txt")
    assert len(events) > 500
    described = json.loads((tmp_path / "out" / "meta.json").read_text())["scene"]
    assert "axis z up" in described["note"]
    files = {name: hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() for name in ("cube.mtl", "paint.png")}
    assert described["files"] == files


def test_a_scene_knows_all_files_that_it_reads(tmp_path: Path) -> None:
    """Materials that faces use and their textures, each once; a PLY mesh's texture; none where there is none."""
    path = painted(tmp_path, np.zeros((4, 4, 3), np.uint8), "newmtl paint\nmap_Kd paint.png\nnewmtl plain\nKd 1 1 1\n")
    first, *others = QUADS.splitlines()
    path.write_text(cube("\n".join([first, "usemtl plain", *others]), before="mtllib cube.mtl\nusemtl paint\n"))
    assert load_scene(path).files == (tmp_path / "cube.mtl", tmp_path / "paint.png")
    header = "ply\nformat ascii 1.0\ncomment TextureFile paint.png\nelement vertex 3\n"
    header += "".join(f"property float {name}\n" for name in "xyzst") + "element face 1\n"
    header += "property list uchar int vertex_indices\nend_header\n"
    mesh = tmp_path / "triangle.ply"
    mesh.write_text(header + "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n")
    assert load_scene(mesh).files == (tmp_path / "paint.png",)
    mesh.write_bytes(ply("ascii", faces=[[0, 1, 2]]))
    assert load_scene(mesh).files == ()


FACES_WITH_CORNERS = """ply
format ascii 1.0
comment TextureFile left.png
comment TextureFile right.png
element vertex 4
property float x
property float y
property float z
element face 3
property list uchar int vertex_indices
property list uchar float texcoord
property int texnumber
property uchar red
property uchar green
property uchar blue
end_header
0 0 0
1 0 0
1 1 0
0 1 0
4 0 1 2 3 8 0 0 1 0 1 1 0 1 1 255 0 0
3 0 1 2 6 0 0.5 1 0.25 1 1 0 255 0 0
3 0 2 3 6 0 0 0 0 0 0 -1 255 0 255
"""
"""As MeshLab writes textures of faces: several, with coordinates of their own at each corner, and faces without."""


def parts_of(folder: Path, text: str) -> list[MeshPart]:
    for name, grey in (("left", 40), ("right", 200)):
        Image.new("RGB", (2, 2), (grey,) * 3).save(folder / f"{name}.png")
    (folder / "faces.ply").write_text(text)
    return read_ply(folder / "faces.ply", Budget(folder / "faces.ply"))


def test_faces_of_a_ply_file_have_textures_and_colours_of_their_own(tmp_path: Path) -> None:
    plain, left, right = parts_of(tmp_path, FACES_WITH_CORNERS)
    assert (plain.material, left.material, right.material) == ("", "left.png", "right.png")
    assert left.uv is not None
    assert right.uv is not None
    assert left.uv.tolist() == [[[0, 0.5], [1, 0.25], [1, 1]]]
    assert np.array_equal(right.uv, right.corners[..., :2])
    assert len(right.uv) == 2
    assert plain.colours is not None
    assert plain.colours.tolist() == [[[1, 0, 1]] * 3]
    assert (left.colours, right.colours) == (None, None)
    # Without textures, all have the colours of their faces; those of vertices come first.
    bare = FACES_WITH_CORNERS.replace("comment TextureFile left.png\ncomment TextureFile right.png\n", "")
    (part,) = parts_of(tmp_path, bare)
    assert part.colours is not None
    assert part.colours[:, 0].tolist() == [[1, 0, 0]] * 3 + [[1, 0, 1]]
    of_vertices = "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    painted_vertices = bare.replace("property float z\n", of_vertices).replace(" 0\n", " 0 0 255 0\n", 4)
    (part,) = parts_of(tmp_path, painted_vertices)
    assert part.colours is not None
    assert (part.colours == [0, 1, 0]).all()
    # Of faces without coordinates of their own, those of the vertices count.
    (part,) = parts_of(
        tmp_path,
        """ply
format ascii 1.0
comment TextureFile left.png
element vertex 3
property float x
property float y
property float z
property float s
property float t
element face 1
property list uchar int vertex_indices
property list uchar float texcoord
end_header
0 0 0 0.25 0.5
1 0 0 1 0
0 1 0 0 1
3 0 1 2 0
""",
    )
    assert part.uv is not None
    assert part.uv[0, 0].tolist() == [0.25, 0.5]


def test_the_opacity_of_faces_of_a_ply_file_is_told_as_lost(tmp_path: Path) -> None:
    text = FACES_WITH_CORNERS.replace("property uchar blue\n", "property uchar blue\nproperty uchar alpha\n")
    for alpha, lost in (("255", ()), ("128", (TRANSPARENCY,))):
        with_alpha = text.replace("-1 255 0 255\n", f"-1 255 0 255 {alpha}\n").replace("255 0 0\n", "255 0 0 255\n")
        assert parts_of(tmp_path, with_alpha)[0].lost == lost


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("6 0 0.5 1 0.25 1 1 0 ", "4 0 0.5 1 0.25 0 ", "face 2 needs 2 texture coordinates for each corner"),
        ("0 1 1 255", "0 1 2 255", "a face has the texture 2 of 2, counted from 0"),
        ("8 0 0 1 0 1 1 0 1 1 ", "8 0 nan 1 0 1 1 0 1 1 ", "texture coordinates of face 1 must be finite"),
        ("6 0 0.5 1 0.25 1 1 0 ", "0 0 ", "the texture 'left.png' needs texture coordinates of vertices"),
        ("property int texnumber", "property float texnumber", "texnumber of face 1 is not the number of a texture"),
    ],
)
def test_textures_of_faces_that_do_not_fit_are_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = FACES_WITH_CORNERS.replace(old, new)
    if "float" in new:
        text = text.replace("0 1 1 255", "0 1 inf 255")
    assert text != FACES_WITH_CORNERS
    with pytest.raises(ValueError, match=said):
        parts_of(tmp_path, text)


def test_textures_without_texture_coordinates_show_their_mean(tmp_path: Path) -> None:
    """Only the triangles that lack coordinates lose the texture, and the mean is that of light, not of sRGB."""
    texels = np.zeros((2, 2, 3), np.uint8)
    texels[0, 0], texels[1, 1] = (255, 255, 255), (0, 188, 0)
    Image.fromarray(texels).save(tmp_path / "paint.png")
    (tmp_path / "m.mtl").write_text("newmtl paint\nmap_Kd paint.png\n")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    path = tmp_path / "m.obj"
    path.write_text(f"mtllib m.mtl\n{corners}usemtl paint\nf 1/1 2/2 3/3\nf 2 4 3\n")
    parts = read_obj(path, Budget(path))
    assert [len(part.corners) for part in parts] == [1, 1]
    placed, unplaced = parts
    assert isinstance(placed.reflectance, EncodedTexture)
    assert not placed.lost
    green = (1 + from_srgb(np.array(188 / 255))) / 4
    np.testing.assert_allclose(unplaced.reflectance, [0.25, green, 0.25], atol=1e-6)
    assert unplaced.lost == (UNPLACED,)
