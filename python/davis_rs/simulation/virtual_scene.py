"""Feeds a virtual camera from a simulated scene: what the simulator computes, as the words a DAVIS would send."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from .._core import Device, Encoder
from .._util.progress import progress
from ..events.decoded import Frame
from ..scene.scene import Scene
from ..usb.virtual_davis import VIRTUAL_CHIPS, VirtualDavis
from .simulator import Simulator

_EXPOSURE_US = 4000
_WHITE_PERCENTILE, _WHITE_SHARE = 98.0, 0.8
_FULL_SCALE = 1023


def virtual_davis_of_scene(
    scene: Scene, *, duration_s: float | None = None, show_progress: bool = False
) -> VirtualDavis:
    """Make a virtual camera that sees a scene from the scene's own camera path: events and frames, then nothing.

    The scene is simulated here, before anything is sent, so that the camera can keep time.

    Args:
        scene: its camera must have the size of one of the virtual cameras.
        duration_s: how much of its path; all if not given.
        show_progress: how far it is, on standard error.

    Raises:
        ValueError: for a camera of another size, or a scene that cannot be simulated so long.
    """
    scene = scene.crop(0.0, duration_s)
    simulator = Simulator(scene)
    chip = _chip_of_size(simulator.camera.width, simulator.camera.height)
    encoder = Encoder(chip)
    stream: list[tuple[int, bytes]] = []
    scale: float | None = None
    with progress(f"simulating {scene.name}", scene.path.duration_s, unit="s", show=show_progress) as bar:
        for packet in simulator.run():
            frames = []
            if packet.luma is not None:
                scale = scale or _full_scale_of(packet.luma)
                exposed_us = max(packet.start_us, packet.end_us - _EXPOSURE_US)
                if exposed_us < packet.end_us:
                    frames.append(_frame(packet.luma * scale, exposed_us, packet.end_us))
            stream.append((packet.end_us, encoder.encode(packet.events, frames=frames)))
            bar.to(min(packet.end_us * 1e-6, scene.path.duration_s))

    def source() -> Iterator[tuple[int, bytes]]:
        return iter(stream)

    return VirtualDavis(source, chip=chip)


def _chip_of_size(width: int, height: int) -> str:
    sizes = {}
    for name in VIRTUAL_CHIPS:
        device = Device(name)
        sizes[device.width, device.height] = name
    if (width, height) not in sizes:
        known = ", ".join(f"{w} x {h} ({name})" for (w, h), name in sizes.items())
        raise ValueError(f"a virtual camera has {known} pixels, the scene's has {width} x {height}")
    return sizes[width, height]


def _full_scale_of(luma: npt.NDArray[np.float32]) -> float:
    white = float(np.percentile(luma, _WHITE_PERCENTILE))
    return _WHITE_SHARE / white if white > 0 else 1.0


def _frame(values: npt.NDArray[np.float32], start_us: int, end_us: int) -> Frame:
    pixels = (np.rint(np.clip(values, 0, 1) * _FULL_SCALE)).astype(np.uint16) << 6
    return Frame(start_us, start_us, end_us, end_us, 0, 0, pixels.astype(np.uint16), exposure_us=end_us - start_us)
