"""Names the types of arrays whose precision is not fixed, and of values that come from JSON or YAML.

An array with one dtype says so where it stands (``npt.NDArray[np.float64]``).
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

FloatingArray: TypeAlias = npt.NDArray[np.floating[Any]]
"""An array of floating-point numbers of any precision."""

IntegerArray: TypeAlias = npt.NDArray[np.integer[Any]]
"""An array of integers of any width, with or without a sign."""

NumberArray: TypeAlias = npt.NDArray[np.number[Any]]
"""An array of numbers of any dtype."""

AnyArray: TypeAlias = npt.NDArray[np.generic]
"""An array of any dtype, structured ones among them."""

UncheckedArray: TypeAlias = npt.NDArray[Any]
"""An array from a file or a user, whose dtype is known only when it is read; it is checked before it is used."""

JsonValue: TypeAlias = Any
"""A value as JSON or YAML gives it."""

JsonObject: TypeAlias = dict[str, JsonValue]
"""A mapping as JSON or YAML gives it; whoever takes a value out of it checks what it is."""
