"""Computes where animations take the nodes of a glTF file.

Source: Khronos Group, glTF 2.0 Specification, section 3.11 (animations) and appendix C (interpolation).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...geometry.pose import FloatArray, hamilton, rotation_matrices
from ..keyframes import Track
from ..repairs import Repairs
from .gltf_file import GltfFile, Item, plain

WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
"""How many numbers each property has that places a node."""
REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
"""Their values where a file gives none."""

_UNIT = 0.01
"""By how much a quaternion's length may differ from 1 unsaid: four numbers of 8 bits."""
_SHORTEST = 1e-6
"""A quaternion that is not longer than this has no direction."""
_SHEAR = 1e-3
"""By how much the axes of a matrix may differ from those of a body: numbers with few digits."""
_KEPT = 4
"""For so many sets of instants, poses are kept, because several objects ask for the same."""
_MOST_KEPT = 1 << 17
"""No set is kept that has more poses than this, with 256 bytes each."""
_TOGETHER = 1 << 12
"""So many poses at most are computed for all nodes that move when some are asked for, because others will be asked for
at the same few instants. At many instants, each object asks at its own keyframes, and gets its own poses alone."""

Poses = tuple[FloatArray, FloatArray]
"""Transforms (n, ..., 4, 4) at n times, and their rates per second."""


@dataclass(frozen=True)
class Node:
    """A node of the scene: its number, that of its parent, and what the file says of it."""

    index: int
    parent: int | None
    item: Item
    name: str


class _Animated(NamedTuple):
    """Holds what is animated of some nodes.

    Attributes:
        indices: of those that are animated, k.
        given: (k, width) for each property, what the file gives where it is not animated.
        tracks: each with its property and the numbers of its nodes, whose values it has side by side.
    """

    indices: list[int]
    given: dict[str, FloatArray]
    tracks: list[tuple[str, list[int], Track]]


class NodePoses:
    """Computes the transforms of nodes to the scene's axes, those of all nodes together.

    Tracks with the same keyframes, as exporters write them for all bones of a skeleton, are interpolated together.

    Args:
        nodes: of the scene, parents before children.
        moving: those that an animation moves, in the same order.
        tracks: by node and property.
        duration_s: the end of the whole scene.
        repairs: gets what is mended.
    """

    def __init__(
        self,
        file: GltfFile,
        nodes: Mapping[int, Node],
        moving: Sequence[Node],
        tracks: Mapping[int, Mapping[str, Track]],
        duration_s: float,
        repairs: Repairs,
    ) -> None:
        self._file, self._nodes, self._tracks, self._duration_s = file, nodes, tracks, duration_s
        self._repairs = repairs
        self._moving = {node.index: node for node in moving}
        self._still: dict[int | None, FloatArray] = {None: np.eye(4)}
        self._local: dict[int, FloatArray] = {}
        self._animations: dict[tuple[int, ...], _Animated] = {}
        self._kept: tuple[tuple[FloatArray, dict[int, Poses]], ...] = ()

    def of(self, indices: Sequence[int], t: FloatArray) -> Poses:
        """Return transforms (n, k, 4, 4) of k nodes at times (n,), and their rates."""
        moving = [index for index in indices if index in self._moving]
        poses = self._poses(moving, t) if moving else {}
        matrices, rates = np.empty((len(t), len(indices), 4, 4)), np.zeros((len(t), len(indices), 4, 4))
        for number, index in enumerate(indices):
            if index in poses:
                matrices[:, number], rates[:, number] = poses[index]
            else:
                matrices[:, number] = self._at_rest(index)
        return matrices, rates

    def _poses(self, indices: Sequence[int], t: FloatArray) -> dict[int, Poses]:
        """Return the poses of nodes that move, and of those that they are in."""
        for times, poses in self._kept:
            if np.array_equal(times, t) and all(index in poses for index in indices):
                return poses
        together = len(t) * len(self._moving) <= _TOGETHER
        nodes = list(self._moving.values()) if together else self._with_parents(indices)
        poses = self._computed(nodes, t)
        if len(t) * len(nodes) > _MOST_KEPT:
            return poses
        self._kept = ((t.copy(), poses), *self._kept[: _KEPT - 1])
        return poses

    def _with_parents(self, indices: Sequence[int]) -> list[Node]:
        wanted: set[int] = set()
        for index in indices:
            at: int | None = index
            while at in self._moving and at not in wanted:
                wanted.add(at)
                at = self._moving[at].parent
        return [node for index, node in self._moving.items() if index in wanted]

    def _computed(self, nodes: Sequence[Node], t: FloatArray) -> dict[int, Poses]:
        local = self._animated(nodes, t)
        poses: dict[int, Poses] = {}
        for node in nodes:
            at_rest = node.parent not in self._moving
            if at_rest:
                around, turning = self._at_rest(node.parent), np.zeros((1, 4, 4))
            else:
                assert node.parent is not None
                around, turning = poses[node.parent]
            if node.index in local:
                matrix, rate = local[node.index]
                poses[node.index] = around @ matrix, around @ rate if at_rest else turning @ matrix + around @ rate
            else:
                matrix = self._local_at_rest(node)
                poses[node.index] = around @ matrix, turning @ matrix
        return poses

    def _prepared(self, nodes: Sequence[Node]) -> _Animated:
        """Return what is animated of some nodes, gathered once for all instants."""
        known = tuple(node.index for node in nodes)
        if known not in self._animations:
            tracks = {index: self._tracks.get(index, {}) for index in known}
            animated = [node for node in nodes if any(name in WIDTHS for name in tracks[node.index])]
            together: dict[tuple[str, str, bytes], list[int]] = {}
            given = {name: np.empty((len(animated), width)) for name, width in WIDTHS.items()}
            for number, node in enumerate(animated):
                for name in WIDTHS:
                    if name in tracks[node.index]:
                        track = tracks[node.index][name]
                        together.setdefault((name, track.kind, track.times.tobytes()), []).append(number)
                    else:
                        given[name][number] = self._given(node, name)
            alike = [
                (name, numbers, _joined([tracks[animated[number].index][name] for number in numbers]))
                for (name, _, _), numbers in together.items()
            ]
            self._animations[known] = _Animated([node.index for node in animated], given, alike)
        return self._animations[known]

    def _animated(self, nodes: Sequence[Node], t: FloatArray) -> dict[int, Poses]:
        """Return the transforms of those nodes that are animated, within those that they are in."""
        animated = self._prepared(nodes)
        n, k = len(t), len(animated.indices)
        values = {name: np.tile(given, (n, 1, 1)) for name, given in animated.given.items()}
        rates = {name: np.zeros((n, k, width)) for name, width in WIDTHS.items()}
        for name, numbers, track in animated.tracks:
            values[name][:, numbers], rates[name][:, numbers] = track.at(t, self._duration_s)
        quaternion, turning = values["rotation"], rates["rotation"]
        length = np.linalg.norm(quaternion, axis=2, keepdims=True)
        if not (length > _SHORTEST).all():
            wrong = animated.indices[int(np.argmin(length.min((0, 2))))]
            rule = "an animation takes it through 0: it has no direction there"
            raise self._file.error(f"nodes[{wrong}].rotation", rule)
        unit = quaternion / length
        turning = (turning - unit * (unit * turning).sum(2, keepdims=True)) / length
        flat = unit.reshape(-1, 4)
        rotation = rotation_matrices(flat).reshape(n, k, 3, 3)
        spin = rotation @ _skew(2 * hamilton(flat * [-1, -1, -1, 1], turning.reshape(-1, 4))[:, :3]).reshape(n, k, 3, 3)
        scale = values["scale"][:, :, None]
        matrix, rate = np.tile(np.eye(4), (n, k, 1, 1)), np.zeros((n, k, 4, 4))
        matrix[..., :3, :3], matrix[..., :3, 3] = rotation * scale, values["translation"]
        rate[..., :3, :3] = spin * scale + rotation * rates["scale"][:, :, None]
        rate[..., :3, 3] = rates["translation"]
        return {index: (matrix[:, number], rate[:, number]) for number, index in enumerate(animated.indices)}

    def _at_rest(self, index: int | None) -> FloatArray:
        """Return the transform (4, 4) of a node that no animation moves; the identity for the scene itself."""
        chain = []
        while index not in self._still:
            assert index is not None
            chain.append(self._nodes[index])
            index = chain[-1].parent
        matrix = self._still[index]
        for node in reversed(chain):
            matrix = self._still[node.index] = matrix @ self._local_at_rest(node)
        return matrix

    def _local_at_rest(self, node: Node) -> FloatArray:
        if node.index not in self._local:
            self._local[node.index] = self._given_matrix(node)
        return self._local[node.index]

    def _given_matrix(self, node: Node) -> FloatArray:
        if node.item.matrix is None:
            given = [self._given(node, name)[None] for name in WIDTHS]
            return composed(*given)[0]
        return _matrix(self._file, node)

    def _given(self, node: Node, name: str) -> FloatArray:
        """Return what the file gives for a property of a node at rest: an animation's only value, or the node's."""
        track = self._tracks.get(node.index, {}).get(name)
        if track is not None:
            return track.values[0]
        given, where = getattr(node.item, name), f"nodes[{node.index}].{name}"
        rest = np.array(REST[name]) if given is None else self._file.numbers(given, where, WIDTHS[name])
        if name != "rotation":
            return rest
        if not rest.any():  # as viewers take it
            self._repairs.add("nodes whose rotation is a quaternion of length 0 are not turned", 1, where)
            return np.array(REST[name])
        return unit_quaternions(self._file, rest[None], where, self._repairs)[0]


def _joined(tracks: Sequence[Track]) -> Track:
    """Return tracks of the same kind and keyframes as one, whose values (times, k, width) lie side by side."""
    tangents = None
    if tracks[0].tangents is not None:
        both = [track.tangents for track in tracks if track.tangents is not None]
        tangents = np.stack([ends[0] for ends in both], 1), np.stack([ends[1] for ends in both], 1)
    return tracks[0]._replace(values=np.stack([track.values for track in tracks], 1), tangents=tangents)


def unit_quaternions(file: GltfFile, quaternions: FloatArray, where: str, repairs: Repairs) -> FloatArray:
    """Normalise quaternions (n, 4); tell of those whose length is not 1, and refuse those without a direction."""
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    wrong = ~((length > _SHORTEST) & np.isfinite(length))
    if wrong.any():
        result = quaternions[int(wrong.argmax())].tolist()
        raise file.error(where, f"rotations must be quaternions with a direction, got {plain(result)}")
    off = np.abs(length - 1)
    if (off > _UNIT).any():
        note = "rotations by quaternions whose length is not 1, which are scaled to it"
        repairs.add_off(note, int((off > _UNIT).sum()), where, float(off.max()))
    return quaternions / length


def _matrix(file: GltfFile, node: Node) -> FloatArray:
    """Return the matrix (4, 4) that a node has."""
    where = f"nodes[{node.index}].matrix"
    matrix = file.numbers(node.item.matrix, where, 16).reshape(4, 4).T
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-6:
        raise file.error(where, "must be an affine transform")
    return np.asarray(matrix)


def taken_apart(file: GltfFile, node: Node) -> Node:
    """Return a node that has a matrix with what that is made of: translation, rotation and scale.

    Raises:
        DecodeError: for a matrix that shears, or scales to nothing.
    """
    from scipy.spatial.transform import Rotation

    matrix = _matrix(file, node)
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) < 0:
        scale = -scale
    axes = matrix[:3, :3] / np.where(scale == 0, 1.0, scale)
    if np.abs(axes.T @ axes - np.eye(3)).max() > _SHEAR:
        rule = "is animated, so its matrix must be made of a translation, a rotation and a scale"
        raise file.error(f"nodes[{node.index}]", rule)
    parts = {"translation": matrix[:3, 3], "rotation": Rotation.from_matrix(axes).as_quat(), "scale": scale}
    item = Item({**node.item, "matrix": None, **{name: numbers.tolist() for name, numbers in parts.items()}})
    return replace(node, item=item)


def composed(translation: FloatArray, rotation: FloatArray, scale: FloatArray) -> FloatArray:
    """Compose transforms (n, 4, 4) of translations (n, 3), unit quaternions (n, 4) and scales (n, 3)."""
    matrix = np.tile(np.eye(4), (len(translation), 1, 1))
    matrix[:, :3, :3] = rotation_matrices(rotation) * scale[:, None]
    matrix[:, :3, 3] = translation
    return matrix


def _skew(vector: FloatArray) -> FloatArray:
    x, y, z = vector.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], 1).reshape(-1, 3, 3)
