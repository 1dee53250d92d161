"""Loads XML files that name plug-ins which this Mitsuba does not have, where these do not say how the scene looks.

Research code has integrators, films and samplers of its own, and its scenes name them. A renderer of this package takes
their place. Older versions of Mitsuba had properties of shapes that this one does not read. What they write in another
way is in ``former_notation``, their textures, materials and lights are in ``former_textures``, ``former_materials`` and
``former_lights``, and what moves is in ``animated_transforms``.
All else that is unknown, such as another material, is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from .added_lights import add_lights
from .animated_transforms import Motion, take_motions
from .bright_reflectances import dim_reflectances
from .elements import Element, written
from .files import SceneFile, XmlFile, read_scene_file
from .foreign_meshes import meshes_rewritten
from .former_lights import translate_lights
from .former_materials import translate
from .former_notation import rewrite
from .former_textures import take_factor, translate_textures
from .grey_materials import GreyMaterial, make_grey
from .lost_normals import flatten_lost_normals
from .null_surfaces import drop_null_surfaces
from .plugins import is_usable
from .types import Mitsuba, MitsubaObject, MitsubaScene

_MODE = "mode"
"""An element of other programs that says how they render."""
_ELEMENTS = ("spectrum", "transform")
"""Elements of Mitsuba that may stand in a scene without a type or an id."""
_MORE_NEXT_TO_LIGHT = ("aov", "moment")
"""Integrators that write more than light, such as depth. Kinds of these differ between versions."""
_FOR_DERIVATIVES = "which has the same light, for a renderer that needs no derivatives"
_SAME_LIGHT = {
    "ptracer": "which has the same light with less noise",  # it follows paths from lights
    **dict.fromkeys(("prb", "prb_basic", "prb_projective", "prbvolpath", "direct_projective"), _FOR_DERIVATIVES),
}
"""Integrators that do not say what a single ray sees, and why others take their places. Light is baked for these."""
_DIRECT = "direct_projective"
"""The one of them that has no light that bounces."""
_CAMERAS = ("perspective", "thinlens", "orthographic")
_OF_FILM = {"width", "height", "crop_width", "crop_height", "crop_offset_x", "crop_offset_y"}


class LoadedFile(NamedTuple):
    """A scene of an XML file.

    Attributes:
        scene: as Mitsuba loads it.
        motions: of its shapes and its sensors.
        grey: materials that are not known.
        notes: one line for each thing that is taken otherwise than the file says.
    """

    scene: MitsubaScene
    motions: list[Motion]
    grey: list[GreyMaterial]
    notes: list[str]


def load_file(file: XmlFile, mi: Mitsuba) -> LoadedFile:
    """Load an XML file, without what Mitsuba would refuse although it does not say how the scene looks.

    Args:
        mi: the module, under the variant in force.

    Raises:
        OSError, DecodeError: as for :func:`~davis_rs._mitsuba.files.read_scene_file`.
        RuntimeError: if Mitsuba refuses the scene.
    """
    read = read_scene_file(file)
    notes: list[str] = []
    rewrite(read, notes)
    _drop_settings(read.root, notes)
    _unwrap_integrators(read, notes)
    _drop_meters(read.root, notes)
    drop_null_surfaces(read, notes)
    flatten_lost_normals(read, notes)
    motions = take_motions(read, mi, notes)
    translate_textures(read, notes)
    translate(read, notes)
    dim_reflectances(read, notes)
    translate_lights(read, notes)
    add_lights(read.root, file.lights)
    grey = make_grey(read, mi, notes) if file.grey_unknown else []
    config = mi.parser.ParserConfig(mi.variant())
    config.merge_equivalent = config.merge_meshes = False
    config.unused_properties = mi.LogLevel.Trace  # they are looked at below
    places: list[str] = []
    try:
        with meshes_rewritten(read, notes) as meshes, _files_next_to(file, mi):
            text, places = written(read.root)
            # Mitsuba refuses variables that it does not find; those in names of such files are no longer there.
            gone = [name for name in file.variables if any(f"${name}" in each for each in read.including + meshes)]
            variables = {
                name: value for name, value in file.variables.items() if name not in gone or f"${name}" in text
            }
            state = mi.parser.parse_string(config, text, **variables)
            mi.parser.transform_all(config, state)
            light = "volpath" if any(node.type == mi.ObjectType.Medium for node in state.nodes) else "path"
            for node in state.nodes:
                _replace(node, light, mi, notes)
                take_factor(node, mi)
            scene = mi.parser.instantiate(config, state)
    except RuntimeError as error:
        placed = re.sub(r"string \(line (\d+), col \d+\)", lambda at: places[int(at[1]) - 1], str(error))
        raise RuntimeError(placed) from None
    for node in state.nodes:
        if (unread := node.props.unqueried()) and node.type not in _without_looks(mi):
            what = f"{', '.join(unread)} of a {node.props.plugin_name()}"
            if node.type not in (mi.ObjectType.Shape, mi.ObjectType.Sensor):
                raise RuntimeError(f"it has {what}, which this Mitsuba does not read, and which says how it looks")
            notes.append(f"{what} is left out, because this Mitsuba does not read it")
    return LoadedFile(scene, motions, grey, list(dict.fromkeys(notes)))


def _drop_settings(root: Element, notes: list[str]) -> None:
    """Leave out elements of other programs that hold nothing but values: objects of a scene have a type."""
    kept: list[Element] = []
    for child in root.children:
        values = all(each.attributes.keys() == {"name", "value"} and not each.children for each in child.children)
        mode = child.tag == _MODE and not child.children
        if not mode and (child.tag in _ELEMENTS or child.attributes or not child.children or not values):
            kept.append(child)
        else:
            notes.append(f"its settings {child.tag[:40]!r}, which are none of Mitsuba's, are left out")
    root.children = kept


def _unwrap_integrators(file: SceneFile, notes: list[str]) -> None:
    """Put the integrator whose light is seen in the place of one that writes more next to it."""
    for number, element in enumerate(file.root.children):
        while element.tag == "integrator" and (
            inside := [each for each in element.children if each.tag == element.tag]
        ):
            kind, light = element.attributes.get("type", ""), inside[0]
            if kind not in _MORE_NEXT_TO_LIGHT:
                own = file.with_values(light.attributes.get("type", ""))
                notes.append(f"its integrator {kind[:40]!r} is replaced by {own[:40]!r}, which is in it")
            file.root.children[number] = element = light


def _drop_meters(root: Element, notes: list[str]) -> None:
    """Leave out sensors that are no cameras; the scene looks the same without them."""
    for element in root.walk():
        kept: list[Element] = []
        for child in element.children:
            kind = child.attributes.get("type", "")
            if child.tag == "sensor" and kind not in _CAMERAS:
                notes.append(f"its sensor {kind[:40]!r}, which is no camera of this Mitsuba, is left out")
            else:
                kept.append(child)
        element.children = kept


def _without_looks(mi: Mitsuba) -> dict[object, tuple[str, set[str]]]:
    """Return, for each type of object that does not say what a scene looks like, a plug-in and what it keeps."""
    types = mi.ObjectType
    return {
        types.Integrator: ("path", {"max_depth", "rr_depth", "hide_emitters"}),
        types.Film: ("hdrfilm", _OF_FILM),
        types.Sampler: ("independent", set()),
        types.ReconstructionFilter: ("box", set()),
    }


def _replace(node: MitsubaObject, light: str, mi: Mitsuba, notes: list[str]) -> None:
    """Put a plug-in that is there in the place of one that does not say what the scene looks like.

    Args:
        light: the integrator that takes the place of others.
    """
    if node.type not in _without_looks(mi):
        return
    plugin, kept = _without_looks(mi)[node.type]
    if node.type == mi.ObjectType.Integrator:
        name = node.props.plugin_name()
        plugin, kept = ("direct", {"hide_emitters"}) if name == _DIRECT else (light, kept)
        if name in _SAME_LIGHT:
            notes.append(f"its integrator {name!r} is replaced by {plugin!r}, {_SAME_LIGHT[name]}")
        elif is_usable(name, node.type, mi):
            return
        else:
            notes.append(f"its integrator {name!r}, which this Mitsuba cannot use, is replaced by {plugin!r}")
    for key in set(node.props.keys()) - kept:
        del node.props[key]
    node.props.set_plugin_name(plugin)


@contextmanager
def _files_next_to(file: XmlFile, mi: Mitsuba) -> Iterator[None]:
    """Look for the files that a scene names next to its own, as ``mi.load_file`` does."""
    before = mi.file_resolver()
    resolver = mi.FileResolver(before)
    resolver.prepend(str(file.path.parent))
    mi.set_file_resolver(resolver)
    try:
        yield
    finally:
        mi.set_file_resolver(before)
