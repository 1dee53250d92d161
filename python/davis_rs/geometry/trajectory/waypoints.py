"""Makes a trajectory from control points: through or near them, at a given speed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import check_number
from ..._util.close_names import names_checked
from ..pose import UNIT_NORM_TOLERANCE, FloatArray
from .sampled_trajectory import SampledTrajectory

_SAMPLE_RATE_HZ = 400.0
_TURN_RADIUS_M = 0.2
_TABLE_PER_LEG = 200


@names_checked
def waypoint_trajectory(
    positions: npt.ArrayLike,
    quaternions: npt.ArrayLike,
    *,
    speed_m_s: float,
    through: bool = True,
    ramp_s: float = 0.3,
) -> SampledTrajectory:
    """Make a smooth path along control points, at constant speed between a start and an end at rest.

    The curve is a natural cubic spline through the points over the distance between them; or, near them, the
    cubic B-spline that has them as its control points, from the first to the last: it keeps within their hull, and cuts
    corners. Rotations follow likewise, in the components of the quaternion. A turn counts as a path, too: by an angle a
    as a distance of a * 0.2 m, so that the camera also turns on the spot.

    Args:
        positions: (n, 3) metres, world, n >= 2.
        quaternions: (n, 4) of R_world_camera, (x, y, z, w), of norm 1 within 1e-3, any sign; neighbours must differ by
            less than 90 degrees.
        speed_m_s: of that path between the ramps, > 0: the camera's, where it hardly turns.
        through: through the points, or near them.
        ramp_s: how long the speed takes to rise from 0 and to fall to 0, >= 0; shortened where the path is too short.
            Without ramps it starts and ends at full speed.

    Raises:
        ValueError: for shapes, quaternions or numbers out of range, neighbours that are 90 degrees or more apart, or
            two equal neighbours.

    The path is evaluated 400 times a second and interpolated (:class:`SampledTrajectory`), with exact derivatives.
    """
    from scipy.interpolate import BSpline, CubicSpline, PchipInterpolator

    p, q = np.array(positions, np.float64), np.array(quaternions, np.float64)
    if p.ndim != 2 or p.shape[1:] != (3,) or len(p) < 2 or q.shape != (len(p), 4):
        raise ValueError(f"waypoints must have shapes (n, 3) and (n, 4), n >= 2, got {p.shape} and {q.shape}")
    if not (np.isfinite(p).all() and np.isfinite(q).all()):
        raise ValueError("waypoints must be finite")
    norms = np.linalg.norm(q, axis=1)
    if (np.abs(norms - 1) > UNIT_NORM_TOLERANCE).any():
        raise ValueError(f"waypoint quaternions must have norm 1 within {UNIT_NORM_TOLERANCE}, got {norms.tolist()}")
    check_number("speed_m_s", speed_m_s, 0, above_low=True)
    check_number("ramp_s", ramp_s, 0)
    q /= norms[:, None]
    q[1:] *= np.cumprod(np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0))[:, None]
    angles = 2 * np.arccos(np.clip((q[1:] * q[:-1]).sum(1), -1, 1))
    if (angles >= np.pi / 2).any():
        at = int(angles.argmax())
        raise ValueError(
            f"neighbouring waypoints must be turned by less than 90 degrees, got {np.degrees(angles[at]):.1f} "
            f"between {at} and {at + 1}"
        )
    # Quaternions as lengths: a small turn by a moves them by a / 2.
    points = np.concatenate([p, 2 * _TURN_RADIUS_M * q], axis=1)
    legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if (legs == 0).any():
        raise ValueError(f"waypoints {int(legs.argmin())} and {int(legs.argmin()) + 1} are the same")
    if through:
        curve = CubicSpline(np.concatenate([[0.0], np.cumsum(legs)]), points, bc_type="natural")
        first, last = 0.0, float(legs.sum())
    else:
        degree = min(3, len(points) - 1)
        knots = np.concatenate([np.zeros(degree), np.arange(len(points) - degree + 1), np.zeros(degree)])
        first, last = 0.0, float(len(points) - degree)
        knots[-degree:] = last
        curve = BSpline(knots, points, degree)
    u = np.linspace(first, last, _TABLE_PER_LEG * len(points) + 1)
    steps = np.linalg.norm(np.diff(curve(u), axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    at_length = PchipInterpolator(length, u)

    duration_s, travelled = _ramped(float(length[-1]), speed_m_s, ramp_s)
    t = np.linspace(0.0, duration_s, max(8, round(duration_s * _SAMPLE_RATE_HZ)) + 1)
    samples = curve(at_length(np.clip(travelled(t), 0.0, length[-1])))
    rotation = samples[:, 3:] / np.linalg.norm(samples[:, 3:], axis=1, keepdims=True)
    return SampledTrajectory(
        t,
        samples[:, :3],
        rotation,
        description={"kind": "waypoints", "waypoints": len(p), "through": through, "speed_m_s": float(speed_m_s)},
    )


def _ramped(length: float, speed: float, ramp_s: float) -> tuple[float, Callable[[FloatArray], FloatArray]]:
    """Return the time for a length with ramps of the speed at both ends, and the distance travelled as a function of
    time."""
    ramp_s = min(ramp_s, length / speed)
    duration_s = length / speed + ramp_s

    def risen(t: FloatArray) -> FloatArray:
        """Return the integral of a smooth step over a ramp, 3 x^2 - 2 x^3, and of 1 after it."""
        if ramp_s == 0:
            return t
        x = np.clip(t / ramp_s, 0.0, 1.0)
        covered: FloatArray = ramp_s * (x**3 - x**4 / 2) + np.maximum(t - ramp_s, 0.0)
        return covered

    def travelled(t: FloatArray) -> FloatArray:
        early = t <= duration_s / 2
        return np.where(early, speed * risen(t), length - speed * risen(duration_s - t))

    return duration_s, travelled
