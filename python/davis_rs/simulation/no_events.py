"""Warns of a run that makes no events, or cannot make any."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator

from ..events.packet import Packet


class NoEventsWarning(UserWarning):
    """Warns that a run made no events, or that changes of light cannot make any, because a threshold is too large."""


def warned_without_events(
    packets: Iterator[Packet], contrast_thresholds: tuple[float, float], log_eps: float, *, stacklevel: int = 2
) -> Iterator[Packet]:
    """Yield a run's packets as they come, and warn at the first one or at the end.

    Args:
        packets: of the whole run.
        contrast_thresholds: C of ON and of OFF events.
        log_eps: dark level in units of luma.
        stacklevel: of the warnings; 2 is who takes the packets.

    Warns:
        NoEventsWarning: if the smaller threshold is above the whole range of the image, from the dark level to white
            (luma 1, or the brightest of the first frame where that is more); else if no event came until the end.
    """
    threshold = min(contrast_thresholds)
    first: Packet | None = None
    events, end_us, hopeless = 0, 0, False
    darkest, brightest = math.inf, 0.0
    for packet in packets:
        if packet.luma is not None:
            darkest, brightest = min(darkest, float(packet.luma.min())), max(brightest, float(packet.luma.max()))
        if first is None:
            first = packet
            most = math.log1p(max(brightest, 1.0) / log_eps)
            hopeless = threshold > most
            if hopeless:
                warnings.warn(
                    f"the contrast threshold {threshold:g} is above the whole range of the image, which is {most:.3g} "
                    f"in log intensity, from the dark level {log_eps:.3g} to white: changes of light make no events",
                    NoEventsWarning,
                    stacklevel=stacklevel,
                )
        events, end_us = events + len(packet.events), packet.end_us
        yield packet
    if first is None or events or hopeless:
        return
    span = math.log((brightest + log_eps) / (darkest + log_eps)) if brightest >= darkest else math.inf
    why = f"all frames together span {span:.3g}" if span < threshold else "every pixel changed by less"
    warnings.warn(
        f"0 events in {(end_us - first.start_us) / 1e6:.6g} s: the contrast threshold is {threshold:g} in log "
        f"intensity, and {why}",
        NoEventsWarning,
        stacklevel=stacklevel,
    )
