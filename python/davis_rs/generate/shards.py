"""Packs many sequences into one file, which is whole or not there at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from .._util.extras import require
from .folder import ManifestLine, ShardFile, file_sha256, sync, withdraw
from .shard_formats import write_hdf5_shard, write_webdataset_shard

WRITERS: dict[str, tuple[str, Callable[[Path, Sequence[Path]], None]]] = {
    "hdf5": (".h5", write_hdf5_shard),
    "webdataset": (".tar", write_webdataset_shard),
}
"""The formats: a file's suffix, and what writes it from sequences' folders."""

MOST_IN_A_SHARD = 100_000


@dataclass(frozen=True)
class Shards:
    """Says how sequences are packed into files.

    Attributes:
        format: a key of ``WRITERS``.
        sequences: how many in a file, but for the last one, which may have fewer.
    """

    format: str
    sequences: int

    def name(self, index: int) -> str:
        """Return the file that a sequence belongs to."""
        return f"shard_{index // self.sequences:05d}{WRITERS[self.format][0]}"

    def members(self, index: int, total: int) -> range:
        """Return the sequences of that file, of a plan with ``total`` of them."""
        first = index - index % self.sequences
        return range(first, min(first + self.sequences, total))


class Packing:
    """Packs shards in a thread while sequences are made; a shard's folders go once the manifest has its file.

    Args:
        root: the folder of the sequences.
        shards: how they are put together.
        names: of all sequences of the plan, in order.

    Raises:
        ImportError: if the library that writes the format is missing.
    """

    def __init__(self, root: Path, shards: Shards, names: Sequence[str]) -> None:
        if shards.format == "hdf5":  # before sequences are made that could not be packed
            require("hdf5", "h5py")
        self._root, self._shards, self._names = root, shards, names
        self._thread = ThreadPoolExecutor(1, "packing")
        self._packed: dict[str, Future[tuple[list[str], ShardFile]]] = {}

    def offer(self, index: int, lines: Mapping[str, ManifestLine]) -> None:
        """Pack the shard of a sequence if all of its sequences are whole and it is not packed yet."""
        name = self._shards.name(index)
        members = [self._names[k] for k in self._shards.members(index, len(self._names))]
        if name not in self._packed and all(member in lines and "shard" not in lines[member] for member in members):
            self._packed[name] = self._thread.submit(self._pack, name, members)

    def take(self, lines: dict[str, ManifestLine], write: Callable[[], None], *, wait: bool = False) -> None:
        """Say in the manifest's lines which shards are there by now, write them, and remove the folders.

        Args:
            lines: of the manifest, by name.
            write: brings them to the disk.
            wait: for all shards that were begun.

        Raises:
            OSError, ValueError: if a shard cannot be written.
        """
        for name, future in list(self._packed.items()):
            if not (wait or future.done()):
                continue
            members, shard = future.result()
            del self._packed[name]
            for member in members:
                lines[member] = {**lines[member], "shard": shard}
            write()
            for member in members:
                withdraw(self._root / member)

    def close(self) -> None:
        """Begin no other shard, and wait for the one at work."""
        self._thread.shutdown(cancel_futures=True)

    def _pack(self, name: str, members: Sequence[str]) -> tuple[list[str], ShardFile]:
        final, working = self._root / name, self._root / f".{name}.{uuid4().hex}.part"
        try:
            WRITERS[self._shards.format][1](working, [self._root / member for member in members])
            sync(working)
            shard: ShardFile = {"name": name, "bytes": working.stat().st_size, "sha256": file_sha256(working)}
            os.replace(working, final)
        except BaseException:
            with suppress(OSError):
                working.unlink()
            raise
        sync(self._root)
        return list(members), shard


def shard_fault(root: Path, shard: ShardFile, *, contents: bool = True) -> str | None:
    """Say what is wrong with a file that a line of the manifest names; None if it is as it was.

    Args:
        contents: read all of it; otherwise only look whether it is there, with as many bytes.
    """
    path = root / shard["name"]
    try:
        if path.stat().st_size != shard["bytes"] or (contents and file_sha256(path) != shard["sha256"]):
            return f"{path.name} has changed"
    except OSError as error:
        return f"{path.name} is missing" if isinstance(error, FileNotFoundError) else f"{path.name}: {error}"
    return None


def taken_from_shards(
    root: Path, shards: Shards, names: Sequence[str], known: Mapping[str, ManifestLine], say: Callable[[str], None]
) -> dict[str, ManifestLine]:
    """Take the manifest's lines of sequences that are in shards already, and remove what is left of their folders.

    A shard that is not as it was, or whose sequences are now more (the plan has grown), is made again.
    """
    lines: dict[str, ManifestLine] = {}
    for first in range(0, len(names), shards.sequences):
        members = [names[k] for k in shards.members(first, len(names))]
        packed = [name for name in members if name in known and "shard" in known[name]]
        if not packed:
            continue
        shard = known[packed[0]]["shard"]
        fault = shard_fault(root, shard, contents=False)
        if len(packed) < len(members) and fault is None:
            fault = "the plan has grown, and more sequences belong to it"
        if fault is not None:
            say(f"{shard['name']} is made again: {fault}")
            (root / shard["name"]).unlink(missing_ok=True)
            continue
        for name in members:
            lines[name] = known[name]
            if (root / name).is_dir():  # a kill came before it was removed
                withdraw(root / name)
    return lines


def shard_names(lines: Iterable[ManifestLine]) -> dict[str, ShardFile]:
    """Return the shards that lines of a manifest name, by name."""
    return {line["shard"]["name"]: line["shard"] for line in lines if "shard" in line}
