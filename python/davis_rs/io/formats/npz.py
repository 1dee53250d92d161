"""Writes and reads NumPy's .npz: a zip archive, here with the one array ``events``."""

from __future__ import annotations

import os
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ..._core import DecodeError, crc32, crc32_combine
from ..._util.budget import Budget
from ..._util.untrusted import decoding
from ...events.arrays import EventArray
from .blocks import BLOCK, Blocks, equal_blocks, refuse
from .destination import Destination, PartFile
from .interface import EventReader, Format, warn_truncated
from .npy import HEADER, NpyReader, NpyWriter, npy_header, read_header, to_events
from .reading import ReadRules

_NAME = b"events.npy"
_LOCAL = struct.Struct("<4s5H3L2H")
"""Signature, version, flags, method, time, date, CRC-32, two sizes, lengths of name and extra field."""
_DATE = (0, 0x21)
"""Midnight of 1980-01-01: the same events are the same bytes."""
_END, _END_64 = b"PK\x05\x06", b"PK\x06\x06"
_END_LENGTH = 22 + 0xFFFF
"""The record that an archive ends with, and the longest comment behind it."""
_MEMBER, _MEMBER_HELD = 46, 600
"""Bytes of a member of the list of members: the fewest in the file, and in memory."""
_LATER = 0xFFFFFFFF
"""A size that stands in the extra field, where it has 64 bits."""


class NpzWriter(NpyWriter):
    """Writes the archive next to its path, as ``NAME.npz.part``, and renames it on finishing, because other programs
    cannot open an unfinished archive. :func:`davis_rs.read_events` reads what a killed process has left in it."""

    _part: PartFile | None = None
    _crc = 0

    def _open(self, destination: Destination) -> BinaryIO:
        target = destination.target
        if not isinstance(target, str | os.PathLike):
            return target
        self._part = destination.claim_part()
        return self._part.part.open("r+b", buffering=0)

    def _put_beginning(self) -> None:
        self._archive = self._start
        self._put(_local_header(0, 0))
        self._start = self._file.tell()
        super()._put_beginning()

    def _encode(self, packet: EventArray) -> None:
        super()._encode(packet)
        self._crc = crc32(packet.view(np.uint8), self._crc)

    def _close(self) -> int:
        data = self._count * 16
        crc = crc32_combine(zlib.crc32(npy_header(self._count)), self._crc, data)
        self._put(_directory(crc, HEADER + data, self._file.tell() - self._archive))
        self._patch(self._archive, _local_header(crc, HEADER + data))
        self._start = self._archive
        size = super()._close()
        if self._part is not None:
            self._part.commit()
        return size


class DeflatedReader(EventReader):
    """Reads an array from an archive that compresses it, from its beginning."""

    def __init__(self, path: str | os.PathLike[str], *, format: str, rules: ReadRules, member: str) -> None:
        super().__init__(path, format=format, rules=rules)
        self._member = member
        with zipfile.ZipFile(self.path) as archive, archive.open(member) as file:
            self._dtype, self._count = read_header(file, self.path, rules.max_packet_bytes)
        self._done = 0

    @property
    def events(self) -> int:
        return self._count

    @property
    def progress(self) -> float:
        return self._done / max(self._count, 1)

    def blocks(self) -> Blocks:
        refuse(self.path, "the archive is compressed")

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        self._done = 0
        budget = Budget(self.path)
        with zipfile.ZipFile(self.path) as archive, archive.open(self._member) as file:
            read_header(file, self.path, self.rules.max_packet_bytes)
            at_once = min(chunk, self.rules.max_packet_bytes // self._dtype.itemsize)
            while self._done < self._count:
                size = min(at_once, self._count - self._done) * self._dtype.itemsize
                with budget.borrow(2 * size, "a piece of the array"), decoding(self.path, f"after event {self._done}"):
                    data = file.read(size)
                    packet = np.frombuffer(bytearray(data), self._dtype, len(data) // self._dtype.itemsize)
                if not len(packet):
                    raise DecodeError(f"{self.path}: {self._member} holds {self._done} of {self._count} events")
                self._done += len(packet)
                yield to_events(packet, self.path)


class CutReader(NpyReader):
    """Reads what is left of an archive of :class:`NpzWriter` without its directory at the end."""

    def __init__(self, path: str | os.PathLike[str], *, format: str, rules: ReadRules) -> None:
        super().__init__(path, format=format, rules=rules, start=len(_local_header(0, 0)))

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        yield from super()._packets(chunk, start_us, stop_us)
        self._warn_cut()

    def blocks(self) -> Blocks:
        self._warn_cut()
        return equal_blocks(self.events, BLOCK)

    def _warn_cut(self) -> None:
        warn_truncated(self.path, f"the archive was cut, or never finished; {self.events} events are left")


class NpzFormat(Format):
    """Describes .npz archives of one array ``events`` of :data:`davis_rs.EVENT_DTYPE`, not compressed.

    The writer has no options. Archives of another single array of events, and compressed ones, are read too.

    Source: NumPy, ``numpy.savez``; PKWARE, APPNOTE.TXT.
    """

    name = "npz"
    suffixes = (".npz",)
    writer = NpzWriter
    states_size = False

    def sniff(self, head: bytes, path: Path) -> bool:
        return head.startswith(b"PK\x03\x04")

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> EventReader:  # noqa: B008
        file = Path(path)
        _charge_members(file)
        try:
            with zipfile.ZipFile(file) as archive:
                member = _events_of(archive, file)
        except zipfile.BadZipFile as error:
            if _is_ours(file):
                return CutReader(file, format=self.name, rules=rules)
            raise DecodeError(f"{file}: {error}") from None
        if member.flag_bits & 1:
            raise DecodeError(f"{file}: {member.filename} is encrypted")
        if member.compress_type == zipfile.ZIP_DEFLATED:
            return DeflatedReader(file, format=self.name, rules=rules, member=member.filename)
        # Others unpack without a limit, and NumPy does not write them.
        if member.compress_type != zipfile.ZIP_STORED:
            raise DecodeError(
                f"{file}: {member.filename} must be stored or deflated, not method {member.compress_type}"
            )
        with file.open("rb") as stream:
            stream.seek(member.header_offset)
            *_, name, extra = _LOCAL.unpack(stream.read(_LOCAL.size))
        start = member.header_offset + _LOCAL.size + name + extra
        return NpyReader(file, format=self.name, rules=rules, start=start, end=start + member.file_size)


def _charge_members(path: Path) -> None:
    """Charge the archive's list of members, all of which ``zipfile`` makes objects of, before it does so.

    Raises:
        DecodeError: if the file's budget does not hold it.
    """
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _END_LENGTH - 76))
        tail = file.read()
    end, end_64 = tail.rfind(_END), tail.rfind(_END_64)
    if 0 <= end <= len(tail) - 22:
        length = int.from_bytes(tail[end + 12 : end + 16], "little")
        if length == _LATER and 0 <= end_64 <= len(tail) - 48:
            length = int.from_bytes(tail[end_64 + 40 : end_64 + 48], "little")
        Budget(path).take(min(length, size) // _MEMBER * _MEMBER_HELD, "the list of the archive's members")


def _events_of(archive: zipfile.ZipFile, path: Path) -> zipfile.ZipInfo:
    members = archive.infolist()
    chosen = [member for member in members if member.filename == _NAME.decode()] or members
    if len(chosen) != 1:
        names = ", ".join(member.filename for member in members)
        raise DecodeError(f"{path}: expected one array of events, named events; found {names or 'none'}")
    return chosen[0]


def _is_ours(path: Path) -> bool:
    """Return whether the file begins as those of :class:`NpzWriter` do, whatever is said of sizes."""
    with path.open("rb") as file:
        begin, whole = file.read(_LOCAL.size + len(_NAME)), _local_header(0, 0)
    return begin[:14] == whole[:14] and begin[18:] == whole[18 : len(begin)]


def _local_header(crc: int, size: int) -> bytes:
    sizes = struct.pack("<2H2Q", 1, 16, size, size)
    fields = (45, 0, zipfile.ZIP_STORED, *_DATE, crc, _LATER, _LATER, len(_NAME), len(sizes))
    return _LOCAL.pack(b"PK\x03\x04", *fields) + _NAME + sizes


def _directory(crc: int, size: int, position: int) -> bytes:
    """Return the central directory, which begins at ``position``, and its two ends, of 64 and of 32 bits."""
    sizes = struct.pack("<2H2Q", 1, 16, size, size)
    fields = (45, 45, 0, zipfile.ZIP_STORED, *_DATE, crc, _LATER, _LATER, len(_NAME), len(sizes), 0, 0, 0, 0, 0)
    entry = struct.pack("<4s6H3L5H2L", b"PK\x01\x02", *fields) + _NAME + sizes
    end = position + len(entry)
    return b"".join(
        [
            entry,
            struct.pack("<4sQ2H2L4Q", b"PK\x06\x06", 44, 45, 45, 0, 0, 1, 1, len(entry), position),
            struct.pack("<4sLQL", b"PK\x06\x07", 0, end, 1),
            struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 1, 1, len(entry), _LATER, 0),
        ]
    )
