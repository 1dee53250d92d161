"""The survey of foreign worlds, on small files of our own: one for each feature that decides who renders a file."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gltf_files import Gltf, quad

SURVEY = Path(__file__).parents[2] / "benches" / "worlds.py"

MATTE = '<bsdf type="diffuse"/>'
BRUSHED = '<bsdf type="roughconductor"><float name="alpha_u" value="0.1"/><float name="alpha_v" value="0.3"/></bsdf>'
VARNISHED = '<bsdf type="principled"><texture type="checkerboard" name="flatness"/></bsdf>'
SILKY = '<bsdf type="principled"><float name="flatness" value="0.5"/><float name="sheen" value="1"/></bsdf>'
SCALED = """<bsdf type="diffuse"><texture type="scale" name="reflectance"><float name="scale" value="0.5"/>
<texture type="checkerboard"/></texture></bsdf>"""
NULL = '<bsdf type="null"/>'
LAMP = '<shape type="rectangle"><transform name="to_world"><translate z="2"/></transform><emitter type="area"/></shape>'
HIDING = 'type="path"><boolean name="hide_emitters" value="true"/></integrator>'
BOARD = '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>'
NEAREST = """<bsdf type="diffuse"><texture type="bitmap" name="reflectance">
<string name="filename" value="picture.png"/>
<string name="filter_type" value="nearest"/></texture></bsdf>"""
COLOURS = """<bsdf type="diffuse"><texture type="mesh_attribute" name="reflectance">
<string name="name" value="vertex_color"/></texture></bsdf>"""
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property float r
property float g
property float b
element face 1
property list uchar int vertex_indices
end_header
0 0 0 1 0 0
1 0 0 0 1 0
0 1 0 0 0 1
3 0 1 2
"""


def xml(*parts: str) -> str:
    return f"""<scene version="3.0.0"><integrator type="direct"/><emitter type="point" id="lamp"/>
    <sensor type="perspective"><transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
    </sensor>{"".join(parts)}</scene>"""


def shape(kind: str, inside: str = MATTE) -> str:
    return f'<shape type="{kind}" id="thing">{inside}</shape>'


SCENES = {
    "checkerboard": (xml(shape("rectangle", BOARD)), "native", ""),
    "nearest": (xml(shape("cube", NEAREST)), "native", ""),
    "colours": (xml(shape("ply", '<string name="filename" value="coloured.ply"/>' + COLOURS)), "native", ""),
    "round": (xml(shape("sphere", BOARD), shape("disk").replace("thing", "other")), "native", ""),
    "cylinder": (xml(shape("cylinder")), "native", ""),
    "instance": (
        xml(
            f'<shape type="shapegroup" id="group"><shape type="sphere">{MATTE}</shape></shape>',
            '<shape type="instance"><ref id="group"/></shape>',
        ),
        "native",
        "",
    ),
    "glass": (xml(shape("sphere", '<bsdf type="dielectric"/>')), "native", ""),
    "frosted": (xml(shape("sphere", '<bsdf type="roughdielectric"/>')), "native", ""),
    "brushed": (xml(shape("sphere", BRUSHED)), "native", ""),
    "varnished": (xml(shape("sphere", VARNISHED)), "integrator", "has a principled surface"),
    "flat sheen": (xml(shape("sphere", SILKY)), "native", ""),
    "null lamp": (xml(shape("rectangle"), LAMP.replace(">", f">{NULL}", 1)), "baked", ""),
    "hidden lamp": (xml(shape("rectangle"), LAMP).replace('type="direct"/>', HIDING), "baked", ""),
    "scaled": (xml(shape("rectangle", SCALED)).replace("3.0.0", "0.6.0"), "native", ""),
    "variable": (xml(shape("sphere", '<float name="radius" value="$r"/>')), "refused", "-D r=VALUE"),
    "absent": (xml(shape("obj", '<string name="filename" value="nowhere.obj"/>')), "missing files", "nowhere.obj"),
}
"""For each Mitsuba file its text, what the survey says of it, and a part of the reason."""


def plain(gltf: Gltf) -> None:
    gltf.node(mesh=quad(gltf))


def lines(gltf: Gltf) -> None:
    plain(gltf)
    gltf.document["meshes"][0]["primitives"][0]["mode"] = 1


def other_images(gltf: Gltf) -> None:
    plain(gltf)
    gltf.document["extensionsRequired"] = ["EXT_texture_avif"]


MODELS: dict[str, tuple[Callable[[Gltf], None], str, str]] = {
    "square": (plain, "native", ""),
    "lines": (lines, "refused", "parts made of lines, which have no surface, left out"),
    "other_images": (other_images, "refused", "EXT_texture_avif"),
}
"""The same for glTF files."""


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("worlds")
    for name, (text, _, _) in SCENES.items():
        (folder / f"{name}.xml").write_text(text)
    for name, (make, _, _) in MODELS.items():
        gltf = Gltf()
        make(gltf)
        gltf.save(folder / f"{name}.glb")
    (folder / "coloured.ply").write_text(PLY)
    (folder / "no_scene.xml").write_text("<notes/>")
    Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3) * 5).save(folder / "picture.png")
    done = subprocess.run([sys.executable, SURVEY, folder, "--rows"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", [*(f"{name}.xml" for name in SCENES), *(f"{name}.glb" for name in MODELS)])
@pytest.mark.long
def test_each_file_has_its_row(surveyed: str, name: str) -> None:
    stem, _, suffix = name.partition(".")
    outcome, reason = (SCENES if suffix == "xml" else MODELS)[stem][1:]
    [row] = [line for line in surveyed.splitlines() if line.startswith(f"{name} ")]
    assert row[61:].startswith(f"{outcome} ")
    assert reason in row
    assert " MB" in row


@pytest.mark.long
def test_outcomes_are_counted(surveyed: str) -> None:
    counts = surveyed.partition("\noutcome\n")[2].partition("\n\n")[0]
    found = {line.split(maxsplit=1)[1]: line.split(maxsplit=1)[0] for line in counts.splitlines()}
    assert found == {
        "XML: native": "11",
        "XML: baked": "2",
        "XML: integrator": "1",
        "XML: refused": "1",
        "XML: missing files": "1",
        "glTF: native": "1",
        "glTF: refused": "2",
        "mesh: native": "1",
    }
    assert "no_scene.xml" not in surveyed
