"""Describes how a camera is set, and makes the writes that set it so, in the order of the vendor's driver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from ..sensor.biases import DAVIS240C_BIASES, DAVIS346_BIASES, BiasValues, ChipBias, CoarseFineBias, as_biases
from . import protocol
from .description import DavisDescription
from .protocol import Module, Register, Write, set_all

ACCELEROMETER_RANGES_G = (2, 4, 8, 16)
GYROSCOPE_RANGES_DEG_S = (250, 500, 1000, 2000)
EXPOSURE_MAX_US, FRAME_INTERVAL_MAX_US = (1 << 22) - 1, (1 << 23) - 1

_SHIFTED_SOURCE = 1 << 4 | 33 << 10
"""Reference level 1, regulator level 33: both shifted sources of every chip."""


@names_checked
@dataclass(frozen=True, kw_only=True)
class DavisSettings:
    """Settings of a camera; the defaults are those of the vendor's driver.

    Attributes:
        biases: over the chip's defaults, "indoors" or "outdoors" (the sets of Mueggler et al., IJRR 2017), or names
            with (coarse, fine).
        background_filter: drop events without another one nearby in the last 2 ms, in the camera.
        exposure_us: of frames, microseconds.
        frame_interval_us: from one frame's start to the next, microseconds; at most as fast as the read-out.
        region: of frames, (x, y, width, height) in pixels; None is the whole.
        global_shutter: expose all rows at once, where the chip can.
        accelerometer_range_g: +- 2, 4, 8 or 16 g.
        gyroscope_range_deg_s: +- 250, 500, 1000 or 2000 degrees a second.

    Raises:
        ValueError: for a value that does not exist; limits of the chip show when it is used.
    """

    biases: str | BiasValues = field(default_factory=dict)
    background_filter: bool = True
    exposure_us: int = 4000
    frame_interval_us: int = 40_000
    region: tuple[int, int, int, int] | None = None
    global_shutter: bool = True
    accelerometer_range_g: int = 4
    gyroscope_range_deg_s: int = 500

    def __post_init__(self) -> None:
        as_biases(self.biases)
        for name, allowed in (
            ("accelerometer_range_g", ACCELEROMETER_RANGES_G),
            ("gyroscope_range_deg_s", GYROSCOPE_RANGES_DEG_S),
        ):
            if getattr(self, name) not in allowed:
                raise ArgumentError(
                    "{argument} is one of {}; got {!r}",
                    ", ".join(map(str, allowed)),
                    getattr(self, name),
                    argument=name,
                )
        for name, most in (("exposure_us", EXPOSURE_MAX_US), ("frame_interval_us", FRAME_INTERVAL_MAX_US)):
            if not 0 <= getattr(self, name) <= most:
                raise ArgumentError("{argument} must lie in 0..{}, got {!r}", most, getattr(self, name), argument=name)

    def writes(self, camera: DavisDescription) -> tuple[Write, ...]:
        """Return everything that is written into the camera before it is started, in order.

        Raises:
            ValueError: for a region outside of its frames, or a bias that its chip does not have.
        """
        return (
            *_bias_writes(camera.chip, as_biases(self.biases)),
            *_CHIP_WRITES,
            *set_all((protocol.DROP_EXTERNAL_INPUT, protocol.DROP_DVS), 1),
            *_pixel_filters_off(camera),
            Write(*protocol.DVS_BACKGROUND_FILTER, int(self.background_filter)),
            Write(*protocol.DVS_BACKGROUND_TIME, _BACKGROUND_TIME),
            *self._frame_writes(camera),
            *self._imu_writes(camera),
            *set_all((protocol.INPUT_PULSES, protocol.INPUT_PULSE_POLARITY), 1),
            Write(*protocol.INPUT_PULSE_LENGTH, round(_PULSE_US * camera.logic_mhz)),
            Write(*protocol.USB_EARLY_PACKET, round(_EARLY_PACKET_US * camera.usb_mhz)),
        )

    def _frame_writes(self, camera: DavisDescription) -> tuple[Write, ...]:
        global_shutter = int(self.global_shutter and camera.has_global_shutter)
        region = zip(range(4), _region_words(self.region, camera), strict=True)
        return (
            Write(*protocol.APS_WAIT, 1),
            Write(*protocol.APS_GLOBAL_SHUTTER, global_shutter),
            Write(*protocol.CHIP_GLOBAL_SHUTTER, global_shutter),
            *(Write(Module.APS, protocol.APS_REGION.parameter + k, value) for k, value in region),
            Write(*protocol.APS_EXPOSURE, round(self.exposure_us * camera.adc_mhz)),
            Write(*protocol.APS_INTERVAL, round(self.frame_interval_us * camera.adc_mhz)),
        )

    def _imu_writes(self, camera: DavisDescription) -> tuple[Write, ...]:
        gyroscope_low_pass = (Write(*protocol.IMU_GYROSCOPE_LOW_PASS, 1),) if camera.imu_type == 2 else ()
        return (
            Write(*protocol.IMU_DIVIDER, 0),
            Write(*protocol.IMU_LOW_PASS, 1),
            Write(*protocol.IMU_ACCELEROMETER_SCALE, ACCELEROMETER_RANGES_G.index(self.accelerometer_range_g)),
            *gyroscope_low_pass,
            Write(*protocol.IMU_GYROSCOPE_SCALE, GYROSCOPE_RANGES_DEG_S.index(self.gyroscope_range_deg_s)),
        )


_EARLY_PACKET_US = 1000
"""The longest time that data wait for a USB packet to fill: 8 micro-frames."""
_BACKGROUND_TIME = 8
"""Neighbouring events within this time, in units of 250 us, support each other."""
_PULSE_US = 10
"""Length of a pulse at the external input."""

_CHIP_WRITES = (
    *set_all((Register(Module.BIAS, parameter) for parameter in range(128, 136)), 0),
    Write(Module.BIAS, 136, 1),
    Write(Module.BIAS, 137, 0),
    Write(Module.BIAS, 138, 1),
    *set_all((Register(Module.BIAS, parameter) for parameter in (140, 141)), 0),
)
"""The chip's multiplexers for test signals off, its pixels on."""


_DAVIS346_OTHER_BIASES = dict(
    # Five voltages (overflow level, cascode, references of the frame converter), then what the read-out needs.
    zip(
        (*range(5), 8, 9, *range(17, 28)),
        (
            *(411, 405, 480, 449, 469),
            *(23119, 14, 24909, 28095, 20813, 31, 25549, 21279, 26047, 17677, 31117, 14, 14),
        ),
        strict=True,
    )
)
"""Address -> word of the biases that :data:`davis_rs.sensor.biases.DAVIS346_BIASES` has no name for, as dv-processing
2.0 sends them to a DAVIS346."""


def _bias_writes(chip: str, biases: Mapping[str, CoarseFineBias]) -> tuple[Write, ...]:
    table: Mapping[str, ChipBias]
    table, other_words = {}, {}
    if chip.startswith("DAVIS240"):
        table, other_words = DAVIS240C_BIASES, dict.fromkeys((20, 21), _SHIFTED_SOURCE)
    elif chip.startswith("DAVIS346"):
        table, other_words = DAVIS346_BIASES, _DAVIS346_OTHER_BIASES | dict.fromkeys((35, 36), _SHIFTED_SOURCE)
    for name in biases:
        if name not in table:
            raise ValueError(f"the {chip} has no bias {name!r}; it has {', '.join(table) or 'none that are known'}")
    words = other_words | {bias.address: bias.word(biases.get(name)) for name, bias in table.items()}
    return tuple(Write(Module.BIAS, address, word) for address, word in sorted(words.items()))


def _pixel_filters_off(camera: DavisDescription) -> tuple[Write, ...]:
    if not camera.chip.startswith("DAVIS240"):
        return ()
    first = protocol.DVS_PIXEL_FILTER.parameter
    # An address past the array's end is that of no pixel.
    return tuple(Write(Module.DVS, first + k, (camera.rows, camera.columns)[k % 2]) for k in range(16))


def _region_words(region: tuple[int, int, int, int] | None, camera: DavisDescription) -> tuple[int, int, int, int]:
    """Start column, start row, end column, end row, as the read-out counts them."""
    device = camera.device
    whole_width, whole_height = device.frame_width, device.frame_height
    x, y, width, height = region or (0, 0, whole_width, whole_height)
    if not (0 <= x < x + width <= whole_width and 0 <= y < y + height <= whole_height):
        raise ValueError(
            f"region (x, y, width, height) must lie in frames of {whole_width} x {whole_height} pixels, got {region}"
        )
    corners = (x, y, x + width - 1, y + height - 1)
    return (corners[1], corners[0], corners[3], corners[2]) if camera.frames_swapped else corners
