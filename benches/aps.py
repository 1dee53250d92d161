"""The frames of active pixels: their photon transfer curve, their fixed patterns, and a rolling shutter.

python benches/aps.py [-o docs/aps.png]
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from effect_figure import picture

from davis_rs import Camera, Effects, Scene, SegmentTrajectory, Simulator
from davis_rs.geometry.pose import FloatArray, Pose
from davis_rs.sensor.effects import Aps

SIZE = 180, 240
SENSOR = Aps(0, 2.88, 10, 1.0, full_well_e=25_000.0, electrons_per_dn=30.2, prnu=0.02, dsnu_dn=3.0)
"""Its well is full at 828 of 1023 DN."""

PATTERNS = Aps(0, 2.0, 10, 1.0, prnu=0.02, dsnu_dn=3.0, column_offset_dn=5.0, column_noise_dn=1.0)
CAMERA = Camera(120, 90, 100.0, 100.0, 59.5, 44.5)
SPEED_PX_S, ROW_US, EXPOSURE_US, SECONDS = 2_000.0, 100.0, 500, 0.04
"""How fast stripes move, the rows' readout, the shutter, and how long it takes."""


def transfer(level: float, aps: Aps = SENSOR) -> tuple[float, float, float]:
    """Mean, variance in time and variance from pixel to pixel, in DN, of an even grey (EMVA 1288: by two frames)."""
    first, second = (aps.read_out(np.full(SIZE, level), frame=k).astype(np.float64) * 1023 for k in range(2))
    temporal = float(np.var(first - second) / 2)
    return float(first.mean()), temporal, float(np.mean((first - first.mean()) * (second - second.mean())))


def stripes() -> Scene:
    """Upright stripes on a floor, 20 px wide, seen from 3 m above by a camera that moves along x."""
    texels = np.repeat(np.tile(np.repeat([0.1, 0.8], 1), 40)[None, :, None], 3, -1).astype(np.float32)
    bitmap = {"type": "bitmap", "raw": True, "filter_type": "nearest", "data": np.repeat(texels, 2, 0)}
    wide = np.diag([24.0, 24.0, 1.0, 1.0])
    parts: dict[str, Any] = {
        "type": "scene",
        "sun": {"type": "directional", "direction": [0.0, 0.0, -1.0], "irradiance": 3.0},
        "floor": {"type": "rectangle", "to_world": wide, "bsdf": {"type": "diffuse", "reflectance": bitmap}},
    }
    way_m = SPEED_PX_S * SECONDS / CAMERA.fx * 3.0
    ends = (Pose([x, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0]) for x in (0.0, way_m))
    return Scene("stripes", partial(dict, parts), shadows=False).with_trajectory(SegmentTrajectory(*ends, SECONDS))


def last_frame(aps: Aps) -> FloatArray:
    """What active pixels see of the stripes at the end."""
    simulator = Simulator(stripes(), camera=CAMERA, effects=Effects(aps=aps), frame_rate_hz=50, depth_rate_hz=0)
    frames = [packet.frame for packet in simulator.run() if packet.frame is not None]
    return frames[-1].astype(np.float64)


def edge_places(frame: FloatArray) -> FloatArray:
    """The place right of its middle where each row first passes from dark to light, between two pixels."""
    middle = (frame.max() + frame.min()) / 2
    places = []
    for row in frame:
        up = 20 + int(np.flatnonzero((row[20:-1] < middle) & (row[21:] >= middle))[0])
        places.append(up + (middle - row[up]) / (row[up + 1] - row[up]))
    return np.array(places)


def main() -> None:
    """Run, print, draw."""
    with picture(__doc__, panels=3, size=(8.4, 2.7)) as (curve, columns, rolling):
        per_dn, well = SENSOR.electrons_per_dn or 1.0, (SENSOR.full_well_e or math.inf) / (SENSOR.electrons_per_dn or 1)
        found = np.array([transfer(level) for level in np.geomspace(0.003, 1.0, 40)])
        mean = np.geomspace(1, well, 200)
        curve.loglog(mean, SENSOR.read_noise_dn**2 + mean / per_dn + 1 / 12, "C0", linewidth=1, label="law: in time")
        curve.plot(mean, SENSOR.dsnu_dn**2 + (SENSOR.prnu * mean) ** 2, "C1", linewidth=1, label="law: pixel to pixel")
        curve.plot(found[:, 0], found[:, 1], "C0.", markersize=4)
        curve.plot(found[:, 0], found[:, 2], "C1.", markersize=4)
        curve.axvline(well, color="k", linestyle=":", linewidth=0.7, label="full well")
        curve.set(xlabel="mean (DN)", ylabel="variance (DN$^2$)", ylim=(1, 1e3))
        curve.legend(loc="upper left")
        inside = (found[:, 0] > 30) & (found[:, 0] < 0.9 * well)
        law = SENSOR.read_noise_dn**2 + found[inside, 0] / per_dn + 1 / 12
        print(f"variance in time over its law, 30 DN to 90 % of the well: {(found[inside, 1] / law).mean():.4f}")
        print(f"beyond the full well: mean {found[-1, 0]:.1f} DN, variance in time {found[-1, 1]:.2f} DN^2")
        frame = PATTERNS.read_out(np.full(SIZE, 0.3), frame=0) * 1023
        columns.imshow(frame[:60, :80], cmap="gray", vmin=0.3 * 1023 - 25, vmax=0.3 * 1023 + 25)
        columns.set_title("an even grey: pixels and columns", fontsize=7)
        columns.axis("off")
        skewed = last_frame(Aps(EXPOSURE_US, 0, None, None, row_readout_us=ROW_US))
        rolling.imshow(skewed, cmap="gray")
        rolling.set_title(f"rolling shutter, {ROW_US:g} us a row, {SPEED_PX_S:g} px/s", fontsize=7)
        rolling.axis("off")
        places, rows = np.unwrap(edge_places(skewed), period=40.0), np.arange(CAMERA.height)
        law = places[-1] + (CAMERA.height - 1 - rows) * ROW_US * 1e-6 * SPEED_PX_S
        rolling.plot((law + 20) % 120 - 0.5, rows, "r.", markersize=1)
        off = np.abs(places - law).max()
        print(f"rolling shutter: {places[0] - places[-1]:.2f} px of skew, off geometry by {off:.3f} px at most")


if __name__ == "__main__":
    main()
