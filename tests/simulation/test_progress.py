"""Progress: one style in a terminal, plain lines without one, and nothing where silence is asked for."""

from __future__ import annotations

import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from PIL import Image

from davis_rs import frames_to_folder, load_scene, open_frames, simulate_to_folder
from davis_rs._util import progress as module
from davis_rs._util.progress import Forecast, Progress, each, progress, say, speed_of
from davis_rs._util.quantities import events_a_second
from davis_rs.simulation.folder import advice
from davis_rs.simulation.planning import plan_effects
from davis_rs.simulation.settings import FolderSettings, complete

PACKAGE = Path(module.__file__).parent


def in_a_terminal(program: str) -> str:
    """What a program writes to standard error where that is a terminal."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("4H", 24, 100, 0, 0))
    process = subprocess.Popen([sys.executable, "-c", program], stderr=theirs)
    os.close(theirs)
    told = b""
    try:
        while piece := os.read(ours, 4096):
            told += piece
    except OSError:  # the other end is closed
        pass
    os.close(ours)
    assert process.wait(60) == 0, told
    return told.decode()


def test_a_terminal_has_a_bar() -> None:
    """What, share, how much of how much, time, speed, and a note; a line of text goes above it."""
    told = in_a_terminal(
        "from davis_rs._util.progress import progress, say\n"
        "import time\n"
        "with progress('simulating', 2.0, unit='s') as bar:\n"
        "    for step in range(1, 5):\n"
        "        time.sleep(0.15); bar.to(0.001 * step, f'{step} events')\n"
        "    say('a word')\n"
    )
    assert "a word" in told
    last = told.rstrip().split("\r")[-1]
    assert last.startswith("simulating:   0%|")
    assert "0.004/2 s [00:0" in last
    assert "4 events]" in last
    speed = float(last.split(", ")[1].removesuffix(" s/s"))
    assert 0.001 < speed < 0.0075, "a slow speed is shown as what it is, not as 0.00"


@pytest.mark.parametrize(
    ("done", "seconds", "shown"),
    [(0.0, 5.0, "? s/s"), (0.01, 100.0, "0.0001 s/s"), (3.0, 700.0, "0.0043 s/s"), (1234.0, 1.0, "1,234 s/s")],
)
def test_a_speed_has_two_digits_however_slow(done: float, seconds: float, shown: str) -> None:
    assert speed_of(done, seconds, " s") == shown


def test_without_a_terminal_there_are_rare_plain_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One a minute, so nothing for short work, and never a carriage return."""
    for _ in each(range(10_000), "counting", 10_000):
        pass
    assert capsys.readouterr().err == ""
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    with progress("simulating", 2.0, unit="s") as bar:
        for second in range(150):
            now[0] += 1.0
            bar.to(0.01 * (second + 1), f"{second + 1} events")
    assert capsys.readouterr().err == (
        "simulating: 30 %, 0.6 of 2 s, 0.01 s/s, 60 events\nsimulating: 60 %, 1.2 of 2 s, 0.01 s/s, 120 events\n"
    )


def test_large_counts_have_no_exponents(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(module, "LINE_EVERY_S", 0.0)
    monkeypatch.setattr("time.monotonic", lambda: 1.0)
    with progress("baking light", 550_912, unit="points") as bar:
        bar.to(413_200)
    assert capsys.readouterr().err == "baking light: 75 %, 413,200 of 550,912 points, ? points/s\n"
    told = in_a_terminal(
        "from davis_rs._util.progress import progress\n"
        "with progress('baking light', 550_912, unit='points') as bar:\n"
        "    bar.to(413_200)\n"
    )
    assert "413,200/550,912 points [" in told.rstrip().split("\r")[-1]


def test_silence_where_it_is_asked_for(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Not even a line a minute; the items come all the same."""
    monkeypatch.setattr(module, "LINE_EVERY_S", 0.0)
    assert list(each("abc", "reading", 3, show=False)) == ["a", "b", "c"]
    assert capsys.readouterr().err == ""
    assert list(each("abc", "reading", 3)) == ["a", "b", "c"]
    assert capsys.readouterr().err.count("\n") == 3
    say("a word")
    assert capsys.readouterr().err == "a word\n"


def test_all_bars_are_these() -> None:
    """No other module draws one of its own."""
    others = [path for path in PACKAGE.rglob("*.py") if path.name != "progress.py" and "tqdm" in path.read_text()]
    assert others == []


def foretold(forecast: Forecast, arrivals: list[tuple[float, float]]) -> list[float]:
    """All forecasts, of steps that arrive as (done, seconds)."""
    return [in_all for step in arrivals if (in_all := forecast.seconds(*step)) is not None]


def test_a_forecast_is_made_between_the_ends_of_batches() -> None:
    """Eight steps at once every two seconds, the first batch after five: 400 steps take 103 s, told as soon as the
    third batch is over."""
    batches = [5.0 + 2.0 * batch for batch in range(10)]
    arrivals = [(8.0 * k + j + 1, at_s + 0.001 * j) for k, at_s in enumerate(batches) for j in range(8)]
    assert foretold(Forecast(400.0), arrivals[:24]) == []
    assert foretold(Forecast(400.0), arrivals[:25]) == pytest.approx([103.0], abs=0.2)


def test_a_forecast_of_steps_that_come_evenly() -> None:
    told = foretold(Forecast(1000.0), [(step, 0.05 * step) for step in range(1, 400)])
    assert told == pytest.approx([50.0] * len(told))
    assert told
    assert foretold(Forecast(390.0), [(step, 0.05 * step) for step in range(1, 390)]) == [], "19.5 s need no line"


def test_a_long_run_is_foretold_in_a_log(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Once, before the first line; work that asks for no forecast or is foretold already, and short work, have none."""
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    advice = "--accuracy fast takes less"
    for total, forecast, foretold in (
        (120.0, advice, False),
        (120.0, None, False),
        (1.0, "", False),
        (120.0, "", True),
    ):
        with progress("simulating", total, unit="s", forecast=forecast) as bar:
            now[0] += 30.0
            bar.begin(foretold=foretold)
            for step in range(1, 6):
                now[0] += 3.0
                bar.to(0.2 * step)
    assert capsys.readouterr().err == "simulating will take about 30 minutes; --accuracy fast takes less\n"


def test_a_long_run_is_foretold_once_above_the_bar() -> None:
    told = in_a_terminal(
        "from davis_rs._util import progress as module\n"
        "import time\n"
        "now = [0.0]\n"
        "time.monotonic = lambda: now[0]\n"
        "with module.progress('simulating', 120.0, unit='s', forecast='--accuracy fast takes less') as bar:\n"
        "    bar.begin()\n"
        "    for step in range(1, 30):\n"
        "        now[0] += 3.0; bar.to(0.2 * step)\n"
    )
    assert told.count("simulating will take about 30 minutes; --accuracy fast takes less\r\n") == 1


def test_what_is_being_done_shows_on_the_innermost_bar() -> None:
    """A bar inside of another one goes when it is over; a stage says how long it takes, and goes."""
    told = in_a_terminal(
        "from davis_rs._util.progress import doing, progress, stage\n"
        "doing('what nobody sees')\n"
        "with stage('planning effects'):\n"
        "    doing('effect 1 of 2, readout')\n"
        "with progress('simulating', 2.0, unit='s') as bar:\n"
        "    doing('loading the scene')\n"
        "    with progress('baking light', 9, unit='points') as baking:\n"
        "        doing('sun')\n"
        "        baking.to(9)\n"
        "    bar.to(2.0)\n"
    )
    assert "nobody" not in told
    assert "planning effects [00:00, effect 1 of 2, readout]" in told
    assert "0/2 s [00:00<?, ? s/s, loading the scene]" in told
    assert "0/9 points [00:00<?, ? points/s, sun]" in told
    shown = [line.split("\n")[-1] for line in told.split("\r") if line.strip()]
    assert shown[-1].startswith("simulating: 100%")
    assert told.count("\n") == told.count("\x1b[A") + 1, "every bar but the last one is taken away"


def test_a_notebook_has_bars() -> None:
    """There standard error is no terminal, but what is written appears below the cell."""
    program = (
        "import sys, types\n"
        "shell = types.SimpleNamespace(config={'IPKernelApp': {}})\n"
        "sys.modules['IPython'] = types.SimpleNamespace(get_ipython=lambda: shell)\n"
        "from davis_rs._util import progress as module\n"
        "print(module._in_notebook())\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
    assert not module._in_notebook()


def test_a_run_tells_what_it_does_and_counts_keyframes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """From before the simulator is made to the end: keyframes, not packets, move the bar."""
    told: list[str] = []
    monkeypatch.setattr("davis_rs.simulation.simulate.doing", told.append)
    monkeypatch.setattr("davis_rs.simulation.folder.doing", told.append)
    moved: list[tuple[float, str]] = []
    monkeypatch.setattr(Progress, "to", lambda _, done, note="": moved.append((done, note)))
    scene = load_scene("three_planes")
    report = simulate_to_folder(scene, tmp_path, duration_s=0.06, frame_rate_hz=10, size=(60, 45), quiet=True)
    assert told == [
        "loading the scene",
        "making the renderer",
        "measuring noise",
        "making the simulator",
        "rendering the first keyframes",
    ]
    times = [done for done, _ in moved]
    assert times == sorted(set(times))
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(0.06)
    assert len(times) > 5, "packets end at 0 and at 0.06 s alone"
    assert moved[-1][1].startswith(f"{report.events:,} events, ")
    assert [events_a_second(rate) for rate in (12.3, 45_600, 4_230_000, 87.4e6)] == ["12/s", "46k/s", "4.2M/s", "87M/s"]


@pytest.mark.usefixtures("llvm")
def test_a_plan_tells_each_of_its_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """One for the sample, one for each candidate, and those of the effects together."""
    told: list[str] = []
    for module_name in ("planner", "effects_together"):
        monkeypatch.setattr(f"davis_rs.simulation.planning.{module_name}.doing", told.append)
    candidates = {"leak_rate_hz": 0.1, "refractory_period_us": 200}
    plan_effects(load_scene("three_planes").crop(0, 0.02), candidates, size=(24, 18))
    assert told[:4] == [
        "rendering a sample of the sequence",
        "effect 1 of 2, refractory_period_us",
        "effect 2 of 2, leak_rate_hz",
        "the effects together",
    ]
    assert told[-1] == "the effects together, on other pixels"


def test_frames_tell_what_is_done_before_they_are_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The bar is there before the first frames are read."""
    told: list[str] = []
    monkeypatch.setattr("davis_rs.simulation.from_frames.frames_folder.doing", told.append)
    moved: list[float] = []
    monkeypatch.setattr(Progress, "to", lambda _, done, note="": moved.append(done))
    (tmp_path / "images").mkdir()
    for number in range(4):
        Image.new("L", (24, 18), 40 * number + 20).save(tmp_path / "images" / f"{number}.png")
    frames = open_frames(tmp_path / "images", fps=100)
    frames_to_folder(frames, tmp_path / "d", interpolation="linear", quiet=True)
    assert told == ["reading the first frames"]
    assert moved == [1, 2, 3, 4]


def test_a_run_is_told_of_the_fast_preset_only_where_it_decides() -> None:
    told = {
        advice(complete(FolderSettings, given, taker="a test"))
        for given in ({"accuracy": "fast"}, {"render_rate_hz": 1000.0}, {"tolerance": 0.1, "accuracy": "exact"})
    }
    assert told == {"a shorter --duration takes less"}
    assert advice(complete(FolderSettings, {"accuracy": "exact"}, taker="a test")) == (
        "a shorter --duration or --accuracy fast takes less"
    )
