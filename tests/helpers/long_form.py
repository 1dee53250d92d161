"""Marks parameters of a test that only its long form needs."""

from __future__ import annotations

from typing import Any

import pytest


def long_values(*values: Any) -> list[Any]:
    """Return parameters that run only with ``--long``; a tuple stands for the values of several names."""
    return [pytest.param(*_all(value), marks=pytest.mark.long) for value in values]


def _all(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)
