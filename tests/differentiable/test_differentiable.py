"""The differentiable renderer: its frames, its derivatives both ways, and what they leave out."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Pose, Scene, SegmentTrajectory
from davis_rs._mitsuba.variants import SCALAR, variant
from davis_rs.differentiable import CameraPoses, DifferentiableRenderer, spline
from davis_rs.differentiable.edge_passes import ChangedRays, EdgePasses, Passes
from davis_rs.events.luma import blur_3x3
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene.light_profile import Flicker
from long_form import long_values
from places import ROOT

FloatArray = npt.NDArray[np.float64]
Function = Callable[[Any], Any]

CAMERA = Camera(24, 18, 22.0, 24.0, 11.2, 8.9, k1=-0.1)
# Looks at the origin, rolled by 0.4 rad: a skew rotation, unlike its transpose.
POSE = Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])
OTHER = Pose([0.3, -0.7, 1.7], POSE.quaternion)
LAMP = {"type": "point", "position": [0.4, -0.5, 2.5], "intensity": {"type": "rgb", "value": [9.0, 20.0, 4.0]}}
SUN = {"type": "directional", "direction": [0.2, 0.3, -1.0], "irradiance": 3.0}
SKY = {"type": "constant", "radiance": 0.7}
TEXELS = np.random.RandomState(3).random_sample((9, 16, 3)).astype(np.float32)
EXAMPLES = ROOT / "examples"


@pytest.fixture
def mi(llvm: str) -> Iterator[Any]:
    """Mitsuba under the variant that a user of derivatives works in."""
    with variant(llvm) as (mitsuba, _):
        yield mitsuba


def bitmap(texels: Any, **settings: Any) -> dict[str, Any]:
    reflectance = {"type": "bitmap", "raw": True, "data": texels, **settings}
    return {"type": "twosided", "inner": {"type": "diffuse", "reflectance": reflectance}}


def plane(half: float, bsdf: dict[str, Any], x: float = 0.0, z: float = 0.0) -> dict[str, Any]:
    to_world = np.diag([half, half, 1.0, 1.0])
    to_world[:3, 3] = x, 0, z
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}


def scene(parts: dict[str, Any], *, shadows: bool = False, blur: bool = False) -> Scene:
    direct = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    source = {"type": "scene", "integrator": direct, **parts}
    return Scene(name="test", source=lambda: source, shadows=shadows, blur=blur)


def smooth_scene() -> Scene:
    """One plane that fills the view, textured by a u + b v + c u v: its bilinear lookup has no kinks."""
    v, u = np.meshgrid(*[(np.arange(64) + 0.5) / 64] * 2, indexing="ij")
    texels = np.stack([0.1 + 0.8 * u, 0.9 - 0.7 * v, 0.2 + 0.6 * u * v], -1).astype(np.float32)
    return scene({"lamp": LAMP, "sun": SUN, "sky": SKY, "floor": plane(3.0, bitmap(texels))}, blur=True)


SCENES = {
    "three lights, blur": smooth_scene(),
    "edges, shadows and background": scene(
        {"lamp": LAMP, "sky": SKY, "floor": plane(0.8, bitmap(TEXELS)), "tile": plane(0.3, bitmap(TEXELS), z=0.4)},
        shadows=True,
    ),
    "wrap modes": scene(
        {
            "lamp": LAMP,
            "floor": plane(3.0, bitmap(TEXELS, wrap_mode="mirror", to_uv=np.diag([3.0, 2.0, 1.0]))),
            "tile": plane(0.3, bitmap(TEXELS, wrap_mode="clamp", to_uv=np.diag([2.0, 2.0, 1.0])), z=0.4),
            "grey": plane(0.2, {"type": "diffuse", "reflectance": 0.3}, z=0.5),
        }
    ),
}


@pytest.mark.few(1)
@pytest.mark.parametrize("name", SCENES)
def test_frames_are_the_table_renderers(name: str, mi: Any) -> None:
    """Derivatives are of the frames that are simulated, whether anything is attached or replaced, or nothing."""
    import drjit as dr

    renderer = DifferentiableRenderer(SCENES[name], CAMERA)
    expected = make_renderer(SCENES[name], CAMERA, rays_per_pixel=4, kind="table").luma(Views.at_rest([POSE, OTHER]))
    poses = CameraPoses.at([POSE, OTHER])
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose(renderer.luma(poses).numpy(), expected, atol=1e-6, rtol=1e-6)
    increments = dr.zeros(mi.TensorXf, (2, 6))
    parameters = renderer.parameters
    dr.enable_grad(increments, parameters)
    attached = renderer.luma(poses.perturbed(increments), parameters)
    np.testing.assert_allclose(attached.numpy(), expected, atol=1e-6, rtol=1e-6)


def test_a_reflectance_may_be_grey(mi: Any) -> None:
    """(H, W) is the same in all channels: under coloured light too."""
    renderer = DifferentiableRenderer(SCENES["wrap modes"], CAMERA)
    poses = CameraPoses.at([POSE])
    grey, rgb = (
        renderer.luma(poses, {"floor.reflectance": values}).numpy()
        for values in (TEXELS[..., 0], np.repeat(TEXELS[..., :1], 3, -1))
    )
    np.testing.assert_allclose(grey, rgb, rtol=1e-5)


def one_parameter(renderer: DifferentiableRenderer, poses: CameraPoses, name: str, value: Any) -> Any:
    return renderer.luma(poses, {name: value})


def functions(renderer: DifferentiableRenderer) -> dict[str, tuple[Any, Function, float]]:
    """For each quantity its value, luma as a function of it, and a step for differences."""
    start = renderer.parameters
    poses, one = CameraPoses.at([POSE, OTHER]), CameraPoses.at([POSE])
    quaternions = np.stack([np.r_[pose.position, pose.quaternion] for pose in (POSE, OTHER)])
    points = np.random.RandomState(1).uniform(-0.05, 0.05, (5, 6))
    found: dict[str, tuple[Any, Function, float]] = {
        "poses": (np.full((2, 6), 0.01), lambda x: renderer.luma(poses.perturbed(x)), 2e-3),
        "quaternions": (quaternions, lambda x: renderer.luma(CameraPoses.from_quaternions(x)), 2e-3),
        "control points": (
            points,
            lambda x: renderer.luma(one.perturbed(spline(x, [0.1, 0.75, 1.0], duration_s=1.0))),
            3e-3,
        ),
    }
    for name, step in (
        ("lamp.intensity", 1.0),
        ("lamp.position", 1e-2),
        ("sun.irradiance", 0.3),
        ("sun.direction", 1e-2),
        ("sky.radiance", 0.1),
        ("floor.reflectance", 0.1),
    ):
        if name in start:
            found[name] = start[name].numpy(), partial(one_parameter, renderer, poses, name), step
    return found


def reverse(function: Function, value: Any, weights: FloatArray, mi: Any) -> FloatArray:
    """Gradient of sum(weights luma) by reverse mode."""
    import drjit as dr

    x = mi.TensorXf(np.array(value, np.float32))
    dr.enable_grad(x)
    dr.backward(dr.sum(function(x) * mi.TensorXf(weights.astype(np.float32)), axis=None))
    return np.array(dr.grad(x).numpy(), np.float64)


def forward(function: Function, value: Any, direction: FloatArray, mi: Any) -> FloatArray:
    """Derivative of luma along a direction by forward mode."""
    import drjit as dr

    x = mi.TensorXf(np.array(value, np.float32))
    dr.enable_grad(x)
    dr.set_grad(x, mi.TensorXf(direction.astype(np.float32)))
    return np.array(dr.forward_to(function(x)).numpy(), np.float64)


def differences(function: Function, value: Any, direction: FloatArray, step: float) -> FloatArray:
    """The same by central differences of fourth order."""
    at = {k: function(np.asarray(value) + k * step * direction).numpy().astype(np.float64) for k in (-2, -1, 1, 2)}
    return np.asarray((8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * step))


def directions(shape: tuple[int, ...]) -> FloatArray:
    """One direction for each of a few numbers, or two at random through many."""
    size = int(np.prod(shape))
    basis = np.eye(size) if size <= 14 else np.random.RandomState(2).uniform(-1, 1, (2, size))
    return np.asarray(basis.reshape(-1, *shape))


QUANTITIES = [
    *["poses", "floor.reflectance", "lamp.position", "sun.direction"],
    *long_values("quaternions", "control points", "lamp.intensity", "sun.irradiance", "sky.radiance"),
]


@pytest.mark.few(1)
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_derivatives_agree_with_differences(quantity: str, mi: Any) -> None:
    """Inside a smooth surface all three ways give one derivative: reverse, forward, differences of the same samples."""
    value, function, step = functions(DifferentiableRenderer(smooth_scene(), CAMERA))[quantity]
    weights = np.random.RandomState(5).uniform(0, 1, function(value).shape)
    gradient = reverse(function, value, weights, mi)
    assert gradient.any()
    scale = np.abs(gradient).max()
    modes, steps = [], []
    for direction in directions(gradient.shape):
        ahead = forward(function, value, direction, mi)
        around = differences(function, value, direction, step)
        modes.append(abs((weights * ahead).sum() - (gradient * direction).sum()) / scale)
        steps.append(np.linalg.norm(around - ahead) / np.linalg.norm(ahead))
    print(f"{quantity}: modes differ by {max(modes):.0e}, differences by {min(steps):.0e} to {max(steps):.0e}")
    assert max(modes) < 1e-5
    assert max(steps) < 1e-3


@pytest.mark.long
@pytest.mark.parametrize("quantity", ["poses", "sky.radiance", *long_values("lamp.position", "floor.reflectance")])
def test_both_modes_agree_at_edges_and_shadows(quantity: str, mi: Any) -> None:
    """Rays that hit nothing, or meet a shadow, disturb neither mode, and the background is the sky's."""
    renderer = DifferentiableRenderer(SCENES["edges, shadows and background"], CAMERA, blur=True)
    value, function, step = functions(renderer)[quantity]
    weights = np.random.RandomState(5).uniform(0, 1, function(value).shape)
    gradient = reverse(function, value, weights, mi)
    assert gradient.any()
    scale = np.abs(gradient).max()
    for direction in directions(gradient.shape):
        ahead = forward(function, value, direction, mi)
        assert (weights * ahead).sum() == pytest.approx((gradient * direction).sum(), rel=1e-4, abs=1e-6 * scale)
        if quantity in ("sky.radiance", "floor.reflectance"):  # luma is linear in them, edges or not
            around = differences(function, value, direction, step)
            np.testing.assert_allclose(ahead, around, atol=1e-4 * np.abs(ahead).max())


GREY = {name: {"type": "diffuse", "reflectance": value} for name, value in (("dark", 0.1), ("bright", 0.9))}
HALF_PLANE = {
    "sky": {"type": "constant", "radiance": 1.0},
    "floor": plane(9.0, GREY["dark"]),
    "tile": plane(4.0, GREY["bright"], x=4.0, z=0.5),
}


@pytest.mark.long
def test_an_edge_in_closed_form(mi: Any) -> None:
    """A bright half-plane covers more and more of a dark one: all of that change is the edge's. It is
    rows x fx / depth x contrast, brighter as the camera moves to the right; and none of it is there without edges.
    """
    above = CameraPoses.at([Pose([0.0, 0.0, 2.0], [1.0, 0.0, 0.0, 0.0])])
    right, ones = np.eye(6)[:1], np.ones((1, 18, 24))
    expected = 18 * 22.0 / 1.5 * (0.9 - 0.1)
    for blur in (False, True):
        for edges in (True, False):
            renderer = DifferentiableRenderer(
                scene(HALF_PLANE), Camera(24, 18, 22.0, 22.0, 11.5, 8.5), rays_per_pixel=64, blur=blur, edges=edges
            )

            def luma(x: Any, renderer: DifferentiableRenderer = renderer) -> Any:
                return renderer.luma(above.perturbed(x))

            back, ahead = reverse(luma, np.zeros((1, 6)), ones, mi), forward(luma, np.zeros((1, 6)), right, mi)
            if edges:
                assert back[0, 0] == pytest.approx(expected, rel=0.01)
                assert ahead.sum() == pytest.approx(expected, rel=0.01)
                assert not ahead[..., :10].any()

                def turned(x: Any, renderer: DifferentiableRenderer = renderer) -> Any:
                    return renderer.luma(CameraPoses(above.positions, above.perturbed(x).rotations))

                about_y = forward(turned, np.zeros((1, 6)), np.eye(6)[4:5], mi)
                assert about_y.sum() == pytest.approx(1.5 * expected, rel=0.01)
                assert ahead[0, :, 11] == pytest.approx(ahead[0, :, 12], rel=0.01)  # the edge is on their border
            else:
                assert not back.any()
                assert not ahead.any()


def finely(world: Scene, about: CameraPoses, **settings: Any) -> list[FloatArray]:
    """Derivatives along each increment, of two poses at once, by differences of frames of six times as many pixels,
    averaged. With 128 samples a pixel of these they err by 2 %."""
    times, step = 6, 2e-3
    fine = Camera(24 * times, 18 * times, 22.0 * times, 24.0 * times, 11.7 * times - 0.5, 9.4 * times - 0.5, k1=-0.1)
    renderer = DifferentiableRenderer(world, fine, rays_per_pixel=128, blur=False)
    found = []
    for increment in INCREMENTS:
        before, after = (renderer.luma(about.perturbed(k * step * increment), **settings).numpy() for k in (-1, 1))
        slope = (after.astype(np.float64) - before) / (2 * step)
        found.append(slope.reshape(2, 18, times, 24, times).mean((2, 4)))
    return found


def blurred(derivative: FloatArray) -> FloatArray:
    return blur_3x3(derivative.astype(np.float32)).astype(np.float64)


INCREMENTS = [np.eye(6)[[column] * 2] for column in range(6)]
EDGES = scene(
    {"lamp": LAMP, "sky": SKY, "floor": plane(0.8, GREY["bright"]), "tile": plane(0.3, GREY["dark"], z=0.4)},
    shadows=True,
)
"""Edges of a tile, of the floor and of a shadow."""


@pytest.fixture(scope="module")
def edges_by_differences(llvm: str) -> list[FloatArray]:
    with variant(llvm):
        return finely(EDGES, CameraPoses.at([POSE, OTHER]))


@pytest.mark.long
@pytest.mark.parametrize(
    ("rays_per_pixel", "blur", "bound"),
    [(16, False, 0.17), *long_values((256, False, 0.06), (256, True, 0.04))],
)
def test_derivatives_at_edges_agree_with_differences(
    rays_per_pixel: int, blur: bool, bound: float, edges_by_differences: list[FloatArray], mi: Any
) -> None:
    """Whole frames, two poses at once; and a sky and a lamp twice as bright make them twice as large."""
    about = CameraPoses.at([POSE, OTHER])
    renderer, plain = (
        DifferentiableRenderer(EDGES, CAMERA, rays_per_pixel=rays_per_pixel, blur=blur, edges=edges)
        for edges in (True, False)
    )

    def frames(of: DifferentiableRenderer, **parameters: Any) -> Function:
        return lambda increments: of.luma(about.perturbed(increments), parameters)

    for increment, exact in zip(INCREMENTS, edges_by_differences, strict=True):
        expected = blurred(exact) if blur else exact
        found, without = (forward(frames(of), np.zeros((2, 6)), increment, mi) for of in (renderer, plain))
        size = np.linalg.norm(expected)
        assert np.linalg.norm(found - expected) < bound * size
        assert np.linalg.norm(without - expected) > 0.3 * size
    twice = {"sky.radiance": [1.4], "lamp.intensity": 2 * plain.parameters["lamp.intensity"].numpy()}
    bright = forward(frames(renderer, **twice), np.zeros((2, 6)), increment, mi)
    assert bright == pytest.approx(2 * found, rel=1e-4, abs=1e-4 * np.abs(found).max())


@pytest.fixture
def moving_scene() -> Scene:
    """A tile that moves and turns above a floor, with a shadow, under a lamp that flickers."""
    source = {"lamp": LAMP, "sky": SKY, "floor": plane(0.8, bitmap(TEXELS)), "tile": plane(0.3, bitmap(TEXELS), z=0.4)}
    turn = Rotation.from_euler("zx", [0.9, 0.2]).as_quat()
    path = SegmentTrajectory(Pose([0, 0, 0.4], [0, 0, 0, 1]), Pose([0.4, -0.2, 0.5], turn), 1.0)
    world = scene(source, shadows=True, blur=True)
    return replace(world, objects={"tile": path}, lights={"lamp": Flicker(3.0, modulation=0.5)})


def test_frames_of_moving_scenes_are_the_table_renderers(moving_scene: Scene, mi: Any) -> None:
    renderer, times = DifferentiableRenderer(moving_scene, CAMERA), np.array([0.1, 0.7])
    expected = make_renderer(moving_scene, CAMERA, rays_per_pixel=4, kind="table").luma(
        Views.at_rest([POSE, OTHER], times)
    )
    about = CameraPoses.at([POSE, OTHER])
    np.testing.assert_allclose(renderer.luma(about, t_s=times).numpy(), expected, atol=1e-5, rtol=1e-5)
    one, other = (renderer.luma(about, t_s=t).numpy() for t in times)
    np.testing.assert_allclose(np.stack([one[0], other[1]]), expected, atol=1e-5, rtol=1e-5)
    assert np.abs(one - other).max() > 0.1


@pytest.mark.long
def test_derivatives_of_moving_scenes_agree_with_differences(moving_scene: Scene, mi: Any) -> None:
    """Edges, shadows and texels, at two times at once; and the strength of the lamp that flickers."""
    about, times = CameraPoses.at([POSE, OTHER]), np.array([0.1, 0.7])
    renderer = DifferentiableRenderer(moving_scene, CAMERA, rays_per_pixel=256)
    for increment, exact in zip(INCREMENTS, finely(moving_scene, about, t_s=times), strict=True):
        expected = blurred(exact)
        found = forward(lambda x: renderer.luma(about.perturbed(x), t_s=times), np.zeros((2, 6)), increment, mi)
        assert np.linalg.norm(found - expected) < 0.06 * np.linalg.norm(expected)

    def by_strength(x: Any) -> Any:
        return renderer.luma(about, {"lamp.intensity": x}, t_s=times)

    strength = renderer.parameters["lamp.intensity"].numpy()
    found = forward(by_strength, strength, np.ones(1), mi)
    expected = differences(by_strength, strength, np.ones(1), 2.0)  # luma is linear in it
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(found).max())
    assert found[0].max() != pytest.approx(found[1].max(), rel=0.05)


def test_edges_that_are_not_found_are_told(mi: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Here every second ray's edge is lost: half of the derivative is left out, and nothing is NaN."""
    whole = EdgePasses.passes

    def half(self: EdgePasses, ends: tuple[Views, Views], rays: ChangedRays) -> Passes:
        passes = whole(self, ends, rays)
        passes.fraction[::2] = np.nan
        return passes

    renderer = DifferentiableRenderer(scene(HALF_PLANE), Camera(24, 18, 22.0, 22.0, 11.5, 8.5), rays_per_pixel=64)
    above = CameraPoses.at([Pose([0.0, 0.0, 2.0], [1.0, 0.0, 0.0, 0.0])])
    monkeypatch.setattr(EdgePasses, "passes", half)
    with pytest.warns(UserWarning, match=r"derivatives leave out \d+\.\d% of the change at edges"):
        found = forward(lambda x: renderer.luma(above.perturbed(x)), np.zeros((1, 6)), np.eye(6)[:1], mi)
    assert found.sum() == pytest.approx(18 * 22.0 / 1.5 * (0.9 - 0.1) / 2, rel=0.1)


@pytest.mark.long
def test_shadows_of_moved_lights_have_no_edges(mi: Any) -> None:
    world = SCENES["edges, shadows and background"]
    place = {"lamp.position": [0.3, -0.5, 2.5]}
    about = CameraPoses.at([POSE])
    renderer, plain = (DifferentiableRenderer(world, CAMERA, edges=edges) for edges in (True, False))
    increments = mi.TensorXf(np.zeros((1, 6), np.float32))
    renderer.luma(about.perturbed(increments), place)  # needs no derivatives
    import drjit as dr

    dr.enable_grad(increments)
    plain.luma(about.perturbed(increments), place)
    renderer.luma(about.perturbed(increments), {"lamp.position": LAMP["position"]})
    with pytest.raises(ValueError, match=r"edges of shadows of the scene's own lights, so lamp\.position cannot"):
        renderer.luma(about.perturbed(increments), place)
    sunny = DifferentiableRenderer(scene({"sun": SUN, "floor": plane(0.8, GREY["dark"])}, shadows=True), CAMERA)
    sunny.luma(about.perturbed(increments), {"sun.direction": (2 * np.array(SUN["direction"])).tolist()})  # its own way
    with pytest.raises(ValueError, match=r"so sun\.direction cannot"):
        sunny.luma(about.perturbed(increments), {"sun.direction": [0.2, 0.4, -1.0]})


def test_batches_add_up(mi: Any) -> None:
    """Gradients of many poses may be gathered batch by batch, in the memory of one."""
    import drjit as dr

    renderer = DifferentiableRenderer(smooth_scene(), CAMERA)
    intensity = mi.TensorXf([20.0])
    dr.enable_grad(intensity)
    gradients = []
    for batches in ([[POSE, OTHER]], [[POSE], [OTHER]]):
        dr.set_grad(intensity, 0)
        for batch in batches:
            dr.backward(dr.sum(renderer.luma(CameraPoses.at(batch), {"lamp.intensity": intensity}), axis=None))
        gradients.append(float(dr.grad(intensity).array[0]))
    assert gradients[0] > 0
    assert gradients[1] == pytest.approx(gradients[0], rel=1e-5)


@pytest.mark.parametrize("angle", [0.0, 1e-4, 0.0316, 0.0317, 1.0, 3.1])
def test_increments_are_camera_axes_rotations(angle: float, mi: Any) -> None:
    """R exp(r), with exp SciPy's, on both sides of where the series ends; translations are the world's."""
    vector = angle * np.array([0.6, -0.48, 0.64])
    moved = CameraPoses.at([POSE]).perturbed(np.r_[0.1, 0.2, -0.3, vector][None])
    expected = POSE.rotation @ Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(np.array(moved.rotations.numpy())[..., 0], expected, atol=3e-7)
    np.testing.assert_allclose(moved.positions.numpy()[:, 0], np.add(POSE.position, (0.1, 0.2, -0.3)), atol=3e-7)


def test_quaternions_are_hamiltons(mi: Any) -> None:
    """(x, y, z, w), of any norm, as SciPy reads them: the transpose would differ."""
    poses = CameraPoses.from_quaternions(np.r_[POSE.position, 1.7 * POSE.quaternion][None])
    assert len(poses) == 1
    np.testing.assert_allclose(np.array(poses.rotations.numpy())[..., 0], POSE.rotation, atol=3e-7)


@pytest.mark.parametrize("degree", [1, 3])
def test_splines_are_scipys(degree: int, mi: Any) -> None:
    """From the first control point to the last, in between SciPy's B-spline; degree 1 is linear in time."""
    points = np.random.RandomState(4).uniform(-1, 1, (6, 2))
    times = np.linspace(0, 3.0, 11)
    inner = np.linspace(0, 3.0, 7 - degree)
    knots = np.r_[[0.0] * degree, inner, [3.0] * degree]
    values = spline(points, times, duration_s=3.0, degree=degree).numpy()
    np.testing.assert_allclose(values, BSpline(knots, points, degree)(times), atol=1e-6)
    np.testing.assert_allclose(values[[0, -1]], points[[0, -1]], atol=1e-6)


def test_the_users_variant_stays(mi: Any) -> None:
    """Frames and gradients may be asked for under any variant, which is the user's to choose."""
    renderer = DifferentiableRenderer(smooth_scene(), CAMERA)
    with variant(SCALAR) as (mitsuba, _):
        assert renderer.luma(CameraPoses.at([POSE]).perturbed(np.zeros((1, 6)))).shape == (1, 18, 24)
        assert mitsuba.variant() == SCALAR


def test_what_is_refused(mi: Any) -> None:
    """Each refusal names the rule and what was given."""
    mirror = {"floor": {"type": "rectangle", "bsdf": {"type": "conductor"}}, "lamp": LAMP}
    with pytest.raises(ValueError, match=r"cannot render this: shape 'floor' has a conductor surface"):
        DifferentiableRenderer(scene(mirror), CAMERA)
    plastic = {"floor": {"type": "rectangle", "bsdf": {"type": "plastic"}}, "lamp": LAMP}
    with pytest.raises(ValueError, match=r"has a plastic surface, not a diffuse one: --matte \(matte=True\) takes"):
        DifferentiableRenderer(scene(plastic), CAMERA)
    assert "floor.reflectance" in DifferentiableRenderer(replace(scene(plastic), matte=True), CAMERA).parameters
    flickering = DifferentiableRenderer(
        replace(smooth_scene(), lights={"lamp": Flicker(100.0, modulation=0.5)}), CAMERA
    )
    about = CameraPoses.at([POSE, OTHER])
    with pytest.raises(ValueError, match="t_s must say when each pose is taken, because lamp changes with time"):
        flickering.luma(about)
    with pytest.raises(ValueError, match=r"t_s of 2 poses must have shape \(2,\), got \(3,\)"):
        flickering.luma(about, t_s=[0.0, 0.1, 0.2])
    with pytest.raises(ValueError, match=r"rays_per_pixel .* 1\.\.1024, got 0"):
        DifferentiableRenderer(smooth_scene(), CAMERA, rays_per_pixel=0)
    renderer, poses = DifferentiableRenderer(smooth_scene(), CAMERA), CameraPoses.at([POSE, OTHER])
    for name, value, message in (
        ("wall.reflectance", 1.0, r"are floor.reflectance, .*sky.radiance, .*; got 'wall.reflectance'"),
        ("floor.reflectance", np.ones((2, 2)), r"shape \(64, 64, 3\) or \(64, 64\), got \(2, 2\)"),
        ("lamp.position", [1.0, 2.0], r"lamp.position must have shape \(3,\), got \(2,\)"),
        ("lamp.intensity", [1.0, 2.0], r"lamp.intensity must have shape \(1,\), got \(2,\)"),
    ):
        with pytest.raises(ValueError, match=message):
            renderer.luma(poses, {name: value})
    with pytest.raises(ValueError, match=r"shape \(n, 6\), got \(2, 7\)"):
        poses.perturbed(np.zeros((2, 7)))
    with pytest.raises(ValueError, match="increments of 2 poses must be as many rows, got 3"):
        poses.perturbed(np.zeros((3, 6)))
    with pytest.raises(ValueError, match=r"shape \(n, 7\)"):
        CameraPoses.from_quaternions(np.zeros(7))
    with pytest.raises(ValueError, match=r"\(m >= 4, k\), got \(3, 6\)"):
        spline(np.zeros((3, 6)), [0.0], duration_s=1.0)
    with pytest.raises(ValueError, match=r"0\.\.1.0 s, got \[1.5\]"):
        spline(np.zeros((4, 6)), [1.5], duration_s=1.0)


@pytest.mark.long
def test_torch_sees_a_function(mi: Any) -> None:
    """Through dr.wrap the frames belong to torch's graph; the gradient is Dr.Jit's own."""
    import drjit as dr

    torch = pytest.importorskip("torch")
    renderer = DifferentiableRenderer(smooth_scene(), CAMERA)
    poses = CameraPoses.at([POSE, OTHER])

    def luma(increments: Any) -> Any:
        return renderer.luma(poses.perturbed(increments))

    increments = torch.zeros((2, 6), requires_grad=True)
    dr.wrap(source="torch", target="drjit")(luma)(increments).sum().backward()
    expected = reverse(luma, np.zeros((2, 6)), np.ones((2, 18, 24)), mi)
    np.testing.assert_allclose(increments.grad.numpy(), expected, rtol=1e-4, atol=1e-4)


def example(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.long
def test_a_pose_is_recovered(mi: Any) -> None:
    """From 2 cm and 1 degree off, in a frame with occlusion edges, to less than a tenth of both."""
    errors = example("recover_pose").main(["--iterations", "3", "--rays-per-pixel", "4"])
    assert errors[0] == pytest.approx((0.02, 1.0), rel=1e-6)
    assert errors[-1][0] < 0.002
    assert errors[-1][1] < 0.1


@pytest.mark.long
def test_a_texture_is_recovered(mi: Any) -> None:
    """From uniform grey to less than a tenth of the error."""
    before, after = example("recover_texture").main(["--iterations", "60", "--frames", "4"])
    assert after < before / 10
