"""Reads textures of one number, such as roughness, from Mitsuba, and brings colours to the same texture coordinates."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import Mitsuba, MitsubaTexture
from ..scene.texel_lookup import WRAP_MODES
from .texels import LUMINANCE, bilinear_meaning, looked_up, lookup_positions, uv_map_of

FloatArray = npt.NDArray[np.float64]

_PERIOD = 256
"""Texels along a side of a checkerboard's period: its edges become ramps of one texel."""


@dataclass(frozen=True)
class NumberTexels:
    """Roughness or the fraction of metal from place to place, looked up at the texture coordinates of the base colour.

    Attributes:
        height, width: texels along each side.
        wrap: index into :data:`~davis_rs.scene.texel_lookup.WRAP_MODES`.
        values: the texels, 0 to 1, as the bytes of float32 (height, width).
    """

    height: int
    width: int
    wrap: int
    values: bytes = field(repr=False)

    @property
    def image(self) -> npt.NDArray[np.float32]:
        """The texels (height, width)."""
        return np.frombuffer(self.values, np.float32).reshape(self.height, self.width)


class NumberTexture(NamedTuple):
    """A texture of one number.

    Attributes:
        mean: of it.
        texels: None where it is the same everywhere.
        uv_map: (3, 3), the transform of its coordinates; None where it is the same everywhere.
    """

    mean: float
    texels: NumberTexels | None = None
    uv_map: FloatArray | None = None


def number_texture(texture: MitsubaTexture, mi: Mitsuba) -> NumberTexture | None:
    """Read a texture of numbers from 0 to 1; None of one that is no constant, bitmap or checkerboard of them."""
    value = constant_of(texture, mi)
    if value is not None:
        return NumberTexture(float(value.flat[0]))
    if texture.class_name() == "Checkerboard":
        return _checkerboard(texture, mi)
    uv_map = _uv_map(texture, mi)
    if uv_map is None:
        return None
    data = np.asarray(mi.traverse(texture)["data"])
    uv, mapped = lookup_positions(uv_map)
    meant = bilinear_meaning(data, mapped, looked_up(texture.eval_1, uv, mi), LUMINANCE)
    if meant is None:
        return None
    texels, wrap = meant
    values = np.concatenate([piece @ LUMINANCE for _, piece in texels.pieces()]).astype(np.float32)
    if not (values.min() >= 0 and values.max() <= 1):
        return None
    height, width = texels.shape[:2]
    return NumberTexture(float(values.mean()), NumberTexels(height, width, wrap, values.tobytes()), uv_map)


def _checkerboard(texture: MitsubaTexture, mi: Mitsuba) -> NumberTexture | None:
    """Read a checkerboard of two numbers from 0 to 1 as one period of texels; None of one of other textures."""
    parameters = mi.traverse(texture)
    keys = ["color0.value", "color1.value"]
    if any(key not in parameters for key in keys):
        return None
    first, second = (_luminance(np.array(parameters[key], np.float64)) for key in keys)
    if not (0 <= first <= 1 and 0 <= second <= 1):
        return None
    half = np.arange(_PERIOD) >= _PERIOD // 2
    # Rows go down as v goes up, as those of a bitmap.
    values = np.where(half == half[::-1, None], first, second).astype(np.float32)
    texels = NumberTexels(_PERIOD, _PERIOD, WRAP_MODES.index("repeat"), values.tobytes())
    return NumberTexture((first + second) / 2, texels, uv_map_of(parameters))


def _luminance(value: FloatArray) -> float:
    """Return the one number that Mitsuba makes of a number or of red, green and blue."""
    return float((np.array(rgb_of(value)) @ LUMINANCE)[0])


def _uv_map(texture: MitsubaTexture, mi: Mitsuba) -> FloatArray | None:
    """Return the transform (3, 3) of a bitmap's coordinates; None of another texture."""
    parameters = mi.traverse(texture)
    if "data" not in parameters or "to_uv" not in parameters:
        return None
    return uv_map_of(parameters)


def constant_of(texture: MitsubaTexture, mi: Mitsuba) -> FloatArray | None:
    """Return the value of a texture that is the same everywhere; None of any other texture, and of encoded texels."""
    parameters = mi.traverse(texture)
    if "value" in parameters:
        return np.array(parameters["value"], np.float64)
    if "data" not in parameters:
        return None
    texels = np.asarray(parameters["data"])
    alike = np.issubdtype(texels.dtype, np.floating) and np.ptp(texels) == 0
    return texels.reshape(-1)[:1].astype(np.float64) if alike else None


def placed_alike(
    base: MitsubaTexture, *others: NumberTexture, mi: Mitsuba, anisotropic: bool = False
) -> MitsubaTexture | None:
    """Return a base colour that is looked up at the same coordinates as other textures; None where it is not.

    Args:
        anisotropic: it needs coordinates in any case, whose axes are those of the mesh.
    """
    uv_maps = [number.uv_map for number in others if number.uv_map is not None]
    colour = constant_of(base, mi)
    if colour is None and (of_base := _uv_map(base, mi)) is not None:
        uv_maps.insert(0, of_base)
    elif colour is None:
        return None if uv_maps or anisotropic else base
    uv_maps = uv_maps or ([np.eye(3)] if anisotropic else [])
    if not uv_maps:
        return base
    if any(not np.array_equal(other, uv_maps[0]) for other in uv_maps):
        return None
    if anisotropic and (uv_maps[0][0, 1] != 0 or uv_maps[0][1, 0] != 0):
        return None
    if colour is None:
        return base
    # A texture of one texel has no coordinates, so it gets a second one.
    texels = np.broadcast_to(rgb_of(colour), (1, 2, 3)).astype(np.float32)
    to_uv = mi.ScalarTransform3f(uv_maps[0].tolist())
    return mi.load_dict({"type": "bitmap", "raw": True, "data": mi.TensorXf(texels), "to_uv": to_uv})


def rgb_of(value: FloatArray) -> tuple[float, float, float]:
    red, green, blue = np.broadcast_to(value.reshape(-1), (3,)).tolist()
    return red, green, blue
