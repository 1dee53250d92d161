"""Keeps what a bake has computed so far, so that one that is interrupted goes on where it was."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from .kept_arrays import packed_arrays, unpacked_arrays

FloatArray = npt.NDArray[np.float64]


class PartialBake:
    """Keeps light at points, each batch under a hash of all that it follows from.

    Args:
        data: of :meth:`packed`; None to begin with nothing.

    Raises:
        ValueError: for data that are damaged.
    """

    def __init__(self, data: bytes | None = None) -> None:
        self._known: dict[bytes, FloatArray] = {}
        if data is None:
            return
        for name, light in unpacked_arrays(data).items():
            if light.dtype != np.float64 or light.ndim != 2 or light.shape[1] != 3:
                raise ValueError(f"light must be float64 (n, 3), found {light.dtype} {light.shape}")
            if not ((light >= 0) & (light < np.inf)).all():
                raise ValueError("light must be finite and >= 0")
            self._known[bytes.fromhex(name)] = light

    def __len__(self) -> int:
        """Return how many batches there are."""
        return len(self._known)

    def known_or(
        self, follows_from: tuple[bytes, FloatArray, FloatArray], compute: Callable[[], FloatArray]
    ) -> FloatArray:
        """Return what was computed before from the same settings, positions and normals, or compute it now."""
        settings, *arrays = follows_from
        digest = hashlib.sha256(settings)
        for array in arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
        key = digest.digest()
        kept = self._known.get(key)
        if kept is None or len(kept) != len(arrays[0]):
            self._known[key] = compute()
        return self._known[key].copy()

    def packed(self) -> bytes:
        """Return all of it, with a checksum."""
        return packed_arrays({key.hex(): light for key, light in self._known.items()})
