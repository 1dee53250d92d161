"""Effects that the crossing engine carries out."""

from __future__ import annotations

from .._core import check_effects
from .effect import Effect


class EngineEffect(Effect):
    """An effect on the log signal, in the pixel or on the stream; the engine knows the ranges of its parameters."""

    def __post_init__(self) -> None:
        check_effects({self.name: self.settings()})
