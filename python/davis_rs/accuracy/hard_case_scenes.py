"""Makes hard cases: small scenes in which sampling in time or space is easily wrong, each with what makes it so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from ..geometry.camera import Camera
from ..geometry.pose import FloatArray, Pose
from ..geometry.trajectory.trajectory import CallableTrajectory, SegmentTrajectory, Trajectory
from ..scene.light_profile import Flicker, LightProfile, SampledProfile
from ..scene.parts import DIRECT, look_at
from ..scene.scene import Scene

CAUSE_S = 0.0123
"""When the light jumps."""

START_S = 0.0195
"""When the camera starts from rest."""

_WIDTH, _HEIGHT = 32, 24
_FOCAL = 240.0
_EYE = np.array([0.03, -0.2, 2.0])
_DAY_S = 86_400.0
_TEXELS = 200
_WIRES_M = 0.5
"""How high wires are above the floor."""


@dataclass(frozen=True)
class HardCase:
    """Holds a scene with its camera path, and how it is seen.

    Attributes:
        name: of few words.
        what: what makes it hard.
        scene: with a camera path.
        start_s: where on the path the simulation starts.
        contrast_threshold: C in natural-log units.
        true_scene: whose events by brute force are the truth, where that is another scene that must give the same.
    """

    name: str
    what: str
    scene: Scene
    start_s: float = 0.0
    contrast_threshold: float = 0.15
    true_scene: Scene | None = None

    @property
    def part(self) -> Scene:
        """Return the part of the scene's path that is simulated."""
        return self.scene.crop(self.start_s)

    @property
    def true_part(self) -> Scene:
        """Return the part that brute force renders."""
        return (self.true_scene or self.scene).crop(self.start_s)


def hard_cases() -> list[HardCase]:
    """Make all hard cases, for cameras of 32 x 24 pixels, some hundredths of a second each."""
    step = [CAUSE_S, CAUSE_S + 1e-6]
    brighter, on = SampledProfile(step, [1.0, 1e6]), SampledProfile(step, [0.0, 1.0])
    square = Flicker(130.0, modulation=0.5, phase_rad=0.3, waveform="square")
    slow = sideways(0.024, 0.3)
    telephoto, barrel = _camera(5000.0), _camera(32.0, k1=-0.3)
    return [
        HardCase("still start", "rest, then 1.5 m/s from 19.5 ms on", room(starting())),
        HardCase(
            "light jump", "a lamp a million times brighter at 12.3 ms, camera still", room(still(0.024), brighter)
        ),
        HardCase("light jump, moving", "the same, camera at 0.3 m/s", room(slow, brighter)),
        HardCase("black to light", "the only lamp goes on at 12.3 ms, camera still", room(still(0.024), on)),
        HardCase("square flicker", "130 Hz, half as bright again and half as bright, 0.3 m/s", room(slow, square)),
        HardCase("wires", "boxes 0.3, 0.45 and 1 px thick and their shadows, 1 m/s", wires(sideways(0.024, 1.0))),
        HardCase(
            "scaled",
            "a scene 10,000 times smaller, 0.1 mm/s, against the scene at its own size",
            room(sideways(0.024, 1.0, scale=1e-4), scale=1e-4),
            true_scene=room(sideways(0.024, 1.0)),
        ),
        HardCase("telephoto", "fx 5000, 0.15 rad/s", room(turning(0.012, 0.15), camera=telephoto, texel=0.001)),
        HardCase("fast turn", "30 rad/s", room(turning(0.004, 30.0))),
        HardCase("grazing", "1 degree above the floor, 1 m/s", room(grazing(0.012, 1.0))),
        HardCase("barrel", "a lens of k1 = -0.3, 10 m/s", room(sideways(0.024, 10.0), camera=barrel, texel=0.2)),
        HardCase("low threshold", "C = 1e-3, 0.1 m/s", room(sideways(0.012, 0.1)), contrast_threshold=1e-3),
        HardCase("late start", "from 86,400 s on, 1 m/s, flicker of 100 Hz", late(), start_s=_DAY_S),
    ]


def room(
    trajectory: Trajectory,
    light: LightProfile | None = None,
    *,
    camera: Camera | None = None,
    scale: float = 1.0,
    texel: float = 0.02,
) -> Scene:
    """Make a textured floor with a box on it, under a lamp that throws the box's shadow.

    Args:
        light: the lamp's profile.
        scale: of the scene; its light looks the same at any.
        texel: of the floor's texture, metres.
    """
    lights = {} if light is None else {"lamp": light}
    content = partial(_room, scale, texel)
    return Scene("room", content, camera=camera or _camera(), trajectory=trajectory, lights=lights)


def wires(trajectory: Trajectory, *, shadows: bool = True) -> Scene:
    """Make thin level boxes over the same floor: 0.3, 0.45 and 1 px thick as a camera 2 m above the floor sees them."""
    return Scene("wires", _wires, camera=_camera(), trajectory=trajectory, shadows=shadows)


def late() -> Scene:
    """Make a camera that swings for more than a day, in a light that flickers."""
    hertz, reach = 2.0, 1.0 / (2 * np.pi * 2.0)
    angle = 2 * np.pi * hertz
    path = _straight(
        _DAY_S + 0.024,
        lambda t: reach * np.sin(angle * (t - _DAY_S)),
        lambda t: reach * angle * np.cos(angle * (t - _DAY_S)),
    )
    return room(path, Flicker(100.0, modulation=0.3))


def still(duration_s: float) -> Trajectory:
    """Make a camera path without motion."""
    return SegmentTrajectory(_down(), _down(), duration_s)


def sideways(duration_s: float, speed_m_s: float, *, scale: float = 1.0) -> Trajectory:
    """Make a straight path over the floor."""
    start = _down(scale)
    end = Pose(start.position + scale * speed_m_s * duration_s * np.array([0.8, 0.6, 0.0]), start.quaternion)
    return SegmentTrajectory(start, end, duration_s)


def starting(*, declared: bool = True, duration_s: float = 0.03, speed_m_s: float = 1.5) -> Trajectory:
    """Return a path at rest until :data:`START_S`, then at full speed at once.

    Args:
        declared: whether the path tells of its break.
    """
    return _straight(
        duration_s,
        lambda t: speed_m_s * np.maximum(t - START_S, 0.0),
        lambda t: np.where(t >= START_S, speed_m_s, 0.0),
        breaks_s=[START_S] if declared else [],
    )


def turning(duration_s: float, rate_rad_s: float) -> Trajectory:
    """Make a turn on the spot, about an axis that is none of the camera's."""
    from scipy.spatial.transform import Rotation

    start = _down()
    axis = np.array([0.6, -0.64, 0.48])
    turned = Rotation.from_quat(start.quaternion) * Rotation.from_rotvec(axis * rate_rad_s * duration_s)
    return SegmentTrajectory(start, Pose(start.position, turned.as_quat()), duration_s)


def grazing(duration_s: float, speed_m_s: float) -> Trajectory:
    """Return a path along the floor, looking down on it by 1 degree."""
    eye = np.array([0.0, -2.0, 0.15])
    ahead = np.array([0.0, np.cos(np.radians(1.0)), -np.sin(np.radians(1.0))])
    start = Pose.from_matrix(_matrix(look_at(eye, eye + ahead), eye))
    end = Pose(start.position + speed_m_s * duration_s * np.array([0.6, 0.8, 0.0]), start.quaternion)
    return SegmentTrajectory(start, end, duration_s)


def _straight(
    duration_s: float,
    distance: Callable[[FloatArray], FloatArray],
    speed: Callable[[FloatArray], FloatArray],
    *,
    breaks_s: npt.ArrayLike = (),
) -> CallableTrajectory:
    """Return the path of :func:`sideways` with the given distance and speed."""
    start, way = _down(), np.array([0.8, 0.6, 0.0])
    return CallableTrajectory(
        duration_s,
        position=lambda t: start.position + distance(t)[:, None] * way,
        velocity=lambda t: speed(t)[:, None] * way,
        quaternion=lambda t: np.tile(start.quaternion, (len(t), 1)),
        angular_rate=lambda t: np.zeros((len(t), 3)),
        breaks_s=breaks_s,
        description={"path": "straight"},
    )


def _camera(focal: float = _FOCAL, *, k1: float = 0.0) -> Camera:
    return Camera(_WIDTH, _HEIGHT, focal, focal, (_WIDTH - 1) / 2, (_HEIGHT - 1) / 2, k1=k1)


def _down(scale: float = 1.0) -> Pose:
    """Return a pose that looks down at the floor, a little aslant."""
    return Pose.from_matrix(_matrix(look_at(_EYE, np.array([0.02, 0.0, 0.0])), scale * _EYE))


def _matrix(rotation: FloatArray, position: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


def _room(scale: float, texel: float) -> dict[str, object]:
    box = np.diag([0.03 * scale, 0.025 * scale, 0.03 * scale, 1.0])
    box[:3, 3] = np.array([0.05, 0.03, 0.03]) * scale
    return {
        "type": "scene",
        "integrator": DIRECT,
        "lamp": {"type": "point", "position": [-0.7 * scale, 0.5 * scale, 3.0 * scale], "intensity": 12.0 * scale**2},
        "floor": _floor(scale, texel),
        "box": {"type": "cube", "to_world": box, "bsdf": {"type": "diffuse", "reflectance": 0.8}},
    }


def _floor(scale: float, texel: float) -> dict[str, object]:
    """Make a floor of squares of random grey, the brightest three times as bright as the darkest."""
    grey = np.random.Generator(np.random.PCG64(7)).uniform(0.25, 0.75, (_TEXELS, _TEXELS))
    data = np.repeat(grey[..., None], 3, -1).astype(np.float32)
    half = _TEXELS * texel / 2 * scale
    return {
        "type": "rectangle",
        "to_world": np.diag([half, half, 1.0, 1.0]),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "bitmap", "raw": True, "data": data}},
    }


def _wires() -> dict[str, object]:
    content = _room(1.0, 0.02)
    del content["box"]
    for k, (x, pixels) in enumerate(zip(np.linspace(-0.09, 0.11, 6), [0.3, 0.45, 1.0] * 2, strict=True)):
        # As thick as `pixels` pixels are wide at its distance.
        half = pixels * (_EYE[2] - _WIRES_M) / _FOCAL / 2
        thin = np.diag([half, 2.0, half, 1.0])
        thin[:3, 3] = (x, 0.0, _WIRES_M)
        grey = 0.9 if k % 2 else 0.05
        content[f"wire_{k}"] = {"type": "cube", "to_world": thin, "bsdf": {"type": "diffuse", "reflectance": grey}}
    return content
