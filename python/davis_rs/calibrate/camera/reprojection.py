"""Projects points of a board into the image, with derivatives by the points' places and by small motions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...geometry.camera import Camera

FloatArray = npt.NDArray[np.float64]


def projection_jacobian(camera: Camera, points: FloatArray) -> FloatArray:
    """Return d(pixel)/d(point), (..., 2, 3), of :meth:`Camera.project` at points (..., 3) in camera axes."""
    x, y, z = np.moveaxis(points, -1, 0)
    zero = np.zeros_like(z)
    ray = np.stack([np.stack([1 / z, zero, -x / z**2], -1), np.stack([zero, 1 / z, -y / z**2], -1)], -2)
    return np.asarray(camera.distortion_jacobian(points[..., :2] / z[..., None]) @ ray)


def cross_matrix(v: npt.ArrayLike) -> FloatArray:
    """Return [v]x, (..., 3, 3), with [v]x w = v x w, of vectors (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(v, np.float64), -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def rotation_of(vectors: npt.ArrayLike) -> FloatArray:
    """Exp: rotation matrices (..., 3, 3) of rotation vectors (..., 3), radians."""
    from scipy.spatial.transform import Rotation

    v = np.asarray(vectors, np.float64)
    return np.asarray(Rotation.from_rotvec(v.reshape(-1, 3)).as_matrix()).reshape(*v.shape, 3)


def vector_of(rotations: npt.ArrayLike) -> FloatArray:
    """Log: rotation vectors (..., 3), radians, of rotation matrices (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    r = np.asarray(rotations, np.float64)
    return np.asarray(Rotation.from_matrix(r.reshape(-1, 3, 3)).as_rotvec()).reshape(r.shape[:-1])


def transform(rotation: npt.ArrayLike, translation: npt.ArrayLike) -> FloatArray:
    """Return rigid transforms (..., 4, 4) of rotations (..., 3, 3) and translations (..., 3)."""
    r, t = np.asarray(rotation, np.float64), np.asarray(translation, np.float64)
    matrix = np.zeros((*r.shape[:-2], 4, 4))
    matrix[..., :3, :3], matrix[..., :3, 3], matrix[..., 3, 3] = r, t, 1.0
    return matrix


def inverse(transforms: FloatArray) -> FloatArray:
    """Return inverses of rigid transforms (..., 4, 4)."""
    turned = np.swapaxes(transforms[..., :3, :3], -1, -2)
    return transform(turned, -(turned @ transforms[..., :3, 3:])[..., 0])


def moved(pose: FloatArray, motion: FloatArray) -> FloatArray:
    """Return a transform (4, 4) times the small one of a rotation vector and a translation, (6,), in its own axes."""
    return pose @ transform(rotation_of(motion[:3]), motion[3:])
