"""Measures what an active pixel's frames differ by from exact luma at an instant."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...sampling.exposure import expose
from ...sensor.effects import Aps
from .sequence_sample import SequenceSample

_FRAMES = 4
_WHITE_PERCENTILE, _WHITE = 99.0, 0.8
"""Where the frames' full scale is not given: as frames are written by default."""

BLUR_PX = 0.5
"""A motion during the exposure that is worth a blur: a pixel's half, from which on sub-frames differ."""


class FrameChange(NamedTuple):
    """Says what neglecting the effect changes in frames.

    Attributes:
        percent: of the pixels of 8-bit frames that change by more than one grey value.
        blurred_percent: of the pixels whose image moves by more than :data:`BLUR_PX` while the shutter is open.
        observation: in words.
    """

    percent: float
    blurred_percent: float
    observation: str


def frame_change(sequence: SequenceSample, aps: Aps) -> FrameChange:
    """Compare frames of some instants, read out and exact, both as they would be written in 8 bits."""
    t_us = np.unique(np.linspace(0, sequence.duration_us, _FRAMES + 1).astype(np.int64)[1:])
    exact = sequence.luma(t_us)
    read = np.stack([aps_frame(sequence, aps, t, luma, i) for i, (t, luma) in enumerate(zip(t_us, exact, strict=True))])
    white = aps.full_scale_luma or float(np.percentile(exact, _WHITE_PERCENTILE)) / _WHITE or 1.0
    grey = [np.rint(np.clip(255 / white * frames.astype(np.float64), 0, 255)) for frames in (exact, read)]
    changed = 100 * float((np.abs(grey[0] - grey[1]) > 1).mean())
    flow = np.nan_to_num(sequence.renderer.flow(sequence.stretch.views(sequence.stretch.start_us + t_us)))
    # What moves while a row is exposed is blurred, what moves while rows are read is skewed.
    open_us = aps.exposure_us + aps.readout_us(sequence.camera.height)
    moved_px = np.linalg.norm(flow, axis=-1) * open_us * 1e-6
    saturated = 100 * float((exact >= white).mean()) if aps.full_scale_luma else 0.0
    in_the_dark = (aps.read_noise_dn, aps.dsnu_dn, aps.column_offset_dn, aps.column_noise_dn)
    noise = float(np.linalg.norm(in_the_dark)) * 255 / (2.0 ** (aps.bits or 10) - 1)
    observation = (
        f"time the shutter takes x flow up to {moved_px.max():.3g} px (median {np.median(moved_px):.2g}); noise in the "
        f"dark {noise:.2g} grey values of 8 bits; {saturated:.3g} % saturated; {changed:.3g} % of pixels change by "
        f"more than one of them"
    )
    return FrameChange(changed, 100 * float((moved_px > BLUR_PX).mean()), observation)


def aps_frame(
    sequence: SequenceSample, aps: Aps, t_us: int, luma: npt.NDArray[np.float32], number: int
) -> npt.NDArray[np.float32]:
    """Return the frame at ``t_us`` of the sequence, where ``luma`` is seen, as the active pixels have it."""
    at_us = sequence.stretch.start_us + int(t_us)
    exposed = expose(luma, [sequence.stretch], at_us, round(aps.exposure_us), aps.row_readout_us)
    return aps.read_out(exposed, frame=number, seed=sequence.seed)
