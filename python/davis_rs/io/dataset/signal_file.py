"""Writes and reads the labels of a dataset folder's events, signal or noise: ``signal.npy``, bool, one an event."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.budget import Budget
from ..._util.untrusted import decoding, read_charged
from ...events.packet import Packet
from ...events.signal_labels import SignalLabels
from ..formats.destination import naming
from ..formats.npy import npy_header


class SignalFile:
    """Labels the events of packets, and writes the labels as they are decided, in memory that does not grow.

    A label is decided some time after its event. So the file of a writer that was killed reads as the labels of the
    first events; a writer that is closed has labelled all.

    Args:
        path: a file that does not exist.
        size, window_us: as of :class:`~davis_rs.SignalLabels`.

    Raises:
        OSError: if it cannot be written.
    """

    def __init__(self, path: Path, size: tuple[int, int], window_us: int) -> None:
        self._labels = SignalLabels(size, window_us=window_us)
        with naming(path):
            self._file = path.open("xb")
        self._path = path
        self._append(np.zeros(0, np.bool_))

    @property
    def count(self) -> int:
        """Return how many events are labelled as signal."""
        return self._labels.signal

    def write(self, packet: Packet) -> None:
        """Take a packet, which has ``noiseless`` events."""
        self._append(self._labels.add(packet.events, packet.noiseless, packet.end_us))

    def close(self) -> None:
        """Label the events that still wait, and close the file."""
        try:
            self._append(self._labels.finish())
        finally:
            self._file.close()

    def _append(self, labels: npt.NDArray[np.bool_]) -> None:
        with naming(self._path):
            self._file.seek(0, os.SEEK_END)
            self._file.write(labels.tobytes())
            self._file.seek(0)
            self._file.write(npy_header(self._labels.signal + self._labels.noise, np.dtype(np.bool_)))
            self._file.flush()


def read_signal(path: Path) -> npt.NDArray[np.bool_]:
    """Return the labels of a folder's first events, or of all: bool (n,), True for signal.

    Raises:
        OSError, DecodeError: if they cannot be read.
    """
    data = read_charged(path, Budget(path))
    with decoding(path):
        stream = io.BytesIO(data)
        np.lib.format.read_magic(stream)
        shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
        labels = np.frombuffer(data, np.uint8, offset=stream.tell())
    if dtype != np.bool_ or len(shape) != 1 or shape[0] > len(labels) or labels.max(initial=0) > 1:
        raise DecodeError(f"{path}: expected bool (n,), found {dtype} {shape} in {len(labels)} bytes")
    return labels[: shape[0]].view(np.bool_)
