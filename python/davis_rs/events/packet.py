"""Defines the packet: everything that falls between two instants of a simulated sequence."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..geometry.pose import Pose
from .arrays import EventArray


class Displacement(NamedTuple):
    """Says how far the points that a frame's pixels see move in the image within some time.

    Attributes:
        pixels: float32 (H, W, 2), how far each goes in the image, pixels (x right, y down), through the lens. NaN where
            nothing is seen, and where the point ends behind the camera.
        occluded: bool (H, W), True where at the end another surface hides the point, or it lies behind the camera. A
            point that has left the image is not occluded by that.
    """

    pixels: npt.NDArray[np.float32]
    occluded: npt.NDArray[np.bool_]

    def __repr__(self) -> str:
        height, width = self.occluded.shape
        return f"<Displacement of {width} x {height} px, {np.count_nonzero(self.occluded):,} occluded>"


@dataclass(frozen=True, eq=False)
class Packet:
    """Holds one step of a sequence: its events, and the frame, depth map and other data at its end.

    Consecutive packets tile time without a gap or an overlap, so their events in order are the stream.

    Attributes:
        start_us, end_us: the interval in microseconds from the start of the sequence; events lie in
            (start_us, end_us]. The first packet has start_us == end_us and no events: it only sets the references.
        events: the events, ``EVENT_DTYPE``, sorted by (t, y, x); behind a bus
            (:class:`~davis_rs.sensor.effects.Readout`) by t, and in its order.
        pose: T_world_camera at ``end_us``; None where no camera moved: events from frames.
        luma: linear luma, float32 (H, W), where an intensity frame fell due at ``end_us``, else None.
        depth: z along the optical axis in metres, float32 (H, W), inf where nothing is hit, where a depth map fell
            due at ``end_us``, else None.
        frame: the intensity frame as active pixels made it (exposed, noisy, digitised), float32 (H, W), in units of
            luma, where one fell due and :class:`~davis_rs.sensor.effects.Aps` is on; else None, and ``luma`` is the
            frame.
        flow: optical flow in pixels per second (x right, y down), float32 (H, W, 2), NaN where nothing is hit, where it
            fell due at ``end_us``, else None.
        displacement: where the points that the pixels see at ``end_us`` are some time later, where flow fell due and
            the simulator has a ``flow_interval_s`` that ends before its path does, else None.
        shapes: uint16 (H, W), the number of the shape that each pixel sees, 1 for the first of
            :attr:`Simulator.shape_names` and 0 for nothing, where a mask fell due, else None.
        normals: float32 (H, W, 3), unit normals of the surfaces in camera axes (x right, y down, z ahead), on the side
            that is seen, NaN where nothing is hit, where a map fell due, else None.
        noiseless: with a ``signal_window_us``, the events that a twin of the pixels makes of the same light in the same
            interval, without noise; :class:`~davis_rs.SignalLabels` tells signal from noise by them. Else None.
    """

    start_us: int
    end_us: int
    events: EventArray
    pose: Pose | None
    luma: npt.NDArray[np.float32] | None = None
    depth: npt.NDArray[np.float32] | None = None
    frame: npt.NDArray[np.float32] | None = None
    flow: npt.NDArray[np.float32] | None = None
    displacement: Displacement | None = None
    shapes: npt.NDArray[np.uint16] | None = None
    normals: npt.NDArray[np.float32] | None = None
    noiseless: EventArray | None = None

    def __repr__(self) -> str:
        names = (field.name for field in fields(self)[3:])  # all but the interval and its events
        more = "".join(f", {name}" for name in names if getattr(self, name) is not None)
        return f"<Packet {self.start_us}..{self.end_us} us, {len(self.events):,} events{more}>"
