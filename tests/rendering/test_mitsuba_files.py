"""Scene files that would end the process are refused before Mitsuba sees them."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from clips import write_exr
from davis_rs import DecodeError, load_scene
from davis_rs._mitsuba.files import XmlFile, check_scene_dictionary, read_scene_file
from davis_rs._mitsuba.ply_mesh import check_ply
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.budget import VARIABLE, Budget
from davis_rs.cli.main import main
from davis_rs.scene.repairs import SceneFileWarning

VERTICES = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]


def ply(faces: list[list[int]], form: str = "ascii", *, vertices: int = 4) -> bytes:
    """A mesh of four vertices."""
    header = (
        f"ply\nformat {form} 1.0\ncomment made\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        rows = [*VERTICES, *((len(face), *face) for face in faces)]
        return header + "\n".join(" ".join(map(str, row)) for row in rows).encode() + b"\n"
    order = "<" if "little" in form else ">"
    body = b"".join(struct.pack(f"{order}3f", *row) for row in VERTICES)
    return header + body + b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in faces)


FORMS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("form", FORMS)
def test_meshes(tmp_path: Path, form: str) -> None:
    """Faces of any number of corners are looked at, in every form of the file."""
    path = tmp_path / "mesh.ply"
    for faces in ([[0, 1, 2], [3, 2, 1]], [[0, 1, 2], [0, 1, 3, 2]], []):
        path.write_bytes(ply(faces, form))
        check_ply(path, Budget(path))
    for faces in ([[0, 1, 2], [3, 2, 4]], [[0, 1, 2], [0, 1, 3, -1]], [[0, 1, 99_999_999]]):
        path.write_bytes(ply(faces, form))
        with pytest.raises(DecodeError, match=r"mesh.ply, PLY: a face names vertex (4|-1|99999999) of 4"):
            check_ply(path, Budget(path))
    whole = ply([[0, 1, 2], [3, 2, 1]], form)
    path.write_bytes(whole[:-4])
    with pytest.raises(DecodeError):
        check_ply(path, Budget(path))
    path.write_bytes(whole.replace(b"element vertex 4", b"element vertex 4000000000"))
    with pytest.raises(DecodeError, match="there are not 4000000000 of vertex"):
        check_ply(path, Budget(path))


def test_scene_files(tmp_path: Path) -> None:
    """Meshes are found by the name that a scene file, or one that it includes, gives them; deep XML is refused."""
    (tmp_path / "bad.ply").write_bytes(ply([[0, 1, 9]]))
    shape = '<shape type="ply"><string name="filename" value="$mesh"/></shape>'
    inner, outer = tmp_path / "inner.xml", tmp_path / "outer.xml"
    inner.write_text(f'<scene version="3.0.0"><default name="mesh" value="bad.ply"/>{shape}</scene>')
    outer.write_text('<scene version="3.0.0"><include filename="inner.xml"/></scene>')
    for path in (inner, outer):
        with pytest.raises(DecodeError, match="a face names vertex 9 of 4"):
            read_scene_file(XmlFile(path, {}))
    with pytest.raises(DecodeError, match="a face names vertex 9 of 4"):
        check_scene_dictionary({"type": "scene", "a": {"type": "ply", "filename": str(tmp_path / "bad.ply")}})
    outer.write_text('<scene version="3.0.0"><include filename="outer.xml"/></scene>')
    with pytest.raises(DecodeError, match="15 deep"):
        read_scene_file(XmlFile(outer, {}))
    outer.write_text("<scene>" + "<bsdf>" * 20_000 + "</bsdf>" * 20_000 + "</scene>")
    with pytest.raises(DecodeError, match="nested 100 deep"):
        read_scene_file(XmlFile(outer, {}))
    outer.write_text("<scene")
    with pytest.raises(DecodeError, match="no XML"):
        read_scene_file(XmlFile(outer, {}))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('<bsdf type="../../evil"/>', r"\(line 1\): must name a plug-in of Mitsuba, got the path '../../evil'"),
        ('<default name="a" value="/tmp/evil"/><integrator type="$a"/>', "got the path '/tmp/evil'"),
        ('<bsdf type="blendbsdf"/>', "a blendbsdf must have two materials"),
        ('<bsdf type="blendbsdf"><bsdf type="diffuse"/></bsdf>', "a blendbsdf must have two materials"),
    ],
)
def test_plug_ins_that_would_do_harm(tmp_path: Path, content: str, message: str) -> None:
    """Mitsuba loads libraries from any path, and ends the process at a blend of nothing."""
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{content}<shape type="cube"/></scene>')
    with pytest.raises(DecodeError, match=message):
        load_scene(path)


@pytest.mark.parametrize("name", ["twosided", "scene", "diffuse"])
def test_integrators_that_are_other_plug_ins_are_replaced(tmp_path: Path, name: str) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0"><integrator type="{name}"/><shape type="cube"/></scene>')
    with pytest.warns(SceneFileWarning, match=f"its integrator '{name}', .* is replaced by 'path'"):
        load_scene(path)


@pytest.mark.parametrize("encoding", ["wtf-8", "utf-32", "big5"])
def test_encodings_that_are_not_known(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(f'<?xml version="1.0" encoding="{encoding}"?><scene version="3.0.0"/>')
    with pytest.raises(DecodeError, match="no XML"):
        read_scene_file(XmlFile(path, {}))


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_images_are_charged_by_their_headers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    """Mitsuba would decode them at once; all images of a scene share one budget."""
    for name in "ab":
        if suffix == ".png":
            Image.new("L", (200, 100)).save(tmp_path / f"{name}.png")
        else:
            write_exr(tmp_path / f"{name}.exr", {"Y": np.ones((100, 200), np.float32)})
    bitmaps = "".join(
        f'<texture type="bitmap" id="{name}"><string name="filename" value="{name}{suffix}"/></texture>'
        for name in "ab"
    )
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{bitmaps}</scene>')
    read_scene_file(XmlFile(path, {}))
    monkeypatch.setenv(VARIABLE, "bytes=400KiB")
    with pytest.raises(DecodeError, match=rf"scene\.xml: the image .*b\{suffix} of 200 x 100 texels needs 312 KiB"):
        read_scene_file(XmlFile(path, {}))


def test_what_is_no_image_is_left_to_mitsuba(tmp_path: Path) -> None:
    (tmp_path / "spot.ies").write_text("IESNA")
    path = tmp_path / "scene.xml"
    path.write_text('<scene version="3.0.0"><string name="filename" value="spot.ies"/></scene>')
    read_scene_file(XmlFile(path, {}))


WITH_VARIABLES = """<scene version="3.0.0"><default name="height" value="2"/><integrator type="direct"/>
<emitter type="point"><point name="position" x="0" y="0" z="$height"/></emitter>
<include filename="$shapes.xml"/></scene>"""
INCLUDED = (
    """<scene version="3.0.0"><shape type="sphere" id="ball"><float name="radius" value="$radius"/></shape></scene>"""
)


def test_variables_of_a_file_get_values(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Before the file's defaults, in files that it includes and in names of files; what lacks one is told."""
    file = tmp_path / "scene.xml"
    file.write_text(WITH_VARIABLES)
    (tmp_path / "balls.xml").write_text(INCLUDED)
    given = {"radius": "0.25", "shapes": "balls", "height": "-5"}
    scene = load_scene(file, variables=given)
    assert scene.variables == given
    with variant(SCALAR) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        assert np.array(loaded.shapes()[0].bbox().max).tolist() == [0.25] * 3
        assert np.array(mi.traverse(loaded.emitters()[0])["position"]).ravel().tolist() == [0, 0, -5]
    with pytest.raises(ValueError, match=r"undefined parameter: \$radius.*-D radius=VALUE \(load_scene"):
        load_scene(file, variables={"shapes": "balls"})
    with pytest.raises(ValueError, match="unused parameters"):
        load_scene(file, variables={**given, "colour": "red"})
    with pytest.raises(ValueError, match="variables are for a Mitsuba XML file"):
        load_scene("three_planes", variables=given)
    path = tmp_path / "path.txt"
    path.write_text("0.0 0 0 -3 0 0 0 1\n0.01 0.01 0 -3 0 0 0 1\n0.02 0.02 0 -3 0 0 0 1\n0.03 0.03 0 -3 0 0 0 1\n")
    run = ["simulate", str(file), "--trajectory", str(path), "--camera", "ideal", "-o", str(tmp_path / "out")]
    with pytest.raises(SystemExit):
        main([*run, "-D", "radius"])
    assert "must be NAME=VALUE, got 'radius'" in capsys.readouterr().err
    assert main([*run, *(word for name, value in given.items() for word in ("-D", f"{name}={value}"))]) == 0
    assert json.loads((tmp_path / "out" / "meta.json").read_text())["scene"]["variables"] == given
