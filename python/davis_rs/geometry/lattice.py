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


@functools.cache
def rank1_lattice(n: int) -> npt.NDArray[np.float64]:
    """Return n points (n, 2) in (-0.5, 0.5)^2 around the pixel's centre, their mean at the centre.

    Point i is (i / n, frac(i g / n)) with the generator g, coprime to n (no two points share a row or column), whose
    points keep the largest least distance on the torus.

    Raises:
        ValueError: for n outside of 1..1024.

    Source: Dammertz, Keller, Image synthesis by rank-1 lattices, MCQMC 2006.
    """
    if not 1 <= n <= 1024:
        raise ArgumentError("{rays_per_pixel} must lie in 1..1024, got {}", n)
    i = np.arange(n)

    def least_distance(g: int) -> int:
        # The points form a group, so their least distance is that of the nearest point to the origin.
        dx, dy = i[1:], i[1:] * g % n
        return int((np.minimum(dx, n - dx) ** 2 + np.minimum(dy, n - dy) ** 2).min(initial=2 * n * n))

    generator = max((g for g in range(1, n + 1) if gcd(g, n) == 1), key=least_distance)
    points = (np.stack([i, i * generator % n], 1) + 0.5) / n - 0.5
    points.flags.writeable = False  # every caller gets the same array
    return points
