"""Mitsuba files without a version, with files that they include, with animations, and such as attack the reader."""

from __future__ import annotations

import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import davis_rs
from davis_rs import DecodeError
from davis_rs._mitsuba.files import XmlFile, read_scene_file
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.budget import VARIABLE
from davis_rs.scene.repairs import SceneFileWarning

BALL = '<shape type="sphere" id="ball"><float name="radius" value="0.5"/>{}</shape>'
SENSOR = """<sensor type="perspective"><float name="fov" value="40"/>{}
    <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/></film></sensor>"""
LIGHT = '<emitter type="constant"/>'
LOOKING = '<lookat origin="{} 0 4" target="{} 0 0" up="0 1 0"/>'
AT = f'<transform name="to_world">{LOOKING.format(0, 0)}</transform>'


def scene_file(folder: Path, *parts: str, version: str | None = "0.6.0", name: str = "scene.xml") -> Path:
    """Write a scene."""
    path = folder / name
    given = "" if version is None else f' version="{version}"'
    path.write_text(f"<scene{given}>\n" + "\n".join(parts) + "\n</scene>")
    return path


def loaded(path: Path) -> tuple[davis_rs.Scene, list[str]]:
    """Return a file's scene, and what is told of the file."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SceneFileWarning)
        scene = davis_rs.load_scene(path)
    return scene, [str(one.message).removeprefix(f"{path}: ") for one in caught]


@pytest.mark.parametrize(
    ("version", "name", "told"),
    [
        (None, "toWorld", "it has no version, so it is read as one of Mitsuba 0.6, because of names such as 'toWorld'"),
        (None, "to_world", "it has no version, so it is read as one of Mitsuba 3"),
        ("1.1", "toWorld", "its version '1.1' is none of Mitsuba's, so it is read as one of Mitsuba 0.6, because"),
        ("$MtsVer", "to_world", "its version '$MtsVer' is none of Mitsuba's, so it is read as one of Mitsuba 3"),
        ("0.5.0", "toWorld", None),
        ("3.0.0", "to_world", None),
    ],
)  # fmt: skip
def test_a_missing_version_follows_from_the_names(
    tmp_path: Path, version: str | None, name: str, told: str | None
) -> None:
    placed = BALL.format(f'<transform name="{name}"><translate x="3"/></transform>')
    path = scene_file(tmp_path, placed, LIGHT, version=version)
    scene, notes = loaded(path)
    assert len(notes) == (told is not None)
    assert told is None or notes[0].startswith(told)
    with variant(SCALAR) as (mi, _):
        assert load_scene_source(scene.source(), mi).bbox().max.x == 3.5


@pytest.mark.parametrize("outer", ["0.6.0", "3.0.0"])
def test_included_files_have_versions_and_repairs_of_their_own(tmp_path: Path, outer: str) -> None:
    """Each is in a folder of its own; what it names lies next to the scene's file."""
    (tmp_path / "parts").mkdir()
    moved = BALL.format('<transform name="{}"><translate x="3"/></transform><srgb name="shine" value="1"/>')
    scene_file(tmp_path / "parts", moved.format("toWorld"), version="0.6.0", name="old.xml")
    scene_file(tmp_path / "parts", moved.format("to_world").replace("ball", "new"), version="3.0.0", name="new.xml")
    (tmp_path / "parts" / "paint.xml").write_text('<bsdf version="0.6.0" type="phong" id="paint"/>')
    path = scene_file(
        tmp_path,
        *(f'<include filename="parts/{name}.xml"/>' for name in ("old", "new")),
        BALL.replace("ball", "third").format('<include filename="parts/paint.xml"/>'),
        version=outer,
    )
    scene, notes = loaded(path)
    assert "'phong' are taken as 'principled'" in notes[0]
    assert "shine of a sphere is left out" in notes[0]
    with variant(SCALAR) as (mi, _):
        shapes = load_scene_source(scene.source(), mi).shapes()
        assert [shape.bbox().max.x for shape in shapes] == [3.5, 3.5, 0.5]
    scene_file(tmp_path / "parts", BALL.format('<bsdf type="hk"/>'), name="old.xml")
    with pytest.raises(ValueError, match=r'parts/old.xml \(line 2\).*"hk" not found'):
        davis_rs.load_scene(path)


def moving(*keys: tuple[float, str]) -> str:
    """Return an animation."""
    transforms = "".join(f'<transform time="{t}">{at}</transform>' for t, at in keys)
    return f'<animation name="toWorld">{transforms}</animation>'


def test_animated_shapes_are_moving_objects(tmp_path: Path) -> None:
    """On straight lines, and by the shorter way around; their sizes stay in their own frames."""
    turned = '<scale x="2" y="1" z="0.5"/><rotate z="1" angle="{}"/><translate x="{}"/>'
    path = scene_file(
        tmp_path,
        '<default name="x" value="5"/>',
        SENSOR.format(AT),
        f'<shape type="cube">{moving((0.5, turned.format(0, 1)), (1.5, turned.format(90, 3)))}</shape>',
        BALL.format(moving((0, '<translate x="$x"/>'))),
        LIGHT,
    )
    scene, notes = loaded(path)
    assert notes == ["times of its animations are taken as seconds: 0.5 to 1.5 s"]
    assert list(scene.objects) == ["moving_0"]  # a single keyframe does not move
    body = scene.objects["moving_0"]
    np.testing.assert_allclose(body.positions([0, 0.5, 1, 1.5])[:, 0], [1, 1, 2, 3], atol=1e-12)
    np.testing.assert_allclose(body.velocities([0.2, 1])[:, 0], [0, 2], atol=1e-12)
    angle = np.radians(45)
    np.testing.assert_allclose(body.rotations([1.0])[0][:2, 0], [np.cos(angle), np.sin(angle)], atol=1e-9)
    np.testing.assert_allclose(body.angular_rates([1.0])[0], [0, 0, np.pi / 2], atol=1e-9)
    assert scene.trajectory is not None
    assert scene.trajectory.duration_s == 1.5  # the camera is at rest
    with variant(SCALAR) as (mi, _):
        first, ball = load_scene_source(scene.source(), mi).shapes()
        assert first.id() == "moving_0"
        np.testing.assert_allclose(np.array(first.bbox().max), [2, 1, 0.5], atol=1e-6)
        assert ball.bbox().max.x == 5.5


def test_an_animated_sensor_is_the_cameras_path(tmp_path: Path) -> None:
    keys = [(t, LOOKING.format(x, x)) for t, x in ((0, 0), (0.2, 1), (0.4, 0))]
    scene, notes = loaded(scene_file(tmp_path, SENSOR.format(moving(*keys)), BALL.format(""), LIGHT))
    assert notes == ["times of its animations are taken as seconds: 0 to 0.4 s"]
    still, _ = loaded(scene_file(tmp_path, SENSOR.format(AT.replace("to_world", "toWorld")), BALL.format("")))
    assert scene.trajectory is not None
    assert still.start is not None
    np.testing.assert_allclose(scene.path.positions([0, 0.1, 0.2, 0.4])[:, 0], [0, 0.5, 1, 0], atol=1e-6)
    np.testing.assert_allclose(scene.path.rotations([0.1])[0], still.start.rotation, atol=1e-6)
    np.testing.assert_array_equal(scene.path.breaks_s(), [0.2])


def test_the_motion_of_other_sensors_is_told(tmp_path: Path) -> None:
    animation = moving(*((t, LOOKING.format(x, x)) for t, x in ((0, 0), (0.2, 1))))
    other = SENSOR.format(animation).replace("<sensor ", '<sensor id="other" ')
    scene, (line,) = loaded(scene_file(tmp_path, SENSOR.format(AT), other, BALL.format("")))
    assert "the motion of sensor 'other' is left out: the camera is the first sensor" in line
    assert scene.trajectory is None


def test_moving_shapes_make_events(tmp_path: Path) -> None:
    lamp = (
        '<emitter type="point"><point name="position" x="0" y="2" z="4"/><rgb name="intensity" value="20"/></emitter>'
    )
    ball = BALL.format(moving((0, ""), (0.1, '<translate x="0.5"/>')))
    scene, _ = loaded(scene_file(tmp_path, '<integrator type="direct"/>', SENSOR.format(AT), ball, lamp))
    assert sum(len(packet.events) for packet in davis_rs.simulate(scene, duration_s=0.1)) > 50


def test_what_cannot_move_is_told(tmp_path: Path) -> None:
    """Lights, shapes within groups, and sizes that change."""
    lamp = '<emitter type="point">{}</emitter>'.format(moving((0, ""), (1, '<translate x="1"/>')))
    growing = BALL.format(moving((0, ""), (1, '<scale value="2"/><translate x="1"/>')))
    scene, (line,) = loaded(scene_file(tmp_path, lamp, growing))
    assert "the motion of an emitter is left out: it stays where it is at first" in line
    assert "a shape changes its size by up to 1 of it, which is left out" in line
    assert list(scene.objects) == ["ball"]


@pytest.mark.parametrize(
    ("animation", "message"),
    [
        (moving((0, ""), (0, '<translate x="1"/>')), "times must increase"),
        (moving((-1, ""), (0, '<translate x="1"/>')), "times must increase, from 0 s or later"),
        (moving((0, ""), (float("nan"), "")), "times must increase"),
        (moving((0, ""), (1e7, "")), "1e\\+06 s at most"),
        ('<animation name="toWorld"/>', "an animation must have transforms"),
        ('<animation name="toWorld"><transform/></animation>', "must have a time"),
        (moving((0, ""), (1, '<scale value="0"/>')), "scales a shape to nothing"),
        (moving((0, ""), (1, '<translate x="inf"/>')), "finite"),
        (moving((0, ""), (1, "<shear/>")), "shear"),
    ],
)  # fmt: skip
def test_animations_that_are_none_are_refused(tmp_path: Path, animation: str, message: str) -> None:
    path = scene_file(tmp_path, BALL.format(animation))
    with pytest.raises(DecodeError, match=rf"(?s)scene.xml \(line 2\).*{message}"):
        davis_rs.load_scene(path)


def test_entities_are_not_expanded(tmp_path: Path) -> None:
    letters = "abcdefghi"
    larger = [f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise(letters)]
    lines = ['<!DOCTYPE scene [<!ENTITY a "aaaaaaaaaa">', *larger, "]>"]
    path = scene_file(tmp_path, BALL.format('<string name="material" value="&i;"/>'))
    path.write_text("\n".join(lines) + path.read_text())
    with pytest.raises(DecodeError, match="declares the entity 'a', which is not read"):
        davis_rs.load_scene(path)
    path.write_text('<!DOCTYPE scene [<!ENTITY a SYSTEM "/etc/hostname">]>' + scene_file(tmp_path, "&a;").read_text())
    with pytest.raises(DecodeError, match="declares the entity 'a'"):
        davis_rs.load_scene(path)


def test_elements_are_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a small file, and of one that is included many times."""
    monkeypatch.setenv(VARIABLE, "bytes=1MiB")
    path = scene_file(tmp_path, "<a/>" * 2000)
    with pytest.raises(DecodeError, match="its elements needs"):
        read_scene_file(XmlFile(path, {}))
    scene_file(tmp_path, "<a/>" * 100, name="part.xml")
    for number in range(12):
        inner = "part" if number == 0 else f"part{number - 1}"
        scene_file(tmp_path, f'<include filename="{inner}.xml"/>' * 2, name=f"part{number}.xml")
    with pytest.raises(DecodeError, match="may be held in memory"):
        read_scene_file(XmlFile(tmp_path / "part11.xml", {}))


def test_included_files_do_not_nest_without_end(tmp_path: Path) -> None:
    """Each is shallow enough alone."""
    deep = "<bsdf>" * 30 + '<include filename="{}.xml"/>' + "</bsdf>" * 30
    for number in range(5):
        scene_file(tmp_path, deep.format(f"part{number + 1}"), name=f"part{number}.xml")
    scene_file(tmp_path, name="part5.xml")
    with pytest.raises(DecodeError, match="nested 100 deep"):
        read_scene_file(XmlFile(tmp_path / "part0.xml", {}))


def test_each_file_is_parsed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one that needs repairs; Mitsuba never reads the file itself."""
    path = scene_file(tmp_path, '<integrator type="bdpt"/>', BALL.format('<float name="shine" value="1"/>'))
    parsed = []
    with variant(davis_rs._mitsuba.variants.default_variant()[0]) as (mi, _):
        parse = mi.parser.parse_string
        monkeypatch.setattr(mi.parser, "parse_string", lambda *given, **more: parsed.append(1) or parse(*given, **more))
        monkeypatch.setattr(mi, "load_file", None)
        _, notes = loaded(path)
    assert len(parsed) == 1
    assert len(notes) == 1
