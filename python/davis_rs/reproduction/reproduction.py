"""Holds how well a recording is reproduced, in all halves that were compared."""

from __future__ import annotations

from dataclasses import dataclass

from .._util.array_types import JsonObject
from .reproduced import ReproducedHalf
from .table import csv_of, text_of


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Holds how well a recording is reproduced; ``str()`` of it is a table.

    Attributes:
        name: of the recording.
        halves: those that were compared.
        notes: what was assumed, a line each.
    """

    name: str
    halves: tuple[ReproducedHalf, ...]
    notes: tuple[str, ...]

    def __str__(self) -> str:
        return "\n".join([self.name, *(text_of(half) for half in self.halves), "", *self.notes])

    def describe(self) -> JsonObject:
        """Return all numbers in JSON's types."""
        return {"name": self.name, "notes": list(self.notes), "halves": [half.describe() for half in self.halves]}

    def csv(self) -> str:
        """Return all numbers as CSV: a line for each half, statistic and stream."""
        return csv_of(self.halves)
