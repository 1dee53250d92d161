"""The training example, in short: what it learns is in the events."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch")

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def example() -> Any:
    spec = importlib.util.spec_from_file_location("train_reconstruction", EXAMPLES / "train_reconstruction.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.long
def test_a_network_learns_to_reconstruct(tmp_path: Path, long: bool) -> None:
    """On images that it never saw, a network comes closer to the frames than before it learned; with ``--long``, also
    than an even grey."""
    sequences, steps = ("24", "120") if long else ("5", "30")
    arguments = ["--sequences", sequences, "--steps", steps, "--data", str(tmp_path / "data")]
    found = example().main([*arguments, "-o", str(tmp_path / "out.png")])
    error, correlation = found["network"]
    assert error < found["network before training"][0]
    assert correlation > (0.45 if long else 0.2)
    assert not long or error < 0.92 * found["an even grey"][0]
    assert (tmp_path / "out.png").stat().st_size > 10_000
