"""What a reader mends in a scene's file, or leaves out of it, in one line."""

from __future__ import annotations

import warnings
from pathlib import Path


class SceneFileWarning(UserWarning):
    """Something of a scene's file is left out, mended, or not shown as it is meant."""


class Repairs:
    """What was mended in a file or left out of it: how often, and where first.

    Attributes:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._found: dict[str, tuple[int, str]] = {}

    def add(self, what: str, count: int, first: str) -> None:
        """Note ``count`` more cases; ``first`` says where the first of them is."""
        if count:
            before, where = self._found.get(what, (0, first))
            self._found[what] = before + count, where

    def __str__(self) -> str:
        return "; ".join(f"{what}: {count} (the first: {first})" for what, (count, first) in self._found.items())

    def __bool__(self) -> bool:
        return bool(self._found)

    def warn(self) -> None:
        """Tell all of it in one line, if there is anything.

        Warns:
            SceneFileWarning: with the file and what was found.
        """
        if self:
            warnings.warn(f"{self.path}: {self}", SceneFileWarning, stacklevel=5)

    def refuse_nothing(self, triangles: int) -> None:
        """Refuse a mesh of which nothing is left.

        Raises:
            ValueError: where there are no ``triangles``, with what was left out.
        """
        if not triangles:
            told = f": {self}" if self else ""
            raise ValueError(f"{self.path}: the mesh has no faces that a camera could see{told}")
