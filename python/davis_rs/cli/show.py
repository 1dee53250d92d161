"""Shows events in a browser as they come, for the commands that take ``--show``."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from types import TracebackType
from typing import TYPE_CHECKING

from .._util.progress import say

if TYPE_CHECKING:
    from ..events.arrays import EventArray
    from ..events.packet import Packet
    from ..inspection.live_view import LiveView


def add_output(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a command that simulates into a dataset folder."""
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="the folder to write")
    parser.add_argument("--overwrite", action="store_true", help="replace the dataset in DIR")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, only the last line")
    add_show(parser)


def add_show(parser: argparse.ArgumentParser) -> None:
    """Add the option that shows events as they come."""
    parser.add_argument(
        "--show", action="store_true", help="show the events in the browser as they come, on a page of this machine"
    )


class ShownEvents:
    """Shows events in a browser as they come, if asked for; a context manager.

    Args:
        title: of the page.
        wanted: whether anything is shown.
    """

    def __init__(self, title: str, *, wanted: bool) -> None:
        self._title, self._wanted = title, wanted
        self._stack = ExitStack()
        self._view: LiveView | None = None

    def add(self, events: EventArray, t_us: int, size: tuple[int, int]) -> None:
        """Show events of a sensor of (width, height) pixels; the page is opened with the first ones."""
        if not self._wanted:
            return
        if self._view is None:
            from ..inspection.live_view import LiveView

            self._view = self._stack.enter_context(LiveView(size, self._title))
            say(f"events are shown at {self._view.address}" + ("" if self._view.opened else ": open it in a browser"))
        self._view.add(events, t_us)

    def packet(self, packet: Packet, size: tuple[int, int]) -> None:
        """Show a packet."""
        self.add(packet.events, packet.end_us, size)

    def __enter__(self) -> ShownEvents:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc_value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stack.__exit__(exc_type, exc_value, traceback)
