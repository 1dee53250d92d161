"""One scene in every format: XML, OBJ with MTL, PLY, glTF and GLB give the same light and the same events."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from davis_rs import Scene, compare_events, load_scene, simulate
from davis_rs.events.arrays import EventArray
from davis_rs.events.luma import LumaFrames
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene.files.mesh_scene import usual_light
from gltf_files import Gltf

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.25, 0.75)])
SIDES = [(0, 4, 5, 1), (4, 6, 7, 5), (6, 2, 3, 7), (2, 0, 1, 3), (1, 5, 7, 3), (2, 6, 4, 0)]
UV = np.array([[0, 0], [1.5, 0], [1.5, 1], [0, 1]])
"""v upwards; beyond 1 the texture repeats."""

TRIANGLES = [[side[0], side[k], side[k + 1]] for side in SIDES for k in (1, 2)]
TRIANGLE_UV = np.array([UV[[0, k, k + 1]] for _ in SIDES for k in (1, 2)])


def _texture() -> bytes:
    texels = np.random.default_rng(5).integers(20, 256, (8, 8, 3)).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(texels.repeat(2, 0).repeat(2, 1)).save(file, "PNG")
    return file.getvalue()


def _y_up(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The world's (x, y, z) in a file whose y points up."""
    turned: npt.NDArray[np.float64] = points[:, [0, 2, 1]] * [1, 1, -1]
    return turned


def _obj(folder: Path) -> Path:
    (folder / "box.mtl").write_text("newmtl paint\nmap_Kd paint.png\n")
    lines = ["mtllib box.mtl", "usemtl paint"]
    lines += [f"v {x} {y} {z}" for x, y, z in _y_up(CORNERS)] + [f"vt {u} {v}" for u, v in UV]
    lines += ["f " + " ".join(f"{corner + 1}/{k + 1}" for k, corner in enumerate(side)) for side in SIDES]
    (folder / "box.obj").write_text("\n".join(lines) + "\n")
    return folder / "box.obj"


def _ply(folder: Path) -> Path:
    header = ["ply", "format ascii 1.0", "comment TextureFile paint.png", f"element vertex {3 * len(TRIANGLES)}"]
    header += [f"property float {name}" for name in "xyzst"]
    header += [f"element face {len(TRIANGLES)}", "property list uchar int vertex_indices", "end_header"]
    points = CORNERS[np.array(TRIANGLES)].reshape(-1, 3)
    rows = [f"{x} {y} {z} {s} {t}" for (x, y, z), (s, t) in zip(points, TRIANGLE_UV.reshape(-1, 2), strict=True)]
    faces = [f"3 {3 * k} {3 * k + 1} {3 * k + 2}" for k in range(len(TRIANGLES))]
    (folder / "box.ply").write_text("\n".join([*header, *rows, *faces]) + "\n")
    return folder / "box.ply"


def _document(folder: Path, *, embedded: bool) -> Gltf:
    gltf = Gltf()
    image = {"bufferView": gltf.view(_texture()), "mimeType": "image/png"} if embedded else {"uri": "paint.png"}
    paint = gltf.material(baseColorTexture=gltf.texture(image))
    points = _y_up(CORNERS[np.array(TRIANGLES)].reshape(-1, 3))
    uv = TRIANGLE_UV.reshape(-1, 2) * [1, -1] + [0, 1]
    mesh = gltf.mesh(points - [0, 0.25, 0], np.arange(len(points)), uv=uv, material=paint)
    gltf.node(mesh=mesh, translation=[0, 0.25, 0])
    return gltf


def _gltf(folder: Path) -> Path:
    return _document(folder, embedded=False).save(folder / "box.gltf", buffer="box.bin")


def _glb(folder: Path) -> Path:
    return _document(folder, embedded=True).save(folder / "box.glb")


def _xml(folder: Path) -> Path:
    light = usual_light(None)
    direction = ", ".join(map(repr, light["sun"]["direction"]))
    _obj(folder)
    (folder / "box.xml").write_text(
        f"""<scene version="3.0.0">
        <integrator type="direct"/>
        <emitter type="directional"><vector name="direction" value="{direction}"/>
            <rgb name="irradiance" value="{light["sun"]["irradiance"]}"/></emitter>
        <emitter type="constant"><rgb name="radiance" value="{light["sky"]["radiance"]}"/></emitter>
        <shape type="obj" id="mesh">
            <string name="filename" value="box.obj"/>
            <boolean name="face_normals" value="true"/>
            <transform name="to_world"><matrix value="1 0 0 0  0 0 -1 0  0 1 0 0  0 0 0 1"/></transform>
            <bsdf type="twosided"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
                <string name="filename" value="paint.png"/></texture></bsdf></bsdf>
        </shape></scene>"""
    )
    return folder / "box.xml"


FORMATS: dict[str, Callable[[Path], Path]] = {"xml": _xml, "ply": _ply, "gltf": _gltf, "glb": _glb}


def _scene(path: Path, like: Scene) -> Scene:
    """As the file has it, on the same path through the same lens."""
    return replace(load_scene(path), camera=like.camera, trajectory=like.trajectory).crop(0.0, 0.1)


def _luma(scene: Scene) -> LumaFrames:
    views = Views.along(scene.path, np.linspace(0, 0.1, 4))
    return make_renderer(scene, scene.own_camera, rays_per_pixel=2).luma(views)


def _events(scene: Scene) -> EventArray:
    packets = simulate(scene, accuracy="paper", rays_per_pixel=2, frame_rate_hz=0, depth_rate_hz=0)
    return np.concatenate([packet.events for packet in packets])


@pytest.mark.few(1)
@pytest.mark.parametrize("make", FORMATS.values(), ids=FORMATS)
def test_every_format_gives_the_same_scene(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    """Next to OBJ with MTL: luma to 1e-5, and every event, of XML to the microsecond."""
    (tmp_path / "paint.png").write_bytes(_texture())
    reference = load_scene(_obj(tmp_path))
    like, other = _scene(_obj(tmp_path), reference), _scene(make(tmp_path), reference)
    expected = _luma(like)
    assert expected.std() > 0.04
    np.testing.assert_allclose(_luma(other), expected, rtol=1e-5)
    events = _events(like)
    assert len(events) > 5000
    if make is not _xml:
        np.testing.assert_array_equal(_events(other), events)
        return
    found = compare_events(_events(other), events, size=(240, 180))
    assert found.missing == found.spurious == 0
    assert np.abs(found.time_error_us).max() <= 1  # Mitsuba places the mesh in float32


def test_a_camera_a_path_and_lamps_of_gltf_are_those_of_xml(tmp_path: Path) -> None:
    """A lens, a place, a lamp and a sun, said in both: the same luma, and the same events on the animation's path."""
    (tmp_path / "paint.png").write_bytes(_texture())
    document = _document(tmp_path, embedded=True)
    # Looking from (0, -2, 0.25) along y, 60 degrees wide, moving to the right.
    lens = {"yfov": 2 * float(np.arctan(np.tan(np.pi / 6) * 0.75)), "aspectRatio": 4 / 3, "znear": 0.1}
    camera = document.node(camera=document.add("cameras", {"type": "perspective", "perspective": lens}))
    document.animate(camera, "translation", [0.0, 0.1], [[0, 0.25, 2], [0.125, 0.25, 2]])
    document.light({"type": "point", "intensity": 683.0 * 4}, translation=[1, 2, 3])
    document.light(
        {"type": "directional", "intensity": 683.0 / 2}, rotation=[-float(np.sqrt(0.5)), 0, 0, float(np.sqrt(0.5))]
    )
    theirs = load_scene(document.save(tmp_path / "lit.glb"))
    path = _xml(tmp_path)
    text = path.read_text()
    start, end = text.index("<emitter"), text.index("<shape")
    lights = """<sensor type="perspective"><float name="fov" value="60"/><transform name="to_world">
        <lookat origin="0, -2, 0.25" target="0, 0, 0.25" up="0, 0, 1"/></transform>
        <film type="hdrfilm"><integer name="width" value="240"/><integer name="height" value="180"/></film></sensor>
        <emitter type="point"><point name="position" value="1, -3, 2"/><rgb name="intensity" value="4"/></emitter>
        <emitter type="directional"><vector name="direction" value="0, 0, -1"/>
        <rgb name="irradiance" value="0.5"/></emitter>"""
    path.write_text(text[:start] + lights + text[end:])
    ours = load_scene(path)
    assert ours.start is not None
    assert theirs.start is not None
    np.testing.assert_allclose(theirs.start.matrix, ours.start.matrix, atol=1e-6)
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        assert getattr(theirs.own_camera, name) == pytest.approx(getattr(ours.own_camera, name), rel=1e-6)
    assert theirs.path.duration_s == pytest.approx(0.1)
    alike = replace(ours, camera=theirs.camera, trajectory=theirs.trajectory)
    np.testing.assert_allclose(_luma(theirs), _luma(alike), rtol=1e-5, atol=1e-7)
    found = compare_events(_events(theirs), _events(alike), size=(240, 180))
    assert found.matched > 100_000
    assert found.missing == found.spurious == 0
    assert np.abs(found.time_error_us).max() <= 1  # float32 of an angle and of a tenth of a second
