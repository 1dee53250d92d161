"""Makes a video of a sequence: its intensity frames next to its events."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import check_number
from .._util.argument_error import ArgumentError
from .._util.close_names import did_you_mean, names_checked
from .._util.extras import from_extra
from .._util.progress import each
from .._util.srgb import to_srgb
from .._util.whole_file import whole_file
from ..events.arrays import EventArray
from .figure import event_picture
from .visual_sequence import VisualSequence, open_visual_sequence

_PANEL_HEIGHT = 360
_CAPTION_HEIGHT = 28
_GAP = 8
_LEAST_WIDTH = 320  # of the caption


_FILE_BYTES = 4_500_000
"""Of an .mp4, as far as its length allows it."""

_LEAST_BITS_A_SECOND = 500_000


PANELS = ("frame", "events", "accumulated")
"""What a video may show, side by side."""


@names_checked
def make_video(
    source: str | Path,
    output: str | Path,
    *,
    fps: float = 25.0,
    speed: float = 0.1,
    size: tuple[int, int] | None = None,
    panels: Sequence[str] | str = ("frame", "events"),
    window_s: float | None = None,
    events_per_picture: int | None = None,
    full_scale: int = 3,
    show_progress: bool = False,
) -> Path:
    """Make a video of a sequence: the intensity frame on the left, on the right the events over it, ON red, OFF blue.

    A picture of the video shows the events of the time that passes until the next one, (t - speed / fps, t], and the
    last intensity frame until t.

    >>> make_video("clip", "dvs.mp4", panels="accumulated", window_s=0.01)

    Args:
        source: a dataset folder, an event file of any format, or a recording (AEDAT, or a camera's bytes).
        output: the file to write: ``.mp4`` (H.264; 5 MB at most up to 70 s of video, then 0.5 Mbit/s) or ``.gif``.
        fps: pictures a second. A GIF counts in hundredths of a second, so there 50 at most.
        speed: seconds of the sequence in a second of the video; 1 is real time, 0.1 ten times slower.
        size: (width, height) of the sensor in pixels, where the source does not say.
        panels: what is shown from left to right: ``frame``, the last intensity frame; ``events``, the events over it;
            ``accumulated``, each pixel's ON minus OFF events, grey for none, white and black at ``full_scale``. A
            sequence of these, or a text with commas.
        window_s: how far back the events of a picture reach, in seconds: (t - window_s, t].
        events_per_picture: a picture is made at every so many events, and shows just these; then ``speed`` and
            ``window_s`` say nothing, and the caption has each picture's time.
        full_scale: how many events make a pixel of ``accumulated`` white or black, >= 1.
        show_progress: how far it is, on standard error.

    Returns:
        The path of the video.

    Raises:
        ImportError: without imageio, saying how to get it.
        ValueError: for another suffix, an fps, speed or window that is not positive and finite, a panel that does not
            exist, both ``window_s`` and ``events_per_picture``; for a size that
            nobody knows, or a sequence in which nothing has a time.
        DecodeError, OSError: if the source cannot be read or the video cannot be written.
    """
    output = Path(output)
    suffix = output.suffix.lower()
    if suffix not in (".mp4", ".gif"):
        raise ValueError(f"a video's name must end in .mp4 or .gif, got {output}")
    for name, value in (("fps", fps), ("speed", speed)):
        check_number(name, value, 0, above_low=True)
    shown = _panels(panels)
    check_number("full_scale", full_scale, 1, whole=True)
    if window_s is not None:
        check_number("window_s", window_s, 0, above_low=True)
    if events_per_picture is not None:
        check_number("events_per_picture", events_per_picture, 1, whole=True)
        if window_s is not None:
            raise ArgumentError("only one of {window_s} and {events_per_picture} may be given")
    if suffix == ".gif" and fps > 50:
        raise ArgumentError("a GIF cannot show more than 50 pictures a second, got {fps} {}", fps)
    with from_extra("view"):
        import imageio.v2 as imageio

    sequence = open_visual_sequence(source, size=size)
    if not len(sequence.events) and not sequence.frame_times:
        raise ValueError(f"{source} has neither events nor frames: there is nothing to show in a video")
    if events_per_picture is None:
        moments = _even_moments(sequence, 1e6 * speed / fps, window_s)
        caption = _speed_text(speed)
    else:
        moments = _moments_of_events(sequence, events_per_picture)
        caption = f"{events_per_picture:,} events a picture"
    count = len(moments)
    if suffix == ".mp4":
        # The best quality of libx264's own scale that keeps the file small: what moves like noise would fill a disk.
        most = f"{max(_LEAST_BITS_A_SECOND, 8 * _FILE_BYTES * fps / count):.0f}"
        limited = ["-crf", "18", "-maxrate", most, "-bufsize", most]
        options = {"fps": fps, "quality": None, "macro_block_size": 2, "ffmpeg_params": limited}
    else:
        options = {"duration": 1000 / fps, "loop": 0}
    with whole_file(output) as working_path, imageio.get_writer(working_path, **options) as writer:
        for picture in each(
            _pictures(sequence, moments, shown, full_scale, caption),
            "drawing",
            count,
            unit="pictures",
            show=show_progress,
        ):
            writer.append_data(picture)
    return output


def _speed_text(speed: float) -> str:
    """Write how fast a video plays."""
    if speed == 1:
        return "real time"
    return f"{1 / speed:.3g} x slower" if speed < 1 else f"{speed:.3g} x faster"


class _Moment(NamedTuple):
    """Says what a picture of the video shows: the last frame until a time, and events from one number to another."""

    t_us: int
    first: int
    stop: int


def _even_moments(sequence: VisualSequence, step_us: float, window_s: float | None) -> list[_Moment]:
    """Return the moments of pictures that follow each other by the same time."""
    count = max(1, math.ceil((sequence.end_us - sequence.start_us) / step_us))
    ends = sequence.start_us + np.rint(np.arange(1, count + 1) * step_us).astype(np.int64)
    starts = sequence.start_us + np.rint(np.arange(count) * step_us).astype(np.int64)
    if window_s is not None:
        starts = ends - round(1e6 * window_s)
    first, stop = (np.searchsorted(sequence.events["t"], times, side="right") for times in (starts, ends))
    return list(map(_Moment, ends.tolist(), first.tolist(), stop.tolist()))


def _moments_of_events(sequence: VisualSequence, number: int) -> list[_Moment]:
    """Return the moments of pictures that each show so many events; the last may have fewer."""
    t = sequence.events["t"]
    if not len(t):
        raise ArgumentError("{events_per_picture} wants events, and there are none")
    firsts = range(0, len(t), number)
    return [_Moment(int(t[min(first + number, len(t)) - 1]), first, min(first + number, len(t))) for first in firsts]


def _panels(panels: Sequence[str] | str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in panels.split(",")) if isinstance(panels, str) else tuple(panels)
    for name in names:
        if name not in PANELS:
            known = ", ".join(PANELS)
            raise ArgumentError("{panels} must be of {}, got {!r}{}", known, name, did_you_mean(name, PANELS))
    if not names:
        raise ArgumentError("{panels} must name one of {}", ", ".join(PANELS))
    return names


def accumulated_picture(size: tuple[int, int], events: EventArray, full_scale: int) -> npt.NDArray[np.uint8]:
    """Return ON minus OFF events of each pixel as grey: uint8 (H, W), 128 for none, 1 and 255 at ``full_scale``."""
    width, height = size
    pixel = events["y"].astype(np.int64) * width + events["x"]
    sign = np.where(events["p"] == 1, 1.0, -1.0)
    net = np.bincount(pixel, sign, width * height).reshape(height, width)
    return np.rint(128 + 127 * np.clip(net / full_scale, -1, 1)).astype(np.uint8)


def _pictures(
    sequence: VisualSequence, moments: Sequence[_Moment], panels: Sequence[str], full_scale: int, caption: str
) -> Iterator[npt.NDArray[np.uint8]]:
    """Yield the pictures of the video, uint8 (even height, even width, 3)."""
    from PIL import Image, ImageDraw, ImageFont

    width, height = sequence.size
    scale = max(1, round(_PANEL_HEIGHT / height))
    panel_height, panel_width = height * scale, width * scale
    # Video codecs halve the resolution of colour, so they want even sizes.
    whole_width = max(len(panels) * (panel_width + _GAP) - _GAP, _LEAST_WIDTH)
    size = (whole_width + whole_width % 2, panel_height + _CAPTION_HEIGHT + panel_height % 2)
    font = ImageFont.load_default(16)
    shown, grey = -1, np.ones((height, width))
    for moment in moments:
        latest = int(np.searchsorted(sequence.frame_times, moment.t_us, side="right")) - 1
        if latest != shown:
            shown, grey = latest, to_srgb(sequence.read_frame(latest))
        events = sequence.events[moment.first : moment.stop]
        picture = Image.new("RGB", size, "white")
        for number, panel in enumerate(panels):
            if panel == "frame":
                image = Image.fromarray(np.rint(255 * grey).astype(np.uint8))
            elif panel == "events":
                image = Image.fromarray(event_picture(grey, events))
            else:
                image = Image.fromarray(accumulated_picture(sequence.size, events, full_scale))
            resized = image.resize((panel_width, panel_height), Image.Resampling.NEAREST)
            picture.paste(resized, (number * (panel_width + _GAP), 0))
        text = f"t = {moment.t_us / 1e6:.4f} s, {caption}"
        ImageDraw.Draw(picture).text((size[0] / 2, panel_height + _CAPTION_HEIGHT / 2), text, "black", font, "mm")
        yield np.asarray(picture)
