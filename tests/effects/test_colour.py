"""Colour filters: which pixel sees which light, on frames, events and their times, and full colour from a mosaic."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import davis_rs
from davis_rs import Camera, ColourFilter, Effects, FixedRate, MaxDisplacement, Scene, Simulator, Tolerance, demosaic
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.events.colour import PATTERNS, filter_numbers
from davis_rs.events.luma import LUMA_WEIGHTS
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.scene_cache import shared_scenes
from davis_rs.sampling.rules import TimeSampling
from davis_rs.sensor.parameters import SensorParameters
from davis_rs.sensor.presets import read_sensor_file, save_sensor
from davis_rs.simulation.settings import SimulatorSettings, resolve
from lit_scenes import DOWN, Parts, area, build, diffuse, environment, make_scene, plate
from long_form import long_values
from moving_scene import BOX, DIRECT, FLOOR, LAMP, PATH

CAMERA = Camera(41, 30, 33.0, 33.0, 20.0, 14.5)
LOOK = davis_rs.Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])
END = davis_rs.Pose([0.54, -0.88, 1.79], [0.965061, 0.0517277, -0.1125492, -0.2308985])
TRAJECTORY = davis_rs.SegmentTrajectory(LOOK, END, 0.05)
SCENE = Scene(
    "boxes", partial(dict, {"type": "scene", "by": DIRECT, "lamp": LAMP, "floor": FLOOR, "box": BOX}),
    objects={"box": PATH}, trajectory=TRAJECTORY,
)  # fmt: skip
FILTER = ColourFilter("GBRG", red=(0.8, 0.1, 0.0), green=(0.2, 0.7, 0.1), blue=(0.0, 0.1, 0.9))


def simulator(**settings: Any) -> Simulator:
    return Simulator(SCENE, **{"camera": CAMERA, "rays_per_pixel": 2, "contrast_threshold": 0.06, **settings})


def events_of(**settings: Any) -> EventArray:
    return concatenate_events([packet.events for packet in simulator(**settings).run()])


def of_weights(weights: tuple[float, float, float]) -> Any:
    return make_renderer(SCENE, CAMERA, rays_per_pixel=2, kind="native", weights=weights)


@pytest.mark.parametrize(
    ("pattern", "corner"),
    [("RGGB", [[0, 1], [1, 2]]), ("GRBG", [[1, 0], [2, 1]]), ("GBRG", [[1, 2], [0, 1]]), ("BGGR", [[2, 1], [1, 0]])],
)
def test_patterns_repeat_from_the_upper_left(pattern: str, corner: list[list[int]]) -> None:
    """Row by row, as libcaer's table has them; on odd sizes they are cut off."""
    numbers = filter_numbers(pattern, 5, 3)
    assert numbers.shape == (3, 5)
    for y in range(3):
        for x in range(5):
            assert numbers[y, x] == corner[y % 2][x % 2]


@pytest.mark.parametrize("optics", [{}, {"lens_blur_px": 0.7}])
@pytest.mark.parametrize("blur", [False, True])
def test_a_pixel_sees_its_filters_light(optics: dict[str, Any], blur: bool) -> None:
    """Luma, rates and single pixels are those of a renderer of its colour, blur and lens before the filter."""
    from davis_rs.sensor.effects import with_optics

    effects = Effects(**optics)
    made = simulator(colour_filter=FILTER, blur=blur, effects=effects).renderer
    views = Views.along(TRAJECTORY, [0.0, 0.03])
    numbers = filter_numbers("GBRG", 41, 30)
    lumas, rates = made.luma_and_rate(views)
    assert np.array_equal(made.luma(views), lumas)
    pixel = np.arange(0, 41 * 30, 7)
    samples = made.samples(views, np.ones_like(pixel), pixel)
    assert np.array_equal(samples, lumas[1].ravel()[pixel])
    for number, weights in enumerate(FILTER.weights):
        alone = make_renderer(SCENE, CAMERA, rays_per_pixel=2, kind="native", weights=weights, blur=blur)
        luma, rate = with_optics(alone, effects).luma_and_rate(views)
        own = numbers == number
        assert np.array_equal(lumas[:, own], luma[:, own])
        assert np.array_equal(rates[:, own], rate[:, own])
        assert not np.array_equal(lumas[:, ~own], luma[:, ~own])
    assert np.array_equal(made.depth(views), of_weights((1, 0, 0)).depth(views))
    assert np.array_equal(made.flow(views), of_weights((1, 0, 0)).flow(views), equal_nan=True)


def test_colours_are_told_apart_where_scenes_are_shared() -> None:
    """What is made of a scene and kept is that of its weights."""
    views = Views.along(TRAJECTORY, [0.01])
    alone = simulator(colour_filter=FILTER).renderer.luma(views)
    with shared_scenes():
        simulator()
        assert np.array_equal(simulator(colour_filter=FILTER).renderer.luma(views), alone)


def test_colours_add_up_to_luma() -> None:
    """Light is linear: the renders of red, green and blue, weighted, are luma."""
    views = Views.along(TRAJECTORY, [0.01])
    red, green, blue = (of_weights(tuple(row)).luma(views) for row in np.eye(3).tolist())  # type: ignore[arg-type]
    luma = make_renderer(SCENE, CAMERA, rays_per_pixel=2, kind="native").luma(views)
    assert np.allclose(0.299 * red + 0.587 * green + 0.114 * blue, luma, rtol=1e-5)
    assert np.abs(red - blue).mean() > 0.05 * luma.mean()


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("kind", ["table", "integrator"])
def test_all_renderers_have_colours(kind: str) -> None:
    views = Views.along(TRAJECTORY, [0.01])
    weights = (0.1, 0.2, 0.9)
    native = of_weights(weights).luma(views)
    other = make_renderer(SCENE, CAMERA, rays_per_pixel=2, kind=kind, weights=weights).luma(views)
    luma = make_renderer(SCENE, CAMERA, rays_per_pixel=2, kind=kind).luma(views)
    assert np.isclose(native, other, rtol=0.01).mean() > (0.97 if kind == "table" else 0.8)
    assert np.abs(luma - native).mean() > 0.05 * luma.mean()


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "sampling", [FixedRate(500), FixedRate(500, hermite=True), MaxDisplacement(0.3), Tolerance(0.3)]
)
def test_events_of_a_pixel_are_those_of_its_colour(sampling: TimeSampling) -> None:
    """Where all pixels have one filter, events are those of a scene in that light; a mosaic has each colour's own."""
    mosaic = events_of(colour_filter=FILTER, sampling=sampling, refine=False)
    numbers = filter_numbers("GBRG", 41, 30)
    assert len(mosaic) > 500
    for number, weights in enumerate(FILTER.weights):
        one = ColourFilter("RGGB", red=weights, green=weights, blue=weights)
        alone = events_of(colour_filter=one, sampling=sampling, refine=False)
        own = numbers[alone["y"], alone["x"]] == number
        mine = mosaic[numbers[mosaic["y"], mosaic["x"]] == number]
        if isinstance(sampling, Tolerance):  # keyframes follow all pixels of the image
            size = (41, 30)
            comparison = davis_rs.compare_events(mine, alone[own], size=size, window_us=2000)
            assert comparison.missing + comparison.spurious < 0.03 * own.sum()
        else:
            assert np.array_equal(mine, alone[own])
        assert own.sum() > 50


def test_without_filters_nothing_changes() -> None:
    """Not a byte, whatever way none is asked for."""
    plain = events_of()
    assert events_of(colour_filter="none").tobytes() == plain.tobytes()
    assert type(simulator(colour_filter="none").renderer) is type(simulator().renderer)
    assert events_of(colour_filter="RGGB").tobytes() != plain.tobytes()
    assert simulator().describe()["parameters"]["colour_filter"] is None
    described = simulator(colour_filter="rggb".upper()).describe()["parameters"]["colour_filter"]
    assert described == {"pattern": "RGGB", "red": (1, 0, 0), "green": (0, 1, 0), "blue": (0, 0, 1)}


def test_a_sensor_file_has_filters(tmp_path: Path) -> None:
    """Pattern and weights; a setting goes before the sensor's."""
    sensor = SensorParameters(colour_pattern="GBRG", colour_red="0.8 0.1 0", colour_blue="0 0.1 0.9")
    path = save_sensor(tmp_path / "colour.yaml", sensor, sources={"colour_red": "assumption"})
    read = read_sensor_file(path)
    assert read.parameters == sensor
    assert read.parameters.colour_filter() == ColourFilter("GBRG", red=(0.8, 0.1, 0), blue=(0, 0.1, 0.9))
    assert simulator(sensor=path).colour_filter == read.parameters.colour_filter()
    assert simulator(sensor=path, colour_filter="BGGR").colour_filter == ColourFilter("BGGR")
    assert simulator(sensor=path, colour_filter="none").colour_filter is None
    assert SensorParameters().colour_filter() is None


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"colour_pattern": "RGB"}, "colour_pattern must be one of RGGB, GRBG, GBRG, BGGR, got 'RGB'"),
        ({"colour_pattern": 3}, "colour_pattern must be one of"),
        ({"colour_red": "1 0 0"}, "colour_red needs a colour_pattern"),
        ({"colour_pattern": "RGGB", "colour_blue": "1 0"}, "colour_blue must be three weights >= 0, .*got '1 0'"),
        ({"colour_pattern": "RGGB", "colour_blue": "1 0 -1"}, "colour_blue must be three weights"),
        ({"colour_pattern": "RGGB", "colour_blue": "0 0 0"}, "colour_blue must be three weights"),
        ({"colour_pattern": "RGGB", "colour_blue": "1 0 nan"}, "colour_blue must be three weights"),
        ({"colour_pattern": "RGGB", "colour_green": 1.0}, "colour_green must be three weights"),
    ],
)
def test_filters_that_do_not_exist_are_refused(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SensorParameters(**parameters)


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ValueError, match="colour_filter must be one of none, RGGB"):
        simulator(colour_filter="CYGM")
    with pytest.raises(ValueError, match="colour_filter must be ColourFilter"):
        simulator(colour_filter=3)
    with pytest.raises(ValueError, match="colour filter must be three weights"):
        ColourFilter("RGGB", red=(1, 2))  # type: ignore[arg-type]


def test_a_callers_objects_move_in_all_colours() -> None:
    """One motion for the three renderers."""
    made = Simulator(
        replace(SCENE, objects={}).with_movable("box"), camera=CAMERA, rays_per_pixel=2, colour_filter="RGGB"
    )
    made.step(0, LOOK, objects={"box": PATH.pose(0.0)})
    [packet] = made.step(20_000, LOOK, objects={"box": PATH.pose(0.6)})[-1:]
    numbers = filter_numbers("RGGB", 41, 30)
    seen = np.bincount(numbers[packet.events["y"], packet.events["x"]], minlength=3)
    assert (seen > 20).all()


@pytest.mark.parametrize("pattern", PATTERNS)
def test_demosaicing_keeps_what_is_known_and_flat_colour(pattern: str) -> None:
    """A flat colour comes back everywhere, borders too; inside, a slope; what a pixel saw is never changed."""
    numbers = filter_numbers(pattern, 9, 7)
    colour = np.array([0.2, 0.5, 0.9], np.float32)
    assert np.allclose(demosaic(colour[numbers], pattern), colour, atol=1e-6)
    y, x = np.mgrid[:7, :9].astype(np.float32)
    slope = 0.1 * x - 0.05 * y + 1
    planes = colour[numbers] * slope
    full = demosaic(planes, pattern)
    assert np.array_equal(np.take_along_axis(full, numbers[..., None].astype(np.int64), 2)[..., 0], planes)
    assert np.allclose(full[1:-1, 1:-1], (colour * slope[..., None])[1:-1, 1:-1], atol=1e-5)
    for wrong in (np.zeros((3, 4, 3)), np.zeros((1, 9))):
        with pytest.raises(ValueError, match="a raw image must have shape"):
            demosaic(wrong)


def test_demosaiced_frames_are_those_of_colour_renders() -> None:
    """The packet's luma is raw; in full colour it is near the renders of all three."""
    [packet] = simulator(colour_filter="RGGB").step(0, LOOK)
    assert packet.luma is not None
    full = demosaic(packet.luma, "RGGB")
    views = Views.at_rest([LOOK])
    planes: list[npt.NDArray[np.float32]] = [of_weights(tuple(row)).luma(views)[0] for row in np.eye(3).tolist()]  # type: ignore[arg-type]
    true = np.stack(planes, -1)
    grey = np.repeat(packet.luma[..., None], 3, -1)
    assert np.abs(full - true).mean() < 0.5 * np.abs(grey - true).mean()


def test_resolved_settings_hold_the_filter() -> None:
    settings = SimulatorSettings(colour_filter=FILTER, camera=CAMERA)
    assert resolve(SCENE, settings).view.colour_filter is FILTER


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(
    "case", ["glossy under a map", *long_values("diffuse under a sky", "diffuse under a map", "glossy under a sky")]
)
def test_baked_light_has_the_colours_of_its_lights_and_surfaces(case: str) -> None:
    """Weights of luma are a sum of filters; what each filter passes is what the path tracer has through it.

    A lamp, a sky and an environment map are seen themselves, too.
    """
    metal = {"type": "conductor", "material": "Au"} if "glossy" in case else diffuse([0.7, 0.3, 0.2])
    sky: Parts = {"type": "constant", "radiance": {"type": "rgb", "value": [0.1, 0.2, 0.4]}}
    if "map" in case:
        by_height = np.stack([np.linspace(*ends, 32) for ends in ((0.3, 0.8), (0.5, 0.5), (0.6, 0.2))], axis=-1)
        sky = environment(np.repeat(by_height[:, None], 64, axis=1))
    radiance = area([3.0, 2.0, 0.5])
    scene = make_scene(
        lamp=plate(0.1, 0.2, 0.3, (0.2, 0.1)) | {"emitter": radiance},
        lamp_above=plate(-0.3, 0.1, 2.0, (0.2, 0.2), up=False) | {"emitter": radiance},
        floor=plate(0.1, 0, 0, (0.4, 0.5), diffuse([0.2, 0.6, 0.4])),
        plate=plate(-0.2, 0, 0.1, (0.3, 0.4), metal),
        sky=sky,
    )
    views = Views.at_rest([DOWN])
    with shared_scenes():
        luma = build(scene).luma(views)[0]
        planes = [build(scene, weights=weights).luma(views)[0] for weights in np.eye(3).tolist()]
    np.testing.assert_allclose(np.tensordot(LUMA_WEIGHTS, planes, 1), luma, rtol=1e-4, atol=1e-6)
    traced = [
        build(scene, kind="integrator", rays_per_pixel=256, weights=weights).luma(views)[0]
        for weights in (LUMA_WEIGHTS, *np.eye(3).tolist())
    ]
    for plane, of_paths in zip(planes, traced[1:], strict=True):
        assert plane.mean() == pytest.approx(of_paths.mean(), rel=0.05)
        # Where luma is off, because a coarse map is seen, colours are off alike.
        off = (plane / of_paths) / (luma / traced[0])
        assert np.quantile(np.abs(off - 1), 0.75) < 0.05
