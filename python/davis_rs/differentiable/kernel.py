"""Extends the table kernel by textures and lights that are Dr.Jit arrays, so that derivatives reach them."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import JitFloat, JitTensor, JitVector, Mitsuba, TensorLike
from ..render.scene_tables.scene_table import Light, SceneTable
from ..render.scene_tables.scene_texture import TextureTable
from ..render.table.kernel import TableKernel
from ..scene.texel_lookup import wrap_index
from .poses import tensor

_STRENGTHS = {"point": "intensity", "directional": "irradiance", "constant": "radiance"}
_VECTORS = {"point": "position", "directional": "direction"}


class DifferentiableKernel(TableKernel):
    """Extends the table kernel: textures and lights have names, and can be replaced."""

    def __init__(self, table: SceneTable, mi: Mitsuba) -> None:
        super().__init__(table, mi)
        self._textures = {f"{shape.id()}.reflectance": number for number, shape in enumerate(table.scene.shapes())}
        self._strengths, self._vectors = {}, {}
        for number, light in enumerate(table.lights):
            self._strengths[f"{light.name}.{_STRENGTHS[light.kind]}"] = number
            if light.kind in _VECTORS:
                self._vectors[f"{light.name}.{_VECTORS[light.kind]}"] = number

    def parameters(self) -> dict[str, JitTensor]:
        """Return the scene's own values, ``mi.TensorXf``, by name."""
        lights = self._table.lights
        return {
            **{name: tensor(_reflectances(self._table.textures, number)) for name, number in self._textures.items()},
            **{name: tensor([lights[number].strength]) for name, number in self._strengths.items()},
            **{name: tensor(lights[number].vector) for name, number in self._vectors.items()},
        }

    def replaced(self, parameters: Mapping[str, TensorLike]) -> TableKernel:
        """Return this kernel with other values for some of its parameters, attached to them.

        Raises:
            ValueError: for a name that is not there, or a value of another shape.
        """
        import drjit as dr
        import mitsuba as mi

        textures: dict[int, JitTensor] = {}
        lights = list(self._table.lights)
        for name, value in parameters.items():
            if name in self._textures:
                number = self._textures[name]
                _, width, height, _ = self._table.textures.sizes[number].tolist()
                textures[number] = _shaped(name, value, (height, width, 3), (height, width))
            elif name in self._strengths:
                number = self._strengths[name]
                lights[number] = replace(lights[number], strength=_shaped(name, value, (1,)).array)
            elif name in self._vectors:
                number = self._vectors[name]
                vector = dr.unravel(mi.Vector3f, _shaped(name, value, (3,)).array)
                if lights[number].kind == "directional":
                    vector = dr.normalize(vector)
                components: JitVector = _Components(vector)
                lights[number] = replace(lights[number], vector=components)
            else:
                known = ", ".join([*self._textures, *self._strengths, *self._vectors])
                raise ValueError(f"parameters of this scene are {known}; got {name!r}")
        kernel = copy.copy(self)
        if textures:
            kernel._texels = [self._with_textures(group, textures) for group in range(len(self._texels))]
        kernel._table = _TableWithLights(self._table, lights)
        return kernel

    def moved_lights(self, parameters: Mapping[str, TensorLike]) -> list[str]:
        """Return the names of replaced positions and directions of lights that differ from the scene's own."""
        moved = []
        for name, number in self._vectors.items():
            if name in parameters:
                light = self._table.lights[number]
                vector = tensor(parameters[name]).numpy().astype(np.float64)
                if light.kind == "directional":
                    vector /= np.linalg.norm(vector)
                if not np.allclose(vector, light.vector, rtol=1e-6, atol=1e-6 * np.abs(light.vector).max()):
                    moved.append(name)
        return moved

    def _with_textures(self, group: int, replacements: Mapping[int, JitTensor]) -> JitFloat:
        """Return the kernel's buffer of texels as luma, each texture with its border, with some textures replaced."""
        import drjit as dr
        import mitsuba as mi

        weights = self._table.textures.group_weights[group].tolist()
        textures, end = [], 0
        for number, (_, width, height, wrap) in enumerate(self._table.textures.sizes.tolist()):
            start, end = end, end + (width + 2) * (height + 2)
            if number not in replacements:
                textures.append(dr.gather(mi.Float, self._texels[group], dr.arange(mi.UInt32, start, end)))
                continue
            value = replacements[number]
            rows, columns = (wrap_index(np.arange(-1, size + 1), size, wrap) for size in (height, width))
            texel = mi.UInt32((rows[:, None] * width + columns).ravel().astype(np.uint32))
            if value.ndim == 2:
                textures.append(sum(weights) * dr.gather(mi.Float, value.array, texel))
            else:
                rgb = (dr.gather(mi.Float, value.array, texel * 3 + channel) for channel in range(3))
                textures.append(sum(weight * values for weight, values in zip(weights, rgb, strict=True)))
        return dr.concat(textures)


class _TableWithLights(SceneTable):
    """Holds a table with other lights, whose strengths and vectors may be Dr.Jit arrays."""

    def __init__(self, table: SceneTable, lights: list[Light]) -> None:
        self.__dict__.update(table.__dict__)
        self.lights = lights

    @property
    def background_luma(self) -> JitFloat:
        return self.background(self.lights)


class _Components(list[JitFloat]):
    """Holds the components of a Dr.Jit vector, with the method of a NumPy vector that the kernel calls."""

    def tolist(self) -> list[JitFloat]:
        return self


def _reflectances(textures: TextureTable, number: int) -> npt.NDArray[np.float32]:
    """Return linear RGB (H, W, 3) of a texture: its texels under a red, a green and a blue light."""
    by_channel = copy.copy(textures)
    by_channel.group_weights = list(np.eye(3))
    first, width, height, _ = textures.sizes[number].tolist()
    rgb = np.stack([by_channel.texels(channel)[first : first + width * height] for channel in range(3)], -1)
    return rgb.reshape(height, width, 3)


def _shaped(name: str, value: TensorLike, *shapes: tuple[int, ...]) -> JitTensor:
    attached = tensor(value)
    if attached.shape not in shapes:
        raise ValueError(f"{name} must have shape {' or '.join(map(str, shapes))}, got {attached.shape}")
    return attached
