"""Makes a video of a sequence: its intensity frames next to its events."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import check_number
from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from .._util.extras import from_extra
from .._util.progress import each
from .._util.whole_file import whole_file
from .figure import event_picture
from .visual_sequence import VisualSequence, display_grey, open_visual_sequence

_PANEL_HEIGHT = 360
_CAPTION_HEIGHT = 28
_GAP = 8


_FILE_BYTES = 4_500_000
"""Of an .mp4, as far as its length allows it."""

_LEAST_BITS_A_SECOND = 500_000


@names_checked
def make_video(
    source: str | Path,
    output: str | Path,
    *,
    fps: float = 25.0,
    speed: float = 0.1,
    size: tuple[int, int] | None = None,
    show_progress: bool = False,
) -> Path:
    """Make a video of a sequence: the intensity frame on the left, on the right the events over it, ON red, OFF blue.

    A picture of the video shows the events of the time that passes until the next one, (t - speed / fps, t], and the
    last intensity frame until t.

    Args:
        source: a dataset folder, an event file of any format, or a recording (AEDAT, or a camera's bytes).
        output: the file to write: ``.mp4`` (H.264; 5 MB at most up to 70 s of video, then 0.5 Mbit/s) or ``.gif``.
        fps: pictures a second. A GIF counts in hundredths of a second, so there 50 at most.
        speed: seconds of the sequence in a second of the video; 1 is real time, 0.1 ten times slower.
        size: (width, height) of the sensor in pixels, where the source does not say.
        show_progress: how far it is, on standard error.

    Returns:
        The path of the video.

    Raises:
        ImportError: without imageio, saying how to get it.
        ValueError: for another suffix, or an fps or speed that is not positive and finite; for a size that
            nobody knows, or a sequence in which nothing has a time.
        DecodeError, OSError: if the source cannot be read or the video cannot be written.
    """
    output = Path(output)
    suffix = output.suffix.lower()
    if suffix not in (".mp4", ".gif"):
        raise ValueError(f"a video's name must end in .mp4 or .gif, got {output}")
    for name, value in (("fps", fps), ("speed", speed)):
        check_number(name, value, 0, above_low=True)
    if suffix == ".gif" and fps > 50:
        raise ArgumentError("a GIF cannot show more than 50 pictures a second, got {fps} {}", fps)
    with from_extra("view"):
        import imageio.v2 as imageio

    sequence = open_visual_sequence(source, size=size)
    if not len(sequence.events) and not sequence.frame_times:
        raise ValueError(f"{source} has neither events nor frames: there is nothing to show in a video")
    step_us = 1e6 * speed / fps
    count = max(1, math.ceil((sequence.end_us - sequence.start_us) / step_us))
    if suffix == ".mp4":
        # The best quality of libx264's own scale that keeps the file small: what moves like noise would fill a disk.
        most = f"{max(_LEAST_BITS_A_SECOND, 8 * _FILE_BYTES * fps / count):.0f}"
        limited = ["-crf", "18", "-maxrate", most, "-bufsize", most]
        options = {"fps": fps, "quality": None, "macro_block_size": 2, "ffmpeg_params": limited}
    else:
        options = {"duration": 1000 / fps, "loop": 0}
    with whole_file(output) as working_path, imageio.get_writer(working_path, **options) as writer:
        for picture in each(
            _pictures(sequence, step_us, count, _speed_text(speed)),
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


def _pictures(sequence: VisualSequence, step_us: float, count: int, speed: str) -> Iterator[npt.NDArray[np.uint8]]:
    """Yield the pictures of the video, uint8 (even height, even width, 3)."""
    from PIL import Image, ImageDraw, ImageFont

    (width, height), events, t = sequence.size, sequence.events, sequence.events["t"]
    scale = max(1, round(_PANEL_HEIGHT / height))
    panel_height, panel_width = height * scale, width * scale
    # Video codecs halve the resolution of colour, so they want even sizes.
    size = (2 * panel_width + _GAP, panel_height + _CAPTION_HEIGHT + panel_height % 2)
    font = ImageFont.load_default(16)
    shown, grey = -1, np.ones((height, width))
    for number in range(1, count + 1):
        start_us, end_us = (sequence.start_us + round(step * step_us) for step in (number - 1, number))
        latest = int(np.searchsorted(sequence.frame_times, end_us, side="right")) - 1
        if latest != shown:
            shown, grey = latest, display_grey(sequence.read_frame(latest))
        window = slice(np.searchsorted(t, start_us, side="right"), np.searchsorted(t, end_us, side="right"))
        picture = Image.new("RGB", size, "white")
        for left, panel in (
            (0, Image.fromarray(np.rint(255 * grey).astype(np.uint8))),
            (panel_width + _GAP, Image.fromarray(event_picture(grey, events[window]))),
        ):
            picture.paste(panel.resize((panel_width, panel_height), Image.Resampling.NEAREST), (left, 0))
        caption = f"t = {end_us / 1e6:.4f} s, {speed}"
        ImageDraw.Draw(picture).text((size[0] / 2, panel_height + _CAPTION_HEIGHT / 2), caption, "black", font, "mm")
        yield np.asarray(picture)
