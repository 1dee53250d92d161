"""Did you mean ...? for names that users type."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def did_you_mean(given: str, names: Iterable[str]) -> str:
    """A question that names what was probably meant, to be put behind a message; empty where nothing is close."""
    by_folded = {name.lower(): name for name in names}
    close = get_close_matches(given.lower(), by_folded, n=1, cutoff=0.6)
    return f"; did you mean {by_folded[close[0]]}?" if close else ""
