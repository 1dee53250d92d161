"""Publishes a sequence's folder: hidden while it is made, whole once it has its name, with checksums that say so
later."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from itertools import count
from pathlib import Path
from typing import TypedDict
from uuid import uuid4


class ShardFile(TypedDict):
    """Holds what the manifest says of a file with many sequences: its name, size in bytes and SHA-256."""

    name: str
    bytes: int
    sha256: str


class _ManifestLine(TypedDict):
    name: str
    parameters: dict[str, object]
    events: int
    duration_us: int
    files: int
    sha256: str


class ManifestLine(_ManifestLine, total=False):
    """Holds what the manifest says of a sequence; ``shard`` is there where its files are in one."""

    shard: ShardFile


CHECKSUMS = "sha256sums.txt"
"""In every folder, of all other files that it is made with, by name and as ``sha256sum --check`` reads it."""

_HIDDEN = re.compile(r"\.sequence_\d{5,}\.[0-9a-f]{32}\.(part|gone)|\.shard_\d{5,}\.\w+\.[0-9a-f]{32}\.part")


def working_folder(root: Path, name: str) -> Path:
    """Return a hidden path next to ``name``. It is unique, even if another process makes the same sequence."""
    return root / f".{name}.{uuid4().hex}.part"


def publish(working: Path, final: Path) -> None:
    """Give a folder that is whole its checksums, bring all of it to the disk, and then give it its name.

    Where another one has come first, this one, which is the same, is dropped.

    Raises:
        OSError: if something cannot be written.
    """
    names = file_names(working)
    lines = "".join(f"{file_sha256(working / name)}  {name}\n" for name in names)
    (working / CHECKSUMS).write_text(lines)
    for name in [*names, CHECKSUMS]:
        sync(working / name)
    for folder in {working, *(path for path in working.rglob("*") if path.is_dir())}:
        sync(folder)
    try:
        working.rename(final)
    except OSError:
        if not final.is_dir():
            raise
        discard(working)
    sync(final.parent)


def discard(folder: Path) -> None:
    """Remove a hidden folder.

    It gets another name first: a process that still works in it cannot publish what is left of it.
    """
    gone = folder.with_name(folder.name.rpartition(".")[0] + ".gone")
    try:
        folder.rename(gone)
    except FileNotFoundError:
        return
    shutil.rmtree(gone, ignore_errors=True)


def withdraw(folder: Path) -> None:
    """Remove a published folder.

    It is hidden first: whenever this is cut short, all of the folder has its name or nothing does.
    """
    hidden = working_folder(folder.parent, folder.name)
    folder.rename(hidden)
    discard(hidden)


def set_aside(folder: Path) -> Path:
    """Give a published folder a name that no sequence has, and return it."""
    names = (folder.with_name(f"damaged_{folder.name}_{number}") for number in count())
    aside = next(path for path in names if not path.exists())
    folder.rename(aside)
    return aside


def discard_hidden(root: Path) -> None:
    """Remove what killed processes left behind."""
    for path in root.iterdir():
        if _HIDDEN.fullmatch(path.name):
            if path.is_file():
                path.unlink()
            elif path.name.endswith(".gone"):
                shutil.rmtree(path, ignore_errors=True)
            else:
                discard(path)


def folder_sha256(folder: Path) -> str:
    """Return one digest of all files: that of the list of checksums.

    Raises:
        OSError: if there is no such list.
    """
    return file_sha256(folder / CHECKSUMS)


def damage(folder: Path, *, contents: bool = True) -> str | None:
    """Say what is wrong with a folder that was published; None if it is as its list of checksums says.

    Files that somebody added are no damage.

    Args:
        contents: read every file; otherwise only look whether they are all there.
    """
    try:
        listed = listed_files(folder)
    except (OSError, UnicodeDecodeError) as error:
        return f"its {CHECKSUMS} cannot be read: {error}"
    if missing := listed.keys() - set(file_names(folder)):
        return f"{min(missing)} is missing"
    for name, digest in listed.items() if contents else ():
        try:
            if file_sha256(folder / name) != digest:
                return f"{name} has changed"
        except OSError as error:
            return f"{name} cannot be read: {error}"
    return None


def listed_files(folder: Path) -> dict[str, str]:
    """Read the list of checksums: SHA-256 by name.

    Raises:
        OSError, UnicodeDecodeError: if it cannot be read.
    """
    lines = (line.partition("  ") for line in (folder / CHECKSUMS).read_text("utf-8").splitlines())
    return {name: digest for digest, _, name in lines}


def unlisted_files(folder: Path) -> list[str]:
    """List files that the list of checksums does not have, sorted: somebody added them. Without a list, all files."""
    try:
        listed = listed_files(folder)
    except (OSError, UnicodeDecodeError):
        listed = {}
    return [name for name in file_names(folder) if name not in listed]


def file_names(folder: Path) -> list[str]:
    """List all files but the list of checksums, relative to the folder, sorted."""
    paths = (path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir())
    names = (path.relative_to(folder).as_posix() for path in paths)
    return sorted(name for name in names if name != CHECKSUMS)


def file_sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def sync(path: Path) -> None:
    """Bring a file, or a folder as a list of names, to the disk: a stop of the machine then leaves no half of it."""
    if os.name == "nt":
        return  # Windows syncs nothing that is opened for reading, and no folder
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
