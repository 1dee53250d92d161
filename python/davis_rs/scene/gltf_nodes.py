"""The nodes of a glTF file: where they are, and how animations move them.

Source: Khronos Group, glTF 2.0 Specification, sections 3.5 (scenes), 3.11 (animations) and appendix C (interpolation).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..pose import FloatArray, hamilton, rotation_matrices
from ..trajectory.trajectory import CallableTrajectory
from .gltf_file import GltfFile, plain

DEEPEST = 100
"""Nodes within nodes."""

_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
_REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
_RIGID = 1e-4
"""A body whose axes are longer or shorter than at first by more than this is no rigid one."""
_STILL = 1e-12


@dataclass(frozen=True)
class Node:
    """A node of the scene: its number, that of its parent, and what the file says of it."""

    index: int
    parent: int | None
    item: Any
    name: str


class Track(NamedTuple):
    """The keyframes of one property of a node: times (k,) in seconds, values (k, width), tangents (k, width) or None.

    ``kind`` is LINEAR, STEP or CUBICSPLINE.
    """

    times: FloatArray
    values: FloatArray
    tangents: tuple[FloatArray, FloatArray] | None
    kind: str

    def at(self, t: FloatArray, end_s: float) -> tuple[FloatArray, FloatArray]:
        """Values and rates (n, width) at times (n,); ``end_s`` is when everything ends."""
        times, values = self.times, self.values
        if len(times) == 1:
            return np.repeat(values, len(t), 0), np.zeros((len(t), values.shape[1]))
        # At a keyframe what holds from there on; at the very end what held until there.
        segment = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        held = (t < times[0]) | (t > times[-1]) | ((t == times[-1]) & (times[-1] < end_s))
        span = np.diff(times)[segment]
        share = np.clip((t - times[segment]) / span, 0.0, 1.0)[:, None]
        first, second = values[segment], values[segment + 1]
        if self.kind == "STEP":
            found = np.where(share >= 1, second, first)
            rate = np.zeros_like(found)
        elif self.kind == "CUBICSPLINE":
            found, rate = self._cubic(segment, span[:, None], share)
        elif values.shape[1] == 4:
            found, rate = _slerp(first, second, share, span[:, None])
        else:
            found = first + share * (second - first)
            rate = (second - first) / span[:, None]
        return found, np.where(held[:, None], 0.0, rate)

    def _cubic(self, segment: Any, span: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        assert self.tangents is not None
        incoming, outgoing = self.tangents
        first, second = self.values[segment], self.values[segment + 1]
        start, end = span * outgoing[segment], span * incoming[segment + 1]
        found = (2 * s**3 - 3 * s**2 + 1) * first + (s**3 - 2 * s**2 + s) * start
        found = found + (3 * s**2 - 2 * s**3) * second + (s**3 - s**2) * end
        rate = (6 * s**2 - 6 * s) * (first - second) + (3 * s**2 - 4 * s + 1) * start + (3 * s**2 - 2 * s) * end
        return found, rate / span

    @property
    def moves(self) -> bool:
        """Whether it is not the same all the time."""
        tangents = () if self.tangents is None else self.tangents
        return bool((np.abs(self.values - self.values[0]) > _STILL).any()) or any(one.any() for one in tangents)

    @property
    def corners(self) -> FloatArray:
        """The times at which it is not smooth."""
        if self.kind != "CUBICSPLINE" or self.tangents is None:
            return self.times
        incoming, outgoing = self.tangents
        smooth = np.abs(incoming - outgoing).max(1) <= 1e-6 * (1 + np.abs(outgoing).max(1))
        smooth[[0, -1]] = False
        return self.times[~smooth]


def _slerp(first: FloatArray, second: FloatArray, share: FloatArray, span: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the interpolation along the shorter arc between unit quaternions, and its rate."""
    dot = (first * second).sum(1, keepdims=True)
    second, dot = np.where(dot < 0, -second, second), np.abs(dot)
    angle = np.arccos(np.minimum(dot, 1.0))
    sine = np.where(angle > 1e-6, np.sin(angle), 1.0)
    near = angle <= 1e-6
    a = np.where(near, 1 - share, np.sin((1 - share) * angle) / sine)
    b = np.where(near, share, np.sin(share * angle) / sine)
    da = np.where(near, -1.0, -angle * np.cos((1 - share) * angle) / sine) / span
    db = np.where(near, 1.0, angle * np.cos(share * angle) / sine) / span
    return a * first + b * second, da * first + db * second


@dataclass(frozen=True)
class NodeTree:
    """The nodes of a file's scene, parents before children, and what moves them.

    Attributes:
        duration_s: until the last keyframe of whatever moves in the scene; 0 where nothing does.
        left_out: what of the animations is not taken, for a message.
    """

    file: GltfFile
    nodes: dict[int, Node]
    tracks: dict[int, dict[str, Track]]
    duration_s: float
    left_out: list[str]

    @classmethod
    def of(cls, file: GltfFile) -> NodeTree:
        """Return the nodes of the file's default scene.

        Raises:
            DecodeError: naming the place that breaks a rule.
        """
        nodes = {node.index: node for node in _walk(file)}
        left_out: list[str] = []
        tracks = _tracks(file, nodes, left_out)
        for path in tracks.values():
            for name in [name for name, track in path.items() if not track.moves and len(track.times) > 1]:
                path[name] = Track(path[name].times[:1], path[name].values[:1], None, "LINEAR")
        ends = [track.times[-1] for path in tracks.values() for track in path.values() if len(track.times) > 1]
        return cls(file, nodes, tracks, float(max(ends, default=0.0)), left_out)

    def chain(self, index: int) -> list[Node]:
        """A node and those that it is within, the outermost first."""
        found, at = [], self.nodes[index]
        while True:
            found.append(at)
            if at.parent is None:
                return found[::-1]
            at = self.nodes[at.parent]

    def moves(self, index: int) -> bool:
        """Whether an animation moves a node, or one that it is within."""
        return any(
            len(track.times) > 1 for node in self.chain(index) for track in self.tracks.get(node.index, {}).values()
        )

    def matrices(self, index: int, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The node's transform to the scene's axes (n, 4, 4) at times (n,), and its rate."""
        matrix, rate = np.tile(np.eye(4), (len(t), 1, 1)), np.zeros((len(t), 4, 4))
        for node in self.chain(index):
            local, local_rate = self._local(node, t)
            matrix, rate = matrix @ local, rate @ local + matrix @ local_rate
        return matrix, rate

    def path(self, index: int, to_world: FloatArray, flip: FloatArray, duration_s: float) -> tuple[Any, FloatArray]:
        """How a node moves, as a trajectory, and what its own axes are stretched by first (3, 3).

        Args:
            to_world: (4, 4), from the scene's axes.
            flip: (3,), signs of the body's axes in those of the node.
            duration_s: of the trajectory, > 0.

        Raises:
            DecodeError: for a node that is no rigid body, because its animation scales it.
        """
        start, _ = self.matrices(index, np.zeros(1))
        linear = (to_world @ start[0])[:3, :3]
        left, lengths, right = np.linalg.svd(linear)
        name = self.nodes[index].name
        if lengths[-1] <= 1e-9 * lengths[0] or lengths[0] == 0:
            raise self.file.error(f"node {name}", "moves, and its scale is 0 at first: it can be no rigid body")
        if np.linalg.det(left @ right) < 0:
            left = left * [1, 1, -1]  # a mirror image belongs to the body
        stretch = (left @ right).T @ linear
        unstretched = np.eye(4)
        unstretched[:3, :3] = np.linalg.inv(stretch)

        def rigid(t: FloatArray) -> tuple[FloatArray, FloatArray]:
            matrix, rate = self.matrices(index, t)
            return to_world @ matrix @ unstretched, to_world @ rate @ unstretched

        times = {0.0, duration_s} | {
            float(t)
            for node in self.chain(index)
            for track in self.tracks.get(node.index, {}).values()
            for t in track.times
            if 0 < t < duration_s
        }
        grid = np.unique(np.linspace(sorted(times)[:-1], sorted(times)[1:], 5))
        axes = rigid(grid)[0][:, :3, :3]
        off = np.abs(np.swapaxes(axes, 1, 2) @ axes - np.eye(3)).max((1, 2))
        if off.max() > _RIGID:
            worst = float(grid[off.argmax()])
            raise self.file.error(
                f"node {name}", f"its animation scales or shears it (at {worst:g} s): only rigid bodies may move"
            )
        reference = _continuous(_quaternions(axes * flip))
        signs = np.diag(flip)

        def quaternion(t: FloatArray) -> FloatArray:
            found = _quaternions(rigid(t)[0][:, :3, :3] * flip)
            near = reference[np.clip(np.searchsorted(grid, t, side="right") - 1, 0, len(grid) - 1)]
            return np.where((found * near).sum(1, keepdims=True) < 0, -found, found)

        def angular_rate(t: FloatArray) -> FloatArray:
            matrix, rate = rigid(t)
            turning = np.swapaxes(matrix[:, :3, :3], 1, 2) @ rate[:, :3, :3]
            skew = signs @ (turning - np.swapaxes(turning, 1, 2)) @ signs / 2
            return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], 1)

        corners = {
            float(t)
            for node in self.chain(index)
            for track in self.tracks.get(node.index, {}).values()
            if len(track.times) > 1
            for t in track.corners
            if 0 < t < duration_s
        }
        trajectory = CallableTrajectory(
            duration_s,
            position=lambda t: rigid(t)[0][:, :3, 3],
            velocity=lambda t: rigid(t)[1][:, :3, 3],
            quaternion=quaternion,
            angular_rate=angular_rate,
            breaks_s=sorted(corners),
            description={"path": "of an animation", "file": self.file.path.name, "node": name},
        )
        return trajectory, stretch

    def _local(self, node: Node, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        tracks, item, place = self.tracks.get(node.index, {}), node.item, f"nodes[{node.index}]"
        if not tracks and item.matrix is not None:
            matrix = self.file.numbers(item.matrix, f"{place}.matrix", 16).reshape(4, 4).T
            if np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-6:
                raise self.file.error(f"{place}.matrix", "must be an affine transform")
            return np.tile(matrix, (len(t), 1, 1)), np.zeros((len(t), 4, 4))
        found: dict[str, tuple[FloatArray, FloatArray]] = {}
        for name, width in _WIDTHS.items():
            if name in tracks:
                found[name] = tracks[name].at(t, self.duration_s)
                continue
            given = getattr(item, name)
            rest = np.array(_REST[name]) if given is None else self.file.numbers(given, f"{place}.{name}", width)
            found[name] = np.tile(rest, (len(t), 1)), np.zeros((len(t), width))
        quaternion, turning = found["rotation"]
        length = np.linalg.norm(quaternion, axis=1, keepdims=True)
        if not (length > 1e-6).all():
            raise self.file.error(f"{place}.rotation", "must be a unit quaternion")
        unit = quaternion / length
        turning = (turning - unit * (unit * turning).sum(1, keepdims=True)) / length
        rotation = rotation_matrices(unit)
        rate = 2 * hamilton(unit * [-1, -1, -1, 1], turning)[:, :3]
        spin = rotation @ _skew(rate)
        scale, growing = found["scale"]
        matrix, change = np.tile(np.eye(4), (len(t), 1, 1)), np.zeros((len(t), 4, 4))
        matrix[:, :3, :3] = rotation * scale[:, None]
        change[:, :3, :3] = spin * scale[:, None] + rotation * growing[:, None]
        matrix[:, :3, 3], change[:, :3, 3] = found["translation"]
        return matrix, change


def _walk(file: GltfFile) -> Iterator[Node]:
    """The nodes of the default scene, parents first."""
    document = file.document
    every = document.nodes or []
    if document.scenes:
        scene = file.item("scenes", 0 if document.scene is None else document.scene, "scene")
        roots = scene.nodes or []
    else:
        children = {child for node in every for child in node.children or [] if isinstance(child, int)}
        roots = [index for index in range(len(every)) if index not in children]
    seen: set[int] = set()
    waiting: list[tuple[Any, int | None, int]] = [(root, None, 0) for root in reversed(roots)]
    while waiting:
        index, parent, depth = waiting.pop()
        node = file.item("nodes", index, "scenes" if parent is None else f"nodes[{parent}].children")
        if index in seen:
            raise file.error(f"nodes[{index}]", "is within itself, or within two nodes")
        if depth > DEEPEST:
            raise file.error(f"nodes[{index}]", f"nodes may be {DEEPEST} within each other")
        seen.add(index)
        name = plain(node.name)[1:-1] if isinstance(node.name, str) and node.name else f"node_{index}"
        yield Node(index, parent, node, name)
        waiting += [(child, index, depth + 1) for child in reversed(node.children or [])]


def _tracks(file: GltfFile, nodes: dict[int, Node], left_out: list[str]) -> dict[int, dict[str, Track]]:
    tracks: dict[int, dict[str, Track]] = {}
    for number, animation in enumerate(file.document.animations or []):
        place = f"animations[{number}]"
        samplers = animation.samplers or []
        for channel in animation.channels or []:
            if channel.target is None or channel.target.node not in nodes:
                continue
            node, path = channel.target.node, channel.target.path
            if path == "weights":
                raise file.error(
                    place, f"moves the shape of node {nodes[node].name} (morph targets), which is not read"
                )
            if path not in _WIDTHS:
                left_out.append(f"the animation of {plain(path)}")
                continue
            if path in tracks.setdefault(node, {}):
                left_out.append(f"a second animation of node {nodes[node].name}")
                continue
            if nodes[node].item.matrix is not None:
                raise file.error(f"nodes[{node}]", "is animated, so it must have no matrix")
            which = file.whole(channel.sampler, f"{place}.channels", "of its samplers", len(samplers) - 1)
            tracks[node][path] = _track(file, samplers[which], f"{place}.samplers[{which}]", _WIDTHS[path])
    return tracks


def _track(file: GltfFile, sampler: Any, place: str, width: int) -> Track:
    times = file.array(sampler.input, f"{place}.input", width=(1,)).ravel().astype(np.float64)
    values = file.array(sampler.output, f"{place}.output", width=(width,)).astype(np.float64)
    kind = sampler.interpolation or "LINEAR"
    if kind not in ("LINEAR", "STEP", "CUBICSPLINE"):
        raise file.error(f"{place}.interpolation", f"must be LINEAR, STEP or CUBICSPLINE, got {plain(kind)}")
    if len(times) == 0 or times[0] < 0 or not (np.diff(times) > 0).all() or times[-1] > 1e6:
        raise file.error(f"{place}.input", "times must increase, from 0 s or later to 1e6 s at most")
    each = 3 if kind == "CUBICSPLINE" else 1
    if len(values) != each * len(times):
        raise file.error(f"{place}.output", f"must have {each * len(times)} values for its times, got {len(values)}")
    tangents = None
    if each == 3:
        incoming, values, outgoing = values.reshape(len(times), 3, width).swapaxes(0, 1)
        tangents = (incoming, outgoing)
    if width == 4:
        length = np.linalg.norm(values, axis=1, keepdims=True)
        if not (length > 1e-6).all():
            raise file.error(f"{place}.output", "rotations must be unit quaternions")
        if each == 1:
            values = values / length
    return Track(times, values, tangents, kind)


def _quaternions(rotations: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    found: FloatArray = Rotation.from_matrix(rotations).as_quat()
    return found


def _continuous(quaternions: FloatArray) -> FloatArray:
    """Return the quaternions with signs such that no neighbours are far apart."""
    dots = (quaternions[1:] * quaternions[:-1]).sum(1)
    return quaternions * np.concatenate([[1.0], np.cumprod(np.where(dots < 0, -1.0, 1.0))])[:, None]


def _skew(vector: FloatArray) -> FloatArray:
    x, y, z = vector.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], 1).reshape(-1, 3, 3)
