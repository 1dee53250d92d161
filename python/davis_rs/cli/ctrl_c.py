"""Ends the command on Ctrl-C, from its first line to its last: one line, and exit status 130.

Three things are dangerous about the KeyboardInterrupt that Python raises by itself. Before :func:`main` runs nobody
catches it. A module that is being imported is left half made, and a library may take that for a broken installation,
panic or crash. And once the result stands, all that it can do is to print a traceback.

So it ends the process at once while the command line is imported; the first lines of this package see to that. Within a
command it waits for the end of an import, or of the command if that comes first. After a command it does nothing.
"""

from __future__ import annotations

import _thread
import signal
import sys
import time
from collections.abc import Callable
from types import FrameType

from . import leave_at_once

LINE = "davis-rs: stopped by Ctrl-C"

_PATIENCE_S = 0.01
"""How long a signal waits until it is tried again."""

_IMPORT = "<frozen importlib._bootstrap>"


def exit_status(run: Callable[[], int], say: Callable[[str], None]) -> int:
    """Return what ``run`` returns; after Ctrl-C 130, and a line is said.

    While a module is imported, Ctrl-C waits until it is whole. In the end it has its meaning of before; in davis-rs
    itself it has none any more, because the result stands.
    """
    before = signal.getsignal(signal.SIGINT)
    if not callable(before) or not _in_main_thread(before):
        return run()  # Ctrl-C is ignored, or another thread's
    over = waits = False
    outermost, thread = sys._getframe(), _thread.get_ident()
    hook = sys.unraisablehook

    def obey(_: int, frame: FrameType | None) -> None:
        nonlocal waits
        if over:
            return
        waits = _importing(frame, outermost)
        if waits:
            send_again(thread)
        else:
            raise KeyboardInterrupt

    def kept(unraisable: sys.UnraisableHookArgs) -> None:
        """Send Ctrl-C again where Python cannot raise it, but only print it: in a finaliser, or a callback of C."""
        nonlocal waits
        if isinstance(unraisable.exc_value, KeyboardInterrupt):
            waits = True
            send_again(thread)
        else:
            hook(unraisable)

    status = 130
    try:
        try:
            signal.signal(signal.SIGINT, obey)
            sys.unraisablehook = kept
            status = run()
            if waits and status != 130:  # the command was over before it was sent again, or has told of it by itself
                raise KeyboardInterrupt
        finally:
            over = True
    except KeyboardInterrupt:  # wherever it comes, also while an error is told
        over = True
        status = 130
        say(LINE)
    finally:
        sys.unraisablehook = hook
        signal.signal(signal.SIGINT, signal.SIG_IGN if before is leave_at_once else before)
    return status


def send_again(thread: int) -> None:
    """Send Ctrl-C to a thread in a moment, from another one that takes no lock, because any may be held here."""

    def send() -> None:
        time.sleep(_PATIENCE_S)
        signal.pthread_kill(thread, signal.SIGINT)  # unlike interrupt_main, it also ends a wait for the system

    _thread.start_new_thread(send, ())


def _importing(frame: FrameType | None, outermost: FrameType) -> bool:
    """Tell whether an import is under way within the command: one around it is that of a program that calls it."""
    while frame is not None and frame is not outermost:
        if frame.f_code.co_filename == _IMPORT:
            return True
        frame = frame.f_back
    return False


def _in_main_thread(handler: Callable[..., object]) -> bool:
    """Tell whether this is the thread in which signals are handled; where it is, its handler is set to what it is."""
    try:
        signal.signal(signal.SIGINT, handler)
    except ValueError:
        return False
    return True
