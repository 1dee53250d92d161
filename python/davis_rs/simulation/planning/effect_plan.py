"""Writes a plan: of each effect what leaving it out does and what having it costs, and a table for people."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from textwrap import wrap

from ..._util.html_table import html_table
from ..._util.quantities import three_digits, time_text
from ...sensor.effects import Effect, Effects
from .effects_together import SetForecast
from .omission_error import OmissionError, TimeScale

_HEADS = ("effect", "called for", "count", "rate", "time")
_MORE_HEADS = ("missing", "spurious", "shift: median / p99", "cost")
_WIDTH = 118


@dataclass(frozen=True)
class PlannedEffect:
    """Says what leaving out an effect would do, and what having it costs.

    Attributes:
        effect: with its values.
        called_for: whether the plan switches it on.
        with_others: whether that is only because of what it does together with others, and not alone.
        observation: what was seen of the sequence.
        omission: what leaving it out does to events; no error for APS.
        frame_change_percent: pixels of 8-bit frames that would be off by more than one grey value; NaN but for APS.
        cost_ns_per_pixel: of a keyframe, or of an intensity frame for APS; NaN where it costs none or was not measured.
        cost_ns_per_event: likewise, of what acts on the stream.
    """

    effect: Effect
    called_for: bool
    with_others: bool
    observation: str
    omission: OmissionError
    frame_change_percent: float
    cost_ns_per_pixel: float
    cost_ns_per_event: float


@dataclass(frozen=True)
class EffectPlan:
    """Says which effects a sequence calls for; its string is a short table for people, :meth:`explain` a long one.

    Attributes:
        items: one for each candidate, in the order in which light and events meet them.
        effects_tolerance: by how much leaving out an effect may err in event count, rate or time, as a share.
        scale: what times of events were compared with.
        events: of ideal pixels, estimated for the whole sequence.
        duration_s: of the sequence.
        together: the chosen set at once; None where no candidate acts on events, or where noise would make more events
            than are worth simulating.
        kept: effects that were given by name and so are no candidates.
    """

    items: tuple[PlannedEffect, ...]
    effects_tolerance: float
    scale: TimeScale
    events: float
    duration_s: float
    together: SetForecast | None
    kept: Effects

    @property
    def effects(self) -> Effects:
        """Return the effects called for and those kept; other candidates are switched off, so no sensor brings them
        back."""
        chosen = {item.effect.name: item.effect for item in self.items if item.called_for}
        off = {item.effect.name for item in self.items} - chosen.keys()
        return self.kept.with_defaults(Effects.of(chosen.values())).without(off)

    def describe(self) -> dict[str, object]:
        """Return the plan in JSON's types, for meta.json: what was found of each effect and of the set."""
        items = [{**asdict(item), "effect": item.effect.name} for item in self.items]
        return {
            "effects_tolerance": self.effects_tolerance,
            **asdict(self.scale),
            "events": self.events,
            "kept": self.kept.describe(),
            "effects": [_without_nan({**item, **item.pop("omission")}) for item in items],
            "together": None if self.together is None else _without_nan(asdict(self.together)),
        }

    def explain(self) -> str:
        """Return the table with all that was found and seen, and what its columns mean."""
        return "\n".join([*_table(self, long=True), "", *_wrapped(_summary(self)), "", *_wrapped(_notes(self))])

    def _repr_html_(self) -> str:
        rows = [_cells(item, long=False) for item in self.items]
        below = "".join(f"<div>{html.escape(line)}</div>" for line in _summary(self))
        return html_table("EffectPlan", rows, heads=_HEADS, below=below)

    def __str__(self) -> str:
        return "\n".join([*_table(self, long=False), "", *_wrapped(_summary(self))])


def _without_nan(item: dict[str, object]) -> dict[str, object]:
    """Return the same with None for NaN, which JSON lacks."""
    return {
        name: _without_nan(value) if isinstance(value, dict) else None if value != value else value
        for name, value in item.items()
    }


def _table(plan: EffectPlan, *, long: bool) -> list[str]:
    """Write one row an effect, and in the long table what was seen of the sequence below it."""
    rows = [_HEADS + (_MORE_HEADS if long else ()), *(_cells(item, long=long) for item in plan.items)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [_line(rows[0], widths)]
    for item, row in zip(plan.items, rows[1:], strict=True):
        lines.append(_line(row, widths))
        if long:
            lines += wrap(item.observation, _WIDTH, initial_indent="    ", subsequent_indent="    ")
    return lines


def _summary(plan: EffectPlan) -> list[str]:
    """Say what is called for, and what the set does."""
    called = [item.effect.name for item in plan.items if item.called_for]
    kept = f", next to what was given: {', '.join(effect.name for effect in plan.kept)}" if plan.kept else ""
    lines = [
        f"Called for at a tolerance of {100 * plan.effects_tolerance:g} %: {', '.join(called) or 'none'}{kept}.",
    ]
    together = plan.together
    if together is None:
        if any(item.effect.name != "aps" for item in plan.items):
            lines.append("The set was not run as a whole: its noise would make too many events.")
        return lines
    lines.append(f"Together: about {together.events:,.0f} events; ideal pixels: {plan.events:,.0f}.")
    where = (
        f"{together.held_out:,} other pixels"
        if together.held_out
        else "the same pixels (the sensor has too few others)"
    )
    if together.chosen == together.candidates:
        lines.append("These are all of the candidates that act on events.")
        return lines
    explained = (
        "there is no difference" if math.isnan(together.explained_percent) else _share_of(together.explained_percent)
    )
    cost = "" if math.isnan(together.cost_percent) else f" at {together.cost_percent:.0f} % of the cost"
    left = together.omission
    lines.append(
        f"These {together.chosen} of {together.candidates} effects on events: {explained}{cost}. "
        f"Compared with all of them on {where}, the events err by {_percent(left.count_percent)} in count, "
        f"{_percent(left.rate_percent)} in rate and {_percent(left.time_percent)} in time."
    )
    if left.worst_percent > 100 * plan.effects_tolerance:
        lines.append("That is above the tolerance, though on the pixels of the choice it was not: they are a sample.")
    return lines


def _share_of(percent: float) -> str:
    return f"{percent:.1f} % of the difference"


def _notes(plan: EffectPlan) -> list[str]:
    """Say what the columns mean."""
    tolerance, scale = f"{100 * plan.effects_tolerance:g} %", plan.scale
    return [
        f"Of each effect left out alone, compared with ideal pixels, in {plan.duration_s:g} s with about "
        f"{plan.events:,.0f} events; called for above {tolerance} of count, rate or time, or (with others) "
        f"where the set would else err by more, compared with all candidates. All shares are of the larger "
        "one of both streams.",
        "Count: events without the effect minus those with it. Rate: the same of each pixel and polarity, added up "
        "without signs. Time: the mean shift of an event, as a share of the median interval between events of a pixel, "
        f"{time_text(scale.interval_us)}; shifts below {time_text(scale.sampling_error_us)} count as none, because the "
        "sampling in time errs as much.",
        f"Missing, spurious: events without a partner within {time_text(scale.window_us)}. Cost: of a pixel of a "
        "keyframe, of an event, or of a pixel of an intensity frame. Frames: pixels off by more than one grey value of "
        f"8 bits; called for above {tolerance}, or where that share of the pixels moves by half a pixel in the "
        "exposure.",
        "Difference: Victor and Purpura's distance between the events with all candidates and those with none, or with "
        "the set. Neither it nor its cost has frames in it.",
    ]


def _wrapped(paragraphs: Sequence[str]) -> list[str]:
    return [line for paragraph in paragraphs for line in wrap(paragraph, _WIDTH)]


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    name, called, *numbers = (
        cell.ljust(w) if i < 2 else cell.rjust(w) for i, (cell, w) in enumerate(zip(cells, widths, strict=True))
    )
    return "  ".join([name, called, *numbers]).rstrip()


def _cells(item: PlannedEffect, *, long: bool) -> tuple[str, ...]:
    start = (item.effect.name, _called(item))
    omission, cost = item.omission, _cost(item)
    if not math.isnan(item.frame_change_percent):
        frames = (*start, "-", "-", f"{_percent(item.frame_change_percent)} of frames")
        return (*frames, "-", "-", "-", cost) if long else frames
    errors = (*start, *map(_percent, (omission.count_percent, omission.rate_percent, omission.time_percent)))
    if not long:
        return errors
    shift = "-" if math.isnan(omission.median_us) else f"{time_text(omission.median_us)} / {time_text(omission.p99_us)}"
    sign = ("-" if omission.count_percent < 0 else "+") if abs(omission.count_percent) >= 0.01 else ""
    signed = (*start, sign + errors[2], *errors[3:])
    return (*signed, _percent(omission.missing_percent), _percent(omission.spurious_percent), shift, cost)


def _called(item: PlannedEffect) -> str:
    if item.with_others:
        return "with others"
    return "yes" if item.called_for else "no"


def _percent(value: float) -> str:
    """Return a percentage as text, without a sign."""
    size = abs(value)
    if 0 < size < 0.01:
        return "< 0.01 %"
    return f"{size:.0f} %" if size >= 9.95 or size == 0 else f"{size:.2g} %"


def _cost(item: PlannedEffect) -> str:
    ns, unit = item.cost_ns_per_event, "event"
    if math.isnan(ns):
        ns, unit = item.cost_ns_per_pixel, "pixel"
    if math.isnan(ns):
        return "-"
    return f"{time_text(ns * 1e-3)}/{unit}" if ns >= 1000 else f"{three_digits(ns)} ns/{unit}"
