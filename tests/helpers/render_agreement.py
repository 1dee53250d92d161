"""How far the native renderer agrees with the table kernel: python tests/helpers/render_agreement.py [SCENE ...]

Frames of one ray a pixel, of all sequences and of some other scenes, 20 views each. Prints a table:

- rms: relative difference over the pixels that differ by at most 1e-3;
- off: the share of pixels that differ by more; of them, by a float64 ray caster,
- edge, shadow: how many rays pass within 1e-3 px of an edge, or of the edge of a shadow;
- one plane: how many see two surfaces that lie at one depth, where either may be seen;
- rounding: how many see one surface throughout, whose texture is so fine there that 1e-3 px are worth more than 1e-3
  of luma; of them, how many are wrong by more than 1e-3 in the table kernel, and how many in the native renderer;
- not explained: how many have in the native renderer a luma that no ray within 1e-3 px has.

Needs LLVM for the table kernel.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from davis_rs import Scene, load_scene
from davis_rs.accuracy.hard_case_scenes import hard_cases
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.rays.camera_rays import ray_table
from davis_rs.scene.sequences import SEQUENCES
from exact_scene import Sights, exact_scenes

FloatArray = npt.NDArray[np.float64]

HARD_CASES = ("wires", "scaled", "telephoto", "grazing", "barrel")
SCENES = ("three_planes", "three_walls", "fence", "checkerboard", *SEQUENCES, *HARD_CASES)
CLOSE = 1e-3
"""Relative difference of luma up to which pixels are taken as equal, and rays as seeing the same."""
RADII_PX = (1e-5, 1e-4, 1e-3)


@dataclass
class Agreement:
    """Counts of pixels, and the sum of squares of the relative differences of those that are close; see the top of this
    file."""

    pixels: int = 0
    off: int = 0
    squares: float = 0.0
    edge: int = 0
    shadow: int = 0
    one_plane: int = 0
    rounding: int = 0
    table_wrong: int = 0
    native_wrong: int = 0
    not_explained: int = 0

    @property
    def rms(self) -> float:
        return float(np.sqrt(self.squares / max(1, self.pixels - self.off)))


def scene_named(name: str) -> Scene:
    if name in SEQUENCES:
        return SEQUENCES[name].scene()
    if name in HARD_CASES:
        return next(case.scene for case in hard_cases() if case.name == name)
    return load_scene(name)


def agreement(scene: Scene, views: int = 20) -> Agreement:
    """Compares the renderers along a scene's camera path."""
    native, kernel = (
        make_renderer(scene, scene.own_camera, rays_per_pixel=1, blur=False, kind=kind) for kind in ("native", "table")
    )
    path = Views.along(scene.path, np.linspace(0.0, 0.999 * scene.path.duration_s, views))
    ours, theirs = (renderer.luma(path).reshape(views, -1).astype(np.float64) for renderer in (native, kernel))
    difference = np.abs(ours - theirs) / np.maximum(np.maximum(np.abs(ours), np.abs(theirs)), 1e-12)
    close = np.less_equal(difference, CLOSE)
    found = Agreement(pixels=close.size, off=int((~close).sum()), squares=float((difference[close] ** 2).sum()))
    rays = np.concatenate([ray_table(scene.own_camera, 1)[0].astype(np.float32), np.ones((ours.shape[1], 1))], 1)
    doubtful = np.flatnonzero(~close.all(1))
    for view, exact in zip(doubtful.tolist(), exact_scenes(scene, path[doubtful]), strict=True):
        off = np.flatnonzero(~close[view])
        bundles = rays[off, None] + _steps() / [scene.own_camera.fx, scene.own_camera.fy, 1.0]
        sights = exact.see(path.positions[view], path.rotations[view], bundles)
        _explain(found, sights, ours[view, off], theirs[view, off])
    return found


def _steps() -> FloatArray:
    """(k, 3): no step at all, then around circles, pixels."""
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False) + 0.1
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(16)], 1)
    return np.concatenate([np.zeros((1, 3)), *(radius * circle for radius in RADII_PX)])


def _explain(found: Agreement, sights: Sights, ours: FloatArray, theirs: FloatArray) -> None:
    """Sorts pixels that are off by what float64 says of their rays: (m, k) sights, luma (m,)."""
    per_circle = (sights.luma.shape[1] - 1) // len(RADII_PX)

    def changes(of: npt.NDArray[np.int64]) -> FloatArray:
        """For each ray the first radius at which something else is seen; inf for none."""
        other = np.not_equal(of[:, 1:], of[:, :1]).reshape(len(of), len(RADII_PX), per_circle).any(2)
        return np.where(other, RADII_PX, np.inf).min(1)

    edge, shadow = changes(sights.triangle), changes(sights.shadows)
    one_plane = np.any(sights.margin < 1e-5, axis=1)
    truth, low, high = sights.luma[:, 0], sights.luma.min(1), sights.luma.max(1)
    slack = CLOSE * np.maximum(np.maximum(ours, theirs), truth)
    for i in range(len(ours)):
        if one_plane[i]:
            found.one_plane += 1
        elif not low[i] - slack[i] <= ours[i] <= high[i] + slack[i]:
            found.not_explained += 1
        elif np.isfinite(edge[i]):
            found.edge += 1
        elif np.isfinite(shadow[i]):
            found.shadow += 1
        else:
            found.rounding += 1
            found.table_wrong += int(abs(theirs[i] - truth[i]) > slack[i])
            found.native_wrong += int(abs(ours[i] - truth[i]) > slack[i])


HEADINGS = (
    *("scene", "rms", "off", "edge", "shadow", "one plane", "rounding"),
    *("table wrong", "native wrong", "not explained"),
)


def row(name: str, found: Agreement) -> str:
    counts = [found.edge, found.shadow, found.one_plane, found.rounding]
    counts += [found.table_wrong, found.native_wrong, found.not_explained]
    cells = [name, f"{found.rms:.1e}", f"{found.off / found.pixels:.1e}", *map(str, counts)]
    return f"| {' | '.join(cells)} |"


def main(names: list[str]) -> None:
    print(f"| {' | '.join(HEADINGS)} |\n|---|{'---:|' * (len(HEADINGS) - 1)}")
    for name in names:
        print(row(name, agreement(scene_named(name))), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or list(SCENES))
