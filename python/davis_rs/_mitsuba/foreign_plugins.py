"""Loads XML files that name plug-ins which this Mitsuba does not have, where these do not say how the scene looks.

Research code has integrators, films and samplers of its own, and its scenes name them. A renderer of this package takes
their place. Older versions of Mitsuba had properties of shapes that this one does not read, and wrote colours in other
ways; files from Windows have backslashes in names. All else that is unknown, such as a material, is still refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from .._util.srgb import from_srgb
from .files import XmlFile
from .types import Mitsuba, MitsubaObject, MitsubaScene

_MAY_HELP = re.compile(
    r"failed to instantiate (integrator|film|sampler|rfilter) plugin|unreferenced propert|not found|No such file"
    r"|<(lookAt|srgb)>|Invalid spectrum value|could not parse RGB value|Invalid filter type"
)
_COLOUR = re.compile(r"""<(rgb|srgb|spectrum)(\s[^<>]*?\bvalue\s*=\s*)(["'])([^"'<>]*)\3""")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
# Bounded, because a comment may repeat its beginning without end.
_FILE = re.compile(r"""(\bname\s*=\s*["']filename["'][^<>]{0,300}?\bvalue\s*=\s*)(["'])([^"'<>]*)\2""")
_OF_FILM = {"width", "height", "crop_width", "crop_height", "crop_offset_x", "crop_offset_y"}


def load_file(file: XmlFile, mi: Mitsuba, notes: list[str]) -> MitsubaScene:
    """Load an XML file; where Mitsuba refuses it for what does not say how the scene looks, without that.

    Args:
        file: that was checked.
        mi: the module, under the variant in force.
        notes: gets one line for each thing that is taken otherwise.

    Raises:
        RuntimeError: if Mitsuba refuses the scene.
    """
    try:
        return mi.load_file(str(file.path), optimize=False, **file.variables)
    except RuntimeError as error:
        if not _MAY_HELP.search(str(error)):
            raise
    config = mi.parser.ParserConfig(mi.variant())
    config.merge_equivalent = config.merge_meshes = False
    config.unused_properties = mi.LogLevel.Trace  # they are looked at below
    text = _as_written_now(file.path.read_text("utf-8", "replace"))
    try:
        with _files_next_to(file, mi):
            state = mi.parser.parse_string(config, text, **file.variables)
            mi.parser.transform_all(config, state)
            for node in state.nodes:
                _replace(node, mi, notes)
            scene = mi.parser.instantiate(config, state)
    except RuntimeError as error:
        raise RuntimeError(str(error).replace(" string (line", f" {file.path} (line")) from None
    for node in state.nodes:
        if (unread := node.props.unqueried()) and node.type not in _without_looks(mi):
            note = f"{', '.join(unread)} of a {node.props.plugin_name()}, which this Mitsuba does not read"
            if node.type not in (mi.ObjectType.Shape, mi.ObjectType.Sensor):
                raise RuntimeError(f"it has {note}, and which says how it looks")
            notes.append(note)
    return scene


def _as_written_now(text: str) -> str:
    """Return a scene file with what older versions of Mitsuba, and other systems, write in another way."""
    text = re.sub(r"(?<=<)(/?)lookAt\b", r"\1lookat", text)
    text = re.sub(r"""(["']filter(?:_t|T)ype["']\s+value\s*=\s*["'])(?:trilinear|ewa)(?=["'])""", r"\1bilinear", text)
    text = _COLOUR.sub(_rgb, text).replace("</srgb>", "</rgb>")
    return _FILE.sub(lambda one: one[0].replace("\\", "/"), text)


def _rgb(element: re.Match[str]) -> str:
    """Return a colour as linear red, green and blue, where it is one: three numbers, or a number of 6 digits.

    Before version 2 ``rgb`` was linear in both forms, ``srgb`` encoded, and ``spectrum`` could be three numbers.
    """
    name, before, quote, value = element.groups()
    if digits := re.fullmatch(r"\s*#([0-9a-fA-F]{6})\s*", value):
        colour = np.array(list(bytes.fromhex(digits[1]))) / 255.0
    else:
        words = value.replace(",", " ").split()
        if len(words) not in ((1, 3) if name == "srgb" else (3,)) or not all(map(_NUMBER.fullmatch, words)):
            return element[0]
        colour = np.array([*words] if len(words) == 3 else words * 3, np.float64)
    if name == "srgb":
        colour = from_srgb(colour)
    return f"<rgb{before}{quote}{', '.join(map(repr, colour.tolist()))}{quote}"


def _without_looks(mi: Mitsuba) -> dict[object, tuple[str, set[str]]]:
    """Return, for each type of object that does not say what a scene looks like, a plug-in and what it keeps."""
    types = mi.ObjectType
    return {
        types.Integrator: ("path", {"max_depth", "rr_depth", "hide_emitters"}),
        types.Film: ("hdrfilm", _OF_FILM),
        types.Sampler: ("independent", set()),
        types.ReconstructionFilter: ("box", set()),
    }


def _replace(node: MitsubaObject, mi: Mitsuba, notes: list[str]) -> None:
    """Put a plug-in that is there in the place of one that does not say what the scene looks like."""
    if node.type not in _without_looks(mi):
        return
    plugin, kept = _without_looks(mi)[node.type]
    if node.type == mi.ObjectType.Integrator:
        name = node.props.plugin_name()
        if _is_usable(name, mi):
            return
        notes.append(f"its integrator {name!r}, which this Mitsuba cannot use; {plugin!r} is in its place")
    for key in set(node.props.keys()) - kept:
        del node.props[key]
    node.props.set_plugin_name(plugin)


def _is_usable(plugin: str, mi: Mitsuba) -> bool:
    try:
        mi.load_dict({"type": plugin})
    except RuntimeError as error:
        return not re.search("not found!|polarized mode", str(error))
    return True


@contextmanager
def _files_next_to(file: XmlFile, mi: Mitsuba) -> Iterator[None]:
    """Look for the files that a scene names next to its own, as ``mi.load_file`` does."""
    before = mi.file_resolver()
    resolver = mi.FileResolver(before)
    resolver.append(str(file.path.parent))
    mi.set_file_resolver(resolver)
    try:
        yield
    finally:
        mi.set_file_resolver(before)
