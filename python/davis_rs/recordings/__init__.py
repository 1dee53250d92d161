"""Recordings by other software, in the formats AEDAT 2.0 (jAER), 3.1 (cAER) and 4 (DV), as the decoder's arrays.

Source: docs.inivation.com, AEDAT file formats; jAER's and libcaer's public sources for what those leave open.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path

from .._core import DecodeError
from . import aedat2, aedat3, aedat4
from .recording import Recording, RecordingWarning

__all__ = ["Recording", "RecordingWarning", "read_recording"]

_READERS = {
    aedat2.MAGIC: aedat2.read,
    aedat3.MAGIC: aedat3.read,
    aedat4.MAGIC: aedat4.read,
}


def read_recording(
    path: str | os.PathLike[str],
    *,
    chip: str | None = None,
    accelerometer_range_g: int | None = None,
    gyroscope_range_deg_s: int | None = None,
) -> Recording:
    """Read a recording; its contents say in which format.

    A record that the end of the file cuts off is reported by a :class:`RecordingWarning`, and the rest returned. The
    file is held in memory while it is read; a packet of AEDAT 4 may unpack to 64 MiB.

    Args:
        path: AEDAT 2.0, 3.1 (format RAW) or 4. AEDAT 4 with compression needs ``pip install davis_rs[aedat]``.
        chip: the camera, such as ``"DAVIS346B"``, where the file does not name it or is wrong.
        accelerometer_range_g: full scale in g (2, 4, 8 or 16) of an AEDAT 2.0 file, which holds only counts. If not
            given, what the file's copy of jAER's preferences says, or jAER's default, 8. Other formats hold units.
        gyroscope_range_deg_s: likewise in deg/s (250, 500, 1000 or 2000); jAER's default is 1000.

    Raises:
        OSError: if it cannot be read.
        DecodeError: if it is none of these formats or malformed, with the byte.
        ValueError: for a chip or a range that there is not.
        ModuleNotFoundError: for a compressed file without the extra.
    """
    path = Path(path)
    data = path.read_bytes()
    read = next((read for magic, read in _READERS.items() if data.startswith(magic)), None)
    if read is None:
        known = ", ".join(magic.decode() for magic in _READERS)
        raise DecodeError(f"{path}, byte 0: expected one of {known}, found {data[:12]!r}")
    recording = read(
        path,
        data,
        chip=chip,
        accelerometer_range_g=accelerometer_range_g,
        gyroscope_range_deg_s=gyroscope_range_deg_s,
    )
    for cut in recording.cut:
        warnings.warn(f"{path}, {cut}", RecordingWarning, stacklevel=2)
    return recording
