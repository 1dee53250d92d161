"""Packs and unpacks messages of events in CDR: ``dvs_msgs/EventArray`` and ``event_camera_msgs/EventPacket``."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError, Evt3Stream, fill_events, pack_evt3
from ...events.arrays import EVENT_DTYPE, EventArray
from . import ros_messages as messages

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

LATEST_US = 2**31 * 1_000_000 - 1
"""ROS 2 counts seconds by 32 bits with a sign."""

_ENCAPSULATION = 4
_ROUND_US = 1 << 24
"""EVT 3.0 writes times modulo this."""

_FROM_STAMP = np.dtype(
    {
        "names": ["sec", "nanosec", "p", "next_x", "next_y"],
        "formats": ["<i4", "<u4", "u1", "<u2", "<u2"],
        "offsets": [0, 4, 8, 10, 12],
        "itemsize": 16,
    }
)
"""An event is x, y, seconds, nanoseconds, polarity: 13 bytes, of which CDR aligns shorts to 2 and words to 4 bytes. The
first one begins at a multiple of 4 and has no gap before its stamp, all others do. So from stamp to stamp there are
always 16 bytes, and x and y of an event lie behind the polarity of the one before it."""
_AFTER_LAST = 7
"""Bytes of the last such record that a message does not have."""


def pack_event_array(events: EventArray, size: tuple[int, int], frame_id: str) -> bytes:
    """Return a ``dvs_msgs/EventArray`` of at least one event, stamped with the last one's time.

    Source: OMG DDSI-RTPS 2.3, chapter 10 (encapsulation, CDR_LE); rpg_dvs_ros, dvs_msgs/msg.
    """
    t_us = events["t"]
    name = frame_id.encode() + b"\0"
    seconds, microseconds = divmod(int(t_us[-1]), 1_000_000)
    head = struct.pack("<iII", seconds, microseconds * 1000, len(name)) + name
    head += bytes(-len(head) % 4)
    first = struct.pack("<IIIHH", size[1], size[0], len(events), int(events["x"][0]), int(events["y"][0]))
    records = np.zeros(len(events), _FROM_STAMP)
    records["sec"] = t_us // 1_000_000
    records["nanosec"] = t_us % 1_000_000 * 1000
    records["p"] = events["p"]
    records["next_x"][:-1], records["next_y"][:-1] = events["x"][1:], events["y"][1:]
    return b"\0\1\0\0" + head + first + records.tobytes()[:-_AFTER_LAST]


def unpack_event_array(path: Path, data: bytes) -> tuple[EventArray, tuple[int, int]]:
    """Return the events of a ``dvs_msgs/EventArray`` and the sensor's (width, height); times to the nearest
    microsecond.

    Raises:
        DecodeError: where the message breaks its definition.
    """
    if len(data) < _ENCAPSULATION or data[0] != 0 or data[1] not in (0, 1):
        raise _broken(path, f"it must begin with CDR's 00 00 or 00 01, found {data[:2]!r}")
    order: Literal["<", ">"] = "<" if data[1] else ">"
    body = memoryview(data)[_ENCAPSULATION:]
    try:
        (length,) = struct.unpack_from(f"{order}I", body, 8)
        start = 12 + length
        start += -start % 4
        height, width, count = struct.unpack_from(f"{order}III", body, start)
    except struct.error as error:
        raise _broken(path, f"it ends in its head ({error})") from None
    start += 12
    if max(height, width) > 65_535:
        raise _broken(path, f"a sensor's side must be 0..65535 pixels, found {width} x {height}")
    rest, needed = len(body) - start, 16 * count - 3 if count else 0
    if not needed <= rest < needed + 8:  # some writers fill up to a multiple of 4 or 8
        raise _broken(path, f"{count} events need {needed} bytes, found {rest}")
    if not count:
        return np.zeros(0, EVENT_DTYPE), (width, height)
    records = np.frombuffer(
        bytes(body[start + 4 : start + needed]) + bytes(_AFTER_LAST), _FROM_STAMP.newbyteorder(order)
    )
    x, y = np.empty(count, np.uint16), np.empty(count, np.uint16)
    x[0], y[0] = struct.unpack_from(f"{order}HH", body, start)
    x[1:], y[1:] = records["next_x"][:-1], records["next_y"][:-1]
    p, nanosec = records["p"].copy(), records["nanosec"]
    for wrong, rule in (
        (p > 1, "polarity must be 0 or 1"),
        (nanosec >= 1_000_000_000, "nanoseconds must be less than a second"),
    ):
        if wrong.any():
            raise _broken(path, f"{rule} (event {int(wrong.argmax())})")
    t_us = records["sec"].astype(np.int64) * 1_000_000 + (nanosec.astype(np.int64) + 500) // 1000
    return _filled(t_us, x, y, p), (width, height)


def packet_message(store: Typestore, events: EventArray, size: tuple[int, int], sequence: int, frame_id: str) -> Any:
    """Return an ``event_camera_msgs/EventPacket`` of at least one event, encoded as EVT 3.0.

    It begins with the high part of its first event's time, which is also the header's stamp, so that it can be decoded
    without those before it. ``time_base`` is that time without its low 24 bits, in nanoseconds.

    Source: ros-event-camera/event_camera_msgs, README.
    """
    first_us = int(events["t"][0])
    return store.types[messages.EVENT_PACKETS](
        header=messages.header(store, sequence % 2**32, first_us, frame_id),
        height=size[1],
        width=size[0],
        seq=sequence,
        time_base=(first_us - first_us % _ROUND_US) * 1000,
        encoding="evt3",
        is_bigendian=False,
        events=np.frombuffer(pack_evt3(events), np.uint8),
    )


class PacketDecoder:
    """Decodes the ``event_camera_msgs/EventPacket`` of one stream, one after the other.

    Packets of cameras begin in the middle of EVT 3.0's state, so it goes on from packet to packet. Times are the
    sensor's, moved such that the first event has its packet's stamp. Rounds of its 24 bits that no packet shows are
    told from the stamps.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stream = Evt3Stream()
        self._offset_us: int | None = None

    def unpack(self, message: Any) -> tuple[EventArray, tuple[int, int]]:
        """Return the events of the next message and the sensor's (width, height).

        Raises:
            DecodeError: for an encoding other than evt3, or a packet of an odd length.
        """
        width, height = int(message.width), int(message.height)
        if message.encoding != "evt3":
            raise DecodeError(f"{self._path}: event packets in {message.encoding!r}: only evt3 is read")
        if max(width, height) > 65_535 or message.events.size % 2:
            raise DecodeError(
                f"{self._path}: a packet of {message.events.size} bytes of a sensor of {width} x {height} pixels is no "
                "EVT 3.0"
            )
        words = message.events.view(np.uint16).byteswap().view(np.uint8) if message.is_bigendian else message.events
        events = self._stream.push(words.tobytes())
        if len(events):
            stamp_us, first_us = messages.stamp_us(message.header.stamp), int(events["t"][0])
            if self._offset_us is None:
                self._offset_us = stamp_us - first_us
            else:
                rounds = (stamp_us - first_us - self._offset_us + _ROUND_US // 2) // _ROUND_US
                self._offset_us += max(0, rounds) * _ROUND_US
            events["t"] += self._offset_us
        return events, (width, height)


def _filled(
    t_us: npt.NDArray[np.int64], x: npt.NDArray[np.uint16], y: npt.NDArray[np.uint16], p: npt.NDArray[np.uint8]
) -> EventArray:
    events = np.zeros(len(t_us), EVENT_DTYPE)
    fill_events(events, t_us, x, y, p)
    return events


def _broken(path: Path, rule: str) -> DecodeError:
    return DecodeError(f"{path}: dvs_msgs/EventArray: {rule}")
