"""Deforms meshes by joints and by morph targets, as characters are animated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..geometry.box import box_corners
from ..geometry.pose import FloatArray
from .deformation import AT_ONCE, Deformation, DeformedMesh, MovingPoints

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

OverTime = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""A function of times (n,) in seconds that gives values and their rates per second, (n, ...) each."""


@dataclass(frozen=True, eq=False)
class SkinnedMesh(Deformation):
    """Deforms a mesh by linear blend skinning, after its morph targets were added.

    A vertex is the mean, by its weights, of where its joints take it: p = sum of w_j M_j (rest + sum of m_k target_k).
    Normals follow the inverse transpose of the same mean of matrices.

    Source: Khronos Group, glTF 2.0 Specification, section 3.7.3 (skins) and 3.7.2.2 (morph targets).

    Args:
        rest: vertices (u, 3) without deformation, with normals (u, 3) or without.
        vertices: int (v,), the vertex of ``rest`` that each vertex of the shape is: those of triangles one after the
            other.
        joint_count: J, how many joints there are.
        joints: int (u, k), numbers of the joints of each vertex.
        weights: (u, k), their weights, >= 0 and with a sum of 1.
        matrices: transforms (n, J, 4, 4) of the joints, from the axes of ``rest``, and their rates, at times (n,).
        targets: (T, u, 3), displacements of the morph targets.
        target_normals: (T, u, 3), of the normals.
        strengths: of the morph targets (n, T), and their rates, at times (n,).
        most: (T,), no strength is larger in magnitude.
        duration_s: of the animation, > 0.
        breaks: times at which it is not smooth, seconds.
        name: what deforms, for records.
    """

    rest: DeformedMesh
    vertices: npt.NDArray[np.int64]
    joint_count: int
    joints: npt.NDArray[np.int64]
    weights: FloatArray
    matrices: OverTime
    targets: FloatArray
    target_normals: FloatArray
    strengths: OverTime
    most: FloatArray
    duration_s: float
    breaks: FloatArray
    name: str

    def meshes(self, t_s: FloatArray) -> Iterator[DeformedMesh]:
        """Yield the mesh at each of the times, see :meth:`Deformation.meshes`."""
        for (matrices, _), (strengths, _) in self._states(t_s):
            linear, offset = self._blended(matrices)
            positions = np.einsum("uij,uj->ui", linear, self._morphed(strengths)) + offset
            normals = None
            if self.rest.normals is not None:
                own = self.rest.normals + np.tensordot(strengths, self.target_normals, 1)
                # The cofactors are the inverse transpose times the determinant, which is negative in a mirror image.
                rows = [np.cross(linear[:, (i + 1) % 3], linear[:, (i + 2) % 3]) for i in range(3)]
                normals = np.einsum("uij,uj->ui", np.stack(rows, 1), own)
                sign = np.where(np.einsum("ui,ui->u", linear[:, 0], rows[0]) < 0, -1.0, 1.0)
                length = np.linalg.norm(normals, axis=1)
                normals *= np.divide(sign, length, out=np.zeros_like(length), where=length > 0)[:, None]
                normals = normals[self.vertices]
            yield DeformedMesh(positions[self.vertices], normals)

    def velocities(self, t_s: FloatArray) -> Iterator[FloatArray]:
        """Yield the vertices' velocities, see :meth:`Deformation.velocities`."""
        for (matrices, rates), (strengths, changes) in self._states(t_s):
            linear, _ = self._blended(matrices)
            turning, drift = self._blended(rates)
            by_joints = np.einsum("uij,uj->ui", turning, self._morphed(strengths)) + drift
            by_targets = np.einsum("uij,uj->ui", linear, np.tensordot(changes, self.targets, 1))
            yield (by_joints + by_targets)[self.vertices]

    def hull(self, t_s: FloatArray) -> FloatArray:
        """Return the corners of boxes around what each joint moves, see :meth:`Deformation.hull`."""
        matrices, _ = self.matrices(self._within(t_s))
        return self._moved(matrices)

    def fastest(self, t_s: FloatArray) -> FloatArray:
        """Return a bound on speed, see :meth:`Deformation.fastest`: that of the corners of the joints' boxes."""
        matrices, rates = self.matrices(self._within(t_s))
        speed = np.linalg.norm(self._moved(rates), axis=2).max(1)
        return np.asarray((speed + self._morphing(t_s, matrices)) * self.moves(t_s))

    def moving_points(self, t_s: FloatArray) -> Iterator[MovingPoints]:
        """Yield the corners of the joints' boxes, see :meth:`Deformation.moving_points`: a vertex is the mean of where
        its joints take it, each within its box; morph targets move it besides."""
        matrices, rates = self.matrices(self._within(t_s))
        corners, velocities = self._moved(matrices), self._moved(rates)
        of_instants = zip(corners, velocities, self._morphing(t_s, matrices), self.moves(t_s), strict=True)
        for positions, moving, morphing, moves in of_instants:
            yield MovingPoints(positions, moving * moves, float(morphing * moves))

    def breaks_s(self) -> FloatArray:
        """Return the times at which the animation is not smooth."""
        return self.breaks

    def describe(self) -> dict[str, object]:
        """Return what deforms."""
        return {"kind": "skin and morph targets", "name": self.name, "vertices": len(self.rest.positions)}

    def is_mirrored(self) -> bool:
        """Return whether most of the mesh is a mirror image at time 0, so that its triangles are turned over."""
        ((matrices, _), _), *_ = self._states(np.zeros(1))
        return bool(np.mean(np.linalg.det(self._blended(matrices)[0]) < 0) > 0.5)

    def turned(self) -> SkinnedMesh:
        """Return the same for a shape whose triangles have their corners in the opposite order."""
        return replace(self, vertices=self.vertices.reshape(-1, 3)[:, ::-1].ravel())

    def _states(self, t_s: FloatArray) -> Iterator[tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]]:
        for first in range(0, len(t_s), AT_ONCE):
            t = t_s[first : first + AT_ONCE]
            matrices, rates = self.matrices(self._within(t))
            strengths, changes = self.strengths(self._within(t))
            for i, moves in enumerate(self.moves(t)):
                yield (matrices[i], rates[i] * moves), (strengths[i], changes[i] * moves)

    def _within(self, t_s: FloatArray) -> FloatArray:
        return np.clip(t_s, 0.0, self.duration_s)

    def _morphed(self, strengths: FloatArray) -> FloatArray:
        return self.rest.positions + np.tensordot(strengths, self.targets, 1)

    def _blended(self, matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return each vertex's mean of matrices (J, 4, 4): linear part (u, 3, 3) and offset (u, 3)."""
        blended = np.asarray(self._mean @ matrices[:, :3].reshape(-1, 12)).reshape(-1, 3, 4)
        return blended[..., :3], blended[..., 3]

    @cached_property
    def _mean(self) -> csr_matrix:
        """The weights (u, J) as a sparse matrix."""
        from scipy.sparse import csr_matrix

        count, each = self.joints.shape
        starts = np.arange(0, count * each + 1, each)
        return csr_matrix((self.weights.ravel(), self.joints.ravel(), starts), shape=(count, self.joint_count))

    @cached_property
    def _boxes(self) -> tuple[npt.NDArray[np.int64], FloatArray]:
        """The joints that move anything, and the corners (j, 8, 3) of boxes around what each moves before it does."""
        around = np.tensordot(self.most, np.abs(self.targets), 1) if len(self.most) else 0.0
        low, high = self.rest.positions - around, self.rest.positions + around
        moved = self.weights > 0
        used = np.unique(self.joints[moved])
        of_joint = [((self.joints == joint) & moved).any(1) for joint in used]
        ends = np.stack([[low[rows].min(0) for rows in of_joint], [high[rows].max(0) for rows in of_joint]])
        return used, box_corners(ends)

    def _morphing(self, t_s: FloatArray, matrices: FloatArray) -> FloatArray:
        """Return a bound (n,) on the speed that morph targets give to a vertex, by the joints' matrices there."""
        if not len(self.most):
            return np.zeros(len(t_s))
        _, changes = self.strengths(self._within(t_s))
        stretch = np.linalg.norm(matrices[:, :, :3, :3], axis=(2, 3)).max(1)
        return np.asarray(stretch * (np.abs(changes) @ np.linalg.norm(self.targets, axis=2).max(1)))

    def _moved(self, matrices: FloatArray) -> FloatArray:
        """Return the corners of the boxes where matrices (n, J, 4, 4) take them, (n, k, 3); of rates, the velocities
        there."""
        used, corners = self._boxes
        own = matrices[:, used]
        moved = np.einsum("njab,jcb->njca", own[..., :3, :3], corners) + own[..., None, :3, 3]
        return moved.reshape(len(matrices), 8 * len(used), 3)
