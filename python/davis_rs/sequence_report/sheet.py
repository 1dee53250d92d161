"""A contact sheet: what each sequence looks like, and its events there."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .._util.argument_error import ArgumentError
from .._util.whole_file import whole_file
from ..inspection.figure import event_picture
from ..inspection.visual_sequence import display_grey
from ..io.dataset.files import as_grey
from ..io.dataset.writer import image_gain_for
from ..scene.sequences import Sequence
from ..simulation.simulator import Simulator

_SLICE_S = 0.1
_EVENTS_A_PIXEL = 0.15
_COLUMNS, _GAP, _TITLE = 3, 8, 20
"""Tiles a row; pixels between tiles; pixels of a tile's title."""


def draw_sheet(sequences: Iterable[Sequence], output_png: str | Path, *, share: float = 0.7) -> Path:
    """Draw a frame of each sequence, next to the same frame, faded, with the events that lead up to it.

    The frame is exposed by the rule of :class:`~davis_rs.io.dataset.writer.DatasetWriter` and drawn with sRGB's
    curve; as many of the last 0.1 s's events are shown as make 0.15 a pixel.

    Args:
        share: of the sequence's time that has passed, in 0..1.

    Raises:
        ValueError: for a share out of range, or no sequences.
        OSError: if it cannot be written.
    """
    from PIL import Image, ImageDraw, ImageFont

    if not 0 <= share <= 1:
        raise ArgumentError("{share} must lie in 0..1, got {}", share)
    with whole_file(output_png) as place:  # fails before the rendering, if it must
        tiles = [(sequence.name, _tile(sequence, share)) for sequence in sequences]
        if not tiles:
            raise ValueError("a contact sheet needs at least one sequence")
        height, width = tiles[0][1].shape[:2]
        rows = -(-len(tiles) // _COLUMNS)
        sheet = Image.new("RGB", (_COLUMNS * (width + _GAP) - _GAP, rows * (height + _TITLE + _GAP) - _GAP), "white")
        draw = ImageDraw.Draw(sheet)
        for number, (name, tile) in enumerate(tiles):
            left, top = (number % _COLUMNS) * (width + _GAP), (number // _COLUMNS) * (height + _TITLE + _GAP)
            draw.text((left, top), name, "black", ImageFont.load_default(size=14))
            sheet.paste(Image.fromarray(tile), (left, top + _TITLE))
        sheet.save(place, format="PNG")
    return Path(output_png)


def _tile(sequence: Sequence, share: float) -> npt.NDArray[np.uint8]:
    """Frame and events side by side, (height, 2 width, 3)."""
    whole_s = sequence.paper.duration_s
    slice_s = min(_SLICE_S, whole_s)
    scene = sequence.scene().crop(share * (whole_s - slice_s), slice_s)
    simulator = Simulator(scene, frame_rate_hz=1 / slice_s, depth_rate_hz=0, accuracy="fast")
    packets = list(simulator.run())
    luma = next(packet.luma for packet in reversed(packets) if packet.luma is not None)
    events = np.concatenate([packet.events for packet in packets])
    grey = display_grey(as_grey(luma, image_gain_for(luma)) / 255.0)
    shown = events[len(events) - min(len(events), round(_EVENTS_A_PIXEL * luma.size)) :]
    frame = np.repeat(np.rint(255 * grey)[..., None], 3, axis=2).astype(np.uint8)
    return np.concatenate([frame, event_picture(grey, shown)], axis=1)
