"""docs/own_scene.md from top to bottom, as a reader copies it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from davis_rs import Dataset

PAGE = Path(__file__).resolve().parents[1] / "docs" / "own_scene.md"


@pytest.mark.usefixtures("llvm")
def test_everything_on_the_page_runs(tmp_path: Path) -> None:
    """Programs, commands and the scene file, in their order in one folder; both datasets hold events."""
    blocks = re.findall(r"^```(\w+)\n(.*?)^```", PAGE.read_text(), re.M | re.S)
    assert [language for language, _ in blocks] == ["python", "sh", "python", "sh", "xml", "python", "sh", "python"]
    for language, text in blocks:
        if language == "xml":
            (tmp_path / "crate.xml").write_text(text)
            continue
        lines = text.splitlines() if language == "sh" else []
        commands = [["-m", "davis_rs.cli", *line.removeprefix("davis-rs ").split()] for line in lines] or [["-c", text]]
        for command in commands:
            done = subprocess.run(
                [sys.executable, *command], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
            )
            assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
            if "simulate" in command:
                assert "rendering with native renderer" in done.stderr
    for name in ("crate", "wall", "crate_slider"):
        assert len((tmp_path / name / "events.txt").read_text().splitlines()) > 1000
        assert Dataset(tmp_path / name).frames
    assert re.search(r"100000 us: [1-9]\d* events", done.stdout)
