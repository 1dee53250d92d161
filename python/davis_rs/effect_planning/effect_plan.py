"""What a plan says: of each effect what leaving it out does and what having it costs, and a table for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from textwrap import wrap
from typing import Any

from ..effects import Effect, Effects

_HEADS = ("effect", "called for", "missing", "spurious", "shifted", "events", "off by: median / p99", "cost")
_WIDTH = 118


@dataclass(frozen=True)
class PlannedEffect:
    """What leaving out an effect would do, and what having it costs.

    Shares are of the larger one of both streams, with and without the effect.

    Attributes:
        effect: with its values.
        called_for: whether the plan switches it on.
        observation: what was seen of the sequence.
        missing_percent: events that would be missing without it.
        spurious_percent: events that would be there though they should not.
        shifted_percent: events that would be off by more than the plan's ``shift_us``.
        event_change_percent: events without it minus those with it.
        median_us, p99_us: of how far events would be off; NaN where there are none.
        frame_change_percent: pixels of 8-bit frames that would be off by more than one grey value; NaN but for APS.
        cost_ns_per_pixel: of a keyframe, or of an intensity frame for APS; NaN where it costs none or was not measured.
        cost_ns_per_event: likewise, of what acts on the stream.
    """

    effect: Effect
    called_for: bool
    observation: str
    missing_percent: float
    spurious_percent: float
    shifted_percent: float
    event_change_percent: float
    median_us: float
    p99_us: float
    frame_change_percent: float
    cost_ns_per_pixel: float
    cost_ns_per_event: float


@dataclass(frozen=True)
class EffectPlan:
    """Which effects a sequence calls for; its string is a table for people.

    Attributes:
        items: one for each candidate, in the order in which light and events meet them.
        share: of events (for APS, of pixels) that an effect must change to be called for.
        shift_us: by how much an event must be off to count as shifted.
        window_us: how far apart two events may be that count as the same.
        events: of ideal pixels, estimated for the whole sequence.
        duration_s: of the sequence.
        kept: effects that were given by name and so are no candidates.
    """

    items: tuple[PlannedEffect, ...]
    share: float
    shift_us: float
    window_us: int
    events: float
    duration_s: float
    kept: Effects = Effects()  # noqa: RUF009 (it is immutable)

    @property
    def effects(self) -> Effects:
        """Those called for and those kept; every other candidate is switched off, so that no sensor brings it back."""
        chosen = {item.effect.name: item.effect for item in self.items if item.called_for}
        off = {item.effect.name for item in self.items} - chosen.keys()
        return self.kept.with_defaults(Effects.of(chosen.values())).without(off)

    def describe(self) -> dict[str, Any]:
        """The plan in JSON's types, for meta.json: what was found of each effect."""
        items = [{**asdict(item), "effect": item.effect.name} for item in self.items]
        found = [{name: None if value != value else value for name, value in item.items()} for item in items]  # NaN
        return {
            "share": self.share,
            "shift_us": self.shift_us,
            "window_us": self.window_us,
            "events": self.events,
            "kept": self.kept.describe(),
            "effects": found,
        }

    def __str__(self) -> str:
        return _table(self)


def _table(plan: EffectPlan) -> str:
    """One row an effect, what was seen of the sequence below it, and what the columns mean at the end."""
    rows = [_HEADS, *(_cells(item) for item in plan.items)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [_line(rows[0], widths)]
    for item, row in zip(plan.items, rows[1:], strict=True):
        lines += [_line(row, widths), *wrap(item.observation, _WIDTH, initial_indent="    ", subsequent_indent="    ")]
    called = ", ".join(effect.name for effect in plan.effects) or "none"
    share = f"{100 * plan.share:g} %"
    notes = (
        f"Called for: {called}.",
        f"Of each effect left out alone, compared with ideal pixels, in {plan.duration_s:g} s with about "
        f"{plan.events:,.0f} events: events that would be missing, spurious, or off by more than {plan.shift_us:g} us, "
        f"in percent of the larger one of both streams; called for above {share} of any. Events: without it minus with "
        f"it. Two events within {plan.window_us:,} us may be the same. Of frames, pixels off by more than one grey "
        f"value of 8 bits: called for above {share}, or where so many pixels move by half a pixel in the exposure.",
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
