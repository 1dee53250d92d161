"""The virtual camera itself: what a host sees of it, and that it does what its registers say."""

from __future__ import annotations

import time

import pytest
import usb.core
import usb.util

from davis_rs.usb.protocol import RESET_TIMESTAMPS, START, STOP, Register, Write, decode_writes, encode_writes
from davis_rs.usb.virtual_backend import VirtualBackend
from davis_rs.usb.virtual_davis import Stalled, Unplugged, VirtualDavis, paced

WORDS = bytes(range(1, 201))


def start(camera: VirtualDavis) -> None:
    for phase in START:
        write(camera, *phase.writes)


def write(camera: VirtualDavis, *writes: Write) -> None:
    for module, parameter, value in writes:
        camera.control(0x40, 0xBF, module, parameter, value.to_bytes(4, "big"))


@pytest.mark.parametrize(
    ("chip", "product", "endpoints"), [("DAVIS240C", 0x841B, [0x82]), ("DAVIS346B", 0x841A, [0x81, 0x82])]
)
def test_pyusb_sees_a_davis(chip: str, product: int, endpoints: list[int]) -> None:
    """Vendor, product, strings, configuration and endpoints, as pyusb reads them from any device."""
    device = usb.core.find(backend=VirtualBackend(VirtualDavis(paced(b""), chip=chip, serial="84010001")))
    assert (device.idVendor, device.idProduct, device.bcdDevice & 0xFF) == (
        0x152A,
        product,
        4 if product == 0x841B else 6,
    )
    assert (device.serial_number, device.product) == ("84010001", f"{chip} (virtual)")
    device.set_configuration()
    configuration = device.get_active_configuration()
    # A host leaves a device unconfigured that asks for more than its port gives.
    assert (configuration.bConfigurationValue, configuration.bNumInterfaces, configuration.bMaxPower) == (1, 1, 50)
    assert [endpoint.bEndpointAddress for endpoint in configuration[0, 0]] == endpoints
    assert configuration.wTotalLength == 9 + 9 + 7 * len(endpoints)


def test_registers_are_written_one_by_one_and_together() -> None:
    """Both requests end in the same registers; those of the system information cannot be written."""
    camera = VirtualDavis(paced(b""))
    writes = (Write(2, 12, 120_000), Write(5, 8, 9133))
    write(camera, writes[0])
    camera.control(0x40, 0xC2, 2, 0, encode_writes(writes))
    assert camera.control(0xC0, 0xBF, 5, 8, 4) == bytes((0, 0, 9133 >> 8, 9133 & 0xFF))
    assert camera.registers[Register(2, 12)] == 120_000
    write(camera, Write(6, 1, 9))
    assert camera.control(0xC0, 0xBF, 6, 1, 4) == b"\0\0\0\x02"
    assert decode_writes(encode_writes(writes)) == writes
    with pytest.raises(ValueError, match="6 bytes a write, got 7"):
        decode_writes(bytes(7))
    with pytest.raises(ValueError, match=r"0 to 2\^32 - 1, got -1"):
        encode_writes([Write(0, 0, -1)])


@pytest.mark.parametrize(
    "request_",
    [(0x40, 0xBF, 0, 0, b"\0\0\0"), (0x40, 0xC2, 2, 0, bytes(6)), (0x80, 6, 0x0600, 0, 10), (0x40, 0x12, 0, 0, b"")],
)
def test_what_no_davis_knows_is_stalled(request_: tuple[int, int, int, int, bytes | int]) -> None:
    """Short values, wrong counts, a device qualifier, another vendor request."""
    with pytest.raises(Stalled):
        VirtualDavis(paced(b"")).control(*request_)


def test_data_flow_while_the_registers_let_them() -> None:
    """Nothing before the start, from the beginning after it, nothing after the stop, from the beginning again."""
    camera = VirtualDavis(paced(WORDS, chunk=50, bytes_per_s=1000))
    assert camera.read(1000, 0.01) == b""
    for phase in START[:2]:
        write(camera, *phase.writes)
    assert not camera.streaming
    start(camera)
    assert camera.read(30, 1) == WORDS[:30]
    assert camera.read(20, 1) == WORDS[30:50]
    write(camera, *STOP)
    assert camera.read(1000, 0.01) == b""
    start(camera)
    assert read_all(camera) == WORDS
    assert camera.over.is_set()


def read_all(camera: VirtualDavis) -> bytes:
    read = b""
    while data := camera.read(1000, 0.2):
        read += data
    return read


def test_a_reset_is_answered_in_the_stream() -> None:
    """What was seen before comes first, then the word 0x0001, then the clock's new life."""
    camera = VirtualDavis(paced(WORDS, chunk=50, bytes_per_s=1000))
    start(camera)
    assert camera.read(20, 1) == WORDS[:20]
    camera.control(0x40, 0xC2, 2, 0, encode_writes(RESET_TIMESTAMPS))
    assert read_all(camera) == WORDS[20:50] + b"\x01\x00" + WORDS


def test_data_come_in_real_time() -> None:
    """Not before their time, whatever the host asks for; a read ends at its timeout."""
    camera = VirtualDavis(lambda: [(0, b"ab"), (400_000, b"cd")])
    begun = time.monotonic()
    start(camera)
    assert camera.read(100, 0.01) == b"ab"
    assert camera.read(100, 0.01) == b""
    assert camera.read(100, 5) == b"cd"
    assert time.monotonic() - begun >= 0.4


def test_unplugged_means_gone() -> None:
    """The camera is unplugged after ``unplug_after`` bytes, or by hand. Every request then fails."""
    camera = VirtualDavis(paced(WORDS), unplug_after=70)
    start(camera)
    assert camera.read(1000, 1) == WORDS[:70]
    with pytest.raises(Unplugged):
        camera.read(1000, 1)
    with pytest.raises(Unplugged):
        camera.control(0xC0, 0xBF, 6, 1, 4)
    other = VirtualDavis(paced(WORDS))
    other.unplug()
    assert list(VirtualBackend(other).enumerate_devices()) == []


@pytest.mark.parametrize(
    ("chip", "serial", "message"),
    [
        ("DAVIS128", "1", "one of DAVIS240C, DAVIS346B, got 'DAVIS128'"),
        ("DAVIS240C", "123456789", "1 to 8 characters"),
        ("DAVIS240C", "", "1 to 8 characters"),
    ],
)
def test_impossible_cameras(chip: str, serial: str, message: str) -> None:
    """Refused when they are made."""
    with pytest.raises(ValueError, match=message):
        VirtualDavis(paced(b""), chip=chip, serial=serial)
    with pytest.raises(ValueError, match="words have two bytes"):
        paced(b"abc")
