"""Reads material files (MTL) of OBJ meshes: the diffuse colour or texture of each material, and what it emits."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._util.budget import Budget
from ..._util.untrusted import read_charged
from ...geometry.pose import FloatArray
from ..lost_looks import BUMPS, METAL, MIRRORS, MISSING, OWN_LIGHT, TRANSPARENCY
from ..mesh_part import GREY
from ..named_file import named_file
from ..texture_file import EncodedTexture, TextureFiles
from .rounding import ROUNDING, within

_LOOKS = {
    "Pm": METAL,
    "map_Pm": METAL,
    **dict.fromkeys(("bump", "map_bump", "map_Bump", "norm", "disp"), BUMPS),
}
"""The kind of look that is lost if a material has one of these lines."""
_NUMBERS = ("Kd", "Ke", "d", "Tr", "Pm", "illum")
"""Lines of numbers, behind which a comment may stand; in names, # is a letter."""
_MATERIAL_BYTES = 1000
"""About what a material takes in memory, without its texture."""
_BRIGHTEST = 1e18
"""The most radiance that is read: its square must fit in float32."""
_MIRRORS = tuple("3456789")
"""Models of illumination with reflections or refraction."""
_USUAL = {"Pm": 0.0}
"""Values with which nothing is lost."""


class Materials:
    """The materials of a file by name: ``Kd`` (linear RGB), or ``map_Kd`` (a texture, which replaces ``Kd``).

    Surfaces are diffuse: highlights are not read, and mirrors and glass (``illum``) are told as lost. They emit ``Ke``
    (radiance, linear RGB), or ``map_Ke``, a texture that ``Ke`` multiplies where it is not 0.

    Args:
        folder: the scene's own, in which textures must lie.
        budget: what the scene's file may take.
        grey_unknown: surfaces whose texture is missing are grey; else :meth:`reflectance` refuses them.

    Raises:
        OSError: if the file cannot be read.
        ValueError: naming the line that is malformed.
    """

    def __init__(self, path: Path, folder: Path, budget: Budget, grey_unknown: bool = False) -> None:
        self.path, self._folder, self._grey_unknown = path, folder, grey_unknown
        self.colours: dict[str, FloatArray] = {}
        self._images: dict[str, Path] = {}
        """What each line names, so that each is told once."""
        self._textures: dict[str, tuple[str, str]] = {}
        self._opacities: dict[str, tuple[str, str]] = {}
        self._opaque: dict[str, dict[str, float]] = {}
        self._emissions: dict[str, FloatArray] = {}
        self._emissive_textures: dict[str, tuple[str, str]] = {}
        self._lost: dict[str, dict[str, None]] = {}
        name = ""
        for number, line in enumerate(text_lines(read_charged(path, budget), budget), 1):
            where = f"{path}:{number}"
            key, rest = [*line.split(None, 1), "", ""][:2]
            rest = (rest.partition("#")[0] if key in _NUMBERS else rest).strip()
            if key == "newmtl":
                name = rest
                budget.take(_MATERIAL_BYTES, f"{where}: a material")
                self.colours[name] = np.full(3, GREY)
                self._lost[name] = {}
            elif key == "Kd" and name:
                self.colours[name] = _colour(rest, where)
            elif key == "map_Kd" and name:
                if rest.startswith("-"):
                    raise ValueError(f"{where}: options of map_Kd are not read, got {rest!r}; remove them")
                self._textures[name] = (rest, where)
            elif key == "map_d" and name:
                self._opacities[name] = (rest, where)
            elif key in ("d", "Tr") and name and (given := _fraction(rest)) is not None:
                self._opaque.setdefault(name, {})[key] = given
            elif key in ("d", "Tr") and name:
                self._lost[name][TRANSPARENCY] = None
            elif key == "Ke" and name and (emission := _radiance(rest)) is not None:
                self._emissions[name] = emission
            elif key == "map_Ke" and name and not rest.startswith("-"):
                self._emissive_textures[name] = (rest, where)
            elif key in ("Ke", "map_Ke") and name:
                self._lost[name][OWN_LIGHT] = None
            elif key == "illum" and name and rest in _MIRRORS:
                self._lost[name][MIRRORS] = None
            elif key in _LOOKS and name and _is_different(key, rest):
                self._lost[name][_LOOKS[key]] = None

    def texture(self, name: str) -> Path | None:
        """Return the file of a material's texture; None without one, and where it is missing and grey will do.

        Raises:
            DecodeError: if it does not lie in the scene's folder.
        """
        if name not in self._textures:
            return None
        file = self._image("map_Kd", *self._textures[name])
        return None if self._grey_unknown and not file.is_file() else file

    def _image(self, key: str, given: str, where: str) -> Path:
        """Return the file that a line with a key names.

        Raises:
            DecodeError: if it does not lie in the scene's folder.
        """
        if where not in self._images:
            self._images[where] = named_file(given.replace("\\", "/"), self.path, self._folder, f"{where}: {key}")
        return self._images[where]

    def lost(self, name: str) -> tuple[str, ...]:
        """Return the kinds of a material's looks that are lost, besides those of its opacity's texture."""
        missing = (MISSING,) if name in self._textures and self.texture(name) is None else ()
        return (*self._lost[name], *missing)

    def reflectance(self, name: str, textures: TextureFiles) -> EncodedTexture | FloatArray:
        """Return a material's texture, or its colour (3,).

        Raises:
            OSError, ValueError: if its texture cannot be read.
        """
        image = self.texture(name)
        if image is not None:
            return textures.read(image, self._textures[name][1])
        return np.full(3, GREY) if name in self._textures else self.colours[name]

    def emission(
        self, name: str, textures: TextureFiles
    ) -> tuple[Path | None, EncodedTexture | FloatArray | None, bool]:
        """Return what a material emits.

        Returns:
            the file of ``map_Ke``; that texture, or a colour (3,), None where it is dark; and whether that file is
            missing.

        Raises:
            OSError, ValueError: if the texture cannot be read; DecodeError if it does not lie in the scene's folder.
        """
        colour = self._emissions.get(name)
        if colour is not None and not colour.any():
            colour = None
        if name not in self._emissive_textures:
            return None, colour, False
        given, where = self._emissive_textures[name]
        path = self._image("map_Ke", given, where)
        if not path.is_file():
            return None, None, True
        texture = textures.read(path, where)
        return path, texture if colour is None else texture.tinted(colour), False

    def opaque(self, name: str) -> float:
        """Return the fraction of its area that a material covers: ``d``, or without it 1 - ``Tr``.

        Some exporters write the same number in both.
        """
        given = self._opaque.get(name, {})
        return given.get("d", 1.0 - given.get("Tr", 0.0))

    def opacity(self, name: str, textures: TextureFiles) -> tuple[Path | None, npt.NDArray[np.uint8] | None, bool]:
        """Return what ``map_d`` says of a material's opacity, or the alpha of its texture without such a line.

        Returns:
            the file of ``map_d``; the opacity, uint8 (H, W): the file's alpha, or without one its red channel, None
            where it is opaque; and whether the line cannot be followed, because it has options or its file is missing.

        Raises:
            OSError, ValueError: if an image cannot be read; DecodeError if it does not lie in the scene's folder.
        """
        if name not in self._opacities:
            texture = self.reflectance(name, textures)
            return None, texture.alpha if isinstance(texture, EncodedTexture) else None, False
        given, where = self._opacities[name]
        if given.startswith("-"):
            return None, None, True
        path = self._image("map_d", given, where)
        if not path.is_file():
            return None, None, True
        texture = textures.read(path, where)
        return path, texture.texels[..., 0] if texture.alpha is None else texture.alpha, False


def text_lines(data: bytes, budget: Budget) -> Iterator[str]:
    """Iterate over the lines of an OBJ or MTL file, in UTF-8 or nearly so.

    Raises:
        DecodeError: if there are more than the budget allows.
    """
    budget.count(max(data.count(b"\n"), data.count(b"\r")) + 1, "lines")
    return iter(io.TextIOWrapper(io.BytesIO(data), "utf-8", errors="replace"))


def _colour(text: str, where: str) -> FloatArray:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
    colour = within(values, 0, 1)
    if len(values) not in (1, 3) or colour is None:
        raise ValueError(f"{where}: Kd must be three numbers from 0 to 1, got {text!r}")
    return np.broadcast_to(colour, 3).copy()


def _fraction(text: str) -> float | None:
    """Return a number from 0 to 1; None for another text, such as an option."""
    try:
        value = within(np.array([float(text)]), 0, 1)
    except ValueError:
        return None
    return None if value is None else float(value[0])


def _radiance(text: str) -> FloatArray | None:
    """Return linear RGB (3,); None for another text, such as the name of a spectrum."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        return None
    colour = within(values, 0, _BRIGHTEST)
    return None if len(values) not in (1, 3) or colour is None else np.broadcast_to(colour, 3).copy()


def _is_different(key: str, text: str) -> bool:
    """Return whether a line says more than that a surface is smooth and not metallic."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        return True
    return key not in _USUAL or bool((np.abs(values - _USUAL[key]) > ROUNDING).any())
