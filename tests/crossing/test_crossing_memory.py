"""A push that would make more events than memory holds, and numbers of threads that no machine has."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from davis_rs import CrossingEngine, Effects
from davis_rs.sensor.effects import ShotNoise

WIDTH, HEIGHT = 240, 180


def states_equal(a: dict[str, Any], b: dict[str, Any]) -> bool:
    if a.keys() != b.keys():
        return False
    return all(
        states_equal(a[key], b[key])
        if isinstance(a[key], dict)
        else np.array_equal(a[key], b[key], equal_nan=True)
        if isinstance(a[key], np.ndarray) and a[key].dtype.kind == "f"
        else np.array_equal(a[key], b[key])
        for key in a
    )


@pytest.mark.few(2)
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("kind", ["linear", "hermite", "sparse", "log", "effects"])
def test_a_tiny_threshold_is_refused_and_the_engine_goes_on(kind: str, threads: int) -> None:
    """C = 1e-5 over the whole range of luma: 3e10 events, half a terabyte."""
    effects = Effects(refractory_period_us=1e-3, leak_rate_hz=0.1) if kind == "effects" else None
    engine = CrossingEngine(
        WIDTH,
        HEIGHT,
        contrast_threshold=1e-5,
        interpolation="hermite" if kind == "hermite" else "linear",
        effects=effects,
        threads=threads,
    )
    dark, bright = np.zeros((HEIGHT, WIDTH), np.float32), np.ones((HEIGHT, WIDTH), np.float32)

    def push(t_us: int, luma: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        if kind == "log":
            return engine.push_log(t_us, np.log(luma.astype(np.float64) + 1e-3))
        if kind == "hermite":
            return engine.push(t_us, luma, np.full_like(luma, 3.0))
        if kind == "sparse" and t_us:
            sparse = (np.array([7], np.uint32), np.array([t_us - 1], np.int64), np.array([0.5], np.float32))
            return engine.push(t_us, luma, sparse=sparse)
        return engine.push(t_us, luma)

    push(0, dark)
    before = engine.state()
    with pytest.raises(ValueError, match=r"one push may make 134217728") as refused:
        push(1_000_000, bright)
    told = re.search(
        r"about (\d+) events in 43200 pixels at a least contrast threshold of 0\.00001", str(refused.value)
    )
    assert told, refused.value
    assert 2.9e10 < int(told[1]) < 3.1e10
    assert states_equal(engine.state(), before)
    # A small step is taken as if nothing had been.
    dim = dark.copy()
    dim[3, 5] = 1e-6
    events = push(2_000_000, dim)
    if kind != "effects":
        assert np.count_nonzero((events["x"] == 5) & (events["y"] == 3)) == 99
    assert engine.last_event_us[3, 5] > 0


def test_noise_is_what_it_was_before_a_push_that_was_refused() -> None:
    """It was followed through many cells until memory ended; the next frame is as if nothing had been."""
    engine, other = (
        CrossingEngine(16, 16, contrast_threshold=1e-5, effects=Effects(shot_noise_rms=ShotNoise(2e-5)), seed=3)
        for _ in range(2)
    )
    dark = np.full((16, 16), 0.01, np.float32)
    for t_us in (0, 5_000):
        np.testing.assert_array_equal(engine.push(t_us, dark), other.push(t_us, dark))
    before = engine.state()
    with pytest.raises(ValueError, match=r"one push may make 134217728"):
        engine.push(1_005_000, 1e4 * dark)
    assert states_equal(engine.state(), before)
    events = engine.push(30_000, dark)
    np.testing.assert_array_equal(events, other.push(30_000, dark))
    assert len(events) > 256


LIMITED = """
import resource, sys
import numpy as np
from davis_rs import CrossingEngine

engine = CrossingEngine(240, 180, contrast_threshold=2e-3, threads=1)
dark = np.zeros((180, 240), np.float32)
engine.push(0, dark)
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
limit = used + (1 << 30)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
try:
    engine.push(1_000_000, dark + 1)  # 149 million events at most 3454 a pixel: 2.4 GB
except (MemoryError, ValueError) as error:
    print(type(error).__name__, error)
try:
    engine.push(1_000_000, dark + np.float32(0.1))  # 99 million: 1.6 GB, where there is 1 GB
except MemoryError as error:
    print(type(error).__name__, error)
small = dark.copy()
small[0, 0] = 1
print(len(engine.push(1_000_000, small)))
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="limits its own memory as Linux does")
def test_memory_that_does_not_suffice_is_an_error() -> None:
    """With 1 GiB to go, a push of 1.6 GB of events is a MemoryError, and the process lives on."""
    run = subprocess.run([sys.executable, "-c", LIMITED], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    first, second, third = run.stdout.splitlines()
    assert first.startswith("ValueError the frame at 1000000 us would make about 149")
    assert second.startswith("MemoryError there is not enough memory for the events")
    assert "makes: about 99" in second
    assert third == "3454"


@pytest.mark.parametrize("threads", [0, -1, 1025, 1_000_000, 2**64, -(2**70)])
def test_threads_are_refused_beyond_their_limits(threads: int) -> None:
    engine = CrossingEngine(4, 3)
    with pytest.raises(ValueError, match=rf"threads must lie in 1\.\.1024, got {threads}$"):
        CrossingEngine(4, 3, threads=threads)
    with pytest.raises(ValueError, match=rf"threads must lie in 1\.\.1024, got {threads}$"):
        CrossingEngine.from_state(engine.state(), threads=threads)
