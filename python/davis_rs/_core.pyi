"""The Rust core."""

import os
from typing import Any, BinaryIO, final

import numpy as np
import numpy.typing as npt

__all__ = [
    "CrossingEngine",
    "DecodeError",
    "EventFileReader",
    "EventFileWriter",
    "__version__",
    "check_events",
    "count_events",
    "crc32",
    "crc32_combine",
    "fill_events",
    "latest_times",
    "log_intensity",
    "pack_event_message",
    "reconstruct",
    "unpack_event_message",
    "voxel_grid",
]

__version__: str

_SparseSamples = tuple[npt.NDArray[np.integer[Any]], npt.NDArray[np.integer[Any]], npt.NDArray[np.floating[Any]]]

class DecodeError(ValueError):
    """Contents of a file or stream that do not follow the format they claim; the message says where."""

@final
class CrossingEngine:
    """Turns frames of linear luma into events, by the crossing rule of an ideal event-camera pixel.

    Each pixel holds a reference R = B + n_on C_on - n_off C_off with integer counters, B being its log intensity at the
    first frame. Between two frames log intensity L = ln(luma + log_eps) is interpolated; an ON event falls each time it
    reaches R + C_on, an OFF event each time it reaches R - C_off. An event's stamp is the first microsecond at or after
    the crossing, so it lies in (t_a, t_b]. After every frame -C_off < L - R < C_on holds in every pixel.

    With linear interpolation levels and stamps are decided exactly for the float64 L. With Hermite interpolation the
    stamp may be one microsecond off where the crossing lies within 1e-6 us of one, and where an extremum comes
    within 4 ulp of a level either count may come. See docs/crossing.md for the guarantee and where it ends.

    Engines can be pickled. A pixel may have 2^32 - 1 events of each polarity.

    Args:
        width, height: sensor size in pixels, 1..65535.
        contrast_threshold: C_on in natural-log units, 1e-6..1e3: a number (None means 0.15), or float, shape
            (height, width).
        contrast_threshold_off: C_off, likewise; None means C_on.
        log_eps: dark level in units of luma, > 0.
        interpolation: ``linear``, or ``hermite``: cubics through samples and rates of change.
        threads: None means as many as pay on this sensor, at most one a core. The events do not depend on it.

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
        contrast_threshold: float | npt.NDArray[np.floating[Any]] | None = None,
        contrast_threshold_off: float | npt.NDArray[np.floating[Any]] | None = None,
        log_eps: float = 1e-3,
        interpolation: str = "linear",
        threads: int | None = None,
    ) -> CrossingEngine: ...
    def push(
        self,
        t_us: int,
        luma: npt.NDArray[np.floating[Any]],
        dluma_dt: npt.NDArray[np.floating[Any]] | None = None,
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
                order or of the interval, or an engine that has been fed with log intensity. The engine is then as
                it was.
        """
    def push_log(
        self,
        t_us: int,
        log_intensity: npt.NDArray[np.floating[Any]],
        slope: npt.NDArray[np.floating[Any]] | None = None,
        *,
        sparse: _SparseSamples | None = None,
    ) -> npt.NDArray[np.void]:
        """:meth:`push` of log intensity itself: float64, shape (height, width), within +-746, and its dL/dt."""
    @property
    def reference(self) -> npt.NDArray[np.float64]:
        """The reference R in log intensity, shape (height, width); NaN before the first frame."""
    @property
    def last_event_us(self) -> npt.NDArray[np.int64]:
        """The surface of active events: time of each pixel's last event, shape (height, width); -1 = none yet."""
    def state(self) -> dict[str, Any]:
        """All that decides what comes next, as numbers and arrays: parameters, time, last frame, counters."""
    @staticmethod
    def from_state(state: dict[str, Any], *, threads: int | None = None) -> CrossingEngine:
        """An engine that goes on from :meth:`state` as the one it was taken from would have.

        Raises:
            ValueError: for a state that no engine can be in, naming the entry.
        """

@final
class EventFileWriter:
    """Encodes events in a format of the core and writes them; what :mod:`davis_rs.formats` stands on.

    Args:
        target: a path, or an object with ``write(bytes)``.
        format: ``text``, ``evt2``, ``evt3`` or ``aedat4``.
        width, height: x and y must lie below.
        overwrite: whether an existing file may be replaced.
        size_line: text: whether a first line ``width height`` is written.
        compression: aedat4: ``none``, ``lz4`` or ``zstd``.
        level: aedat4: of zstd.
        start_us: aedat4: added to all times.
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
        """Check events, and write them; they are in the system's hands when it returns, but for those that a format
        of packets keeps back."""
    def flush(self) -> None:
        """Hand everything to the operating system."""
    def finish(self) -> int:
        """Write what is left, close the file and return its size in bytes."""
    def abandon(self) -> None:
        """Close the file as it is."""

@final
class EventFileReader:
    """Reads a file and decodes its events, from its beginning to its end.

    Args:
        path: the file.
        format: as :class:`EventFileWriter`'s.
        from_byte: text: where the first line to be read begins.
        start_us, stop_us: aedat4: only the packets that hold events of that slice are read, if the table of contents
            tells.
    """

    def __new__(
        cls,
        path: str | os.PathLike[str],
        format: str,
        *,
        from_byte: int = 0,
        start_us: int | None = None,
        stop_us: int | None = None,
    ) -> EventFileReader: ...
    def look(self) -> None:
        """Read until there is an event or the size is known; for a reader that will read nothing else."""
    def read(self, enough: int) -> npt.NDArray[np.void]:
        """The next events: at least ``enough`` and not many more, fewer at the end."""
    @property
    def over(self) -> bool:
        """Whether the end was reached."""
    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height), once read, where the file says."""
    @property
    def bytes(self) -> int:
        """Bytes that have become events."""
    @property
    def file_size(self) -> int:
        """Bytes of the file."""
    @property
    def left_over(self) -> int:
        """At the end: bytes that are no whole record."""

def check_events(events: npt.NDArray[np.void], *, last_us: int, latest_us: int, size: tuple[int, int]) -> None:
    """Check a packet that follows an event at ``last_us`` (-1 for none).

    Raises:
        ValueError: for the first event, with its index, that goes back in time, is before 0 or after ``latest_us``,
            lies outside of ``size`` (width, height), or has a polarity above 1.
    """

def crc32(bytes: npt.NDArray[np.uint8], start: int) -> int:
    """CRC-32 (ISO-HDLC, zip's) of bytes that follow those of CRC-32 ``start`` (0 for none); the GIL is released."""

def crc32_combine(first: int, second: int, second_length: int) -> int:
    """CRC-32 of two stretches of bytes, of which the second has ``second_length``, from those of each."""

def log_intensity(luma: npt.NDArray[np.floating[Any]], log_eps: float) -> npt.NDArray[np.float64]:
    """L = ln(luma + log_eps) in float64, shape (height, width), as :class:`CrossingEngine` computes it.

    The same bits on every processor, within 1 ulp of the exact logarithm.

    Raises:
        ValueError: for luma that is NaN, infinite or negative (with the pixel), or log_eps <= 0.
    """

def reconstruct(
    events: npt.NDArray[np.void],
    first_log_intensity: npt.NDArray[np.floating[Any]],
    t_us: int,
    contrast_threshold: float | npt.NDArray[np.floating[Any]],
    contrast_threshold_off: float | npt.NDArray[np.floating[Any]] | None = None,
) -> npt.NDArray[np.float64]:
    """Log intensity at ``t_us`` from the first frame's and the events until then (t <= t_us).

    log I(x; t) = log I(x; 0) + n_on C_on - n_off C_off with each pixel's counts: the engine's reference to the bit.

    Args:
        events: events of the sensor, in any order.
        first_log_intensity: float64, shape (height, width).

    Returns:
        float64, shape (height, width).

    Raises:
        ValueError: for thresholds out of range or an event outside of the frame.

    Source: Mueggler et al., IJRR 2017, section 6.
    """

def count_events(events: npt.NDArray[np.void], size: tuple[int, int]) -> npt.NDArray[np.uint32]:
    """Events by polarity and pixel, shape (2, height, width), OFF before ON; ``size`` is (width, height).

    Raises:
        ValueError: for an event outside of the sensor or of a polarity other than 0 or 1, with its index.
    """

def latest_times(events: npt.NDArray[np.void], size: tuple[int, int], until_us: int) -> npt.NDArray[np.int64]:
    """The time in microseconds of the last event up to ``until_us`` by polarity and pixel, -1 where there was none.

    Returns:
        int64, shape (2, height, width), OFF before ON; ``size`` is (width, height).

    Raises:
        ValueError: as :func:`count_events`.
    """

def voxel_grid(
    events: npt.NDArray[np.void], size: tuple[int, int], bins: int, start_us: int, stop_us: int, endpoint: bool
) -> npt.NDArray[np.float64]:
    """See :func:`davis_rs.represent.voxel_grid`; float64, shape (bins, height, width)."""

def pack_event_message(events: npt.NDArray[np.void], size: tuple[int, int], seq: int, frame_id: str) -> bytes:
    """A ``dvs_msgs/EventArray`` as ROS 1 serializes it, stamped with the last event's time.

    ``size`` is (width, height).

    Raises:
        ValueError: for a time outside of 0..2^32 s, with the event's index.
    """

def unpack_event_message(message: bytes) -> tuple[npt.NDArray[np.void], tuple[int, int]]:
    """The events of a ``dvs_msgs/EventArray``, times rounded to the nearest microsecond, and its (width, height).

    Raises:
        DecodeError: where the message breaks the definition, with the byte.
    """

def fill_events(
    events: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
) -> None:
    """Fill an array of :data:`davis_rs.EVENT_DTYPE` from contiguous columns of the same length.

    Raises:
        ValueError: if the lengths differ, or for the first polarity other than 0 or 1, with its index.
    """
