"""PLY meshes of Mitsuba files that Mitsuba 3 refuses, or shows black."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

import davis_rs
from davis_rs import DecodeError
from davis_rs._mitsuba.files import XmlFile
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.budget import VARIABLE
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene.repairs import SceneFileWarning

FloatArray = npt.NDArray[np.float64]

FORMS = ["ascii", "binary_little_endian", "binary_big_endian"]
CORNERS = ((-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0))
INDICES, UV = ("list", "uchar", "int", "vertex_indices"), ("list", "uchar", "float", "texcoord")
CODES = {"uchar": "B", "int": "i", "float": "f"}


def write_ply(
    path: Path,
    faces: list[tuple[object, ...]],
    of_faces: tuple[tuple[str, ...], ...] = (INDICES,),
    *,
    vertices: tuple[tuple[float, ...], ...] = CORNERS,
    names: tuple[str, ...] = ("x", "y", "z"),
    form: str = "ascii",
) -> None:
    """Write a mesh. A face has a number or a tuple for each of its properties."""
    lines = ["ply", f"format {form} 1.0", f"element vertex {len(vertices)}", *(f"property float {n}" for n in names)]
    lines += [f"element face {len(faces)}", *(f"property {' '.join(words)}" for words in of_faces), "end_header"]
    rows: list[list[tuple[str, float]]] = [[("float", number) for number in vertex] for vertex in vertices]
    for face in faces:
        row: list[tuple[str, float]] = []
        for words, value in zip(of_faces, face, strict=True):
            if isinstance(value, tuple):
                row += [(words[1], len(value)), *((words[2], number) for number in value)]
            else:
                row.append((words[0], value))  # type: ignore[arg-type]
        rows.append(row)
    if form == "ascii":
        body = "".join(" ".join(f"{number:g}" for _, number in row) + "\n" for row in rows).encode()
    else:
        order = "<" if "little" in form else ">"
        body = b"".join(struct.pack(order + CODES[kind], number) for row in rows for kind, number in row)
    path.write_bytes("\n".join(lines).encode() + b"\n" + body)


def scene_file(
    folder: Path, of_shape: str = "", name: str = "mesh.ply", light: str = '<emitter type="constant"/>'
) -> Path:
    """Write a scene of a mesh in front of a camera."""
    path = folder / "scene.xml"
    path.write_text(
        f"""<scene version="3.0.0"><integrator type="direct"/>
        <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">
            <lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
            <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film></sensor>
        {light}
        <shape type="ply"><string name="filename" value="{name}"/>{of_shape}</shape></scene>"""
    )
    return path


class Loaded(NamedTuple):
    """What Mitsuba has of the mesh, corner by corner (m, 3, k)."""

    points: FloatArray
    uv: FloatArray | None
    normals: FloatArray | None
    colours: FloatArray | None
    told: str


def loaded(path: Path, variables: dict[str, str] | None = None) -> Loaded:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        davis_rs.load_scene(path, variables=variables)
    with variant(SCALAR) as (mi, _):
        (shape,) = load_scene_source(XmlFile(path, variables or {}), mi).shapes()
        parameters = mi.traverse(shape)

        def each(name: str, width: int) -> FloatArray | None:
            if name not in parameters or not len(parameters[name]):
                return None
            return np.array(parameters[name], np.float64).reshape(-1, width)

        faces = np.array(parameters["faces"]).reshape(-1, 3)
        points, uv = each("vertex_positions", 3), each("vertex_texcoords", 2)
        normals, colours = each("vertex_normals", 3), each("face_color", 3)
        flat = "face_normals = 1" in str(shape)
    assert points is not None
    return Loaded(
        points[faces],
        None if uv is None else uv[faces],
        None if normals is None or flat else normals[faces],
        colours,
        "; ".join(str(warning.message) for warning in told if warning.category is SceneFileWarning),
    )


@pytest.mark.parametrize("form", FORMS)
def test_texture_coordinates_of_corners(tmp_path: Path, form: str) -> None:
    """Two faces share vertices, at which they have other texture coordinates: MeshLab writes such lists."""
    uv = (0.0, 0.0, 1.0, 0.0, 1.0, 0.5), (0.25, 0.0, 0.75, 0.5, 0.0, 1.0)
    faces: list[tuple[object, ...]] = [((0, 1, 2), uv[0]), ((0, 2, 3), uv[1])]
    write_ply(tmp_path / "mesh.ply", faces, (INDICES, UV), form=form)
    found = loaded(scene_file(tmp_path))
    assert found.told == ""
    assert found.uv is not None
    np.testing.assert_allclose(found.uv, np.array(uv).reshape(2, 3, 2))
    np.testing.assert_allclose(found.points, np.array(CORNERS)[[[0, 1, 2], [0, 2, 3]]])


@pytest.mark.parametrize("form", FORMS)
def test_faces_that_have_no_texture_coordinates_take_those_of_their_vertices(tmp_path: Path, form: str) -> None:
    vertices = tuple((*corner, corner[0] / 4, corner[1] / 4) for corner in CORNERS)
    of_faces = (INDICES, UV, ("float", "r"), ("float", "g"), ("float", "b"))
    own = (0.0, 0.0, 1.0, 0.0, 1.0, 0.5)
    faces: list[tuple[object, ...]] = [((0, 1, 2), (), 0.5, 0.25, 1.0), ((0, 2, 3), own, 0.0, 1.0, 0.0)]
    names = ("x", "y", "z", "texture_u", "texture_v")
    write_ply(tmp_path / "mesh.ply", faces, of_faces, vertices=vertices, names=names, form=form)
    found = loaded(scene_file(tmp_path))
    assert found.told == ""
    assert found.uv is not None
    assert found.colours is not None
    np.testing.assert_allclose(found.uv[0], np.array(CORNERS)[[0, 1, 2], :2] / 4)
    np.testing.assert_allclose(found.uv[1], np.reshape(own, (3, 2)))
    np.testing.assert_allclose(found.colours, [[0.5, 0.25, 1.0], [0.0, 1.0, 0.0]])


@pytest.mark.parametrize("form", FORMS)
def test_lists_of_another_meaning_are_left_out(tmp_path: Path, form: str) -> None:
    of_faces = (INDICES, ("list", "uchar", "int", "flags"))
    write_ply(tmp_path / "mesh.ply", [((0, 1, 2), (7,)), ((0, 2, 3), (7, 8))], of_faces, form=form)
    found = loaded(scene_file(tmp_path))
    assert "its meshes mesh.ply have the list 'flags' of faces, which is left out" in found.told
    np.testing.assert_allclose(found.points, np.array(CORNERS)[[[0, 1, 2], [0, 2, 3]]])


@pytest.mark.parametrize("form", FORMS)
def test_polygons(tmp_path: Path, form: str) -> None:
    """A quad becomes two triangles, also next to triangles."""
    write_ply(tmp_path / "mesh.ply", [((0, 1, 2, 3),), ((2, 1, 0),)], form=form)
    found = loaded(scene_file(tmp_path))
    assert "mesh.ply have faces with more than three corners, which are cut into triangles" in found.told
    np.testing.assert_allclose(found.points, np.array(CORNERS)[[[0, 1, 2], [0, 2, 3], [2, 1, 0]]])


def test_a_mesh_that_a_variable_names(tmp_path: Path) -> None:
    write_ply(tmp_path / "mesh.ply", [((0, 1, 2), (0.0,) * 6)], (INDICES, UV))
    assert len(loaded(scene_file(tmp_path, name="$what.ply"), {"what": "mesh"}).points) == 1


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("lost", [0.0, float("nan")])
def test_meshes_all_of_whose_normals_have_no_direction_are_flat(tmp_path: Path, form: str, lost: float) -> None:
    """They are as bright with Mitsuba's integrators as with the native renderer, and as without such normals."""
    faces: list[tuple[object, ...]] = [((0, 1, 2),), ((0, 2, 3),)]
    sun = '<emitter type="directional"><vector name="direction" value="0, 1, -2"/></emitter>'
    path = scene_file(tmp_path, light=sun)
    write_ply(tmp_path / "mesh.ply", faces, form=form)
    expected = luma(path, "integrator")
    names = ("x", "y", "z", "nx", "ny", "nz")
    vertices = tuple((*corner, lost, lost, lost) for corner in CORNERS)
    write_ply(tmp_path / "mesh.ply", faces, vertices=vertices, names=names, form=form)
    found = loaded(path)
    assert found.told.endswith("its meshes mesh.ply have normals without a direction, so their faces are flat")
    assert found.normals is None
    np.testing.assert_allclose(luma(path, "integrator"), expected, rtol=1e-5)
    np.testing.assert_allclose(luma(path, "native"), expected, rtol=1e-5)
    assert loaded(scene_file(tmp_path, '<boolean name="face_normals" value="true"/>', light=sun)).told == ""


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("front", [1.0, -1.0])
def test_single_normals_without_a_direction(tmp_path: Path, form: str, front: float) -> None:
    """They become the mean of their triangles', on the side of the others. Vertices of no face do not matter."""
    names = ("x", "y", "z", "nx", "ny", "nz")
    normals = (0.0, 0.0, front), (0.0, 0.0, 0.0), (0.0, 0.6, front * 0.8), (0.0, 0.0, front)
    vertices = tuple((*corner, *normal) for corner, normal in zip(CORNERS, normals, strict=True))
    vertices = (*vertices, (5.0, 5.0, 5.0, 0.0, 0.0, 0.0))
    write_ply(tmp_path / "mesh.ply", [((0, 1, 2),), ((0, 2, 3),)], vertices=vertices, names=names, form=form)
    found = loaded(scene_file(tmp_path))
    assert "mesh.ply have normals without a direction, which become the mean of their triangles'" in found.told
    assert found.normals is not None
    np.testing.assert_allclose(found.normals[0], [normals[0], (0.0, 0.0, front), normals[2]], atol=1e-6)
    write_ply(tmp_path / "mesh.ply", [((0, 2, 3),)], vertices=vertices, names=names, form=form)
    assert loaded(scene_file(tmp_path)).told == ""


def test_malformed_meshes_are_refused(tmp_path: Path) -> None:
    write_ply(tmp_path / "mesh.ply", [((0, 1, 2), (0.0,) * 6)], (INDICES, UV), form="binary_little_endian")
    whole = (tmp_path / "mesh.ply").read_bytes()
    for broken in (whole[:-1], whole.replace(b"float texcoord", b"what texcoord")):
        (tmp_path / "mesh.ply").write_bytes(broken)
        with pytest.raises(DecodeError, match=r"mesh\.ply"):
            davis_rs.load_scene(scene_file(tmp_path))


@pytest.mark.parametrize(("faces", "what"), [("polygons", "corners"), ("different", "faces")])
def test_small_files_of_many_corners_are_charged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, faces: str, what: str
) -> None:
    """Cut into triangles, polygons take a hundred times their bytes; so do faces of which each is read alone."""
    corners = {"polygons": [((0, 1, 2) * 80,)] * 500, "different": [((),), ((0, 1, 2),)] * 5000}
    indices = ("list", "uchar", "uchar", "vertex_indices")
    write_ply(tmp_path / "mesh.ply", corners[faces], (indices,), form="binary_little_endian")  # type: ignore[arg-type]
    monkeypatch.setenv(VARIABLE, "bytes=3MiB")
    with pytest.raises(DecodeError, match=rf"mesh\.ply: its list of {what} needs"):
        davis_rs.load_scene(scene_file(tmp_path))


def luma(path: Path, kind: str) -> FloatArray:
    """Render a scene from its start."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneFileWarning)
        scene = davis_rs.load_scene(path)
    assert scene.camera is not None
    assert scene.start is not None
    renderer = make_renderer(scene, scene.camera, kind=kind, rays_per_pixel=256, blur=False)
    return np.asarray(renderer.luma(Views.at_rest([scene.start])), np.float64)
