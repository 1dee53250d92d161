"""Defers SIGINT and SIGTERM to a safe point, for a graceful shutdown."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_NAMES = {int(signal.SIGINT): "Ctrl-C", int(signal.SIGTERM): "SIGTERM"}


@contextmanager
def stop_requests() -> Iterator[Callable[[], str]]:
    """Catch the first SIGINT or SIGTERM as a wish; the next one acts as it would have.

    Yields a function that returns who wished it, ``Ctrl-C`` or ``SIGTERM``; nobody so far: an empty text.
    """
    wishes: list[int] = []

    def wish(number: int, _: FrameType | None) -> None:
        wishes.append(number)
        signal.signal(number, before[number])

    try:
        before = {int(number): signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        for number in before:
            signal.signal(number, wish)
    except ValueError:  # not in the main thread: signals are the caller's
        yield lambda: ""
        return
    try:
        yield lambda: _NAMES[wishes[0]] if wishes else ""
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def interrupts_deferred() -> Iterator[None]:
    """Hold a Ctrl-C back until the end of the block.

    Where modules are being loaded: an extension whose initialisation meets a KeyboardInterrupt is half made, and the
    process then crashes, at once or when it ends; and where a process is started, which would miss what it is sent.
    """
    before = signal.getsignal(signal.SIGINT)
    in_main = threading.current_thread() is threading.main_thread()  # where alone Ctrl-C is raised
    if not in_main or not callable(before):
        yield
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            signal.raise_signal(signal.SIGINT)
