"""The packet: everything that falls between two instants of a simulated sequence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .events import EventArray
from .pose import Pose


@dataclass(frozen=True, eq=False)
class Packet:
    """One step of a sequence: its events, and what fell due at its end.

    Consecutive packets tile time without a gap or an overlap, so their events in order are the stream.

    Attributes:
        start_us, end_us: the interval in microseconds from the start of the sequence; events lie in
            (start_us, end_us]. The first packet has start_us == end_us and no events: it only sets the references.
        events: the events, ``EVENT_DTYPE``, sorted by (t, y, x).
        pose: T_world_camera at ``end_us``; None where no camera moved: events from frames.
        luma: linear luma, float32 (H, W), where an intensity frame fell due at ``end_us``, else None.
        depth: z along the optical axis in metres, float32 (H, W), inf where nothing is hit, where a depth map fell
            due at ``end_us``, else None.
        frame: the intensity frame as active pixels made it (exposed, noisy, digitised), float32 (H, W), in units of
            luma, where one fell due and :class:`~davis_rs.effects.Aps` is on; else None, and ``luma`` is the frame.
    """

    start_us: int
    end_us: int
    events: EventArray
    pose: Pose | None
    luma: npt.NDArray[np.float32] | None = None
    depth: npt.NDArray[np.float32] | None = None
    frame: npt.NDArray[np.float32] | None = None
