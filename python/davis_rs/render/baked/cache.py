"""Baked light is kept in the user's cache folder, under a hash of all that it follows from."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import platformdirs

from ..._util.progress import say
from .light_maps import LightMaps
from .partial import PartialBake

FOLDER_VARIABLE = "DAVIS_RS_CACHE_DIR"
"""Names another cache folder; empty for none."""

MOST_BYTES = 2 << 30
"""When the folder holds more, what was not used for longest is deleted."""

_SUFFIX, _PARTIAL_SUFFIX = ".light", ".partial"
_HASH_BYTES = 32

_Content = TypeVar("_Content")


def cache_folder() -> Path | None:
    """The folder in which baked light is kept; None if it is not kept."""
    named = os.environ.get(FOLDER_VARIABLE)
    if named is not None:
        return Path(named) if named else None
    return Path(platformdirs.user_cache_dir("davis_rs")) / "baked_light"


def load(key: str) -> LightMaps | None:
    """What is kept under a key; None where there is nothing, or it is damaged, which is said in one line."""
    return _read(key + _SUFFIX, _unpacked)


def holds(key: str) -> bool:
    """Whether anything is kept under a key."""
    folder = cache_folder()
    return folder is not None and (folder / (key + _SUFFIX)).is_file()


def store(key: str, maps: LightMaps) -> None:
    """Keep light under a key. Where that fails, one line says so and the run goes on.

    Other processes see the whole file or none: it gets its name when it is whole.
    """
    folder = cache_folder()
    if folder is None:
        return
    _write(folder, key + _SUFFIX, _packed(maps), "the next run bakes it again")
    with contextlib.suppress(OSError):
        (folder / (key + _PARTIAL_SUFFIX)).unlink(missing_ok=True)


def load_partial(key: str) -> PartialBake:
    """What a bake that was stopped has left under a key, or nothing yet."""
    kept = _read(key + _PARTIAL_SUFFIX, PartialBake)
    if kept is None:
        return PartialBake()
    say("the scene's light was baked in part before, and the bake continues from there")
    return kept


@contextlib.contextmanager
def kept_if_stopped(key: str, kept: PartialBake) -> Iterator[None]:
    """Keep what is computed so far if Ctrl-C, or a signal that exits, ends the bake within."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        folder = cache_folder()
        if (
            folder is not None
            and len(kept)
            and _write(folder, key + _PARTIAL_SUFFIX, kept.packed(), "the next run begins anew")
        ):
            say("what is baked so far is kept: the next run continues from there")
        raise


def _read(name: str, unpacked: Callable[[bytes], _Content]) -> _Content | None:
    folder = cache_folder()
    if folder is None:
        return None
    file = folder / name
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
        return unpacked(data)
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        say(f"baked light in {file} is damaged ({error}): it is baked again")
        return None


def _write(folder: Path, name: str, data: bytes, otherwise: str) -> bool:
    """Whether it could be written; if not, a line says what happens ``otherwise``."""
    temporary: str | None = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=folder, prefix=f".{name[:16]}-")
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        os.replace(temporary, folder / name)
        _delete_oldest(folder, name)
        return True
    except OSError as error:
        say(f"baked light cannot be kept in its cache ({error}): {otherwise}")
        return False
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)


def _packed(maps: LightMaps) -> bytes:
    buffer = io.BytesIO()
    numbers = np.array(
        [maps.error, maps.motion_error, maps.points, *maps.samples, maps.complete, maps.seconds], np.float64
    )
    texels: dict[str, Any] = {f"texels_{i}": one for i, one in enumerate(maps.texels)}
    np.savez(buffer, divisions=maps.divisions, instants=maps.instants, numbers=numbers, **texels)
    data = buffer.getvalue()
    return hashlib.sha256(data).digest() + data


def _unpacked(data: bytes) -> LightMaps:
    if hashlib.sha256(data[_HASH_BYTES:]).digest() != data[:_HASH_BYTES]:
        raise ValueError("its checksum is wrong")
    with np.load(io.BytesIO(data[_HASH_BYTES:]), allow_pickle=False) as arrays:
        error, motion_error, points, lamp, paths, complete, seconds = arrays["numbers"].tolist()
        texels = [arrays[f"texels_{i}"] for i in range(len(arrays.files) - 3)]
        return LightMaps(
            arrays["divisions"],
            texels,
            arrays["instants"],
            error,
            motion_error,
            int(points),
            (int(lamp), int(paths)),
            bool(complete),
            seconds,
        )


def _delete_oldest(folder: Path, name: str) -> None:
    """Delete what was not used for longest, but for the file that was just written."""
    kept = []
    for file in folder.iterdir():
        if file.suffix in (_SUFFIX, _PARTIAL_SUFFIX):
            with contextlib.suppress(OSError):
                kept.append((file.stat().st_mtime, file.stat().st_size, file))
    total = sum(size for _, size, _ in kept)
    for _, size, file in sorted(kept):
        if total <= MOST_BYTES or file.name == name:
            continue
        with contextlib.suppress(OSError):
            file.unlink()
            total -= size
