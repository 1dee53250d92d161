"""Writes a sequence as a folder in the layout of the public Event-Camera Dataset."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType

import numpy as np
import numpy.typing as npt

from ..._util.argument_error import ArgumentError
from ..._util.array_types import JsonObject
from ..._util.close_names import names_checked
from ...events.arrays import EventArray, as_events
from ...events.packet import Packet
from ...geometry.camera import Camera
from ...geometry.pose import NO_VELOCITIES, Pose, PoseLike, Velocities, as_pose
from ...sensor.imu import IMU_DTYPE, Imu, ImuArray, as_imu, kalibr_camera_chain, kalibr_imu
from .displacement_png import encode_displacement
from .files import (
    CALIBRATION,
    DEPTH_MAPS,
    DISPLACEMENT_PNGS,
    DISPLACEMENTS,
    FLOW_MAPS,
    FRAMES,
    GROUND_TRUTH,
    INERTIAL,
    KALIBR_CAMERA_CHAIN,
    KALIBR_IMU,
    LUMA_MAPS,
    MASKS,
    META,
    META_PART,
    NORMAL_MAPS,
    SHAPE_NAMES,
    SIGNAL,
    VELOCITY,
    EventFile,
    ImageFiles,
    append_lines,
    as_grey,
    as_json,
    check_event_format,
    claim_folder,
    encode_exr,
    encode_png,
    pose_line,
    stamped_line,
    write_file,
)
from .signal_file import SignalFile

_FRAME_FULL_SCALE = 0.8
_FRAME_PERCENTILE = 98.0


def image_gain_for(frame: npt.NDArray[np.float32]) -> float:
    """Return the image gain that brings the frame's 98th percentile to 0.8 of full scale; 1.0 where that is black."""
    white = float(np.percentile(frame, _FRAME_PERCENTILE))
    return _FRAME_FULL_SCALE / white if white > 0 else 1.0


def check_image_gain(image_gain: float | None) -> None:
    """Refuse, by a ValueError, an image gain that is not positive and finite; None is one that is still to be
    chosen."""
    if image_gain is not None and not 0 < image_gain < math.inf:
        raise ArgumentError("{image_gain} must be positive and finite, got {}", image_gain)


@names_checked
class DatasetWriter:
    """Writes packets, as they come, into a dataset folder; a context manager.

    The folder has the layout of the public Event-Camera Dataset: ``events.txt``, ``images.txt`` with ``images/``,
    ``depthmaps.txt`` with ``depthmaps/``, ``groundtruth.txt``, ``imu.txt`` and ``calib.txt``. In addition there are
    ``luma.txt`` with ``luma/`` (exact linear luma, OpenEXR channel ``Y``, of the first frame, every ``check_frames``-th
    and the last: what :func:`~davis_rs.inspection.check.check_dataset` compares the events with) and ``meta.json``;
    with an IMU, Kalibr's ``imu.yaml`` and ``camchain.yaml``. Maps of the ground truth have lists and folders likewise:
    ``flow`` (OpenEXR channels ``U`` and ``V``, pixels per second), ``displacement`` (``U`` and ``V``, pixels, and
    ``occluded``, 0 or 1), ``displacement_png`` (the same as 16-bit PNG), ``masks`` (16-bit PNG, with the shapes' names
    in ``shapes.json``) and ``normals`` (``X``, ``Y``, ``Z``). A list that would be empty is not written.

    Every packet is on disk, as far as the operating system is concerned, when :meth:`write` returns, and an image is
    listed only once it is whole: a process that is killed leaves a folder that can be read up to its last packet,
    with ``"complete": false`` in ``meta.json`` (whose counts are then those of its last writing). An error while
    writing closes the files and surfaces at once.

    Args:
        path: the folder; made if it does not exist.
        camera: its size is the sensor's and its calibration goes to ``calib.txt``; or (width, height) in pixels where
            the lens is not known: then there is no ``calib.txt``, and ``meta.json`` says so.
        image_gain: a frame's grey value is round(255 * image_gain * luma), clipped to 0..255. By default it is chosen
            once, from the first frame, so that its 98th percentile comes to 0.8 of full scale (1.0 where that is
            black).
        overwrite: replace a dataset that is already there. Only the files of a dataset are removed; any others in the
            folder stay.
        check_frames: every how many frames the linear luma is stored too; 0 stores only the first and the last.
        shape_names: of the shapes in masks; number 1 is the first.
        flow_png: write displacements as PNG too: the encoding, ``kitti`` or ``dsec``.
        events_format: of the event file: "text" (``events.txt``), or another one (docs/formats.md), whose file then
            stands in its place. What a killed process leaves of it is told there.
        signal_window_us: label the events of packets, which have ``noiseless`` ones, as
            :class:`~davis_rs.SignalLabels` does with this window, in ``signal.npy``: bool, one label for each event in
            the order of the events, True for signal. In a folder whose writer was killed the last labels lack.
        imu: the IMU whose samples will be written: Kalibr's ``imu.yaml`` and ``camchain.yaml`` tell of it.
        meta: what is already known of the sequence, for ``meta.json``, so that a folder that is never finished has it.

    Raises:
        FileExistsError: if ``path`` is a file, or a folder that is not empty (with ``overwrite``: one that does not
            hold both ``events.txt`` and ``meta.json``, so that no other folder can be overwritten by mistake).
        OSError: if the folder cannot be written, here or later, naming the file; EBUSY if another writer has it.
        ValueError: for an image gain that is not positive and finite, a negative ``check_frames``, or an IMU with a
            camera with k3, for which Kalibr has no model, or without a camera.

    Source: Mueggler et al., "The Event-Camera Dataset and Simulator", IJRR 2017, section 5 (file formats).
    """

    def __init__(
        self,
        path: str | Path,
        camera: Camera | tuple[int, int],
        *,
        image_gain: float | None = None,
        overwrite: bool = False,
        check_frames: int = 8,
        shape_names: Sequence[str] = (),
        flow_png: str | None = None,
        events_format: str = "text",
        signal_window_us: int | None = None,
        imu: Imu | None = None,
        meta: Mapping[str, object] | None = None,
    ) -> None:
        check_image_gain(image_gain)
        if check_frames < 0:
            raise ArgumentError("{check_frames} must be >= 0, got {}", check_frames)
        self.path = Path(path)
        self.camera = camera if isinstance(camera, Camera) else None
        self.size = (camera.width, camera.height) if isinstance(camera, Camera) else camera
        check_event_format(events_format, self.size)
        self.image_gain = image_gain
        self._check_frames = check_frames
        self._meta = as_json(meta or {})
        self._end_us = 0
        self._pose_count, self._last_pose_us = 0, -1
        self._imu_count, self._last_imu_us = 0, -1
        texts = {} if self.camera is None else {CALIBRATION: self.camera.to_calib()}
        if imu is not None:
            if self.camera is None:
                raise ValueError("the IMU's pose is relative to the camera: give a camera")
            texts |= {KALIBR_IMU: kalibr_imu(imu), KALIBR_CAMERA_CHAIN: kalibr_camera_chain(self.camera, imu)}
        self._pending_luma: tuple[int, npt.NDArray[np.float32]] | None = None
        self._hold = claim_folder(self.path, overwrite=overwrite)
        self._open = True
        self._events = EventFile(self.path, events_format, self.size)
        window_us = signal_window_us
        self._signal = None if window_us is None else SignalFile(self.path / SIGNAL, self.size, window_us)
        self._frames = ImageFiles(self.path, FRAMES)
        self._depth_maps = ImageFiles(self.path, DEPTH_MAPS)
        self._luma_maps = ImageFiles(self.path, LUMA_MAPS)
        self._flow_maps, self._displacements = ImageFiles(self.path, FLOW_MAPS), ImageFiles(self.path, DISPLACEMENTS)
        self._flow_png = flow_png
        self._displacement_pngs = ImageFiles(self.path, DISPLACEMENT_PNGS)
        self._masks, self._normal_maps = ImageFiles(self.path, MASKS), ImageFiles(self.path, NORMAL_MAPS)
        self._velocity_count, self._last_velocity_us = 0, -1
        if shape_names:
            names = {str(number): name for number, name in enumerate(shape_names, 1)}
            texts[SHAPE_NAMES] = json.dumps(names, indent=2) + "\n"
        for name, text in texts.items():
            write_file(self.path / name, text.encode())
        self._write_meta(complete=False)

    def write(
        self,
        packet: Packet,
        poses: Iterable[tuple[int, PoseLike]] = (),
        imu: ImuArray | None = None,
        velocities: Velocities | None = None,
    ) -> None:
        """Append one packet, ``poses`` as (t_us, T_world_camera) to ``groundtruth.txt``, ``imu`` to ``imu.txt``,
        ``velocities`` to ``velocity.txt``.

        ``imu`` is (n,) of :data:`~davis_rs.IMU_DTYPE`. Poses, samples and velocities may be of other times than
        the packet.

        Raises:
            ValueError: if times go back or leave the packet's interval, or an array does not fit the sensor. Nothing
                of the packet is written then, and the writer can go on.
            OSError: if writing fails, naming the file. The writer is then closed; what was written stays readable.
        """
        self._require_open()
        events = self._checked_events(packet)
        largest = float(np.finfo(np.float32).max)
        luma = self._checked_image(packet.luma, "luma", packet.end_us, largest=largest)
        frame = self._checked_image(packet.frame, "frame", packet.end_us, largest=largest)
        depth = self._checked_image(packet.depth, "depth", packet.end_us, largest=math.inf)
        pose_list = self._checked_poses(poses)
        samples = self._checked_imu(imu)
        moving = self._checked_velocities(velocities)
        flow = self._checked_map(packet.flow, "flow", packet.end_us, 2)
        normals = self._checked_map(packet.normals, "normals", packet.end_us, 3)
        displacement, occluded = packet.displacement or (None, None)
        displacement = self._checked_map(displacement, "displacement", packet.end_us, 2)
        try:
            self._end_us = packet.end_us
            self._events.write(events)
            if self._signal is not None:
                self._signal.write(packet)
            if luma is not None:
                self._write_frame(packet.end_us, luma, luma if frame is None else frame)
            if depth is not None:
                self._depth_maps.write(packet.end_us, encode_exr({"Z": depth}))
            if flow is not None:
                self._flow_maps.write(packet.end_us, encode_exr({"U": flow[..., 0], "V": flow[..., 1]}))
            if displacement is not None and occluded is not None:
                channels = {
                    "U": displacement[..., 0],
                    "V": displacement[..., 1],
                    "occluded": occluded.astype(np.float32),
                }
                self._displacements.write(packet.end_us, encode_exr(channels))
                if self._flow_png is not None:
                    self._displacement_pngs.write(packet.end_us, encode_displacement(displacement, self._flow_png))
            if packet.shapes is not None:
                self._masks.write(packet.end_us, encode_png(np.ascontiguousarray(packet.shapes, np.uint16)))
            if normals is not None:
                self._normal_maps.write(
                    packet.end_us, encode_exr(dict(zip("XYZ", np.moveaxis(normals, -1, 0), strict=True)))
                )
            if len(moving.t_us):
                lines = map(stamped_line, moving.t_us.tolist(), np.concatenate(moving[1:], 1))
                append_lines(self.path / VELOCITY, "".join(lines))
                self._velocity_count += len(moving.t_us)
                self._last_velocity_us = int(moving.t_us[-1])
            if pose_list:
                append_lines(self.path / GROUND_TRUTH, "".join(pose_line(t_us, pose) for t_us, pose in pose_list))
                self._pose_count += len(pose_list)
                self._last_pose_us = pose_list[-1][0]
            if len(samples):
                values = np.concatenate([samples["accel"], samples["gyro"]], axis=1)
                lines = map(stamped_line, samples["t"].tolist(), values)
                append_lines(self.path / INERTIAL, "".join(lines))
                self._imu_count += len(samples)
                self._last_imu_us = int(samples["t"][-1])
        except OSError:
            self._abandon(interrupted=False)
            raise

    def finish(self, meta: Mapping[str, object] | None = None, *, interrupted: bool = False) -> JsonObject:
        """Close every file, write ``meta.json`` and return what it holds.

        ``meta.json`` holds ``meta`` (added to what the constructor was given) and, under keys that are the writer's
        own, ``sensor``, ``calibrated`` (whether there is a ``calib.txt``), ``image_gain`` (null where no frame was
        written), ``counts`` (``events``, ``on_events``, with labels ``signal_events``, ``frames``, ``depth_maps``,
        ``luma_maps``, ``poses``, ``imu_samples``), ``duration_us`` (the end of the last packet), ``complete`` and
        ``interrupted``.

        Args:
            meta: anything that JSON can hold; NumPy scalars and arrays and paths are converted.
            interrupted: the sequence ends before its time: ``complete`` becomes false and ``interrupted`` true.

        Raises:
            TypeError, ValueError: if ``meta`` holds what JSON cannot. The writer stays open.
            OSError: if writing fails, naming the file.
        """
        self._require_open()
        self._meta.update(as_json(meta or {}))
        self._open = False
        try:
            self._write_luma()
        finally:
            self._close_events()
        written = self._write_meta(complete=not interrupted, interrupted=interrupted)
        self._hold.release()
        return written

    def __enter__(self) -> DatasetWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish; where an exception leaves the block, keep what was written and let the exception through."""
        if not self._open:
            return
        if kind is None:
            self.finish()
        else:
            self._abandon(interrupted=issubclass(kind, KeyboardInterrupt))

    def _checked_events(self, packet: Packet) -> EventArray:
        start_us, end_us = packet.start_us, packet.end_us
        if not self._end_us <= start_us <= end_us:
            raise ValueError(
                f"packets must follow each other in time: this one runs from {start_us} us to {end_us} us, "
                f"the last one ended at {self._end_us} us"
            )
        events = as_events(packet.events)
        if not len(events):
            return events
        t_us, (width, height) = events["t"], self.size
        back = t_us[1:] < t_us[:-1]
        if back.any():
            at = int(back.argmax())
            raise ValueError(f"event times must not go back: {t_us[at + 1]} us follows {t_us[at]} us")
        if not (start_us < t_us[0] and t_us[-1] <= end_us):
            raise ValueError(
                f"events must lie in the packet's interval ({start_us}, {end_us}] us, got {t_us[0]} to {t_us[-1]} us"
            )
        wrong = (events["x"] >= width) | (events["y"] >= height) | (events["p"] > 1)
        if wrong.any():
            t, x, y, p = events[wrong.argmax()]
            raise ValueError(
                f"events must have x < {width}, y < {height} and p 0 or 1, got x = {x}, y = {y}, p = {p} at {t} us"
            )
        return events

    def _checked_poses(self, poses: Iterable[tuple[int, PoseLike]]) -> list[tuple[int, Pose]]:
        checked, last_us = [(t_us, as_pose(pose, "poses")) for t_us, pose in poses], self._last_pose_us
        for t_us, _ in checked:
            if t_us <= last_us:
                raise ValueError(f"pose times must be >= 0 and increase, got {t_us} us after {last_us} us")
            last_us = t_us
        return checked

    def _checked_imu(self, imu: ImuArray | None) -> ImuArray:
        samples = np.zeros(0, IMU_DTYPE) if imu is None else as_imu(imu)
        if len(samples) and samples["t"][0] <= self._last_imu_us:
            raise ValueError(
                f"IMU times must be >= 0 and increase, got {samples['t'][0]} us after {self._last_imu_us} us"
            )
        return samples

    def _checked_velocities(self, velocities: Velocities | None) -> Velocities:
        if velocities is None:
            return NO_VELOCITIES
        t_us = velocities.t_us
        if len(t_us) and (t_us[0] <= self._last_velocity_us or (np.diff(t_us) <= 0).any()):
            raise ValueError(f"times of velocities must be >= 0 and increase, got {t_us[0]} us and later")
        return velocities

    def _checked_map(
        self, image: npt.ArrayLike | None, kind: str, t_us: int, channels: int
    ) -> npt.NDArray[np.float32] | None:
        if image is None:
            return None
        array = np.asarray(image, np.float32)
        shape = (self.size[1], self.size[0], channels)
        if array.shape != shape:
            raise ValueError(f"the {kind} at {t_us} us must have shape {shape}, got {array.shape}")
        return array

    def _checked_image(
        self, image: npt.ArrayLike | None, kind: str, t_us: int, *, largest: float
    ) -> npt.NDArray[np.float32] | None:
        if image is None:
            return None
        array = np.ascontiguousarray(image, np.float32)
        size = (self.size[1], self.size[0])
        if array.shape != size:
            raise ValueError(f"the {kind} at {t_us} us must have the sensor's shape {size}, got {array.shape}")
        bad = ~((array >= 0) & (array <= largest))
        if bad.any():
            y, x = np.argwhere(bad)[0]
            raise ValueError(
                f"the {kind} must lie in 0..{largest:.6g}, got {array[y, x]} at {t_us} us, pixel ({x}, {y})"
            )
        return array

    def _write_frame(self, t_us: int, luma: npt.NDArray[np.float32], frame: npt.NDArray[np.float32]) -> None:
        if self.image_gain is None:
            self.image_gain = image_gain_for(frame)
            self._write_meta(complete=False)
        number = self._frames.count
        self._pending_luma = (t_us, luma.copy())
        if number == 0 or (self._check_frames and number % self._check_frames == 0):
            self._write_luma()
        self._frames.write(t_us, encode_png(as_grey(frame, self.image_gain)))

    def _write_luma(self) -> None:
        if self._pending_luma is not None:
            t_us, luma = self._pending_luma
            self._luma_maps.write(t_us, encode_exr({"Y": luma}))
            self._pending_luma = None

    def _require_open(self) -> None:
        if not self._open:
            raise ValueError(f"the writer of {self.path} is closed")

    def _close_events(self) -> None:
        try:
            self._events.close()
        finally:
            if self._signal is not None:
                self._signal.close()

    def _abandon(self, *, interrupted: bool) -> None:
        """Close after an exception, which must not be masked by what fails now for the same reason."""
        self._open = False
        with suppress(OSError):
            self._close_events()
        with suppress(OSError):
            if interrupted:  # nothing is wrong with what was written: let it be checked to its last frame
                self._write_luma()
            self._write_meta(complete=False, interrupted=interrupted)
        self._hold.release()

    def _truth_counts(self) -> dict[str, int]:
        return {
            "flow_maps": self._flow_maps.count,
            "displacements": self._displacements.count,
            "masks": self._masks.count,
            "normal_maps": self._normal_maps.count,
            "velocities": self._velocity_count,
        }

    def _write_meta(self, *, complete: bool, interrupted: bool = False) -> JsonObject:
        meta = self._meta | {
            "sensor": {"width": self.size[0], "height": self.size[1]},
            "calibrated": self.camera is not None,
            "image_gain": self.image_gain,
            "counts": {
                "events": self._events.count,
                "on_events": self._events.on_count,
                **({} if self._signal is None else {"signal_events": self._signal.count}),
                "frames": self._frames.count,
                "depth_maps": self._depth_maps.count,
                "luma_maps": self._luma_maps.count,
                **{name: count for name, count in self._truth_counts().items() if count},
                "poses": self._pose_count,
                "imu_samples": self._imu_count,
            },
            "duration_us": self._end_us,
            "complete": complete,
            "interrupted": interrupted,
        }
        # Written under another name and then renamed, so that there is never half a meta.json.
        unfinished = self.path / META_PART
        write_file(unfinished, (json.dumps(meta, indent=2) + "\n").encode())
        unfinished.replace(self.path / META)
        return meta
