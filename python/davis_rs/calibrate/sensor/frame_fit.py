"""Fits what recordings with frames tell, in addition to what their events do."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import takewhile
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...inspection.statistics.stream_statistics import Measured
from .exposure_fit import GROUPS, ExposureFit, fit_exposures
from .exposure_pairs import exposure_pairs
from .finding import Finding, combined
from .frame_noise import FrameNoise, fit_frame_noise
from .measured_recording import MeasuredRecording
from .noise_fit import noise_of_threshold
from .readout_fit import COLUMN_PARITY
from .threshold_fit import NotIdentifiable, ThresholdFit, fit_thresholds

_ON, _OFF = ("threshold ON", "contrast_threshold"), ("threshold OFF", "contrast_threshold_off")
_MISMATCH = ("threshold mismatch", "threshold_mismatch")
_BANDWIDTH = ("bandwidth", "source_follower_bandwidth_hz")
_OVER_LIGHT = ("bandwidth over light", "photoreceptor_bandwidth_hz")
_AT_LUX = ("  in the light of", "photoreceptor_bandwidth_lux")
_EXPOSURE, _READ = ("exposure of frames", "aps_exposure_us"), ("read noise of frames", "aps_read_noise_dn")

BLACK_LEVEL = "black level of frames"
"""What the finding of the value without light is called."""

_LONG_EXPOSURE_US = 10_000.0
"""From this exposure on frames are taken as integrals of the light, not as its value at an instant."""

_LEAST_SIGNIFICANCE = 4.0
"""Of lags: one over a lag that is less certain is not known to a factor of two."""


def find_of_frames(recordings: Sequence[MeasuredRecording], leak_hz: Measured | None) -> Iterator[Finding]:
    """Yield thresholds, mismatch, bandwidth, exposure and noise of frames, each found or with the reason why not."""
    framed = [one for one in recordings if one.samples is not None]
    if not framed:
        why = "there are no frames"
        for names in (_ON, _OFF, _MISMATCH, _BANDWIDTH, _OVER_LIGHT, _EXPOSURE, _READ):
            yield Finding(*names, None, why)
        return
    fits, blurred, receptors, reasons = list[ThresholdFit](), list[ExposureFit](), [], []
    for recording in framed:
        fitted = _fitted(recording, leak_hz)
        if isinstance(fitted, str):
            reasons.append(f"{recording.statistics.name}: {fitted}" if len(framed) > 1 else fitted)
        elif isinstance(fitted, ExposureFit):
            blurred.append(fitted)
        else:
            fits.append(fitted)
            if (receptor := _receptor(recording, fitted)) is not None:
                receptors.append(receptor)
    if fits:
        yield from _of_thresholds(fits, blurred)
        yield from _of_lags(fits, receptors, all(one.lux is None for one in framed))
    elif blurred:
        yield from _of_exposures(blurred)
    else:
        for names in (_ON, _OFF, _MISMATCH, _BANDWIDTH, _OVER_LIGHT):
            yield Finding(*names, None, "; ".join(reasons) if names == _ON else "it needs thresholds")
    blacks = [*(one.black for one in fits), *(one.black for one in blurred)]
    if blacks:
        yield Finding(BLACK_LEVEL, None, blacks[0], "in units of the frames; below 0 it is the pixels' dark current")
    yield _exposure(framed)
    yield from _noise(framed, blacks[0].value if blacks else 0.0)


def _fitted(recording: MeasuredRecording, leak_hz: Measured | None) -> ThresholdFit | ExposureFit | str:
    """Fit thresholds to samples at single instants where these are enough and exposures are short; to all pairs of
    frames otherwise. Or say why there are none."""
    assert recording.samples is not None
    short = recording.samples.exposure_us < _LONG_EXPOSURE_US
    if short:
        try:
            return _thresholds(recording, leak_hz)
        except NotIdentifiable as reason:
            fitted = _exposures(recording, leak_hz)
            return f"{reason}; {fitted}" if isinstance(fitted, str) else fitted
    fitted = _exposures(recording, leak_hz)
    if isinstance(fitted, str):
        try:
            return _thresholds(recording, leak_hz)
        except NotIdentifiable as reason:
            return f"{fitted}; {reason}"
    return fitted


def _exposures(recording: MeasuredRecording, leak_hz: Measured | None) -> ExposureFit | str:
    source, events = recording.source, recording.events
    if source is None or not len(events):
        return "there are no events next to the frames"
    last_us, width = int(events["t"][-1]), recording.statistics.size[0]
    frames = takewhile(lambda frame: frame.t_us - frame.exposure_us / 2 <= last_us, source.frames())
    pairs = exposure_pairs(events, frames, width, groups=GROUPS, left_out=_hot(recording))
    return fit_exposures(pairs, leak_hz=0.0 if leak_hz is None else leak_hz.value, black=source.black)


def _hot(recording: MeasuredRecording) -> npt.NDArray[np.bool_]:
    """Return which pixels are hot, (H, W)."""
    events = recording.statistics
    hot = np.zeros((events.size[1], events.size[0]), np.bool_)
    hot[events.hot_pixels.y, events.hot_pixels.x] = True
    return hot


def _of_exposures(fits: Sequence[ExposureFit]) -> Iterator[Finding]:
    said = (
        f"{sum(one.pairs for one in fits):,} pairs of frames; {100 * max(one.blurred for one in fits):.2g} % of their "
        f"events fall into exposures; ratios scatter by {max(one.noise for one in fits):.2g}"
    )
    yield Finding(*_ON, combined([one.on for one in fits]), said)
    yield Finding(*_OFF, combined([one.off for one in fits]), said)
    yield Finding(*_MISMATCH, None, "single pixels have too few pairs of frames")
    for names in (_BANDWIDTH, _OVER_LIGHT):
        yield Finding(*names, None, "frames are too few, or too long, to tell how far events are behind")


class _Receptor(NamedTuple):
    """Holds, of a recording, the lag in any light, and what the photoreceptor's lag times illuminance is."""

    lag_s: Measured
    lag_lux: Measured
    lux: float


def _thresholds(recording: MeasuredRecording, leak_hz: Measured | None) -> ThresholdFit:
    """With two parts of the lag, if the light is known and both can be told; with one otherwise."""
    samples, source, width = recording.samples, recording.source, recording.statistics.size[0]
    assert samples is not None
    assert source is not None
    noise = noise_of_threshold(recording.statistics)
    fit = partial(
        fit_thresholds, samples, width, leak_hz=leak_hz, black=source.black, left_out=_hot(recording), noise=noise
    )
    fitted = fit(over_light=recording.lux is not None)
    return fit() if fitted.lag_by_light is not None and _receptor(recording, fitted) is None else fitted


def _receptor(recording: MeasuredRecording, fit: ThresholdFit) -> _Receptor | None:
    """Return what tells the photoreceptor; None where that lags too little to be told."""
    by_light, lux, samples = fit.lag_by_light, recording.lux, recording.samples
    if by_light is None or lux is None or samples is None or not _is_told(by_light):
        return None
    # The quiet pixels are those whose light is known.
    values = samples.mean[recording.statistics.quiet]
    values = values[np.isfinite(values)]
    if not len(values) or not values.mean() > fit.black.value:
        return None
    per_value = lux / float(values.mean() - fit.black.value)
    return _Receptor(fit.lag_s, Measured(by_light.value * per_value, by_light.sigma * per_value), lux)


def _of_thresholds(fits: Sequence[ThresholdFit], blurred: Sequence[ExposureFit]) -> Iterator[Finding]:
    pairs, pixels = sum(one.pairs for one in fits), sum(one.pixels for one in fits)
    black = ", ".join(str(one.black) for one in fits)
    outliers, noise = (max(values) for values in zip(*((one.outliers, one.noise) for one in fits), strict=True))
    said = (
        f"{pairs:,} pairs of frames in {pixels:,} pixels; black level of the frames {black}; log ratios scatter by "
        f"{noise:.2g}, {100 * outliers:.2g} % outliers"
    )
    yield Finding(*_ON, combined([*(one.on for one in fits), *(one.on for one in blurred)]), said)
    yield Finding(*_OFF, combined([*(one.off for one in fits), *(one.off for one in blurred)]), said)
    mismatch = [one.mismatch for one in fits if one.mismatch is not None]
    if mismatch:
        yield Finding(*_MISMATCH, combined(mismatch), "what both halves of a pixel's pairs have in common")
    else:
        yield Finding(*_MISMATCH, None, "single pixels have too few pairs of frames")
    yield Finding(*COLUMN_PARITY, combined([one.parity for one in fits]), "of thresholds")


def _of_lags(fits: Sequence[ThresholdFit], receptors: Sequence[_Receptor], dark: bool) -> Iterator[Finding]:
    if receptors:
        yield _bandwidth([one.lag_s for one in receptors], "the part of the lag that does not go with light")
        product = combined([one.lag_lux for one in receptors])
        lux = float(np.mean([one.lux for one in receptors]))
        said = (
            f"the lag's other part, {Measured(1e6 * product.value / lux, 1e6 * product.sigma / lux)} us there, goes by "
            "one over the frames' values"
        )
        yield Finding(*_OVER_LIGHT, _corner(Measured(product.value / lux, product.sigma / lux)), said)
        yield Finding(*_AT_LUX, Measured(lux, math.inf), "as it was given for quiet pixels")
        return
    yield _bandwidth([one.lag_s for one in fits], "in the recordings' light")
    why = "it needs the light (--lux)" if dark else "bright and dark pixels lag alike, within the errors"
    yield Finding(*_OVER_LIGHT, None, why)


def _bandwidth(lags: Sequence[Measured], of_which: str) -> Finding:
    lag = combined(lags)
    behind = f"events are {Measured(1e6 * lag.value, 1e6 * lag.sigma)} us behind the middle of the exposure, {of_which}"
    return Finding(*_BANDWIDTH, _corner(lag) if _is_told(lag) else None, behind)


def _is_told(lag: Measured) -> bool:
    return lag.value > _LEAST_SIGNIFICANCE * lag.sigma


def _corner(lag_s: Measured) -> Measured:
    """Return the corner that lags so much. Its error is the one to higher frequencies, which is the larger one."""
    corner = 1 / (2 * math.pi * lag_s.value)
    return Measured(corner, corner * lag_s.sigma / (lag_s.value - lag_s.sigma))


def _exposure(framed: Sequence[MeasuredRecording]) -> Finding:
    told = sorted({round(one.samples.exposure_us) for one in framed if one.samples and one.samples.exposure_us > 0})
    if not told:
        return Finding(*_EXPOSURE, None, "the recordings do not tell it")
    if len(told) > 1:
        return Finding(*_EXPOSURE, None, f"it differs: {told[0]:,} to {told[-1]:,} us (medians of the recordings)")
    return Finding(*_EXPOSURE, Measured(float(told[0]), math.inf), "as the recordings tell it")


def _noise(framed: Sequence[MeasuredRecording], black: float) -> Iterator[Finding]:
    noises, reasons = [], []
    for recording in framed:
        assert recording.samples is not None
        noise = fit_frame_noise(recording.samples.noise, recording.samples.lowest, recording.samples.highest, black)
        if isinstance(noise, FrameNoise):
            noises.append(noise)
        else:
            reasons.append(noise)
    if not noises:
        yield Finding(*_READ, None, "; ".join(sorted(set(reasons))))
        return
    of_camera = all(one.source is not None and one.source.of_camera for one in framed)
    parameter = _READ[1] if of_camera else None
    unit = "" if of_camera else "in grey values of the frames; "
    gain = combined([one.gain for one in noises])
    said = f"{unit}its square grows by {gain} a value (photon transfer)"
    yield Finding(_READ[0], parameter, combined([one.read for one in noises]), said)
