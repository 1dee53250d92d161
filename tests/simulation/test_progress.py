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

from davis_rs._util import progress as module
from davis_rs._util.progress import each, progress, say, speed_of

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
