"""Sampling by a tolerance: renders where they are needed, no more, and keeps its word on the error."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import (
    CallableTrajectory,
    CrossingEngine,
    MaxDisplacement,
    Pose,
    SegmentTrajectory,
    Simulator,
    Tolerance,
    compare_events,
    load_scene,
    log_intensity,
)
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.geometry.trajectory.trajectory import Trajectory
from davis_rs.render.choice import make_renderer
from davis_rs.sampling.displacement import DisplacementClock
from davis_rs.sampling.interpolate import interpolated
from davis_rs.sampling.keyframes import Keyframe, Stretch
from stretches import (
    CAMERA,
    DOWN,
    LOG_EPS,
    NARROW,
    TINY,
    built_in,
    dense,
    mirror,
    shift,
    sparse_count,
    stretch,
    times_of,
    wall,
)

FloatArray = npt.NDArray[np.float64]

pytestmark = pytest.mark.usefixtures("llvm")


def errors(keyframes: list[Keyframe], part: Stretch, share: float) -> FloatArray:
    """|interpolated - rendered| log luma, in contrast thresholds, of all pixels at a share of every interval."""
    times = times_of(keyframes)
    inside = np.unique((times[:-1] + share * np.diff(times)).astype(np.int64))
    inside = inside[~np.isin(inside, times)]
    found = [log for _, logs in interpolated(keyframes, inside, LOG_EPS) for log in logs]
    truth = [log_intensity(part.renderer.luma(part.views([t_us]))[0], LOG_EPS) for t_us in inside]
    return np.abs(np.array(found) - np.array(truth)) / part.contrast_threshold


def crossings(
    keyframes: list[Keyframe], *, interpolation: str = "hermite", sparse: bool = True, off: float = 0.15
) -> EventArray:
    """The engine's events of keyframes, with their sparse samples or without."""
    engine = CrossingEngine(
        CAMERA.width, CAMERA.height, contrast_threshold_off=off, log_eps=LOG_EPS, interpolation=interpolation
    )
    return concatenate_events(
        [engine.push(k.t_us, k.luma, k.rate, sparse=k.sparse if sparse else None) for k in keyframes]
    )


@pytest.mark.few(6)
@pytest.mark.parametrize("name", ["three_planes", "three_walls"])
@pytest.mark.parametrize("paired", [False, True], ids=["even", "paired"])
@pytest.mark.parametrize("contrast", [0.3, 0.1, 0.05])
def test_the_error_stays_below_the_tolerance(name: str, paired: bool, contrast: float) -> None:
    """At the middle of intervals and off it, in 95 % of all pixels, also where due instants lie 1 us apart.

    A pixel that has a sparse sample in the middle is right there by construction: off the middle it has no such help.
    """
    renderer, trajectory = built_in(name, NARROW)
    even = range(0, 100_001, 12_500)
    due = sorted({*even, *(t_us + 1 for t_us in even[:-1])} if paired else even)
    part = stretch(renderer, trajectory.crop(0, 0.1), due)
    keyframes = list(Tolerance(contrast).keyframes(part))
    for share in (0.5, 0.3):
        assert (errors(keyframes, part, share) <= contrast).mean() >= 0.95


def test_due_instants_side_by_side_do_not_hide_the_error() -> None:
    """A keyframe a microsecond away predicts its neighbour whatever happens: intervals are judged by others."""
    renderer, trajectory = built_in()
    even = range(0, 100_001, 25_000)
    rms = []
    for due in (even, sorted({*even, *(t_us + 1 for t_us in even[:-1])})):
        part = stretch(renderer, trajectory.crop(0, 0.1), due)
        rms.append(np.sqrt((errors(list(Tolerance(0.1).keyframes(part)), part, 0.3) ** 2).mean()))
    assert max(rms) < 0.1


@pytest.mark.long
def test_a_smaller_contrast_has_a_smaller_error() -> None:
    """What is asked for is what is got: root mean square and 99th percentile fall, and renders are spent on it."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory)
    runs = [list(Tolerance(contrast).keyframes(part)) for contrast in (1.0, 0.3, 0.1, 0.03)]
    found = [errors(keyframes, part, 0.3) for keyframes in runs]
    rms = [np.sqrt((error**2).mean()) for error in found]
    p99 = [np.percentile(error, 99) for error in found]
    for coarse, fine in [*pairwise(rms), *pairwise(p99)]:
        assert fine < 0.7 * coarse
    assert all(len(coarse) <= len(fine) for coarse, fine in pairwise(runs))
    assert len(runs[0]) < 0.3 * len(runs[-1])


def test_the_contrast_is_a_share_of_the_threshold() -> None:
    """Twice the threshold at half the contrast is the same tolerance, to the bit."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory.crop(0, 0.1), contrast_threshold=0.125)
    one = list(Tolerance(0.25).keyframes(part))
    other = list(Tolerance(0.125).keyframes(replace(part, contrast_threshold=0.25)))
    assert times_of(one).tolist() == times_of(other).tolist()
    assert sparse_count(one) == sparse_count(other) > 0


def test_sparse_samples_are_pixels_rendered_between_keyframes() -> None:
    """Sorted by pixel and time, within their interval, each pixel's middle first among them, luma of the renderer."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory.crop(0, 0.1))
    keyframes = list(Tolerance(0.1, edges=False).keyframes(part))
    assert sparse_count(keyframes) > 1000
    most = 0
    for last, new in pairwise(keyframes):
        if new.sparse is None or len(new.sparse.pixel) == 0:
            continue
        pixel, t_us, luma = new.sparse
        assert [column.dtype.name for column in new.sparse] == ["uint32", "int64", "float32"]
        assert np.all((t_us > last.t_us) & (t_us < new.t_us))
        keys = pixel.astype(np.int64) * 10**9 + t_us
        assert np.all(np.diff(keys) > 0)
        middle = t_us == (last.t_us + new.t_us) // 2
        assert np.array_equal(pixel[middle], np.unique(pixel))
        times, view = np.unique(t_us, return_inverse=True)
        assert np.array_equal(luma, renderer.samples(part.views(times), view, pixel))
        most = max(most, int(np.bincount(pixel).max()))
    assert 3 <= most <= 7  # three halvings


@pytest.mark.parametrize("halvings", [0, 1, 2])
def test_halvings_bound_the_samples_of_a_pixel(halvings: int) -> None:
    """2^halvings - 1 in an interval at the most; none at all for 0."""
    renderer, trajectory = built_in()
    keyframes = list(
        Tolerance(0.02, halvings=halvings, edges=False).keyframes(stretch(renderer, trajectory.crop(0, 0.05)))
    )
    counts = [np.bincount(k.sparse.pixel).max() for k in keyframes if k.sparse is not None and len(k.sparse.pixel)]
    assert max(counts, default=0) == 2**halvings - 1


@pytest.mark.long
def test_sparse_samples_make_event_times_better() -> None:
    """Against a dense reference, with the same keyframes: more events found, and their times nearer."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory.crop(0, 0.15))
    keyframes = list(Tolerance(0.05).keyframes(part))
    reference = crossings(dense(part), interpolation="linear")
    assert len(reference) > 2000
    with_samples, without = (
        compare_events(crossings(keyframes, sparse=sparse), reference, size=(CAMERA.width, CAMERA.height))
        for sparse in (True, False)
    )
    assert with_samples.median_us < 0.7 * without.median_us
    assert with_samples.p99_us < without.p99_us
    assert with_samples.missing + with_samples.spurious < 0.8 * (without.missing + without.spurious)


def test_the_simulator_feeds_the_engine_all_of_it() -> None:
    """Rates and sparse samples reach the engine, for the lesser threshold: its events are those of the keyframes."""
    renderer, trajectory = built_in()
    part = trajectory.crop(0, 0.1)
    simulator = Simulator(
        load_scene("three_planes").with_trajectory(part),
        camera=CAMERA,
        rays_per_pixel=8,
        sampling=Tolerance(0.05, edges=False),
        contrast_threshold_off=0.09,
        frame_rate_hz=0,
        depth_rate_hz=0,
    )
    found = concatenate_events([packet.events for packet in simulator.run()])
    keyframes = list(
        Tolerance(0.05, edges=False).keyframes(
            stretch(renderer, part, range(0, 100_001, 25_000), contrast_threshold=0.09)
        )
    )
    assert sparse_count(keyframes) > 1000
    assert found.tobytes() == crossings(keyframes, off=0.09).tobytes()


def test_a_camera_at_rest_is_rendered_when_something_is_due() -> None:
    """No events, no keyframes beyond the due ones, no sparse samples."""
    renderer, trajectory = built_in()
    pose = trajectory.pose(0.0)
    due = list(range(0, 500_001, 25_000))
    keyframes = list(Tolerance(0.01).keyframes(stretch(renderer, SegmentTrajectory(pose, pose, 0.5), due)))
    assert times_of(keyframes).tolist() == due
    assert sparse_count(keyframes) == 0
    assert len(crossings(keyframes)) == 0


def test_a_wall_without_texture_needs_no_more_than_the_clock() -> None:
    """Nothing to see: no sparse samples; keyframes start at ``pixels`` and grow apart up to ``longest``."""
    renderer = make_renderer(wall(), CAMERA, rays_per_pixel=4)
    part = stretch(renderer, shift([2.0, 0.4, 0.0], 0.5))
    settings = Tolerance(0.05, pixels=0.25, longest=0.8)
    keyframes = list(settings.keyframes(part))
    assert sparse_count(keyframes) == 0
    clock = DisplacementClock(renderer, part.trajectory, part.end_us)
    path = np.diff([clock.path_at(int(t_us)) for t_us in times_of(keyframes)])
    np.testing.assert_allclose(path[:7], 0.25, rtol=2e-2)
    assert path.max() == pytest.approx(0.8, rel=2e-2)
    assert len(keyframes) < 0.6 * path.sum() / 0.25


def test_texture_brings_keyframes_closer() -> None:
    """Where whole images cannot be trusted, intervals are halved, and the next ones start shorter."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory)
    clock = DisplacementClock(renderer, trajectory, part.end_us)
    path = np.diff([clock.path_at(int(t_us)) for t_us in times_of(list(Tolerance(0.02).keyframes(part)))])
    assert path[:20].max() <= 0.26
    assert path[-20:].max() < 0.2


@pytest.mark.parametrize("slow", [0.0, 0.4, 2.0])
def test_a_camera_that_takes_off_is_seen_from_its_first_pixel_on(slow: float) -> None:
    """However slow it was before: no two keyframes farther apart than the longest displacement."""
    renderer = make_renderer(wall(), CAMERA, rays_per_pixel=1)

    def x(t: FloatArray) -> FloatArray:
        return np.where(t < 0.5, slow * t, 0.5 * slow + 2.8 * (t - 0.5))

    trajectory = CallableTrajectory(
        0.65,
        position=lambda t: DOWN.position + np.outer(x(t), [1.0, 0.0, 0.0]),
        quaternion=lambda t: np.broadcast_to(DOWN.quaternion, (len(t), 4)),
        velocity=lambda t: np.outer(np.where(t < 0.5, slow, 2.8), [1.0, 0.0, 0.0]),
        angular_rate=lambda t: np.zeros((len(t), 3)),
        description={},
    )
    part = stretch(renderer, trajectory, range(0, 650_001, 25_000))
    times = times_of(list(Tolerance(1.0, pixels=0.5, longest=0.5).keyframes(part)))
    clock = DisplacementClock(renderer, trajectory, part.end_us)
    path = np.diff([clock.path_at(int(t_us)) for t_us in times])
    assert path.max() <= 0.51
    assert path.sum() > 4
    # No more of them either: each due instant may cut one interval in two.
    assert len(times) <= path.sum() / 0.5 + 27 + 1


def leap(trajectory: Trajectory) -> Trajectory:
    """Two metres within a millisecond, and then a slow walk."""
    start = trajectory.pose(0.0)

    def x(t: FloatArray) -> FloatArray:
        return np.where(t < 1e-3, 2000 * t, 2.0 + 0.1 * (t - 1e-3))

    return CallableTrajectory(
        0.5,
        position=lambda t: start.position + np.outer(x(t), [1.0, 0.0, 0.0]),
        quaternion=lambda t: np.broadcast_to(start.quaternion, (len(t), 4)),
        velocity=lambda t: np.outer(np.where(t < 1e-3, 2000.0, 0.1), [1.0, 0.0, 0.0]),
        angular_rate=lambda t: np.zeros((len(t), 3)),
        description={},
    )


def test_a_camera_that_leaps_costs_no_more_than_microseconds() -> None:
    """Intervals are split, to a microsecond at the most; what comes after the leap is not rendered as finely."""
    renderer, trajectory = built_in()
    part = stretch(renderer, leap(trajectory))
    asked = sum(t_us < 1000 for t_us in MaxDisplacement(0.5).instants(renderer, part.trajectory, 1000))
    times = times_of(list(Tolerance(0.1).keyframes(part)))
    assert np.all(np.diff(times) > 0)
    assert min(1.5 * asked, 1000) < (times <= 1000).sum() <= 1001
    assert (times > 2000).sum() < 500


@pytest.mark.long
def test_a_tolerance_below_all_noise_stays_affordable() -> None:
    """What nothing can satisfy does not bring keyframes ever closer: a displacement of pixels / 32, halved once."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory)
    path = DisplacementClock(renderer, trajectory, part.end_us).path_at(part.end_us)
    settings = Tolerance(1e-7, pixels=0.125, longest=0.125, halvings=0)
    found = sum(1 for _ in islice(settings.keyframes(part), 4000))
    assert 4 * path / 0.125 < found < 2 * path / (0.125 / 32)


@pytest.mark.parametrize("end_us", [2, 3, 10, 100])
def test_a_leap_within_microseconds(end_us: int) -> None:
    """No more instants than there are, whatever the tolerance asks for."""
    renderer, trajectory = built_in()
    part = stretch(renderer, shift([2.0, 0.0, 0.0], end_us * 1e-6, trajectory.pose(0.0)))
    keyframes = list(Tolerance(0.01, halvings=20).keyframes(part))
    assert times_of(keyframes).tolist() == list(range(end_us + 1))
    assert sparse_count(keyframes) == 0


def test_rays_that_miss() -> None:
    """Where nothing is seen a translation asks for nothing, and a rotation for its flow if the background may have a
    pattern; luma is black, rates zero."""
    renderer, mitsubas = (make_renderer(wall(), CAMERA, kind=kind, rays_per_pixel=2) for kind in ("auto", "integrator"))
    up = Pose([0.0, 0.0, 3.0], [0.0, 0.0, 0.0, 1.0])
    due = [0, 25_000, 50_000]
    translated = list(Tolerance(0.1).keyframes(stretch(renderer, shift([2.0, 0.0, 0.0], 0.05, up), due)))
    assert times_of(translated).tolist() == due
    turned = Pose(up.position, Rotation.from_rotvec([0.0, 0.3, 0.0]).as_quat())
    path = SegmentTrajectory(up, turned, 0.05)
    assert times_of(list(Tolerance(0.1).keyframes(stretch(renderer, path, due)))).tolist() == due
    rotated = list(Tolerance(0.1).keyframes(stretch(mitsubas, path, due)))
    assert len(rotated) > 8
    for keyframe in [*translated, *rotated]:
        assert np.all(keyframe.luma == 0)
        assert keyframe.rate is not None
        assert np.all(keyframe.rate == 0)
    assert sparse_count(rotated) == 0


def test_an_edge_to_nothing_is_sampled() -> None:
    """A bright floor that ends in black: its silhouette gets samples, the rest of the image none."""
    renderer = make_renderer(wall(left=0.3), CAMERA, rays_per_pixel=16)
    part = stretch(renderer, shift([0.3, 0.0, 0.0], 0.1))
    keyframes = list(Tolerance(0.05).keyframes(part))
    pixels = np.concatenate([k.sparse.pixel for k in keyframes if k.sparse is not None]) % CAMERA.width
    assert len(pixels) > 100
    # It passes from column 19.5 to 16.2.
    assert 15 <= pixels.min() <= pixels.max() <= 21
    assert (errors(keyframes, part, 0.3) <= 0.05).mean() > 0.95


def test_any_renderer_will_do() -> None:
    """A mirror, for Mitsuba's own integrator: the tolerance holds there too."""
    renderer = make_renderer(mirror(), TINY, rays_per_pixel=4, kind="integrator")
    assert "PathIntegrator" in renderer.name
    part = stretch(renderer, shift([0.15, 0.0, 0.0], 0.05))
    keyframes = list(Tolerance(0.1).keyframes(part))
    assert (errors(keyframes, part, 0.3) <= 0.1).mean() >= 0.95
    assert 3 <= len(keyframes) < 100


def test_memory_does_not_grow() -> None:
    """Keyframe after keyframe passes through a window of a few."""
    renderer = make_renderer(wall(), CAMERA, rays_per_pixel=1)
    part = stretch(renderer, shift([1.0, 0.0, 0.0], 0.2), range(0, 200_001, 4_000))
    used = []
    tracemalloc.start()
    for count, _ in enumerate(Tolerance(0.1, pixels=0.2, longest=0.2).keyframes(part)):
        if count in (20, 80):
            used.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert len(used) == 2
    frame = 4 * CAMERA.width * CAMERA.height
    assert used[1] - used[0] < 15 * frame


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"contrast": 0.0}, "contrast must be finite and > 0, got 0.0"),
        ({"contrast": float("nan")}, "contrast .* got nan"),
        ({"pixels": -1.0}, "pixels .* got -1.0"),
        ({"longest": float("inf")}, "longest .* got inf"),
        ({"halvings": -1}, "halvings must be an integer >= 0, got -1"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, float], message: str) -> None:
    """Each names its rule and value."""
    with pytest.raises(ValueError, match=message):
        Tolerance(**settings)  # type: ignore[arg-type]
