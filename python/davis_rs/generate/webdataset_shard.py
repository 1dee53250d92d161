"""Writes sequences into one tar file for WebDataset: a sequence's files have the same name up to the first dot."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .sequence_arrays import read_sequence


def write_webdataset_shard(path: Path, folders: Sequence[Path]) -> None:
    """Write folders of sequences into a new tar file, one after the other, in the order of their names.

    A sequence has ``NAME.meta.json``, ``NAME.GROUP.npz`` for each group of
    :class:`~davis_rs.generate.sequence_arrays.SequenceArrays`, and all other files as ``NAME.files.FILE`` with
    ``.`` for ``/``. The same folders give the same bytes.

    Raises:
        OSError, DecodeError: if a folder cannot be read, or the file cannot be written.
    """
    with tarfile.open(path, "x", format=tarfile.USTAR_FORMAT) as archive:
        for folder in folders:
            sequence = read_sequence(folder)
            _add(archive, f"{folder.name}.meta.json", sequence.meta)
            for name, columns in sequence.groups.items():
                stream = io.BytesIO()
                np.savez_compressed(stream, **columns)  # type: ignore[arg-type]
                _add(archive, f"{folder.name}.{name}.npz", stream.getvalue())
            for name, data in sequence.files.items():
                _add(archive, f"{folder.name}.files.{name.replace('/', '.')}", data)


def _add(archive: tarfile.TarFile, name: str, data: bytes) -> None:
    member = tarfile.TarInfo(name)  # of no owner and time, so that the bytes are those of the data alone
    member.size = len(data)
    archive.addfile(member, io.BytesIO(data))
