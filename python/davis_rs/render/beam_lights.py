"""Reads Mitsuba's spots and projectors: lights at a position that shine differently in different directions.

Both may throw a picture, a slide. Where a place lies in it follows from the direction in which the light sees it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import Mitsuba, MitsubaEmitter, MitsubaParameters, MitsubaTexture
from .diffuse_materials import children
from .obstacles import Unsuitable, plugin_name
from .texels import Texels, bilinear_meaning, bordered, looked_up, lookup_positions, nearest_meaning, uv_map_of

FloatArray = npt.NDArray[np.float64]

CoreSlide = tuple[list[list[float]], list[list[float]], bool, bool, list[int], npt.NDArray[np.float32]]
"""What the core takes, see :class:`davis_rs._core.SceneRenderer`."""

BEAMS = ("SpotLight", "Projector")
"""Mitsuba's classes of these lights."""

_RIGHT_ANGLE = np.pi / 2


class Slide(NamedTuple):
    """Holds what a light throws on surfaces.

    Attributes:
        rows: (3, 3), vectors of the world for u, v and depth, see :class:`davis_rs._core.SceneRenderer`.
        projected: it is a projector's, which ends at its edges.
        texels: factors on the light's intensity.
        wrap: index into :data:`~davis_rs.scene.texel_lookup.WRAP_MODES`.
        uv_map: (3, 3), the texture's own transform of its coordinates.
        nearest: the nearest texel is taken, not a mix of four.
    """

    rows: FloatArray
    projected: bool
    texels: Texels
    wrap: int
    uv_map: FloatArray
    nearest: bool

    @property
    def planes(self) -> int:
        """How many numbers a texel has: one, or three where any has a hue."""
        return 1 if self.texels.is_grey else 3

    @property
    def has_edges(self) -> bool:
        """Whether its light jumps from one direction to the next: at its end, or between texels."""
        return self.projected or self.nearest

    def core(self) -> CoreSlide:
        """Return it as the core takes it."""
        height, width = self.texels.shape[:2]
        image = np.empty((height * width, self.planes), np.float32)
        for start, piece in self.texels.pieces():
            image[start : start + len(piece)] = piece[:, : self.planes]
        framed = bordered(image.reshape(height, width, -1), self.wrap, np.float32)
        layout = [width, height, self.wrap]
        planes = np.ascontiguousarray(np.moveaxis(framed, -1, 0)).ravel()
        return self.rows.tolist(), self.uv_map[:2].tolist(), self.projected, self.nearest, layout, planes


class BeamLight(NamedTuple):
    """Holds a spot or a projector.

    Attributes:
        position: (3,), metres.
        intensity: (3,), red, green and blue along the axis; of a light with a slide, where the slide's texels are 1.
        axis: (3,), the unit vector along which it looks.
        angles: radians from the axis up to which a spot shines fully, and up to which at all; None for a projector.
        slide: what it throws; None for nothing.
    """

    position: FloatArray
    intensity: FloatArray
    axis: FloatArray
    angles: tuple[float, float] | None
    slide: Slide | None


def beam_light(emitter: MitsubaEmitter, mi: Mitsuba) -> BeamLight:
    """Read a spot or a projector.

    Args:
        mi: Mitsuba, under the variant that loaded it.

    Raises:
        Unsuitable: for a slide that is no bitmap, checkerboard or constant, or that its light's transform stretches,
            and for one before a spot of 90 degrees or more, whose texture coordinates have no end.
    """
    parameters = mi.traverse(emitter)
    matrix = np.array(parameters["to_world"].matrix, np.float64).reshape(4, 4)
    linear, position = matrix[:3, :3], matrix[:3, 3]
    axis = linear[:, 2] / np.linalg.norm(linear[:, 2])
    if emitter.class_name() == "Projector":
        return _projector(emitter, parameters, (linear, position, axis), mi)
    intensity = _rgb(parameters["intensity.value"])
    full, cutoff = (float(np.radians(np.array(parameters[key]).reshape(()))) for key in ("beam_width", "cutoff_angle"))
    slide = None
    if parameters.get("texture.value") is None:
        named = f"the spot light {emitter.id()!r}"
        if cutoff >= _RIGHT_ANGLE:
            raise Unsuitable("has a texture and a cutoff_angle of 90 degrees or more", "make it narrower", named)
        by_slope = 0.5 / np.tan(cutoff)
        to_uv = np.array([[by_slope, 0.0, 0.5], [0.0, by_slope, 0.5], [0.0, 0.0, 1.0]])
        texels, wrap, uv_map, nearest = _image(children(emitter)["texture"], mi, named)
        slide = Slide(to_uv @ _axes(linear, named).T, False, texels, wrap, uv_map, nearest)
    return BeamLight(position, intensity, axis, (full, cutoff), slide)


def _projector(
    emitter: MitsubaEmitter,
    parameters: MitsubaParameters,
    placed: tuple[FloatArray, FloatArray, FloatArray],
    mi: Mitsuba,
) -> BeamLight:
    """Read a projector, whose light on a plane at a distance of 1 is pi times its texture.

    Args:
        placed: linear part of its transform, position and axis.
    """
    named = f"the projector {emitter.id()!r}"
    linear, position, axis = placed
    axes = _axes(linear, named)
    size = float(np.linalg.norm(linear[:, 2]))
    # Mitsuba measures depth in the light's own unit, squared, and divides by the axis in the world's.
    strength = np.pi * size * float(np.array(parameters["scale"]).reshape(()))
    if "irradiance.value" in parameters:
        colour, image = _rgb(parameters["irradiance.value"]), (Texels(np.ones((1, 1, 3))), 0, np.eye(3), False)
    else:
        colour, image = np.ones(3), _image(children(emitter)["irradiance"], mi, named)
    slide = Slide(_to_slide(emitter, linear, position, mi) @ axes.T, True, *image)
    return BeamLight(position, strength * colour, axis, None, slide)


def _axes(linear: FloatArray, named: str) -> FloatArray:
    """Return the unit vectors of a light's axes, one a column."""
    axes = linear / np.linalg.norm(linear[:, 2])
    if not np.allclose(axes.T @ axes, np.eye(3), atol=1e-4):
        raise Unsuitable("is stretched by its transform", "turn and move it only", named)
    return axes


def _to_slide(emitter: MitsubaEmitter, linear: FloatArray, position: FloatArray, mi: Mitsuba) -> FloatArray:
    """Return what takes a direction (x, y, 1) in a projector's axes to its slide's (u, v, 1), (3, 3).

    Mitsuba does not tell the field of view, so it is asked where three places lie in the slide.
    """
    # So far away that float32 tells these places apart, wherever the light is.
    away = 1.0 + float(np.abs(position).max()) / float(np.linalg.norm(linear[:, 2]))

    def seen(x: float, y: float) -> FloatArray:
        interaction = mi.Interaction3f()
        interaction.p = mi.Point3f((away * linear @ [x, y, 1.0] + position).tolist())
        sample, _ = emitter.sample_direction(interaction, mi.Point2f(0.5, 0.5), True)
        return np.array(sample.uv, np.float64).reshape(2)

    middle = seen(0.0, 0.0)
    columns = [seen(1.0, 0.0) - middle, seen(0.0, 1.0) - middle, middle]
    return np.vstack([np.stack(columns, axis=1), [0.0, 0.0, 1.0]])


def _image(texture: MitsubaTexture, mi: Mitsuba, named: str) -> tuple[Texels, int, FloatArray, bool]:
    """Return the texels of a texture, its wrap mode, its transform, and whether the nearest texel is taken.

    Mitsuba does not tell a bitmap's encoding, wrap mode or filter. So each is tried, until a lookup agrees with
    Mitsuba's own.

    Raises:
        Unsuitable: for a texture that is neither a bitmap nor a checkerboard of two colours.
    """
    parameters, kind = mi.traverse(texture), plugin_name(texture)
    if kind == "checkerboard" and "color0.value" in parameters and "color1.value" in parameters:
        first, second = (_rgb(parameters[f"color{number}.value"]) for number in (0, 1))
        return Texels(np.array([[first, second], [second, first]])), 0, uv_map_of(parameters), True
    if "data" not in parameters:
        raise Unsuitable(f"throws a {kind}, which is no bitmap", "give it as one", named)
    uv_map, data = uv_map_of(parameters), np.asarray(parameters["data"])
    # Light may be of any size, and lookups are compared with an error that is meant for values up to 1.
    unit = 1.0 if data.dtype == np.uint8 else float(np.abs(data).max()) or 1.0
    scaled = data if data.dtype == np.uint8 else data / np.float32(unit)
    uv, mapped = lookup_positions(uv_map)
    own = looked_up(texture.eval, uv, mi) / unit
    for meaning, nearest in ((bilinear_meaning, False), (nearest_meaning, True)):
        if (meant := meaning(scaled, mapped, own)) is not None:
            texels, wrap = meant
            return (texels if data.dtype == np.uint8 else Texels(data)), wrap, uv_map, nearest
    raise Unsuitable("throws a texture whose lookup is neither bilinear nor nearest", "give it one of these", named)


def _rgb(value: object) -> FloatArray:
    return np.broadcast_to(np.array(value, np.float64).reshape(-1), (3,))
