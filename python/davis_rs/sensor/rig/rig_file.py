"""Reads and writes ``rig.yaml``: Kalibr's camchain, with sensors, IMUs and mounts."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..._core import DecodeError
from ..._util.array_types import JsonObject
from ..._util.close_names import did_you_mean
from ..._util.yaml_file import read_yaml
from ...geometry.camera import Camera
from ...geometry.pose import FloatArray, Pose
from ..effects.effects import named_effects
from ..imu import DAVIS_T_IMU_CAMERA, IMU_EFFECTS, IMU_MODELS, Imu, ImuNoise, Mounting, kalibr_camera
from ..imu.kalibr import inverse_transform
from ..parameters import SensorParameters
from ..presets.sensor_file import SensorFile, read_sensor_content, sensor_yaml
from .rig import CameraClock, Rig, RigCamera, RigImu
from .transforms import Relation, mounts_on_body

_NAMED = re.compile(r"(cam|imu)(0|[1-9][0-9]{0,2})")
_CAMERA = (
    *("camera_model", "distortion_model", "distortion_coeffs", "intrinsics", "resolution", "rostopic"),
    *("T_cn_cnm1", "T_cam_imu", "timeshift_cam_imu", "cam_overlaps", "parent", "T_cam_parent"),
    *("clock_offset", "clock_drift", "sensor"),
)
_DENSITIES = tuple(ImuNoise(0, 0, 0, 0).settings())
_IMU = ("rostopic", "update_rate", *_DENSITIES, "model", "T_i_b", "parent", "T_imu_parent", "effects", "gravity")
_MOUNTED_MODELS = ("davis", "mpu6150")
"""IMUs that have their place in a DAVIS, so that their file need not say it."""

BODY = "body"
"""The name of the body's own axes, where they are no sensor's."""


def read_rig_file(path: str | os.PathLike[str]) -> Rig:
    """Read a rig's file; docs/rigs.md has its keys. A sensor that is a file is relative to the rig's folder.

    Raises:
        OSError: if it, or a sensor's file, cannot be read.
        DecodeError: if it is no YAML, lacks a key or has one that does not exist, has a value of another type or out
            of range, sizes that contradict each other, or transforms that contradict each other or leave a sensor
            without a place; in one line that names file, sensor, rule and value.
    """
    file = Path(path)
    try:
        return _rig(file, _mapping("a rig", read_yaml(file)))
    except DecodeError:
        raise
    except ValueError as error:
        said = str(error)
        raise DecodeError(said if said.startswith(str(file)) else f"{file}: {said}") from None


def _rig(file: Path, content: JsonObject) -> Rig:
    name, body = content.pop("name", file.stem), content.pop("body", None)
    if not isinstance(name, str) or (body is not None and not isinstance(body, str)):
        raise ValueError(f"name and body must be texts, got {name!r:.60} and {body!r:.60}")
    for key in content:
        if not (isinstance(key, str) and _NAMED.fullmatch(key)):
            near = did_you_mean(key, ("name", "body", "cam0", "imu0")) if isinstance(key, str) else ""
            raise ValueError(f"a rig has name, body, cam0, cam1, ..., imu0, imu1, ..., not {key!r:.60}{near}")
    cameras = {key: _mapping(key, content[key], _CAMERA) for key in _in_order("cam", content)}
    imus = {key: _mapping(key, content[key] or {}, _IMU) for key in _in_order("imu", content)}
    if not cameras:
        raise ValueError("a rig needs at least one camera, cam0")
    relations = [relation for key, told in cameras.items() for relation in _camera_relations(key, told, imus)]
    relations += [relation for key, told in imus.items() for relation in _imu_relations(key, told, relations)]
    sensors = [*cameras, *imus]
    for relation in relations:
        if relation.other not in (*sensors, BODY):
            raise ValueError(f"{relation.sensor}: {relation.key} is relative to {relation.other}, which the rig lacks"
                             f"{_remedy(relation)}")  # fmt: skip
    if body is None:
        body = BODY if any(relation.other == BODY for relation in relations) else "cam0"
    if body not in (*sensors, BODY):
        raise ValueError(f"body must name a sensor of the rig, or be {BODY!r}, got {body!r:.60}")
    mounts = mounts_on_body(body, sensors, relations)
    return Rig(
        name=name,
        cameras=tuple(_camera(file, key, told, mounts[key]) for key, told in cameras.items()),
        imus=tuple(_imu(key, told, mounts[key]) for key, told in imus.items()),
    )


def _remedy(relation: Relation) -> str:
    return ": give 'imu0: {}' for an ideal one" if relation.other.startswith("imu") else ""


def _in_order(kind: str, content: Mapping[str, object]) -> list[str]:
    """Return the keys of cameras or IMUs, which must be numbered from 0 without a gap."""
    count = sum(key.startswith(kind) for key in content)
    names = [f"{kind}{number}" for number in range(count)]
    for name in names:
        if name not in content:
            raise ValueError(f"{name} is missing: a rig's {kind}s are numbered from 0 without a gap")
    return names


def _camera_relations(key: str, told: JsonObject, imus: Mapping[str, object]) -> list[Relation]:
    relations = []
    if "T_cn_cnm1" in told:
        number = int(key.removeprefix("cam"))
        if number == 0:
            raise ValueError("cam0: T_cn_cnm1 is relative to the camera before, which cam0 does not have")
        relations.append(Relation(key, f"cam{number - 1}", _transform(key, "T_cn_cnm1", told), "T_cn_cnm1"))
    if "T_cam_imu" in told:
        relations.append(Relation(key, "imu0", _transform(key, "T_cam_imu", told), "T_cam_imu"))
    if "timeshift_cam_imu" in told and not imus:
        raise ValueError(f"{key}: timeshift_cam_imu is relative to imu0, which the rig lacks: give 'imu0: {{}}'")
    return [*relations, *_parent(key, told, "T_cam_parent")]


def _imu_relations(key: str, told: JsonObject, others: Sequence[Relation]) -> list[Relation]:
    relations = _parent(key, told, "T_imu_parent")
    if "T_i_b" in told:  # Kalibr's body is its first IMU
        if key == "imu0":
            if np.abs(_transform(key, "T_i_b", told) - np.eye(4)).max() > 0:
                raise ValueError("imu0: T_i_b is relative to imu0 itself, so it must be the identity")
        else:
            relations.append(Relation(key, "imu0", _transform(key, "T_i_b", told), "T_i_b"))
    if not relations and told.get("model") in _MOUNTED_MODELS and not any(each.other == key for each in others):
        relations.append(Relation(key, "cam0", Mounting(DAVIS_T_IMU_CAMERA).matrix, "model"))
    return relations


def _parent(key: str, told: JsonObject, transform: str) -> list[Relation]:
    if ("parent" in told) != (transform in told):
        raise ValueError(f"{key}: parent and {transform} belong together, give both or neither")
    if "parent" not in told:
        return []
    parent = told["parent"]
    if not isinstance(parent, str):
        raise ValueError(f"{key}: parent must be the name of a sensor, or {BODY!r}, got {parent!r:.60}")
    return [Relation(key, parent, _transform(key, transform, told), "parent")]


def _camera(file: Path, key: str, told: JsonObject, mount: FloatArray) -> RigCamera:
    for name, allowed in (("camera_model", "pinhole"), ("distortion_model", "radtan")):
        if told.get(name, allowed) != allowed:
            raise ValueError(f"{key}: {name} must be {allowed}, got {told[name]!r:.60}")
    for name in ("intrinsics", "resolution"):
        if name not in told:
            raise ValueError(f"{key}: {name} is missing")
    width, height = _numbers(key, "resolution", told["resolution"], (2,))
    focal_and_centre = _numbers(key, "intrinsics", told["intrinsics"], (4,))
    distortion = _numbers(key, "distortion_coeffs", told.get("distortion_coeffs", [0, 0, 0, 0]), (4, 5))
    if width != int(width) or height != int(height):
        raise ValueError(f"{key}: resolution must be two integers, got {told['resolution']!r:.60}")
    if "clock_offset" in told and "timeshift_cam_imu" in told:
        raise ValueError(f"{key}: clock_offset is the negative of timeshift_cam_imu: give one of them")
    shift = _number(key, "timeshift_cam_imu", told.get("timeshift_cam_imu", 0.0))
    offset = _number(key, "clock_offset", told.get("clock_offset", 0.0)) - shift
    drift = _number(key, "clock_drift", told.get("clock_drift", 0.0))
    try:
        return RigCamera(
            camera=Camera(int(width), int(height), *focal_and_centre, *distortion),
            mount=_pose(mount),
            sensor=_sensor(file, told.get("sensor")),
            clock=CameraClock(offset, drift),
            topic=_text(key, "rostopic", told.get("rostopic", "")),
        )
    except (ValueError, OSError) as error:
        if isinstance(error, OSError):
            raise
        raise ValueError(f"{key}: {error}") from None


def _sensor(file: Path, told: object) -> SensorParameters | str | None:
    """Return a camera's pixels: of a preset's name, a file next to the rig's, or a mapping as in a sensor file."""
    if isinstance(told, dict):
        return read_sensor_content(f"{file}: sensor", told).parameters
    if told is None or not isinstance(told, str):
        if told is not None:
            raise ValueError(f"sensor must be a name, a file or a mapping, got {told!r:.60}")
        return None
    beside = file.parent / told
    return str(beside) if beside.suffix and beside.is_file() else told


def _imu(key: str, told: JsonObject, mount: FloatArray) -> RigImu:
    model = told.get("model", "ideal")
    if model not in IMU_MODELS:
        near = did_you_mean(model, IMU_MODELS) if isinstance(model, str) else ""
        raise ValueError(f"{key}: model must be one of {', '.join(IMU_MODELS)}, got {model!r:.60}{near}")
    given: JsonObject = {"mounting": Mounting(inverse_transform(mount))}
    if "update_rate" in told:
        given["rate_hz"] = _number(key, "update_rate", told["update_rate"])
    if "gravity" in told:
        given["gravity"] = tuple(_numbers(key, "gravity", told["gravity"], (3,)))
    effects = told.get("effects") or {}
    if not isinstance(effects, dict):
        raise ValueError(f"{key}: effects must be a mapping of {', '.join(IMU_EFFECTS)}, got {effects!r:.60}")
    densities = {name: _number(key, name, told[name]) for name in _DENSITIES if name in told}
    try:
        given |= named_effects({name: {} if value is None else value for name, value in effects.items()}, IMU_EFFECTS)
        imu: Imu = replace(IMU_MODELS[model](), **given)
        if densities:
            noise = replace(imu.noise or ImuNoise(0.0, 0.0, 0.0, 0.0), **densities)
            imu = replace(imu, noise=None if noise.neutral else noise)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{key}: {error}") from None
    return RigImu(imu=imu, topic=_text(key, "rostopic", told.get("rostopic", "")))


def rig_yaml(rig: Rig) -> str:
    """Write a rig as :func:`read_rig_file` reads it back: each sensor with its place on the body."""
    import yaml

    content: JsonObject = {"name": rig.name, "body": BODY}
    for index, each in enumerate(rig.cameras):
        camera = each.camera
        section: JsonObject = {
            "camera_model": "pinhole",
            "distortion_model": "radtan",
            "resolution": [camera.width, camera.height],
            "intrinsics": [float(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy)],
            "distortion_coeffs": [float(value) for value in camera.distortion[: 5 if camera.k3 else 4]],
            "parent": BODY,
            "T_cam_parent": inverse_transform(each.mount.matrix).tolist(),
        }
        if each.topic:
            section["rostopic"] = each.topic
        if rig.imus:
            section["timeshift_cam_imu"] = 0.0 - each.clock.offset_s
        elif each.clock.offset_s:
            section["clock_offset"] = each.clock.offset_s
        if each.clock.drift:
            section["clock_drift"] = each.clock.drift
        if isinstance(each.sensor, SensorParameters):
            section["sensor"] = yaml.safe_load(sensor_yaml(SensorFile(each.sensor)))
        elif each.sensor is not None:
            section["sensor"] = each.sensor
        content[f"cam{index}"] = section
    for index, inertial in enumerate(rig.imus):
        imu = inertial.imu
        effects = {name: getattr(imu, name) for name in IMU_EFFECTS if name != "noise"}
        content[f"imu{index}"] = {
            **({"rostopic": inertial.topic} if inertial.topic else {}),
            "update_rate": float(imu.rate_hz),
            **({} if imu.noise is None else imu.noise.settings()),
            "gravity": [float(value) for value in imu.gravity],
            "effects": {name: effect.settings() for name, effect in effects.items() if effect is not None},
            "parent": BODY,
            "T_imu_parent": imu.effective_mounting.matrix.tolist(),
        }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110)


def kalibr_rig_chain(rig: Rig) -> str:
    """Write a rig's cameras as Kalibr's ``camchain.yaml``, which estimators read.

    ``T_cn_cnm1`` leads from one camera to the next, ``T_cam_imu`` from the first IMU to each camera. With the lag of
    that IMU's samples t_imu = t_cam + timeshift_cam_imu.

    Raises:
        ValueError: for a camera with k3, which Kalibr's model ``radtan`` lacks.
    """
    lines: list[str] = []
    for index, each in enumerate(rig.cameras):
        chain: JsonObject = {}
        if rig.imus:
            chain["T_cam_imu"] = inverse_transform(rig.imus[0].seen_from(each.mount).effective_mounting.matrix)
            chain["timeshift_s"] = rig.imus[0].imu.lag_s - each.clock.offset_s
        if index:
            chain["T_cn_cnm1"] = rig.relative_pose(index, index - 1).matrix
        try:
            lines += kalibr_camera(f"cam{index}", each.camera, topic=each.topic or f"/cam{index}/image_raw", **chain)
        except ValueError as error:
            raise ValueError(f"cam{index}: {error}") from None
    return "\n".join(lines) + "\n"


def _mapping(subject: str, content: object, known: Sequence[str] | None = None) -> JsonObject:
    if not isinstance(content, dict):
        raise ValueError(f"{subject} must be a mapping of keys to values, got {content!r:.60}")
    for key in content if known is not None else ():
        if key not in (known or ()):
            near = did_you_mean(key, known or ()) if isinstance(key, str) else ""
            raise ValueError(f"{subject} has no key {key!r:.60}{near or '; there are ' + ', '.join(known or ())}")
    return dict(content)


def _number(key: str, name: str, value: object) -> float:
    if not _is_finite(value):
        raise ValueError(f"{key}: {name} must be a finite number, got {value!r:.60}")
    return float(value)  # type: ignore[arg-type]  # it is a number


def _numbers(key: str, name: str, value: object, counts: Sequence[int]) -> list[float]:
    """Return a list of finite numbers, of one of the given lengths."""
    rule = f"{' or '.join(map(str, counts))} finite numbers"
    values = value if isinstance(value, list) else []
    if len(values) not in counts or not all(_is_finite(each) for each in values):
        raise ValueError(f"{key}: {name} must be {rule}, got {value!r:.60}")
    return [float(each) for each in values]


def _is_finite(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the range of floats
        return False


def _transform(key: str, name: str, told: JsonObject) -> FloatArray:
    """Return a rigid transform (4, 4), its rotation made exact."""
    rows = told[name]
    if not (isinstance(rows, list) and len(rows) == 4):
        raise ValueError(f"{key}: {name} must be 4 rows of 4 numbers, got {rows!r:.60}")
    matrix = [_numbers(key, name, row, (4,)) for row in rows]
    try:
        return Mounting(matrix).matrix
    except ValueError as error:
        raise ValueError(f"{key}: {name}: {error}") from None


def _pose(matrix: FloatArray) -> Pose:
    """Return a pose of a product of transforms; its rotation is made exact again."""
    return Pose.from_matrix(Mounting(matrix).matrix)


def _text(key: str, name: str, value: object) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{key}: {name} must be a text, got {value!r:.60}")
    return value
