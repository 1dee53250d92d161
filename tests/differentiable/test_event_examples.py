"""The examples that fit models to event times, in short forms."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def example(name: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(EXAMPLES)
    return importlib.import_module(name)


@pytest.mark.long
def test_thresholds_are_recovered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that the events tell follow the true ones."""
    short = ["--noise-us", "1", "--width", "40", "--duration", "0.2"]
    (found,) = example("recover_thresholds", monkeypatch).main(short)
    assert found.known.mean() > 0.7
    assert found.correlation.min() > 0.99
    assert found.rms.max() < 0.02


@pytest.mark.long
def test_a_trajectory_is_recovered(monkeypatch: pytest.MonkeyPatch) -> None:
    """From 2 cm and 1 degree off; ten control points leave 0.08 mm of the sines."""
    short = ["--noise-us", "10", "--width", "40", "--points", "10", "--steps", "4", "--time-steps", "2"]
    (found,) = example("recover_trajectory", monkeypatch).main(short)
    assert found.history[0, 0] > 0.015
    assert found.history[-1, 0] < 3e-4
    assert found.history[-1, 1] < 5e-3


@pytest.mark.long
def test_a_texture_is_recovered_from_events(monkeypatch: pytest.MonkeyPatch) -> None:
    """Texels that the events tell are known to within 3 %, but for their common factor."""
    (found,) = example("recover_texture_from_events", monkeypatch).main(["--noise-us", "10", "--width", "48"])
    assert found.known.mean() > 0.4
    error = np.abs(found.error[found.known])
    assert np.median(error) < 2e-3
    assert np.quantile(error, 0.95) < 0.03


@pytest.mark.long
def test_a_clock_offset_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """5 ms and 1000 ppm, to within what least squares says."""
    short = ["--noise-us", "10", "--width", "48", "--time-steps", "5"]
    (found,) = example("recover_clock_offset", monkeypatch).main(short)
    assert (found.sigma < [2e-6, 5e-5]).all()
    assert (np.abs(found.error) < 4 * found.sigma).all()


@pytest.mark.long
def test_the_bound_predicts_the_scatter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Squared errors by the bound's covariance are chi-squared with six degrees of freedom."""
    draws = 20
    short = ["--motions", "all six", "--thresholds", "0.2", "--width", "32", "--draws", str(draws)]
    (bound,), squared = example("design_bounds", monkeypatch).main(short)
    assert bound.rms()[0] < 0.1
    # Four standard deviations of a mean of so many, 12 the variance of one.
    assert abs(squared.mean() - 6) < 4 * np.sqrt(12 / draws)
