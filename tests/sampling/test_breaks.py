"""Causes that are sudden: no event comes before its cause, declared or not, and none the other way."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from davis_rs import CallableTrajectory, Camera, MaxDisplacement, Pose, Scene, Simulator, compare_events
from davis_rs.accuracy.brute_force import dense_probe, early
from davis_rs.accuracy.hard_case_scenes import CAUSE_S, START_S, room, sideways, starting, still, wires
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.geometry.pose import FloatArray
from davis_rs.geometry.trajectory.trajectory import Trajectory, align
from davis_rs.render.motion.scene_motion import STILL, SceneMotion
from davis_rs.sampling.breaks import break_instants, find_breaks
from davis_rs.sampling.displacement import LARGEST_BEND, DisplacementClock
from davis_rs.sampling.presets import ACCURACY
from davis_rs.scene.light_profile import Flicker, LightProfile, SampledProfile, ShiftedProfile

PRESETS = pytest.mark.parametrize("preset", list(ACCURACY))
CAUSE_US, START_US = round(CAUSE_S * 1e6), round(START_S * 1e6)
SMALL = Camera(16, 12, 120.0, 120.0, 7.5, 5.5)


class Undeclared(LightProfile):
    """Another profile that does not tell of its breaks, as one of a user's own may not."""

    def __init__(self, profile: LightProfile) -> None:
        self._profile = profile

    def factor(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._profile.factor(t_s)

    def rate(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._profile.rate(t_s)

    def describe(self) -> dict[str, object]:
        return {"kind": "undeclared"}


def jump(before: float, after: float) -> SampledProfile:
    """A light that changes within a microsecond."""
    return SampledProfile([CAUSE_S, CAUSE_S + 1e-6], [before, after])


def simulator(scene: Scene, preset: str, camera: Camera | None = None) -> Simulator:
    return Simulator(scene, accuracy=preset, frame_rate_hz=0, depth_rate_hz=0, camera=camera)


def events_of(made: Simulator) -> EventArray:
    return concatenate_events([packet.events for packet in made.run()])


def test_paths_know_their_breaks() -> None:
    """Those that are declared, wherever the path is moved or cut to; a smooth path has none."""
    path = starting()
    np.testing.assert_array_equal(path.breaks_s(), [START_S])
    np.testing.assert_allclose(path.crop(0.01, 0.015).breaks_s(), [START_S - 0.01])
    assert len(path.crop(0.0, 0.015).breaks_s()) == len(path.crop(0.02).breaks_s()) == 0
    np.testing.assert_array_equal(align(path, Pose([1, 2, 3], [0, 0, 0, 1])).breaks_s(), [START_S])
    assert len(still(1.0).breaks_s()) == 0


@pytest.mark.parametrize(
    ("breaks", "message"),
    [([0.0], "within"), ([0.2], "within"), ([np.nan], "within"), ([0.1, 0.1], "increase"), ([[0.1]], "shape")],
)
def test_breaks_that_cannot_be_are_refused(breaks: list[float], message: str) -> None:
    """Instants within the path, in order."""
    zero = {name: lambda t: np.zeros((len(t), 3)) for name in ("position", "velocity", "angular_rate")}
    with pytest.raises(ValueError, match=message):
        CallableTrajectory(
            0.2, **zero, quaternion=lambda t: np.tile([0.0, 0, 0, 1], (len(t), 1)), description={}, breaks_s=breaks
        )


def test_lights_know_their_breaks() -> None:
    """Edges, peaks and samples, at any phase, shifted or not."""
    square = Flicker(100.0, modulation=0.5, phase_rad=np.pi / 2, waveform="square")
    np.testing.assert_allclose(square.breaks_s(0.0, 0.011), [0.0025, 0.0075])
    triangle = Flicker(100.0, modulation=0.5, waveform="triangle")
    np.testing.assert_allclose(triangle.breaks_s(0.0, 0.011), [0.0025, 0.0075])
    assert len(Flicker(100.0, modulation=0.5).breaks_s(0.0, 1.0)) == 0
    assert len(Flicker(100.0, modulation=0.0, waveform="square").breaks_s(0.0, 1.0)) == 0
    np.testing.assert_allclose(ShiftedProfile(jump(1, 2), 0.01).breaks_s(0.0, 1.0), np.array([2300, 2301]) * 1e-6)
    assert len(ShiftedProfile(jump(1, 2), 0.02).breaks_s(0.0, 1.0)) == 0


@pytest.mark.parametrize("hertz", [100.0, 130.0, 37.3])
def test_each_jump_of_a_light_lies_within_its_microsecond(hertz: float) -> None:
    """At the start of a sequence and a day later, wherever rounding puts the edge."""
    square = Flicker(hertz, modulation=0.5, waveform="square")
    for start_us in (0, 86_400_000_000):
        found = list(find_breaks(still(2.5), SceneMotion({}, {"lamp": square}, {}), start_us, start_us + 2_500_000))
        assert len(found) == pytest.approx(5 * hertz, abs=1.01)
        before = np.array([item.before_us for item in found])
        assert np.all(np.diff(before) > 1)
        sides = start_us * 1e-6 + (before[:, None] + np.array([0, 1]) - start_us) * 1e-6
        factors = square.factor(sides.ravel()).reshape(sides.shape)
        np.testing.assert_allclose(np.abs(np.diff(factors, axis=1)), 1.0)
        assert all(item.jump for item in found)


def test_small_bends_of_a_profile_of_many_samples_are_left_to_the_displacement() -> None:
    """A sine in 2,000 samples a period has no breaks but its ends; the same in 8 samples has all of them."""
    for samples, expected in ((2000, 2), (8, 9)):
        t = np.linspace(0.001, 0.011, samples + 1)
        profile = SampledProfile(t, 1 + 0.5 * np.sin(2 * np.pi * t / 0.01))
        found = list(find_breaks(still(0.02), SceneMotion({}, {"lamp": profile}, {}), 0, 20_000))
        assert len(found) <= expected
        assert (samples == 2000) or len(found) >= expected - 2  # those where it is straight


def test_an_object_breaks_where_its_path_ends_in_motion() -> None:
    """From there on it stands still; one that has come to rest by itself has no break there."""
    box = [[-1, -1, -1], [1, 1, 1]]
    moving, resting = sideways(0.01, 1.0), still(0.01)
    for path, expected in ((moving, [9_999, 10_000]), (resting, [])):
        found = find_breaks(still(1.0), SceneMotion({"box": path}, {}, {"box": box}), 0, 1_000_000)
        assert list(break_instants(found, 0, both=True)) == expected


def test_a_path_that_leaps_has_a_jump() -> None:
    """Where the pose changes by more than its velocity explains there are keyframes on both sides for lines, too."""
    for leap, expected in ((0.0, [19_499]), (0.01, [19_499, 19_500])):
        found = find_breaks(leaping(leap, declared=True), STILL, 0, 30_000)
        assert list(break_instants(found, 0, both=False)) == expected


def leaping(leap_m: float, *, declared: bool) -> Trajectory:
    """At rest, but that it is elsewhere from one instant on."""
    start = still(1.0).pose(0.0)
    return CallableTrajectory(
        0.03,
        position=lambda t: start.position + np.where(t >= START_S, leap_m, 0.0)[:, None] * [1.0, 0.0, 0.0],
        velocity=lambda t: np.zeros((len(t), 3)),
        quaternion=lambda t: np.tile(start.quaternion, (len(t), 1)),
        angular_rate=lambda t: np.zeros((len(t), 3)),
        breaks_s=[START_S] if declared else [],
        description={},
    )


@PRESETS
@pytest.mark.parametrize("declared", [True, False], ids=["declared", "undeclared"])
@pytest.mark.usefixtures("llvm")
def test_no_event_before_a_start_from_rest(preset: str, declared: bool) -> None:
    """Not even one microsecond before: the span without motion ends where motion begins."""
    events = events_of(simulator(room(starting(declared=declared)), preset))
    assert len(events) > 1000
    assert events["t"].min() >= START_US


@PRESETS
@pytest.mark.parametrize("declared", [True, False], ids=["declared", "undeclared"])
@pytest.mark.parametrize(("before", "after"), [(1.0, 1e6), (0.0, 1.0), (0.0, 1e-3)])
@pytest.mark.usefixtures("llvm")
def test_light_that_jumps_makes_on_events_at_once(preset: str, declared: bool, before: float, after: float) -> None:
    """With a camera at rest all events are ON, within the microsecond of the jump."""
    profile = jump(before, after)
    events = events_of(simulator(room(still(0.024), profile if declared else Undeclared(profile)), preset))
    assert len(events) > 500
    assert np.all(events["p"] == 1)
    assert set(events["t"].tolist()) == {CAUSE_US + 1}


@pytest.mark.few(3)
@PRESETS
@pytest.mark.parametrize("declared", [True, False], ids=["declared", "undeclared"])
@pytest.mark.usefixtures("llvm")
def test_light_that_jumps_while_the_camera_moves(preset: str, declared: bool) -> None:
    """As many events as brute force finds, within 1 %, of each polarity within 1 % of all."""
    profile = jump(1.0, 1e6)
    made = simulator(room(sideways(0.024, 0.3), profile if declared else Undeclared(profile)), preset)
    events = events_of(made)
    probe = dense_probe(made.renderer, made.scene.path, step_us=100, contrast_threshold=0.15)
    for p in (0, 1):
        difference = np.count_nonzero(events["p"] == p) - np.count_nonzero(probe.events["p"] == p)
        assert abs(difference) < 0.01 * len(probe.events)


@PRESETS
@pytest.mark.usefixtures("llvm")
def test_a_square_flicker_is_as_by_brute_force(preset: str) -> None:
    """Its edges are instants: less than 0.5 % missing and spurious together, those of the slow motion included."""
    square = Flicker(130.0, modulation=0.5, phase_rad=0.3, waveform="square")
    made = simulator(room(sideways(0.024, 0.3), square), preset)
    events = events_of(made)
    probe = dense_probe(made.renderer, made.scene.path, step_us=50, contrast_threshold=0.15)
    compared = compare_events(events, probe.events, size=(32, 24), window_us=10_000)
    assert compared.missing_percent + compared.spurious_percent < 0.5


@PRESETS
@pytest.mark.usefixtures("llvm")
def test_a_probe_finds_what_nobody_declared(preset: str) -> None:
    """A camera that is elsewhere all at once, at rest before and after by its own account."""
    events = events_of(simulator(room(leaping(0.01, declared=False)), preset))
    assert len(events) > 100
    assert events["t"].min() > START_US - 100


@pytest.mark.parametrize("pixels", [1 / 3, 1.0])
@pytest.mark.usefixtures("llvm")
def test_displacement_grows_evenly_between_keyframes(pixels: float) -> None:
    """A smooth start from rest: within every span the path is a straight line within an eighth of the spacing."""
    start, way = still(1.0).pose(0.0), np.array([0.8, 0.6, 0.0])
    path = CallableTrajectory(
        0.05,
        position=lambda t: start.position + (300.0 * t**3)[:, None] * way,
        velocity=lambda t: (900.0 * t**2)[:, None] * way,
        quaternion=lambda t: np.tile(start.quaternion, (len(t), 1)),
        angular_rate=lambda t: np.zeros((len(t), 3)),
        description={},
    )
    renderer = simulator(room(path), "paper").renderer
    instants = list(MaxDisplacement(pixels).instants(renderer, path, 50_000))
    for before, after in pairwise([0, *instants]):
        t_us = np.arange(before, after + 1)
        clock = DisplacementClock(renderer, path, 50_000)
        moved = np.array([clock.path_at(int(t)) for t in t_us])
        line = np.interp(t_us, [before, after], moved[[0, -1]])
        assert np.abs(moved - line).max() <= LARGEST_BEND * pixels * 1.3
    # A few more than by displacement alone, at the start.
    alone = clock.path_at(50_000) / pixels
    assert alone < len(instants) < alone + 6


STEADY = SampledProfile([0.0, 1.0], [1.0, 1.0])


@st.composite
def motions(draw: st.DrawFn) -> Trajectory:
    """A rest, then straight pieces at speeds of their own, some at rest, declared or not."""
    pieces = draw(
        st.lists(st.tuples(st.integers(300, 7_000), st.sampled_from([3.0, -8.0, 0.3, 0.0])), min_size=1, max_size=3)
    )
    gaps, each = zip((draw(st.integers(300, 7_000)), 0.0), *pieces, strict=True)
    knots = np.cumsum([0, *gaps]) * 1e-6
    speeds = np.array(each)
    distances = np.concatenate([[0.0], np.cumsum(speeds * np.diff(knots))])
    start, way = still(1.0).pose(0.0), np.array([0.8, 0.6, 0.0])

    def piece(t: FloatArray) -> npt.NDArray[np.int64]:
        return np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(speeds) - 1)

    def distance(t: FloatArray) -> FloatArray:
        return np.asarray(distances[piece(t)] + speeds[piece(t)] * (t - knots[piece(t)]))

    return CallableTrajectory(
        knots[-1],
        position=lambda t: start.position + distance(t)[:, None] * way,
        velocity=lambda t: speeds[piece(t)][:, None] * way,
        quaternion=lambda t: np.tile(start.quaternion, (len(t), 1)),
        angular_rate=lambda t: np.zeros((len(t), 3)),
        breaks_s=knots[1:-1] if draw(st.booleans()) else [],
        description={},
    )


@st.composite
def lights(draw: st.DrawFn) -> LightProfile:
    """Steady, then steps within a microsecond, pulses and ramps, which it declares."""
    gaps = draw(st.lists(st.sampled_from([1, 40, 900, 5_000]), min_size=1, max_size=5))
    factors = draw(
        st.lists(st.sampled_from([0.0, 0.01, 1.0, 1.0, 5.0]), min_size=len(gaps) + 1, max_size=len(gaps) + 1)
    )
    first = draw(st.integers(200, 5_000))
    return SampledProfile(np.cumsum([first, *gaps]) * 1e-6, factors)


@pytest.mark.few(1)
@pytest.mark.parametrize("changing", ["motion", "light", "both"])
@given(data=st.data(), preset=st.sampled_from(["paper", "fast", "balanced"]))
@settings(max_examples=12)
@pytest.mark.usefixtures("llvm")
def test_no_event_before_the_first_change_of_its_pixel(changing: str, data: st.DataObject, preset: str) -> None:
    """Any piecewise motion, any course of light: events of a pixel begin after a dense probe sees its luma change."""
    rest = st.integers(1_000, 12_000).map(lambda us: still(us * 1e-6))
    motion = data.draw(rest if changing == "light" else motions())
    light = STEADY if changing == "motion" else data.draw(lights())
    step_us = 50
    made = simulator(floor(motion, light), preset)
    events = events_of(made)
    probe = dense_probe(made.renderer, made.scene.path, step_us=step_us, contrast_threshold=0.15)
    assert early(events, probe, by_us=0) == 0


def floor(motion: Trajectory, light: LightProfile) -> Scene:
    """The floor alone: without edges, a pixel's luma changes as soon as the camera moves."""
    whole = room(motion, light, camera=SMALL)
    parts = whole.source()
    assert isinstance(parts, dict)
    return replace(whole, source=lambda: {name: part for name, part in parts.items() if name != "box"})


@pytest.mark.long
@pytest.mark.parametrize("shadows", [pytest.param(True, marks=pytest.mark.long), False], ids=["shadows", "no-shadows"])
@pytest.mark.usefixtures("llvm")
def test_wires_thinner_than_a_pixel(shadows: bool) -> None:
    """The preset exact has the events of wires of 0.3 to 1 pixel and of their shadows, but for a few of some
    microseconds, and knows when they are."""
    made = simulator(wires(sideways(0.006, 1.0), shadows=shadows), "exact")
    events = events_of(made)
    probe = dense_probe(made.renderer, made.scene.path, step_us=1, contrast_threshold=0.15)
    compared = compare_events(events, probe.events, size=(32, 24), window_us=8_000)
    assert compared.missing_percent + compared.spurious_percent < 1
    assert compared.median_us <= 8
    assert compared.p99_us <= 150
