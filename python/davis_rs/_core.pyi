"""The Rust core. The types are kept here; all else is made by ``.ci/stub`` from the extension module."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, BinaryIO, TypedDict, final

import numpy as np
import numpy.typing as npt

from ._util.array_types import FloatingArray, IntegerArray
from .events.decoded import Decoded, Frame
from .sensor.effects import EffectsLike

__all__ = [
    "RUST_SYSROOT",
    "Aedat4Recording",
    "CrossingEngine",
    "DecodeError",
    "Decoder",
    "Device",
    "Encoder",
    "EventFileReader",
    "EventFileWriter",
    "EventFilter",
    "Evt3Stream",
    "IrradianceSampler",
    "PixelRays",
    "ReflectedLight",
    "SceneRenderer",
    "__version__",
    "blur_3x3",
    "check_effects",
    "check_events",
    "count_events",
    "crc32",
    "crc32_combine",
    "decode_ecf",
    "decode_ktx2",
    "decode_meshopt",
    "fill_events",
    "inspect_ktx2",
    "latest_times",
    "log_intensity",
    "pack_event_message",
    "pack_evt3",
    "reconstruct",
    "spike_tensor",
    "unpack_event_message",
    "voxel_grid",
]

__version__: str
RUST_SYSROOT: str
"""The Rust toolchain that built this module, as ``rustc --print sysroot`` named it; empty if it could not be asked."""

_SparseSamples = tuple[IntegerArray, IntegerArray, FloatingArray]

class _Aedat4(TypedDict):
    events: npt.NDArray[np.void]
    imu: npt.NDArray[np.void]
    frames: list[Frame]
    triggers: npt.NDArray[np.void]
    other_packets: int

class DecodeError(ValueError):
    """Contents of a file or stream that do not follow the format they claim; the message says where."""

@final
class Device:
    """What a decoder has to know of a camera: its chip, sizes, orientation, inertial sensor and converter clock.

    Only the chip is needed; what is not given is as the chip has it by default. For a live camera, pass what its
    registers say, unchanged. Numbers in parentheses are (module, parameter) of the camera's configuration.

    On some chips (the DAVIS346) x and y are swapped on the wire: a row there is a column of the image. ``width`` and
    ``height`` are always those of the image.

    Args:
        chip: ``DAVIS240A``, ``DAVIS240B``, ``DAVIS240C``, ``DAVIS128``, ``DAVIS346A``, ``DAVIS346B``, ``DAVIS346C`` or
            ``DAVIS640``; or the number by which the camera names it (module 6, parameter 1).
        dvs_columns, dvs_rows: sizes of the event array on the wire (1, 0) and (1, 1), 1..4096.
        dvs_orientation: (1, 2): bit 2 = x and y swapped.
        aps_columns, aps_rows: sizes of the frame array on the wire (2, 0) and (2, 1), 1..4096.
        aps_orientation: (2, 2): bits 2 = x and y swapped, 1 = columns from the last on, 0 = rows from the last on.
        imu_type: (3, 0): 2 = MPU-9250, otherwise the MPU-6050's family; they count temperature differently.
        imu_flips: (3, 1): axes to be negated, bits 2 = x, 1 = y, 0 = z.
        adc_mhz: clock of the frame converter in MHz, in which exposures are counted; 30 if not given.

    Raises:
        ValueError: for a chip whose stream is not understood, or a size out of range.
    """

    def __new__(
        cls,
        chip: str | int,
        *,
        dvs_columns: int | None = None,
        dvs_rows: int | None = None,
        dvs_orientation: int | None = None,
        aps_columns: int | None = None,
        aps_rows: int | None = None,
        aps_orientation: int | None = None,
        imu_type: int | None = None,
        imu_flips: int | None = None,
        adc_mhz: float | None = None,
    ) -> Device: ...
    @property
    def chip(self) -> str:
        """The chip's name."""

    @property
    def width(self) -> int:
        """Number of columns of the events' image: x is less than this."""

    @property
    def height(self) -> int:
        """Number of rows of the events' image: y is less than this."""

    @property
    def frame_width(self) -> int:
        """Columns of a full frame."""

    @property
    def frame_height(self) -> int:
        """Rows of a full frame."""

    @property
    def adc_mhz(self) -> float:
        """Clock of the frame converter in MHz, in which exposures are counted."""

@final
class Decoder:
    """Decodes the USB stream of a DAVIS (logic version 18), piece by piece.

    Any split of the stream into pieces decodes alike; an odd byte at the end of a piece waits for the next one. No
    input makes it fail: what a malformed stream makes unusable is dropped and counted in :attr:`stats`. Between two
    pieces it keeps at most one frame and one inertial sample.

    Times are microseconds since the stream began or the camera's clock was last reset, int64, without overflow. Where a
    malformed stream goes back in time, so do they.

    Args:
        device: the name of a chip, or a :class:`Device` where sizes or orientation differ from the chip's own.
        imu_counts: inertial samples in counts of the sensor (:data:`davis_rs.IMU_COUNTS_DTYPE`) instead of SI units.

    Raises:
        ValueError: for a chip whose stream is not understood.

    Source: the public drivers libcaer 3.3 and jAER, and the logic's VHDL.
    """

    def __new__(cls, device: str | Device, *, imu_counts: bool = False) -> Decoder: ...
    def push(self, data: bytes | bytearray | memoryview | npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> Decoded:
        """Decode the next bytes of the stream; the GIL is released.

        Args:
            data: contiguous bytes, or 16-bit words in the machine's order. They are taken without a copy, so do not
                change them while this runs.

        Returns:
            What these bytes complete, ``(events, imu, frames, triggers)``: arrays of :data:`davis_rs.EVENT_DTYPE`,
            :data:`davis_rs.IMU_DTYPE` (or :data:`davis_rs.IMU_COUNTS_DTYPE`) and :data:`davis_rs.TRIGGER_DTYPE`, and
            a list of :class:`davis_rs.Frame`. Events keep the order of the wire. A frame that lacks its samples takes
            some 200 times the memory of the words that make it: push a stream that you do not trust in pieces.

        Raises:
            ValueError: for data of another kind.
        """

    @property
    def device(self) -> Device:
        """The camera whose stream is decoded."""

    @property
    def stats(self) -> dict[str, int]:
        """Counts of faults in the stream, by kind; all zero for one without a fault.

        - ``unknown_words``: words that mean nothing, the reserved 0x0000 among them; ignored
        - ``times_not_increasing``: timestamps and wraps that do not go forward; obeyed
        - ``addresses_out_of_range``: rows and columns outside of the array; dropped
        - ``columns_without_row``: columns before any row; dropped
        - ``imu_malformed``: inertial samples too short, too long or without a scale; dropped
        - ``imu_unended``: inertial samples whose end never came; dropped
        - ``imu_stray_words``: words of inertial samples where none had begun, a second end among them; ignored
        - ``imu_repeated_scales``: scales that came again within a sample, which then begins anew
        - ``frame_stray_words``: words of frames where none had begun; ignored
        - ``samples_missing``: samples that their column lacked; 0 instead
        - ``samples_extra``: samples beyond the end of their column or of the region; ignored
        - ``exposure_words_extra``: exposure words beyond the third of a frame; ignored
        - ``exposure_marks_missing``: frames without start or end of exposure; that time is then the one before it
        - ``frames_wrong_columns``: frames of which a read did not see every column once; dropped
        - ``frames_bad_region``: frames without one whole region on the sensor before the samples; dropped
        - ``frames_unended``: frames whose end never came; dropped
        """

@final
class Encoder:
    """Encodes what a DAVIS would send: the inverse of :class:`Decoder`.

    As the camera's logic does, it sends a timestamp only when time changed, wraps in one word where nothing happened
    between them, and a row once for the columns that share its time. Decoding gives back what was encoded, but for what
    the wire does not carry: of a pixel the upper ten bits (on a DAVIS240 nine, and white); and a frame or an inertial
    sample that lies across a multiple of 2^31 us, which decoders lose.

    Args:
        device: the name of a chip, or a :class:`Device`.
        accel_range, gyro_range: full scales for inertial samples in SI units, 0..3: 2, 4, 8, 16 g and 250, 500, 1000,
            2000 deg/s. Samples in counts bring their own.

    Raises:
        ValueError: for a chip whose stream is not understood, or a range out of range.
    """

    def __new__(cls, device: str | Device, *, accel_range: int = 1, gyro_range: int = 1) -> Encoder: ...
    def encode(
        self,
        events: npt.NDArray[np.void] | None = None,
        imu: npt.NDArray[np.void] | None = None,
        frames: Iterable[Frame] | None = None,
        triggers: npt.NDArray[np.void] | None = None,
    ) -> bytes:
        """Encode the next packet and return its bytes; the GIL is released.

        Times must lie in 0..2^48 us, may not decrease within a kind, nor lie before the last time encoded; frames may
        not overlap. A trigger that resets the clock comes first, at time 0; what follows counts from there.

        Args:
            events: anything with the fields t, x, y, p.
            imu: :data:`davis_rs.IMU_DTYPE` (rounded to counts, which saturate) or :data:`davis_rs.IMU_COUNTS_DTYPE`.
            frames: :class:`davis_rs.Frame`, full ones or parts of the image.
            triggers: :data:`davis_rs.TRIGGER_DTYPE`.

        Returns:
            Little-endian 16-bit words.

        Raises:
            ValueError: for times that go back, or what does not fit the camera, with the index; nothing is encoded
                then.
        """

    @property
    def device(self) -> Device:
        """The camera whose stream is made."""

@final
class CrossingEngine:
    """Turns frames of linear luma into events, by the crossing rule of an ideal event-camera pixel.

    Each pixel holds a reference R = B + n_on C_on - n_off C_off with integer counters, B being its log intensity at the
    first frame (see ``start_phase``). Between two frames log intensity L = ln(luma + log_eps) is interpolated; an ON
    event falls each time it reaches R + C_on, an OFF event each time it reaches R - C_off. An event's stamp is the
    first microsecond at or after the crossing, so it lies in (t_a, t_b]. After every frame -C_off < L - R < C_on holds
    in every pixel.

    With linear interpolation levels and stamps are decided exactly for the float64 L. With Hermite interpolation the
    stamp may be one microsecond off where the crossing lies within 1e-6 us of one, and where an extremum comes
    within 4 ulp of a level either count may come. See docs/crossing.md for the guarantee and where it ends.

    Under ``effects`` the pixel is not ideal, and what is said above holds as far as they let it: see
    :class:`davis_rs.Effects` and docs/effects.md. Noise is a function of (seed, effect, pixel, number of the draw).

    Engines can be pickled. A pixel may have 2^32 - 1 events of each polarity.

    Args:
        width, height: sensor size in pixels, 1..65535.
        contrast_threshold: C_on in natural-log units, 1e-6..1e3: a number (None means 0.15), or float, shape
            (height, width).
        contrast_threshold_off: C_off, likewise; None means C_on.
        log_eps: dark level in units of luma, > 0.
        interpolation: ``linear``, or ``hermite``: cubics through samples and rates of change.
        effects: :class:`davis_rs.Effects`, or what stands for them in other calls: texts such as
            ``"refractory_period_us=100"``, or numbers and parameters by name. Those on the log signal, in the pixel and
            on the stream act here. None for ideal pixels.
        start_phase: where references lie at the first frame: ``zero``, at its log intensity; ``stationary``, so that
            L - R is uniform in (-C_off, C_on), drawn for each pixel, as in a camera that has run before.
        seed: of thresholds, start phases and noise, 0..2^64 - 1; None means 0.
        threads: 1..1024; None means as many as make a sensor of this size faster, at most one a core. The events do not
            depend on it.

    Raises:
        ValueError: for a parameter out of range.

    Source: Mueggler, Rebecq, Gallego, Delbruck, Scaramuzza, The Event-Camera Dataset and Simulator, IJRR 2017,
    section 6.
    """

    def __new__(
        cls,
        width: int,
        height: int,
        *,
        contrast_threshold: float | FloatingArray | None = None,
        contrast_threshold_off: float | FloatingArray | None = None,
        log_eps: float = 0.001,
        interpolation: str = "linear",
        effects: EffectsLike | None = None,
        start_phase: str = "zero",
        seed: int | None = None,
        threads: int | None = None,
    ) -> CrossingEngine: ...
    def push(
        self,
        t_us: int,
        luma: FloatingArray,
        dluma_dt: FloatingArray | None = None,
        *,
        sparse: _SparseSamples | None = None,
    ) -> npt.NDArray[np.void]:
        """Take the frame at ``t_us``; return the events since the frame before it.

        The first frame sets the references and returns no events. The GIL is released.

        Args:
            t_us: time in microseconds, >= 0 and after the last frame's.
            luma: linear luma, shape (height, width), finite and >= 0; float32 in C order is taken without a copy,
                other layouts are copied, float64 is rounded to float32.
            dluma_dt: for Hermite interpolation, the total dY/dt in luma per second, likewise; a value that is not
                finite means a straight line for that pixel. A slope makes no extremum that the samples do not support:
                slopes of one sign against the samples' way are ignored, along it cut to three times the chord's.
            sparse: samples that some pixels bring since the last frame: (pixel, t_us, luma), arrays of one length:
                row-major pixel index, time strictly between the two frames, luma as above; sorted by pixel and then
                by time. Straight lines run between them, also where the frames have rates.

        Returns:
            Events (:data:`davis_rs.EVENT_DTYPE`), sorted by (t, y, x, order of crossing).

        Raises:
            ValueError: for a wrong shape or dtype, luma that is NaN, infinite or negative (with time and pixel), a time
                that does not increase, a rate that is missing or should not be there, sparse samples that are out of
                order or outside of the interval, an engine that has been fed with log intensity, or more than 2^27
                events. The engine is then as it was.
            MemoryError: if there is no memory for the events. The engine is then as it was.
        """

    def push_log(
        self,
        t_us: int,
        log_intensity: FloatingArray,
        slope: FloatingArray | None = None,
        *,
        sparse: _SparseSamples | None = None,
    ) -> npt.NDArray[np.void]:
        """Take log intensity itself instead of luma, otherwise as :meth:`push`; ``log_eps`` is not used.

        Args:
            t_us: time in microseconds, >= 0 and after the last frame's.
            log_intensity: natural logarithm, shape (height, width), within +-746; float64 in C order is taken without
                a copy, float32 is widened.
            slope: for Hermite interpolation, dL/dt per second, likewise; see ``dluma_dt`` of :meth:`push`.
            sparse: as of :meth:`push`, with log intensity instead of luma.

        Returns:
            Events (:data:`davis_rs.EVENT_DTYPE`), as of :meth:`push`.

        Raises:
            ValueError: as :meth:`push`, for log intensity that is NaN or beyond +-746, or an engine that has been fed
                with luma. The engine is then as it was.
        """

    def flush(self) -> npt.NDArray[np.void]:
        """Return the events that the readout effect still holds: requested up to the last frame, stamped after it.

        Returns:
            Events (:data:`davis_rs.EVENT_DTYPE`), sorted; none without that effect.
        """

    @property
    def dropped_events(self) -> int:
        """How many events the readout effect has dropped so far; 0 without it."""

    @property
    def missed_events(self) -> int:
        """How often a pixel reached a level before its last event was read out and its reset over; 0 without a bus."""

    @property
    def contrast_threshold(self) -> float | npt.NDArray[np.float64]:
        """C_on in natural-log units: one number for all pixels, or float64, shape (height, width), one for each."""

    @property
    def contrast_threshold_off(self) -> float | npt.NDArray[np.float64]:
        """C_off in natural-log units: one number for all pixels, or float64, shape (height, width), one for each."""

    @property
    def reference(self) -> npt.NDArray[np.float64]:
        """The reference R in log intensity, float64, shape (height, width).

        NaN before the first frame, and where a refractory period holds a pixel in reset.
        """

    @property
    def last_event_us(self) -> npt.NDArray[np.int64]:
        """The surface of active events: the time of each pixel's last event in microseconds, -1 where there was none.

        int64, shape (height, width).
        """

    def state(self) -> dict[str, Any]:
        """Return what decides which events come next, as numbers and arrays: parameters, time, last frame, counters.

        For :meth:`from_state`, and for NumPy's or any other storage; pickling stores the same.
        """

    @staticmethod
    def from_state(state: dict[str, Any], *, threads: int | None = None) -> CrossingEngine:
        """Return an engine that continues from :meth:`state` as the original engine would have.

        Args:
            state: what :meth:`state` gave, also in another process or at another time.
            threads: as of the class; the events do not depend on it.

        Raises:
            ValueError: for a state that no engine can be in, naming the entry.
        """

@final
class EventFileWriter:
    """Encodes events in a format of the core and writes them; :func:`davis_rs.open_writer` is made of it.

    Args:
        target: a path, or an object with ``write(bytes)``.
        format: ``text``, ``evt2``, ``evt3`` or ``aedat4``.
        width, height: x and y must lie below.
        overwrite: whether an existing file may be replaced.
        size_line: text: whether a first line ``width height`` is written.
        compression: aedat4: ``none``, ``lz4`` or ``zstd``.
        level: aedat4: of zstd.
        start_us: aedat4: added to all times.

    Raises:
        ValueError: for a format, compression or size that there is not.
        OSError: for a file that cannot be made, or one that exists without ``overwrite``.
    """

    def __new__(
        cls,
        target: str | os.PathLike[str] | BinaryIO,
        format: str,
        *,
        width: int,
        height: int,
        overwrite: bool = False,
        size_line: bool = False,
        compression: str = "none",
        level: int = 0,
        start_us: int = 0,
    ) -> EventFileWriter: ...
    def write(self, events: npt.NDArray[np.void]) -> None:
        """Check events and write them.

        The operating system (or ``target``) has their bytes when this returns; the GIL is released.

        Args:
            events: anything with the fields t, x, y, p; times must not decrease, also from one call to the next.

        Raises:
            ValueError: for the first event that breaks the format's limits, with its index, before any is written; for
                a writer that is finished.
            OSError: if the file refuses.
        """

    def flush(self) -> None:
        """Hand everything to the operating system.

        Raises:
            ValueError: for a writer that is finished.
            OSError: if the file refuses.
        """

    def finish(self) -> int:
        """Write what is left, close the file and return its size in bytes; again, only the size.

        Raises:
            OSError: if the file refuses; it is closed then.
        """

    def abandon(self) -> None:
        """Close the file as it is, without what is left to write."""

def check_effects(effects: Mapping[str, Mapping[str, float | None]]) -> None:
    """Refuse settings of effects that are out of range.

    Raises:
        ValueError: naming the effect, the value and the range.
    """

@final
class EventFileReader:
    """Reads a file and decodes its events, from its beginning to its end.

    Args:
        path: the file.
        format: as :class:`EventFileWriter`'s.
        from_byte: text: where the first line to be read begins.
        start_us, stop_us: aedat4: only the packets that hold events of that slice are read, where the file has a table
            of contents. Events of these packets outside of the slice come too.
        max_packet_bytes: aedat4: what a packet may unpack to; 64 MiB if not given.
        in_order: text: whether times that go back are refused, with their line.

    Raises:
        ValueError: for a format that there is not.
        OSError: for a file that cannot be read.
    """

    def __new__(
        cls,
        path: str | os.PathLike[str],
        format: str,
        *,
        from_byte: int = 0,
        start_us: int | None = None,
        stop_us: int | None = None,
        max_packet_bytes: int = ...,
        in_order: bool = True,
    ) -> EventFileReader: ...
    def look(self) -> None:
        """Read until there is an event or the size is known; for a reader that will read nothing else.

        Raises:
            DecodeError: where the file breaks its format, with its position.
            OSError: if the file refuses.
        """

    def read(self, enough: int) -> npt.NDArray[np.void]:
        """Read the next events: at least ``enough`` and not many more, fewer at the end; the GIL is released.

        Returns:
            Events (:data:`davis_rs.EVENT_DTYPE`), in the file's order.

        Raises:
            DecodeError: where the file breaks its format, with its position.
            OSError: if the file refuses.
        """

    def scan(self, enough: int) -> npt.NDArray[np.int64]:
        """Find the blocks that can be read by themselves: the next ones, from where the reader is; the GIL is released.

        Args:
            enough: how many blocks, fewer at the end of the file.

        Returns:
            int64, shape (blocks, 9): the byte where a block begins, the number of events, the times of the first and
            last one in microseconds, and five numbers that the decoder carries.

        Raises:
            DecodeError: where the file breaks its format, or for a time that is negative or goes back, with its
                position.
            OSError: if the file refuses.
        """

    def read_block(self, byte: int, state: Sequence[int], end: int) -> npt.NDArray[np.void]:
        """Read the events of a block that :meth:`scan` has found in this file; the GIL is released.

        Args:
            byte: where it begins.
            state: what the decoder carries there, five numbers.
            end: where the next one begins, or the file ends.

        Returns:
            Events (:data:`davis_rs.EVENT_DTYPE`), in the file's order.

        Raises:
            DecodeError: where the file breaks its format, with its position.
            OSError: if the file refuses.
            ValueError: for a state that no decoder has.
        """

    @property
    def over(self) -> bool:
        """Whether the end of the file was reached."""

    @property
    def size(self) -> tuple[int, int] | None:
        """The sensor's (width, height), where the file says it and once that part was read; None otherwise."""

    @property
    def bytes(self) -> int:
        """How many bytes of the file were decoded so far."""

    @property
    def file_size(self) -> int:
        """How many bytes the file has."""

    @property
    def left_over(self) -> int:
        """Number of bytes left at the end of the file that are no complete record."""

@final
class Aedat4Recording:
    """Reads what a file of AEDAT 4.0 holds: of each kind the first stream, in the order of the file.

    Args:
        path: the file.
        kinds: what is unpacked of ``events``, ``imu``, ``frames`` and ``triggers``; the rest is passed over.
        max_packet_bytes: what a packet may unpack to.

    Raises:
        ValueError: for a kind that there is not.
        OSError: if it cannot be read.
        DecodeError: if its header does not follow the format.
    """

    def __new__(cls, path: str | os.PathLike[str], kinds: Sequence[str], max_packet_bytes: int) -> Aedat4Recording: ...
    def read(self) -> _Aedat4 | None:
        """Read the next packets, some hundred kilobytes of the file; the GIL is released.

        Returns:
            None at the end of the file, else

            events: :data:`davis_rs.EVENT_DTYPE`; negative coordinates are 32,768 and more.
            imu, triggers: :data:`davis_rs.IMU_DTYPE`, :data:`davis_rs.TRIGGER_DTYPE`.
            frames: a list of :class:`davis_rs.Frame`.
            other_packets: how many were passed over.

        Raises:
            OSError: if it cannot be read.
            DecodeError: for the first packet that does not follow the format, with its byte.
        """

    @property
    def size(self) -> tuple[int, int] | None:
        """The sensor's (width, height), where the header says."""

    @property
    def source(self) -> str:
        """The camera that the header names, or ""."""

    @property
    def has_events(self) -> bool:
        """Whether the header announces a stream of events."""

    @property
    def bytes(self) -> int:
        """Bytes of the file that were read."""

    @property
    def cut(self) -> str | None:
        """What the end of the file cuts off, and where; known once it was read to its end."""

def check_events(events: npt.NDArray[np.void], *, last_us: int, latest_us: int, size: tuple[int, int]) -> None:
    """Check a packet of events before it is written.

    Args:
        events: anything with the fields t, x, y, p.
        last_us: time of the event before the packet in microseconds, -1 for none.
        latest_us: the latest time that the format can hold.
        size: (width, height): x and y must lie below.

    Raises:
        ValueError: for the first event, with its index, that goes back in time, is before 0 or after ``latest_us``,
            lies outside of ``size`` (width, height), or has a polarity above 1.
    """

def decode_ecf(bytes: npt.NDArray[np.uint8], most: int) -> npt.NDArray[np.void]:
    """Decode a chunk of ECF, the compression of Metavision's HDF5 files; the GIL is released.

    Args:
        bytes: uint8, shape (n,), contiguous: the chunk.
        most: events that it may have.

    Returns:
        :data:`davis_rs.EVENT_DTYPE`, with the times of the file.

    Raises:
        DecodeError: for more events, and for bytes that end too early, that go beyond the number of events, or that are
            left over.

    Source: `hdf5_ecf`, Prophesee's codec, HDF5's filter 0x8ECF.
    """

def crc32(bytes: npt.NDArray[np.uint8], start: int) -> int:
    """Compute the CRC-32 of bytes that come in parts; the GIL is released.

    Args:
        bytes: uint8, shape (n,), contiguous: the next part.
        start: CRC-32 of all parts before it, 0 for none.

    Returns:
        CRC-32 of all parts so far.

    Source: CRC-32/ISO-HDLC, the one of zip (PKWARE's APPNOTE, 4.4.7).
    """

def crc32_combine(first: int, second: int, second_length: int) -> int:
    """Compute the CRC-32 of two byte strings in a row from the CRC-32 of each, as :func:`crc32` gives it.

    Args:
        first: CRC-32 of the first string.
        second: CRC-32 of the second string.
        second_length: bytes of the second string.
    """

def log_intensity(luma: FloatingArray, log_eps: float) -> npt.NDArray[np.float64]:
    """Compute L = ln(luma + log_eps) in float64, shape (height, width), as :class:`CrossingEngine` does.

    The same bits on every processor, within 1 ulp of the exact logarithm.

    Args:
        luma: linear luma, shape (height, width), finite and >= 0; float32, or float64, which is rounded to it.
        log_eps: dark level in units of luma, > 0.

    Raises:
        ValueError: for luma that is NaN, infinite or negative (with the pixel), or log_eps <= 0.
    """

def reconstruct(
    events: npt.NDArray[np.void],
    first_log_intensity: FloatingArray,
    t_us: int,
    contrast_threshold: float | FloatingArray,
    contrast_threshold_off: float | FloatingArray | None = None,
    *,
    start_phase: str = "zero",
    seed: int | None = None,
) -> npt.NDArray[np.float64]:
    """Compute log intensity at ``t_us`` from that of the first frame and the events until then (t <= t_us).

    log I(x; t) = log I(x; 0) - d(x) + n_on C_on - n_off C_off with each pixel's counts and start phase d: the engine's
    reference to the bit.

    Args:
        events: events of the sensor, in any order.
        first_log_intensity: float64, shape (height, width).
        t_us: time in microseconds; later events are left out.
        contrast_threshold, contrast_threshold_off: C_on and C_off as :class:`CrossingEngine` takes them; without C_off
            it is C_on.
        start_phase, seed: as of the :class:`CrossingEngine` that made the events; with ``zero`` all d are 0.

    Returns:
        float64, shape (height, width).

    Raises:
        ValueError: for thresholds out of range, a start phase that does not exist, or an event outside of the frame.

    Source: Mueggler et al., IJRR 2017, section 6.
    """

@final
class PixelRays:
    """The lattice rays of a sensor's pixels, as undistorted image coordinates.

    Args:
        width, height: of the sensor, in pixels, 1..65535.
        rays: rays of each pixel, 1..1024.
        table: float32 (rays * height * width * 2), flat: x and y of the direction (x, y, 1) in camera axes, by ray of
            the lattice and pixel, row by row.

    Raises:
        ValueError: for a size or number of rays out of range, or a table of another length or with numbers that are not
            finite.
    """

    def __new__(cls, width: int, height: int, rays: int, table: npt.NDArray[np.float32]) -> PixelRays: ...
    @staticmethod
    def from_parts(
        width: int, height: int, rays: int, rows: int, next: Callable[[int], npt.NDArray[np.float32]]
    ) -> PixelRays:
        """Make the rays of a sensor from tables of a few rows each, so that no table of all of them is needed.

        Args:
            width, height, rays: as for the class.
            rows: rows of the image in a table, a multiple of 8; the last one may have fewer.
            next: called with the first row of a part; returns its table, as that of the class.

        Raises:
            ValueError: as the class does.
        """

    @staticmethod
    def grid(width: int, height: int, rays: int, x: npt.NDArray[np.float32], y: npt.NDArray[np.float32]) -> PixelRays:
        """Make the rays of a sensor without distortion. They take next to no memory, and have the bits of a table.

        Args:
            width, height, rays: as for the class.
            x: float32 (rays * width), flat: x of (x, y, 1) by ray of the lattice and column.
            y: float32 (rays * height), flat: y by ray of the lattice and row.

        Raises:
            ValueError: as the class does.
        """

_Slide = tuple[list[list[float]], list[list[float]], bool, bool, list[int], npt.NDArray[np.float32]]
_Channel = tuple[npt.NDArray[np.float32], int, int]
_Colours = tuple[
    npt.NDArray[np.uint32], list[tuple[tuple[int, int, int], npt.NDArray[np.generic], npt.NDArray[np.float32] | None]]
]
_Views = tuple[
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
]

@final
class SceneRenderer:
    """Renders diffuse triangles under direct light: luma, its rate, and depth.

    Each pixel has the same bits in any batch of views and on any number of threads. The steps are those of
    docs/rendering.md. Arrays are flat; t is the number of triangles. Each triangle is in the coordinates of its own
    frame: the world, or a body that moves.

    Args:
        corners: float64 (t, 3, 3), metres.
        planes: float64 (t, 4), unit normal n on the front side and offset d, n . p + d = 0.
        u_maps, v_maps: float64 (t, 4), affine maps of a point (x, y, z, 1) to texture coordinates.
        normal_maps: float64 (t, 3, 4), those to the shading normal; None where all triangles are flat.
        textures: uint32 (t), the number of the triangle's texture.
        two_sided: uint32 (t), 1 where the back of the triangle reflects too.
        culled: uint32 (t), 1 where the back is culled: from behind, neither a camera nor a mirror sees the triangle,
            which throws shadows all the same; None where no triangle is so.
        hidden: uint32 (t), 1 where the camera sees through the triangle, which mirrors see and which throws shadows all
            the same; None where no triangle is so.
        frames: uint32 (t), 0 for the world, 1, 2, ... for bodies.
        frame_count: frames in all, with the world's.
        layouts: int64 (textures, 4): first texel, width, height, wrap mode (0 repeat, 1 clamp, 2 mirror).
        texels: for each light colour float32, all texels as luma, with a frame of one texel around each texture.
        lights: of each light (kind, colour, strength, background luma per strength, vector, beam, slide). The kind is
            ``point``, whose vector is its position, ``directional``, whose vector is the unit vector along which it
            travels, ``constant``, ``baked``, or ``visible``: baked lights take the light maps' texels one after the
            other, and visible ones fall on nothing, but emissions and the sky are theirs. The beam is that of a point:
            None where it shines alike to all sides; (unit vector, None) where it does with the cosine of the angle to
            it; (unit vector, (full, cutoff)) for a spot, with the angles from it up to which it shines fully, and at
            all. The slide is that before a point: its number and which of its planes counts, or None.
        light_maps: irradiance that was computed beforehand, None where there is none: u_maps and v_maps, float64
            (t, 2 sides, 4), affine maps of a point to coordinates in the map of the triangle's front and back; layouts,
            int64 (t, 2 sides, 4), as those of textures; for each baked light all texels as irradiance / pi, as
            (float32 (texels, channels), flat, the number of channels, and the light's own channel);
            and None, or where normal textures turn surfaces the part of irradiance vectors / pi along these: layouts,
            and for each baked light three such of x, y and z in the triangle's frame.
        emissions: luma that each triangle emits from its front, and the number of its light: float64 (t) and uint32
            (t); None where none does.
        sky: what rays see that hit nothing: the number of its light, the side of its octahedral map, and float32
            (side + 2, side + 2) luma with a frame of one texel; None where that is the lights' background alone.
        gloss: surfaces that are not diffuse; None where all are. The finishes, each (roughness along u and, if that
            differs, across it or None, ``ggx`` or
            ``beckmann``, Fresnel's equations, tint of the lobe, tint of what passes through, whether the base
            colour tints the lobe, what is below, the numbers of textures of roughness and of metal or None,
            (strength, roughness) of a coat or None, (strength, tint) of sheen or None, and the fraction of a mix that
            light passes);
            uint32 (t), the finish of each triangle, 2^32 - 1 for none; the colours of textures: uint32
            (textures), the number of each one's image, and for each image (width, height, wrap mode), and its texels
            (height, width, 3), flat, as float32 and None, or as uint8 and float32 (256, 3), flat, what each number
            stands for in red, green and blue; for each light
            colour what strength 1 is in red, green and blue; for each light such a background; float64 (t, 3),
            radiance that each triangle emits, or nothing; the number of a sky's light, its side and float32 (side,
            side, 3); the most segments of a path; layouts and float32 texels of the textures of roughness and metal,
            as those of other textures; and emissive textures: uint32 (textures), the number of the one on the same
            triangles, 2^32 - 1 for none, or nothing; their layouts, the numbers of their lights, and float32 (texels,
            3), radiance from either side. Fresnel's equations are (``dielectric``, [index]), (``conductor``, [index
            and extinction, 3 each]) or (``mixed``, [index, metal, tint]). Below is (``nothing``, []), (``coated``,
            [index, reflected inside, entering, 1 if nonlinear, and of a rough coat what passes at 33 cosines from 0 to
            1]), (``rough``, [roughness, factor]), (``solid``, [index, and what is absorbed inside per unit of length, 3
            channels]), (``sheet``, [index]) or (``blend``, [opacity], whose texture takes the place of that of
            roughness).
        normal_textures: which way the texels of surfaces face; None where no surface has any. uint32 (textures), the
            number of the normal texture on the same triangles, 2^32 - 1 for none; layouts, as those of textures; uint16
            (texels, 3), components along the tangent, the second tangent and the normal, from -1 (0) to 1 (65,535),
            or of a bump map its height in metres: the lower and the upper half of a float32, and 0; for each, whether
            it is a bump map; for each, whether light fades where a turned normal faces it and the surface hardly
            does; and whether all follow glTF's rule for mirrored texture coordinates and backs, or Mitsuba's.
        slides: what lights throw on surfaces, each (rows, map, projected, nearest, layout, texels). Rows (3, 3) are
            vectors of the world for u, v and depth: a place that lies ``away`` from the light has u = rows[0] . away /
            rows[2] . away, and v likewise; the last one is the unit vector along which the light looks. The map (2, 3)
            takes (u, v, 1) to the coordinates of the texture. A slide that is ``projected`` ends where u or v leave
            0..1, and has the third power of one over the cosine to the last row as a factor; ``nearest`` takes the
            nearest texel in place of a mix of four. The layout is (width, height, wrap mode); texels are float32, one
            plane or three (red, green, blue), each in a frame of one texel. None where there are none.
        shadows: whether point and directional lights throw shadows.
        centre: (3), metres, the middle of the scene.
        step, end: where shadow rays begin and end, see :mod:`davis_rs.render.rays.shadow_rays`.
        threads: None for as many as there are processors.

    Raises:
        ValueError: for arrays that do not belong together, or no threads.
    """

    def __new__(
        cls,
        *,
        corners: npt.NDArray[np.float64],
        planes: npt.NDArray[np.float64],
        u_maps: npt.NDArray[np.float64],
        v_maps: npt.NDArray[np.float64],
        normal_maps: npt.NDArray[np.float64] | None,
        textures: npt.NDArray[np.uint32],
        two_sided: npt.NDArray[np.uint32],
        culled: npt.NDArray[np.uint32] | None = None,
        hidden: npt.NDArray[np.uint32] | None = None,
        frames: npt.NDArray[np.uint32],
        frame_count: int,
        layouts: npt.NDArray[np.int64],
        texels: list[npt.NDArray[np.float32]],
        lights: list[
            tuple[
                str,
                int,
                float,
                float,
                list[float],
                tuple[list[float], tuple[float, float] | None] | None,
                tuple[int, int] | None,
            ]
        ],
        light_maps: tuple[
            npt.NDArray[np.float64],
            npt.NDArray[np.float64],
            npt.NDArray[np.int64],
            list[_Channel],
            tuple[npt.NDArray[np.int64], list[list[_Channel]]] | None,
        ]
        | None = None,
        emissions: tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]] | None = None,
        sky: tuple[int, int, npt.NDArray[np.float32]] | None = None,
        gloss: tuple[
            list[
                tuple[
                    tuple[float, float | None],
                    str,
                    tuple[str, list[float]],
                    list[float],
                    list[float],
                    bool,
                    tuple[str, list[float]],
                    list[int | None],
                    tuple[float, float] | None,
                    tuple[float, float] | None,
                    float,
                    float,
                ]
            ],
            npt.NDArray[np.uint32],
            _Colours,
            list[list[float]],
            list[list[float]],
            npt.NDArray[np.float64],
            tuple[int, int, npt.NDArray[np.float32]] | None,
            int,
            tuple[list[list[int]], npt.NDArray[np.float32]],
            tuple[npt.NDArray[np.uint32], list[list[int]], list[int], npt.NDArray[np.float32]],
        ]
        | None = None,
        normal_textures: tuple[
            npt.NDArray[np.uint32], list[list[int]], npt.NDArray[np.uint16], list[bool], list[bool], bool
        ]
        | None = None,
        slides: list[_Slide] | None = None,
        shadows: bool,
        centre: list[float],
        step: float,
        end: float,
        threads: int | None = None,
    ) -> SceneRenderer: ...
    def luma(
        self, rays: PixelRays, views: _Views, *, rate: bool = False
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32] | None]:
        """Render linear luma of each view, and its rate.

        Args:
            rays: of the sensor.
            views: the camera at n instants in each of f frames, under l lights, as six flat float64 arrays: positions
                (n, f, 3) in metres; rotations (n, f, 3, 3) that take camera axes to the frame's; velocities (n, f, 3)
                in the frame's axes, m/s; angular rates (n, f, 3) in camera axes, rad/s; factors (n, l) on the strengths
                of the lights; the rates of these factors (n, l), 1/s.
            rate: whether the rate is computed too.

        Returns:
            Luma, float32, flat (n, height, width), and its rate per second in the same shape, None where it was not
            asked for.

        Raises:
            ValueError: for views of another number of frames or lights than the scene has.
        """

    def samples(
        self, rays: PixelRays, views: _Views, view: npt.NDArray[np.integer], pixel: npt.NDArray[np.integer]
    ) -> npt.NDArray[np.float32]:
        """Render luma of single pixels, the bits of :meth:`luma`.

        Args:
            rays: of the sensor.
            views: as in :meth:`luma`.
            view, pixel: uint32 (k), the number of the view, and of the pixel, row by row.

        Returns:
            Luma, float32 (k).

        Raises:
            ValueError: for views that do not fit the scene, or a view or pixel that is not there.
        """

    def depth(self, rays: PixelRays, views: _Views) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]:
        """Find what the pixels' rays hit.

        Args:
            rays: of the sensor, one ray a pixel.
            views: as in :meth:`luma`.

        Returns:
            Depth, float32, flat (n, height, width): z in camera axes, metres, inf where nothing is hit; and the number
            of the triangle that is hit, uint32 in the same shape, 2^32 - 1 where none is.

        Raises:
            ValueError: for views that do not fit the scene, or more than one ray a pixel.
        """

    def hits(
        self, rays: PixelRays, views: _Views, view: npt.NDArray[np.integer], pixel: npt.NDArray[np.integer]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]:
        """Find what the rays of single pixels hit, the bits of :meth:`depth`.

        Args:
            rays: of the sensor, one ray a pixel.
            views: as in :meth:`luma`.
            view, pixel: uint32 (k), the number of the view, and of the pixel, row by row.

        Returns:
            Depth, float32 (k), and the number of the triangle, uint32 (k), as in :meth:`depth`.

        Raises:
            ValueError: for views that do not fit the scene, a view or pixel that is not there, or more than one ray a
                pixel.
        """

    def gradients(
        self,
        rays: PixelRays,
        views: _Views,
        view: npt.NDArray[np.uint32],
        pixel: npt.NDArray[np.uint32],
        weights: npt.NDArray[np.float64],
    ) -> npt.NDArray[np.float64]:
        """Compute luma of single pixels in float64, or of weighted sums of pixels, each with its derivatives.

        Which surface a ray meets, and whether a light is hidden from it, is taken as fixed.

        Args:
            rays: of the sensor.
            views: as in :meth:`luma`.
            view: uint32 (k), the number of the view.
            pixel: uint32 (k * m), flat: the pixels that are added up, row by row.
            weights: float64 (m), by which they are multiplied before.

        Returns:
            float64, flat (k, 8 + l): luma; its rate per second; its derivatives by the camera's position in world axes
            (3, per metre), and by a rotation vector in camera axes (3, per radian); and the part of each of l lights in
            it, which is the derivative by the logarithm of the light's strength.

        Raises:
            ValueError: for views that do not fit the scene, a view or pixel that is not there, or another number of
                pixels.
        """

    def texel_gradients(
        self,
        rays: PixelRays,
        views: _Views,
        view: npt.NDArray[np.uint32],
        pixel: npt.NDArray[np.uint32],
        weights: npt.NDArray[np.float64],
        steps: npt.NDArray[np.float64],
    ) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32], npt.NDArray[np.float64]]:
        """Compute derivatives of single pixels' luma by texels in float64, or of weighted sums of pixels.

        Which surface a ray meets, whether a light is hidden from it, and light that bounces, is taken as fixed.

        Args:
            rays, views, view, pixel, weights: as in :meth:`gradients`.
            steps: float64 (g), by how much the texels of each light colour change for a unit.

        Returns:
            How many texels each of the k sums sees, uint32 (k); their numbers in the buffer of texels that the scene
            was made with, ascending for each sum, uint32, flat, one sum's after the other's; and luma by the unit,
            float64, as many.

        Raises:
            ValueError: for views that do not fit the scene, a view or pixel that is not there, or another number of
                pixels or steps.
        """

    def ray_hits(
        self, rays: PixelRays, views: _Views, view: npt.NDArray[np.uint32], pixel: npt.NDArray[np.uint32]
    ) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint64], npt.NDArray[np.float64]]:
        """Find what each ray of single pixels sees, in float64.

        Args:
            rays: of the sensor, r rays a pixel.
            views: as in :meth:`luma`.
            view, pixel: uint32 (k), the number of the view, and of the pixel, row by row.

        Returns:
            The number of the triangle that is hit, uint32, flat (k, r), 2^32 - 1 where none is; which lights are hidden
            from the point, uint64 in the same shape: bit n mod 64 is turned over for each light n that something hides;
            and luma, float64 in the same shape.

        Raises:
            ValueError: for views that do not fit the scene, or a view or pixel that is not there.
        """

    def line_luma(self, corners: PixelRays, lines: int, views: _Views) -> npt.NDArray[np.float32]:
        """Render luma of frames by lines through the pixels: of each pixel's area, not of single rays.

        Args:
            corners: of the sensor. By :meth:`PixelRays.grid` two rays a pixel, through its upper left and its lower
                right corner; else, behind a lens with distortion, four: through all of its corners, row by row.
            lines: lines a pixel: 4, 8, 16 or 64.
            views: as in :meth:`luma`.

        Returns:
            Luma, float32, flat (n, height, width).

        Raises:
            ValueError: for other rays or lines, or views that do not fit the scene.
        """

    def line_samples(
        self,
        corners: PixelRays,
        lines: int,
        views: _Views,
        view: npt.NDArray[np.integer],
        pixel: npt.NDArray[np.integer],
    ) -> npt.NDArray[np.float32]:
        """Render luma of single pixels by lines, the bits of :meth:`line_luma`.

        Args:
            corners, lines: as in :meth:`line_luma`.
            views: as in :meth:`luma`.
            view, pixel: uint32 (k), the number of the view, and of the pixel, row by row.

        Returns:
            Luma, float32 (k).

        Raises:
            ValueError: as in :meth:`line_luma`, or for a view or pixel that is not there.
        """

    def deform(
        self,
        frame: int,
        first: int,
        corners: npt.NDArray[np.float64],
        planes: npt.NDArray[np.float64],
        u_maps: npt.NDArray[np.float64],
        v_maps: npt.NDArray[np.float64],
        normal_maps: npt.NDArray[np.float64] | None,
    ) -> None:
        """Deform the mesh of a body: what is rendered after this shows it so. Its BVH keeps its shape.

        Args:
            frame: number of the body, 1, 2, ...
            first: number of its first triangle; its d triangles follow each other.
            corners, planes, u_maps, v_maps, normal_maps: of these triangles, float64, as the renderer was made with.

        Raises:
            ValueError: for what is no body, one with baked light, arrays that do not fit it, or a triangle that has no
                area or is not finite; then nothing changes.
        """

    def nearest_distance(self, point: tuple[float, float, float]) -> float:
        """Return how far the nearest triangle of the world's frame is from a point, in any direction.

        Args:
            point: x, y and z in the world, metres.

        Returns:
            Metres, inf where that frame has no triangle.
        """

    def depths_in_parts(self, parts: npt.NDArray[np.float64], views: _Views) -> npt.NDArray[np.float64]:
        """Return the least and the largest depth of triangles in parts of the image, whatever hides them.

        Args:
            parts: float64, flat (m, 2, 2), of rays (x, y, 1) in camera axes the lowest x and y, and the highest.
            views: as in :meth:`luma`.

        Returns:
            float64, flat (n, m, 2), in metres along the optical axis; NaN where surely no triangle is seen. Depths of
            what is only near to a part may be among them.

        Raises:
            ValueError: for views that do not fit the scene.
        """

def count_events(events: npt.NDArray[np.void], size: tuple[int, int]) -> npt.NDArray[np.uint32]:
    """Count events by polarity and pixel.

    Args:
        events: anything with the fields t, x, y, p.
        size: (width, height) of the sensor.

    Returns:
        uint32, shape (2, height, width), OFF before ON.

    Raises:
        ValueError: for an event outside of the sensor or of a polarity other than 0 or 1, with its index.
    """

def latest_times(
    events: npt.NDArray[np.void], size: tuple[int, int], until_us: int, depth: int = 1
) -> npt.NDArray[np.int64]:
    """Find the last events up to ``until_us`` by polarity and pixel: times in microseconds, -1 where there were fewer.

    Args:
        events: anything with the fields t, x, y, p, in any order.
        size: (width, height) of the sensor.
        until_us: later events are left out.
        depth: how many events of a pixel and polarity, >= 1.

    Returns:
        int64, shape (2 * depth, height, width), OFF before ON, of each the latest first.

    Raises:
        ValueError: as :func:`count_events`, or for ``depth`` < 1.
    """

def voxel_grid(
    events: npt.NDArray[np.void],
    size: tuple[int, int],
    bins: int,
    start_us: int,
    stop_us: int,
    include_stop: bool,
    endpoint: bool,
) -> npt.NDArray[np.float64]:
    """Sum polarities (+1 ON, -1 OFF) in planes of time; :func:`davis_rs.events.represent.voxel_grid` is made of it.

    Each event is shared by the two planes around it, in proportion to how near it is to each.

    Args:
        events: anything with the fields t, x, y, p; those outside of the window are left out.
        size: (width, height) of the sensor.
        bins: number of planes, >= 1.
        start_us, stop_us: the window in microseconds, start <= t < stop; the first plane is at ``start_us``.
        include_stop: whether events at ``stop_us`` count too.
        endpoint: whether the last plane is at ``stop_us``, or one step before it.

    Returns:
        float64, shape (bins, height, width).

    Raises:
        ValueError: as :func:`count_events`, for ``bins`` < 1, or for a window that ends before it starts.
    """

def spike_tensor(
    events: npt.NDArray[np.void],
    size: tuple[int, int],
    bins: int,
    start_us: int,
    stop_us: int,
    include_stop: bool,
    times: bool,
) -> npt.NDArray[np.float64]:
    """Sum measurements of events in planes of time, by polarity: :func:`davis_rs.events.represent.event_spike_tensor`.

    Each event is shared by the two planes around it, in proportion to how near it is to each.

    Args:
        events: anything with the fields t, x, y, p; those outside of the window are left out.
        size: (width, height) of the sensor.
        bins: number of planes of each polarity, >= 1.
        start_us, stop_us: the window in microseconds, start <= t < stop; planes go from ``start_us`` to ``stop_us``.
        include_stop: whether events at ``stop_us`` count too.
        times: whether an event adds its position in the window (0 at the start, 1 at the end), or one.

    Returns:
        float64, shape (2 * bins, height, width), OFF before ON.

    Raises:
        ValueError: as :func:`voxel_grid`.
    """

def pack_event_message(events: npt.NDArray[np.void], size: tuple[int, int], seq: int, frame_id: str) -> bytes:
    """Pack a ``dvs_msgs/EventArray`` as ROS 1 serializes it, stamped with the last event's time.

    Args:
        events: anything with the fields t, x, y, p.
        size: (width, height) of the sensor.
        seq: number of the message.
        frame_id: name of the coordinate frame.

    Raises:
        ValueError: for a time outside of 0..2^32 s, with the event's index.
    """

def unpack_event_message(message: bytes) -> tuple[npt.NDArray[np.void], tuple[int, int]]:
    """Return the events of a ``dvs_msgs/EventArray``, times rounded to the microsecond, and its (width, height).

    Raises:
        DecodeError: where the message breaks the definition, with the byte.
    """

def pack_evt3(events: npt.NDArray[np.void]) -> bytes:
    """Pack events as words of EVT 3.0 without a header, beginning with the high part of the first event's time.

    Args:
        events: anything with the fields t, x, y, p; times modulo 2^24 us are written.

    Raises:
        ValueError: for a time that goes back or is negative, and for a pixel outside of 2048 x 2048.
    """

@final
class Evt3Stream:
    """Decodes a stream of EVT 3.0 that comes in packets, without a header; time and row go on from packet to packet."""

    def __new__(cls) -> Evt3Stream: ...
    def push(self, packet: bytes) -> npt.NDArray[np.void]:
        """Decode the next packet and return its events.

        Args:
            packet: whole words, little-endian.

        Returns:
            Events (:data:`davis_rs.EVENT_DTYPE`), times from the beginning of the round in which the stream began.
            Events before the first time are left out.

        Raises:
            ValueError: for an odd number of bytes.
        """

def fill_events(
    events: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
) -> None:
    """Fill an array of events from columns, in one pass.

    Args:
        events: :data:`davis_rs.EVENT_DTYPE`, shape (n,), contiguous; it is overwritten.
        t: int64, shape (n,), contiguous: microseconds.
        x: uint16, shape (n,), contiguous.
        y: uint16, shape (n,), contiguous.
        p: uint8, shape (n,), contiguous: 0 or 1.

    Raises:
        ValueError: if the lengths differ, or for the first polarity other than 0 or 1, with its index.
    """

@final
class IrradianceSampler:
    """Computes irradiance at points of diffuse surfaces, by rays.

    The light at a point is a function of the scene, the point, its shift and the samples. It has the same bits in any
    batch of points, on any number of threads and on every processor. Arrays are flat; t is the number of triangles.

    Args:
        corners: float64 (t, 3, 3), in the world, metres.
        normals: float64 (t, 3), unit normals of the fronts.
        shading_normals: float64 (t, 3, 3), unit normals of the fronts at the corners.
        uv: float64 (t, 3, 2), texture coordinates of the corners.
        textures: uint32 (t), the number of the triangle's texture.
        two_sided: uint32 (t), 1 where the back of the triangle reflects too.
        colours: the reflectance of textures, as that of :class:`SceneRenderer`'s glossy surfaces.
        groups: of lights that are baked together, each (lamps, constant, map, points, directions, small lamps). A lamp
            is (first triangle, number of triangles, radiance, whether it shines from its back too); ``constant`` is the
            radiance from all sides or None; ``map`` is an environment map (width, height, float32 texels (height,
            width, 3), rotation (3, 3) of the world to its axes) or None; points are (position, intensity, beam,
            slide), with beams and slides of :class:`SceneRenderer` or None; directions are (unit vector along which
            light travels, irradiance).

    Raises:
        ValueError: for arrays that do not belong together, or light that is not finite or negative.
    """

    def __new__(
        cls,
        *,
        corners: npt.NDArray[np.float64],
        normals: npt.NDArray[np.float64],
        shading_normals: npt.NDArray[np.float64],
        uv: npt.NDArray[np.float64],
        textures: npt.NDArray[np.uint32],
        two_sided: npt.NDArray[np.uint32],
        colours: _Colours,
        groups: Sequence[
            tuple[
                Sequence[tuple[int, int, Sequence[float], bool]],
                Sequence[float] | None,
                tuple[int, int, npt.NDArray[np.float32], Sequence[Sequence[float]]] | None,
                Sequence[
                    tuple[
                        Sequence[float],
                        Sequence[float],
                        tuple[Sequence[float], tuple[float, float] | None] | None,
                        _Slide | None,
                    ]
                ],
                Sequence[tuple[Sequence[float], Sequence[float]]],
                Sequence[tuple[int, int, Sequence[float], bool]],
            ]
        ],
    ) -> IrradianceSampler: ...
    def of_lamps(
        self,
        group: int,
        points: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]],
        samples: int,
    ) -> npt.NDArray[np.float64]:
        """Compute direct light of the lamps of a group.

        Args:
            group: its number.
            points: positions (n, 3) in metres, unit normals (n, 3), and by how much the lattice of samples is shifted
                (n, 2), 0..1; three flat float64 arrays.
            samples: points on each lamp, 1..2^20.

        Returns:
            Irradiance / pi, float64, flat (n, 3): red, green and blue.

        Raises:
            ValueError: for a group that is not there, or points that are not finite.
        """

    def of_sky(
        self,
        group: int,
        points: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]],
        samples: int,
    ) -> npt.NDArray[np.float64]:
        """Compute direct light of the sky of a ``group`` at ``points``, as :meth:`of_lamps`, by ``samples`` rays."""

    def of_sharp(
        self,
        group: int,
        points: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]],
        samples: int,
    ) -> npt.NDArray[np.float64]:
        """Compute direct light of points, directions and small lamps of a ``group`` at ``points``, as :meth:`of_lamps`.

        ``samples`` are taken of each light.
        """

    def gathered(
        self,
        group: int,
        points: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]],
        samples: int,
        reflected: ReflectedLight | None,
    ) -> npt.NDArray[np.float64]:
        """Gather light that other surfaces reflect, by rays that follow the cosine.

        Args:
            group, points: as in :meth:`of_lamps`.
            samples: rays.
            reflected: light that falls on surfaces, None for none; that of the group's points, directions and small
                lamps comes on top.

        Returns:
            Irradiance / pi, float64, flat (n, 3).

        Raises:
            ValueError: as :meth:`of_lamps`, and for reflected light of another number of triangles.
        """

    def traced(
        self,
        group: int,
        points: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]],
        samples: int,
        seed: int,
        bounces: int,
        roulette: int,
    ) -> npt.NDArray[np.float64]:
        """Compute what :meth:`gathered` does by paths, with all lights of the group.

        Args:
            group, points: as in :meth:`of_lamps`.
            samples: paths.
            seed: of their draws.
            bounces: how often light bounces at most.
            roulette: after so many bounces a path may end at random.

        Returns:
            Irradiance / pi, float64, flat (n, 3).

        Raises:
            ValueError: as :meth:`of_lamps`.
        """

    def is_lit(
        self,
        group: int,
        points: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]],
        samples: int,
        seed: int,
        bounces: int,
        roulette: int,
    ) -> npt.NDArray[np.bool_]:
        """Find whether any of some paths meets light, however little.

        Args:
            group, points, samples, seed, bounces, roulette: as in :meth:`traced`.

        Returns:
            bool (n).
        """

    def along_of_lamps(
        self,
        group: int,
        points: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]],
        samples: int,
    ) -> npt.NDArray[np.float64]:
        """Compute the part along the surface of irradiance vectors of the light of :meth:`of_lamps`.

        Where a surface is turned a little, its irradiance grows by the product of this with its normal.

        Args:
            group, points, samples: as in :meth:`of_lamps`.

        Returns:
            Irradiance vectors / pi, float64, flat (n, 3 axes, 3): red, green and blue of x, y and z.

        Raises:
            ValueError: as :meth:`of_lamps`.
        """

    def along_of_sky(
        self,
        group: int,
        points: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]],
        samples: int,
    ) -> npt.NDArray[np.float64]:
        """Compute the same of the light of :meth:`of_sky`, of a ``group`` at ``points``, by ``samples`` rays.

        See :meth:`along_of_lamps`.
        """

    def along_gathered(
        self,
        group: int,
        points: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]],
        samples: int,
        reflected: ReflectedLight | None,
    ) -> npt.NDArray[np.float64]:
        """Compute the same of the light of :meth:`gathered`.

        Args:
            group, points, samples, reflected: as in :meth:`gathered`.

        Returns:
            As :meth:`along_of_lamps`.
        """

@final
class ReflectedLight:
    """Light that falls on the surfaces of a scene, for :meth:`IrradianceSampler.gathered`.

    Args:
        layouts: int64 (t, 2 sides, 2), flat: first texel, and texels along a side, of the map of each triangle's front
            and back; a frame of one texel lies around each map.
        texels: float32 (n, 3), flat, irradiance / pi.

    Raises:
        ValueError: for maps that do not lie in the texels.
    """

    def __new__(cls, layouts: npt.NDArray[np.int64], texels: npt.NDArray[np.float32]) -> ReflectedLight: ...

@final
class EventFilter:
    """Tell which events of a stream pass a rule; :mod:`davis_rs.filters` is made of it."""

    def __new__(cls) -> EventFilter: ...
    @staticmethod
    def background_activity(size: tuple[int, int], window_us: int, neighbours: int) -> EventFilter:
        """Make a filter that passes events near which others came shortly before.

        Args:
            size: (width, height) of the sensor.
            window_us: how long before, in microseconds.
            neighbours: how many of the eight pixels around must have had one.
        """

    @staticmethod
    def refractory(size: tuple[int, int], period_us: int) -> EventFilter:
        """Make a filter that holds a pixel for a time after each event that passed.

        Args:
            size: (width, height) of the sensor.
            period_us: in microseconds.
        """

    @staticmethod
    def flicker(
        size: tuple[int, int], shortest_us: int, longest_us: int, tolerance_us: int, periods: int
    ) -> EventFilter:
        """Make a filter that drops the events of pixels that flicker.

        Args:
            size: (width, height) of the sensor.
            shortest_us, longest_us: the periods that are flicker, in microseconds.
            tolerance_us: by how much two periods in a row may differ.
            periods: after so many even periods a pixel flickers.
        """

    def passes(self, events: npt.NDArray[np.void]) -> npt.NDArray[np.bool_]:
        """Tell for each event whether it passes; the stream goes on from the call before.

        Args:
            events: anything with the fields t, x, y, p, in the order of time.

        Returns:
            bool, shape (n,).

        Raises:
            ValueError: for an event outside of the sensor, of another polarity than 0 and 1, or earlier than the one
                before it, with its index; then the filter has not changed.
        """

def blur_3x3(luma: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Convolve each frame of (n, height, width) luma with the kernel [1 2 1] x [1 2 1] / 16, edges mirrored.

    Args:
        luma: float32, C-contiguous.

    Returns:
        float32 of the same shape.

    Raises:
        TypeError: for an array of another type or number of axes.
        ValueError: for one that is not C-contiguous.
    """

def decode_meshopt(
    data: npt.NDArray[np.uint8], mode: str, filter: str, count: int, stride: int
) -> npt.NDArray[np.uint8]:
    """Decode a buffer view that a glTF file compresses by ``EXT_meshopt_compression`` or ``KHR_meshopt_compression``;
    the GIL is released.

    Args:
        data: uint8, shape (n,), contiguous: the compressed bytes.
        mode: ``ATTRIBUTES``, ``TRIANGLES`` or ``INDICES``.
        filter: ``NONE``, or of attributes ``OCTAHEDRAL``, ``QUATERNION``, ``EXPONENTIAL`` or ``COLOR``.
        count: elements that there must be.
        stride: bytes of an element.

    Returns:
        uint8, shape (count stride,).

    Raises:
        ValueError: for a mode, filter or stride that there is not.
        DecodeError: for data that break a rule of the stream, with the byte.
        MemoryError: if there is not enough.

    Source: Khronos Group, KHR_meshopt_compression, appendices A (bitstream) and B (filters).
    """

def decode_ktx2(data: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Decode the finest level of a KTX2 file: Basis Universal (ETC1S or UASTC), or plain bytes; the GIL is released.

    Args:
        data: uint8, shape (n,), contiguous: the file.

    Returns:
        uint8, shape (height, width, 4): red, green, blue and opacity as the file has them; row 0 is the upper edge.

    Raises:
        DecodeError: for a file that breaks a rule, or whose texels are in a format that is not read.
        MemoryError: if there is not enough.

    Source: Khronos Group, KTX File Format Specification 2.0.
    """

def inspect_ktx2(data: npt.NDArray[np.uint8]) -> tuple[int, int, str]:
    """Read what a KTX2 file says of its image, before anything is decoded.

    Args:
        data: uint8, shape (n,), contiguous: the file.

    Returns:
        Width, height, and what the numbers of texels stand for: ``linear``, ``srgb``, or an empty text where the file
        does not say.

    Raises:
        DecodeError: for a file that breaks a rule, or whose texels are in a format that is not read.

    Source: Khronos Group, KTX File Format Specification 2.0.
    """
