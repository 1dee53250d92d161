"""Reads what a camera says of itself: chip, versions, sizes and orientations, clocks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .._core import Device
from . import protocol
from .protocol import Register

_SWAPPED = 4
_MOST_MHZ = 500
"""Of a clock: the longest exposures and intervals still fit into their registers."""


@dataclass(frozen=True)
class DavisDescription:
    """A camera as its descriptors and registers describe it.

    Attributes:
        chip: its name, such as "DAVIS240C".
        serial: serial number.
        product: USB product id, 0x841B (FX2) or 0x841A (FX3).
        firmware, logic_version, logic_patch: versions.
        columns, rows: of the event pixels, as addressed on the wire.
        dvs_orientation: bit 2: x and y are swapped on the wire.
        aps_columns, aps_rows: of the frames, as read out.
        aps_orientation: bit 2 swapped, bit 1 flip x, bit 0 flip y.
        has_global_shutter: whether frames can be exposed all at once.
        imu_type: 0 none, 1 the 6050 family, 2 9250.
        imu_flips: bit 2 x, bit 1 y, bit 0 z.
        is_master: whether it gives the clock to others connected to it.
        logic_mhz, adc_mhz, usb_mhz: clocks.
    """

    chip: str
    serial: str
    product: int
    firmware: int
    logic_version: int
    logic_patch: int
    columns: int
    rows: int
    dvs_orientation: int
    aps_columns: int
    aps_rows: int
    aps_orientation: int
    has_global_shutter: bool
    imu_type: int
    imu_flips: int
    is_master: bool
    logic_mhz: float
    adc_mhz: float
    usb_mhz: float

    @property
    def device(self) -> Device:
        """What a decoder has to know of the camera.

        Raises:
            ValueError: for a chip whose stream is not understood.
        """
        return Device(
            self.chip,
            dvs_columns=self.columns,
            dvs_rows=self.rows,
            dvs_orientation=self.dvs_orientation,
            aps_columns=self.aps_columns,
            aps_rows=self.aps_rows,
            aps_orientation=self.aps_orientation,
            imu_type=self.imu_type,
            imu_flips=self.imu_flips,
            adc_mhz=self.adc_mhz,
        )

    @property
    def frames_swapped(self) -> bool:
        """Whether columns of the read-out are rows of the frame."""
        return bool(self.aps_orientation & _SWAPPED)

    def __str__(self) -> str:
        return f"{self.chip} {self.serial}"


def describe(read: Callable[[Register], int], *, serial: str, product: int, firmware: int) -> DavisDescription:
    """Ask a camera for its description; ``read`` gives a register's value.

    Raises:
        OSError: if it has other logic or firmware than this protocol is of, a chip whose stream is not understood, or
            sizes or clocks that no camera has.
    """
    oldest = protocol.FIRMWARE_MIN[product]
    if firmware < oldest:
        raise OSError(f"camera {serial} has firmware {firmware}, it must have at least {oldest}: update it")
    logic, patch = read(protocol.SYSTEM_LOGIC_VERSION), read(protocol.SYSTEM_LOGIC_PATCH)
    if logic != protocol.LOGIC_VERSION or patch < protocol.LOGIC_PATCH_MIN:
        raise OSError(
            f"camera {serial} has logic version {logic} patch {patch}, it must have {protocol.LOGIC_VERSION} "
            f"patch {protocol.LOGIC_PATCH_MIN} or above: update it with the vendor's tool"
        )
    chip = read(protocol.SYSTEM_CHIP)
    if chip not in protocol.CHIPS:
        raise OSError(f"camera {serial} has chip {chip}, whose stream is not understood")
    # The FX3's crystal is not quite at the nominal frequency; the register gives the ratio in thousandths.
    deviation = read(protocol.SYSTEM_DEVIATION) / 1000
    description = DavisDescription(
        chip=protocol.CHIPS[chip],
        serial=serial,
        product=product,
        firmware=firmware,
        logic_version=logic,
        logic_patch=patch,
        columns=read(protocol.DVS_COLUMNS),
        rows=read(protocol.DVS_ROWS),
        dvs_orientation=read(protocol.DVS_ORIENTATION),
        aps_columns=read(protocol.APS_COLUMNS),
        aps_rows=read(protocol.APS_ROWS),
        aps_orientation=read(protocol.APS_ORIENTATION),
        has_global_shutter=bool(read(protocol.APS_HAS_GLOBAL_SHUTTER)),
        imu_type=read(protocol.IMU_TYPE),
        imu_flips=read(protocol.IMU_FLIPS),
        is_master=bool(read(protocol.SYSTEM_MASTER)),
        logic_mhz=read(protocol.SYSTEM_LOGIC_MHZ) * deviation,
        adc_mhz=read(protocol.SYSTEM_ADC_MHZ) * deviation,
        usb_mhz=read(protocol.SYSTEM_USB_MHZ) * deviation,
    )
    for name in ("logic_mhz", "adc_mhz", "usb_mhz"):
        clock = getattr(description, name)
        if not 1 <= clock <= _MOST_MHZ:
            raise OSError(f"camera {serial}: {name} must lie in 1..{_MOST_MHZ}, its registers say {clock:g}")
    try:
        description.device  # noqa: B018 - raises
    except ValueError as error:
        raise OSError(f"camera {serial}: its registers describe a camera that is not supported: {error}") from error
    return description
