"""A live camera: everything above libusb, on virtual cameras."""

from __future__ import annotations

import errno
import itertools
import time
import warnings
from collections.abc import Callable

import numpy as np
import pytest

import davis_rs
from davis_rs import Davis, DavisSettings
from davis_rs.usb.protocol import Register, Write
from davis_rs.usb.virtual_backend import VirtualBackend
from davis_rs.usb.virtual_davis import VirtualDavis, paced
from streams import CHIPS, START, STOP, TornBackend, assert_same, contents, decode, encode, is_empty, join

FAST = 20e6
"""Bytes a second, so that tests are short."""


def camera(chip: str = "DAVIS240C", words: bytes = b"", **options: object) -> VirtualDavis:
    return VirtualDavis(paced(words, bytes_per_s=FAST), chip=chip, **options)  # type: ignore[arg-type]


def everything(davis: Davis, virtual: VirtualDavis) -> davis_rs.Decoded:
    """All that comes until the virtual camera has nothing more."""
    packets: list[davis_rs.Decoded] = []
    for packet in davis:
        packets.append(packet)
        if virtual.over.is_set() and is_empty(packet):
            davis.stop()
    return join(packets)


@pytest.mark.parametrize("chip", CHIPS)
def test_what_is_sent_is_what_arrives(chip: str) -> None:
    """Events, samples, frames and triggers, whatever the transfers cut the stream into; nothing odd, nothing lost."""
    sent = contents(chip)
    virtual = camera(chip, encode(chip, sent))
    with Davis.open(backend=VirtualBackend(virtual)) as davis:
        assert (davis.description.chip, davis.description.serial) == (chip, "VIRTUAL")
        got = everything(davis, virtual)
        assert davis.received_bytes == len(virtual.sent)
        assert davis.lost_bytes == 0
        assert not any(davis.stats.values())
    si_units = davis_rs.Decoder(chip).push(encode(chip, sent))
    assert_same(got, sent._replace(imu=si_units.imu))


def test_start_and_stop_in_the_order_of_the_vendor() -> None:
    """A sensor that is started before the way to the host is open loses data; libcaer's order is what cameras know."""
    virtual = camera(words=encode("DAVIS240C", contents("DAVIS240C")))
    with Davis.open(backend=VirtualBackend(virtual)) as davis:
        configured = len(virtual.log)
        davis.start()
        started = len(virtual.log)
        davis.start()
        davis.stop()
        davis.stop()
    assert [entry if isinstance(entry, str) else tuple(entry) for entry in virtual.log[configured:started]] == START
    assert virtual.log[started:] == STOP


@pytest.mark.parametrize("chip", CHIPS)
def test_the_configuration_is_the_vendors(chip: str) -> None:
    """The words that dv-processing 2.0 sends, in the cycles that the registers count in; before anything runs."""
    virtual = camera(chip)
    Davis.open(backend=VirtualBackend(virtual)).close()
    log = [tuple(entry) for entry in virtual.log if not isinstance(entry, str)]
    assert len({write[:2] for write in log}) == len(log)
    both = [(0, 4, 1), (0, 5, 1), (1, 31, 1), (1, 32, 8), (2, 5, 1), (2, 7, 1), (5, 142, 1), (2, 12, 120_000)]
    both += [
        (2, 13, 1_200_000),
        (3, 5, 0),
        (3, 6, 1),
        (3, 7, 1),
        (3, 10, 1),
        (4, 3, 1),
        (4, 4, 1),
        (2, 8, 0),
        (2, 9, 0),
    ]
    of_240 = [(5, 0, 17023), (5, 2, 16399), (5, 3, 23451), (5, 8, 9133), (5, 14, 31117), (5, 20, 33808), (5, 21, 33808)]
    of_240 += [(1, 11, 180), (1, 12, 240), (1, 26, 240), (2, 10, 239), (2, 11, 179), (4, 5, 900), (9, 1, 30_000)]
    of_346 = [
        (5, 0, 411),
        (5, 10, 17023),
        (5, 12, 16415),
        (5, 14, 9133),
        (5, 21, 25549),
        (5, 35, 33808),
        (5, 36, 33808),
    ]
    of_346 += [(2, 10, 259), (2, 11, 345), (4, 5, 1200), (9, 1, 80_000)]
    expected = both + (of_240 if chip == "DAVIS240C" else of_346)
    assert set(expected) <= set(log)
    order = [log.index(write) for write in both[:7]]
    assert order == sorted(order)
    assert log[0][0] == 5


@pytest.mark.parametrize("after", [100_000, 100_001, 512])
def test_unplugging_ends_the_iteration_after_what_arrived(after: int) -> None:
    """Nobody loses the seconds before the cable came out, and nobody takes the end for a quiet scene."""
    words = encode("DAVIS240C", contents("DAVIS240C"))
    virtual = camera(words=words, unplug_after=after)
    packets: list[davis_rs.Decoded] = []
    with Davis.open(backend=VirtualBackend(virtual)) as davis:
        with pytest.raises(OSError, match="unplugged") as error:
            packets.extend(davis)
        assert error.value.errno == errno.ENODEV
    expected = decode("DAVIS240C", words[: after // 2 * 2]).events
    np.testing.assert_array_equal(join(packets).events, expected)
    with pytest.raises(FileNotFoundError, match=r"no DAVIS camera on the USB$"):
        Davis.open(backend=VirtualBackend(virtual))


def test_a_transfer_torn_apart_gives_what_arrived_of_it() -> None:
    """libusb has the data in its buffer, but pyusb then tells an error and no length, and the error may be any."""
    words = encode("DAVIS240C", contents("DAVIS240C"))
    virtual = camera(words=words)
    got: list[bytes] = []
    with (
        Davis.open(backend=TornBackend(virtual, after=50_000)) as davis,
        pytest.raises(OSError, match="unplugged"),
    ):
        got.extend(davis.chunks())
    assert b"".join(got) == virtual.sent
    assert len(virtual.sent) >= 50_000


def test_a_timestamp_reset_starts_the_clock_anew() -> None:
    """The camera answers in the stream; what follows counts from zero and decodes like a fresh stream."""
    sent = contents("DAVIS240C")
    words = encode("DAVIS240C", sent)
    virtual = VirtualDavis(paced(words, bytes_per_s=5e5))
    packets: list[davis_rs.Decoded] = []
    with Davis.open(backend=VirtualBackend(virtual)) as davis:
        for packet in davis:
            packets.append(packet)
            if len(packets) == 5:
                davis.reset_timestamps()
            if virtual.over.is_set() and is_empty(packet):
                davis.stop()
    got = join(packets)
    at = bytes(virtual.sent).rindex(words) - 2
    assert virtual.sent[at : at + 2] == b"\x01\x00"
    before = decode("DAVIS240C", bytes(virtual.sent[:at]))
    np.testing.assert_array_equal(got.events, np.concatenate([before.events, sent.events]))
    assert 0 < len(before.events) < len(sent.events)
    assert list(got.triggers["kind"]).count(davis_rs.TriggerKind.TIMESTAMP_RESET) == 1


def test_a_slow_program_is_told_what_it_lost() -> None:
    """Losses are counted and warned of, and every event that is left has its right time and place."""
    chip = "DAVIS240C"
    sent = contents(chip, events=200_000)
    virtual = camera(chip, encode(chip, sent))
    packets: list[davis_rs.Decoded] = []
    with Davis.open(backend=VirtualBackend(virtual), queue_bytes=200_000) as davis, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        davis.start()
        while not virtual.over.is_set():
            time.sleep(0.01)
        for packet in davis:
            packets.append(packet)
            if is_empty(packet):
                davis.stop()
        lost, received = davis.lost_bytes, davis.received_bytes
    assert received == len(virtual.sent)
    assert received - 210_000 < lost < received
    got = join(packets)
    # The first ones are whole, because one transfer always fits in the queue; and none is one that was not sent.
    np.testing.assert_array_equal(got.events[:1000], sent.events[:1000])
    assert set(got.events.tolist()) <= set(sent.events.tolist())


def test_a_loss_warns() -> None:
    """Once for a gap, where it lies in the stream."""
    virtual = camera(words=encode("DAVIS240C", contents("DAVIS240C")))
    with Davis.open(backend=VirtualBackend(virtual), queue_bytes=0) as davis:
        davis.start()
        while not virtual.over.is_set():
            time.sleep(0.01)
        with pytest.warns(RuntimeWarning, match=r"[0-9]+ bytes of the stream of camera DAVIS240C VIRTUAL were lost"):
            next(iter(davis))
        assert davis.lost_bytes == davis.received_bytes


def test_a_stopped_camera_gives_what_is_left_and_starts_again() -> None:
    """The second run is a stream of its own, with a clock that starts at zero."""
    sent = contents("DAVIS240C")
    virtual = camera(words=encode("DAVIS240C", sent))
    with Davis.open(backend=VirtualBackend(virtual)) as davis:
        assert davis.stats == {}
        with pytest.raises(ValueError, match="never started"):
            davis.decode(b"")
        first = everything(davis, virtual)
        np.testing.assert_array_equal(first.events, sent.events)
        assert not davis.running
        second = everything(davis, virtual)
        np.testing.assert_array_equal(second.events, sent.events)


def writes_of(virtual: VirtualDavis, act: Callable[[], object]) -> list[Write]:
    """What an act writes into the camera."""
    before = len(virtual.log)
    act()
    return [entry for entry in virtual.log[before:] if isinstance(entry, Write)]


def test_settings_change_while_it_runs() -> None:
    """By name, in physical units, and only what differs is written."""
    virtual = camera("DAVIS346B")
    with Davis.open(backend=VirtualBackend(virtual)) as davis:
        davis.start()
        assert writes_of(virtual, lambda: davis.configure(exposure_us=2500)) == [(2, 12, 75_000)]
        assert writes_of(virtual, lambda: davis.configure(exposure_us=2500)) == []
        # On this chip columns of the read-out are rows of the image.
        assert writes_of(virtual, lambda: davis.configure(region=(20, 10, 100, 50))) == [
            *[(2, 8, 10), (2, 9, 20), (2, 10, 59), (2, 11, 119)],
        ]
        ranges = {"accelerometer_range_g": 16, "gyroscope_range_deg_s": 2000}
        assert writes_of(virtual, lambda: davis.configure(**ranges)) == [(3, 7, 3), (3, 10, 3)]
        assert writes_of(virtual, lambda: davis.set_bias("PrBp", 3, 72)) == [(5, 14, 3 << 12 | 72 << 4 | 0b1101)]
        outdoors = writes_of(virtual, lambda: davis.configure(biases="outdoors"))
        assert [write.register for write in outdoors] == [Register(5, address) for address in (11, 12, 14, 15)]
        davis.set_bias("OffBn", 4, 2)
        assert davis.settings.biases["PrSFBp"] == davis_rs.CoarseFineBias(1, 33)  # type: ignore[index]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"exposure_us": -1}, r"exposure_us must lie in 0\.\.4194303, got -1"),
        ({"frame_interval_us": 1 << 23}, r"frame_interval_us must lie in 0\.\.8388607"),
        ({"region": (0, 0, 347, 260)}, "frames of 346 x 260"),
        ({"region": (10, 10, 0, 5)}, "region"),
        ({"accelerometer_range_g": 3}, "one of 2, 4, 8, 16; got 3"),
        ({"biases": "moonlight"}, "no set of biases 'moonlight'"),
        ({"biases": {"IFThrBn": (1, 2)}}, "the DAVIS346B has no bias 'IFThrBn'"),
        ({"biases": {"PrBp": (8, 2)}}, "coarse"),
    ],
)
def test_impossible_settings_change_nothing(changes: dict[str, object], message: str) -> None:
    """The camera stays as it is, and so does what the program believes of it."""
    virtual = camera("DAVIS346B")
    with Davis.open(backend=VirtualBackend(virtual)) as davis:
        with pytest.raises(ValueError, match=message):
            davis.configure(**changes)
        assert writes_of(virtual, lambda: davis.configure()) == []
        assert davis.settings == DavisSettings()


def test_one_of_several_cameras() -> None:
    """By serial number, and never any that was not meant."""
    cameras = [camera(serial=serial) for serial in ("A1", "A2")]
    backend = VirtualBackend(*cameras)
    with pytest.raises(OSError, match="say which: A1, A2"):
        Davis.open(backend=backend)
    with pytest.raises(FileNotFoundError, match="serial number A3 on the USB; there is A1, A2"):
        Davis.open("A3", backend=backend)
    with Davis.open("A2", backend=backend) as davis:
        assert davis.description.serial == "A2"
    assert not any(isinstance(entry, Write) for entry in cameras[0].log)


@pytest.mark.parametrize(
    ("register", "value", "message"),
    [
        (Register(6, 0), 17, "logic version 17"),
        (Register(6, 7), 0, "patch 0"),
        (Register(6, 1), 7, "chip 7"),
        (Register(6, 1), 42, "chip 42"),
    ],
)
def test_a_camera_of_another_version_is_refused(register: Register, value: int, message: str) -> None:
    """Its stream means something else: nothing is written into it."""
    virtual = camera()
    virtual.registers[register] = value
    with pytest.raises(OSError, match=message):
        Davis.open(backend=VirtualBackend(virtual))
    assert not any(isinstance(entry, Write) for entry in virtual.log)


class RefusingBackend(VirtualBackend):
    """The system refuses: to open, or to claim."""

    def __init__(self, *cameras: VirtualDavis, opening: int = 0, claiming: int = 0) -> None:
        super().__init__(*cameras)
        self.opening, self.claiming = opening, claiming

    def open_device(self, device: VirtualDavis) -> VirtualDavis:
        self.refuse(self.opening)
        return super().open_device(device)

    def claim_interface(self, handle: VirtualDavis, interface: int) -> None:
        self.refuse(self.claiming)
        super().claim_interface(handle, interface)

    def refuse(self, number: int) -> None:
        from usb.core import USBError

        if number:
            raise USBError("refused", None, number)


def test_without_permission_the_missing_rule_is_told() -> None:
    """A user who cannot open the camera needs one line, and where to put it."""
    with pytest.raises(PermissionError) as error:
        Davis.open(backend=RefusingBackend(camera(), opening=errno.EACCES))
    assert "/etc/udev/rules.d/" in str(error.value)
    assert 'SUBSYSTEM=="usb", ATTR{idVendor}=="152a", ATTR{idProduct}=="841[ab]", MODE="0666"' in str(error.value)


def test_a_camera_in_use_is_told() -> None:
    """Another program has it."""
    with pytest.raises(OSError, match="in use by another program") as error:
        Davis.open(backend=RefusingBackend(camera(), claiming=errno.EBUSY))
    assert error.value.errno == errno.EBUSY


def test_an_error_of_the_reader_reaches_the_program() -> None:
    """Whatever goes wrong in the reader's thread must not look like silence."""

    class FaultyBackend(VirtualBackend):
        def bulk_read(self, *_: object) -> int:
            raise RuntimeError("a fault of the backend")

    with (
        Davis.open(backend=FaultyBackend(camera())) as davis,
        pytest.raises(RuntimeError, match="a fault of the backend"),
    ):
        list(itertools.islice(davis, 10))
