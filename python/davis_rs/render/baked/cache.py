"""Keeps baked light in the user's cache folder, under a hash of all that it follows from."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
import platformdirs

from ..._util.budget import Budget
from ..._util.progress import say
from ..._util.untrusted import read_limited, regular_file
from .kept_arrays import packed_arrays, unpacked_arrays
from .light_maps import LightMaps
from .partial import PartialBake

FOLDER_VARIABLE = "DAVIS_RS_CACHE_DIR"
"""Names another cache folder; empty for none."""

MOST_BYTES = 2 << 30
"""When the folder holds more, what was not used for longest is deleted."""

_SUFFIX, _PARTIAL_SUFFIX = ".light", ".partial"

_Content = TypeVar("_Content")


def cache_folder() -> Path | None:
    """Return the folder in which baked light is kept; None if it is not kept."""
    named = os.environ.get(FOLDER_VARIABLE)
    if named is not None:
        return Path(named) if named else None
    return Path(platformdirs.user_cache_dir("davis_rs")) / "baked_light"


def load(key: str, check: Callable[[LightMaps], object]) -> LightMaps | None:
    """Return what is kept under a key; None where there is nothing, or it is damaged, which is said in one line.

    Args:
        check: raises a ValueError for light that is not that of the scene.
    """

    def unpacked(data: bytes) -> LightMaps:
        maps = _unpacked(data)
        check(maps)
        return maps

    return _read(key + _SUFFIX, unpacked)


def holds(key: str) -> bool:
    """Return whether anything is kept under a key."""
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
    """Return what a bake that was stopped has left under a key, or nothing yet."""
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
        size = regular_file(file).stat().st_size
        budget = Budget(file)
        with budget.borrow(size, "baked light"):
            data = read_limited(file, size)
            with contextlib.suppress(OSError):
                os.utime(file)
            return unpacked(data)
    except FileNotFoundError:
        return None
    except OSError as error:
        say(f"baked light cannot be read from its cache ({error}): it is baked again")
        return None
    except ValueError as error:
        say(f"baked light in {file} is damaged ({error}): it is baked again")
        return None


def _write(folder: Path, name: str, data: bytes, otherwise: str) -> bool:
    """Write a file, and return whether that worked; if not, a line says what happens ``otherwise``."""
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
    numbers = np.array(
        [maps.error, maps.motion_error, maps.points, *maps.samples, maps.complete, maps.seconds], np.float64
    )
    arrays = {"divisions": maps.divisions, "instants": maps.instants, "numbers": numbers, "bumpy": maps.bumpy}
    arrays |= {f"texels_{i}": one for i, one in enumerate(maps.texels)}
    return packed_arrays(arrays | {f"vectors_{i}": one for i, one in enumerate(maps.vectors)})


def _unpacked(data: bytes) -> LightMaps:
    arrays = unpacked_arrays(data)
    texels, vectors = (
        [f"{kind}_{i}" for i in range(sum(name.startswith(kind) for name in arrays))] for kind in ("texels", "vectors")
    )
    if arrays.keys() != {"divisions", "instants", "numbers", "bumpy", *texels, *vectors}:
        raise ValueError("its arrays are not those of baked light")
    numbers = arrays["numbers"]
    if numbers.shape != (7,) or not ((numbers >= 0) & (numbers < 2.0**53)).all():
        raise ValueError(f"its numbers must be 7, finite and >= 0: found {numbers.shape}")
    error, motion_error, points, lamp, paths, complete, seconds = numbers.tolist()
    return LightMaps(
        arrays["divisions"],
        [arrays[name] for name in texels],
        arrays["bumpy"],
        [arrays[name] for name in vectors],
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
