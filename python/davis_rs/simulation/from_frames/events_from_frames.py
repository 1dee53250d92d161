"""Makes packets of events from frames."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy.typing as npt

from ..._util.argument_error import ArgumentError
from ...events.packet import Packet
from ..settings import FrameSettings, complete, takes_settings
from .array_frames import ArrayFrames
from .frame_run import FrameRun
from .frame_source import FrameSource
from .frame_values import FrameValuesWarning
from .stamps import as_stamps, rate_stamps

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..settings.keywords import FrameKeywords


@takes_settings(FrameSettings)
def events_from_frames(
    frames: Iterable[npt.ArrayLike] | FrameSource,
    t_us: Iterable[int] | npt.ArrayLike | None = None,
    *,
    fps: float | None = None,
    **settings: Unpack[FrameKeywords],
) -> Iterator[Packet]:
    """Yield packets of events of a sensor that sees these frames, in bounded memory.

    >>> for packet in events_from_frames(np.load("stack.npy"), fps=240, interpolation="linear"):
    ...     print(packet.end_us, len(packet.events))

    With ``interpolation="linear"`` the events are those of :class:`~davis_rs.CrossingEngine`, fed with the linear luma
    of the frames.

    Args:
        frames: a stack (n, H, W) or (n, H, W, 3), or any iterable of frames (H, W) or (H, W, 3), which is read as it is
            needed: uint8 or uint16 (sRGB, unless ``transfer`` says else; also fewer bits that were brought to 16) or
            floating point (linear light, 1 at white); or what :func:`~davis_rs.open_frames` opened.
        t_us: when each was taken, in microseconds, increasing; an iterable of its own. None where ``fps`` is given, or
            ``frames`` has stamps.
        fps: frames a second; the first is at 0.
        {settings}

    Returns:
        One packet a frame, which ends at it; with ``image_rate_hz`` one an image. Stamps are those of the frames. The
        first has no events; ``luma`` is what the pixels saw, and ``pose`` is None.

    Warns:
        FrameValuesWarning: where the values of integers come in larger steps than their type has, which is then taken
            for the source's resolution; where white may be another value than the one that is taken; where all frames
            show other steps than the first.
        NoEventsWarning: where a threshold is larger than all contrast from the dark level to white, and where there
            were no events at all.

    Raises:
        TypeError: for a setting that does not exist.
        ValueError: for settings out of range, frames that cannot be taken (naming the frame), stamps that do not
            increase, fewer than two frames, at the call or on the way.
        OSError, DecodeError: as :func:`~davis_rs.open_frames`.
        ImportError: for what needs OpenCV, without it.
    """
    given = complete(FrameSettings, settings, taker=events_from_frames)
    run = FrameRun(_source(frames, t_us, fps), given)
    if run.step_line and run.settings.log_eps is None:
        warnings.warn(run.step_line, FrameValuesWarning, stacklevel=2)
    return run.packets()


def _source(
    frames: Iterable[npt.ArrayLike] | FrameSource, t_us: Iterable[int] | npt.ArrayLike | None, fps: float | None
) -> FrameSource:
    if isinstance(frames, FrameSource):
        if t_us is not None or fps is not None:
            raise ArgumentError("{frames} that were opened have stamps: give {t_us} or {fps} to open_frames")
        return frames
    if isinstance(frames, str) or hasattr(frames, "__fspath__"):
        raise ArgumentError("{frames} must be arrays, got the path {!r}: open it by davis_rs.open_frames", str(frames))
    if (t_us is None) == (fps is None):
        raise ArgumentError("one of {t_us} and {fps} must be given")
    if fps is not None:
        return ArrayFrames(frames, rate_stamps(fps))
    if isinstance(t_us, Iterator):
        return ArrayFrames(frames, (1000 * int(stamp) for stamp in t_us))
    return ArrayFrames(frames, as_stamps(t_us, "us", "t_us").tolist())  # type: ignore[arg-type]
