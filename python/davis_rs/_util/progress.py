"""Shows the progress of long work: a bar in a terminal, a plain line now and then in a pipe or a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from .terminal_text import printable, tell

LINE_EVERY_S = 60.0
"""How often a line is written where there is no terminal."""

_LAYOUT = "{desc}: {percentage:3.0f}%|{bar}| {n:.4g}/{total:.4g}{unit} [{elapsed}<{remaining}, {speed}{postfix}]"

_Item = TypeVar("_Item")


class Progress:
    """Counts how far a piece of work is; shows nothing.

    Attributes:
        done, total: in the work's own unit; ``total`` may be corrected on the way.
    """

    def __init__(self, total: float) -> None:
        self.done, self.total = 0.0, total

    def to(self, done: float, note: str = "") -> None:
        """Shows how much is done by now, with a note."""
        self.done = done
        self._show(note)

    def advance(self, step: float = 1.0) -> None:
        """Adds to what is done."""
        self.to(self.done + step)

    def _show(self, note: str) -> None:
        """Show nothing."""


@contextmanager
def progress(what: str, total: float, *, unit: str = "", start: float = 0.0, show: bool = True) -> Iterator[Progress]:
    """Show a bar on standard error: ``with progress("reading", total) as bar: ... bar.to(done)``.

    Args:
        what: is done.
        total, unit: how much of it, and in what.
        start: how much of it is done already.
        show: False for silence.
    """
    what = printable(what)
    if not show:
        yield Progress(total)
    elif sys.stderr.isatty():
        bar = _Bar(what, total, unit, start)
        try:
            yield bar
        finally:
            bar.close()
    else:
        yield _Lines(what, total, unit, start)


def each(items: Iterable[_Item], what: str, total: int, *, unit: str = "", show: bool = True) -> Iterator[_Item]:
    """Yield the items, one after the other, with a bar that counts them."""
    with progress(what, total, unit=unit, show=show) as bar:
        for item in items:
            yield item
            bar.advance()


def say(text: str) -> None:
    """Write a line to standard error, above a bar that may be there."""
    if _shown:
        _shown[-1].say(printable(text, lines=True))
    else:
        tell(text, file=sys.stderr)


def speed_of(done: float, seconds: float, unit: str) -> str:
    """Write a speed to two digits however slow: 0.0043 s/s."""
    if done <= 0 or seconds <= 0:
        return f"?{unit}/s"
    rate = done / seconds
    return f"{rate:.2g}{unit}/s" if rate < 100 else f"{rate:,.0f}{unit}/s"


class _Bar(Progress):
    """Shows a bar of tqdm's."""

    def __init__(self, what: str, total: float, unit: str, start: float) -> None:
        from tqdm import tqdm

        class Bar(tqdm):  # type: ignore[misc]
            @property
            def format_dict(self) -> dict[str, Any]:
                known: dict[str, Any] = super().format_dict
                known["speed"] = speed_of(self.n - self.initial, known["elapsed"], self.unit)
                return known

        super().__init__(total)
        self.done = start
        unit = f" {unit}" if unit else ""
        self._bar = Bar(total=total, desc=what, unit=unit, initial=start, bar_format=_LAYOUT, file=sys.stderr)
        _shown.append(self)

    def _show(self, note: str) -> None:
        self._bar.total = self.total
        if note:
            self._bar.set_postfix_str(printable(note), refresh=False)
        self._bar.update(self.done - self._bar.n)

    def say(self, text: str) -> None:
        """Write a line above it."""
        self._bar.write(text, file=sys.stderr)

    def close(self) -> None:
        """Leave the bar as it is, and go on below it."""
        _shown.remove(self)
        self._bar.total = self.total
        self._bar.refresh()
        self._bar.close()


_shown: list[_Bar] = []


class _Lines(Progress):
    """Shows a line a minute."""

    def __init__(self, what: str, total: float, unit: str, start: float) -> None:
        super().__init__(total)
        self._what, self._unit = what, f" {unit}" if unit else ""
        self.done = self._start = start
        self._began = self._said = time.monotonic()

    def _show(self, note: str) -> None:
        now = time.monotonic()
        if now - self._said < LINE_EVERY_S:
            return
        self._said = now
        speed = speed_of(self.done - self._start, now - self._began, self._unit)
        percent = 100 * self.done / self.total if self.total else 100.0
        more = f", {note}" if note else ""
        tell(
            f"{self._what}: {percent:.0f} %, {self.done:.4g} of {self.total:.4g}{self._unit}, {speed}{more}",
            file=sys.stderr,
            flush=True,
        )
