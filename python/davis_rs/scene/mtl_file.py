"""The material files (MTL) of OBJ meshes: the diffuse colour or texture of each material."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from ..pose import FloatArray
from .mesh_part import GREY
from .texture_file import read_texture
from .textures import Texture


class Materials:
    """The materials of a file by name: ``Kd`` (linear RGB), or ``map_Kd`` (a texture, which takes the place of ``Kd``).

    Surfaces are diffuse and opaque: highlights and bumps are not read, and one line says so of transparency and of
    light.

    Raises:
        OSError: if the file cannot be read.
        ValueError: naming the line that is malformed.

    Warns:
        UserWarning: naming the materials that are transparent or give light.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.colours: dict[str, FloatArray] = {}
        self._textures: dict[str, tuple[str, str]] = {}
        different: list[str] = []
        name = ""
        for number, line in enumerate(path.read_text("utf-8", errors="replace").splitlines(), 1):
            where = f"{path}:{number}"
            key, _, rest = line.strip().partition(" ")
            rest = rest.strip()
            if key == "newmtl":
                name = rest
                self.colours[name] = np.full(3, GREY)
            elif key == "Kd" and name:
                self.colours[name] = _colour(rest, where)
            elif key == "map_Kd" and name:
                if rest.startswith("-"):
                    raise ValueError(f"{where}: options of map_Kd are not read, got {rest!r}; remove them")
                self._textures[name] = (rest, where)
            elif (key in ("d", "Tr", "Ke") and _is_different(key, rest)) or key in ("map_d", "map_Ke"):
                different.append(name)
        if different:
            named = ", ".join(dict.fromkeys(different))
            warnings.warn(
                f"{path}: materials that are transparent or give light are simulated opaque and dark: {named}",
                stacklevel=2,
            )

    def texture(self, name: str) -> Path | None:
        """The file of a material's texture; None without one."""
        return self.path.parent / self._textures[name][0].replace("\\", "/") if name in self._textures else None

    def reflectance(self, name: str) -> Texture | FloatArray:
        """Return a material's texture, or its colour (3,).

        Raises:
            OSError, ValueError: if its texture cannot be read.
        """
        texture = self.texture(name)
        return self.colours[name] if texture is None else read_texture(texture, self._textures[name][1])


def _colour(text: str, where: str) -> FloatArray:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
    if len(values) not in (1, 3) or not ((values >= 0) & (values <= 1)).all():
        raise ValueError(f"{where}: Kd must be three numbers from 0 to 1, got {text!r}")
    return np.broadcast_to(values, 3).copy()


def _is_different(key: str, text: str) -> bool:
    """Whether a material's opacity, transparency or light is other than that of an opaque, dark surface."""
    try:
        values = {float(word) for word in text.split()}
    except ValueError:
        return True
    return values != ({1.0} if key == "d" else {0.0})
