"""Working ahead in a thread: the same items, the same errors, and no thread that stays."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

import davis_rs
from davis_rs import Camera, FixedRate, MaxDisplacement, Simulator, Tolerance
from davis_rs._util.read_ahead import leave_if_unwanted, read_ahead
from davis_rs.events.arrays import concatenate_events
from davis_rs.sampling.keyframes import Keyframe, Stretch
from davis_rs.sampling.rules import TimeSampling

SMALL = Camera(40, 30, 33.0, 33.0, 19.5, 14.5)


def workers() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "davis_rs ahead"]


def test_items_come_in_order_and_no_more_wait_than_may() -> None:
    made: list[int] = []

    def items() -> Iterator[int]:
        for i in range(100):
            made.append(i)
            yield i

    for i, item in enumerate(read_ahead(items(), most=3)):
        assert item == i
        # Three wait, one is handed on, and one is being made.
        assert len(made) <= i + 6
        time.sleep(0.0005)
    assert made == list(range(100))
    assert not workers()


def test_an_item_that_nobody_wants_is_not_made_to_its_end() -> None:
    """Such as keyframes of slow views, after Ctrl-C; elsewhere than in its thread the check does nothing."""
    leave_if_unwanted()
    parts, closed = [], []

    def items() -> Iterator[int]:
        try:
            yield 0
            for part in range(1000):
                leave_if_unwanted()
                parts.append(part)
                time.sleep(0.01)
            yield 1
        finally:
            closed.append(True)

    ahead = read_ahead(items(), most=3)
    assert next(ahead) == 0
    ahead.close()  # type: ignore[attr-defined]
    assert len(parts) < 100
    assert closed
    assert not workers()


def test_an_error_comes_out_after_the_items_before_it() -> None:
    def items() -> Iterator[int]:
        yield 1
        yield 2
        raise OSError("the third is lost")

    seen = []
    with pytest.raises(OSError, match="the third is lost"):
        seen += list(read_ahead(items(), most=8))
    taken = read_ahead(items(), most=8)
    assert [next(taken), next(taken)] == [1, 2]
    with pytest.raises(OSError, match="the third is lost"):
        next(taken)
    assert not workers()


def test_who_stops_early_leaves_no_thread_and_no_open_generator() -> None:
    closed = []

    def items() -> Iterator[int]:
        try:
            yield from range(10**9)
        finally:
            closed.append(True)

    taken = read_ahead(items(), most=2)
    assert next(taken) == 0
    taken.close()  # type: ignore[attr-defined]  # a generator
    assert closed
    assert not workers()


class Recorded(TimeSampling):
    """A rule that notes the thread in which it is asked for keyframes, and may fail at one of them."""

    def __init__(self, rule: TimeSampling, fails_at: int | None = None) -> None:
        self.rule, self.fails_at, self.threads = rule, fails_at, set[str]()

    @property
    def interpolation(self) -> str:
        return self.rule.interpolation

    def keyframes(self, stretch: Stretch) -> Iterator[Keyframe]:
        for number, keyframe in enumerate(self.rule.keyframes(stretch)):
            self.threads.add(threading.current_thread().name)
            if number == self.fails_at:
                raise FloatingPointError("keyframe 3")
            yield keyframe


@pytest.mark.parametrize("rule", [MaxDisplacement(1 / 2), Tolerance(0.2)])
def test_rendering_ahead_changes_no_bit(rule: TimeSampling) -> None:
    """One thread renders in turn with the crossing engine, more threads at the same time as it."""
    scene = davis_rs.load_scene("three_planes").crop(0.0, 0.06)
    runs = []
    for threads in (1, None):
        recorded = Recorded(rule)
        simulator = Simulator(
            scene,
            camera=SMALL,
            rays_per_pixel=2,
            sampling=recorded,
            threads=threads,
            frame_rate_hz=100,
            depth_rate_hz=50,
        )
        runs.append(list(simulator.run()))
        assert recorded.threads == {"MainThread" if threads == 1 else "davis_rs ahead"}
    for one, other in zip(*runs, strict=True):
        assert (one.start_us, one.end_us) == (other.start_us, other.end_us)
        assert one.events.tobytes() == other.events.tobytes()
        for kind in ("luma", "depth"):
            assert np.array_equal(getattr(one, kind), getattr(other, kind))
    assert len(concatenate_events([packet.events for packet in runs[0]])) > 1000
    assert not workers()


def test_a_rule_that_fails_ahead_ends_the_run_with_its_error() -> None:
    scene = davis_rs.load_scene("three_planes").crop(0.0, 0.06)
    simulator = Simulator(scene, camera=SMALL, rays_per_pixel=2, sampling=Recorded(MaxDisplacement(1 / 2), fails_at=3))
    with pytest.raises(FloatingPointError, match="keyframe 3"):
        list(simulator.run())
    assert not workers()


def test_a_run_that_is_dropped_leaves_no_thread() -> None:
    scene = davis_rs.load_scene("three_planes")
    packets = Simulator(scene, camera=SMALL, rays_per_pixel=2, sampling=FixedRate(20_000)).run()
    next(packets)
    next(packets)
    assert workers()
    del packets
    assert not workers()


def test_steps_of_a_controller_start_no_threads() -> None:
    scene = davis_rs.load_scene("three_planes")
    recorded = Recorded(MaxDisplacement(1 / 2))
    simulator = Simulator(scene, camera=SMALL, rays_per_pixel=2, sampling=recorded)
    for t_us in (0, 1000, 2000):
        simulator.step(t_us, scene.path.pose(t_us * 1e-6))
    assert recorded.threads == {"MainThread"}
