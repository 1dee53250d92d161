"""Makes maps of irradiance on both sides of a scene's triangles, and looks them up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .surface_lattice import MOST_DIVISIONS, SampledLight, SurfaceLattice

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class LightMaps:
    """Holds irradiance / pi of one or several lights on both sides of each triangle.

    Attributes:
        divisions: int64 (t, 2): a map has 2 to the power of this many cells along an edge; that of a back which does
            not reflect is -1.
        texels: for each instant and each light of it float32 (n, 3), RGB: all maps one after the other, triangle by
            triangle and front before back, each with a frame of one texel around it, row by row.
        bumpy: bool (t), which triangles have maps of irradiance vectors, because normal textures turn them.
        vectors: as ``texels``, float32 (n, 9), x, y and z in RGB each, in the triangles' frames: the part along the
            surface of the irradiance vector / pi, of the triangles that have such maps; empty where none has.
        instants: seconds (k), when bodies are where the light has them; one where nothing moves.
        error: how much the light errs, relative: measured, of three places two err less.
        motion_error: how much more it errs between instants, relative: root mean square where light changes, in the
            worst of the instants that were looked at.
        points: at how many points light was computed.
        samples: points on each lamp, and rays that gather what bounces, for each place.
        complete: whether the maps are as fine as the error asks for.
        seconds: how long it took.
    """

    divisions: IntArray
    texels: list[npt.NDArray[np.float32]]
    bumpy: npt.NDArray[np.bool_]
    vectors: list[npt.NDArray[np.float32]]
    instants: FloatArray
    error: float
    motion_error: float
    points: int
    samples: tuple[int, int]
    complete: bool
    seconds: float

    @property
    def layouts(self) -> IntArray:
        """Return each map's first texel, width, height and wrap mode, (t, 2, 4); a back without one has the front's."""
        return layouts_of(self.divisions)

    @property
    def vector_layouts(self) -> IntArray:
        """Return the same of the maps of irradiance vectors; triangles that have none have those of another one."""
        return vector_layouts_of(self.divisions, self.bumpy)


def check_maps(
    maps: LightMaps,
    *,
    two_sided: npt.NDArray[np.bool_],
    bumpy: npt.NDArray[np.bool_],
    lights: int,
    tests: FloatArray,
) -> None:
    """Refuse maps that are not those of a scene's light.

    Args:
        two_sided, bumpy: bool (t), of the scene's triangles.
        lights: how many there are.
        tests: seconds (k), the instants at which light may be baked.

    Raises:
        ValueError: for the first rule that is broken.
    """
    divisions, instants = maps.divisions, maps.instants
    if divisions.dtype != np.int64 or divisions.shape != (len(two_sided), 2):
        raise ValueError(f"divisions must be int64 ({len(two_sided)}, 2), found {divisions.dtype} {divisions.shape}")
    least = np.stack([np.zeros(len(two_sided), np.int64), np.where(two_sided, 0, -1)], 1)
    if not ((divisions >= least) & (divisions <= MOST_DIVISIONS) & ((divisions < 0) == (least < 0))).all():
        raise ValueError(f"divisions must be 0..{MOST_DIVISIONS}, and -1 for backs that do not reflect")
    in_order = instants.dtype == np.float64 and instants.ndim == 1 and len(instants) and (np.diff(instants) > 0).all()
    if not in_order or not np.isin(instants, tests).all():
        raise ValueError("its instants are not those of the scene's motion")
    if len(maps.texels) != len(instants) * lights:
        raise ValueError(f"{len(instants)} instants of {lights} lights need as many maps, found {len(maps.texels)}")
    inside = _inside(divisions)
    count = len(inside)
    for texels in maps.texels:
        if texels.dtype != np.float32 or texels.shape != (count, 3):
            raise ValueError(f"texels must be float32 ({count}, 3), found {texels.dtype} {texels.shape}")
        if not (np.isfinite(texels).all() and (texels[inside] >= 0).all()):
            raise ValueError("texels must be finite, and >= 0 within triangles")
    if maps.bumpy.dtype != np.bool_ or not np.array_equal(maps.bumpy, bumpy):
        raise ValueError("its irradiance vectors are not those of the scene's normal textures")
    if len(maps.vectors) != (len(maps.texels) if bumpy.any() else 0):
        raise ValueError(f"{len(maps.texels)} maps need as many of irradiance vectors, found {len(maps.vectors)}")
    count = texel_count(maps.vector_layouts) if maps.vectors else 0
    for vectors in maps.vectors:
        if vectors.dtype != np.float32 or vectors.shape != (count, 9) or not np.isfinite(vectors).all():
            raise ValueError(f"irradiance vectors must be finite float32 ({count}, 9), found {vectors.shape}")


def _inside(divisions: IntArray) -> npt.NDArray[np.bool_]:
    """Return which texels lie in a triangle or on its edges. Beyond the third edge light goes on as it rises or falls,
    below 0 too."""
    layouts = layouts_of(divisions)
    inside = np.zeros(texel_count(layouts), bool)
    for level in np.unique(divisions[divisions >= 0]).tolist():
        cells = 2**level
        at = np.clip(np.arange(-1, cells + 2), 0, cells)
        within = np.flatnonzero(np.add.outer(at, at) <= cells)
        inside[layouts[divisions == level, 0][:, None] + within] = True
    return inside


def texel_count(layouts: IntArray) -> int:
    """Return how many texels all maps of these layouts (t, 2, 4) have."""
    return int((layouts[..., 0] + (layouts[..., 1] + 2) ** 2).max())


def layouts_of(divisions: IntArray) -> IntArray:
    sides = 2 ** divisions.clip(min=0) + 1
    sizes = np.where(divisions >= 0, (sides + 2) ** 2, 0).ravel()
    first = np.cumsum([0, *sizes])[:-1].reshape(-1, 2)
    layouts = np.stack([first, sides, sides, np.ones_like(sides)], -1)
    none = divisions[:, 1] < 0
    layouts[none, 1] = layouts[none, 0]
    return np.asarray(layouts)


def vector_layouts_of(divisions: IntArray, bumpy: npt.NDArray[np.bool_]) -> IntArray:
    """Return the layouts (t, 2, 4) of maps of some triangles (t) alone; the others have those of the first of these."""
    layouts = layouts_of(np.where(bumpy[:, None], divisions, -1))
    layouts[~bumpy] = layouts[np.argmax(bumpy)]
    return layouts


def side_of(lattice: SurfaceLattice) -> IntArray:
    """Return 0 for fronts, 1 for backs, which come after all fronts."""
    side = np.zeros(len(lattice.triangles), np.int64)
    fronts = int(lattice.triangles.max()) + 1
    side[fronts:] = 1
    return side


def looked_up(texels: npt.NDArray[np.float32], layouts: IntArray, weight: FloatArray) -> FloatArray:
    """Return light (n, 3) of maps with layouts (n, 4), at points with these barycentric coordinates (n, 3)."""
    first, side = layouts[:, 0], layouts[:, 1]
    position = weight[:, 1:] * (side - 1)[:, None]
    cell = np.minimum(position.astype(np.int64), (side - 2).clip(min=0)[:, None])
    x, y = (position - cell).T[..., None]
    stride = side + 2
    at = first + (cell[:, 1] + 1) * stride + cell[:, 0] + 1
    above = (1 - x) * texels[at] + x * texels[at + 1]
    below = (1 - x) * texels[at + stride] + x * texels[at + stride + 1]
    return np.asarray((1 - y) * above + y * below, np.float64)


def texels_of(
    lattice: SurfaceLattice,
    components: Sequence[SampledLight],
    divisions: IntArray,
    layouts: IntArray,
    others: npt.NDArray[np.float32] | None = None,
    chosen: npt.NDArray[np.bool_] | None = None,
) -> npt.NDArray[np.float32]:
    """Return the texels (n, 3) of maps of the sum of all components, and of ``others``, texels of the same layouts.

    Args:
        chosen: bool, which of the lattice's sides have maps; None: all.
    """
    texels = np.zeros((texel_count(layouts), 3), np.float32) if others is None else others.copy()
    sides = side_of(lattice)
    for component in components:
        for faces, grids in component.grids(divisions):
            if chosen is not None:
                faces, grids = faces[chosen[faces]], grids[chosen[faces]]
            if not len(faces):
                continue
            # Rows are along the second coordinate.
            framed = np.pad(grids.swapaxes(1, 2), ((0, 0), (1, 1), (1, 1), (0, 0)), mode="edge")
            first = layouts[lattice.triangles[faces], sides[faces], 0]
            at = first[:, None] + np.arange(framed.shape[1] ** 2)
            texels[at] += framed.reshape(len(faces), -1, 3).astype(np.float32)
    return texels


def map_coordinates(corners: FloatArray, divisions: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return affine maps of a position to the coordinates u and v in a triangle's light maps, (t, 2, 4) each.

    Args:
        corners: (t, 3, 3).
        divisions: (t, 2), see :class:`LightMaps`.
    """
    edges = corners[:, 1:] - corners[:, :1]
    cross = np.cross(edges[:, 0], edges[:, 1])
    squared = np.einsum("ij,ij->i", cross, cross)
    squared = np.where(squared > 0, squared, 1.0)[:, None]
    gradients = (np.cross(edges[:, 1], cross) / squared, np.cross(cross, edges[:, 0]) / squared)
    divisions = np.where(divisions < 0, divisions[:, :1], divisions)
    cells = (2.0**divisions)[..., None]
    maps = []
    for gradient in gradients:
        barycentric = np.concatenate([gradient, -np.einsum("ij,ij->i", gradient, corners[:, 0])[:, None]], 1)[:, None]
        maps.append((barycentric * cells + np.array([0, 0, 0, 0.5])) / (cells + 1))
    return maps[0], maps[1]
