"""What the test files share: the profile of hypothesis, and fixtures for Mitsuba's fast variant and for processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from davis_rs._mitsuba.variants import FAST, default_variant
from davis_rs.render.baked import baked_scene, cache

# The same examples in every run, and no time limit for one: kernels are compiled on first use. For more of them:
# pytest --hypothesis-profile=long
settings.register_profile("davis_rs", derandomize=True, deadline=None, max_examples=20)
settings.register_profile("long", derandomize=True, deadline=None, max_examples=300)
settings.load_profile("davis_rs")

TESTS = Path(__file__).parent
QUICK = {
    "cli/test_convert_and_info.py",
    "crossing/test_crossing_faults.py",
    "crossing/test_crossing_frames.py",
    "crossing/test_crossing_state.py",
    "crossing/test_log_intensity.py",
    "dataset/test_dataset.py",
    "effects/test_effects_settings.py",
    "events/test_event_array.py",
    "formats/test_event_files.py",
    "formats/test_events_text.py",
    "live_camera/test_decoder.py",
    "sensors/test_sensors.py",
    "simulation/test_settings.py",
    "simulation/test_simulate.py",
    "trajectory/test_trajectory.py",
}
"""Of --quick: the engine, effects, formats, decoder, simulator, dataset folders and the command line, in small."""


def pytest_configure() -> None:
    """A shell without job control starts background programs with SIGINT ignored, and their children inherit that.

    Tests of Ctrl-C send this signal to the test process and to its children: so both have Python's own handler.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="run tests marked long, too")
    parser.addoption("--quick", action="store_true", help="run a few files of each part alone, in less than a minute")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """With ``--quick``, other files are not even imported: that would take as long as to run these."""
    if not config.getoption("quick") or collection_path.suffix != ".py":
        return None
    return True if collection_path.relative_to(TESTS).as_posix() not in QUICK else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Without ``--long``, tests marked long are skipped: others test the same promise in a cheaper way."""
    mark_all_but_few(items)
    if not config.getoption("long"):
        for item in items:
            if item.get_closest_marker("long") is not None:
                item.add_marker(pytest.mark.skip(reason="long: run with --long"))


def mark_all_but_few(items: list[pytest.Item]) -> None:
    """Mark as long all sets of parameters of a test but the ``few(count)`` of its mark, spread evenly over all."""
    sets: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("few") is not None and item.get_closest_marker("long") is None:
            sets.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for all_sets in sets.values():
        mark = all_sets[0].get_closest_marker("few")
        assert mark is not None
        (count,) = mark.args
        kept = {i * len(all_sets) // count for i in range(count)}
        for i, item in enumerate(all_sets):
            if i not in kept:
                item.add_marker(pytest.mark.long)


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Workers (-n) begin at files far apart: if they shared a file's tests, each would make its fixtures."""
    if config.getoption("dist", "no") == "no":
        config.option.dist = "worksteal"


@pytest.fixture(scope="session")
def long(request: pytest.FixtureRequest) -> bool:
    """Whether tests that have a short and a long form are to run the long one (``--long``)."""
    return bool(request.config.getoption("long"))


@pytest.fixture(scope="session")
def llvm() -> str:
    """The fast variant's name; without a usable LLVM the test is skipped, and the summary says why."""
    name, why = default_variant()
    if name != FAST:
        pytest.skip(f"needs Mitsuba's {FAST}: {why}")
    return name


@pytest.fixture(scope="session", autouse=True)
def baked_light_kept_apart(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Light is baked once in a run of the tests, by whichever worker, and not taken from the user's own cache."""
    before = os.environ.get("DAVIS_RS_CACHE_DIR")
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    os.environ["DAVIS_RS_CACHE_DIR"] = str(shared / "baked_light")
    yield
    if before is None:
        del os.environ["DAVIS_RS_CACHE_DIR"]
    else:
        os.environ["DAVIS_RS_CACHE_DIR"] = before


@pytest.fixture(scope="session", autouse=True)
def costs_measured_once(long: bool) -> Iterator[None]:
    """What effects cost in time, which no test judges, is measured in one round; with ``--long`` in three."""
    with pytest.MonkeyPatch.context() as patch:
        if not long:
            patch.setattr("davis_rs.simulation.planning.cost._ROUNDS", 1)
        yield


VIEW_POINTS = 40_000
"""So many points on the surfaces of a file decide where it is looked at from; without tests, ten times as many."""


@pytest.fixture(scope="session", autouse=True)
def views_found_quickly(long: bool) -> Iterator[None]:
    """Where a file without a camera is looked at from is found from fewer points; with ``--long`` from all.

    Files are read in hundreds of tests, of which those of the view itself (tests/scenes/test_default_view.py) take all.
    """
    with pytest.MonkeyPatch.context() as patch:
        if not long:
            patch.setattr("davis_rs.scene.files.subject._POINTS", VIEW_POINTS)
        yield


@pytest.fixture
def light_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of baked light, on disk and in memory."""
    monkeypatch.setenv(cache.FOLDER_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(baked_scene, "_known", {})
    return tmp_path / "cache"


@pytest.fixture(params=["native", "table"])
def kind(request: pytest.FixtureRequest) -> str:
    """Both renderers that have a scene's tables; without LLVM the native one."""
    if request.param == "table":
        request.getfixturevalue("llvm")
    return str(request.param)


@pytest.fixture(scope="session")
def run_python() -> Callable[..., str]:
    """Run a program in a fresh interpreter, with environment variables; returns what it prints."""

    def run(program: str, *arguments: str, **environment: str) -> str:
        command = [sys.executable, "-c", program, *arguments]
        done = subprocess.run(
            command, env={**os.environ, **environment}, capture_output=True, text=True, timeout=300, check=False
        )
        assert done.returncode == 0, f"exit status {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    return run


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of two megabytes."""
    folder = tmp_path / "small"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True, check=False).returncode != 0:
        pytest.skip("needs the right to mount a tmpfs")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)
