"""Defines the environment: a camera that an action moves, and what it sees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from .._util.argument_checks import check_number, check_type
from .._util.argument_error import ArgumentError
from .._util.close_names import did_you_mean
from ..events.arrays import concatenate_events
from ..events.packet import Packet
from ..geometry.pose import FloatArray, Pose, as_pose
from ..inspection.figure import event_picture
from ..scene.scene import Scene
from ..sensor.imu import ImuNoise
from ..simulation.settings import SimulatorSettings, takes_settings
from ..simulation.simulator import Simulator
from .bodies import GRAVITY, Body, BodyState
from .observations import OBSERVATIONS, Seen, StepShape
from .tasks import Moment, Task

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..simulation.settings.keywords import SimulatorKeywords

_LONGEST_STEP_S = 10.0


@takes_settings(SimulatorSettings)
class EventCameraEnv(gymnasium.Env[dict[str, Any], npt.NDArray[Any]]):
    """Simulates an event camera in a scene, moved by actions: an environment of Gymnasium.

    >>> env = EventCameraEnv(scene, VelocityBody(), task, observe=["voxel_grid"], step_s=0.01, duration_s=5.0)
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

    The scene, its renderer and baked light are made once; an episode begins in little time. The same seed gives the
    same episode, noise included. ``info`` has ``t_s``, ``pose`` (T_world_camera, 4 x 4), ``events`` (how many there
    were in the step), and what the task adds.

    Args:
        scene: what is seen. Objects that the task moves must be movable: ``scene.with_movable("ball")``.
        body: what an action does.
        task: where episodes begin, what moves, what a step is worth.
        observe: which observations the dictionary has, of :data:`OBSERVATIONS`.
        step_s: how long an action acts, seconds, whole microseconds.
        duration_s: an episode is truncated after this time, seconds; None: never.
        poses_per_step: into how many parts a step is divided. Between two poses the camera moves at constant velocity
            and body rate; each part has one sample of the IMU.
        bins: planes of voxel grids.
        imu_noise: of the IMU; None for an ideal one.
        render_mode: ``rgb_array``: :meth:`render` gives uint8 (H, W, 3), the events of the last step, ON red, OFF blue.
        {settings}
            Rates of frames and depth maps follow from ``observe``, and ``seed`` from :meth:`reset`.

    Raises:
        TypeError: for a setting that does not exist, what is no body or no task.
        ValueError: for unknown observations, values out of range, settings that the environment decides, and as
            :class:`davis_rs.Simulator`.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 25}  # noqa: RUF012, as the base has it

    def __init__(
        self,
        scene: Scene,
        body: Body,
        task: Task,
        *,
        observe: Sequence[str] = ("voxel_grid",),
        step_s: float = 0.01,
        duration_s: float | None = None,
        poses_per_step: int = 1,
        bins: int = 5,
        imu_noise: ImuNoise | None = None,
        render_mode: str | None = None,
        **settings: Unpack[SimulatorKeywords],
    ) -> None:
        check_type("body", body, Body, "davis_rs.gym.VelocityBody() makes one")
        check_type("task", task, Task, "davis_rs.gym.KeepCentred() makes one")
        check_number("step_s", step_s, 1e-6, _LONGEST_STEP_S, unit="s")
        check_number("poses_per_step", poses_per_step, 1, 1000, whole=True)
        check_number("bins", bins, 1, 1000, whole=True)
        if duration_s is not None:
            check_number("duration_s", duration_s, step_s, unit="s")
        if render_mode not in (None, "rgb_array"):
            raise ArgumentError("{render_mode} must be rgb_array or None, got {!r}", render_mode)
        if imu_noise is not None:
            check_type("imu_noise", imu_noise, ImuNoise, "davis_rs.sensor.imu.ImuNoise() makes one")
        self._observe = _checked_names(observe)
        step_us = round(step_s * 1e6)
        if abs(step_us - step_s * 1e6) > 1e-3 or step_us < poses_per_step:
            raise ArgumentError(
                "{step_s} must be whole microseconds, at least one for each of the {} poses, got {}",
                *(poses_per_step, step_s),
            )
        given: dict[str, Any] = dict(settings)
        decided = [name for name in ("frame_rate_hz", "depth_rate_hz", "seed") if name in given]
        if decided:
            raise ValueError(f"{decided[0]} is not a setting of an environment: observe and reset decide it")
        given["frame_rate_hz"] = 1e6 / step_us if "frame" in observe else 0.0
        given["depth_rate_hz"] = 1e6 / step_us if "depth" in observe else 0.0
        self._simulator = Simulator(scene, **given)
        self._body, self._task, self._imu_noise = body, task, imu_noise
        self._step_us, self._substeps, self._duration_s = step_us, poses_per_step, duration_s
        self._shape = StepShape(self._simulator.camera, step_us, bins, poses_per_step)
        self.render_mode = render_mode
        self.action_space = body.action_space
        self.observation_space = spaces.Dict({name: OBSERVATIONS[name].space(self._shape) for name in self._observe})
        self._t_us = 0
        self._seen: Seen | None = None
        self._over = True

    @property
    def simulator(self) -> Simulator:
        """Return what renders, with its settings; its own time is that of the episode."""
        return self._simulator

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: of all chance in this episode and those after it; None goes on with the one before.
            options: ``{"pose": pose}`` begins there instead of where the task does.

        Returns:
            the observation at t = 0, which has no events, and ``info``.

        Raises:
            ValueError: for other options, or what is no pose.
        """
        unknown = [name for name in options or {} if name != "pose"]
        if unknown:
            raise ArgumentError("{options} may have pose alone, got {}", ", ".join(map(str, unknown)))
        super().reset(seed=seed)
        self._simulator.restart(seed=int(self.np_random.integers(1 << 63)))
        self._noise_seed = int(self.np_random.integers(1 << 63))
        self._noise, self._samples = np.empty((0, 6)), 0
        start = self._task.start(self.np_random)
        if options:
            start = as_pose(options["pose"], "options['pose']")
        self._body.reset(start)
        self._t_us, self._over = 0, False
        packets = self._simulate(start)
        rest = np.concatenate([start.rotation.T @ -GRAVITY, np.zeros(3)])
        imu = np.tile(rest, (self._substeps, 1)) + self._drawn_noise(self._substeps)
        self._seen = _seen_of(0, packets, imu)
        return self._observation(self._seen), self._info(start, self._seen)

    def step(self, action: npt.NDArray[Any]) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Move for a step under an action.

        Returns:
            observation, reward, terminated, truncated, info.

        Raises:
            ValueError: for an action outside of the action space (``gymnasium.wrappers.ClipAction`` clips).
            gymnasium.error.ResetNeeded: before the first reset, and after the end of an episode.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("call reset before the first step, and after the end of an episode")
        if not self.action_space.contains(np.asarray(action, np.float32)):
            raise ArgumentError(
                "{action} must lie in {}, got {}; gymnasium.wrappers.ClipAction clips it",
                *(self.action_space, np.asarray(action).tolist()),
            )
        exact = np.asarray(action, np.float64)
        start_us, packets, readings = self._t_us, list[Packet](), []
        for substep in range(1, self._substeps + 1):
            end_us = start_us + self._step_us * substep // self._substeps
            duration_s = (end_us - self._t_us) * 1e-6
            before, after = self._body.state, self._body.move(exact, duration_s)
            readings.append(_reading(before, after, duration_s))
            self._t_us = end_us
            packets += self._simulate(after.pose)
        self._seen = seen = _seen_of(start_us, packets, np.array(readings) + self._drawn_noise(self._substeps))
        verdict = self._task.judge(Moment(self._t_us * 1e-6, after, exact, self._shape.camera))
        truncated = self._duration_s is not None and self._t_us >= self._duration_s * 1e6 - 0.5
        self._over = verdict.terminated or truncated
        info = {**verdict.info, **self._info(after.pose, seen)}
        return self._observation(seen), float(verdict.reward), bool(verdict.terminated), truncated, info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the events of the last step as a picture, uint8 (H, W, 3); None without a render mode."""
        if self.render_mode is None:
            return None
        if self._seen is None:
            raise gymnasium.error.ResetNeeded("call reset before render")
        width, height = self._shape.size
        return event_picture(np.full((height, width), 1.0), self._seen.events)

    def _simulate(self, pose: Pose) -> list[Packet]:
        """Step the simulator to now."""
        t_s = self._t_us * 1e-6
        return self._simulator.step(self._t_us, pose, objects=self._task.objects(t_s), lights=self._task.lights(t_s))

    def _drawn_noise(self, count: int) -> FloatArray:
        """Return the IMU's noise of the next samples; what is drawn at once does not depend on how far it goes."""
        if self._imu_noise is None:
            return np.zeros((count, 6))
        first, self._samples = self._samples, self._samples + count
        if self._samples > len(self._noise):
            rate_hz = self._substeps * 1e6 / self._step_us
            self._noise = self._imu_noise.draw(max(1024, 2 * self._samples), rate_hz, self._noise_seed)
        return self._noise[first : self._samples]

    def _observation(self, seen: Seen) -> dict[str, Any]:
        return {name: OBSERVATIONS[name].value(self._shape, seen) for name in self._observe}

    def _info(self, pose: Pose, seen: Seen) -> dict[str, Any]:
        return {"t_s": self._t_us * 1e-6, "pose": pose.matrix, "events": len(seen.events)}


def _checked_names(observe: Sequence[str]) -> tuple[str, ...]:
    """Return the names of observations, each known and once."""
    names = (observe,) if isinstance(observe, str) else tuple(observe)
    for name in names:
        if name not in OBSERVATIONS:
            raise ArgumentError(
                "{observe} may have {}, got {!r}{}", ", ".join(OBSERVATIONS), name, did_you_mean(name, OBSERVATIONS)
            )
    if not names or len(set(names)) < len(names):
        raise ArgumentError("{observe} must name at least one observation, and none twice, got {}", list(names))
    return names


def _seen_of(start_us: int, packets: Sequence[Packet], imu: FloatArray) -> Seen:
    """Gather what the packets of a step bring."""
    last = packets[-1]
    frame = last.luma if last.frame is None else last.frame
    events = concatenate_events([packet.events for packet in packets])
    return Seen(start_us, events, frame, last.depth, imu.astype(np.float32))


def _reading(before: BodyState, after: BodyState, duration_s: float) -> FloatArray:
    """Return the means over a part of a step, in camera axes: specific force and angular rate (6,).

    The axes are those half way, so that the mean of a turning camera is right to second order.
    """
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(before.pose.rotation.T @ after.pose.rotation).as_rotvec()
    half_way = before.pose.rotation @ Rotation.from_rotvec(turn / 2).as_matrix()
    acceleration = (after.velocity - before.velocity) / duration_s
    return np.concatenate([half_way.T @ (acceleration - GRAVITY), turn / duration_s])
