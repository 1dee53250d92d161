"""Makes the scene ``dynamic``: the office with a person in it who sits, stands up, walks to and fro and waves."""

from __future__ import annotations

from functools import cache

import numpy as np

from ...geometry.camera import PRESETS
from ...geometry.pose import FloatArray
from ...geometry.trajectory.sampled_trajectory import SampledTrajectory
from ..meshes import shape
from ..parts import start_looking_at
from ..scene import Scene
from .office_scene import chair, office_room
from .person import Joints, clothes, parts
from .room import LUX_PER_LUMA

DURATION_S = 60.0
"""Length of what the person does; then it stays seated."""
_RATE_HZ = 50.0
_SMOOTH_S = 0.07
"""Standard deviation of the Gaussian that rounds off all joints: no muscle jerks."""

_STRIDE_M = 1.3
_SEAT = (0.1, 1.66)
_PUSHED_BACK_M = 0.4

_LEFT, _RIGHT = -1.4, 1.5
_WALK = [
    *((9.5, _SEAT[0], 0), (10.0, _SEAT[0], 90), (12.0, _LEFT, 90), (13.0, _LEFT, 270), (16.0, _RIGHT, 270)),
    *((17.0, _RIGHT, 90), (20.0, _LEFT, 90), (21.0, _LEFT, 270), (24.0, _RIGHT, 270), (25.0, _RIGHT, 90)),
    *((27.3, 0.0, 90), (28.0, 0.0, 180), (37.3, 0.0, 180), (38.0, 0.0, 90), (39.5, _LEFT, 90), (40.5, _LEFT, 270)),
    *((43.5, _RIGHT, 270), (44.5, _RIGHT, 90), (47.5, _LEFT, 90), (48.5, _LEFT, 270), (51.3, _RIGHT, 270)),
    *((52.0, _RIGHT, 90), (53.5, _SEAT[0], 90), (54.0, _SEAT[0], 0)),
]
"""When, at which x, facing where: 90 degrees is to the left, 180 to the camera."""


def dynamic() -> Scene:
    """Make the office of :func:`~davis_rs.scene.sequences.office_scene.office` with a person in it, for 60 s; C =
    0.5.

    The person sits at the desk and types in the air, 8 to 20 cm above the height of the keyboard, stands up (the chair
    rolls back), walks to and fro before the desk at up to about 1.5 m/s, turning to the camera at the ends, stops and
    waves, walks again, and sits down. The camera stands 2.2 m from where the person walks, with 1.1 m of air around it.
    A synthetic counterpart of the dataset's by kind of motion, not a copy: the body is rigid parts that turn in their
    joints, and walks by rule; its toes dip into the floor by up to 4 cm as it does.
    """
    return Scene(
        name="dynamic",
        source=lambda: {
            **office_room(),
            "chair": shape(chair(), 0.18),
            **{name: shape(part, clothes()) for name, part in parts().items()},
        },
        camera=PRESETS["davis240c"],
        start=start_looking_at([0.0, -0.4, 1.3], [0.0, 2.0, 1.1]),
        contrast_threshold=0.5,
        objects=performance(),
        lux_per_luma=LUX_PER_LUMA,
        ambient=True,
    )


@cache
def performance() -> dict[str, SampledTrajectory]:
    """Make the paths of the person's parts and of the chair; :data:`DURATION_S` long."""
    t = np.linspace(0.0, DURATION_S, round(DURATION_S * _RATE_HZ) + 1)
    sits = _keyed(t, [(0, 1), (8, 1), (9.5, 0), (54, 0), (55.5, 1)])
    placed = _joints(t, sits).placed()
    rolled = np.column_stack([np.full_like(t, _SEAT[0]), _SEAT[1] - _PUSHED_BACK_M * (1 - sits), 0 * t])
    paths = {name: SampledTrajectory(t, at, turn.as_quat()) for name, (at, turn) in placed.items()}
    return {**paths, "chair": SampledTrajectory(t, rolled, np.tile([0.0, 0, 0, 1], (len(t), 1)))}


def _joints(t: FloatArray, sits: FloatArray) -> Joints:
    """Return the angles of all joints at times (n,)."""
    x, degrees = (_keyed(t, [(key[0], key[column]) for key in _WALK]) for column in (1, 2))
    speed = np.abs(np.gradient(x, t))
    swing = _rounded(0.5 * np.clip(speed / 1.2, 0.0, 1.0))[:, None]
    step = 2 * np.pi * np.cumsum(speed) / (_RATE_HZ * _STRIDE_M)
    legs = np.stack([np.sin(step), -np.sin(step)], 1)
    bent = np.stack([1 - np.sin(step - 1.1), 1 + np.sin(step - 1.1)], 1)
    seated = sits[:, None]
    types = seated * np.stack([np.sin(11.0 * t), np.sin(13.0 * t + 1)], 1)
    waves = np.stack([0 * t, _keyed(t, [(29, 0), (30, 1), (35.5, 1), (36.5, 0)])], 1)
    return Joints(
        position=_rounded(np.column_stack([x, _SEAT[1] + 0.16 * (1 - sits)])),
        heading=_rounded(np.radians(degrees)),
        lean=_rounded(0.06 + 1.6 * sits * (1 - sits) + 0.04 * np.sin(0.9 * t)),
        hips=_rounded(np.pi / 2 * seated + swing * legs),
        knees=_rounded(np.pi / 2 * seated + 0.05 + 0.45 * swing * bent),
        shoulders=_rounded(0.75 * seated - 0.9 * swing * legs + 0.4 * waves + 0.04 * types),
        elbows=_rounded(0.3 + 0.9 * seated + 0.5 * swing + 0.6 * waves + 0.1 * types),
        aside=_rounded(0.08 + waves * (2.2 + 0.45 * np.sin(8.0 * t))[:, None]),
    )


def _keyed(t: FloatArray, keys: list[tuple[float, float]]) -> FloatArray:
    """Interpolate between keys (time, value) smoothly, at rest at each."""
    times, values = np.array(keys, np.float64).T
    k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    fraction = np.clip((t - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0)
    return np.asarray(values[k] + (values[k + 1] - values[k]) * fraction**2 * (3 - 2 * fraction))


def _rounded(values: FloatArray) -> FloatArray:
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(values, _SMOOTH_S * _RATE_HZ, axis=0, mode="nearest"))
