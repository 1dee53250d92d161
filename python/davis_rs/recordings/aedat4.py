"""AEDAT 4, DV's format, as the Rust core reads it; what a recording says beyond the arrays is put together here.

Source: docs.inivation.com, AEDAT 4.0; the schemas of dv-processing.
"""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

from .._core import read_aedat4
from .recording import Recording, inside, known_chip, size_of

MAGIC = b"#!AER-DAT4.0\r\n"

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


def read(path: Path, *, chip: str | None, max_packet_bytes: int, **_: Any) -> Recording:
    """Read a file; see :func:`davis_rs.read_recording`."""
    parts = read_aedat4(path, max_packet_bytes)
    events = parts["events"]
    chip = known_chip(chip, parts["source"])
    width, height = size_of(chip, events, parts["size"] or (0, 0))
    notes: list[str] = []
    events = inside(events, width, height, notes)
    if others := parts["other_packets"]:
        notes.append(f"{others} packets of other streams left out; read is the first of each kind")
    recording = Recording(
        path=path, format="AEDAT 4", chip=chip, width=width, height=height,
        events=events, imu=parts["imu"], frames=parts["frames"], triggers=parts["triggers"],
        cut=() if parts["cut"] is None else (parts["cut"],), notes=tuple(notes),
    )  # fmt: skip
    return replace(recording, started=_date(recording.start_us))


def _date(us: int) -> datetime | None:
    """The date of microseconds since 1970, if there is one."""
    try:
        return _EPOCH + timedelta(microseconds=us) if us else None
    except OverflowError:
        return None
