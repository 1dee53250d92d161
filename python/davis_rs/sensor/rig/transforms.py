"""Finds where each sensor of a rig is on the body, from transforms between pairs of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...geometry.pose import FloatArray
from ..imu.kalibr import inverse_transform

_AGREE = 1e-3
"""Transforms that are stated twice, as Kalibr does, agree within this many metres and in each entry of the rotation."""


class Relation(NamedTuple):
    """Holds a transform that a file states: from the axes of ``other`` to those of ``sensor``, (4, 4).

    ``key`` is where the file states it, for messages.
    """

    sensor: str
    other: str
    matrix: FloatArray
    key: str


def mounts_on_body(body: str, sensors: Sequence[str], relations: Sequence[Relation]) -> dict[str, FloatArray]:
    """Return T_body_sensor (4, 4) of every sensor.

    Args:
        body: the frame that is the body's: a sensor's name, or that of none.
        sensors: their names.
        relations: what is stated. One sensor may be reached by several ways, which must agree.

    Raises:
        ValueError: for parents that form a circle, a sensor that nothing connects with the body, or two ways to a
            sensor that disagree; naming the sensors.
    """
    _refuse_circles({relation.sensor: relation.other for relation in relations if relation.key == "parent"})
    mounts: dict[str, FloatArray] = {body: np.eye(4)}
    waiting = deque([body])
    while waiting:
        at = waiting.popleft()
        for relation in relations:
            if at not in (relation.sensor, relation.other):
                continue
            forward = at == relation.other
            reached = relation.sensor if forward else relation.other
            matrix = mounts[at] @ (inverse_transform(relation.matrix) if forward else relation.matrix)
            if reached not in mounts:
                mounts[reached] = matrix
                waiting.append(reached)
            elif (off := float(np.abs(mounts[reached] - matrix).max())) > _AGREE:
                raise ValueError(
                    f"{relation.sensor}: {relation.key} puts {reached} up to {off:.3g} m off where the other "
                    "transforms have it: they must agree"
                )
    lost = [name for name in sensors if name not in mounts]
    if lost:
        raise ValueError(
            f"{lost[0]}: nothing says where it is on the body ({body}): give T_cn_cnm1, T_cam_imu, or parent with "
            f"{'T_cam_parent' if lost[0].startswith('cam') else 'T_imu_parent'}"
        )
    return {name: mounts[name] for name in sensors}


def _refuse_circles(parents: Mapping[str, str]) -> None:
    for name in parents:
        way = [name]
        while way[-1] in parents:
            way.append(parents[way[-1]])
            if way[-1] == name:
                raise ValueError(f"{' -> '.join(way)} is a circle of parents: each sensor must hang on the body")
            if len(way) > len(parents):
                break
