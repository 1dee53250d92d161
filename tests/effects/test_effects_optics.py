"""Vignetting and lens blur: their laws, and that rates, samples and frames all see the same lens."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.ndimage import convolve1d

from davis_rs import Camera, Effects, Pose, Scene, load_scene
from davis_rs.events.luma import LumaFrames, blur_3x3, blur_neighbourhoods
from davis_rs.geometry.camera import PRESETS
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.render.edges.neighbours import mirrored
from davis_rs.sensor.effects.lens_blur import LensBlur
from davis_rs.sensor.effects.optics import Optics, with_optics
from davis_rs.sensor.effects.vignetting import Vignetting
from long_form import long_values

FloatArray = npt.NDArray[np.float64]

CAMERA = Camera(33, 17, 28.0, 28.0, 14.2, 8.9, k1=-0.1)
DAVIS = PRESETS["davis240c"]
SIGMAS = [0.1, 0.3, 0.5, 0.7, 1.0, 1.7, 3.0, 10.0]


def built_in(name: str = "three_planes", *, camera: Camera = CAMERA, **options: Any) -> Renderer:
    return make_renderer(load_scene(name), camera, **{"rays_per_pixel": 3, "kind": "table", **options})


def along(name: str = "three_planes") -> Views:
    """Instants of a built-in scene's own path."""
    trajectory = load_scene(name).trajectory
    assert trajectory is not None
    return Views.along(trajectory, 0.3 + 0.02 * np.arange(6))


def wall(camera: Camera, light: dict[str, Any], *, blur: bool) -> Renderer:
    """An even wall at z = 0 that fills the view."""
    plane = {"type": "rectangle", "to_world": np.diag([99.0, 99.0, 1.0, 1.0]), "bsdf": {"type": "diffuse"}}
    direct = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    scene = Scene("wall", partial(dict, {"type": "scene", "by": direct, "wall": plane, "light": light}))
    return make_renderer(scene, camera, rays_per_pixel=1, kind="table", blur=blur)


def kernel(sigma_px: float) -> FloatArray:
    """Both sides of the kernel, (2 radius + 1,)."""
    half = LensBlur(sigma_px).weights().astype(np.float64)
    return np.concatenate([half[:0:-1], half])


# The laws.


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("exponent", [4.0, 1.0, 6.5])
def test_a_uniform_scene_falls_off_as_the_cosine(exponent: float) -> None:
    """Luma of an evenly lit wall is cos^n of the angle to the axis, through the calibrated lens with its distortion."""
    even = wall(DAVIS, {"type": "constant", "radiance": 0.7}, blur=False)
    views = Views.at_rest([Pose([0.3, -0.2, 1.5], [1.0, 0.0, 0.0, 0.0])])
    level = even.luma(views)[0]
    assert level.min() > 0.1
    np.testing.assert_allclose(level, level[0, 0], rtol=1e-6)

    # The undistorted ray by the fixed point of OpenCV's undistortPoints, apart from the camera's own Newton steps.
    x_of, y_of = np.meshgrid(np.arange(240.0), np.arange(180.0))
    u, v = (x_of - DAVIS.cx) / DAVIS.fx, (y_of - DAVIS.cy) / DAVIS.fy
    x, y = u, v
    for _ in range(100):
        r2 = x * x + y * y
        radial = 1 + DAVIS.k1 * r2 + DAVIS.k2 * r2**2
        dx = 2 * DAVIS.p1 * x * y + DAVIS.p2 * (r2 + 2 * x * x)
        dy = DAVIS.p1 * (r2 + 2 * y * y) + 2 * DAVIS.p2 * x * y
        x, y = (u - dx) / radial, (v - dy) / radial
    cosine = np.cos(np.arctan(np.hypot(x, y)))
    assert cosine.min() < 0.8  # the undistorted corner is more than 36 degrees off the axis
    shaded = with_optics(even, Effects(vignetting=Vignetting(exponent))).luma(views)[0]
    np.testing.assert_allclose(shaded, level * cosine**exponent, rtol=1e-6)


@pytest.mark.parametrize("sigma_px", SIGMAS)
def test_a_point_becomes_a_gaussian_spot(sigma_px: float) -> None:
    """One bright pixel: separable, symmetric, sum 1, variance sigma^2, the logarithm of the weights a parabola."""
    radius = len(LensBlur(sigma_px).weights()) - 1
    size = 2 * radius + 5
    point = np.zeros((1, size, size + 2), np.float32)
    point[0, size // 2, size // 2] = 1
    spot = Optics(Camera(size + 2, size, 99.0, 99.0, 9.0, 9.0), Effects(lens_blur_px=LensBlur(sigma_px))).frames(point)[
        0
    ]
    assert spot.dtype == np.float32
    across, down = (spot.sum(axis, dtype=np.float64) for axis in (0, 1))
    np.testing.assert_allclose(spot, np.outer(down, across), rtol=1e-5, atol=1e-12)
    for line in (across, down):
        k = np.arange(len(line)) - size // 2
        assert line.sum() == pytest.approx(1, abs=2e-7)
        # The tail that is cut off weighs most in the variance of the widest spot.
        assert (k**2 * line).sum() == pytest.approx(sigma_px**2, rel=1e-5)
        seen = line > 0
        np.testing.assert_allclose(line[size // 2 + k[seen]], line[size // 2 - k[seen]], rtol=1e-6)
        # Rounding is smallest compared with the logarithms of the far ones.
        log = np.log(line[seen] / line[k == 0])
        curve = log[-1] / k[seen][-1] ** 2
        np.testing.assert_allclose(log, curve * k[seen] ** 2, rtol=1e-6, atol=1e-6)
        if sigma_px >= 0.7:
            assert curve == pytest.approx(-0.5 / sigma_px**2, rel=0.004)


@pytest.mark.parametrize("sigma_px", SIGMAS)
def test_the_kernel_ends_where_float32_does(sigma_px: float) -> None:
    """Less than a 2^-23rd of the light lies beyond its end, and more beyond the pixel before; all weights are > 0."""
    weights = LensBlur(sigma_px).weights().astype(np.float64)
    a = np.log(weights[0] / weights[1])
    tail = 2 * weights[0] * np.exp(-a * np.arange(400.0) ** 2)
    assert weights.min() > 0
    assert tail[len(weights) :].sum() < 2.0**-23 <= tail[len(weights) - 1 :].sum()


frames = hnp.arrays(
    np.float32,
    st.tuples(st.integers(1, 3), st.integers(1, 9), st.integers(1, 9)),
    elements=st.floats(0, 1e3, width=32),
)


@given(luma=frames, sigma_px=st.floats(0.05, 4))
def test_blur_is_the_convolution_of_the_mirrored_frame(luma: LumaFrames, sigma_px: float) -> None:
    """The kernel along both axes in float64, edges mirrored and not repeated, also of frames smaller than it."""
    optics = Optics(Camera(luma.shape[2], luma.shape[1], 9.0, 9.0, 1.0, 1.0), Effects(lens_blur_px=LensBlur(sigma_px)))
    before = luma.copy()
    blurred = optics.frames(luma)
    assert np.array_equal(luma, before)
    expected = luma.astype(np.float64)
    for axis in (1, 2):
        expected = convolve1d(expected, kernel(sigma_px), axis=axis, mode="mirror")
    np.testing.assert_allclose(blurred, expected, rtol=2e-6, atol=1e-4)
    for index in range(len(luma)):
        assert np.array_equal(optics.frames(luma[index : index + 1])[0], blurred[index])


@pytest.mark.parametrize("sigma_px", [0.3, 0.7, 2.0])
def test_light_is_neither_lost_nor_made(sigma_px: float) -> None:
    """What falls farther inside than the spot's radius all stays; an even frame stays even up to its edges."""
    radius = len(LensBlur(sigma_px).weights()) - 1
    light = np.random.RandomState(1).random_sample((2, 40, 50)).astype(np.float32)
    light = np.pad(light, ((0, 0), *[(radius + 1, radius + 1)] * 2))
    optics = Optics(
        Camera(light.shape[2], light.shape[1], 99.0, 99.0, 9.0, 9.0), Effects(lens_blur_px=LensBlur(sigma_px))
    )
    blurred = optics.frames(light)
    np.testing.assert_allclose(blurred.sum((1, 2), np.float64), light.sum((1, 2), np.float64), rtol=5e-7)
    even = np.full_like(light, 0.37)
    np.testing.assert_allclose(optics.frames(even), even, rtol=5e-7)


def test_a_spot_is_shaded_where_it_lands() -> None:
    """image = vignetting x (spread scene): bit by bit the blurred frame times the gain, not the gain blurred too."""
    luma = np.random.RandomState(2).random_sample((2, 17, 33)).astype(np.float32)
    vignetting, blur = Vignetting(60.0), LensBlur(2.0)
    both = Optics(CAMERA, Effects(vignetting=vignetting, lens_blur_px=blur)).frames(luma)
    blurred = Optics(CAMERA, Effects(lens_blur_px=blur)).frames(luma)
    assert np.array_equal(both, Optics(CAMERA, Effects(vignetting=vignetting)).frames(blurred))
    assert np.array_equal(both, blurred * vignetting.gain(CAMERA))
    assert np.abs(both - Optics(CAMERA, Effects(lens_blur_px=blur)).frames(luma * vignetting.gain(CAMERA))).max() > 0.01


# What a renderer behind a lens gives.


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("blur", [False, True])
def test_rates_are_those_of_the_lens_s_image(blur: bool) -> None:
    """dY/dt behind the lens is the difference quotient of luma behind it: past a lamp near a wall, without any edge."""
    close = Camera(33, 17, 60.0, 60.0, 14.2, 8.9, k1=-0.1)
    renderer = wall(close, {"type": "point", "position": [0.1, -0.05, 0.15], "intensity": 0.5}, blur=blur)
    lens = with_optics(renderer, Effects(vignetting=Vignetting(), lens_blur_px=LensBlur(1.5)))
    still = Views.at_rest([Pose([0.0, 0.0, 1.5], [1.0, 0.0, 0.0, 0.0])])
    twist = np.array([[0.5, -0.3, 0.2]]), np.array([[0.1, 0.2, 0.3]])
    views = Views(still.t_s, still.positions, still.rotations, *twist)
    luma, rate = lens.luma_and_rate(views)
    np.testing.assert_allclose(luma, lens.luma(views), rtol=1e-5)
    before, after = (lens.luma(views.moved([t])).astype(np.float64) for t in (-1e-3, 1e-3))
    central = (after - before) / 2e-3
    assert central.std() > 0.1
    assert np.abs(rate - central).max() < 1e-3 * np.abs(central).max()
    assert np.abs(renderer.luma_and_rate(views)[1] - central).max() > 0.05 * np.abs(central).max()


@pytest.mark.usefixtures("llvm")
def test_frames_and_rates_go_through_the_same_lens() -> None:
    """Every way to frames and rates maps what the renderer gives without the lens, bit by bit, blur and all."""
    renderer, views = built_in(blur=True), along()
    lens = with_optics(renderer, Effects(vignetting=Vignetting(), lens_blur_px=LensBlur()))
    image = Optics(CAMERA, Effects(vignetting=Vignetting(), lens_blur_px=LensBlur())).frames
    sharp, sharp_rate = renderer.luma_and_rate(views)
    assert np.array_equal(lens.luma(views), image(renderer.luma(views)))
    begun, none = lens.begin_luma(views)()
    assert none is None
    assert np.array_equal(begun, lens.luma(views))
    for luma, rate in (lens.luma_and_rate(views), lens.begin_luma_and_rate(views)()):
        assert rate is not None
        assert luma.dtype == rate.dtype == np.float32
        assert np.array_equal(luma, image(sharp))
        assert np.array_equal(rate, image(sharp_rate))
    for i in range(len(views)):
        assert np.array_equal(lens.luma(views[i : i + 1])[0], begun[i])
    assert lens.luma(views[:0]).shape == (0, 17, 33)


@pytest.fixture(scope="module", params=[False, True], ids=["sharp", "blurred"])
def behind_a_lens(request: pytest.FixtureRequest, llvm: str) -> tuple[Renderer, Views, LumaFrames]:
    lens = with_optics(
        built_in("three_walls", blur=request.param), Effects(vignetting=Vignetting(), lens_blur_px=LensBlur())
    )
    views = along("three_walls")
    return lens, views, lens.luma(views)


@pytest.mark.long
@settings(max_examples=40)
@given(
    pairs=st.lists(st.tuples(st.integers(0, 5), st.integers(0, 33 * 17 - 1)), max_size=60),
    twice=st.booleans(),
)
def test_samples_are_pixels_of_the_frames(
    behind_a_lens: tuple[Renderer, Views, LumaFrames], pairs: list[tuple[int, int]], twice: bool
) -> None:
    """Any pairs in any order, doubled or none at all: bit by bit what luma() gives there."""
    lens, views, luma = behind_a_lens
    view, pixel = (np.array([pair[i] for pair in pairs * (1 + twice)], np.int64) for i in (0, 1))
    samples = lens.samples(views, view, pixel)
    assert samples.dtype == np.float32
    assert np.array_equal(samples, luma.reshape(6, -1)[view, pixel])


@pytest.mark.few(1)
def test_whole_frames_of_samples(behind_a_lens: tuple[Renderer, Views, LumaFrames]) -> None:
    """All pixels of all views backwards, corners included, give the frames; so do they one by one, each rendered."""
    lens, views, luma = behind_a_lens
    view, pixel = np.divmod(np.arange(luma.size)[::-1], 33 * 17)
    assert np.array_equal(lens.samples(views, view, pixel), luma.ravel()[::-1])
    alone = [lens.samples(views, [i], [i * 97])[0] for i in range(6)]
    assert np.array_equal(alone, luma.reshape(6, -1)[np.arange(6), np.arange(6) * 97])


@pytest.mark.few(3)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("vignetting", [None, Vignetting()])
@pytest.mark.parametrize("lens_blur", [None, LensBlur(), LensBlur(2.5)])
@pytest.mark.parametrize("size", [*long_values(((1, 1),), ((1, 7),)), (9, 1), (5, 4)])
def test_samples_of_frames_smaller_than_the_spot(
    vignetting: Vignetting | None, lens_blur: LensBlur | None, size: tuple[int, int]
) -> None:
    """Mirrored at both ends at once, with the 3 x 3 blur before the lens: frames and samples still agree."""
    lens = with_optics(
        built_in(camera=Camera(*size, 9.0, 9.0, 1.0, 1.0), blur=True),
        Effects(vignetting=vignetting, lens_blur_px=lens_blur),
    )
    views = along()
    luma = lens.luma(views)
    assert luma.max() > 0
    view, pixel = np.divmod(np.arange(luma.size), size[0] * size[1])
    for chosen in (slice(None), slice(0, 1), slice(2, 3)):
        samples = lens.samples(views, view[chosen], pixel[chosen])
        assert np.array_equal(samples, luma.ravel()[chosen])


@pytest.mark.usefixtures("llvm")
def test_more_rays_are_those_of_a_finer_renderer() -> None:
    """Samples of another number of rays see the lens too."""
    coarse, fine = (
        with_optics(built_in(rays_per_pixel=n, blur=True), Effects(vignetting=Vignetting(), lens_blur_px=LensBlur()))
        for n in (3, 16)
    )
    views = along()
    view, pixel = np.divmod(np.arange(0, 6 * 33 * 17, 7), 33 * 17)
    expected = fine.luma(views).reshape(6, -1)[view, pixel]
    assert np.array_equal(coarse.samples(views, view, pixel, rays=16), expected)
    assert not np.array_equal(coarse.samples(views, view, pixel), expected)


@pytest.mark.usefixtures("llvm")
def test_all_but_luma_passes_through() -> None:
    """Depth and flow keep their bits, the renderer's properties are its own, and it is left as it was."""
    renderer, views = built_in(blur=True, edges=True), along()
    before = renderer.luma(views)
    lens = with_optics(renderer, Effects(vignetting=Vignetting(), lens_blur_px=LensBlur()))
    assert not np.array_equal(lens.luma(views), before)
    assert np.array_equal(renderer.luma(views), before)
    assert renderer.optics is None
    assert np.array_equal(lens.depth(views), renderer.depth(views))
    assert np.array_equal(lens.flow(views), renderer.flow(views), equal_nan=True)
    assert lens.silhouettes is renderer.silhouettes is not None
    for name in ("camera", "rays_per_pixel", "blur", "motion", "name", "reason", "variant", "poses_per_launch"):
        assert getattr(lens, name) == getattr(renderer, name), name
    assert (renderer.reach_px, lens.reach_px) == (1, 4)
    assert with_optics(renderer, Effects(vignetting=Vignetting())).reach_px == 1
    assert with_optics(built_in(blur=False), Effects(lens_blur_px=LensBlur())).reach_px == 3


# Off, and refused.


@pytest.mark.usefixtures("llvm")
def test_neutral_is_off() -> None:
    """Neither, or both at neutral values, is the renderer itself; one at its neutral value leaves the other's bits."""
    renderer, views = built_in(blur=True), along()
    assert with_optics(renderer, Effects()) is renderer
    assert with_optics(renderer, Effects(vignetting=Vignetting(0.0), lens_blur_px=LensBlur(0.0))) is renderer
    assert Vignetting(0.0).neutral
    assert LensBlur(0.0).neutral
    assert not Vignetting().neutral
    assert not LensBlur().neutral
    shaded, blurred = (
        with_optics(renderer, Effects(vignetting=Vignetting())),
        with_optics(renderer, Effects(lens_blur_px=LensBlur())),
    )
    assert np.array_equal(
        with_optics(renderer, Effects(vignetting=Vignetting(), lens_blur_px=LensBlur(0.0))).luma(views),
        shaded.luma(views),
    )
    assert np.array_equal(
        with_optics(renderer, Effects(vignetting=Vignetting(0.0), lens_blur_px=LensBlur())).luma(views),
        blurred.luma(views),
    )
    # A spot too narrow for float32 changes no bit either.
    tiny = with_optics(renderer, Effects(lens_blur_px=LensBlur(1e-9)))
    assert np.array_equal(tiny.luma(views), renderer.luma(views))
    assert np.array_equal(tiny.samples(views, [3], [70]), renderer.samples(views, [3], [70]))


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf, True, "4"])
def test_nonsense_is_refused(value: Any) -> None:
    """Values out of range name the parameter, the range and the value."""
    with pytest.raises(
        ValueError, match=rf"vignetting exponent must be finite and >= 0, got {value!r}".replace("(", r"\(")
    ):
        Vignetting(value)
    with pytest.raises(ValueError, match=rf"lens_blur_px sigma_px must lie in 0\.\.10 px, got {value!r}"):
        LensBlur(value)


def test_a_spot_wider_than_any_lens_s_is_refused() -> None:
    """10 px is the widest."""
    assert LensBlur(10.0).weights().sum() > 0.5
    with pytest.raises(ValueError, match=r"lens_blur_px sigma_px must lie in 0\.\.10 px, got 10\.5"):
        LensBlur(10.5)


@pytest.mark.usefixtures("llvm")
def test_one_lens_is_enough() -> None:
    """A second lens on top of the first is refused, no lens on top of it is not."""
    lens = with_optics(built_in(), Effects(vignetting=Vignetting()))
    assert with_optics(lens, Effects(lens_blur_px=LensBlur(0.0))) is lens
    with pytest.raises(ValueError, match="through a lens already; give all optical effects at once"):
        with_optics(lens, Effects(lens_blur_px=LensBlur()))


# What samples are made of.


@given(size=st.integers(1, 7), reach=st.integers(0, 20))
def test_mirrored_indices_are_those_of_a_reflected_frame(size: int, reach: int) -> None:
    """NumPy's reflection, which also turns back as often as it must."""
    expected = np.pad(np.arange(size), reach, mode="reflect")
    assert np.array_equal(mirrored(np.arange(-reach, size + reach), size), expected)


@given(luma=frames.filter(lambda luma: min(luma.shape[1:]) >= 3))
def test_blur_of_squares_is_that_of_frames(luma: LumaFrames) -> None:
    """The 3 x 3 blur of a part of a frame has the bits of the frame's, wherever it knows all neighbours."""
    inner = blur_neighbourhoods(np.moveaxis(luma, 0, -1))
    assert np.array_equal(np.moveaxis(inner, -1, 0), blur_3x3(luma)[:, 1:-1, 1:-1])
