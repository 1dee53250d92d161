"""Effects that the crossing engine carries out."""

from __future__ import annotations

from ..._core import check_effects
from ..._util.argument_checks import is_number
from .effect import Effect


class EngineEffect(Effect):
    """An effect on the log signal, in the pixel or on the stream; the engine knows the ranges of its parameters."""

    def __post_init__(self) -> None:
        for name, value in self.settings().items():
            if value is not None and not is_number(value):
                raise ValueError(f"{self.name}: {name} must be a number, got {value!r}")
        check_effects({self.name: self.settings()})
