"""The examples that fit models to event times, in short forms."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def example(name: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(EXAMPLES)
    return importlib.import_module(name)


def test_thresholds_are_recovered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that the events tell follow the true ones."""
    short = ["--noise-us", "1", "--width", "40", "--duration", "0.2"]
    (found,) = example("recover_thresholds", monkeypatch).main(short)
    assert found.known.mean() > 0.7
    assert found.correlation.min() > 0.99
    assert found.rms.max() < 0.02
