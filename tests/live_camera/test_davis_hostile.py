"""A camera that lies, stutters or breaks off: everything above pyusb's backend must say so, and go on or end."""

from __future__ import annotations

import contextlib
import errno
import itertools
import random
import struct
import time
from array import array
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import davis_rs
from davis_rs import Davis
from davis_rs.usb import descriptors, protocol
from davis_rs.usb.link import find_devices
from davis_rs.usb.protocol import Register
from davis_rs.usb.virtual_backend import VirtualBackend
from davis_rs.usb.virtual_davis import VirtualDavis, paced
from streams import assert_same, contents, encode, is_empty, join


def camera(words: bytes = b"", **options: Any) -> VirtualDavis:
    return VirtualDavis(paced(words, bytes_per_s=20e6), **options)


class Hostile(VirtualBackend):
    """A backend of which single calls are replaced, by name."""

    def __init__(self, *cameras: VirtualDavis, **calls: Callable[..., Any]) -> None:
        super().__init__(*cameras)
        for name, call in calls.items():
            assert hasattr(self, name)
            setattr(self, name, call)


def refuse(number: int | None) -> Callable[..., Any]:
    """A call that fails."""
    from usb.core import USBError

    def call(*_: object) -> Any:
        raise USBError("refused by the test", None, number)

    return call


class Replies(VirtualBackend):
    """Control transfers to the host, each changed by ``change(request_type, request, value, reply)``."""

    def __init__(self, device: VirtualDavis, change: Callable[[int, int, int, bytes], bytes]) -> None:
        super().__init__(device)
        self.change = change

    def ctrl_transfer(
        self, handle: VirtualDavis, request_type: int, request: int, value: int, index: int, data: array[int], _: int
    ) -> int:
        count = super().ctrl_transfer(handle, request_type, request, value, index, data, _)
        if not request_type & 0x80:
            return count
        reply = self.change(request_type, request, value, data[:count].tobytes())[: len(data)]
        data[: len(reply)] = array("B", reply)
        return len(reply)


def serial_string(content: bytes) -> Callable[[int, int, int, bytes], bytes]:
    """The camera's answer when it is asked for its serial number."""

    def change(_type: int, request: int, value: int, reply: bytes) -> bytes:
        return content if (request, value) == (6, descriptors.STRING << 8 | 3) else reply

    return change


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x04",
        bytes((4, 3, 0x00, 0xD8)),  # half a surrogate pair
        bytes((255, 3)) + b"A\0" * 20,
        bytes((3, 3, 65)),
        bytes((0, 3, 65, 0)),
    ],
)
def test_a_serial_number_that_is_no_string(content: bytes) -> None:
    """The camera is listed in any case, with its serial number or with what is wrong."""
    [found] = find_devices(Replies(camera(), serial_string(content)))
    assert (found.serial is None) == (found.problem is not None)
    if found.problem is not None:
        assert "bus 1 address 1 does not answer" in str(found.problem)
        with pytest.raises(OSError, match="does not answer"):
            Davis.open(backend=Replies(camera(), serial_string(content)))


def test_a_serial_number_does_not_command_the_terminal() -> None:
    """Control characters are shown, not obeyed."""
    content = "\x1b[2J\n\0A".encode("utf-16-le")
    [found] = find_devices(Replies(camera(), serial_string(bytes((2 + len(content), 3)) + content)))
    assert found.serial == r"\x1b[2J\n\x00A"


def test_no_languages_and_no_status() -> None:
    """Either makes pyusb give up upon the strings; other cameras are still found."""

    def no_languages(_type: int, request: int, value: int, reply: bytes) -> bytes:
        return b"\x02\x03" if (request, value) == (6, descriptors.STRING << 8) else reply

    def no_status(_type: int, request: int, _value: int, reply: bytes) -> bytes:
        return b"" if request == 0 else reply

    for change in (no_languages, no_status):
        [found] = find_devices(Replies(camera(), change))
        assert found.serial is None
        assert "does not answer" in str(found.problem)


def test_a_bus_that_cannot_be_listed() -> None:
    """An error of any one device's descriptor, which pyusb does not catch."""
    with pytest.raises(OSError, match="the devices on the USB cannot be listed") as error:
        find_devices(Hostile(camera(), get_device_descriptor=refuse(errno.EIO)))
    assert error.value.errno == errno.EIO


def interface(endpoints: int) -> Callable[..., SimpleNamespace]:
    """The interface's descriptor, which has one setting."""

    def call(_device: object, number: int, setting: int, _configuration: int) -> SimpleNamespace:
        if number or setting:
            raise IndexError
        content = {"bInterfaceNumber": 0, "bAlternateSetting": 0, "bNumEndpoints": endpoints, "bInterfaceClass": 255}
        others = dict.fromkeys(("bInterfaceSubClass", "bInterfaceProtocol", "iInterface"), 0)
        return SimpleNamespace(bLength=9, bDescriptorType=4, extra_descriptors=[], **content, **others)

    return call


def no_descriptor(*_: object) -> SimpleNamespace:
    raise IndexError("no such descriptor")


def endpoint(address: int, kind: int) -> SimpleNamespace:
    names = ("bLength", "bDescriptorType", "bEndpointAddress", "bmAttributes", "wMaxPacketSize", "bInterval")
    values = struct.unpack(descriptors.ENDPOINT_LAYOUT, struct.pack("<BBBBHB", 7, 5, address, kind, 512, 0))
    return SimpleNamespace(**dict(zip(names, values, strict=True)), bRefresh=0, bSynchAddress=0, extra_descriptors=[])


def device_without_configurations(backend: VirtualBackend, device: VirtualDavis) -> SimpleNamespace:
    descriptor = VirtualBackend.get_device_descriptor(backend, device)
    descriptor.bNumConfigurations = 0
    return descriptor


@pytest.mark.parametrize(
    ("calls", "message"),
    [
        ({"get_interface_descriptor": interface(0)}, "no bulk endpoint 0x82"),
        ({"get_endpoint_descriptor": no_descriptor}, "does not answer"),
        ({"get_endpoint_descriptor": lambda *_: endpoint(0x81, 2)}, "no bulk endpoint 0x82"),
        ({"get_endpoint_descriptor": lambda *_: endpoint(0x02, 2)}, "no bulk endpoint 0x82"),
        ({"get_endpoint_descriptor": lambda *_: endpoint(0x82, 1)}, "no bulk endpoint 0x82"),
        ({"get_endpoint_descriptor": lambda *_: endpoint(0x82, 3)}, "no bulk endpoint 0x82"),
        ({"get_configuration": refuse(errno.EPIPE)}, "does not answer"),
        ({"set_configuration": refuse(None)}, "does not answer"),
        ({"claim_interface": refuse(errno.ENOENT)}, "does not answer"),
        ({"claim_interface": refuse(-99)}, "does not answer"),
        ({"claim_interface": refuse(errno.ENODEV)}, "unplugged"),
        ({"clear_halt": refuse(errno.EOVERFLOW)}, "does not answer"),
    ],
)
def test_descriptors_that_do_not_fit(calls: dict[str, Callable[..., Any]], message: str) -> None:
    """Wrong counts, kinds and addresses of endpoints, configurations that are not there, errors of every number."""
    with pytest.raises(OSError, match=message), Davis.open(backend=Hostile(camera(), **calls)) as davis:
        davis.start()


@pytest.mark.parametrize("calls", [{"get_interface_descriptor": interface(9)}, {"get_configuration": lambda *_: 7}])
def test_what_does_no_harm(calls: dict[str, Callable[..., Any]]) -> None:
    """More endpoints than there are, where the right one is; another configuration, before the right one is set."""
    Davis.open(backend=Hostile(camera(), **calls)).close()


def test_a_device_without_configurations() -> None:
    """pyusb knows none that could be set."""
    backend = Hostile(camera())
    backend.get_device_descriptor = lambda device: device_without_configurations(backend, device)  # type: ignore[method-assign]
    with pytest.raises(OSError, match="does not answer: Invalid configuration"):
        Davis.open(backend=backend)


@pytest.mark.parametrize("kept", [0, 1, 3])
def test_short_replies_of_registers(kept: int) -> None:
    """Four bytes are asked for; fewer are no number."""

    def change(request_type: int, _request: int, _value: int, reply: bytes) -> bytes:
        return reply[:kept] if request_type == protocol.REQUEST_IN else reply

    with pytest.raises(OSError, match=f"gave {kept} bytes of register"):
        Davis.open(backend=Replies(camera(), change))


def test_a_write_that_was_not_taken_whole() -> None:
    """A setting that has not arrived must not look as if it had."""
    whole = VirtualBackend(camera()).ctrl_transfer

    def ctrl_transfer(handle: VirtualDavis, request_type: int, *others: Any) -> int:
        return whole(handle, request_type, *others) - (request_type == protocol.REQUEST_OUT)

    with pytest.raises(OSError, match="took 3 bytes of a request, not all 4"):
        Davis.open(backend=Hostile(camera(), ctrl_transfer=ctrl_transfer))


REGISTERS = sorted(VirtualDavis(paced(b"")).registers)
NUMBERS = st.one_of(st.sampled_from([0, 1, 2, 7, 4096, 4097, 2**31, 2**32 - 1]), st.integers(0, 2**32 - 1))


@settings(max_examples=150, deadline=None)
@given(st.dictionaries(st.sampled_from(REGISTERS), NUMBERS, min_size=1, max_size=4))
def test_registers_that_say_anything(changes: dict[Register, int]) -> None:
    """A camera is opened, or refused by an OSError; never anything else."""
    virtual = camera()
    virtual.registers.update(changes)
    with contextlib.suppress(OSError), Davis.open(backend=VirtualBackend(virtual)) as davis:
        assert davis.description.device.width >= 1


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_replies_that_say_anything(data: st.DataObject) -> None:
    """Any reply to any request, shortened or of other bytes."""
    victim, seed = data.draw(st.integers(0, 25)), data.draw(st.integers(0, 1 << 30))
    count, rng = itertools.count(), random.Random(seed)

    def change(_type: int, _request: int, _value: int, reply: bytes) -> bytes:
        if next(count) != victim:
            return reply
        return rng.choice([reply[: rng.randrange(len(reply) + 1)], rng.randbytes(len(reply)), b""])

    with contextlib.suppress(OSError):
        Davis.open(backend=Replies(camera(), change)).close()


def everything(davis: Davis, virtual: VirtualDavis) -> davis_rs.Decoded:
    packets = []
    for packet in davis:
        packets.append(packet)
        if virtual.over.is_set() and is_empty(packet):
            davis.stop()
    return join(packets)


def test_transfers_of_any_size_lose_nothing() -> None:
    """Odd ones, single bytes, empty ones, and timeouts between them."""
    from usb.core import USBTimeoutError

    sent = contents("DAVIS240C")
    virtual, rng = camera(encode("DAVIS240C", sent)), random.Random(3)

    class Odd(VirtualBackend):
        def bulk_read(self, handle: VirtualDavis, address: int, claimed: int, buffer: array[int], timeout: int) -> int:
            kind = rng.randrange(8)
            if kind == 0:
                return 0
            if kind == 1:
                raise USBTimeoutError("operation timed out", None, errno.ETIMEDOUT)
            part = array("B", bytes(rng.choice([1, 3, 511, 512, 513, 4095, 65_537])))
            read = super().bulk_read(handle, address, claimed, part, timeout)
            buffer[:read] = part[:read]
            return read

    with Davis.open(backend=Odd(virtual)) as davis:
        got = everything(davis, virtual)
        assert (davis.received_bytes, davis.lost_bytes) == (len(virtual.sent), 0)
        assert not any(davis.stats.values())
    assert_same(got._replace(imu=sent.imu), sent)


def test_endless_empty_transfers_are_silence() -> None:
    """The program goes on to see the clock, and can stop."""
    with Davis.open(backend=Hostile(camera(), bulk_read=lambda *_: 0)) as davis:
        assert all(map(is_empty, itertools.islice(davis, 3)))
        begun = time.monotonic()
        davis.stop()
        assert time.monotonic() - begun < 60  # it ends, on a busy machine, too
        assert davis.received_bytes == 0


@pytest.mark.few(3)
@pytest.mark.parametrize("number", [errno.EIO, errno.EPIPE, errno.EOVERFLOW, errno.ENOMEM, 12345, -5, None])
def test_an_error_amid_the_stream_comes_after_the_data(number: int | None) -> None:
    """Whatever its number: all that had arrived is given first, and the camera can be let go of."""
    sent = contents("DAVIS240C", events=3000, duration_us=100_000)
    words = encode("DAVIS240C", sent)
    virtual = camera(words)

    class Failing(VirtualBackend):
        def bulk_read(self, handle: VirtualDavis, *others: Any) -> int:
            if len(handle.sent) == len(words):
                refuse(number)()
            return super().bulk_read(handle, *others)

    packets = []

    def receive_all() -> None:
        with Davis.open(backend=Failing(virtual)) as davis:
            for packet in davis:  # the error comes from here
                packets.append(packet)

    with pytest.raises(OSError, match="does not answer") as error:
        receive_all()
    assert error.value.errno == (number or errno.EIO)
    np.testing.assert_array_equal(join(packets).events, sent.events)
