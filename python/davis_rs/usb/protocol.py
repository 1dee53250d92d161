"""Lists the registers of a DAVIS and the orders in which they are written, as data: nothing here does I/O.

A camera's logic is set through registers of 32 bits, addressed by module and parameter. Writing and reading one is a
vendor request on the control endpoint; the events come from one bulk endpoint.

Source: the public drivers libcaer 3.3 and jAER, and the camera's logic.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import NamedTuple

VENDOR = 0x152A
FX2, FX3 = 0x841B, 0x841A
"""Product ids: of the USB controller, not of the chip, which register (6, 1) tells."""
FIRMWARE_MIN = {FX2: 4, FX3: 6}
"""The oldest firmware (low byte of bcdDevice) that speaks this protocol."""
LOGIC_VERSION, LOGIC_PATCH_MIN = 18, 1
"""Other versions of the logic use other codes in the stream from 14 up."""

CHIPS = {
    0: "DAVIS240A",
    1: "DAVIS240B",
    2: "DAVIS240C",
    3: "DAVIS128",
    4: "DAVIS346A",
    5: "DAVIS346B",
    6: "DAVIS640",
    9: "DAVIS346C",
}
"""Chip identifier of register (6, 1) -> name, of the chips whose stream is understood: not of 7 (640H) and 8 (208)."""

CONFIGURATION, INTERFACE = 1, 0
DATA_ENDPOINT = 0x82
DEBUG_ENDPOINT = 0x81
"""Interrupt endpoint of FX3 cameras, with messages of the firmware."""
REQUEST_OUT, REQUEST_IN = 0x40, 0xC0
"""bmRequestType: vendor, to the device, out and in."""
REQUEST_REGISTER = 0xBF
"""bRequest: wValue = module, wIndex = parameter, four bytes, big-endian."""
REQUEST_REGISTERS = 0xC2
"""bRequest: wValue = count, wIndex = 0, then ``count`` times module, parameter, value."""


class Module(IntEnum):
    """The parts of the camera's logic that have registers."""

    MULTIPLEXER = 0
    DVS = 1
    APS = 2
    IMU = 3
    EXTERNAL_INPUT = 4
    BIAS = 5
    SYSTEM = 6
    USB = 9


class Register(NamedTuple):
    """The address of a register."""

    module: int
    parameter: int


class Write(NamedTuple):
    """One register and what goes into it, 0 to 2^32 - 1."""

    module: int
    parameter: int
    value: int

    @property
    def register(self) -> Register:
        """The register that it is written to."""
        return Register(self.module, self.parameter)


MULTIPLEXER_RUN = Register(Module.MULTIPLEXER, 0)
TIMESTAMP_RUN = Register(Module.MULTIPLEXER, 1)
TIMESTAMP_RESET = Register(Module.MULTIPLEXER, 2)
CHIP_RUN = Register(Module.MULTIPLEXER, 3)
DROP_EXTERNAL_INPUT = Register(Module.MULTIPLEXER, 4)
DROP_DVS = Register(Module.MULTIPLEXER, 5)
DVS_COLUMNS = Register(Module.DVS, 0)
DVS_ROWS = Register(Module.DVS, 1)
DVS_ORIENTATION = Register(Module.DVS, 2)
DVS_RUN = Register(Module.DVS, 3)
DVS_PIXEL_FILTER = Register(Module.DVS, 11)
"""The first of eight pairs (row, column) of DAVIS240 cameras."""
DVS_BACKGROUND_FILTER = Register(Module.DVS, 31)
DVS_BACKGROUND_TIME = Register(Module.DVS, 32)
APS_COLUMNS = Register(Module.APS, 0)
APS_ROWS = Register(Module.APS, 1)
APS_ORIENTATION = Register(Module.APS, 2)
APS_RUN = Register(Module.APS, 4)
APS_WAIT = Register(Module.APS, 5)
APS_HAS_GLOBAL_SHUTTER = Register(Module.APS, 6)
APS_GLOBAL_SHUTTER = Register(Module.APS, 7)
APS_REGION = Register(Module.APS, 8)
"""The first of four: start column, start row, end column, end row."""
APS_EXPOSURE = Register(Module.APS, 12)
APS_INTERVAL = Register(Module.APS, 13)
IMU_TYPE = Register(Module.IMU, 0)
IMU_FLIPS = Register(Module.IMU, 1)
IMU_RUN_ACCELEROMETER = Register(Module.IMU, 2)
IMU_RUN_GYROSCOPE = Register(Module.IMU, 3)
IMU_RUN_TEMPERATURE = Register(Module.IMU, 4)
IMU_DIVIDER = Register(Module.IMU, 5)
IMU_LOW_PASS = Register(Module.IMU, 6)
IMU_ACCELEROMETER_SCALE = Register(Module.IMU, 7)
IMU_GYROSCOPE_LOW_PASS = Register(Module.IMU, 9)
IMU_GYROSCOPE_SCALE = Register(Module.IMU, 10)
INPUT_RUN = Register(Module.EXTERNAL_INPUT, 0)
INPUT_PULSES = Register(Module.EXTERNAL_INPUT, 3)
INPUT_PULSE_POLARITY = Register(Module.EXTERNAL_INPUT, 4)
INPUT_PULSE_LENGTH = Register(Module.EXTERNAL_INPUT, 5)
CHIP_GLOBAL_SHUTTER = Register(Module.BIAS, 142)
SYSTEM_LOGIC_VERSION = Register(Module.SYSTEM, 0)
SYSTEM_CHIP = Register(Module.SYSTEM, 1)
SYSTEM_MASTER = Register(Module.SYSTEM, 2)
SYSTEM_LOGIC_MHZ = Register(Module.SYSTEM, 3)
SYSTEM_ADC_MHZ = Register(Module.SYSTEM, 4)
SYSTEM_USB_MHZ = Register(Module.SYSTEM, 5)
SYSTEM_DEVIATION = Register(Module.SYSTEM, 6)
SYSTEM_LOGIC_PATCH = Register(Module.SYSTEM, 7)
USB_RUN = Register(Module.USB, 0)
USB_EARLY_PACKET = Register(Module.USB, 1)
"""How long data wait for a packet to fill, in cycles of the USB clock."""

SENSORS_RUN = (DVS_RUN, APS_RUN, IMU_RUN_ACCELEROMETER, IMU_RUN_GYROSCOPE, IMU_RUN_TEMPERATURE, INPUT_RUN)
"""What produces data, in the order of being switched."""


def set_all(registers: Iterable[Register], value: int) -> tuple[Write, ...]:
    """Return the same value into each."""
    return tuple(Write(*register, value) for register in registers)


class Phase(NamedTuple):
    """Writes, and how long to wait after the last of them."""

    writes: tuple[Write, ...]
    wait_s: float


STOP = set_all((*SENSORS_RUN, MULTIPLEXER_RUN, TIMESTAMP_RUN, USB_RUN, CHIP_RUN), 0)
"""Everything off, data sources first. The host's transfers are cancelled after it."""
CLEAN_SLATE = Phase(STOP, 0.010)
"""Before a start, switch off what the last program left running. Then clear the endpoint's halt and begin to read."""
START = (
    Phase(set_all((CHIP_RUN,), 1), 0.200),
    Phase(set_all((USB_RUN, TIMESTAMP_RUN, MULTIPLEXER_RUN), 1), 0.050),
    Phase(set_all(SENSORS_RUN, 1), 0.0),
)
"""The chip's bias generator settles first, then the way to the host opens, then data are produced."""
RESET_TIMESTAMPS = (Write(*TIMESTAMP_RESET, 1), Write(*TIMESTAMP_RESET, 0))
"""One request with both; the camera answers in the stream, with the word 0x0001."""

RESET_WORD = 0x0001


def encode_value(value: int) -> bytes:
    """Return a register's value as the camera takes it.

    Raises:
        ValueError: if it does not fit into 32 bits.
    """
    if not 0 <= value < 1 << 32:
        raise ValueError(f"a register holds 0 to 2^32 - 1, got {value}")
    return value.to_bytes(4, "big")


def encode_writes(writes: Iterable[Write]) -> bytes:
    """Return the payload of a request that writes several registers at once."""
    return b"".join(bytes((module, parameter)) + encode_value(value) for module, parameter, value in writes)


def decode_writes(payload: bytes) -> tuple[Write, ...]:
    """Return the inverse of :func:`encode_writes`.

    Raises:
        ValueError: if the payload is not whole writes of six bytes.
    """
    if len(payload) % 6:
        raise ValueError(f"a request with several writes has 6 bytes a write, got {len(payload)}")
    rows = (payload[at : at + 6] for at in range(0, len(payload), 6))
    return tuple(Write(row[0], row[1], int.from_bytes(row[2:], "big")) for row in rows)
