"""The reader's thread and its queue: whole words, in order, all of them or counted."""

from __future__ import annotations

import errno
import time
from array import array

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs.usb.stream_gap import gap_words
from davis_rs.usb.stream_reader import StreamReader


class Pieces:
    """A receiver whose transfers are given; then the camera is gone."""

    def __init__(self, pieces: list[bytes]) -> None:
        self.pieces = list(pieces)

    def receive(self, buffer: array[int], timeout_s: float) -> bytes:
        if not self.pieces:
            raise OSError(errno.ENODEV, "unplugged")
        return self.pieces.pop(0)


def take_all(reader: StreamReader) -> list[tuple[bytes, int]]:
    chunks = []

    def take() -> None:
        while (chunk := reader.take(5)) is not None:
            chunks.append((chunk.data, chunk.lost_bytes))

    with pytest.raises(OSError, match="unplugged"):
        take()
    return chunks


@given(st.lists(st.binary(max_size=7)))
def test_words_stay_whole(pieces: list[bytes]) -> None:
    """Transfers may end within a word, and may be empty; chunks do not, and are never empty."""
    reader = StreamReader(Pieces(pieces))
    reader.start()
    chunks = take_all(reader)
    stream = b"".join(pieces)
    assert b"".join(data for data, _ in chunks) == stream[: len(stream) // 2 * 2]
    assert all(data and len(data) % 2 == lost == 0 for data, lost in chunks)
    assert reader.received_bytes == len(stream) // 2 * 2


@given(st.lists(st.binary(max_size=6).map(lambda data: data * 2), max_size=8), st.integers(0, 30))
def test_a_full_queue_loses_what_comes_and_counts_it(pieces: list[bytes], queue_bytes: int) -> None:
    """First come, first kept; one gap for what is lost in a row, with the words that later data hang on."""
    reader = StreamReader(Pieces(pieces), queue_bytes=queue_bytes)
    reader.start()
    while reader.received_bytes < sum(map(len, pieces)):
        time.sleep(0.001)
    expected: list[tuple[bytes, int]] = []
    for piece in filter(None, pieces):
        if sum(len(data) for data, _ in expected) + len(piece) <= queue_bytes:
            expected.append((piece, 0))
        elif expected and expected[-1][1]:
            data, lost = expected.pop()
            expected.append((gap_words(data + piece), lost + len(piece)))
        else:
            expected.append((gap_words(piece), len(piece)))
    assert take_all(reader) == expected
    assert reader.lost_bytes == sum(lost for _, lost in expected)


def test_silence_and_the_end_are_told_apart() -> None:
    """An empty chunk while nothing comes, None once reading was stopped and all is taken."""

    class Silence:
        def receive(self, buffer: array[int], timeout_s: float) -> bytes:
            time.sleep(0.01)
            return b""

    reader = StreamReader(Silence())
    reader.start()
    assert reader.take(0.05) == (b"", 0)
    reader.stop()
    assert reader.take(0.05) is None


def test_a_transfer_fills_its_buffer() -> None:
    """Large ones, so that the system always has requests to fill."""

    class Counting:
        sizes: list[int] = []  # noqa: RUF012

        def receive(self, buffer: array[int], timeout_s: float) -> bytes:
            self.sizes.append(len(buffer))
            if len(self.sizes) == 3:
                raise OSError(errno.ENODEV, "unplugged")
            return np.full(len(buffer) // 2, 0x8001, "<u2").tobytes()

    reader = StreamReader(Counting())
    reader.start()
    assert [len(data) for data, _ in take_all(reader)] == [1 << 17, 1 << 17]
