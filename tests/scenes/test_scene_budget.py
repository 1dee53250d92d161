"""What a scene's file may take of memory and of parts, with all that it names; and which files it may name."""

from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from davis_rs import Camera, DecodeError, Pose, SceneFileWarning, load_scene
from davis_rs._mitsuba.files import XmlFile, read_scene_file
from davis_rs._util.budget import VARIABLE, Budget
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene import texture_file
from davis_rs.scene.files import obj_file
from davis_rs.scene.files.gltf_nodes import NodeTree
from gltf_files import UV, Gltf, quad

FACE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"


def blank_png(width: int, height: int) -> bytes:
    """Black, of 8 bits a channel."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    rows = zlib.compress(bytes((1 + 3 * width) * min(height, 1 << 10)))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def counted(monkeypatch: pytest.MonkeyPatch, module: Any, name: str) -> list[tuple[Any, ...]]:
    """What a function of a module is called with from now on."""
    calls: list[tuple[Any, ...]] = []
    function = getattr(module, name)

    def call(*given: Any) -> Any:
        calls.append(given)
        return function(*given)

    monkeypatch.setattr(module, name, call)
    return calls


def textured(folder: Path, kind: str, *names: str) -> Path:
    """A scene that shows these textures."""
    path = folder / f"scene.{kind}"
    if kind == "obj":
        uses = "".join(f"usemtl m{k}\nf 1/1 2/2 3/3\n" for k in range(len(names)))
        path.write_text(f"mtllib m.mtl\n{FACE}{uses}")
        (folder / "m.mtl").write_text("".join(f"newmtl m{k}\nmap_Kd {name}\n" for k, name in enumerate(names)))
    elif kind == "ply":
        corners = "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n"
        properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "s", "t"))
        path.write_text(
            f"ply\nformat ascii 1.0\ncomment TextureFile {names[0]}\nelement vertex 3\n{properties}"
            f"element face 1\nproperty list uchar int vertex_indices\nend_header\n{corners}3 0 1 2\n"
        )
    else:
        gltf = Gltf()
        for name in names:
            gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(baseColorTexture=gltf.texture({"uri": name}))))
        gltf.save(path)
    return path


@pytest.mark.parametrize("kind", ["obj", "ply", "gltf"])
def test_a_texture_is_charged_before_it_is_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """A file of some kilobytes whose header says 8192 x 8192."""
    monkeypatch.setenv(VARIABLE, "bytes=100MiB")
    (tmp_path / "big.png").write_bytes(blank_png(8192, 8192))
    with pytest.raises(DecodeError, match=r"scene\.\w+: .*big\.png: a texture of 8192 x 8192 texels needs 192 MiB"):
        load_scene(textured(tmp_path, kind, "big.png"))


@pytest.mark.parametrize("kind", ["obj", "gltf"])
def test_all_textures_of_a_file_share_one_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """Each takes 15 bytes a texel in the end, 240 KiB; two of them pass, and three do not."""
    monkeypatch.setenv(VARIABLE, "bytes=700KiB")
    names = [f"{k}.png" for k in range(3)]
    for name in names:
        (tmp_path / name).write_bytes(blank_png(128, 128))
    assert load_scene(textured(tmp_path, kind, *names[:2])) is not None
    with pytest.raises(DecodeError, match=r"texture of 128 x 128 texels.* needs .* are in use; 700 KiB may be held"):
        load_scene(textured(tmp_path, kind, *names))


@pytest.mark.parametrize("kind", ["obj", "gltf"])
def test_a_texture_that_several_materials_show_is_decoded_and_charged_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """An image of 48 KiB, and of 192 KiB in linear light, which all shapes share."""
    monkeypatch.setenv(VARIABLE, "bytes=700KiB")
    (tmp_path / "a.png").write_bytes(blank_png(128, 128))
    decoded = counted(monkeypatch, texture_file, "texture_of_bytes") if kind == "obj" else [()]
    if kind == "obj":
        path = textured(tmp_path, kind, *["a.png"] * 30)
    else:
        gltf = Gltf()
        image = gltf.texture({"uri": "a.png"})
        for number in range(30):
            gltf.node(mesh=quad(gltf, uv=UV, material=gltf.material(f"paint {number}", baseColorTexture=image)))
        path = gltf.save(tmp_path / "scene.gltf")
    load_scene(path)
    assert len(decoded) == 1


@pytest.mark.parametrize("own", ["tint", "light"])
def test_textures_of_several_tints_or_of_surfaces_that_emit_them_are_charged_for_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own: str
) -> None:
    """They are not shared."""
    monkeypatch.setenv(VARIABLE, "bytes=600KiB")
    (tmp_path / "a.png").write_bytes(blank_png(128, 128))
    gltf = Gltf()
    image = gltf.texture({"uri": "a.png"})
    for number in range(3):
        looks: dict[str, Any] = {"more": {"extensions": {"KHR_materials_unlit": {}}}}
        if own == "tint":
            looks = {"baseColorFactor": [1 - 0.1 * number, 1, 1, 1]}
        paint = gltf.material(f"paint {number}", baseColorTexture=image, **looks)
        gltf.node(mesh=quad(gltf, uv=UV, material=paint))
    with pytest.raises(DecodeError, match=r"materials\[2\].*: a texture of 128 x 128 texels in linear light"):
        load_scene(gltf.save(tmp_path / "scene.gltf"))


@pytest.mark.parametrize(
    ("budget", "shapes", "refused"),
    [("530KiB", 1, ""), ("400KiB", 1, r"materials\[0\]: metallicRoughnessTexture"), ("600KiB", 2, "one more shape of")],
)
def test_textures_of_metal_are_charged_for_each_shape(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, budget: str, shapes: int, refused: str
) -> None:
    """Two images of 48 KiB as they are, and of 192 KiB each in linear light; each shape has metal of its own."""
    monkeypatch.setenv(VARIABLE, f"bytes={budget}")
    gltf = Gltf()
    for name in ("a.png", "b.png"):
        Image.fromarray(np.full((128, 128, 3), 9, np.uint8)).save(tmp_path / name)
    base, metal = (gltf.texture({"uri": name}) for name in ("a.png", "b.png"))
    paint = gltf.material(baseColorTexture=base, metallicFactor=1.0, metallicRoughnessTexture=metal)
    for _ in range(shapes):
        node = gltf.node(mesh=quad(gltf, uv=UV, material=paint))
        gltf.animate(node, "translation", [0.0, 1.0], np.eye(3)[:2])
    path = gltf.save(tmp_path / "scene.gltf")
    if not refused:
        scene = load_scene(path)
        assert len(scene.objects) == shapes
        assert {file.name for file in scene.files} >= {"a.png", "b.png"}
        return
    with pytest.raises(DecodeError, match=rf"{refused}.*: a texture of 128 x 128 texels in linear light"):
        load_scene(path)


@pytest.mark.parametrize("kind", ["obj", "ply", "gltf"])
def test_sides_of_textures_are_checked_by_the_header(tmp_path: Path, kind: str) -> None:
    (tmp_path / "thin.png").write_bytes(blank_png(1, 1 << 26))
    with pytest.raises(ValueError, match=r"thin\.png: a texture may have 65536 texels on a side, got 1 x 67108864"):
        load_scene(textured(tmp_path, kind, "thin.png"))


def test_accessors_without_data_share_one_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of them is small; they take no bytes in the file."""
    monkeypatch.setenv(VARIABLE, "bytes=10MiB")
    gltf = Gltf()
    numbers = [gltf.add("accessors", {"componentType": 5126, "type": "VEC3", "count": 1 << 14}) for _ in range(40)]
    indices = gltf.array([0, 1, 2], "u4")
    gltf.node(
        mesh=gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": k}, "indices": indices} for k in numbers]})
    )
    with pytest.raises(DecodeError, match=r"accessors\[\d\d\]: 16384 elements of 3 numbers needs 384 KiB, .* in use"):
        load_scene(gltf.save(tmp_path / "scene.glb"))


def test_objects_of_the_json_are_counted_before_they_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gltf = Gltf()
    gltf.node(mesh=quad(gltf))
    for _ in range(300):
        gltf.node()
    path = gltf.save(tmp_path / "scene.gltf")
    load_scene(path)
    monkeypatch.setenv(VARIABLE, "items=200")
    with pytest.raises(DecodeError, match="more than 200 parts, the last of them objects of the JSON"):
        load_scene(path)
    monkeypatch.setenv(VARIABLE, "bytes=20KiB")
    with pytest.raises(DecodeError, match=r"JSON with \d+ values needs"):
        load_scene(path)


def test_many_users_of_one_accessor_cost_time_and_triangles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What they have is no more than a line of the JSON, also where their triangles have no area."""
    gltf = Gltf()
    zeros = gltf.add("accessors", {"componentType": 5126, "type": "VEC3", "count": 300})
    gltf.node(mesh=gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": zeros}}] * 50}))
    gltf.node(mesh=quad(gltf))
    path = gltf.save(tmp_path / "scene.glb")
    with pytest.warns(SceneFileWarning, match="triangles without area are left out: 5000"):
        load_scene(path)
    monkeypatch.setenv(VARIABLE, "items=3000")
    with pytest.raises(DecodeError, match="more than 3000 parts, the last of them triangles"):
        load_scene(path)
    monkeypatch.setenv(VARIABLE, "seconds=0.000000001")
    with pytest.raises(DecodeError, match="reading its meshes has taken more than 1e-09 s"):
        load_scene(path)


def test_keyframes_are_looked_at_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that an animation of many keyframes takes little more than its numbers."""
    asked = []
    matrices = NodeTree.matrices

    def noted(self: NodeTree, index: int, t: Any) -> Any:
        asked.append(len(t))
        return matrices(self, index, t)

    monkeypatch.setattr(NodeTree, "matrices", noted)
    gltf = Gltf()
    node, keys = gltf.node(mesh=quad(gltf)), 30_000
    gltf.animate(node, "translation", np.arange(keys) / 100, np.random.default_rng(0).random((keys, 3)))
    path = gltf.save(tmp_path / "scene.glb")
    scene = load_scene(path)
    assert max(asked) <= 1 << 14
    assert 4 * (keys - 1) <= sum(asked) < 5 * keys
    np.testing.assert_allclose(scene.objects["node_0_material"].breaks_s(), np.arange(1, keys - 1) / 100, rtol=1e-6)
    monkeypatch.setenv(VARIABLE, "bytes=20MiB")
    with pytest.raises(DecodeError, match=r"the path of node node_0 needs"):
        load_scene(path)


def test_many_shapes_of_one_name_are_numbered_in_one_pass(tmp_path: Path) -> None:
    gltf = Gltf()
    mesh = quad(gltf)
    for _ in range(200):
        node = gltf.node(mesh=mesh, name="a b")
        gltf.animate(node, "translation", [0.0, 1.0], [[0, 0, 0], [1, 0, 0]])
    scene = load_scene(gltf.save(tmp_path / "scene.glb"))
    assert [*scene.objects] == ["a_b_material", *(f"a_b_material_{k}" for k in range(2, 201))]


def test_a_material_file_is_read_once_however_often_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And what is named last counts."""
    read = counted(monkeypatch, obj_file, "Materials")
    (tmp_path / "a.mtl").write_text("newmtl paint\nKd 1 0 0\n")
    (tmp_path / "b.mtl").write_text("newmtl paint\nKd 0 1 0\n")
    path = tmp_path / "m.obj"
    path.write_text("mtllib a.mtl\nmtllib b.mtl\n" * 50 + "mtllib a.mtl\n" + FACE + "usemtl paint\nf 1 2 3\n")
    (part,) = obj_file.read_obj(path, Budget(path))
    assert len(read) == 2
    np.testing.assert_array_equal(part.reflectance, [1, 0, 0])


def test_names_of_shapes_are_made_once_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not once for each pair of materials."""
    made = counted(monkeypatch, re, "sub")
    path = tmp_path / "m.obj"
    path.write_text(FACE + "".join(f"usemtl m {k}\nf 1 2 3\n" for k in range(50)) + "usemtl m_7\nf 1 2 3\n")
    load_scene(path)
    assert sum(pattern == r"\W" for pattern, *_ in made) == 51


@pytest.mark.parametrize("text", ["f 1 2 3\n", "v 0 0 0\n", "\n"])
def test_lines_of_an_obj_are_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    path = tmp_path / "m.obj"
    path.write_text(FACE + text * 1000)
    monkeypatch.setenv(VARIABLE, "bytes=20KiB" if text != "\n" else "items=900")
    with pytest.raises(DecodeError, match=rf"m\.obj: .*{re.escape(VARIABLE)}"):
        load_scene(path)


@pytest.mark.parametrize("form", ["ascii", "binary"])
def test_rows_of_a_ply_are_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str) -> None:
    """Lists of different lengths are objects of Python; alike ones are a table of float64."""
    count = 1000
    kind = "ascii" if form == "ascii" else "binary_little_endian"
    header = f"ply\nformat {kind} 1.0\nelement vertex {count}\n"
    header += "".join(f"property uchar {name}\n" for name in "xyz") + "end_header\n"
    path = tmp_path / "m.ply"
    path.write_bytes(header.encode() + (b"0 0 0\n" * count if form == "ascii" else bytes(3 * count)))
    monkeypatch.setenv(VARIABLE, "bytes=30KiB")
    with pytest.raises(DecodeError, match=r"m\.ply: (its words|the element 'vertex') needs"):
        load_scene(path)


@pytest.mark.parametrize("name", ["../secret", "{}/secret", "link"])
@pytest.mark.parametrize("kind", ["mtllib", "map_Kd", "TextureFile"])
def test_files_outside_of_the_scenes_folder_are_not_opened(tmp_path: Path, kind: str, name: str) -> None:
    (tmp_path / "secret").write_bytes(blank_png(4, 4))
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "link").symlink_to(tmp_path / "secret")
    name = name.format(tmp_path)
    if kind == "mtllib":
        path = folder / "scene.obj"
        path.write_text(f"mtllib {name}\n{FACE}f 1 2 3\n")
    else:
        path = textured(folder, "obj" if kind == "map_Kd" else "ply", name)
    said = r"names .* which lies outside of the scene's folder: put a copy next to \S+$"
    if name == "link":
        said = "'link' is a link to outside of the scene's folder: put the file itself there"
    with pytest.raises(DecodeError, match=f"{kind}: {said}"):
        load_scene(path)


@pytest.mark.parametrize("name", ["../{}", "C:/Users/Jo/My models/{}", "/elsewhere/{}", "C:\\models\\{}"])
@pytest.mark.parametrize("here", ["paint.png", "textures/paint.png"])
def test_a_texture_is_found_by_the_end_of_its_name(tmp_path: Path, name: str, here: str) -> None:
    """A collection's texture that was put next to the mesh is found, though the name leads elsewhere."""
    folder = tmp_path / "scene"
    (folder / here).parent.mkdir(parents=True)
    (tmp_path / "paint.png").write_bytes(blank_png(2, 2))
    (folder / here).write_bytes(blank_png(4, 4))
    path = textured(folder, "obj", name.format(here))
    with pytest.warns(SceneFileWarning, match=rf"\.mtl:\d+: map_Kd: .* is taken to be '{here}' next to it$") as told:
        scene = load_scene(path)
    assert folder / here in scene.files
    assert len([line for line in told if "is taken to be" in str(line.message)]) == 1


def test_the_longest_end_of_a_name_counts(tmp_path: Path) -> None:
    (tmp_path / "textures").mkdir()
    for here in ("paint.png", "textures/paint.png"):
        (tmp_path / here).write_bytes(blank_png(4, 4))
    with pytest.warns(SceneFileWarning, match="is taken to be 'textures/paint.png'"):
        assert (
            tmp_path / "textures" / "paint.png" in load_scene(textured(tmp_path, "obj", "../textures/paint.png")).files
        )


def test_ends_of_names_have_few_steps(tmp_path: Path) -> None:
    """Each end is looked for, so that a name of thousands of steps would take seconds."""
    here = "/".join("abcdefg") + "/paint.png"
    (tmp_path / here).parent.mkdir(parents=True)
    (tmp_path / here).write_bytes(blank_png(4, 4))
    with pytest.warns(SceneFileWarning, match="is taken to be 'a/b/c"):
        load_scene(textured(tmp_path, "obj", f"/elsewhere/{here}"))
    (tmp_path / "z").mkdir()
    (tmp_path / "a").rename(tmp_path / "z" / "a")
    with pytest.raises(DecodeError, match="which lies outside of the scene's folder"):
        load_scene(textured(tmp_path, "obj", f"/elsewhere/z/{here}"))


def test_the_end_of_a_name_leads_to_no_file_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(blank_png(4, 4))
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "link").symlink_to(tmp_path / "secret")
    for name in ("/elsewhere/link", "/elsewhere/../secret"):
        with pytest.raises(DecodeError, match="which lies outside of the scene's folder"):
            load_scene(textured(folder, "obj", name))


def test_a_name_that_the_system_refuses(tmp_path: Path) -> None:
    name = "a" * 3000
    path = tmp_path / "scene.obj"
    path.write_text(f"mtllib {name}\n{FACE}f 1 2 3\n")
    with pytest.raises(DecodeError, match=r"scene\.obj:1: mtllib: '.* names no file: "):
        load_scene(path)


def test_a_material_file_may_name_a_texture_beside_its_folder(tmp_path: Path) -> None:
    (tmp_path / "materials").mkdir()
    (tmp_path / "paint.png").write_bytes(blank_png(4, 4))
    (tmp_path / "materials" / "m.mtl").write_text("newmtl paint\nmap_Kd ..\\paint.png\n")
    (tmp_path / "m.obj").write_text(f"mtllib materials/m.mtl\n{FACE}usemtl paint\nf 1/1 2/2 3/3\n")
    assert tmp_path / "paint.png" in load_scene(tmp_path / "m.obj").files


def test_a_mitsuba_file_may_name_files_outside_of_its_folder(tmp_path: Path) -> None:
    """Scenes of a collection share files. What lies there is seen, and charged as well."""
    for name in ("scene", "shared"):
        (tmp_path / name).mkdir()
    Image.new("RGB", (300, 200), (255, 0, 0)).save(tmp_path / "shared" / "red.png")
    path = tmp_path / "scene" / "scene.xml"
    path.write_text(
        """<scene version="3.0.0"><integrator type="direct"/><emitter type="constant"/><shape type="rectangle">
        <bsdf type="diffuse"><texture type="bitmap" name="reflectance">
        <string name="filename" value="../shared/red.png"/></texture></bsdf></shape></scene>"""
    )
    budget = Budget(path)
    read_scene_file(XmlFile(path, {}), budget)
    assert budget.bytes > 16 * 300 * 200
    renderer = make_renderer(load_scene(path), Camera(4, 4, 40.0, 40.0, 2.0, 2.0), rays_per_pixel=1)
    down = Pose((0, 0, 1), (1, 0, 0, 0))
    assert renderer.luma(Views.at_rest([down])) == pytest.approx(0.299, rel=1e-3)  # the luma of red
