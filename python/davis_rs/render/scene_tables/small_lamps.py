"""Stands in for small area lights by places on them, each of which throws exact shadows.

The light of a place falls off with the cosine to its normal. What must not break: from far away, all places together
are as bright from each side as the lamp is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import Mitsuba, MitsubaShape
from ...geometry.lattice import rank1_lattice, sphere_lattice

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

FLAT_LAMP_PLACES = 16
"""Places on a lamp whose normals are all the same."""

CURVED_LAMP_PLACES = 32
"""Places on any other lamp, of which about half are seen from each side."""

_SAMPLES = 256
_DIRECTIONS = 256
_EVENNESS = 0.01
"""How much it counts that places have equal areas, next to how bright the lamp is from each side."""


class LampPlaces(NamedTuple):
    """Holds places on a lamp.

    Attributes:
        points: (n, 3), metres.
        normals: (n, 3), unit vectors.
        areas: (n,), how much of the lamp's surface each stands for, square metres.
    """

    points: FloatArray
    normals: FloatArray
    areas: FloatArray

    @classmethod
    def on(cls, shape: MitsubaShape, mi: Mitsuba) -> LampPlaces:
        """Choose places on a shape: evenly on a flat one, else parts of it whose normals are much the same."""
        area = float(np.array(shape.surface_area()).reshape(()))
        points, normals = _sampled(shape, _SAMPLES, mi)
        if np.ptp(normals, axis=0).max() > 1e-6:
            return _parts(points, normals, area)
        points, normals = _sampled(shape, FLAT_LAMP_PLACES, mi)
        return cls(points, normals, np.full(FLAT_LAMP_PLACES, area / FLAT_LAMP_PLACES))


def _sampled(shape: MitsubaShape, count: int, mi: Mitsuba) -> tuple[FloatArray, FloatArray]:
    """Return points that are even over a shape's area, and the normals there."""
    samples = [
        shape.sample_position(0.0, mi.Point2f(float(x), float(y))) for x, y in (rank1_lattice(count) + 0.5).tolist()
    ]
    points, normals = ([np.array(getattr(sample, name), np.float64).reshape(3) for sample in samples] for name in "pn")
    return np.array(points), np.array(normals)


def _parts(points: FloatArray, normals: FloatArray, area: float) -> LampPlaces:
    """Return a place for each of :data:`CURVED_LAMP_PLACES` parts of a lamp.

    Their areas are fitted to the area that the lamp shows to each side, because a part's mean normal stands for normals
    that differ.
    """
    from scipy.optimize import nnls

    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    parts = _halved(np.hstack([normals, points / size]), CURVED_LAMP_PLACES)
    means = np.array([normals[part].mean(axis=0) for part in parts])
    axes = means / np.linalg.norm(means, axis=1, keepdims=True)
    # A mean of places may lie within the lamp, which would hide it.
    nearest = [part[np.argmin(np.linalg.norm(points[part] - points[part].mean(axis=0), axis=1))] for part in parts]
    sides = sphere_lattice(_DIRECTIONS)
    shown = np.maximum(sides @ normals.T, 0).mean(axis=1)
    evenness = _EVENNESS * np.sqrt(_DIRECTIONS) * np.eye(len(parts))
    rows = np.vstack([np.maximum(sides @ axes.T, 0), evenness])
    fractions, _ = nnls(rows, np.concatenate([shown, evenness.sum(axis=1) / len(parts)]))
    return LampPlaces(points[nearest], axes, area * fractions)


def _halved(features: FloatArray, count: int) -> list[IntArray]:
    """Part rows of features into so many (a power of two) of equal size, where they differ most."""
    parts = [np.arange(len(features))]
    while len(parts) < count:
        sorted_parts = [
            part[np.argsort(features[part, features[part].var(axis=0).argmax()], kind="stable")] for part in parts
        ]
        parts = [half for part in sorted_parts for half in np.array_split(part, 2)]
    return parts
