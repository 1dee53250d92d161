"""Reads a sequence's folder as arrays, which shards hold."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..io.dataset.files import (
    DEPTH_MAPS,
    DISPLACEMENTS,
    EVENT_TRUTH,
    EVENTS,
    FLOW_MAPS,
    FRAMES,
    GROUND_TRUTH,
    INERTIAL,
    LUMA_MAPS,
    MASKS,
    META,
    NORMAL_MAPS,
    SIGNAL,
    VELOCITY,
    ImageSeries,
)
from ..io.dataset.reader import Dataset
from ..io.dataset.text_folder import StampedImage
from .folder import file_names

Arrays = dict[str, npt.NDArray[np.generic]]


class SequenceArrays(NamedTuple):
    """Holds a sequence as arrays.

    Attributes:
        meta: ``meta.json``, as it is.
        groups: for each kind of data its columns or maps by name; every group has ``t``, int64, microseconds.
            ``events``: t, x, y uint16, p uint8, and signal uint8 where they are labelled; ``frames``, ``depth``,
            ``luma``, ``flow``, ``normals``: ``maps`` (n, H, W) or (n, H, W, channels); ``masks``: ``maps`` uint16;
            ``displacement``: ``maps``, ``occluded``;
            ``poses``: ``position`` (n, 3) m, ``quaternion`` (n, 4) x y z w; ``imu``: ``accel``, ``gyro``;
            ``velocity``: ``velocity``, ``angular_rate``, ``acceleration``, ``angular_acceleration``;
            ``event_truth``: as the file's columns.
        files: all other files, as they are, by name.
    """

    meta: bytes
    groups: dict[str, Arrays]
    files: dict[str, bytes]


def read_sequence(folder: Path) -> SequenceArrays:
    """Read all of a sequence's folder.

    Raises:
        OSError, DecodeError: if something in it cannot be read.
    """
    dataset = Dataset(folder)
    events = dataset.events
    groups: dict[str, Arrays] = {
        "events": {"t": events["t"].astype(np.int64), **{name: events[name] for name in ("x", "y")}}
    }
    groups["events"]["p"] = events["p"].astype(np.uint8)
    if len(dataset.signal) == len(events):
        groups["events"]["signal"] = dataset.signal.astype(np.uint8)
    maps: dict[str, tuple[ImageSeries, Sequence[StampedImage], Callable[[int], npt.NDArray[np.generic]]]] = {
        "frames": (FRAMES, dataset.frames, dataset.read_image),
        "depth": (DEPTH_MAPS, dataset.depth_maps, dataset.read_depth),
        "luma": (LUMA_MAPS, dataset.luma, dataset.read_luma),
        "flow": (FLOW_MAPS, dataset.flow_maps, dataset.read_flow),
        "masks": (MASKS, dataset.masks, dataset.read_mask),
        "normals": (NORMAL_MAPS, dataset.normal_maps, dataset.read_normals),
    }
    taken = {META, EVENTS, GROUND_TRUTH, INERTIAL, VELOCITY, SIGNAL, *EVENT_TRUTH.values()}
    for name, (series, images, read) in maps.items():
        taken |= {series.list_name, *(image.path.relative_to(folder).as_posix() for image in images)}
        if images:
            groups[name] = {"t": _times(images), "maps": np.stack([read(k) for k in range(len(images))])}
    if dataset.displacements:
        moved = [dataset.read_displacement(k) for k in range(len(dataset.displacements))]
        groups["displacement"] = {
            "t": _times(dataset.displacements),
            "maps": np.stack([displacement.pixels for displacement in moved]),
            "occluded": np.stack([displacement.occluded for displacement in moved]).astype(np.uint8),
        }
        taken |= {image.path.relative_to(folder).as_posix() for image in dataset.displacements}
    taken.add(DISPLACEMENTS.list_name)
    if (folder / GROUND_TRUTH).exists():
        truth = dataset.groundtruth
        groups["poses"] = {"t": truth.t_us, "position": truth.positions, "quaternion": truth.quaternions}
    if (folder / INERTIAL).exists():
        samples = dataset.imu
        groups["imu"] = {name: np.ascontiguousarray(samples[name]) for name in ("t", "accel", "gyro")}
    if (folder / VELOCITY).exists():
        moving = dataset.velocities
        names = ("t", "velocity", "angular_rate", "acceleration", "angular_acceleration")
        groups["velocity"] = dict(zip(names, moving, strict=True))
    if (columns := _event_truth(folder)) is not None:
        groups["event_truth"] = columns
    rest = [name for name in file_names(folder) if name not in taken]
    return SequenceArrays((folder / META).read_bytes(), groups, {name: (folder / name).read_bytes() for name in rest})


def _times(images: Sequence[StampedImage]) -> npt.NDArray[np.int64]:
    return np.array([image.t_us for image in images], np.int64)


def _event_truth(folder: Path) -> Arrays | None:
    if (folder / EVENT_TRUTH["h5"]).exists():
        import h5py

        with h5py.File(folder / EVENT_TRUTH["h5"]) as file:
            columns = {name: file[name][()] for name in file}
            return {**columns, "shape_names": np.array(json.loads(file.attrs["shape_names"]), np.str_)}
    if (folder / EVENT_TRUTH["npz"]).exists():
        with np.load(folder / EVENT_TRUTH["npz"]) as archive:
            return {name: archive[name] for name in archive.files}
    return None
