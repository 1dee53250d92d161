"""A small sequence that keeps every promise of a dataset, and writing it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from davis_rs import EVENT_DTYPE, CrossingEngine
from davis_rs.events.arrays import EventArray
from davis_rs.events.packet import Packet
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.pose import Pose
from davis_rs.io.dataset.writer import DatasetWriter

WIDTH, HEIGHT = 24, 18
CAMERA = Camera(WIDTH, HEIGHT, 20.5, 20.25, 11.5, 8.5, k1=-0.1)
STEP_US, STEPS, FRAME_STEPS, DEPTH_STEPS = 1_000, 60, 10, 20


def luma_at(step: int) -> npt.NDArray[np.float32]:
    """A pattern that moves to the right: linear luma, float32 (HEIGHT, WIDTH)."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    luma: npt.NDArray[np.float64] = np.exp(np.sin(0.7 * (x - 0.11 * step)) + 0.5 * np.cos(0.5 * y))
    return luma.astype(np.float32)


def depth_at(step: int) -> npt.NDArray[np.float32]:
    """A slanted plane that comes nearer, below a sky that nothing hits: float32 (HEIGHT, WIDTH), metres."""
    depth = np.repeat(np.linspace(3.0, 1.0, HEIGHT)[:, None], WIDTH, axis=1) - 0.001 * step
    depth[:3] = np.inf
    return depth.astype(np.float32)


def pose_at(step: int) -> Pose:
    return Pose(np.array([0.1 * step, 1 / 3, -2.0]), np.array([np.sin(0.01 * step), 0.0, 0.0, np.cos(0.01 * step)]))


def packets(c_on: float = 0.15, c_off: float = 0.15, **start: Any) -> Iterator[Packet]:
    """An honest sequence: what the crossing engine makes of the moving pattern."""
    engine = CrossingEngine(WIDTH, HEIGHT, contrast_threshold=c_on, contrast_threshold_off=c_off, **start)
    for step in range(STEPS + 1):
        luma = luma_at(step)
        t_us = step * STEP_US
        yield Packet(
            max(0, t_us - STEP_US),
            t_us,
            engine.push(t_us, luma),
            pose_at(step),
            luma if step % FRAME_STEPS == 0 else None,
            depth_at(step) if step % DEPTH_STEPS == 0 else None,
        )


def parameters(c_on: float = 0.15, c_off: float = 0.15) -> dict[str, Any]:
    return {
        "contrast_threshold": c_on,
        "contrast_threshold_off": c_off,
        "log_eps": 1e-3,
        "frame_rate_hz": 1e6 / (FRAME_STEPS * STEP_US),
        "depth_rate_hz": 1e6 / (DEPTH_STEPS * STEP_US),
    }


def write_sequence(
    path: Path, *, c_on: float = 0.15, c_off: float = 0.15, check_frames: int = 2, **start: Any
) -> EventArray:
    """Write the honest sequence as a dataset; return its events. ``start`` is start_phase and seed."""
    written = list(packets(c_on, c_off, **start))
    with DatasetWriter(path, CAMERA, check_frames=check_frames) as writer:
        for packet in written:
            assert packet.pose is not None
            writer.write(packet, [(packet.end_us, packet.pose)])
        writer.finish({"parameters": parameters(c_on, c_off) | start})
    return np.concatenate([packet.events for packet in written])


def some_events(*rows: tuple[int, int, int, int]) -> EventArray:
    return np.array(list(rows), EVENT_DTYPE)


def packet_of(start_us: int, end_us: int, *rows: tuple[int, int, int, int], **images: Any) -> Packet:
    return Packet(start_us, end_us, some_events(*rows), pose_at(0), **images)
