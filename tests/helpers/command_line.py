"""davis-rs as a user runs it, in this process: to start another one takes longer than most of what is tested."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import warnings
from contextlib import redirect_stderr, redirect_stdout
from subprocess import CompletedProcess
from unittest import mock

from davis_rs.cli.main import main

SMALL = ("--rays-per-pixel", 1, "--size", "60x45")
"""Options of a simulation that is quick, for what the size of the sensor changes nothing of."""


def davis_rs(*arguments: object) -> CompletedProcess[str]:
    """Run a command; what Mitsuba and other libraries write past Python's own streams is not caught.

    A warning of ours is a line, as it is for users; all others are errors, as in all tests.
    """
    words = [str(one) for one in arguments]
    with (
        redirect_stdout(io.StringIO()) as out,
        redirect_stderr(io.StringIO()) as err,
        mock.patch.object(sys, "argv", ["davis-rs", *words]),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("always", UserWarning)
        try:
            status = main()
        except SystemExit as left:
            status = left.code if isinstance(left.code, int) else int(left.code is not None)
    return CompletedProcess(words, status, out.getvalue(), err.getvalue())


def in_own_process(*arguments: object, **environment: str) -> CompletedProcess[str]:
    """Run a command in a process of its own, with environment variables."""
    command = [sys.executable, "-m", "davis_rs.cli", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, **environment}, timeout=300, check=False
    )
