"""Reads the nodes of a glTF file, and the animations that move them.

Source: Khronos Group, glTF 2.0 Specification, sections 3.5 (scenes) and 3.11 (animations).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.argument_error import ArgumentError
from ...geometry.pose import FloatArray
from ...geometry.trajectory.trajectory import CallableTrajectory, Trajectory
from ..keyframes import Track
from ..repairs import Repairs
from .gltf_file import GltfFile, Item, plain
from .gltf_poses import REST, WIDTHS, Node, NodePoses, composed, taken_apart, unit_quaternions
from .rounding import ROUNDING

DEEPEST = 100
"""How deep nodes may be nested."""

_LATEST_S = 1e6
"""Times of keyframes are no farther from 0."""
_RIGID = 1e-4
"""A node is not a rigid body if the length of its axes changes by more than this."""
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
class NodeTree:
    """The nodes of a file's scene, parents before children, and what moves them.

    Attributes:
        tracks: by node and property; the strengths of morph targets are ``weights``.
        duration_s: time of the last keyframe in the scene; 0 where nothing moves.
        lost: by kind, the names of what animations change and the scene does not show.
        repairs: of its rotations.
        played: the names of the animations that are played.
        others: the names of those that are not.
    """

    file: GltfFile
    nodes: dict[int, Node]
    tracks: dict[int, dict[str, Track]]
    duration_s: float
    lost: dict[str, dict[str, None]]
    repairs: Repairs
    played: tuple[str, ...]
    others: tuple[str, ...]

    @classmethod
    def of(cls, file: GltfFile, repairs: Repairs, animation: str | None = None) -> NodeTree:
        """Read the nodes of the file's default scene.

        Args:
            repairs: gets what is mended.
            animation: the name of the one that is played, ``animation_1`` for the second without a name. None: all of
                them together, or where two move the same node, the first.

        Raises:
            DecodeError: naming the part of the file that breaks a rule.
            ValueError: for an animation that the file does not have, with those that it has.
        """
        nodes = {node.index: node for node in _walk(file)}
        lost: dict[str, dict[str, None]] = {}
        played, others = _played(file, nodes, animation)
        tracks = _tracks(file, nodes, played, lost, repairs)
        for path in tracks.values():
            for name in [name for name, track in path.items() if not track.moves and len(track.times) > 1]:
                path[name] = path[name]._replace(
                    times=path[name].times[:1], values=path[name].values[:1], tangents=None, kind="LINEAR"
                )
        ends = [track.times[-1] for path in tracks.values() for track in path.values() if len(track.times) > 1]
        return cls(file, nodes, tracks, float(max(ends, default=0.0)), lost, repairs, tuple(played), others)

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
        return [track for path in tracks for name, track in path.items() if name in WIDTHS]

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
        matrices, rates = self.matrices_of([index], t)
        return matrices[:, 0], rates[:, 0]

    def matrices_of(self, indices: list[int], t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return :meth:`matrices` of several nodes (n, k, 4, 4); what they have in common is computed once."""
        return self._poses.of(indices, t)

    @cached_property
    def _poses(self) -> NodePoses:
        moving = [node for node in self.nodes.values() if self.moves(node.index)]
        return NodePoses(self.file, self.nodes, moving, self.tracks, self.duration_s, self.repairs)

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
            for name, width in WIDTHS.items()
            if name.upper() in accessors
        }
        counts = sorted({len(values) for values in read.values()}) or [1]  # none: at the node, with marks of their own
        if len(counts) > 1:
            raise self.file.error(where, f"must have as many of each attribute, got {' and '.join(map(str, counts))}")
        self.file.budget.take(_COPY_BYTES * counts[0], f"{where}: {counts[0]} copies")
        every = {name: read.get(name, np.tile(REST[name], (counts[0], 1))) for name in WIDTHS}
        turns = unit_quaternions(self.file, every["rotation"], where, self.repairs)
        return composed(every["translation"], turns, every["scale"])

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


def _played(
    file: GltfFile, nodes: dict[int, Node], wanted: str | None
) -> tuple[dict[str, tuple[str, Item]], tuple[str, ...]]:
    """Return the animations that are played, each with its place in the file, and the names of the others."""
    every: dict[str, tuple[str, Item]] = {}
    for number, animation in enumerate(file.document.animations or []):
        name = plain(animation.name)[1:-1] if isinstance(animation.name, str) and animation.name else ""
        if not name or name in every:
            name = f"animation_{number}"
        every[name] = f"animations[{number}]", animation
    if wanted is not None:
        if wanted not in every:
            raise ArgumentError(
                "{animation} must be one of those of {}: {}, got {!r}",
                file.path.name,
                ", ".join(every) or "none",
                wanted,
            )
        return {wanted: every[wanted]}, tuple(name for name in every if name != wanted)
    moved: set[tuple[int, str]] = set()
    for _, animation in every.values():
        targets = [_target(channel.target) for channel in animation.channels or [] if channel.target is not None]
        own = {(node, path) for node, path in targets if node in nodes}
        if own & moved:
            first, *others = every
            return {first: every[first]}, tuple(others)
        moved |= own
    return every, ()


def _tracks(
    file: GltfFile,
    nodes: dict[int, Node],
    played: dict[str, tuple[str, Item]],
    lost: dict[str, dict[str, None]],
    repairs: Repairs,
) -> dict[int, dict[str, Track]]:
    tracks: dict[int, dict[str, Track]] = {}
    for where, animation in played.values():
        samplers = animation.samplers or []
        for channel in animation.channels or []:
            if channel.target is None:
                continue
            node, path = _target(channel.target)
            if path not in (*WIDTHS, "weights"):
                lost.setdefault("the animation", {})[plain(path)] = None
            if path not in (*WIDTHS, "weights") or node not in nodes:
                continue
            which = file.whole(channel.sampler, f"{where}.channels", "of its samplers", len(samplers) - 1)
            if path in tracks.setdefault(node, {}):
                lost.setdefault("a second animation", {})[nodes[node].name] = None
                continue
            if nodes[node].item.matrix is not None and path != "weights":
                nodes[node] = taken_apart(file, nodes[node])
                note = "nodes that are animated and have a matrix, which glTF does not allow: it is taken apart"
                repairs.add(note, 1, f"nodes[{node}]")
            tracks[node][path] = _track(file, samplers[which], f"{where}.samplers[{which}]", path, repairs)
    return tracks


def _target(target: Item) -> tuple[int | None, str]:
    """Return the node and the property that a channel animates; None and the pointer for anything else."""
    given = (target.extensions or {}).get("KHR_animation_pointer")
    if target.path != "pointer" or not isinstance(given, dict):
        return target.node, str(target.path)
    pointer = str(given.get("pointer"))
    match = re.fullmatch(r"/nodes/(\d{1,9})/(translation|rotation|scale|weights)", pointer)
    return (int(match[1]), match[2]) if match else (None, pointer)


def _track(file: GltfFile, sampler: Item, where: str, path: str, repairs: Repairs) -> Track:
    times = np.asarray(file.array(sampler.input, f"{where}.input", width=(1,)).ravel(), np.float64)
    width = WIDTHS.get(path, 1)
    values = np.asarray(file.array(sampler.output, f"{where}.output", width=(width,)), np.float64)
    file.budget.take(_KEYFRAME_BYTES * len(times), f"{where}: {len(times)} keyframes")
    kind = sampler.interpolation or "LINEAR"
    if kind not in ("LINEAR", "STEP", "CUBICSPLINE"):
        raise file.error(f"{where}.interpolation", f"must be LINEAR, STEP or CUBICSPLINE, got {plain(kind)}")
    if len(times) == 0 or not (np.diff(times) >= 0).all() or times[0] < -_LATEST_S or times[-1] > _LATEST_S:
        raise file.error(f"{where}.input", f"times must increase, from {-_LATEST_S:g} s at least to {_LATEST_S:g} s")
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
        unit = unit_quaternions(file, values, f"{where}.output", repairs)
        values = unit if each == 1 else values
    played = _played_keyframes(times, where, repairs)
    if tangents is not None:
        tangents = (tangents[0][played], tangents[1][played])
    return Track(times[played], values[played], tangents, kind, path == "rotation")


def _played_keyframes(times: FloatArray, where: str, repairs: Repairs) -> npt.NDArray[np.intp]:
    """Return the numbers of the keyframes that count. An animation begins at 0 s, as viewers play it: of those before
    only the last is needed. Of several at one time the last is taken."""
    last = np.append(np.diff(times) > 0, True)
    repairs.add("keyframes at the time of the next one, which are left out", int((~last).sum()), where)
    repairs.add("keyframes before 0 s, where the animation begins", int((times < 0).sum()), where)
    kept = np.flatnonzero(last)
    return kept[max(np.searchsorted(times[kept], 0.0, side="right") - 1, 0) :]


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
