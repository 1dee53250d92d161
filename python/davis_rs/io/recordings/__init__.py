"""Reads recordings of cameras: AEDAT 2.0 (jAER), 3.1 (cAER) and 4 (DV), and a camera's own bytes.

Source: docs.inivation.com, AEDAT file formats; jAER's and libcaer's public sources for what those leave open.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta, timezone

import numpy as np

from ..._core import DecodeError
from ..._util.close_names import names_checked
from ..._util.untrusted import MAX_PACKET_BYTES, check_max_packet_bytes, regular_file
from ...events.arrays import concatenate_events
from . import aedat2, aedat3, aedat4, camera_bytes
from .recording import Recording, RecordingWarning, inside, spanned
from .recording_file import EMPTY, RecordingFile, Remarks

__all__ = ["Recording", "RecordingWarning", "read_recording"]

_FILES: dict[bytes, Callable[..., RecordingFile]] = {
    aedat2.MAGIC: aedat2.Aedat2File,
    aedat3.MAGIC: aedat3.Aedat3File,
    aedat4.MAGIC: aedat4.Aedat4File,
    camera_bytes.MAGIC: camera_bytes.CameraBytesFile,
}


_HEAD = 16
"""Bytes that tell the format, and are shown where they do not."""

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


@names_checked
def read_recording(
    path: str | os.PathLike[str],
    *,
    chip: str | None = None,
    accelerometer_range_g: int | None = None,
    gyroscope_range_deg_s: int | None = None,
    max_packet_bytes: int = MAX_PACKET_BYTES,
) -> Recording:
    """Read a recording; its contents say in which format.

    A record that the end of the file cuts off is reported by a :class:`RecordingWarning`, and the rest returned.

    Args:
        path: AEDAT 2.0, 3.1 (format RAW) or 4, or a camera's bytes (:class:`davis_rs.RawWriter`).
        chip: the camera, such as ``"DAVIS346B"``, where the file does not name it or is wrong.
        accelerometer_range_g: full scale in g (2, 4, 8 or 16) of an AEDAT 2.0 file, which holds only counts. If not
            given, what the file's copy of jAER's preferences says, or jAER's default, 8. Other formats hold units.
        gyroscope_range_deg_s: likewise in deg/s (250, 500, 1000 or 2000); jAER's default is 1000.
        max_packet_bytes: what a packet of AEDAT 4 may unpack to, 64 MiB if not given.

    Raises:
        OSError: if it cannot be read, or is no regular file.
        DecodeError: if it is none of these formats or malformed, with the byte.
        ValueError: for a chip or a range that there is not.
    """
    path = regular_file(path)
    with path.open("rb") as opened:
        head = opened.read(_HEAD)
    read = next((file for magic, file in _FILES.items() if head.startswith(magic)), None)
    if read is None:
        known = ", ".join(magic.decode().strip() for magic in _FILES)
        raise DecodeError(
            f"{path}, byte 0: expected one of {known}, found {head!r} (davis_rs.read_events reads event files)"
        )
    file = read(
        path,
        chip=chip,
        accelerometer_range_g=accelerometer_range_g,
        gyroscope_range_deg_s=gyroscope_range_deg_s,
        max_packet_bytes=check_max_packet_bytes(max_packet_bytes),
    )
    return whole_recording(file)


def whole_recording(file: RecordingFile) -> Recording:
    """Read all that a file holds into memory; a :class:`RecordingWarning` tells of a cut end."""
    remarks, notes = Remarks(), list[str]()
    decoded = [piece.decoded for piece in file.pieces(remarks=remarks)]
    for cut in remarks.cut:
        warnings.warn(f"{file.path}, {cut}", RecordingWarning, stacklevel=4)
    events = concatenate_events([piece.events for piece in decoded])
    width, height = file.size or spanned(events)
    events = inside(events, width, height, notes)
    recording = Recording(
        path=file.path, format=file.format, chip=file.chip, width=width, height=height,
        events=events, imu=np.concatenate([EMPTY.imu, *(piece.imu for piece in decoded)]),
        frames=[frame for piece in decoded for frame in piece.frames],
        triggers=np.concatenate([EMPTY.triggers, *(piece.triggers for piece in decoded)]), started=file.started,
        accelerometer_range_g=file.accelerometer_range_g, gyroscope_range_deg_s=file.gyroscope_range_deg_s,
        cut=tuple(remarks.cut), notes=(*notes, *remarks.notes),
    )  # fmt: skip
    return replace(recording, started=_date(recording.start_us)) if file.unix_times else recording


def _date(us: int) -> datetime | None:
    """Return the date of microseconds since 1970, if there is one."""
    try:
        return _EPOCH + timedelta(microseconds=us) if us else None
    except OverflowError:
        return None
