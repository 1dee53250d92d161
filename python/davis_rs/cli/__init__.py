"""Runs the command line: davis-rs.

``main`` has the list of commands and what becomes of errors. When a command is called, its module adds its options,
those of declared settings by ``settings_options``.

Its first lines see to Ctrl-C, before anything is imported that takes time: ``ctrl_c`` says why.
"""

import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    import signal
else:
    import _signal as signal  # a part of Python itself; the module signal makes its enumerations first


def leave_at_once(*_: object) -> None:
    """End the process. This is what Ctrl-C does while the command line is imported: nothing has been begun."""
    os.write(2, b"davis-rs: stopped by Ctrl-C\n")
    os._exit(130)


# If Python was started for it, by its script or by -m, and may be interrupted. Other programs have their own Ctrl-C.
if (
    os.path.basename(sys.argv[0]) == "davis-rs" or (sys.argv[0] == "-m" and "davis_rs.cli" in sys.orig_argv)
) and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, leave_at_once)

from .main import main  # noqa: E402

__all__ = ["main"]
