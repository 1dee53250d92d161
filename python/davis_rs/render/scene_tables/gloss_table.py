"""Which of a scene's triangles are glossy, how they reflect, and what stands for them where light is baked."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import MitsubaBsdf, MitsubaScene
from ..baked.lights import integrator_of, paths_of, shows_absorption
from ..finish import CoreFinish, Finish
from ..media import absorption_within
from ..number_textures import NumberTexels
from ..texels import CoreColours, laid_out

FloatArray = npt.NDArray[np.float64]
_Texels = npt.NDArray[np.float32]

CoreGloss = tuple[
    list[CoreFinish],
    npt.NDArray[np.uint32],
    CoreColours,
    list[list[float]],
    list[list[float]],
    FloatArray,
    tuple[int, int, _Texels] | None,
    int,
    tuple[list[list[int]], _Texels],
    tuple[npt.NDArray[np.uint32], list[list[int]], list[int], _Texels],
]
"""What the core takes, see :class:`davis_rs._core.SceneRenderer`."""

DIFFUSE = 2**32 - 1
"""The finish of a triangle that is diffuse."""

_ENDLESS = 1 << 16
"""Segments of paths of any length; the core ends them earlier."""


@dataclass(frozen=True)
class GlossTable:
    """The glossy triangles of a scene.

    Attributes:
        finishes: how they reflect.
        finish_of: uint32 (n), the finish of each triangle, :data:`DIFFUSE` for none.
        longest: segments that a path of light has at most.
    """

    finishes: list[Finish]
    finish_of: npt.NDArray[np.uint32]
    longest: int

    @property
    def has_solid_glass(self) -> bool:
        """Whether light is bent on its way through anything."""
        return any(finish.bends_light for finish in self.finishes)

    @property
    def has_polarizers(self) -> bool:
        """Whether anything dims what is seen through it, and not the light that is baked."""
        return any(finish.is_null and not finish.blends for finish in self.finishes)

    @property
    def digest(self) -> bytes:
        """A hash of all of it."""
        lobes = b"".join(texels.values for texels in self._lobes)
        return hashlib.sha256(repr(self.finishes).encode() + lobes + self.finish_of.tobytes()).digest()

    @property
    def _lobes(self) -> dict[NumberTexels, int]:
        """The textures of roughness and metal, each with its number."""
        lobes = dict.fromkeys(texels for finish in self.finishes for texels in finish.lobe if texels is not None)
        return {texels: number for number, texels in enumerate(lobes)}

    def core_finishes(self) -> list[CoreFinish]:
        """Return the finishes as the core takes them."""
        lobes = self._lobes
        return [finish.core(lobes) for finish in self.finishes]

    def core_lobes(self) -> tuple[list[list[int]], _Texels]:
        """Return the textures of roughness and metal as the core takes them: layouts, and all texels."""
        return laid_out(((texels.image, texels.wrap) for texels in self._lobes), np.float32)

    def finishes_of_textures(self, texture_of: npt.NDArray[np.uint32]) -> dict[int, int]:
        """Return the finish of each texture, or :data:`DIFFUSE`.

        Args:
            texture_of: (t), the texture of each triangle: no two shapes have the same.
        """
        numbers, first = np.unique(texture_of, return_index=True)
        return dict(zip(numbers.tolist(), self.finish_of[first].tolist(), strict=True))

    def albedo(self, finish: int, base: FloatArray) -> FloatArray:
        """Return how much surfaces with a finish, or :data:`DIFFUSE`, reflect of light from all sides (n, 3), for base
        colours (n, 3)."""
        return base if finish == DIFFUSE else self.finishes[finish].albedo(base)

    @property
    def is_clear(self) -> npt.NDArray[np.bool_]:
        """Return through which triangles (t) light that is baked passes, as if they were not there."""
        return np.append([finish.is_clear for finish in self.finishes], False)[self._numbers]

    @property
    def is_glass(self) -> npt.NDArray[np.bool_]:
        """Return which triangles (t) reflect nothing that is baked."""
        return np.append([finish.is_glass for finish in self.finishes], False)[self._numbers]

    @property
    def _numbers(self) -> npt.NDArray[np.int64]:
        """The finish of each triangle, the number after the last for none."""
        return np.minimum(self.finish_of.astype(np.int64), len(self.finishes))


def gloss_table(
    scene: MitsubaScene,
    finishes: Mapping[MitsubaBsdf, Finish],
    counts: Sequence[int],
    *,
    baked: bool,
    reflections: bool = False,
) -> GlossTable | None:
    """Find the glossy triangles of a scene; None where there are none.

    Args:
        finishes: by the materials of shapes.
        counts: how many triangles each shape has.
        reflections: mirrors show all surfaces, and solids absorb, whatever the integrator says.
    """
    numbers = dict[Finish, int]()
    absorbing = reflections or shows_absorption(scene)
    of_shapes = []
    for shape in scene.shapes():
        finish = finishes.get(shape.bsdf())
        if absorbing and finish is not None and finish.under[0] == "solid":
            absorption = absorption_within(shape)
            finish = finish if absorption is None else finish.absorbing(absorption)
        of_shapes.append(DIFFUSE if finish is None else numbers.setdefault(finish, len(numbers)))
    if not numbers:
        return None
    finish_of = np.repeat(np.array(of_shapes, np.uint32), counts)
    longest = _ENDLESS if reflections else _longest(scene, baked=baked)
    return GlossTable(list(numbers), finish_of, longest)


def _longest(scene: MitsubaScene, *, baked: bool) -> int:
    """Return how many segments a path has at most; under direct light alone what is reflected is seen if it shines."""
    integrator = integrator_of(scene)
    if not baked and (integrator is None or integrator.class_name() != "DirectIntegrator"):
        return _ENDLESS  # asked for by name
    depth = paths_of(scene).max_depth
    return _ENDLESS if depth < 0 else depth
