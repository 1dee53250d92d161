"""The README's promises that can be run."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

README = Path(__file__).resolve().parents[1] / "README.md"


def test_the_python_example_runs() -> None:
    """The first thing that a new user pastes."""
    examples = re.findall(r"```python\n(.*?)```", README.read_text(), re.S)
    assert len(examples) == 1
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(examples[0], "README.md", "exec"), {"__name__": "readme"})
    lines = printed.getvalue().splitlines()
    assert [line.split()[0] for line in lines] == ["0", "25000", "50000", "75000", "100000"]


def test_the_pictures_are_there() -> None:
    for name in re.findall(r"!\[[^]]*\]\(([^)]+)\)", README.read_text()):
        assert (README.parent / name).is_file(), name
