"""Models a pinhole camera with OpenCV's radial-tangential distortion, and the rays of its pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._core import DecodeError
from .._util.argument_checks import check_number
from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from .._util.html_table import html_table
from .._util.untrusted import read_text

FloatArray = npt.NDArray[np.float64]

_BLOCK = 8192
"""How many pixels are undistorted at a time."""


class _Distorted(NamedTuple):
    """Holds distorted normalised coordinates u, v, and their derivatives by x, y; ``cross`` is u by y, and v by x."""

    u: FloatArray
    v: FloatArray
    u_by_x: FloatArray
    cross: FloatArray
    v_by_y: FloatArray


@names_checked
@dataclass(frozen=True)
class Camera:
    """Intrinsics of a pinhole camera with radial-tangential distortion (OpenCV's model, ``calib.txt``'s nine numbers).

    Pixel (x, y) = (column, row) has its *centre* at exactly (x, y), as in OpenCV and in the public dataset's
    calibration, and covers x - 0.5 to x + 0.5; so the centre of a 240-pixel row lies at 119.5.

    Args:
        width, height: sensor size in pixels (at most 65,535 each).
        fx, fy: focal lengths in pixels, > 0; they may differ.
        cx, cy: principal point in pixels.
        k1, k2, p1, p2, k3: distortion coefficients; with normalised undistorted (x, y) and r^2 = x^2 + y^2 the image
            is at x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), y likewise with p1 and p2 exchanged.

    Raises:
        ValueError: for a size, focal length or coefficient out of range, or a distortion that folds over inside the
            image (then no ray belongs to a pixel).

    Source: OpenCV, camera calibration and 3D reconstruction; Mueggler et al., IJRR 2017, section 2.2.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            check_number(name, getattr(self, name), 1, 65535, whole=True)
        for name in ("fx", "fy"):
            check_number(name, getattr(self, name), 0, above_low=True)
        for name in ("cx", "cy", "k1", "k2", "p1", "p2", "k3"):
            check_number(name, getattr(self, name))

    def _repr_html_(self) -> str:
        rows = [
            ("sensor", f"{self.width} x {self.height} px"),
            ("focal length fx, fy", f"{self.fx:g}, {self.fy:g} px"),
            ("principal point cx, cy", f"{self.cx:g}, {self.cy:g} px"),
            ("distortion k1, k2, p1, p2, k3", ", ".join(f"{value:g}" for value in self.distortion)),
        ]
        return html_table("Camera", rows)

    @property
    def distortion(self) -> tuple[float, float, float, float, float]:
        """Return the coefficients (k1, k2, p1, p2, k3), in the order of ``calib.txt``."""
        return (self.k1, self.k2, self.p1, self.p2, self.k3)

    def resized(self, width: int, height: int) -> Camera:
        """Return the same lens on an image of another size in pixels, with the same horizontal field of view.

        Pixels keep their shape, and the principal point its place as a fraction of the image.
        """
        scale = width / self.width
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * scale,
            fy=self.fy * scale,
            cx=(self.cx + 0.5) * scale - 0.5,
            cy=(self.cy + 0.5) * height / self.height - 0.5,
        )

    def project(self, points: npt.ArrayLike) -> FloatArray:
        """Return pixel coordinates (..., 2) of points (..., 3) in camera axes (x right, y down, z forward, metres).

        Points with z <= 0 are behind the camera and give NaN.
        """
        p = np.asarray(points, np.float64)
        z = np.where(p[..., 2] > 0, p[..., 2], np.nan)
        at = self._distort(p[..., 0] / z, p[..., 1] / z)
        return np.stack([at.u, at.v], -1) * (self.fx, self.fy) + (self.cx, self.cy)

    def rays(self, pixels: npt.ArrayLike) -> FloatArray:
        """Return undistorted rays (..., 2), x and y of (x, y, 1) in camera axes, for pixel coordinates (..., 2).

        Newton's method in float64 solves for them until the projection is within 1e-9 px of the pixel.

        Raises:
            ValueError: where no ray projects to a pixel (the distortion folds over), naming the pixel.
        """
        pixel = np.asarray(pixels, np.float64)
        flat = pixel.reshape(-1, 2)
        xy = np.empty_like(flat)
        largest_squared = self._squared_radius_of_fold()
        # In blocks that fit in the processor's cache, because a table of rays has millions of entries.
        for start in range(0, len(flat), _BLOCK):
            block = slice(start, start + _BLOCK)
            x, y, solved = self._undistorted(flat[block])
            # Beyond a fold the distortion may rise again: a ray from there projects to the pixel, but is not its ray.
            bad = ~solved | (x * x + y * y >= largest_squared)
            if bad.any():
                where = flat[block][bad][0]
                raise ValueError(
                    f"the lens distortion {self.distortion} folds over inside the image: no ray projects to pixel "
                    f"({where[0]:.2f}, {where[1]:.2f}); check calib.txt's order fx fy cx cy k1 k2 p1 p2 k3"
                )
            xy[block, 0], xy[block, 1] = x, y
        return xy.reshape(pixel.shape)

    def _undistorted(self, pixel: FloatArray) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """Return ray directions x and y of pixels (n, 2), and whether each was found where nothing folds over."""
        u, v = (pixel[:, 0] - self.cx) / self.fx, (pixel[:, 1] - self.cy) / self.fy
        x, y = u.copy(), v.copy()
        for _ in range(50):
            at = self._distort(x, y)
            right, down = at.u - u, at.v - v
            if max(np.abs(right).max(initial=0.0), np.abs(down).max(initial=0.0)) < 1e-13:
                break
            with np.errstate(all="ignore"):
                determinant = at.u_by_x * at.v_by_y - at.cross * at.cross
                x = x - (at.v_by_y * right - at.cross * down) / determinant
                y = y - (at.u_by_x * down - at.cross * right) / determinant
        at = self._distort(x, y)
        error = np.maximum(np.abs((at.u - u) * self.fx), np.abs((at.v - v) * self.fy))
        return x, y, (error < 1e-9) & (at.u_by_x * at.v_by_y - at.cross * at.cross > 0)

    def distortion_jacobian(self, xy: npt.ArrayLike) -> FloatArray:
        """Return d(pixel)/d(undistorted ray), shape (..., 2, 2), at ray directions (..., 2)."""
        rays = np.asarray(xy, np.float64)
        at = self._distort(rays[..., 0], rays[..., 1])
        rows = np.stack([at.u_by_x, at.cross], -1), np.stack([at.cross, at.v_by_y], -1)
        return np.stack([rows[0] * self.fx, rows[1] * self.fy], -2)

    def _squared_radius_of_fold(self) -> float:
        """Return the smallest r^2 at which the distorted radius, r (1 + k1 r^2 + k2 r^4 + k3 r^6), stops growing, or
        inf."""
        roots = np.roots([7 * self.k3, 5 * self.k2, 3 * self.k1, 1.0])
        return float(roots.real[(roots.imag == 0) & (roots.real > 0)].min(initial=np.inf))

    def _distort(self, x: FloatArray, y: FloatArray) -> _Distorted:
        """Return distorted normalised coordinates, and their derivatives."""
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))  # d(radial)/dx = slope * x, d(radial)/dy = slope * y
        return _Distorted(
            u=x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            v=y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            u_by_x=radial + slope * x * x + 2 * p1 * y + 6 * p2 * x,
            cross=slope * x * y + 2 * p1 * x + 2 * p2 * y,
            v_by_y=radial + slope * y * y + 6 * p1 * y + 2 * p2 * x,
        )

    def to_calib(self) -> str:
        """Return the line of ``calib.txt``, ``fx fy cx cy k1 k2 p1 p2 k3``, each number exact (shortest round trip)."""
        return " ".join(repr(float(v)) for v in (self.fx, self.fy, self.cx, self.cy, *self.distortion)) + "\n"

    @classmethod
    def from_calib(cls, path: str | Path, *, width: int = 240, height: int = 180) -> Camera:
        """Read ``calib.txt``: one line ``fx fy cx cy k1 k2 p1 p2 [k3]``; the file does not hold the sensor size.

        Raises:
            OSError: if it cannot be read.
            DecodeError: if it does not hold eight or nine numbers on one line, or they are no camera's, naming file
                and line.
        """
        text = read_text(path)
        lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
        if len(lines) != 1:
            raise DecodeError(f"{path}: expected one line 'fx fy cx cy k1 k2 p1 p2 k3', found {len(lines)} lines")
        number, line = lines[0]
        try:
            values = [float(word) for word in line.split()]
        except ValueError as error:
            raise DecodeError(f"{path}, line {number}: {error}") from None
        if len(values) not in (8, 9):
            raise DecodeError(f"{path}, line {number}: expected 8 or 9 numbers, found {len(values)}")
        try:
            return cls(width, height, *values)
        except ValueError as error:
            raise DecodeError(f"{path}, line {number}: {error}") from None


PRESETS: dict[str, Camera] = {
    "ideal": Camera(240, 180, 200.0, 200.0, 119.5, 89.5),
    "davis240c": Camera(
        240, 180, 199.371, 199.708, 133.754, 113.992, k1=-0.38290, k2=0.18934, p1=-0.0010025, p2=-0.00056378
    ),
}
"""``ideal``: a distortion-free DAVIS240 of 200 px focal length. ``davis240c``: the public dataset's calibration."""


def load_camera(name_or_path: str | Path) -> Camera:
    """Load a preset by name (see :data:`PRESETS`), or else a ``calib.txt`` for a 240 x 180 sensor.

    Raises:
        ValueError: if it is neither a preset nor a file.
        DecodeError: if the file is malformed.
    """
    if str(name_or_path) in PRESETS:
        return PRESETS[str(name_or_path)]
    if not Path(name_or_path).is_file():
        raise ArgumentError(
            "{camera} {!r} is neither a preset ({}) nor a calib.txt file", str(name_or_path), ", ".join(PRESETS)
        )
    return Camera.from_calib(name_or_path)
