"""Fits where two edges of a checkerboard cross: to the light that each pixel near a corner integrates over its area.

OpenCV's refinement takes the point to which gradients are at right angles. In an image that is sharp compared with its
pixels, gradients depend on where edges lie in the pixels' grid, and a lens bends edges. Both move what it finds by some
hundredths of a pixel, a lens alike in all views.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_PER_AXIS = 3
"""Points per pixel and axis at which the model is evaluated, for its mean over the pixel's area."""

_PARAMETERS, _BLUR = 11, 4
"""How many each corner has, and which of them is the blur: x, y, both directions, blur, mean light, contrast and its
slope in x and y, both curvatures."""

_ITERATIONS, _SETTLED_PX = 12, 1e-3
"""The most steps, and the step of a corner after which it takes none."""

_SHARPEST_PX = 0.1
"""A sharper edge looks the same between the points of a pixel."""

_FARTHEST_PX = 0.5
"""No corner is moved by more: what is so far from the start is another thing."""


def fit_corners(image: npt.NDArray[np.uint8], corners: FloatArray, directions: FloatArray, half: int) -> FloatArray:
    """Return corners (n, 2), each fitted in the (2 half + 1)^2 pixels around it; as given where the fit leads nowhere.

    The light around a corner is mean + contrast * s1 * s2. Each s goes from -1 to 1 across an edge, which is a parabola
    through the corner, blurred by a Gaussian; the contrast may change linearly. These values are fitted by least
    squares.

    Args:
        image: (H, W), linear light.
        corners: (n, 2), good to a pixel.
        directions: (n, 2), the angles of the two edges in the image, radians.
        half: how many pixels on either side of a corner's pixel show no other corner.
    """
    # Refining may have moved a corner closer to the image's border.
    centre = np.clip(np.rint(corners).astype(np.int64), half, np.array(image.shape[::-1]) - 1 - half)
    span = np.arange(-half, half + 1)
    light = image[centre[:, 1, None, None] + span[:, None], centre[:, 0, None, None] + span].astype(np.float64)
    light = light.reshape(len(corners), -1)
    fine = np.arange((2 * half + 1) * _PER_AXIS)
    offsets = (fine + 0.5) / _PER_AXIS - half - 0.5
    y, x = (axis.ravel() for axis in np.meshgrid(offsets, offsets, indexing="ij"))

    state = np.zeros((len(corners), _PARAMETERS))
    state[:, :2], state[:, 2:4], state[:, _BLUR] = corners - centre, directions, 0.5
    dark, bright = np.percentile(light, (10, 90), axis=1)
    state[:, 5], state[:, 6] = (dark + bright) / 2, (bright - dark) / 2

    active = np.arange(len(corners))
    for _ in range(_ITERATIONS):
        predicted, derivative = _model(state[active], x, y, half)
        step = _step(predicted - light[active], derivative)
        state[active] += step
        state[active, _BLUR] = np.clip(state[active, _BLUR], _SHARPEST_PX, half)
        active = active[np.abs(step[:, :2]).max(1) > _SETTLED_PX]
        if len(active) == 0:
            break
    fitted = centre + state[:, :2]
    kept = np.hypot(*(fitted - corners).T) <= _FARTHEST_PX
    return np.where(kept[:, None], fitted, corners)


def _step(off: FloatArray, derivative: FloatArray) -> FloatArray:
    """Return the Gauss-Newton step of each corner (n, parameters)."""
    normal = np.einsum("nip,niq->npq", derivative, derivative, optimize=True)
    diagonal = np.arange(_PARAMETERS)
    # Where nothing tells of a value, it stays.
    normal[:, diagonal, diagonal] += 1e-6 * np.maximum(normal[:, diagonal, diagonal], 1e-6)
    return np.asarray(-np.linalg.solve(normal, np.einsum("nip,ni->np", derivative, off)[..., None])[..., 0])


def _model(state: FloatArray, x: FloatArray, y: FloatArray, half: int) -> tuple[FloatArray, FloatArray]:
    """Return the light of each pixel (n, p), and its derivatives (n, p, parameters)."""
    from scipy.special import erf

    centre_x, centre_y, *angles, blur, mean, contrast, slope_x, slope_y, bend_1, bend_2 = state.T[:, :, None]
    dx, dy = x - centre_x, y - centre_y
    sides, by_x, by_y, by_angle, by_blur, by_bend = [], [], [], [], [], []
    for angle, bend in zip(angles, (bend_1, bend_2), strict=True):
        cosine, sine = np.cos(angle), np.sin(angle)
        along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
        away = (across - bend * along**2) / blur
        side, rise = erf(away / np.sqrt(2)), np.sqrt(2 / np.pi) * np.exp(-(away**2) / 2) / blur
        sides.append(side)
        by_x.append(rise * (sine + 2 * bend * along * cosine))
        by_y.append(rise * (-cosine + 2 * bend * along * sine))
        by_angle.append(-rise * (along + 2 * bend * along * across))
        by_blur.append(-rise * away)
        by_bend.append(-rise * along**2)
    first, second = sides
    pattern, height = first * second, contrast + slope_x * dx + slope_y * dy
    columns = [
        height * (by_x[0] * second + first * by_x[1]) - slope_x * pattern,
        height * (by_y[0] * second + first * by_y[1]) - slope_y * pattern,
        height * by_angle[0] * second,
        height * first * by_angle[1],
        height * (by_blur[0] * second + first * by_blur[1]),
        np.ones_like(pattern),
        pattern,
        dx * pattern,
        dy * pattern,
        height * by_bend[0] * second,
        height * first * by_bend[1],
    ]
    size = 2 * half + 1
    shape = len(state), size, _PER_AXIS, size, _PER_AXIS

    def mean_of_pixels(values: FloatArray) -> FloatArray:
        return np.asarray(values.reshape(shape).mean((2, 4)).reshape(len(state), -1))

    return mean_of_pixels(mean + height * pattern), np.stack([mean_of_pixels(column) for column in columns], -1)
