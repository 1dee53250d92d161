"""What a bake has computed so far, so that one that is interrupted goes on where it was."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_HASH_BYTES = 32


class PartialBake:
    """Light at places, each batch under a hash of all that it follows from.

    Args:
        data: of :meth:`packed`; None to begin with nothing.

    Raises:
        ValueError: for data that are damaged.
    """

    def __init__(self, data: bytes | None = None) -> None:
        self._known: dict[bytes, FloatArray] = {}
        if data is None:
            return
        if hashlib.sha256(data[_HASH_BYTES:]).digest() != data[:_HASH_BYTES]:
            raise ValueError("its checksum is wrong")
        with np.load(io.BytesIO(data[_HASH_BYTES:]), allow_pickle=False) as arrays:
            self._known = {bytes.fromhex(name): arrays[name] for name in arrays.files}

    def __len__(self) -> int:
        """How many batches there are."""
        return len(self._known)

    def known_or(
        self, follows_from: tuple[bytes, FloatArray, FloatArray], compute: Callable[[], FloatArray]
    ) -> FloatArray:
        """What was computed before from the same settings, places and normals, or now."""
        settings, *arrays = follows_from
        digest = hashlib.sha256(settings)
        for array in arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
        key = digest.digest()
        if key not in self._known:
            self._known[key] = compute()
        return self._known[key].copy()

    def packed(self) -> bytes:
        """All of it, with a checksum."""
        buffer = io.BytesIO()
        arrays = {key.hex(): light for key, light in self._known.items()}
        np.savez(buffer, **arrays)  # type: ignore[arg-type]
        data = buffer.getvalue()
        return hashlib.sha256(data).digest() + data
