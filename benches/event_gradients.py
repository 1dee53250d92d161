"""Derivatives of event times against crossings that are searched again: python benches/event_gradients.py [SCENE ...]

Each unknown is shifted so that the event moves by 0.01 us, to both sides, and the crossing is found again by bisection
of log luma in float64: no derivative is used. Of each kind of event 600 are drawn at random. An event is within 1 %
where the error of its row is no more than that share of the row, both as norms over columns, each in units of its
median or of 100 us. Speed is in processor time: events a second on two cores, with the start of the run and the search
for jumps.

A second table is of the mean of a pixel (``edges="mean"``), with 1,024 rays: of up to 300 events for which edges make
at least a tenth of a row, and of up to 300 others. The truth is the same formula, with all derivatives of log luma by
central differences of the mean over 24 sets of 1,024 rays, within a 32nd of a pixel of each other.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

import davis_rs
from davis_rs.differentiable import EventTimeDerivatives
from davis_rs.differentiable.event_jacobian import EventTimeModel
from davis_rs.differentiable.log_luma import LogLumaField
from davis_rs.events.arrays import concatenate_events
from davis_rs.geometry.trajectory.views import Views

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

STRETCHES = {
    "three_planes": (0.1003, 0.05),
    "three_walls": (0.1003, 0.05),
    "office_zigzag": (2.0003, 0.05),
    "fence": (0.1003, 0.02),
}
"""Start and length, seconds: at rest, or where rays start on borders of texels, there is no derivative."""

SAMPLES, DRAWN = 8, 600
MOVED_US = 0.01
LEAST_US = 100.0
"""Microseconds by a metre, a radian, or another unit, below which a column has no say."""

WINDOWS_US = (4.0, 40.0, 300.0)
HALVINGS = 50
UNKNOWNS = ("pose", "contrast_threshold", "log_eps", "light")


@dataclass(frozen=True)
class Shift:
    """What is changed for each of n events: the path, the thresholds, the dark level, the lights."""

    pose: FloatArray
    on: FloatArray
    off: FloatArray
    log_eps: FloatArray
    lights: FloatArray


def shifted(column: int, by: FloatArray, lights: int) -> Shift:
    columns = np.zeros((len(by), 9 + lights))
    columns[:, column] = by
    return Shift(columns[:, :6], columns[:, 6], columns[:, 7], columns[:, 8], columns[:, 9:])


class Reference:
    """Crossings of a run's levels, found by bisection."""

    def __init__(self, model: EventTimeModel, at: EventTimeDerivatives, index: IntArray) -> None:
        self.model, self.levels = model, at.levels
        self.t_us, self.pixel = at.levels.t_us[index], at.levels.pixel[index]
        self.sign, self.on, self.off = at.levels.sign[index], at.levels.on[index], at.levels.off[index]
        self.of_name = model.field.of_light_name

    def log_luma(self, t_us: FloatArray, shift: Shift, which: IntArray) -> FloatArray:
        """Of events ``which``, at times of their own."""
        field = self.model.field
        views = field.views(t_us)
        turns = Rotation.from_rotvec(shift.pose[which, 3:]).as_matrix()
        moved = Views(
            views.t_s,
            views.positions + shift.pose[which, :3],
            views.rotations @ turns,
            views.velocities,
            views.angular_rates,
        )
        around = field.pixels.neighbours(self.pixel[which]).astype(np.uint32)
        table = field.renderer.gradients(moved, np.arange(len(which), dtype=np.uint32), around, field.pixels.weights)
        factors = np.expm1(shift.lights[which] @ self.of_name.T)
        luma = table[:, 0] + (table[:, 8:] * factors).sum(1)
        return np.asarray(np.log(luma + field.log_eps + shift.log_eps[which]))

    def crossings(self, shift: Shift) -> FloatArray:
        """(n,) microseconds; NaN where none is near."""
        simulator, everyone = self.model.simulator, np.arange(len(self.t_us))
        level = self.log_luma(np.zeros(len(everyone)), shift, everyone)
        level += self.on * (simulator.contrast_threshold + shift.on)
        level -= self.off * (simulator.contrast_threshold_off + shift.off)

        def above(t_us: FloatArray, which: IntArray) -> FloatArray:
            return np.asarray(self.sign[which] * (self.log_luma(t_us, shift, which) - level[which]))

        last_us = self.model.path.duration_s * 1e6
        low, high = np.full(len(level), np.nan), np.full(len(level), np.nan)
        for window in WINDOWS_US:
            which = np.flatnonzero(np.isnan(low))
            if len(which) == 0:
                break
            begin = np.clip(self.t_us[which] - 0.5 - window, 0, last_us)
            end = np.clip(self.t_us[which] - 0.5 + window, 0, last_us)
            enclosed = (above(begin, which) < 0) & (above(end, which) >= 0)
            low[which[enclosed]], high[which[enclosed]] = begin[enclosed], end[enclosed]
        which = np.flatnonzero(np.isfinite(low))
        for _ in range(HALVINGS):
            middle = (low[which] + high[which]) / 2
            reached = above(middle, which) >= 0
            high[which[reached]], low[which[~reached]] = middle[reached], middle[~reached]
        return (low + high) / 2


def differences(reference: Reference, jacobian: FloatArray, typical: FloatArray, lights: int) -> FloatArray:
    """``typical``: how much each column is, so that where it is 0 shifts are small too."""
    found = np.full_like(jacobian, np.nan)
    for column in range(jacobian.shape[1]):
        by = MOVED_US / np.maximum(np.abs(jacobian[:, column]), 0.1 * typical[column])
        ahead, behind = (reference.crossings(shifted(column, sign * by, lights)) for sign in (1, -1))
        found[:, column] = (ahead - behind) / (2 * by)
    return found


def within(jacobian: FloatArray, truth: FloatArray, shares: tuple[float, ...] = (0.01, 0.05)) -> str:
    known = np.isfinite(truth).all(1)
    if not known.any():
        return "-"
    truth, error = truth[known], jacobian[known] - truth[known]
    unit = np.maximum(np.median(np.abs(truth), axis=0), LEAST_US)
    size, off = (np.linalg.norm(one / unit, axis=1) for one in (truth, error))
    return ", ".join(f"{100 * (off <= share * size + 1e-3).mean():.1f}" for share in shares)


def rows(name: str) -> list[str]:
    start_s, duration_s = STRETCHES[name]
    scene = davis_rs.load_scene(name).crop(start_s, duration_s)
    settings: dict[str, Any] = {"accuracy": "exact", "rays_per_pixel": SAMPLES}
    packets = davis_rs.simulate(scene, frame_rate_hz=0, depth_rate_hz=0, **settings)
    events = concatenate_events([packet.events for packet in packets])
    model = EventTimeModel(scene, **settings)
    seconds = []
    for _ in range(2):
        begin = time.process_time()
        at = model.linearise(model.levels(events))
        at.jacobian(("pose",))
        seconds.append(time.process_time() - begin)
    lights = len(model.field.light_names)
    jacobian = at.jacobian(UNKNOWNS)
    typical = np.median(np.abs(jacobian[at.smooth & (at.levels.on > 0) & (at.levels.off > 0)]), axis=0)
    typical = np.maximum(typical, np.median(np.abs(jacobian[at.smooth]), axis=0)) + LEAST_US
    draw = np.random.RandomState(0)
    kinds = {"light runs smoothly": at.smooth, "a ray jumps": at.jump}
    lines = []
    for kind, flags in kinds.items():
        index = np.flatnonzero(flags)
        index = np.sort(draw.permutation(index)[:DRAWN])
        cells = [name, kind, f"{len(events):,}", f"{100 * flags.mean():.1f}"]
        if len(index) >= 20:
            truth = differences(Reference(model, at, index), jacobian[index], typical, lights)
            for part in (slice(0, 6), slice(6, 8), slice(8, None)):
                cells.append(within(jacobian[index][:, part], truth[:, part]))
        else:
            cells += ["-"] * 3
        masked = 100 * (1 - (at.smooth | at.jump).mean())
        cells += [f"{masked:.1f}", f"{2 * len(events) / min(seconds):,.0f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def turned(views: Views, shift: FloatArray, turn: FloatArray) -> Views:
    """Moved by (n, 3) in the world, then turned by rotation vectors (n, 3)."""
    rotations = views.rotations @ Rotation.from_rotvec(turn).as_matrix()
    return Views(views.t_s, views.positions + shift, rotations, views.velocities, views.angular_rates)


class MeanReference:
    """Log luma of the mean over pixels, by many rays."""

    def __init__(self, field: LogLumaField, pixel: IntArray) -> None:
        camera = field.renderer.camera
        focal_px = np.array([camera.fy, camera.fx])
        draws = np.random.RandomState(1).rand(MEAN_SETS, 2) - 0.5
        self.field, self.pixel = field, pixel
        self.turns = np.pad(draws / np.sqrt(field.renderer.rays_per_pixel) / focal_px, ((0, 0), (0, 1)))

    def log_luma(self, t_us: FloatArray, pose: FloatArray) -> FloatArray:
        """At instants (n,), with an increment (6,) of the pose."""
        count = len(self.pixel)
        views = turned(self.field.views(t_us), np.tile(pose[:3], (count, 1)), np.tile(pose[3:], (count, 1)))
        luma = np.zeros(count)
        around = self.field.pixels.neighbours(self.pixel).astype(np.uint32)
        for turn in self.turns:
            own = turned(views, np.zeros((count, 3)), np.tile(turn, (count, 1)))
            luma += self.field.renderer.gradients(
                own, np.arange(count, dtype=np.uint32), around, self.field.pixels.weights
            )[:, 0]
        return np.asarray(np.log(luma / len(self.turns) + self.field.log_eps))

    def by_pose(self, t_us: FloatArray) -> FloatArray:
        """(n, 6)."""
        columns = []
        for column, by in enumerate(MEAN_MOVED):
            step = np.eye(6)[column] * by
            columns.append((self.log_luma(t_us, step) - self.log_luma(t_us, -step)) / (2 * by))
        return np.stack(columns, 1)

    def jacobian(self, t_us: FloatArray) -> FloatArray:
        """(n, 6) microseconds by the pose."""
        still = np.zeros(6)
        rate = self.log_luma(t_us + MEAN_MOVED_US, still) - self.log_luma(t_us - MEAN_MOVED_US, still)
        return -(self.by_pose(t_us) - self.by_pose(np.zeros_like(t_us))) * (2 * MEAN_MOVED_US / rate)[:, None]


MEAN_SETS, MEAN_SAMPLES, MEAN_PIXELS, MEAN_DRAWN, MEAN_DURATION_S = 24, 1024, 1500, 300, 0.01
MEAN_MOVED, MEAN_MOVED_US = (5e-4, 5e-4, 5e-4, 1e-4, 1e-4, 1e-4), 50.0


def mean_rows(name: str) -> list[str]:
    scene = davis_rs.load_scene(name).crop(STRETCHES[name][0], MEAN_DURATION_S)
    settings: dict[str, Any] = {"rays_per_pixel": MEAN_SAMPLES, "refine": True}
    packets = davis_rs.simulate(scene, frame_rate_hz=0, depth_rate_hz=0, **settings)
    events = concatenate_events([packet.events for packet in packets])
    width = scene.own_camera.width
    pixel = events["y"].astype(np.int64) * width + events["x"]
    random = np.random.RandomState(0)
    events = events[np.isin(pixel, random.permutation(np.unique(pixel))[:MEAN_PIXELS])]
    surfaces = EventTimeModel(scene, **settings).field
    model = EventTimeModel(scene, edges="mean", **settings)
    begin = time.process_time()
    at = model.linearise(model.levels(events))
    jacobian = at.jacobian(("pose",))
    seconds = time.process_time() - begin
    alone = surfaces.at(at.t_us, at.levels.pixel).pose
    unit = np.median(np.abs(at.here.pose), axis=0)
    edges = np.linalg.norm((at.here.pose - alone) / unit, axis=1) > 0.1 * np.linalg.norm(at.here.pose / unit, axis=1)
    found = []
    for where, these in (("an edge passes", edges), ("no edge", ~edges)):
        index = random.permutation(np.flatnonzero(these & at.ok))[:MEAN_DRAWN]
        if not len(index):
            continue
        truth = MeanReference(surfaces, at.levels.pixel[index]).jacobian(at.t_us[index])
        cells = [name, where, f"{these.sum():,}", within(jacobian[index], truth, (0.01, 0.05, 0.1))]
        cells += [f"{100 * (1 - at.ok[these].mean()):.1f}", f"{2 * len(events) / seconds:,.0f}"]
        found.append("| " + " | ".join(cells) + " |")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=list(STRETCHES), metavar="SCENE", help=", ".join(STRETCHES))
    print("| scene | where | events | share (%) | poses | thresholds | dark level, light | masked (%) | a second |")
    print("|---|---|---:|---:|---:|---:|---:|---:|---:|")
    scenes = parser.parse_args().scenes
    for name in scenes:
        print(*rows(name), sep="\n", flush=True)
    print("\n| scene | where | events | poses: 1, 5, 10 % | masked (%) | a second |")
    print("|---|---|---:|---:|---:|---:|")
    for name in scenes:
        print(*mean_rows(name), sep="\n", flush=True)


if __name__ == "__main__":
    main()
