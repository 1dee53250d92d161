"""Collects what a reader repairs in a scene's file, or leaves out of it, for a warning of one line."""

from __future__ import annotations

import warnings
from pathlib import Path


class SceneFileWarning(UserWarning):
    """Warns that something of a scene's file is left out, repaired, or not shown as it is meant."""


class Repairs:
    """Collects what was repaired in a file or left out of it: how often, and where first.

    Attributes:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._cases: dict[str, tuple[int, str]] = {}
        self._off: dict[str, dict[str, tuple[int, float]]] = {}

    def add(self, note: str, count: int, first: str) -> None:
        """Note ``count`` more cases; ``first`` says where the first of them is."""
        if count:
            before, where = self._cases.get(note, (0, first))
            self._cases[note] = before + count, where

    def add_off(self, note: str, count: int, where: str, off: float) -> None:
        """Note ``count`` numbers at a place that are off by up to ``off``. A place counts once, however often noted."""
        self._off.setdefault(note, {})[where] = count, off

    def __str__(self) -> str:
        cases = [f"{what}: {count} (the first: {first})" for what, (count, first) in self._cases.items()]
        for what, places in self._off.items():
            count, most = sum(count for count, _ in places.values()), max(off for _, off in places.values())
            cases.append(f"{what}: {count} (the first: {next(iter(places))}; off by up to {most:.2g})")
        return "; ".join(cases)

    def __bool__(self) -> bool:
        return bool(self._cases or self._off)

    def warn(self) -> None:
        """Warn of all repairs in one line, if there are any.

        Warns:
            SceneFileWarning: with the file and the repairs.
        """
        if self:
            warnings.warn(f"{self.path}: {self}", SceneFileWarning, stacklevel=5)

    def refuse_nothing(self, triangles: int) -> None:
        """Refuse a mesh without any triangle left.

        Raises:
            ValueError: if ``triangles`` is 0, with what was left out.
        """
        if not triangles:
            told = f": {self}" if self else ""
            raise ValueError(f"{self.path}: the mesh has no faces that a camera could see{told}")
