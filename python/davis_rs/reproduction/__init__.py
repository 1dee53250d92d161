"""Reproduces a recording: fits the sensor on one half, simulates the other half, and compares it with the recording.

``reproduce`` (all of it) -> ``clip`` (a recording with frames, and its halves), ``clip_light`` (the light from its
frames, the blur of their exposures undone), ``simulated`` (events of sensors that see it); ``clip_statistics`` and
``agreement`` measure a stream by sums over tiles of pixels, which ``resampling`` draws again and again for errors;
``reproduced`` holds a half's result, ``table`` prints it, ``reproduction`` holds all halves, ``figure`` draws them;
``still_light`` keeps noise of frames out of the light.

A recording tells how a sensor behaved, but not what it saw. Its frames do, so a simulation of the same light can be
held against the events. The half that is compared is never fitted.
"""

from .clip import RecordedClip, open_clip
from .reproduce import reproduce
from .reproduced import ReproducedHalf, Row
from .reproduction import Reproduction

__all__ = ["RecordedClip", "ReproducedHalf", "Reproduction", "Row", "open_clip", "reproduce"]
