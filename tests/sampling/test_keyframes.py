"""Keyframes: what every rule of sampling hands on, and the formulas that run through them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs import FixedRate, MaxDisplacement, Tolerance
from davis_rs.events.luma import LumaFrames
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Launched
from davis_rs.sampling.keyframes import Keyframe, lagrange_weights, slope
from davis_rs.sampling.rules import TimeSampling
from stretches import LOG_EPS, built_in, shift, stretch, times_of

SAMPLINGS = pytest.mark.parametrize(
    "sampling",
    [FixedRate(700.0), FixedRate(700.0, hermite=True), MaxDisplacement(0.2, hermite=True), Tolerance(0.1, pixels=0.1)],
    ids=["rate", "rate-hermite", "displacement-hermite", "tolerance"],
)
GAPS = st.lists(st.integers(1, 40_000), min_size=1, max_size=8)
COEFFICIENTS = st.lists(st.floats(-2, 2), min_size=4, max_size=4)


@given(gaps=GAPS, start_us=st.integers(0, 10**9), coefficients=COEFFICIENTS)
def test_slopes_of_parabolas_are_exact(gaps: list[int], start_us: int, coefficients: list[float]) -> None:
    """At any spacing: inside the parabola's own derivative, at both ends the chord's slope; in float32."""
    t_us = np.cumsum([start_us, *gaps])
    t = (t_us - start_us) / 40_000
    a, b, c, _ = coefficients
    values = a + b * t + c * t**2
    frames = values.astype(np.float32)[:, None, None]
    found = np.array([slope(t_us.tolist(), list(frames), k)[0, 0] for k in range(len(t_us))])
    expected = b + 2 * c * t
    expected[0], expected[-1] = np.diff(values)[0] / np.diff(t)[0], np.diff(values)[-1] / np.diff(t)[-1]
    # Rounding of the values, over the shorter of the two gaps next to each instant.
    gap = np.array(gaps) / 40_000
    rounding = 3e-7 * np.abs(values).max() / np.minimum(np.append(gap, gap[-1]), np.insert(gap, 0, gap[0]))
    assert np.all(np.abs(found / 25.0 - expected) <= rounding + 1e-6 * (1 + np.abs(expected)))


@given(
    ticks=st.lists(st.integers(-50, 50), min_size=4, max_size=6, unique=True),
    at=st.integers(-50, 50),
    coefficients=COEFFICIENTS,
)
def test_lagrange_weights_are_exact_for_cubics(ticks: list[int], at: int, coefficients: list[float]) -> None:
    """Any four instants or more, in any order: the weighted samples are the cubic's value, within and beyond."""
    t = np.array(ticks) / 50
    weights = lagrange_weights(t, at / 50)
    assert weights.shape == t.shape
    assert weights.sum() == pytest.approx(1, abs=1e-13 * np.abs(weights).sum() * 100)
    cubic = np.polynomial.Polynomial(coefficients)
    assert weights @ cubic(t) == pytest.approx(cubic(at / 50), abs=1e-12 * (1 + np.abs(weights).sum()))


def test_a_sample_at_its_own_instant_has_all_the_weight() -> None:
    """Interpolation goes through the samples; a single sample is a constant."""
    np.testing.assert_array_equal(lagrange_weights(np.array([-2.0, 0.0, 1.0]), 0.0), [0, 1, 0])
    np.testing.assert_array_equal(lagrange_weights(np.array([3.0]), 0.0), [1])


@SAMPLINGS
@pytest.mark.usefixtures("llvm")
def test_all_due_instants_are_keyframes_in_order(sampling: TimeSampling) -> None:
    """Strictly increasing, the start where nothing lies before it, the end, and neighbours one microsecond apart."""
    renderer, trajectory = built_in()
    due = [0, 1, 7_001, 25_000, 25_001, 59_999, 60_000]
    keyframes = list(sampling.keyframes(stretch(renderer, trajectory.crop(0, 0.06), due)))
    times = times_of(keyframes)
    assert np.all(np.diff(times) > 0)
    assert set(due) <= set(times.tolist())
    assert (times[0], times[-1]) == (0, 60_000)
    assert len(times) > len(due) + 3
    hermite = sampling.interpolation == "hermite"
    for keyframe in keyframes:
        assert keyframe.luma.shape == (30, 40)
        assert keyframe.luma.dtype == np.float32
        assert (keyframe.rate is not None) == hermite
    assert keyframes[0].sparse is None


@SAMPLINGS
@pytest.mark.usefixtures("llvm")
def test_keyframes_show_the_scene_at_their_time(sampling: TimeSampling) -> None:
    """Also where a stretch starts late in the sequence: luma is that of the trajectory, counted from its start."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory.crop(0, 0.02), start_us=7_000_000, due=[7_011_000, 7_020_000], first=False)
    keyframes = list(sampling.keyframes(part))
    times = times_of(keyframes)
    assert times[0] > 7_000_000
    assert {7_011_000, 7_020_000} <= set(times.tolist())
    luma = renderer.luma(Views.along(trajectory, (times - 7_000_000) * 1e-6))
    np.testing.assert_array_equal([keyframe.luma for keyframe in keyframes], luma)


@SAMPLINGS
@pytest.mark.usefixtures("llvm")
def test_batches_do_not_change_a_bit(sampling: TimeSampling) -> None:
    """How many keyframes are rendered in one call is a matter of speed alone."""
    renderer, trajectory = built_in()
    streams = []
    for batch in (1, 3, 64):
        part = stretch(renderer, trajectory.crop(0, 0.1), range(0, 100_001, 12_500), batch=batch)
        streams.append(list(sampling.keyframes(part)))
    assert len({len(stream) for stream in streams}) == 1
    for one, *others in zip(*streams, strict=True):
        for other in others:
            assert one.t_us == other.t_us
            assert one.luma.tobytes() == other.luma.tobytes()
            if one.rate is not None and other.rate is not None:
                assert one.rate.tobytes() == other.rate.tobytes()
            assert (one.sparse is None) == (other.sparse is None)
            if one.sparse is not None and other.sparse is not None:
                assert [a.tobytes() for a in one.sparse] == [b.tobytes() for b in other.sparse]


@SAMPLINGS
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.usefixtures("llvm")
def test_a_stretch_of_a_microsecond(sampling: TimeSampling, first: bool) -> None:
    """The shortest step of a controller: its end, and its start where nothing lies before it."""
    renderer, _ = built_in()
    path = shift([0.2, 0.0, 0.0], 1e-6)
    due = [5, 6] if first else [6]
    keyframes = list(sampling.keyframes(stretch(renderer, path, due, start_us=5, first=first)))
    assert times_of(keyframes).tolist() == due
    assert all(keyframe.sparse is None or len(keyframe.sparse.pixel) == 0 for keyframe in keyframes)


@SAMPLINGS
@pytest.mark.usefixtures("llvm")
def test_a_stretch_of_its_start_alone(sampling: TimeSampling) -> None:
    """The first step of a controller sets the references and takes no time."""
    renderer, trajectory = built_in()
    part = stretch(renderer, trajectory, [0])
    (keyframe,) = sampling.keyframes(replace(part, end_us=0))
    assert keyframe.t_us == 0
    np.testing.assert_array_equal(keyframe.luma, renderer.luma(Views.at_rest([trajectory.pose(0.0)]))[0])
    assert keyframe.rate is None or np.isfinite(keyframe.rate).all()


@pytest.mark.usefixtures("llvm")
def test_rates_of_keyframes_are_those_of_luma() -> None:
    """A tolerance's rates come from its neighbours: near the renderer's own, and in luma, not log luma, per second."""
    renderer, trajectory = built_in("three_walls")
    part = stretch(renderer, trajectory.crop(0, 0.02), range(0, 20_001, 250))
    own = list(Tolerance(10.0, pixels=100, longest=100).keyframes(part))
    assert len(own) == 81
    for before, keyframe, after in zip(own, own[1:], own[2:], strict=False):
        assert keyframe.rate is not None
        central = (after.luma - before.luma) / 500e-6
        scale = np.abs(central).max()
        # The slope of log luma times luma + eps, at the middle of two equal gaps: the central difference of the logs.
        logs = [np.log(frame.luma.astype(np.float64) + LOG_EPS) for frame in (before, after)]
        expected = (logs[1] - logs[0]) / 500e-6 * (keyframe.luma + LOG_EPS)
        np.testing.assert_allclose(keyframe.rate, expected, atol=2e-3 * scale)


@pytest.mark.parametrize(
    ("seconds", "asked"),
    [(0.001, [1, 4, 16, 16, 16, 8]), (0.4, [1, 4, 12, 12]), (60.0, [1, 1, 1, 1])],
    ids=["fast", "slow", "very slow"],
)
def test_a_call_of_the_renderer_takes_about_five_seconds(
    monkeypatch: pytest.MonkeyPatch, seconds: float, asked: list[int]
) -> None:
    """So that a run of slow views soon tells how far it is, and soon ends after Ctrl-C; fast ones go by the batch."""
    renderer, trajectory = built_in()
    now, counts, begin_luma = [5.0], [], renderer.begin_luma

    def begun(views: Views) -> Launched:
        counts.append(len(views))
        now[0] += seconds * len(views)
        return begin_luma(views)

    monkeypatch.setattr("davis_rs.sampling.rules.time.monotonic", lambda: now[0])
    monkeypatch.setattr(renderer, "begin_luma", begun)
    keyframes = list(FixedRate(1000.0).keyframes(stretch(renderer, trajectory.crop(0, 0.06), batch=16)))
    assert counts[: len(asked)] == asked
    assert sum(counts) == len(keyframes) == 61


def test_slow_views_are_rendered_one_by_one_between_decisions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between them a run is asked whether anybody wants more; fast views are rendered together, with the same bits."""
    renderer, trajectory = built_in()
    now, counts, luma = [5.0], [], renderer.luma

    def keyframes(seconds: float) -> list[Keyframe]:
        def slow(views: Views) -> LumaFrames:
            counts.append(len(views))
            now[0] += seconds * len(views)
            return luma(views)

        counts.clear()
        monkeypatch.setattr(renderer, "luma", slow)
        return list(Tolerance(0.5, pixels=0.02, longest=0.02).keyframes(stretch(renderer, trajectory.crop(0, 0.06))))

    monkeypatch.setattr("davis_rs.sampling.tolerance.time.monotonic", lambda: now[0])
    one_by_one = keyframes(60.0)
    assert set(counts) == {1}
    assert len(counts) >= 16
    together = keyframes(0.001)
    assert max(counts) == 8
    assert [keyframe.t_us for keyframe in together] == [keyframe.t_us for keyframe in one_by_one]
    assert all(np.array_equal(a.luma, b.luma) for a, b in zip(together, one_by_one, strict=True))
