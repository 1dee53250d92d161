"""The tutorials are such that the build of the site runs each of them, from top to end: no test does it again."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import pytest

from places import ROOT

TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorials_are_python_without_outputs(path: Path) -> None:
    """Outputs are made when the site is built. Each cell compiles."""
    code = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]
    assert code
    for cell in code:
        assert cell["outputs"] == []
        assert cell["execution_count"] is None
        compile("".join(cell["source"]), path.name, "exec")


def test_the_site_runs_all_of_them() -> None:
    """Each is in a toctree, and a cell that fails ends the build; .ci/nightly runs all."""
    index = (ROOT / "docs" / "index.rst").read_text()
    listed = re.findall(r"^   tutorials/(\S+)$", index, re.M)
    assert sorted(listed) == [path.stem for path in TUTORIALS]
    assert len(TUTORIALS) >= 7
    settings = {
        target.id: ast.literal_eval(node.value)
        for node in ast.parse((ROOT / "docs" / "conf.py").read_text()).body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name) and target.id.startswith("nb_execution")
    }
    assert settings["nb_execution_mode"] == "force"
    assert settings["nb_execution_raise_on_error"] is True
    assert "sphinx-build -W" in (ROOT / ".ci" / "run").read_text()
