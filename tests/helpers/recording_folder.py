"""A small simulated folder with all parts of a recording, and its conversions."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import davis_rs
from davis_rs.io.files.conversion import ConversionReport, LeftOutWarning, convert

SIZE = (32, 24)


def complete_folder(path: Path) -> Path:
    """A tenth of a second with all that a container can hold, and masks, which none can."""
    davis_rs.simulate_to_folder(
        davis_rs.load_scene("three_planes"),
        path,
        duration_s=0.1,
        size=SIZE,
        renderer="native",
        imu="davis",
        flow_rate_hz=20,
        mask_rate_hz=20,
        quiet=True,
    )
    return path


def quietly(source: Path, target: Path, **options: Any) -> ConversionReport:
    """A conversion that leaves out masks, of which nothing is to be said."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LeftOutWarning)
        return convert(source, target, **options)
