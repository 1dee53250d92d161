"""What files say reaches a terminal without orders for it, and names that are not UTF-8 do no harm."""

from __future__ import annotations

import ast
import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import davis_rs
from command_line import davis_rs as run
from command_line import in_own_process
from davis_rs.inspection.visual_sequence import open_visual_sequence
from davis_rs.progress import progress, say
from davis_rs.terminal_text import printable
from places import ROOT
from written_sequence import write_sequence

ORDER = "\x1b]0;owned\x07\x1b[2J"
HARMFUL = f"{ORDER}\r\nwarning: forged\u202etxt\ud800\x9b31m"


def unescaped(text: str) -> set[str]:
    """Characters of a text that a terminal acts upon, but for new lines."""
    return {one for one in text if one != "\n" and (not one.isprintable() or "\ud800" <= one <= "\udfff")}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a\x1b[31mb", r"a\x1b[31mb"),
        ("a\nb\tc", r"a\nb\tc"),
        ("\r\x00\x7f\x9b", r"\r\x00\x7f\x9b"),
        ("\u202e\u2066\u2028", r"\u202e\u2066\u2028"),
        (os.fsdecode(b"\xffa"), r"\xffa"),
        ("\ud800", r"\ud800"),
        ("ä € 漢 🙂 C:\\x1b", "ä € 漢 🙂 C:\\x1b"),
    ],
)
def test_what_is_escaped(text: str, expected: str) -> None:
    assert printable(text) == expected
    assert printable(f"{text}\n\t", lines=True).endswith("\n\t")


@pytest.fixture
def harmful(tmp_path: Path) -> Path:
    """A dataset folder whose meta.json gives orders."""
    write_sequence(tmp_path / "d")
    meta = json.loads((tmp_path / "d" / "meta.json").read_text())
    meta |= {"scene": {"name": HARMFUL}, "effects": {HARMFUL: {}}, "davis_rs": HARMFUL, "model": 1, "complete": False}
    (tmp_path / "d" / "meta.json").write_text(json.dumps(meta))
    return tmp_path / "d"


@pytest.mark.parametrize("command", ["info", "check"])
def test_reports_of_a_folder_give_no_orders(harmful: Path, command: str) -> None:
    said = run(command, harmful)
    assert r"\x1b]0;owned\x07" in said.stdout
    assert unescaped(said.stdout + said.stderr) == set()
    assert "\nwarning: forged" not in said.stdout


def test_pictures_and_pages_have_the_escaped_text(harmful: Path, tmp_path: Path) -> None:
    label = open_visual_sequence(harmful).label
    assert unescaped(label) == set()
    for option, name in (("--html", "a.html"), ("-o", "a.png")):
        said = run("view", harmful, option, tmp_path / name)
        assert said.returncode == 0, said.stderr
        assert (tmp_path / name).stat().st_size


def test_errors_and_warnings_give_no_orders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"{ORDER}.npy"
    path.write_bytes(b"nothing")
    said = run("info", path)
    assert said.returncode == 1
    assert r"\x1b]0;owned\x07" in said.stderr
    assert unescaped(said.stderr) == set()
    said = run("info", path, "--debug")
    assert "Traceback" in said.stderr
    assert unescaped(said.stderr) == set()
    say(f"davis-rs: warning: {ORDER}")
    assert unescaped(capsys.readouterr().err) == set()


def test_bars_give_no_orders(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    clock = iter(range(0, 10_000, 100))
    monkeypatch.setattr("davis_rs.progress.time", SimpleNamespace(monotonic=lambda: float(next(clock))))
    with progress(f"reading {ORDER}", 2.0) as bar:
        bar.to(1.0, ORDER)
    said = capsys.readouterr().err
    assert r"\x1b" in said
    assert unescaped(said) == set()


def test_a_name_that_is_not_utf_8(tmp_path: Path) -> None:
    """In a process of its own, because its output must be encoded."""
    events = np.array([(10, 1, 2, 1), (20, 3, 4, 0)], davis_rs.EVENT_DTYPE)
    path = os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xfe.npy")
    with davis_rs.open_writer(path, (8, 6)) as writer:
        writer.write(events)
    page = tmp_path / "page.html"
    said = run("view", path, "--html", page, "--size", "8x6")
    assert said.returncode == 0, said.stderr
    assert r"\xff\xfe.npy" in page.read_text()
    said = in_own_process("info", path, "--quiet", PYTHONIOENCODING="utf-8:strict")
    assert said.returncode == 0, said.stderr
    assert r"\xff\xfe.npy" in said.stdout


@pytest.mark.parametrize("path", sorted((ROOT / "python/davis_rs/cli").glob("*.py")), ids=lambda path: path.stem)
def test_commands_print_through_the_one_helper(path: Path) -> None:
    calls = [node.func for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    assert "print" not in {call.id for call in calls if isinstance(call, ast.Name)}
    assert "print_exc" not in {call.attr for call in calls if isinstance(call, ast.Attribute)}
