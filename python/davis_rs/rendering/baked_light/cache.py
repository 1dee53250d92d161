"""Baked light is kept in the user's cache folder, under a hash of all that it follows from."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from ...progress import say
from .bake import LightMaps

FOLDER_VARIABLE = "DAVIS_RS_CACHE_DIR"
"""Names another cache folder; empty for none."""

MOST_BYTES = 2 << 30
"""When the folder holds more, what was not used for longest is deleted."""

_SUFFIX = ".light"
_HASH_BYTES = 32


def cache_folder() -> Path | None:
    """Where baked light is kept; None where nothing shall be."""
    named = os.environ.get(FOLDER_VARIABLE)
    if named is not None:
        return Path(named) if named else None
    return Path(platformdirs.user_cache_dir("davis_rs")) / "baked_light"


def load(key: str) -> LightMaps | None:
    """What is kept under a key; None where there is nothing, or it is damaged, which is said in one line."""
    folder = cache_folder()
    if folder is None:
        return None
    file = folder / (key + _SUFFIX)
    try:
        data = file.read_bytes()
        with contextlib.suppress(OSError):
            os.utime(file)
    except FileNotFoundError:
        return None
    except OSError as error:
        say(f"baked light cannot be read from its cache ({error}): it is baked again")
        return None
    try:
        return _unpacked(data)
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        say(f"baked light in {file} is damaged ({error}): it is baked again")
        return None


def store(key: str, maps: LightMaps) -> None:
    """Keep light under a key. Where that fails, one line says so and the run goes on.

    Other processes see the whole file or none: it gets its name when it is whole.
    """
    folder = cache_folder()
    if folder is None:
        return
    temporary: str | None = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=folder, prefix=f".{key[:16]}-")
        with os.fdopen(handle, "wb") as file:
            file.write(_packed(maps))
        os.replace(temporary, folder / (key + _SUFFIX))
        _delete_oldest(folder, key)
    except OSError as error:
        say(f"baked light cannot be kept in its cache ({error}): the next run bakes it again")
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)


def _packed(maps: LightMaps) -> bytes:
    buffer = io.BytesIO()
    numbers = np.array([maps.error, maps.points, *maps.samples, maps.complete, maps.seconds], np.float64)
    texels: dict[str, Any] = {f"texels_{i}": one for i, one in enumerate(maps.texels)}
    np.savez(buffer, divisions=maps.divisions, numbers=numbers, **texels)
    data = buffer.getvalue()
    return hashlib.sha256(data).digest() + data


def _unpacked(data: bytes) -> LightMaps:
    if hashlib.sha256(data[_HASH_BYTES:]).digest() != data[:_HASH_BYTES]:
        raise ValueError("its checksum is wrong")
    with np.load(io.BytesIO(data[_HASH_BYTES:]), allow_pickle=False) as arrays:
        error, points, lamp, paths, complete, seconds = arrays["numbers"].tolist()
        texels = [arrays[f"texels_{i}"] for i in range(len(arrays.files) - 2)]
        samples = int(lamp), int(paths)
        return LightMaps(arrays["divisions"], texels, error, int(points), samples, bool(complete), seconds)


def _delete_oldest(folder: Path, key: str) -> None:
    kept = []
    for file in folder.glob("*" + _SUFFIX):
        with contextlib.suppress(OSError):
            kept.append((file.stat().st_mtime, file.stat().st_size, file))
    total = sum(size for _, size, _ in kept)
    for _, size, file in sorted(kept):
        if total <= MOST_BYTES or file.name == key + _SUFFIX:
            continue
        with contextlib.suppress(OSError):
            file.unlink()
            total -= size
