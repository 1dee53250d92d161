"""Simulates the cameras of a rig in step: along a path, or pose after pose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

from ..._util.argument_error import ArgumentError
from ...events.packet import Packet
from ...geometry.pose import Pose, PoseLike, as_pose
from ...geometry.trajectory.trajectory import SegmentTrajectory
from ...render.motion.scene_motion import Steering
from ...render.scene_cache import shared_scenes
from ...scene.scene import Scene, check_scene
from ...sensor.rig import Rig, load_rig
from ..settings import SimulationSettings, SimulatorSettings, complete, resolve, takes_settings
from ..simulate import make_simulator
from ..simulator import Simulator
from .rig_cameras import scene_of_camera, settings_of_camera

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..settings.keywords import SimulationKeywords, SimulatorKeywords


class RigPacket(NamedTuple):
    """Holds a packet of one camera of a rig; its times are by that camera's clock."""

    camera: int
    packet: Packet


@takes_settings(SimulationSettings)
def simulate_rig(
    scene: Scene,
    rig: Rig | str,
    *,
    start_s: float = 0.0,
    duration_s: float | None = None,
    **settings: Unpack[SimulationKeywords],
) -> Iterator[RigPacket]:
    """Simulate all cameras of a rig along the scene's path, in step: a generator of packets, in bounded memory.

    >>> for camera, packet in simulate_rig(load_scene("three_planes"), "stereo-davis346", duration_s=0.1):
    ...     print(camera, packet.end_us, len(packet.events))

    A camera's packets are those that it would give alone. The camera that is furthest behind, by the rig's clock, gives
    the next one.

    Args:
        scene: its camera path is that of the rig's body.
        rig: a rig, a preset's name, or a file.
        start_s, duration_s: the part of the path to simulate, by default all from ``start_s`` on.
        {settings}

    The camera with number k > 0 has a seed that follows from (``seed``, k), so that noise is independent.

    Warns:
        NoEventsWarning, NoiseWarning: as :func:`simulate`.

    Raises:
        TypeError, ValueError, OSError: as :func:`simulate` and :func:`load_rig`, and for settings that the rig decides.
    """
    check_scene(scene)
    given, rig = complete(SimulationSettings, settings, taker=simulate_rig), load_rig(rig)
    cropped = scene.crop(start_s, duration_s)
    streams = {}
    with shared_scenes():
        for camera in range(len(rig.cameras)):
            made = make_simulator(scene_of_camera(cropped, rig, camera), settings_of_camera(given, rig, camera))
            made.warn_of_noise(stacklevel=3)
            streams[camera] = made.packets()
    return in_step(rig, streams)


def in_step(rig: Rig, streams: Mapping[int, Iterator[Packet]]) -> Iterator[RigPacket]:
    """Yield the packets of cameras, that of the camera which is furthest behind first.

    Args:
        streams: packets by the number of the camera.
    """
    waiting = {camera: rig.begins_s(camera) for camera in streams}
    while waiting:
        camera = min(waiting, key=lambda each: (waiting[each], each))
        packet = next(streams[camera], None)
        if packet is None:
            del waiting[camera]
            continue
        waiting[camera] = rig.begins_s(camera) + packet.end_us * 1e-6 / rig.cameras[camera].clock.pace
        yield RigPacket(camera, packet)


@takes_settings(SimulatorSettings)
class RigSimulator:
    """Simulates all cameras of a rig in a scene.

    :meth:`run` follows the scene's path; :meth:`step` serves a controller that decides the body's next pose as it goes.

    Args:
        scene: what is seen; its camera path is that of the rig's body.
        rig: a rig, a preset's name, or a file.
        {settings}

    Attributes:
        rig: the rig.
        simulators: a :class:`~davis_rs.Simulator` for each camera.

    Raises:
        TypeError, ValueError, OSError: as :class:`~davis_rs.Simulator` and :func:`load_rig`, and for settings that the
            rig decides.
    """

    def __init__(self, scene: Scene, rig: Rig | str, **settings: Unpack[SimulatorKeywords]) -> None:
        check_scene(scene)
        given = complete(SimulatorSettings, settings, taker=RigSimulator)
        self.rig = rig = load_rig(rig)
        simulators = []
        with shared_scenes():
            for camera in range(len(rig.cameras)):
                recorded = scene_of_camera(scene, rig, camera)
                resolved = resolve(recorded, settings_of_camera(given, rig, camera))
                simulators.append(Simulator.of_resolved(resolved, resolved.renderer()))
        self.simulators = tuple(simulators)
        # What a caller moves, by the rig's clock: where it is when a camera's clock begins between two steps.
        self._motion = simulators[0].renderer.motion.steered_alone()
        self._last: tuple[int, Pose] | None = None

    def __repr__(self) -> str:
        return f"<RigSimulator of {self.rig.name!r}, {len(self.simulators)} cameras>"

    def run(self) -> Iterator[RigPacket]:
        """Simulate the scene's path from its start to its end, as :func:`simulate_rig`.

        Raises:
            ValueError: as :meth:`Simulator.run`.
        """
        return in_step(self.rig, {camera: each.run() for camera, each in enumerate(self.simulators)})

    def step(
        self,
        t_us: int,
        pose: PoseLike,
        *,
        objects: Mapping[str, PoseLike] | None = None,
        lights: Mapping[str, float] | None = None,
    ) -> tuple[list[Packet], ...]:
        """Move the body to ``pose`` at ``t_us``; return each camera's packets since the last step.

        ``t_us`` is a time of the body's path: the first step is at 0. Packets have the stamps of their camera's clock;
        a camera whose clock shows 0 later gives none before that. Between two poses each camera moves at constant
        velocity and body rate, see :meth:`Simulator.step`.

        Args:
            t_us: microseconds, whole, larger than at the last step.
            pose: T_world_body: a :class:`~davis_rs.Pose`, a matrix (4, 4), or (position, quaternion (x, y, z, w)).
            objects: where objects are at ``t_us``, T_world_object by their ids, as for :meth:`Simulator.step`. All
                cameras see the same motion, each by its own clock.
            lights: factors >= 0 on the strengths of lights at ``t_us``, likewise.

        Raises:
            ValueError: as :meth:`Simulator.step`.
        """
        pose = as_pose(pose)
        steering = self._motion.steered(objects or {}, lights or {})
        if self._last is None and t_us != 0:
            raise ValueError(f"the first step must be at t = 0 us, got {t_us} us")
        if self._last is not None and t_us <= self._last[0]:
            raise ArgumentError("the time of a step must be after the last one ({} us), got {t_us:{}} us",
                                self._last[0], t_us)  # fmt: skip
        before_us = 0 if self._last is None else self._last[0]
        self._motion.steer(steering, before_us, t_us, seen_from_us=before_us)
        packets = tuple(self._step(camera, t_us, pose, steering) for camera in range(len(self.simulators)))
        self._last = t_us, pose
        return packets

    def flush(self) -> tuple[list[Packet], ...]:
        """Return what the cameras' readouts still hold, see :meth:`Simulator.flush`."""
        return tuple(each.flush() for each in self.simulators)

    def _step(self, camera: int, t_us: int, pose: Pose, steering: Steering) -> list[Packet]:
        """Step one camera."""
        each, simulator = self.rig.cameras[camera], self.simulators[camera]
        begins_us = self.rig.begins_s(camera) * 1e6
        if t_us < begins_us:
            return []
        packets: list[Packet] = []
        before_us, before = self._last or (t_us, pose)
        if self._last is None or before_us < begins_us:  # its clock shows 0 now, or between two steps
            begun = pose
            if t_us > begins_us:
                segment = SegmentTrajectory(before, pose, (t_us - before_us) * 1e-6)
                begun = segment.pose((begins_us - before_us) * 1e-6)
            there = self._motion.steering_at(begins_us * 1e-6)
            packets += simulator.step(0, begun @ each.mount, objects=there.objects, lights=there.lights)
        own_us = round((t_us - begins_us) * each.clock.pace)
        if own_us > 0:
            packets += simulator.step(own_us, pose @ each.mount, objects=steering.objects, lights=steering.lights)
        return packets
