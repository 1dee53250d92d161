"""What a run takes besides scene and path, as people write it: names and numbers, from a command line or a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from .camera import Camera, load_camera
from .effects import Effects, parse_effect
from .imu import IMU_EFFECTS, Imu, Mounting
from .motion_capture import MocapClock, MocapNoise, MotionCapture
from .sampling.rules import FixedRate, MaxDisplacement, TimeSampling
from .sampling.tolerance import Tolerance
from .scene.scene import Scene
from .simulate import Simulator


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """Settings of one run under the names of the options of ``davis-rs simulate``; None is not given.

    Nothing is checked when it is made: each method refuses what it is given, as the classes that it makes do.

    Attributes:
        camera: as :func:`~davis_rs.load_camera` takes it.
        contrast_threshold, contrast_threshold_off, log_eps, accuracy, samples, sensor, renderer, blur, refine: see
            :class:`~davis_rs.Simulator`.
        lux_per_luma: in place of the scene's.
        frame_rate, depth_rate, pose_rate: in Hz.
        image_gain: see :class:`~davis_rs.DatasetWriter`.
        effects: ``auto``, in place of effects.
        effect, imu_effect: each as :func:`~davis_rs.effects.parse_effect` takes it.
        imu: ``none``, ``ideal``, ``davis`` or ``mpu6150``. imu_rate: in Hz.
        pose_noise, rotation_noise, clock_offset, clock_drift: of the motion capture, in metres, radians, seconds and
            milliseconds a minute.
        render_rate, max_displacement, tolerance: one rule of sampling at most, in Hz, pixels and shares of C.
    """

    camera: str | None = None
    contrast_threshold: float | None = None
    contrast_threshold_off: float | None = None
    log_eps: float = 1e-3
    lux_per_luma: float | None = None
    frame_rate: float = 40.0
    depth_rate: float = 40.0
    image_gain: float | None = None
    sensor: str | None = None
    effects: str | None = None
    effect: Sequence[str] | None = None
    imu: str | None = None
    imu_rate: float | None = None
    imu_effect: Sequence[str] | None = None
    pose_rate: float = 200.0
    pose_noise: float | None = None
    rotation_noise: float | None = None
    clock_offset: float | None = None
    clock_drift: float | None = None
    accuracy: str | None = None
    render_rate: float | None = None
    max_displacement: float | None = None
    tolerance: float | None = None
    refine: bool | None = None
    samples: int | None = None
    renderer: str = "auto"
    blur: bool | None = None

    def make_scene(self, scene: Scene) -> Scene:
        """The scene in these settings' light."""
        return scene if self.lux_per_luma is None else replace(scene, lux_per_luma=self.lux_per_luma)

    def make_camera(self) -> Camera | None:
        """None for the scene's."""
        return None if self.camera is None else load_camera(self.camera)

    def make_sampling(self) -> TimeSampling | None:
        """None for that of the accuracy.

        Raises:
            ValueError: for more than one rule, or a value out of range.
        """
        rules = {"render_rate": FixedRate, "max_displacement": MaxDisplacement, "tolerance": Tolerance}
        given = {name: getattr(self, name) for name in rules if getattr(self, name) is not None}
        if len(given) > 1:
            raise ValueError(f"only one of {', '.join(rules)} may be given, got {' and '.join(given)}")
        return next((rules[name](value) for name, value in given.items()), None)

    def make_effects(self) -> Effects | str:
        """The effects, or ``auto``."""
        if self.effects is not None and self.effect:
            raise ValueError(f"either effects {self.effects!r} or effects by name, got {', '.join(self.effect)} too")
        return self.effects or Effects.of(parse_effect(text) for text in self.effect or ())

    def make_imu(self) -> Imu | None:
        """None for no IMU.

        Raises:
            ValueError: for an effect that is not there or out of range, or settings of an IMU where there is none.
        """
        makers = {"ideal": Imu, "davis": lambda: Imu(mounting=Mounting()), "mpu6150": Imu.mpu6150}
        if self.imu in (None, "none"):
            if self.imu_rate is not None or self.imu_effect:
                raise ValueError("rate and effects of an IMU need an IMU")
            return None
        if self.imu not in makers:
            raise ValueError(f"imu must be one of none, {', '.join(makers)}, got {self.imu!r}")
        imu = makers[self.imu]()
        effects: dict[str, Any] = {
            text.partition("=")[0]: parse_effect(text, IMU_EFFECTS) for text in self.imu_effect or ()
        }
        # Together, so that lag and low-pass are looked at as a pair.
        return replace(imu, rate_hz=imu.rate_hz if self.imu_rate is None else self.imu_rate, **effects)

    def make_motion_capture(self) -> MotionCapture:
        """What gives the ground truth."""
        noise = MocapNoise(self.pose_noise or 0.0, self.rotation_noise or 0.0)
        clock = MocapClock(self.clock_offset or 0.0, (self.clock_drift or 0.0) * 1e-3 / 60)
        return MotionCapture(
            self.pose_rate, noise=None if noise.neutral else noise, clock=None if clock.neutral else clock
        )

    def make_simulator(self, scene: Scene, *, seed: int, threads: int | None) -> Simulator:
        """A fresh simulator; ``seed`` and ``threads`` are :class:`~davis_rs.Simulator`'s.

        Raises:
            ValueError, OSError: as the simulator, and as the methods above.
        """
        return Simulator(
            self.make_scene(scene),
            camera=self.make_camera(),
            contrast_threshold=self.contrast_threshold,
            contrast_threshold_off=self.contrast_threshold_off,
            log_eps=self.log_eps,
            frame_rate_hz=self.frame_rate,
            depth_rate_hz=self.depth_rate,
            accuracy=self.accuracy,
            sampling=self.make_sampling(),
            samples=self.samples,
            sensor=self.sensor,
            effects=self.make_effects(),
            seed=seed,
            threads=threads,
            renderer=self.renderer,
            blur=self.blur,
            refine=self.refine,
        )
