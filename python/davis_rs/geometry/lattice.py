"""Makes the points inside a pixel through which its rays pass: a fixed rank-1 lattice, the same in every frame.

A pattern that changed from frame to frame would turn its noise into events; a fixed one gives none on a still image.
At equal cost rank-1 lattices integrate image edges far better than regular grids.
"""

from __future__ import annotations

import functools
from math import gcd

import numpy as np
import numpy.typing as npt

from .._util.argument_error import ArgumentError

_FAR_APART = 0.95
"""Generators whose least distance is at least this fraction of the largest one are compared by their spectra."""

_WORTH_IT = 0.5
"""The farthest generator is left only for one whose spectral error is at most this fraction of its own."""

_HALF_PERIODS = np.arange(-10, 11)
"""The waves that errors are measured with, in half periods along a pixel's side."""


def sphere_lattice(n: int) -> npt.NDArray[np.float64]:
    """Return n unit vectors (n, 3) that lie evenly on the sphere, from above to below: a Fibonacci lattice.

    Source: Gonzalez, Measurement of areas on a sphere using Fibonacci and latitude-longitude lattices, 2010.
    """
    number = np.arange(n)
    z = 1 - (2 * number + 1) / n
    turn, flat = np.pi * (1 + np.sqrt(5)) * number, np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], 1)


@functools.cache
def rank1_lattice(n: int) -> npt.NDArray[np.float64]:
    """Return n points (n, 2) in (-0.5, 0.5)^2 around the pixel's centre, their mean at the centre.

    Point i is (i / n, frac(i g / n)) with the generator g, coprime to n (no two points share a row or column), whose
    points keep the largest least distance on the torus. Many points of a good least distance may still line up along
    some direction, and then err several times as much at edges: where a generator of nearly the same distance has
    at most half of the :func:`spectral_error`, it is taken instead.

    Raises:
        ValueError: for n outside of 1..1024.

    Source: Dammertz, Keller, Image synthesis by rank-1 lattices, MCQMC 2006.
    """
    if not 1 <= n <= 1024:
        raise ArgumentError("{rays_per_pixel} must lie in 1..1024, got {}", n)
    distances = {g: _least_distance(n, g) for g in range(1, n + 1) if gcd(g, n) == 1}
    farthest = max(distances, key=lambda g: distances[g])
    errors = {
        g: spectral_error(_points(n, g))
        for g, distance in distances.items()
        if distance >= _FAR_APART * distances[farthest]
    }
    # Those of a lattice and its mirror images differ by rounding alone, which must not choose between them.
    best = min(errors, key=lambda g: float(f"{errors[g]:.6g}"))
    points = _points(n, best if errors[best] <= _WORTH_IT * errors[farthest] else farthest)
    points.flags.writeable = False  # every caller gets the same array
    return points


def spectral_error(points: npt.NDArray[np.float64]) -> float:
    """Return how badly the mean over points (n, 2) in (-0.5, 0.5)^2 integrates waves over the pixel: the sum of squared
    errors of waves of up to five periods a side, each weighted by the power that photographs have there, 1 / (1 + f^2).
    """
    phases = np.exp(1j * np.pi * points[:, :, None] * _HALF_PERIODS)
    along = np.sinc(_HALF_PERIODS / 2)
    errors = phases[:, 0].T @ phases[:, 1] / len(points) - np.outer(along, along)
    power = 1 / (1 + np.add.outer(_HALF_PERIODS**2, _HALF_PERIODS**2))
    return float((np.abs(errors) ** 2 * power).sum())


def _points(n: int, generator: int) -> npt.NDArray[np.float64]:
    i = np.arange(n)
    return (np.stack([i, i * generator % n], 1) + 0.5) / n - 0.5


def _least_distance(n: int, generator: int) -> float:
    # The points form a group, so their least distance is that of the nearest point to the origin.
    i = np.arange(1, n)
    dx, dy = i, i * generator % n
    return float(np.hypot(np.minimum(dx, n - dx), np.minimum(dy, n - dy)).min(initial=2 * n))
