"""Writes a sequence as one HTML file, which any browser shows without a server and without a network."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import math
import shlex
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from string import Template

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import check_number
from .._util.argument_error import ArgumentError
from .._util.array_types import IntegerArray, JsonObject
from .._util.close_names import names_checked
from .._util.whole_file import write_whole
from ..events.arrays import EventArray
from ..geometry.pose import GroundTruth
from .page_layers import layers_of
from .sampling_for_display import evenly_spaced, event_counts, sample_events, span_of_events
from .visual_sequence import VisualSequence, open_visual_sequence

MAX_EVENTS = 5_000_000
"""Events that a page keeps by default: 3 to 6 bytes each in the file, because they are compressed."""

MAX_EVENTS_INLINE = 500_000
"""Events that a page within a notebook keeps by default: the notebook's file holds it."""

_MOST_IMU_SAMPLES, _MOST_POSES = 4_000, 2_000
_MOST_RATE_BINS, _EVENTS_A_RATE_BIN = 500, 50
_LARGEST_TICK = 2**31 - 1  # a time and a polarity share 32 bits
_EVENTS_A_PIXEL = 0.1
_FRAME_HEIGHT = 1180  # of the whole page in a notebook, CSS pixels
_SPEEDS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
_PLAYING_TIME_S = 20.0

_SCRIPTS = ("data", "turning", "sensor_panel", "event_cloud", "camera_path", "plots", "viewer")
"""Parts of the page's program, in the order in which they use each other."""


@dataclass(frozen=True)
class HtmlPage:
    """Describes a page that was written; ``str()`` of it is one line: the file, what it keeps, and its size.

    One that was made ``inline`` shows itself in a notebook, in a frame.

    Attributes:
        path: the file; None where it was made for a notebook alone.
        kept: for ``events``, ``frames``, ``depth maps``, ``flow maps``, ``masks``, ``normal maps``,
            ``disparity maps``, ``IMU samples`` and ``poses``: how many the page holds, and how many there are. What the
            source does not have is not listed.
        size_bytes: of the file.
        keep_all: the command, or the call, that makes such a page with all events; "" where it has all.
        text: of the page, where it was made inline.
    """

    path: Path | None
    kept: dict[str, tuple[int, int]]
    size_bytes: int
    keep_all: str = ""
    text: str | None = field(default=None, repr=False)

    def __str__(self) -> str:
        where = "a page" if self.path is None else self.path
        more = f"; all events: {self.keep_all}" if self.keep_all else ""
        return f"{where}: {_kept_text(self.kept)}; {self.size_bytes / 1e6:.1f} MB{more}"

    def _repr_html_(self) -> str | None:
        if self.text is None:
            return None
        style = f"width: 100%; height: {_FRAME_HEIGHT}px; border: 0"
        return f'<iframe style="{style}" srcdoc="{html.escape(self.text)}"></iframe>'


@names_checked
def view_html(
    source: str | Path,
    output: str | Path | None = None,
    *,
    inline: bool = False,
    t_s: float | None = None,
    window_s: float | None = None,
    speed: float | None = None,
    size: tuple[int, int] | None = None,
    max_events: int | None = None,
    max_frames: int | None = None,
    whole: bool = False,
    show_progress: bool = False,
) -> HtmlPage:
    """Write a page that plays a sequence: events over frames or maps of the ground truth, a space-time cloud, event
    rates, IMU and camera path.

    The page is one file: program and data are in it, and its content security policy allows neither other scripts nor
    any access to a network. Its size is bounded, because long sequences are sampled; the page says how much is kept,
    and which command keeps all. The plot of event rates is made from all events. Frames hold linear light and are shown
    with sRGB's transfer curve.

    Args:
        source: a dataset folder, an event file of any format, or a recording (AEDAT, or a camera's bytes).
        output: the file to write: ``.html`` or ``.htm``; may be left out with ``inline``.
        inline: what is returned shows the page in a notebook, as the last line of a cell.
        t_s: the moment that is shown first, in seconds; by default the middle. Times are those of the file; those of a
            recording count from its start.
        window_s: length of the window of events at first; by default such that it holds about 0.1 events a pixel.
        speed: seconds of the sequence in a second of playing, at first; by default such that all of it takes about
            20 s, at most 1.
        size: (width, height) of the sensor in pixels, where the source does not say.
        max_events: events that are kept, at least 1; 5,000,000 by default, 500,000 inline. Each takes 3 to 6 bytes of
            the file, inline a third more in the notebook's.
        max_frames: frames that are kept, at least 1, and maps of each kind; by default as many as fit 4 MB of the file,
            maps 1.3 MB.
        whole: where there are more events than are kept, keep all of one span of time, and none of the others, in place
            of some from everywhere: of the span around ``t_s``, or of the one in which they are densest.
        show_progress: how far it is, on standard error.

    Returns:
        What was written.

    Raises:
        ValueError: for another suffix; a time outside of the sequence; a window, a speed or a number that is not
            positive; a size that nobody knows, or a sequence in which nothing has a time.
        DecodeError, OSError: if the source cannot be read or the page cannot be written.
    """
    if output is None and not inline:
        raise ArgumentError("give {output}, the file to write, or {inline:True} for a notebook")
    output = None if output is None else Path(output)
    if output is not None and output.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"a page's name must end in .html or .htm, got {output}")
    for name, value in (("window_s", window_s), ("speed", speed)):
        if value is not None:
            check_number(name, value, 0, above_low=True)
    for name, number in (("max_events", max_events), ("max_frames", max_frames)):
        if number is not None:
            check_number(name, number, 1, whole=True)
    sequence = open_visual_sequence(source, size=size)
    if not len(sequence.events) and not sequence.frame_times:
        raise ValueError(f"{source} has neither events nor frames: there is nothing to show in a page")
    start_us, end_us = sequence.start_us, sequence.end_us
    if t_s is not None and not start_us <= t_s * 1e6 <= end_us:
        raise ArgumentError("{t_s} must lie in the sequence, {:g}..{:g} s, got {}", start_us / 1e6, end_us / 1e6, t_s)

    duration_us = max(1, end_us - start_us)
    most = max_events or (MAX_EVENTS_INLINE if inline else MAX_EVENTS)
    around_us = None if t_s is None else round(t_s * 1e6)
    span_us: tuple[int, int] | None = None
    if whole and len(sequence.events) > most:
        events = span_of_events(sequence.events, most, around_us)
        span_us = int(events["t"][0]), int(events["t"][-1])
        around_us = (span_us[0] + span_us[1]) // 2 if around_us is None else around_us
    else:
        events = sample_events(sequence.events, most)
    rate_per_us = len(events) / (duration_us if span_us is None else max(1, span_us[1] - span_us[0]))
    data: JsonObject = {
        "width": sequence.size[0],
        "height": sequence.size[1],
        "start_us": start_us,
        "duration_us": duration_us,
        "t_us": duration_us // 2 if around_us is None else around_us - start_us,
        "window_us": round(window_s * 1e6) if window_s is not None else _window_us(sequence, rate_per_us, duration_us),
        "speed": speed or min(_SPEEDS, key=lambda speed: abs(math.log(speed * _PLAYING_TIME_S * 1e6 / duration_us))),
        "speeds": sorted({*_SPEEDS, *([speed] if speed else [])}, reverse=True),
        "events": _packed_events(sequence, events, duration_us, span_us),
        "rate": _packed_rates(sequence),
        "layers": [layer.packed(start_us, max_frames, show_progress=show_progress) for layer in layers_of(sequence)],
        "imu": _packed_imu(sequence),
        "path": _packed_path(sequence),
    }
    kept = {"events": (len(events), len(sequence.events))}
    kept |= {layer["maps"]: (len(layer["t"]), layer["total"]) for layer in data["layers"]}
    kept |= {
        name: (part["kept"], part["total"])
        for name, part in (("IMU samples", data["imu"]), ("poses", data["path"]))
        if part
    }
    keep_all = ""
    if len(events) < len(sequence.events):
        given = {"t_s": t_s, "window_s": window_s, "speed": speed, "size": size, "max_frames": max_frames}
        keep_all = _call_for_all(source, output, len(sequence.events), given)
    text = _page(sequence.label, kept, sequence.read_note(), keep_all, data)
    if output is not None:
        write_whole(output, text)
    return HtmlPage(output, kept, len(text), keep_all, text.decode() if inline else None)


def _kept_text(kept: dict[str, tuple[int, int]]) -> str:
    return ", ".join(f"{some:,} of {total:,} {name}" for name, (some, total) in kept.items())


_OPTIONS = {"t_s": "--time", "window_s": "--window", "speed": "--speed", "size": "--size", "max_frames": "--max-frames"}


def _call_for_all(source: str | Path, output: Path | None, events: int, given: Mapping[str, object]) -> str:
    """Return what makes the page with all events: a command, or for a notebook a call; ``given`` are its arguments."""
    given = {name: value for name, value in given.items() if value is not None}
    if output is None:
        more = "".join(f", {name}={value!r}" for name, value in given.items())
        return f"davis_rs.view_html({str(source)!r}, inline=True, max_events={events}{more})"
    words = ["davis-rs", "view", str(source), "--html", str(output), "--max-events", str(events)]
    for name, value in given.items():
        words += [_OPTIONS[name], "{}x{}".format(*value) if isinstance(value, tuple) else str(value)]
    return shlex.join(words)


def _page(
    label: str, kept: dict[str, tuple[int, int]], note: str | None, keep_all: str, data: dict[str, object]
) -> bytes:
    """Return the whole page. What comes from files is escaped, and the policy lets only the script of this hash run."""
    web = files(__package__) / "web"
    script = (
        '"use strict";\n(async () => {\n'
        + "".join((web / f"{name}.js").read_text("utf-8") for name in _SCRIPTS)
        + "})();\n"
    )
    style = (web / "style.css").read_text("utf-8")
    # Without these characters nothing in it, such as a shape's name, can end the element.
    json_text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    for character in "<>&":
        json_text = json_text.replace(character, f"\\u{ord(character):04x}")
    page = Template((web / "page.html").read_text("utf-8")).substitute(
        label=html.escape(label),
        kept=html.escape(_kept_text(kept)),
        note="" if note is None else html.escape(f" Note: {note}."),
        peaks="" if note is None else f' title="{html.escape(note)}"',
        keep_all=f" For all events: <code>{html.escape(keep_all)}</code>" if keep_all else "",
        script=script,
        style=style,
        script_hash=_hash(script),
        style_hash=_hash(style),
        data=json_text,
    )
    return page.encode("utf-8")


def _hash(text: str) -> str:
    """Return an inline script's hash for a content security policy (W3C, CSP Level 3, section 2.3.1)."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _base64(array: npt.NDArray[np.generic], dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype).tobytes()).decode()


def _window_us(sequence: VisualSequence, rate_per_us: float, duration_us: int) -> int:
    """Return the time in which the kept events, at their rate, cover a share of the pixels."""
    pixels = sequence.size[0] * sequence.size[1]
    window = _EVENTS_A_PIXEL * pixels / rate_per_us if rate_per_us else math.inf
    return max(1, round(min(max(window, duration_us / 1000), duration_us / 4)))


def _packed_events(
    sequence: VisualSequence, events: EventArray, duration_us: int, span_us: tuple[int, int] | None
) -> dict[str, object]:
    """Return the events as bytes, compressed by zlib (RFC 1950), and the span of time that they are all of, if any.

    First all lowest bytes of the uint32 numbers that hold, for each event, the ticks since the event before and in the
    lowest bit the polarity; then their second bytes, and so on. Then likewise x and y, uint16. Equal bytes of
    neighbouring events resemble each other, so this compresses to half of what whole numbers would.
    """
    tick_us = -(-duration_us // _LARGEST_TICK)
    ticks = (events["t"] - sequence.start_us) // tick_us
    steps = np.diff(ticks, prepend=0).astype(np.uint32)
    numbers = (steps << np.uint32(1)) | events["p"].astype(np.uint32)
    columns = ((numbers, "<u4"), (events["x"], "<u2"), (events["y"], "<u2"))
    planes = [np.ascontiguousarray(_bytes_of(values, dtype).T).tobytes() for values, dtype in columns]
    return {
        "total": len(sequence.events),
        "kept": len(events),
        "tick_us": tick_us,
        "span_us": None if span_us is None else [t_us - sequence.start_us for t_us in span_us],
        "packed": base64.b64encode(zlib.compress(b"".join(planes))).decode(),
    }


def _bytes_of(values: npt.NDArray[np.generic], dtype: str) -> npt.NDArray[np.uint8]:
    """Return the bytes of numbers, (n, bytes of one)."""
    numbers = np.ascontiguousarray(values, dtype)
    return numbers.view(np.uint8).reshape(len(numbers), numbers.itemsize)


def _packed_rates(sequence: VisualSequence) -> dict[str, object]:
    bins = max(20, min(_MOST_RATE_BINS, len(sequence.events) // _EVENTS_A_RATE_BIN))
    bin_us, on, off = event_counts(sequence.events, sequence.start_us, sequence.end_us, bins)
    return {"bin_us": bin_us, "on": _base64(on, "<u4"), "off": _base64(off, "<u4")}


def _packed_imu(sequence: VisualSequence) -> dict[str, object] | None:
    """Return acceleration (m/s^2) and rotation (rad/s) of the samples in the sequence's time."""
    imu = sequence.read_imu()
    if not len(imu):
        return None
    inside = imu[_in_time(sequence, imu["t"])]
    kept = inside[evenly_spaced(len(inside), _MOST_IMU_SAMPLES)]
    values = np.concatenate([kept["accel"], kept["gyro"]], -1)
    return {
        "total": len(imu),
        "kept": len(kept),
        "t": _base64(kept["t"] - sequence.start_us, "<f8"),
        "values": _base64(values, "<f4"),
    }


def _packed_path(sequence: VisualSequence) -> dict[str, object] | None:
    """Return positions (m) and quaternions (x, y, z, w) of the poses in the sequence's time."""
    poses: GroundTruth = sequence.read_poses()
    if not len(poses.t_us):
        return None
    inside = np.flatnonzero(_in_time(sequence, poses.t_us))
    kept = inside[evenly_spaced(len(inside), _MOST_POSES)]
    values = np.concatenate([poses.positions[kept], poses.quaternions[kept]], -1)
    return {
        "total": len(poses.t_us),
        "kept": len(kept),
        "t": _base64(poses.t_us[kept] - sequence.start_us, "<f8"),
        "values": _base64(values, "<f4"),
    }


def _in_time(sequence: VisualSequence, t_us: IntegerArray) -> npt.NDArray[np.bool_]:
    return np.asarray((t_us >= sequence.start_us) & (t_us <= sequence.end_us))
