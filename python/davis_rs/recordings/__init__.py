"""Recordings by other software, in the formats AEDAT 2.0 (jAER), 3.1 (cAER) and 4 (DV), as the decoder's arrays.

Source: docs.inivation.com, AEDAT file formats; jAER's and libcaer's public sources for what those leave open.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable

from .._core import DecodeError
from ..close_names import names_checked
from ..untrusted import MAX_PACKET_BYTES, check_max_packet_bytes, regular_file
from . import aedat2, aedat3, aedat4
from .recording import Recording, RecordingWarning

__all__ = ["Recording", "RecordingWarning", "read_recording"]

_READERS: dict[bytes, Callable[..., Recording]] = {
    aedat2.MAGIC: aedat2.read,
    aedat3.MAGIC: aedat3.read,
    aedat4.MAGIC: aedat4.read,
}


_HEAD = 16
"""Bytes that tell the format, and are shown where they do not."""


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
        path: AEDAT 2.0, 3.1 (format RAW) or 4.
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
    with path.open("rb") as file:
        head = file.read(_HEAD)
    read = next((read for magic, read in _READERS.items() if head.startswith(magic)), None)
    if read is None:
        known = ", ".join(magic.decode().strip() for magic in _READERS)
        raise DecodeError(f"{path}, byte 0: expected one of {known}, found {head!r}")
    recording = read(
        path,
        chip=chip,
        accelerometer_range_g=accelerometer_range_g,
        gyroscope_range_deg_s=gyroscope_range_deg_s,
        max_packet_bytes=check_max_packet_bytes(max_packet_bytes),
    )
    for cut in recording.cut:
        warnings.warn(f"{path}, {cut}", RecordingWarning, stacklevel=3)
    return recording
