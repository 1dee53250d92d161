"""Takes ``<animation>`` elements out of a scene: transforms at instants, which this Mitsuba does not read.

Mitsuba 0.5 and 0.6 have them: ``<animation name="toWorld"><transform time="0">...</transform>...</animation>``. In the
scene a shape keeps its size and shear at the first instant; the rest is a motion of a rigid body.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._core import DecodeError
from .elements import Element, Ids, with_values, written
from .files import SceneFile
from .types import Mitsuba

FloatArray = npt.NDArray[np.float64]

_LATEST_S = 1e6
_RIGID = 1e-3
"""By so much the axes of a body may change their lengths: rounding of a file's numbers."""


class Motion(NamedTuple):
    """A shape or a sensor that moves.

    Attributes:
        tag: ``shape`` or ``sensor``.
        id: of the shape or the sensor.
        times: (k,) of keyframes, seconds, increasing.
        poses: (k, 4, 4), T_world_object of a rigid body, or of a sensor as the file has it.
    """

    tag: str
    id: str
    times: FloatArray
    poses: FloatArray


def take_motions(file: SceneFile, mi: Mitsuba, notes: list[str]) -> list[Motion]:
    """Return what moves in a scene, and put a transform in the place of each ``<animation>``.

    Raises:
        DecodeError: for times that do not increase, or transforms that are none.
    """
    motions: list[Motion] = []
    ids = Ids(file.root)
    left: dict[str, None] = {}
    for owner, at, around in list(_animated(file.root, None)):
        animation = owner.children[at]
        times, matrices = _keyframes(animation, file.values, mi)
        name = animation.attributes.get("name", "")
        transform = animation.child("transform", name=name)
        transform.children = animation.children[0].children
        owner.children[at] = transform
        if len(times) == 1 or np.ptp(matrices, 0).max() == 0:
            continue
        if animation.name != "to_world" or owner.tag not in ("shape", "sensor") or around is not file.root:
            article = "an" if owner.tag[:1] in "aeiou" else "a"
            left[f"the motion of {article} {owner.tag} is left out: it stays where it is at first"] = None
            continue
        if owner.tag == "shape":
            matrices, stretch, off = _rigid(matrices, animation)
            transform.children = [_matrix(animation, stretch)]
            if off > _RIGID:
                left[f"a shape changes its size by up to {off:.2g} of it, which is left out"] = None
        motions.append(Motion(owner.tag, ids.of(owner, "moving"), times, matrices))
    if motions:
        ends = f"{min(each.times[0] for each in motions):g} to {max(each.times[-1] for each in motions):g} s"
        notes.append(f"times of its animations are taken as seconds: {ends}")
    notes += left
    return motions


def _animated(element: Element, around: Element | None) -> Iterator[tuple[Element, int, Element | None]]:
    """Yield for each animation the element that it moves, its number in that, and what this element is in."""
    for at, child in enumerate(element.children):
        if child.tag == "animation":
            yield element, at, around
        else:
            yield from _animated(child, element)


def _keyframes(animation: Element, values: Mapping[str, str], mi: Mitsuba) -> tuple[FloatArray, FloatArray]:
    """Return times (k,) and matrices (k, 4, 4) of an animation."""
    transforms = animation.children
    if not transforms or any(each.tag != "transform" for each in transforms):
        raise DecodeError(f"{animation.place}: an animation must have transforms")
    try:
        times = np.array([float(with_values(each.attributes.get("time", ""), values)) for each in transforms])
    except ValueError:
        raise DecodeError(f"{animation.place}: each transform of an animation must have a time, in seconds") from None
    if not ((np.diff(times) > 0).all() and times[0] >= 0 and times[-1] <= _LATEST_S):
        raise DecodeError(f"{animation.place}: times must increase, from 0 s or later to {_LATEST_S:g} s at most")
    scene = animation.child("scene", version="3.0.0")
    for number, transform in enumerate(transforms):
        one = animation.child("transform", name=f"at_{number}")
        one.children = [_valued(step, values) for step in transform.children]
        scene.children.append(one)
    text, _ = written(scene)
    try:
        (node,) = mi.parser.parse_string(mi.parser.ParserConfig(mi.variant()), text).nodes
    except RuntimeError as error:
        raise DecodeError(f"{animation.place}: {error}") from None
    matrices = np.stack([np.array(node.props[f"at_{k}"].matrix, np.float64) for k in range(len(times))])
    if not np.isfinite(matrices).all():
        raise DecodeError(f"{animation.place}: its transforms must be finite")
    return times, matrices.reshape(-1, 4, 4)


def _valued(step: Element, values: Mapping[str, str]) -> Element:
    attributes = {name: with_values(value, values) for name, value in step.attributes.items()}
    return Element(step.tag, attributes, step.file, step.line)


def _rigid(matrices: FloatArray, animation: Element) -> tuple[FloatArray, FloatArray, float]:
    """Return poses of a rigid body, its stretch (4, 4) at the first instant, which comes before them, and by how much
    other instants differ from that."""
    turns, stretches = _polar(matrices[:, :3, :3], animation)
    stretch = np.eye(4)
    stretch[:3, :3] = stretches[0]
    turns, changes = _polar(matrices[:, :3, :3] @ np.linalg.inv(stretches[0]), animation)
    poses = np.tile(np.eye(4), (len(matrices), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turns, matrices[:, :3, 3]
    return poses, stretch, float(np.abs(changes - np.eye(3)).max())


def _polar(linear: FloatArray, animation: Element) -> tuple[FloatArray, FloatArray]:
    """Return rotations (k, 3, 3), and what is left of linear maps before them; a mirror belongs to the body."""
    left, lengths, right = np.linalg.svd(linear)
    if (lengths[:, -1] <= 1e-9 * lengths[:, 0]).any():
        raise DecodeError(f"{animation.place}: scales a shape to nothing, so it is no body that moves")
    left[:, :, -1] *= np.sign(np.linalg.det(left @ right))[:, None]
    turns = left @ right
    return turns, np.swapaxes(turns, 1, 2) @ linear


def _matrix(beside: Element, matrix: FloatArray) -> Element:
    return beside.child("matrix", value=" ".join(map(repr, matrix.ravel().tolist())))
