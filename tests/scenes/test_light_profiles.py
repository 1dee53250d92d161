"""Lights whose strength runs a profile: profiles themselves, frames, exact rates, the clock, and events."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs import Camera, FixedRate, MaxDisplacement, Pose, Scene, SegmentTrajectory, simulate
from davis_rs._mitsuba.variants import FAST, SCALAR, load_scene_source, variant
from davis_rs.events.arrays import concatenate_events
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.integrator.scalar import ScalarRenderer
from davis_rs.render.motion.scene_updates import scene_motion
from davis_rs.sampling.displacement import DARKEST, LIGHT_PER_PIXEL, DisplacementClock
from davis_rs.scene.light_profile import Flicker, LightProfile, SampledProfile

FloatArray = npt.NDArray[np.float64]

CAMERA = Camera(12, 9, 10.0, 11.0, 5.3, 4.2, k1=-0.1)
# Looks at the origin, rolled by 0.4 rad.
POSE = Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])
TEXELS = np.random.RandomState(3).random_sample((9, 16, 3)).astype(np.float32)
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
LAMP = {"type": "point", "position": [0.4, -0.5, 2.5], "intensity": {"type": "rgb", "value": [9.0, 20.0, 4.0]}}
SUN = {"type": "directional", "direction": [0.2, 0.3, -1.0], "irradiance": 3.0}
SKY = {"type": "constant", "radiance": 0.7}
PANEL = {
    "type": "rectangle",
    "to_world": np.diag([0.3, 0.3, -1.0, 1.0]) + np.pad([[0.1], [0.2], [1.5]], ((0, 1), (3, 0))),
    "emitter": {"type": "area", "radiance": 4.0},
}
BITMAP = {"type": "bitmap", "raw": True, "data": TEXELS}
FLOOR = {
    "type": "rectangle",
    "to_world": np.diag([4.0, 4.0, 1.0, 1.0]),
    "bsdf": {"type": "twosided", "inner": {"type": "diffuse", "reflectance": BITMAP}},
}
PROFILES: list[LightProfile] = [
    Flicker(100.0, modulation=0.6, phase_rad=0.4),
    Flicker(70.0, modulation=1.0, waveform="triangle"),
    SampledProfile([0.0, 0.004, 0.01], [1.0, 0.2, 3.0]),
    SampledProfile([0.0, 0.004, 0.007, 0.01], [0.0, 0.0, 3.0, 1.0], interpolation="cubic"),
]


def make_scene(lights: dict[str, LightProfile], **parts: dict[str, Any]) -> Scene:
    return Scene("test", partial(dict, {"type": "scene", "by": DIRECT, **parts}), lights=lights)


def build(kind: str, scene: Scene, request: pytest.FixtureRequest, *, rays_per_pixel: int = 2) -> Renderer:
    if kind in ("table", FAST):
        request.getfixturevalue("llvm")
    if kind in ("native", "table"):
        return make_renderer(scene, CAMERA, rays_per_pixel=rays_per_pixel, kind=kind)
    with variant(kind) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        motion = scene_motion(scene, loaded, mi)
    make = IntegratorRenderer if kind == FAST else ScalarRenderer
    return make(loaded, CAMERA, rays_per_pixel=rays_per_pixel, blur=False, seed=3, reason="", motion=motion)


TABLES = ("native", "table")
every_renderer = pytest.mark.parametrize("kind", [*TABLES, FAST, SCALAR])


@pytest.mark.parametrize("profile", PROFILES, ids=lambda one: type(one).__name__)
def test_rates_are_the_slopes_of_factors(profile: LightProfile) -> None:
    """The rate is what the factor's difference quotient tends to, wherever no bend lies between."""
    t = np.linspace(-0.003, 0.014, 400) + 1.3e-6
    before, now, after = (profile.factor(t + step) for step in (-1e-8, 0.0, 1e-8))
    slope = (after - before) / 2e-8
    smooth = np.abs(after - 2 * now + before) < 1e-9
    assert smooth.mean() > 0.9
    np.testing.assert_allclose(profile.rate(t)[smooth], slope[smooth], rtol=1e-5, atol=1e-3)
    assert (now >= 0).all()


def test_flicker_by_hand() -> None:
    """A sine, a triangle and a square of one period each at its quarters, and a phase that moves them."""
    quarters = np.arange(8) / 4 * 0.01 + 1e-9
    for waveform, wave in (("sine", [0, 1, 0, -1]), ("triangle", [0, 1, 0, -1]), ("square", [1, 1, -1, -1])):
        profile = Flicker(100.0, modulation=0.5, waveform=waveform)
        np.testing.assert_allclose(profile.factor(quarters), 1 + 0.5 * np.tile(wave, 2), atol=1e-6)
        later = Flicker(100.0, modulation=0.5, phase_rad=np.pi / 2, waveform=waveform)
        np.testing.assert_allclose(later.factor(quarters - 0.0025), profile.factor(quarters), atol=1e-6)
    assert (Flicker(50.0, modulation=1.0, waveform="square").rate(quarters) == 0).all()
    assert Flicker(100.0, modulation=0.5).describe() == {
        "kind": "flicker",
        "frequency_hz": 100.0,
        "modulation": 0.5,
        "phase_rad": 0.0,
        "waveform": "sine",
    }


@given(
    factors=st.lists(st.floats(0.0, 50.0), min_size=2, max_size=8),
    interpolation=st.sampled_from(["linear", "cubic"]),
)
def test_sampled_profiles_go_through_their_factors(factors: list[float], interpolation: str) -> None:
    """At its times a profile has its factors; between them it stays within their neighbours, outside it is held."""
    t = np.arange(len(factors)) * 0.1
    profile = SampledProfile(t, factors, interpolation=interpolation)
    np.testing.assert_allclose(profile.factor(t), factors, atol=1e-9)
    np.testing.assert_allclose(profile.factor([-5.0, t[-1] + 3.0]), [factors[0], factors[-1]], atol=1e-9)
    assert (profile.rate([-5.0, -1e-9, t[-1], t[-1] + 3.0]) == 0).all()
    for i in range(len(factors) - 1):
        between = profile.factor(np.linspace(t[i], t[i + 1], 9))
        low, high = sorted(factors[i : i + 2])
        assert low - 1e-9 <= between.min()
        assert between.max() <= high + 1e-9


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (partial(Flicker, 0.0, modulation=0.5), r"> 0 Hz, got 0\.0"),
        (partial(Flicker, float("nan"), modulation=0.5), r"> 0 Hz, got nan"),
        (partial(Flicker, 50.0, modulation=1.1), r"0\.\.1, got 1\.1"),
        (partial(Flicker, 50.0, modulation=0.1, phase_rad=float("inf")), "phase_rad .* got inf"),
        (partial(Flicker, 50.0, modulation=0.1, waveform="saw"), "sine, triangle, square, got 'saw'"),
        (partial(SampledProfile, [0.0], [1.0]), r"n >= 2, got \(1,\) and \(1,\)"),
        (partial(SampledProfile, [0.0, 1.0], [1.0]), r"got \(2,\) and \(1,\)"),
        (partial(SampledProfile, [0.0, 0.0], [1.0, 1.0]), "strictly increasing"),
        (partial(SampledProfile, [0.0, 1.0], [1.0, -0.5]), r">= 0, got -0\.5"),
        (partial(SampledProfile, [0.0, 1.0], [1.0, float("nan")]), r">= 0, got nan"),
        (partial(SampledProfile, [0.0, 1.0], [1.0, 1.0], interpolation="step"), "linear, cubic, got 'step'"),
    ],
)
def test_bad_courses_are_refused(make: Any, message: str) -> None:
    """Each names its rule and value."""
    with pytest.raises(ValueError, match=message):
        make()


class Broken(LightProfile):
    """A profile that breaks its contract after 5 ms."""

    def factor(self, t_s: npt.ArrayLike) -> FloatArray:
        return np.where(np.asarray(t_s) < 0.005, 1.0, -2.0)

    def rate(self, t_s: npt.ArrayLike) -> FloatArray:
        return np.zeros(1)

    def describe(self) -> dict[str, object]:
        return {}


def test_a_course_that_breaks_its_contract_is_named(llvm: str) -> None:
    """A negative factor or a rate of another shape, with the light and the time, before it is rendered."""
    del llvm
    renderer = make_renderer(make_scene({"lamp": Broken()}, lamp=LAMP, floor=FLOOR), CAMERA, rays_per_pixel=1)
    with pytest.raises(ValueError, match=r"factor of light 'lamp' must be finite and >= 0, got -2\.0 at 0\.01 s"):
        renderer.motion.factors(np.array([0.0, 0.01]))
    with pytest.raises(ValueError, match=r"rate of light 'lamp' must have shape \(2,\), got \(1,\)"):
        renderer.luma_and_rate(Views.at_rest([POSE] * 2, [0.0, 0.001]))


@every_renderer
def test_frames_are_scaled(kind: str, request: pytest.FixtureRequest) -> None:
    """Under one light every pixel has the light's factor, exactly, and its rate; views of one launch have their own."""
    profile = Flicker(100.0, modulation=0.6, phase_rad=0.4)
    steady = build(kind, make_scene({}, lamp=LAMP, floor=FLOOR), request)
    flickering = build(kind, make_scene({"lamp": profile}, lamp=LAMP, floor=FLOOR), request)
    t_s = np.array([0.0, 0.0021, 0.0087, 0.0])
    views = Views.at_rest([POSE] * 4, t_s)
    base = steady.luma(views[:1])[0].astype(np.float64)
    assert base.min() > 0.01
    frames, rates = flickering.luma_and_rate(views)
    np.testing.assert_allclose(frames, base * profile.factor(t_s)[:, None, None], rtol=3e-6)
    exact = 1e-5 if kind in TABLES else 1e-3
    np.testing.assert_allclose(rates, base * profile.rate(t_s)[:, None, None], rtol=exact, atol=exact * 100)
    assert np.array_equal(frames[0], frames[3])
    pixels = np.array([3, 77, 30, 3, 107])
    of = np.array([2, 1, 0, 1, 3])
    assert np.array_equal(flickering.samples(views, of, pixels), frames.reshape(4, -1)[of, pixels])


@pytest.mark.few(1)
@every_renderer
def test_of_two_lights_one_flickers(kind: str, request: pytest.FixtureRequest) -> None:
    """Light adds up, background included: a steady sun and sky plus a lamp, or a lamp plus a dimmed sky."""
    t_s = np.array([0.002, 0.008])
    up = Pose([0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0])
    for name, profile in (("lamp", PROFILES[0]), ("sun", PROFILES[2]), ("sky", PROFILES[3])):
        lights: dict[str, dict[str, Any]] = {"lamp": LAMP, "sun": SUN, "sky": SKY}
        whole = build(kind, make_scene({name: profile}, floor=FLOOR, **lights), request)
        for pose in (POSE, up):
            views = Views.at_rest([pose] * 2, t_s)
            alone = {key: build(kind, make_scene({}, floor=FLOOR, **{key: lights[key]}), request) for key in lights}
            # Mitsuba picks one of three lights for a ray at random: the others add them all up.
            if kind not in TABLES and pose is POSE:
                continue
            sums = {key: renderer.luma(views).astype(np.float64) for key, renderer in alone.items()}
            factors = {key: profile.factor(t_s) if key == name else np.ones(2) for key in lights}
            expected = np.sum([sums[key] * factors[key][:, None, None] for key in lights], 0)
            frames, rates = whole.luma_and_rate(views)
            np.testing.assert_allclose(frames, expected, rtol=1e-5, atol=1e-7)
            slope = sums[name] * profile.rate(t_s)[:, None, None]
            exact = 1e-5 if kind in TABLES else 2e-3
            np.testing.assert_allclose(rates, slope, rtol=exact, atol=exact * max(1e-3, np.abs(slope).max()))


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("kind", TABLES)
def test_rates_of_light_and_camera_add_up(kind: str, request: pytest.FixtureRequest) -> None:
    """Product rule: with Y = f(t) S(t), the rate is f' S + f S', of a camera that moves under a lamp that flickers."""
    profile = PROFILES[0]
    still = Views.at_rest([POSE] * 2, [0.001, 0.006])
    views = Views(still.t_s, still.positions, still.rotations, still.positions * 0.1, still.positions * -0.2)
    steady, steady_rate = build(kind, make_scene({}, lamp=LAMP, floor=FLOOR), request).luma_and_rate(views)
    _, rate = build(kind, make_scene({"lamp": profile}, lamp=LAMP, floor=FLOOR), request).luma_and_rate(views)
    factor, slope = (values[:, None, None] for values in (profile.factor(still.t_s), profile.rate(still.t_s)))
    expected = slope * steady.astype(np.float64) + factor * steady_rate
    np.testing.assert_allclose(rate, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("kind", [FAST, SCALAR])
def test_an_area_light_flickers(kind: str, request: pytest.FixtureRequest) -> None:
    """A shape's own light is named shape.emitter; its noise scales with it, the same seed in every frame."""
    profile = Flicker(100.0, modulation=0.6)
    scene = make_scene({"panel.emitter": profile}, panel=PANEL, floor=FLOOR)
    frames = build(kind, scene, request).luma(Views.at_rest([POSE] * 2, [0.0, 0.0025]))
    assert frames[0].max() > 0.05
    np.testing.assert_allclose(frames[1], frames[0] * 1.6, rtol=1e-5)


@pytest.mark.parametrize(("kind", "name"), [("native", "moon"), ("table", "moon"), ("integrator", "floor")])
def test_an_unknown_light_is_refused(kind: str, name: str, llvm: str) -> None:
    """The message names the scene's lights."""
    del llvm
    scene = make_scene({name: PROFILES[0]}, lamp=LAMP, sky=SKY, floor=FLOOR)
    with pytest.raises(ValueError, match=f"has no light '{name}'; it has lamp, sky"):
        make_renderer(scene, CAMERA, kind=kind)


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("waveform", ["sine", "square"])
def test_the_clock_counts_light(waveform: str) -> None:
    """Before a camera at rest the path is the length that log strength goes, also of a light that goes dark."""
    profile = Flicker(100.0, modulation=1.0, phase_rad=0.3, waveform=waveform)
    renderer = make_renderer(make_scene({"lamp": profile}, lamp=LAMP, floor=FLOOR), CAMERA, rays_per_pixel=1)
    rest = SegmentTrajectory(POSE, POSE, 0.05)
    swing = np.log((2 + DARKEST) / DARKEST) / LIGHT_PER_PIXEL
    assert DisplacementClock(renderer, rest, 50_000).path_at(20_000) == pytest.approx(4 * swing, rel=0.02)
    instants = list(MaxDisplacement(1 / 3).instants(renderer, rest, 50_000))
    steps = np.abs(np.diff(np.log(profile.factor(np.array([0, *instants]) * 1e-6) + DARKEST)))
    if waveform == "square":  # both sides of each of ten jumps
        assert len(instants) == 20
        assert np.diff(instants)[::2].tolist() == [1] * 10
        np.testing.assert_allclose(steps[1::2], swing * LIGHT_PER_PIXEL)
    else:  # from instant to instant it changes by a third of LIGHT_PER_PIXEL
        assert len(instants) > 0.5 * 3 * 10 * swing
        assert np.quantile(steps, 0.9) < LIGHT_PER_PIXEL / 3 * 1.2


@pytest.mark.usefixtures("llvm")
def test_the_clock_of_a_later_stretch() -> None:
    """A stretch that starts later sees the light as it is then."""
    profile = SampledProfile([0.0, 0.02, 0.03], [1.0, 1.0, 2.0])
    renderer = make_renderer(make_scene({"lamp": profile}, lamp=LAMP, floor=FLOOR), CAMERA, rays_per_pixel=1)
    rest = SegmentTrajectory(POSE, POSE, 0.01)
    assert DisplacementClock(renderer, rest, 10_000).path_at(10_000) == 0
    later = DisplacementClock(renderer, rest, 10_000, start_us=20_000).path_at(10_000)
    assert later == pytest.approx(np.log((2 + DARKEST) / (1 + DARKEST)) / LIGHT_PER_PIXEL)


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("hermite", [False, True])
def test_a_flicker_makes_events_in_all_pixels_alike(hermite: bool) -> None:
    """Nothing moves: every pixel's log intensity goes up and down by the lamp's own, one event a threshold, at once."""
    profile = Flicker(25.0, modulation=0.8)
    scene = make_scene({"lamp": profile}, lamp=LAMP, floor=FLOOR)
    rest = SegmentTrajectory(POSE, POSE, 0.05)
    settings: dict[str, Any] = {"camera": CAMERA, "rays_per_pixel": 1, "log_eps": 1e-9, "contrast_threshold": 0.15}
    for sampling in (MaxDisplacement(1 / 3, hermite), FixedRate(2000.0, hermite)):
        packets = list(simulate(scene.with_trajectory(rest), sampling=sampling, **settings))
        events = concatenate_events([packet.events for packet in packets])
        counts = np.zeros((9, 12, 2), int)
        np.add.at(counts, (events["y"], events["x"], events["p"].astype(int)), 1)
        # By the fundamental definition: up from 1 to 1.8, down to 0.2, up to 1 and on to 1.8.
        up = int(np.log(1.8) / 0.15)
        level = up * 0.15
        down = int((level - np.log(0.2)) / 0.15)
        again = int((np.log(1.8) - (level - down * 0.15)) / 0.15)
        assert (counts[..., 0] == down).all()
        assert (np.abs(counts[..., 1] - up - again) <= 1).all()
        first = events[events["p"] == 1][: 9 * 12]
        expected = 1e6 * np.arcsin(np.expm1(0.15) / 0.8) / (2 * np.pi * 25)
        assert np.unique(first["y"].astype(int) * 12 + first["x"]).size == 9 * 12
        np.testing.assert_allclose(first["t"], expected, atol=150 if not hermite else 30)


@pytest.mark.usefixtures("llvm")
def test_without_courses_nothing_changes() -> None:
    """Empty mappings give the bits of a scene that has never heard of them."""
    views = Views.at_rest([POSE] * 2, [0.0, 0.3])
    plain = Scene("test", partial(dict, {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR}))
    frames = make_renderer(plain, CAMERA, rays_per_pixel=3).luma(views)
    assert np.array_equal(
        frames, make_renderer(make_scene({}, lamp=LAMP, floor=FLOOR), CAMERA, rays_per_pixel=3).luma(views)
    )
    assert np.array_equal(frames[0], frames[1])
