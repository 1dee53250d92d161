"""Draws what a notebook shows of a dataset: a frame, and the events around it."""

from __future__ import annotations

import io

import numpy as np
import numpy.typing as npt

from .._util.html_table import html_picture
from .._util.quantities import time_text
from .._util.srgb import to_srgb
from ..io.dataset.reader import Dataset
from .figure import event_picture, events_around
from .visual_sequence import open_visual_sequence

_EVENTS_READ = 10_000_000
"""Most events that are read for a picture, which takes a second or two."""
_EVENTS_A_PIXEL, _WIDTH_PX = 0.2, 300


def dataset_picture(dataset: Dataset) -> str:
    """Return the middle frame of a dataset, and next to it the events around it, as HTML; "" where there is neither.

    Events are drawn where ``meta.json`` says how many there are, and they are not too many to be read at once.

    Raises:
        DecodeError, OSError: if the folder cannot be read.
    """
    counts = dataset.meta.get("counts")
    total = counts.get("events") if isinstance(counts, dict) else None
    if dataset.size is None or not (dataset.frames or total):
        return ""
    index = len(dataset.frames) // 2
    if not isinstance(total, int) or not 0 < total <= _EVENTS_READ:
        return _picture(to_srgb(dataset.read_image(index) / 255.0)) if dataset.frames else ""
    sequence = open_visual_sequence(dataset.path)
    width, height = sequence.size
    grey, pictures = np.ones((height, width)), []
    t_us = (sequence.start_us + sequence.end_us) // 2
    if sequence.frame_times:
        grey, t_us = to_srgb(sequence.read_frame(index)), sequence.frame_times[index]
        pictures.append((_picture(grey), f"frame at t = {t_us / 1e6:.6g} s"))
    limits_us = sequence.start_us, sequence.end_us
    events, (from_us, to_us) = events_around(sequence.events, t_us, _EVENTS_A_PIXEL * width * height, None, limits_us)
    said = f"{len(events):,} events in {time_text(to_us - from_us)}; ON red, OFF blue"
    pictures.append((_picture(event_picture(grey, events) / 255.0), said))
    parts = "".join(f"<div>{picture}<div>{said}</div></div>" for picture, said in pictures)
    return f"<div style='display:flex;gap:16px'>{parts}</div>"


def _picture(values: npt.NDArray[np.float64]) -> str:
    """Return grey values or colours in 0..1 as a picture."""
    from PIL import Image

    image, stream = Image.fromarray(np.rint(255 * values).astype(np.uint8)), io.BytesIO()
    image.thumbnail((2 * _WIDTH_PX, 2 * _WIDTH_PX))
    image.save(stream, "PNG")
    return html_picture(stream.getvalue(), min(_WIDTH_PX, max(image.width, 120)))
