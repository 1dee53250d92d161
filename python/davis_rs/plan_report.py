"""A plan as a table for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from textwrap import wrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .plan import EffectPlan, PlannedEffect

_HEADS = ("effect", "called for", "missing", "spurious", "shifted", "events", "off by: median / p99", "cost")
_WIDTH = 118


def table(plan: EffectPlan) -> str:
    """One row an effect, what was seen of the sequence below it, and what the columns mean at the end."""
    rows = [_HEADS, *(_cells(item) for item in plan.items)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [_line(rows[0], widths)]
    for item, row in zip(plan.items, rows[1:], strict=True):
        lines += [_line(row, widths), *wrap(item.evidence, _WIDTH, initial_indent="    ", subsequent_indent="    ")]
    called = ", ".join(effect.name for effect in plan.effects) or "none"
    share = f"{100 * plan.share:g} %"
    notes = (
        f"Called for: {called}.",
        f"Of each effect left out alone, beside ideal pixels, in {plan.duration_s:g} s with about {plan.events:,.0f} "
        f"events: events that would be missing, spurious, or off by more than {plan.shift_us:g} us, in percent of the "
        f"larger one of both streams; called for above {share} of any. Events: without it minus with it. Two events "
        f"within {plan.window_us:,} us may be the same. Of frames, pixels off by more than one grey value of 8 bits: "
        f"called for above {share}, or where so many pixels move by half a pixel in the exposure.",
    )
    return "\n".join([*lines, "", *(line for note in notes for line in wrap(note, _WIDTH))])


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    name, called, *numbers = (
        cell.ljust(w) if i < 2 else cell.rjust(w) for i, (cell, w) in enumerate(zip(cells, widths, strict=True))
    )
    return "  ".join([name, called, *numbers]).rstrip()


def _cells(item: PlannedEffect) -> tuple[str, ...]:
    called = "yes" if item.called_for else "no"
    cost = _cost(item)
    if not math.isnan(item.frame_change_percent):
        return (item.effect.name, called, "-", "-", f"{_percent(item.frame_change_percent)} of frames", "-", "-", cost)
    shares = (item.missing_percent, item.spurious_percent, item.shifted_percent)
    off = "-" if math.isnan(item.median_us) else f"{item.median_us:.3g} / {item.p99_us:.3g} us"
    change = f"{item.event_change_percent:+.2g} %" if item.event_change_percent else "0 %"
    return (item.effect.name, called, *map(_percent, shares), change, off, cost)


def _percent(value: float) -> str:
    return f"{value:.2g} %" if value < 99.5 else "100 %"


def _cost(item: PlannedEffect) -> str:
    if not math.isnan(item.cost_ns_per_event):
        return f"{item.cost_ns_per_event:.2g} ns/event"
    return "-" if math.isnan(item.cost_ns_per_pixel) else f"{item.cost_ns_per_pixel:.2g} ns/pixel"
