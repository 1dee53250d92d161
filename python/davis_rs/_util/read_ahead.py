"""Prefetches an iterator in a background thread."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable, Iterator
from typing import TypeVar

_Item = TypeVar("_Item")

_PATIENCE_S = 0.1
_here = threading.local()
"""Of a thread that works ahead: ``over``, the event that says that nobody wants its items any more."""


class _Unwanted(Exception):
    """Ends a thread whose items nobody wants any more."""


def leave_if_unwanted() -> None:
    """End the making of an item in a thread of :func:`read_ahead` whose iterator is closed; do nothing elsewhere.

    For work that takes long before it yields: call it between its parts.
    """
    over: threading.Event | None = getattr(_here, "over", None)
    if over is not None and over.is_set():
        raise _Unwanted


def read_ahead(items: Iterable[_Item], *, most: int) -> Iterator[_Item]:
    """Yield the same items in the same order, made in another thread; its exceptions come out where the item would
    have.

    The thread ends when the iterator is closed or dropped.

    Args:
        most: how many items wait, so that memory stays bounded.
    """
    waiting: queue.Queue[tuple[_Item | None, BaseException | None]] = queue.Queue(most)
    over = threading.Event()

    def put(item: _Item | None, error: BaseException | None) -> bool:
        while not over.is_set():
            try:
                waiting.put((item, error), timeout=_PATIENCE_S)
                return True
            except queue.Full:
                continue
        return False

    def read() -> None:
        _here.over = over
        iterator = iter(items)
        try:
            for item in iterator:
                if not put(item, None):
                    return
            put(None, StopIteration())
        except BaseException as error:
            put(None, error)
        finally:
            close = getattr(iterator, "close", None)
            if close is not None:
                close()  # the file that a generator holds open

    thread = threading.Thread(target=read, name="davis_rs ahead", daemon=True)
    thread.start()
    try:
        while True:
            item, error = waiting.get()
            if isinstance(error, StopIteration):
                return
            if error is not None:
                raise error
            yield item  # type: ignore[misc]  # an item, where there is no error
    finally:
        over.set()
        thread.join()
