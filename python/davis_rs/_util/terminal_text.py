"""Escapes text for terminals: what comes from files, cameras and names may hold orders for a terminal."""

from __future__ import annotations

import re
from typing import TextIO

_ORDERS = "\x00-\x08\x0b-\x1f\x7f-\x9f"
"""Control characters, among them the one that begins an order, but for a new line and a tabulator."""
_DIRECTIONS = "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
"""Characters that turn the direction of what stands around them."""
_LINES = "\u2028\u2029"
_NOT_TEXT = "\ud800-\udfff"
"""What Python has for bytes of a name that are not UTF-8."""
_ESCAPED = re.compile(f"[{_ORDERS}{_DIRECTIONS}{_LINES}{_NOT_TEXT}]")
_ESCAPED_IN_A_LINE = re.compile(f"[\t\n{_ORDERS}{_DIRECTIONS}{_LINES}{_NOT_TEXT}]")


def printable(text: object, *, lines: bool = False) -> str:
    """Return text with what is not printable written as in Python: ``\x1b`` for an escape, ``\xff`` for a byte that
    is notot
    UTF-8.

    Args:
        lines: whether it may have several, and tabulators.
    """
    return (_ESCAPED if lines else _ESCAPED_IN_A_LINE).sub(_escape, str(text))


def tell(text: object = "", *, file: TextIO | None = None, end: str = "\n", flush: bool = False) -> None:
    """Print lines of text, escaped: on standard output if nothing else is said."""
    print(printable(text, lines=True), file=file, end=end, flush=flush)


def _escape(match: re.Match[str]) -> str:
    character = match[0]
    if "\udc80" <= character <= "\udcff":
        return f"\\x{ord(character) - 0xDC00:02x}"
    return character.encode("unicode_escape").decode("ascii")
