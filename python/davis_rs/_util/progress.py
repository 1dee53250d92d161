"""Shows the progress of long work: a bar in a terminal, a plain line now and then in a pipe or a log."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from .quantities import about
from .terminal_text import printable, tell

LINE_EVERY_S = 60.0
"""How often a line is written where there is no terminal."""

_LAYOUT = "{desc}: {percentage:3.0f}%|{bar}| {reached}/{all}{unit} [{elapsed}<{remaining}, {speed}{postfix}]"
_LAYOUT_WITHOUT_TOTAL = "{desc} [{elapsed}{postfix}]"

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
        """Add to what is done."""
        self.to(self.done + step)

    def begin(self, *, foretold: bool = False) -> None:
        """Say that the work itself begins now; what came before prepared it.

        Args:
            foretold: how long it will take has been said already.
        """

    def _show(self, note: str) -> None:
        """Show nothing."""


@contextmanager
def progress(
    task: str, total: float, *, unit: str = "", start: float = 0.0, show: bool = True, forecast: str | None = None
) -> Iterator[Progress]:
    """Show a bar on standard error: ``with progress("reading", total) as bar: ... bar.to(done)``.

    A bar is shown in a terminal and in a notebook. It stays when the work is over, unless it is inside of another bar,
    or nothing was done before an error.

    Args:
        task: what is done, such as ``reading``.
        total, unit: how much of it, and in what; a total of 0 shows no fraction until there is one.
        start: how much of it is done already.
        show: False for silence.
        forecast: what to add to the line that says how long the work will take, if that is long, such as how to make it
            shorter; None for no such line. Only for work that goes on evenly.
    """
    task = printable(task)
    if not show:
        yield Progress(total)
    elif sys.stderr.isatty() or _in_notebook():
        bar = _Bar(task, total, unit, start, forecast)
        try:
            yield bar
        except BaseException:
            bar.close(keep=bar.done > start)
            raise
        bar.close()
    else:
        yield _Lines(task, total, unit, start, forecast)


@contextmanager
def stage(task: str, *, show: bool = True) -> Iterator[None]:
    """Show on a bar without a total that something is being done, and for how long; it vanishes when that is over.

    Nothing is shown where there is neither a terminal nor a notebook.
    """
    if not show or not (sys.stderr.isatty() or _in_notebook()):
        yield
        return
    bar = _Bar(printable(task), 0, "", 0.0, None)
    try:
        yield
    finally:
        bar.close(keep=False)


def doing(task: str) -> None:
    """Say on the innermost bar, if one is shown, what is being done now.

    So a function deep in the library can tell of its steps, without a bar of its own and without being handed one. It
    stands there until the bar moves on, or something else is done.
    """
    if _shown:
        _shown[-1].note(task)


def each(items: Iterable[_Item], task: str, total: int, *, unit: str = "", show: bool = True) -> Iterator[_Item]:
    """Yield the items, one after the other, with a bar that counts them."""
    with progress(task, total, unit=unit, show=show) as bar:
        for item in items:
            yield item
            bar.advance()


def say(text: str) -> None:
    """Write a line to standard error, above a bar that may be there."""
    if _shown:
        _shown[-1].say(printable(text, lines=True))
    else:
        tell(text, file=sys.stderr)


def amount(value: float) -> str:
    """Write how much is done, or how much there is, never with an exponent: 0.5057, 12.5, 413,200."""
    return f"{value:,.0f}" if value >= 1000 else f"{value:.4g}"


def speed_of(done: float, seconds: float, unit: str) -> str:
    """Write a speed to two digits however slow: 0.0043 s/s."""
    if done <= 0 or seconds <= 0:
        return f"?{unit}/s"
    rate = done / seconds
    return f"{rate:.2g}{unit}/s" if rate < 100 else f"{rate:,.0f}{unit}/s"


class Forecast:
    """Foretells how long work will take in all, from how it goes at first.

    Work may come in batches: nothing for some seconds, then many steps at once. In the middle of a batch the speed is
    not known, so it is taken from the end of one batch to the end of another, which show by a step that comes late.
    The first batch does not count, because it takes longer than others.

    Args:
        total: work in all.
        after_s: how long the work is watched at least.
        above_s: a shorter time in all is worth no line.
    """

    _LATE_S, _SMOOTH_S, _LONGEST_S = 0.2, 1.0, 10.0

    def __init__(self, total: float, *, after_s: float = 3.0, above_s: float = 20.0) -> None:
        self._total, self._after_s, self._above_s = total, after_s, above_s
        self._first: tuple[float, float] | None = None
        self._last, self._began_s = (0.0, 0.0), 0.0

    def seconds(self, done: float, seconds: float) -> float | None:
        """Return how long the work will take in all; None if that is not known yet, or short.

        Args:
            done: how much is done by now.
            seconds: since the work began; never less than at the call before.
        """
        last, self._last = self._last, (done, seconds)
        late = seconds - last[1] >= self._LATE_S
        if self._first is None:
            if late and last[0] > 0:
                self._first = last
            elif last[0] == 0:
                self._began_s = seconds
            elif seconds - self._began_s >= self._SMOOTH_S:
                self._first = done, seconds
            return None
        first_done, first_s = self._first
        judged_done, judged_s = last if late else (done, seconds)
        if not late and seconds - first_s < self._LONGEST_S:
            return None
        if judged_s - first_s < self._after_s or judged_done <= first_done:
            return None
        in_all_s = first_s + (self._total - first_done) * (judged_s - first_s) / (judged_done - first_done)
        return in_all_s if in_all_s > self._above_s else None


class _Foretold:
    """Says once how long the work will take, as soon as that is known, if it is long.

    Args:
        task: what is done.
        total: work in all.
        advice: what to add to the line; None for no line.
    """

    def __init__(self, task: str, total: float, advice: str | None) -> None:
        self._task, self._advice = task, advice
        self._forecast = None if advice is None else Forecast(total)
        self._began = time.monotonic()

    def begin(self, *, foretold: bool) -> None:
        """Take the time from now on; what came before prepared the work. What is foretold is not said again."""
        self._began = time.monotonic()
        if foretold:
            self._forecast = None

    def to(self, done: float) -> None:
        """Take how much is done by now."""
        if self._forecast is None:
            return
        in_all_s = self._forecast.seconds(done, time.monotonic() - self._began)
        if in_all_s is not None:
            self._forecast = None
            say(f"{self._task} will take {about(in_all_s)}{f'; {self._advice}' if self._advice else ''}")


def _in_notebook() -> bool:
    """Tell whether cells of a notebook are being run, without importing IPython."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return shell is not None and "IPKernelApp" in shell.config


class _Bar(Progress):
    """Shows a bar of tqdm's, in a notebook one of its widgets if ipywidgets is there."""

    def __init__(self, task: str, total: float, unit: str, start: float, forecast: str | None) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that ipywidgets is not there
            from tqdm.auto import tqdm

        class Bar(tqdm):  # type: ignore[misc]
            @property
            def format_dict(self) -> dict[str, Any]:
                known: dict[str, Any] = super().format_dict
                known["speed"] = speed_of(self.n - self.initial, known["elapsed"], self.unit)
                known["reached"], known["all"] = amount(self.n), amount(self.total or 0)
                return known

        super().__init__(total)
        self.done = self._start = start
        self._foretold = _Foretold(task, total - start, forecast)
        unit = f" {unit}" if unit else ""
        self._bar = Bar(
            total=total or None,
            desc=task,
            unit=unit,
            initial=start,
            bar_format=_LAYOUT if total else _LAYOUT_WITHOUT_TOTAL,
            file=sys.stderr,
            leave=None,
            dynamic_ncols=True,
        )
        _shown.append(self)

    def _show(self, note: str) -> None:
        if self.total and not self._bar.total:
            self._bar.bar_format = _LAYOUT
        self._bar.total = self.total
        if note:
            self._bar.set_postfix_str(printable(note), refresh=False)
        if self._bar.n == self._start < self.done:
            self._bar.update(self.done - self._bar.n)
            self._bar.refresh()  # the first step shows at once
        else:
            self._bar.update(self.done - self._bar.n)
        self._foretold.to(self.done - self._start)

    def begin(self, *, foretold: bool = False) -> None:
        """Take the time from now on; what came before prepared the work."""
        self._foretold.begin(foretold=foretold)

    def note(self, task: str) -> None:
        """Say on it what is being done, at once."""
        self._bar.set_postfix_str(printable(task))

    def say(self, text: str) -> None:
        """Write a line above it."""
        self._bar.write(text, file=sys.stderr)

    def close(self, *, keep: bool = True) -> None:
        """Leave the bar as it is, and go on below it; or take it away."""
        _shown.remove(self)
        if not keep:
            self._bar.leave = False
        self._bar.total = self.total or None
        self._bar.refresh()
        self._bar.close()


_shown: list[_Bar] = []


class _Lines(Progress):
    """Shows a line a minute, and before them how long the work will take."""

    def __init__(self, task: str, total: float, unit: str, start: float, forecast: str | None) -> None:
        super().__init__(total)
        self._task, self._unit = task, f" {unit}" if unit else ""
        self.done = self._start = start
        self._began = self._said = time.monotonic()
        self._foretold = _Foretold(task, total - start, forecast)

    def begin(self, *, foretold: bool = False) -> None:
        """Take the time for a forecast from now on; what came before prepared the work."""
        self._foretold.begin(foretold=foretold)

    def _show(self, note: str) -> None:
        self._foretold.to(self.done - self._start)
        now = time.monotonic()
        if now - self._said < LINE_EVERY_S:
            return
        self._said = now
        speed = speed_of(self.done - self._start, now - self._began, self._unit)
        percent = 100 * self.done / self.total if self.total else 100.0
        more = f", {note}" if note else ""
        tell(
            f"{self._task}: {percent:.0f} %, {amount(self.done)} of {amount(self.total)}{self._unit}, {speed}{more}",
            file=sys.stderr,
            flush=True,
        )
