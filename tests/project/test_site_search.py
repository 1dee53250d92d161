"""The search of the site finds something: its scores are read next to Sphinx's own script."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

SCORES = Path(__file__).resolve().parents[2] / "docs" / "search_scores.js"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
def test_scores_of_the_search_take_the_place_of_those_of_sphinx(tmp_path: Path) -> None:
    """A browser reads both, in the order of the search page. A second declaration would end all scripts after it."""
    sphinx = pytest.importorskip("sphinx")
    static = Path(sphinx.__file__).parent / "themes" / "basic" / "static"
    scripts = [static / name for name in ("doctools.js", "searchtools.js")]
    sources = "".join(f"<script src='file://{script}'></script>" for script in [*scripts, SCORES])
    page = tmp_path / "search.html"
    page.write_text(
        f"<html><body>{sources}<script>document.title = 'title counts ' + Scorer.title</script></body></html>"
    )
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=1000", f"file://{page}"]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert "SyntaxError" not in ran.stderr, ran.stderr
    title = next(line for line in SCORES.read_text().splitlines() if line.strip().startswith("title:"))
    assert f"<title>title counts {title.strip().removeprefix('title: ').rstrip(',')}</title>" in ran.stdout
