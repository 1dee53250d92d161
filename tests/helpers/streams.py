"""Streams of cameras to test with: random contents, and the words a DAVIS would send for them."""

from __future__ import annotations

import errno
from array import array

import numpy as np

import davis_rs
from davis_rs.usb.virtual_backend import VirtualBackend
from davis_rs.usb.virtual_davis import VirtualDavis

CHIPS = ("DAVIS240C", "DAVIS346B")

# As libcaer writes them, in the numbers of the registers: (module, parameter).
SENSORS = [(1, 3), (2, 4), (3, 2), (3, 3), (3, 4), (4, 0)]
STOP = [(*register, 0) for register in [*SENSORS, (0, 0), (0, 1), (9, 0), (0, 3)]]
START = [
    *STOP,
    "clear halt",
    "reading",
    (0, 3, 1),
    *[(9, 0, 1), (0, 1, 1), (0, 0, 1)],
    *[(*register, 1) for register in SENSORS],
]


def contents(chip: str, *, seed: int = 0, events: int = 20_000, duration_us: int = 300_000) -> davis_rs.Decoded:
    """Events, samples every millisecond, two frames and some triggers, in whole microseconds from 1 on."""
    rng = np.random.default_rng(seed)
    device = davis_rs.Device(chip)
    stream = np.zeros(events, davis_rs.EVENT_DTYPE)
    stream["t"] = np.sort(rng.integers(1, duration_us, events))
    stream["x"] = rng.integers(0, device.width, events)
    stream["y"] = rng.integers(0, device.height, events)
    stream["p"] = rng.integers(0, 2, events)
    imu = np.zeros(duration_us // 1000 - 1, davis_rs.IMU_COUNTS_DTYPE)
    imu["t"] = 1000 * (1 + np.arange(len(imu)))
    imu["accel"], imu["gyro"] = rng.integers(-32768, 32768, (2, len(imu), 3))
    imu["temperature"] = rng.integers(-32768, 32768, len(imu))
    imu["groups"], imu["accel_range"], imu["gyro_range"] = 7, 1, 1
    triggers = np.zeros(5, davis_rs.TRIGGER_DTYPE)
    triggers["t"] = np.sort(rng.integers(1, duration_us, 5))
    triggers["kind"] = davis_rs.TriggerKind.INPUT_RISING
    frames = []
    for start_us in (duration_us // 10, duration_us // 2):
        # Nine bits, so that DAVIS240 chips, which count double, can send them.
        pixels = (rng.integers(0, 511, (device.frame_height, device.frame_width)) * 128).astype(np.uint16)
        times = (start_us, start_us + 50, start_us + 4050, start_us + 9000)
        frames.append(davis_rs.Frame(*times, 0, 0, pixels, exposure_us=4000.0))
    return davis_rs.Decoded(stream, imu, frames, triggers)


def encode(chip: str, sent: davis_rs.Decoded) -> bytes:
    return davis_rs.Encoder(chip).encode(*sent)


def decode(chip: str, words: bytes) -> davis_rs.Decoded:
    return davis_rs.Decoder(chip, imu_counts=True).push(words)


def assert_same(found: davis_rs.Decoded, expected: davis_rs.Decoded) -> None:
    for kind in ("events", "triggers", "imu"):
        np.testing.assert_array_equal(getattr(found, kind), getattr(expected, kind), kind)
    assert len(found.frames) == len(expected.frames)
    for frame, other in zip(found.frames, expected.frames, strict=True):
        assert frame[:6] == other[:6]
        np.testing.assert_array_equal(frame.pixels, other.pixels)


def is_empty(packet: davis_rs.Decoded) -> bool:
    return not (len(packet.events) or len(packet.imu) or len(packet.frames) or len(packet.triggers))


def join(packets: list[davis_rs.Decoded]) -> davis_rs.Decoded:
    return davis_rs.Decoded(
        np.concatenate([packet.events for packet in packets]),
        np.concatenate([packet.imu for packet in packets]),
        [frame for packet in packets for frame in packet.frames],
        np.concatenate([packet.triggers for packet in packets]),
    )


class TornBackend(VirtualBackend):
    """Pulls the camera out amid a transfer, as libusb may show it: data in the buffer, any error, no length."""

    def __init__(self, camera: VirtualDavis, *, after: int) -> None:
        super().__init__(camera)
        self.after = after

    def bulk_read(self, handle: VirtualDavis, endpoint: int, interface: int, buffer: array[int], timeout: int) -> int:
        from usb.core import USBError

        count = super().bulk_read(handle, endpoint, interface, buffer, timeout)
        if len(handle.sent) >= self.after:
            handle.unplug()
            raise USBError("input/output error", None, errno.EIO)
        return count
