"""Libraries that only some formats need."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def from_extra(extra: str) -> Iterator[None]:
    """Around imports: one that is missing is told with the extra of davis_rs that brings it.

    Raises:
        ImportError: if a library is missing.
    """
    try:
        yield
    except ImportError as error:
        message = f"{error.name or error} is not installed: pip install 'davis_rs[{extra}]'"
        raise ImportError(message, name=error.name) from error
