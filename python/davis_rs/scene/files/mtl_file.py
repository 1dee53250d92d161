"""The material files (MTL) of OBJ meshes: the diffuse colour or texture of each material."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...geometry.pose import FloatArray
from ..lost_looks import BUMPS, METAL, OWN_LIGHT, TRANSPARENCY
from ..mesh_part import GREY
from ..textures import Texture
from .rounding import ROUNDING, within
from .texture_file import read_texture

_LOOKS = {
    "d": TRANSPARENCY,
    "Tr": TRANSPARENCY,
    "map_d": TRANSPARENCY,
    "Ke": OWN_LIGHT,
    "map_Ke": OWN_LIGHT,
    "Pm": METAL,
    "map_Pm": METAL,
    **dict.fromkeys(("bump", "map_bump", "map_Bump", "norm", "disp"), BUMPS),
}
"""What is lost of a material that has one of these lines."""
_USUAL = {"d": 1.0, "Tr": 0.0, "Ke": 0.0, "Pm": 0.0}
"""With these numbers nothing is lost."""


class Materials:
    """The materials of a file by name: ``Kd`` (linear RGB), or ``map_Kd`` (a texture, which takes the place of ``Kd``).

    Surfaces are diffuse and opaque: highlights are not read.

    Raises:
        OSError: if the file cannot be read.
        ValueError: naming the line that is malformed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.colours: dict[str, FloatArray] = {}
        self._textures: dict[str, tuple[str, str]] = {}
        self._lost: dict[str, dict[str, None]] = {}
        name = ""
        for number, line in enumerate(path.read_text("utf-8", errors="replace").splitlines(), 1):
            where = f"{path}:{number}"
            key, rest = [*line.split(None, 1), "", ""][:2]
            rest = rest.strip()
            if key == "newmtl":
                name = rest
                self.colours[name] = np.full(3, GREY)
                self._lost[name] = {}
            elif key == "Kd" and name:
                self.colours[name] = _colour(rest, where)
            elif key == "map_Kd" and name:
                if rest.startswith("-"):
                    raise ValueError(f"{where}: options of map_Kd are not read, got {rest!r}; remove them")
                self._textures[name] = (rest, where)
            elif key in _LOOKS and name and _is_different(key, rest):
                self._lost[name][_LOOKS[key]] = None

    def texture(self, name: str) -> Path | None:
        """The file of a material's texture; None without one."""
        return self.path.parent / self._textures[name][0].replace("\\", "/") if name in self._textures else None

    def reflectance(self, name: str) -> tuple[Texture | FloatArray, tuple[str, ...]]:
        """Return a material's texture, or its colour (3,); and the looks that are lost of it.

        Raises:
            OSError, ValueError: if its texture cannot be read.
        """
        image, lost = self.texture(name), dict(self._lost[name])
        if image is None:
            return self.colours[name], tuple(lost)
        texture, opaque = read_texture(image, self._textures[name][1])
        return texture, tuple(lost if opaque else lost | {TRANSPARENCY: None})


def _colour(text: str, where: str) -> FloatArray:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
    colour = within(values, 0, 1)
    if len(values) not in (1, 3) or colour is None:
        raise ValueError(f"{where}: Kd must be three numbers from 0 to 1, got {text!r}")
    return np.broadcast_to(colour, 3).copy()


def _is_different(key: str, text: str) -> bool:
    """Whether a line's numbers are other than those of an opaque, dark and smooth surface that is no metal."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        return True
    return key not in _USUAL or bool((np.abs(values - _USUAL[key]) > ROUNDING).any())
