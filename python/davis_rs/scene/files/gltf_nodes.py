"""Reads the nodes of a glTF file: their transforms, and how animations move them.

Source: Khronos Group, glTF 2.0 Specification, sections 3.5 (scenes), 3.11 (animations) and appendix C (interpolation).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ...geometry.pose import FloatArray, hamilton, rotation_matrices
from ...geometry.trajectory.trajectory import CallableTrajectory, Trajectory
from .gltf_file import GltfFile, Item, plain
from .rounding import ROUNDING

DEEPEST = 100
"""How deep nodes may be nested."""

_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
_REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
_RIGID = 1e-4
"""A node is not a rigid body if the length of its axes changes by more than this."""
_STILL = 1e-12
_UNIT = 0.01
"""By how much a quaternion's length may differ from 1: four numbers of 8 bits."""
_KEYFRAME_BYTES = 200
"""About what a keyframe takes besides its own numbers."""
_COPY_BYTES = 300
"""About what the transform of a copy takes."""
_CHECKED = 4
"""Instants per keyframe at which a body is checked for being rigid, and its orientation is noted."""
_CHECKED_BYTES = 150
"""About what such an instant takes."""
_AT_ONCE = 1 << 14
"""How many instants are checked at a time."""
_INSTANCING = "EXT_mesh_gpu_instancing"


class NotRigid(DecodeError):
    """Raised for a node whose animation scales or shears it."""


@dataclass(frozen=True)
class Node:
    """A node of the scene: its number, that of its parent, and what the file says of it."""

    index: int
    parent: int | None
    item: Item
    name: str


class Track(NamedTuple):
    """The keyframes of one property of a node: times (k,) in seconds, values (k, width), tangents (k, width) or None.

    ``kind`` is LINEAR, STEP or CUBICSPLINE; ``turns`` says that the values are rotations.
    """

    times: FloatArray
    values: FloatArray
    tangents: tuple[FloatArray, FloatArray] | None
    kind: str
    turns: bool = False

    def at(self, t: FloatArray, end_s: float) -> tuple[FloatArray, FloatArray]:
        """Return values and rates (n, width) at times (n,); ``end_s`` is the end of the whole scene."""
        times, values = self.times, self.values
        if len(times) == 1:
            return np.repeat(values, len(t), 0), np.zeros((len(t), values.shape[1]))
        # At a keyframe the segment after it counts; at the very end the one before it.
        segment = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        held = (t < times[0]) | (t > times[-1]) | ((t == times[-1]) & (times[-1] < end_s))
        span = times[segment + 1] - times[segment]
        fraction = np.clip((t - times[segment]) / span, 0.0, 1.0)[:, None]
        first, second = values[segment], values[segment + 1]
        if self.kind == "STEP":
            result = np.where(fraction >= 1, second, first)
            rate = np.zeros_like(result)
        elif self.kind == "CUBICSPLINE":
            result, rate = self._cubic(segment, span[:, None], fraction)
        elif self.turns:
            result, rate = _slerp(first, second, fraction, span[:, None])
        else:
            result = first + fraction * (second - first)
            rate = (second - first) / span[:, None]
        return result, np.where(held[:, None], 0.0, rate)

    def _cubic(self, segment: npt.NDArray[np.intp], span: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        assert self.tangents is not None
        incoming, outgoing = self.tangents
        first, second = self.values[segment], self.values[segment + 1]
        start, end = span * outgoing[segment], span * incoming[segment + 1]
        result = (2 * s**3 - 3 * s**2 + 1) * first + (s**3 - 2 * s**2 + s) * start
        result = result + (3 * s**2 - 2 * s**3) * second + (s**3 - s**2) * end
        rate = (6 * s**2 - 6 * s) * (first - second) + (3 * s**2 - 4 * s + 1) * start + (3 * s**2 - 2 * s) * end
        return result, rate / span

    @property
    def moves(self) -> bool:
        """Whether the value changes."""
        tangents = () if self.tangents is None else self.tangents
        return bool((np.abs(self.values - self.values[0]) > _STILL).any()) or any(tangent.any() for tangent in tangents)

    @property
    def corners(self) -> FloatArray:
        """The times at which the value is not smooth."""
        if self.kind != "CUBICSPLINE" or self.tangents is None:
            return self.times
        incoming, outgoing = self.tangents
        smooth = np.abs(incoming - outgoing).max(1) <= 1e-6 * (1 + np.abs(outgoing).max(1))
        smooth[[0, -1]] = False
        return self.times[~smooth]


def _slerp(
    first: FloatArray, second: FloatArray, fraction: FloatArray, span: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the interpolation along the shorter arc between unit quaternions, and its rate."""
    dot = (first * second).sum(1, keepdims=True)
    second, dot = np.where(dot < 0, -second, second), np.abs(dot)
    angle = np.arccos(np.minimum(dot, 1.0))
    sine = np.where(angle > 1e-6, np.sin(angle), 1.0)
    near = angle <= 1e-6
    a = np.where(near, 1 - fraction, np.sin((1 - fraction) * angle) / sine)
    b = np.where(near, fraction, np.sin(fraction * angle) / sine)
    da = np.where(near, -1.0, -angle * np.cos((1 - fraction) * angle) / sine) / span
    db = np.where(near, 1.0, angle * np.cos(fraction * angle) / sine) / span
    return a * first + b * second, da * first + db * second


@dataclass(frozen=True)
class NodeTree:
    """The nodes of a file's scene, parents before children, and what moves them.

    Attributes:
        tracks: by node and property; the strengths of morph targets are ``weights``.
        duration_s: time of the last keyframe in the scene; 0 where nothing moves.
        lost: by kind, the names of what animations change and the scene does not show.
    """

    file: GltfFile
    nodes: dict[int, Node]
    tracks: dict[int, dict[str, Track]]
    duration_s: float
    lost: dict[str, dict[str, None]]

    @classmethod
    def of(cls, file: GltfFile) -> NodeTree:
        """Read the nodes of the file's default scene.

        Raises:
            DecodeError: naming the part of the file that breaks a rule.
        """
        nodes = {node.index: node for node in _walk(file)}
        lost: dict[str, dict[str, None]] = {}
        tracks = _tracks(file, nodes, lost)
        for path in tracks.values():
            for name in [name for name, track in path.items() if not track.moves and len(track.times) > 1]:
                path[name] = path[name]._replace(
                    times=path[name].times[:1], values=path[name].values[:1], tangents=None, kind="LINEAR"
                )
        ends = [track.times[-1] for path in tracks.values() for track in path.values() if len(track.times) > 1]
        return cls(file, nodes, tracks, float(max(ends, default=0.0)), lost)

    def chain(self, index: int) -> list[Node]:
        """Return a node and its ancestors, the outermost first."""
        chain, node = [], self.nodes[index]
        while True:
            chain.append(node)
            if node.parent is None:
                return chain[::-1]
            node = self.nodes[node.parent]

    def moves(self, index: int) -> bool:
        """Return whether an animation moves a node or one of its ancestors."""
        return any(len(track.times) > 1 for track in self.tracks_of(index))

    def tracks_of(self, index: int) -> list[Track]:
        """Return the tracks that place a node: its own, and those of its ancestors."""
        tracks = (self.tracks.get(node.index, {}) for node in self.chain(index))
        return [track for path in tracks for name, track in path.items() if name in _WIDTHS]

    def strengths(self, index: int, rest: FloatArray) -> Track:
        """Return the track of the strengths of a node's morph targets; always ``rest`` (T,) where they do not move.

        Raises:
            DecodeError: for a track of another number of strengths.
        """
        track = self.tracks.get(index, {}).get("weights")
        if track is None or not (np.abs(track.values) > ROUNDING).any():
            return Track(np.zeros(1), rest[None], None, "LINEAR")
        count = len(rest)
        if track.values.size != count * len(track.times):
            animated = track.values.size // len(track.times)
            raise self.file.error(f"nodes[{index}]", f"animates {animated} morph targets, and its mesh has {count}")
        return track

    def matrices(self, index: int, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the node's transform to the scene's axes (n, 4, 4) at times (n,), and its rate."""
        matrix, rate = np.tile(np.eye(4), (len(t), 1, 1)), np.zeros((len(t), 4, 4))
        for node in self.chain(index):
            local, local_rate = self._local(node, t)
            matrix, rate = matrix @ local, rate @ local + matrix @ local_rate
        return matrix, rate

    def matrices_of(self, indices: list[int], t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return :meth:`matrices` of several nodes (n, k, 4, 4); what they have in common is computed once."""
        known: dict[int | None, tuple[FloatArray, FloatArray]] = {
            None: (np.tile(np.eye(4), (len(t), 1, 1)), np.zeros((len(t), 4, 4)))
        }
        for index in indices:
            for node in self.chain(index):
                if node.index not in known:
                    (matrix, rate), (local, local_rate) = known[node.parent], self._local(node, t)
                    known[node.index] = matrix @ local, rate @ local + matrix @ local_rate
        matrices, rates = zip(*(known[index] for index in indices), strict=True)
        return np.stack(matrices, 1), np.stack(rates, 1)

    def instances(self, index: int) -> FloatArray:
        """Return the transforms (n, 4, 4) of the copies within a node (EXT_mesh_gpu_instancing); one identity
        without."""
        given = (self.nodes[index].item.extensions or {}).get(_INSTANCING)
        if given is None:
            return np.eye(4)[None]
        where = f"nodes[{index}]: {_INSTANCING}"
        accessors = given.get("attributes") if isinstance(given, dict) else None
        if not isinstance(accessors, dict) or not accessors:
            raise self.file.error(where, f"must have attributes, got {plain(given)}")
        read = {
            name: self.file.array(accessors[name.upper()], where, width=(width,)).astype(np.float64)
            for name, width in _WIDTHS.items()
            if name.upper() in accessors
        }
        counts = sorted({len(values) for values in read.values()}) or [1]  # none: at the node, with marks of their own
        if len(counts) > 1:
            raise self.file.error(where, f"must have as many of each attribute, got {' and '.join(map(str, counts))}")
        self.file.budget.take(_COPY_BYTES * counts[0], f"{where}: {counts[0]} copies")
        every = {name: read.get(name, np.tile(_REST[name], (counts[0], 1))) for name in _WIDTHS}
        return _composed(every["translation"], _unit(self.file, every["rotation"], where), every["scale"])

    def path(
        self, index: int, to_world: FloatArray, flip: FloatArray, duration_s: float
    ) -> tuple[Trajectory, FloatArray]:
        """Return a node's motion as a trajectory, and the stretch (3, 3) of its own axes that comes before it.

        Args:
            to_world: (4, 4), from the scene's axes.
            flip: (3,), signs of the body's axes in those of the node.
            duration_s: of the trajectory, > 0.

        Raises:
            NotRigid: for a node that is not a rigid body, because its animation scales it.
        """
        self.file.budget.check_time("reading its animations")
        start, _ = self.matrices(index, np.zeros(1))
        linear = (to_world @ start[0])[:3, :3]
        left, lengths, right = np.linalg.svd(linear)
        name = self.nodes[index].name
        if lengths[-1] <= 1e-9 * lengths[0] or lengths[0] == 0:
            rule = "moves, and its scale is 0 at first: it can be no rigid body"
            raise NotRigid(str(self.file.error(f"node {name}", rule)))
        if np.linalg.det(left @ right) < 0:
            left = left * [1, 1, -1]  # a mirror image belongs to the body
        stretch = (left @ right).T @ linear
        unstretched = np.eye(4)
        unstretched[:3, :3] = np.linalg.inv(stretch)

        def rigid(t: FloatArray) -> tuple[FloatArray, FloatArray]:
            matrix, rate = self.matrices(index, t)
            return to_world @ matrix @ unstretched, to_world @ rate @ unstretched

        tracks = self.tracks_of(index)
        times = _within([track.times for track in tracks], duration_s)
        self.file.budget.take(_CHECKED_BYTES * _CHECKED * len(times), f"the path of node {name}")
        times = np.concatenate([[0.0], times, [duration_s]])
        grid = np.unique(np.linspace(times[:-1], times[1:], _CHECKED + 1))
        reference = np.empty((len(grid), 4))
        for begin in range(0, len(grid), _AT_ONCE):
            piece = slice(begin, begin + _AT_ONCE)
            axes = rigid(grid[piece])[0][:, :3, :3]
            off = np.abs(np.swapaxes(axes, 1, 2) @ axes - np.eye(3)).max((1, 2))
            if off.max() > _RIGID:
                worst = float(grid[piece][off.argmax()])
                rule = f"its animation scales or shears it (at {worst:g} s): only rigid bodies may move"
                raise NotRigid(str(self.file.error(f"node {name}", rule)))
            reference[piece] = _quaternions(axes * flip)
        reference = _continuous(reference)
        signs = np.diag(flip)

        def quaternion(t: FloatArray) -> FloatArray:
            result = _quaternions(rigid(t)[0][:, :3, :3] * flip)
            near = reference[np.clip(np.searchsorted(grid, t, side="right") - 1, 0, len(grid) - 1)]
            return np.where((result * near).sum(1, keepdims=True) < 0, -result, result)

        def angular_rate(t: FloatArray) -> FloatArray:
            matrix, rate = rigid(t)
            turning = np.swapaxes(matrix[:, :3, :3], 1, 2) @ rate[:, :3, :3]
            skew = signs @ (turning - np.swapaxes(turning, 1, 2)) @ signs / 2
            return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], 1)

        corners = breaks(tracks, duration_s)
        trajectory = CallableTrajectory(
            duration_s,
            position=lambda t: rigid(t)[0][:, :3, 3],
            velocity=lambda t: rigid(t)[1][:, :3, 3],
            quaternion=quaternion,
            angular_rate=angular_rate,
            breaks_s=corners,
            description={"path": "of an animation", "file": self.file.path.name, "node": name},
        )
        return trajectory, stretch

    def _local(self, node: Node, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        tracks, item, where = self.tracks.get(node.index, {}), node.item, f"nodes[{node.index}]"
        if not tracks and item.matrix is not None:
            matrix = self.file.numbers(item.matrix, f"{where}.matrix", 16).reshape(4, 4).T
            if np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-6:
                raise self.file.error(f"{where}.matrix", "must be an affine transform")
            return np.tile(matrix, (len(t), 1, 1)), np.zeros((len(t), 4, 4))
        result: dict[str, tuple[FloatArray, FloatArray]] = {}
        for name, width in _WIDTHS.items():
            if name in tracks:
                result[name] = tracks[name].at(t, self.duration_s)
                continue
            given = getattr(item, name)
            rest = np.array(_REST[name]) if given is None else self.file.numbers(given, f"{where}.{name}", width)
            if name == "rotation":
                rest = _unit(self.file, rest[None], f"{where}.rotation")[0]
            result[name] = np.tile(rest, (len(t), 1)), np.zeros((len(t), width))
        quaternion, turning = result["rotation"]
        length = np.linalg.norm(quaternion, axis=1, keepdims=True)
        if not (length > 1e-6).all():
            raise self.file.error(f"{where}.rotation", "an animation takes it through 0: it has no direction there")
        unit = quaternion / length
        turning = (turning - unit * (unit * turning).sum(1, keepdims=True)) / length
        spin = rotation_matrices(unit) @ _skew(2 * hamilton(unit * [-1, -1, -1, 1], turning)[:, :3])
        (translation, speed), (scale, growing) = result["translation"], result["scale"]
        change = np.zeros((len(t), 4, 4))
        change[:, :3, :3] = spin * scale[:, None] + rotation_matrices(unit) * growing[:, None]
        change[:, :3, 3] = speed
        return _composed(translation, unit, scale), change


def _walk(file: GltfFile) -> Iterator[Node]:
    """Yield the nodes of the default scene, parents first."""
    document = file.document
    every = document.nodes or []
    if document.scenes:
        scene = file.item("scenes", 0 if document.scene is None else document.scene, "scene")
        roots = scene.nodes or []
    else:
        children = {child for node in every for child in node.children or [] if isinstance(child, int)}
        roots = [index for index in range(len(every)) if index not in children]
    seen: set[int] = set()
    waiting: list[tuple[int, int | None, int]] = [(root, None, 0) for root in reversed(roots)]
    while waiting:
        index, parent, depth = waiting.pop()
        node = file.item("nodes", index, "scenes" if parent is None else f"nodes[{parent}].children")
        if index in seen:
            raise file.error(f"nodes[{index}]", "is within itself, or within two nodes")
        if depth > DEEPEST:
            raise file.error(f"nodes[{index}]", f"nodes may be {DEEPEST} within each other")
        seen.add(index)
        if (node.extensions or {}).get("KHR_node_visibility") == {"visible": False}:
            continue  # and all that is within it
        name = plain(node.name)[1:-1] if isinstance(node.name, str) and node.name else f"node_{index}"
        yield Node(index, parent, node, name)
        waiting += [(child, index, depth + 1) for child in reversed(node.children or [])]


def _tracks(file: GltfFile, nodes: dict[int, Node], lost: dict[str, dict[str, None]]) -> dict[int, dict[str, Track]]:
    tracks: dict[int, dict[str, Track]] = {}
    for number, animation in enumerate(file.document.animations or []):
        where = f"animations[{number}]"
        samplers = animation.samplers or []
        for channel in animation.channels or []:
            if channel.target is None:
                continue
            node, path = _target(channel.target)
            if path not in (*_WIDTHS, "weights"):
                if path.startswith(("/nodes/", "/meshes/", "/cameras/")):
                    raise file.error(where, f"animates {plain(path)}, which is not read")
                lost.setdefault("the animation", {})[plain(path)] = None
            if path not in (*_WIDTHS, "weights") or node not in nodes:
                continue
            which = file.whole(channel.sampler, f"{where}.channels", "of its samplers", len(samplers) - 1)
            if path in tracks.setdefault(node, {}):
                lost.setdefault("a second animation", {})[nodes[node].name] = None
                continue
            if nodes[node].item.matrix is not None and path != "weights":
                raise file.error(f"nodes[{node}]", "is animated, so it must have no matrix")
            tracks[node][path] = _track(file, samplers[which], f"{where}.samplers[{which}]", path)
    return tracks


def _target(target: Item) -> tuple[int | None, str]:
    """Return the node and the property that a channel animates; None and the pointer for anything else."""
    given = (target.extensions or {}).get("KHR_animation_pointer")
    if target.path != "pointer" or not isinstance(given, dict):
        return target.node, str(target.path)
    pointer = str(given.get("pointer"))
    match = re.fullmatch(r"/nodes/(\d{1,9})/(translation|rotation|scale|weights)", pointer)
    return (int(match[1]), match[2]) if match else (None, pointer)


def _track(file: GltfFile, sampler: Item, where: str, path: str) -> Track:
    times = np.asarray(file.array(sampler.input, f"{where}.input", width=(1,)).ravel(), np.float64)
    width = _WIDTHS.get(path, 1)
    values = np.asarray(file.array(sampler.output, f"{where}.output", width=(width,)), np.float64)
    file.budget.take(_KEYFRAME_BYTES * len(times), f"{where}: {len(times)} keyframes")
    kind = sampler.interpolation or "LINEAR"
    if kind not in ("LINEAR", "STEP", "CUBICSPLINE"):
        raise file.error(f"{where}.interpolation", f"must be LINEAR, STEP or CUBICSPLINE, got {plain(kind)}")
    if len(times) == 0 or times[0] < 0 or not (np.diff(times) > 0).all() or times[-1] > 1e6:
        raise file.error(f"{where}.input", "times must increase, from 0 s or later to 1e6 s at most")
    each = 3 if kind == "CUBICSPLINE" else 1
    if path == "weights" and len(values) % (each * len(times)) == 0:
        width = len(values) // (each * len(times))  # all strengths of a keyframe follow each other
        values = values.reshape(-1, width)
    if len(values) != each * len(times):
        raise file.error(f"{where}.output", f"must have {each * len(times)} values for its times, got {len(values)}")
    tangents = None
    if each == 3:
        incoming, values, outgoing = values.reshape(len(times), 3, width).swapaxes(0, 1)
        tangents = (incoming, outgoing)
    if path == "rotation":
        unit = _unit(file, values, f"{where}.output")
        values = unit if each == 1 else values
    return Track(times, values, tangents, kind, path == "rotation")


def _unit(file: GltfFile, quaternions: FloatArray, where: str) -> FloatArray:
    """Normalise quaternions (n, 4) that have length 1 but for rounding; refuse others."""
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    wrong = np.abs(length - 1) > _UNIT
    if wrong.any():
        result = quaternions[int(wrong.argmax())].tolist()
        raise file.error(where, f"rotations must be unit quaternions, got {plain(result)}")
    return quaternions / length


def _composed(translation: FloatArray, rotation: FloatArray, scale: FloatArray) -> FloatArray:
    """Compose transforms (n, 4, 4) of translations (n, 3), unit quaternions (n, 4) and scales (n, 3)."""
    matrix = np.tile(np.eye(4), (len(translation), 1, 1))
    matrix[:, :3, :3] = rotation_matrices(rotation) * scale[:, None]
    matrix[:, :3, 3] = translation
    return matrix


def breaks(tracks: list[Track], duration_s: float) -> FloatArray:
    """Return the times within a duration at which some track is not smooth, each once, in order."""
    return _within([track.corners for track in tracks if len(track.times) > 1], duration_s)


def _within(times: list[FloatArray], end_s: float) -> FloatArray:
    """Return all times between 0 and the end, each once, in order."""
    every = np.unique(np.concatenate([np.empty(0), *times]))
    return every[(every > 0) & (every < end_s)]


def _quaternions(rotations: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    result: FloatArray = Rotation.from_matrix(rotations).as_quat()
    return result


def _continuous(quaternions: FloatArray) -> FloatArray:
    """Choose the signs of quaternions so that neighbours are close."""
    dots = (quaternions[1:] * quaternions[:-1]).sum(1)
    return quaternions * np.concatenate([[1.0], np.cumprod(np.where(dots < 0, -1.0, 1.0))])[:, None]


def _skew(vector: FloatArray) -> FloatArray:
    x, y, z = vector.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], 1).reshape(-1, 3, 3)
