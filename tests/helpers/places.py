"""Where the tests find what lies outside of their own folders."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HELPERS = ROOT / "tests" / "helpers"
SHARED = ROOT.parent / "shared"
"""Data of others, next to the checkout where there are any: what needs them is skipped elsewhere."""
