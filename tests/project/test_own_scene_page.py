"""docs/own_scene.md from top to bottom, as a reader copies it."""

from __future__ import annotations

import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import pytest

from command_line import davis_rs
from davis_rs import Dataset
from places import ROOT

PAGE = ROOT / "docs" / "own_scene.md"


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_everything_on_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs, commands and the scene file, in their order in one folder; both datasets hold events."""
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```(\w+)\n(.*?)^```", PAGE.read_text(), re.M | re.S)
    languages = "python sh python sh xml python sh python python"
    assert [language for language, _ in blocks] == languages.split()
    printed = StringIO()
    for language, text in blocks:
        if language == "xml":
            (tmp_path / "crate.xml").write_text(text)
            continue
        if language == "python":
            with redirect_stdout(printed):
                exec(compile(text, str(PAGE), "exec"), {"__name__": "__main__"})
            continue
        for line in text.splitlines():
            done = davis_rs(*line.removeprefix("davis-rs ").split())
            assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
            if "simulate" in line:
                assert "rendering with native renderer" in done.stderr
    for name in ("crate", "wall", "crate_slider"):
        assert len((tmp_path / name / "events.txt").read_text().splitlines()) > 1000
        assert Dataset(tmp_path / name).frames
    assert re.search(r"^100000 us: [1-9]\d* events$", printed.getvalue(), re.M)
    assert re.search(r"^[1-9]\d{3,} events$", printed.getvalue(), re.M)
