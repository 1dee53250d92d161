"""Draws random words that are a function of what they are for: no stream, no state."""

from __future__ import annotations

import hashlib


class Words:
    """Draws random words that are a function of (seed, index, path) alone, the same on every machine.

    Word k is the first eight bytes of SHA-256 of the text ``seed/index/path/k``: no library's generator, whose stream
    may change, and no state that one value would leave to the next.
    """

    def __init__(self, seed: int, index: int, path: str) -> None:
        self._of = f"{seed}/{index}/{path}"
        self._taken = 0

    def word(self) -> int:
        """Draw an integer, uniform in 0..2^64 - 1."""
        digest = hashlib.sha256(f"{self._of}/{self._taken}".encode()).digest()
        self._taken += 1
        return int.from_bytes(digest[:8], "big")

    def unit(self) -> float:
        """Draw a number, uniform in the open interval (0, 1), in steps of 2^-52."""
        return ((self.word() >> 12) + 0.5) * 2.0**-52

    def uniform(self, low: float, high: float) -> float:
        """Draw a number, uniform between two."""
        return min(max(low + self.unit() * (high - low), low), high)

    def below(self, count: int) -> int:
        """Draw an integer, uniform in 0..count - 1."""
        return self.word() * count >> 64
