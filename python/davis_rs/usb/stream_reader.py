"""Reads a camera in a thread of its own, so that transfers go on while the program does something else."""

from __future__ import annotations

import threading
import time
from array import array
from collections import deque
from typing import NamedTuple, Protocol

from .stream_gap import gap_words

TRANSFER_BYTES = 1 << 17
"""The system splits a transfer into several requests that it queues all at once: so there is no gap within one."""
TRANSFER_TIMEOUT_S = 0.1
QUEUE_BYTES = 1 << 26


class Receiver(Protocol):
    """What gives the data: :class:`davis_rs.usb.link.UsbLink`."""

    def receive(self, buffer: array[int], timeout_s: float) -> bytes:
        """Make one transfer, and return its bytes, none after a timeout."""


class Chunk(NamedTuple):
    """Whole words of the stream, in order; ``lost_bytes`` is how many this chunk stands for that could not be kept."""

    data: bytes
    lost_bytes: int


class StreamReader:
    """Moves data from a receiver into a bounded queue.

    When the queue is full, what arrives is lost and counted; of it only what the decoding of later data needs is kept
    (:func:`davis_rs.usb.stream_gap.gap_words`: two bytes for each 33 ms).

    Args:
        receiver: is read from by the reader's thread only.
        queue_bytes: how much may wait to be taken.

    Attributes:
        received_bytes: what the transfers brought, lost or not.
        lost_bytes: what was lost because nobody took it in time.
    """

    def __init__(self, receiver: Receiver, *, queue_bytes: int = QUEUE_BYTES) -> None:
        self.received_bytes = 0
        self.lost_bytes = 0
        self._receiver = receiver
        self._limit = queue_bytes
        self._queue: deque[Chunk] = deque()
        self._queued_bytes = 0
        self._error: Exception | None = None
        self._stopping = False
        self._ended = False
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="davis-reader", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def stop(self) -> None:
        """End reading, after the transfer under way; what is in the queue stays there."""
        with self._change:
            self._stopping = True
        self._thread.join()

    def take(self, timeout_s: float) -> Chunk | None:
        """Return the next chunk; an empty one after the timeout, None when reading was stopped and all is taken.

        Raises:
            OSError: when reading has failed and all that came before is taken.
        """
        deadline = time.monotonic() + timeout_s
        with self._change:
            while not self._queue:
                if self._error is not None:
                    raise self._error
                if self._ended:
                    return None
                left = deadline - time.monotonic()
                if left <= 0:
                    return Chunk(b"", 0)
                self._change.wait(left)
            chunk = self._queue.popleft()
            self._queued_bytes -= len(chunk.data)
            return chunk

    def _run(self) -> None:
        buffer = array("B", bytes(TRANSFER_BYTES))
        odd = b""
        try:
            while not self._stopping:
                data = odd + self._receiver.receive(buffer, TRANSFER_TIMEOUT_S)
                whole = len(data) & ~1
                odd = data[whole:]
                if whole:
                    self._put(data[:whole])
        except Exception as error:  # whatever it is, it belongs to the one who takes the data
            self._error = error
        finally:
            with self._change:
                self._ended = True
                self._change.notify_all()

    def _put(self, data: bytes) -> None:
        with self._change:
            self.received_bytes += len(data)
            if self._queued_bytes + len(data) <= self._limit:
                chunk = Chunk(data, 0)
            else:
                self.lost_bytes += len(data)
                before = Chunk(b"", 0)
                if self._queue and self._queue[-1].lost_bytes:
                    before = self._queue.pop()
                    self._queued_bytes -= len(before.data)
                chunk = Chunk(gap_words(before.data + data), before.lost_bytes + len(data))
            self._queue.append(chunk)
            self._queued_bytes += len(chunk.data)
            self._change.notify()
