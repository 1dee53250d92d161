"""What recordings with frames tell, in addition to what their events do."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ..stream_statistics.stream_statistics import Measured
from .finding import Finding, combined
from .frame_noise import FrameNoise, fit_frame_noise
from .measured_recording import MeasuredRecording
from .readout_fit import COLUMN_PARITY
from .threshold_fit import NotIdentifiable, ThresholdFit, fit_thresholds

_ON, _OFF = ("threshold ON", "contrast_threshold"), ("threshold OFF", "contrast_threshold_off")
_MISMATCH = ("threshold mismatch", "threshold_mismatch")
_BANDWIDTH = ("bandwidth", "source_follower_bandwidth_hz")
_EXPOSURE, _READ = ("exposure of frames", "aps_exposure_us"), ("read noise of frames", "aps_read_noise_dn")


def find_of_frames(recordings: Sequence[MeasuredRecording], leak_hz: Measured | None) -> Iterator[Finding]:
    """Thresholds, mismatch, bandwidth, exposure and noise of frames, each found or with the reason why not."""
    framed = [one for one in recordings if one.samples is not None]
    if not framed:
        why = "there are no frames"
        for names in (_ON, _OFF, _MISMATCH, _BANDWIDTH, _EXPOSURE, _READ):
            yield Finding(*names, None, why)
        return
    fits, reasons = [], []
    for one in framed:
        try:
            fits.append(_thresholds(one, leak_hz))
        except NotIdentifiable as reason:
            reasons.append(f"{one.statistics.name}: {reason}" if len(framed) > 1 else str(reason))
    if fits:
        yield from _of_thresholds(fits)
    else:
        for names in (_ON, _OFF, _MISMATCH, _BANDWIDTH):
            yield Finding(*names, None, "; ".join(reasons) if names == _ON else "it needs thresholds")
    yield _exposure(framed)
    yield from _noise(framed, fits)


def _thresholds(recording: MeasuredRecording, leak_hz: Measured | None) -> ThresholdFit:
    samples, source, events = recording.samples, recording.source, recording.statistics
    assert samples is not None
    assert source is not None
    hot = np.zeros((events.size[1], events.size[0]), np.bool_)
    hot[events.hot_pixels.y, events.hot_pixels.x] = True
    return fit_thresholds(samples, events.size[0], leak_hz=leak_hz, black=source.black, left_out=hot)


def _of_thresholds(fits: Sequence[ThresholdFit]) -> Iterator[Finding]:
    pairs, pixels = sum(one.pairs for one in fits), sum(one.pixels for one in fits)
    black = ", ".join(str(one.black) for one in fits)
    outliers, noise = (max(values) for values in zip(*((one.outliers, one.noise) for one in fits), strict=True))
    said = (
        f"{pairs:,} pairs of frames in {pixels:,} pixels; black level of the frames {black}; log ratios scatter by "
        f"{noise:.2g}, {100 * outliers:.2g} % outliers"
    )
    yield Finding(*_ON, combined([one.on for one in fits]), said)
    yield Finding(*_OFF, combined([one.off for one in fits]), said)
    mismatch = [one.mismatch for one in fits if one.mismatch is not None]
    if mismatch:
        yield Finding(*_MISMATCH, combined(mismatch), "what both halves of a pixel's pairs have in common")
    else:
        yield Finding(*_MISMATCH, None, "single pixels have too few pairs of frames")
    yield Finding(*COLUMN_PARITY, combined([one.parity for one in fits]), "of thresholds")
    lag = combined([one.lag_s for one in fits])
    if lag.value > 3 * lag.sigma:
        corner = 1 / (2 * math.pi * lag.value)
        behind = (
            f"events are {1e6 * lag.value:.4g} +- {1e6 * lag.sigma:.2g} us behind the middle of the exposure, in the "
            "recordings' light"
        )
        yield Finding(*_BANDWIDTH, Measured(corner, corner * lag.sigma / lag.value), behind)
    else:
        yield Finding(
            *_BANDWIDTH, None, f"events are {1e6 * lag.value:.3g} +- {1e6 * lag.sigma:.2g} us behind the frames"
        )


def _exposure(framed: Sequence[MeasuredRecording]) -> Finding:
    told = sorted({round(one.samples.exposure_us) for one in framed if one.samples and one.samples.exposure_us > 0})
    if not told:
        return Finding(*_EXPOSURE, None, "the recordings do not tell it")
    if len(told) > 1:
        return Finding(*_EXPOSURE, None, f"it differs: {told[0]:,} to {told[-1]:,} us (medians of the recordings)")
    return Finding(*_EXPOSURE, Measured(float(told[0]), math.inf), "as the recordings tell it")


def _noise(framed: Sequence[MeasuredRecording], fits: Sequence[ThresholdFit]) -> Iterator[Finding]:
    black = fits[0].black.value if fits else 0.0
    found, reasons = [], []
    for one in framed:
        assert one.samples is not None
        noise = fit_frame_noise(one.samples.noise, one.samples.lowest, one.samples.highest, black)
        if isinstance(noise, FrameNoise):
            found.append(noise)
        else:
            reasons.append(noise)
    if not found:
        yield Finding(*_READ, None, "; ".join(sorted(set(reasons))))
        return
    of_camera = all(one.source is not None and one.source.of_camera for one in framed)
    parameter = _READ[1] if of_camera else None
    unit = "" if of_camera else "in grey values of the frames; "
    gain = combined([one.gain for one in found])
    said = f"{unit}its square grows by {gain} a value (photon transfer)"
    yield Finding(_READ[0], parameter, combined([one.read for one in found]), said)
