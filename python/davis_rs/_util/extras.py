"""Imports libraries that only some parts need: the extras of pyproject.toml."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module


@contextmanager
def from_extra(extra: str) -> Iterator[None]:
    """Name the extra of davis_rs that brings a library, where an import within the block does not find it.

    Raises:
        ImportError: if a library is missing.
    """
    try:
        yield
    except ImportError as error:
        message = f"{error.name or error} is not installed: pip install 'davis_rs[{extra}]'"
        raise ImportError(message, name=error.name) from error


def require(extra: str, *modules: str) -> None:
    """Check that the libraries of an extra are there.

    Raises:
        ImportError: naming the first that is missing, and the extra.
    """
    with from_extra(extra):
        for module in modules:
            import_module(module)
