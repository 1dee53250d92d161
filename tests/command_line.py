"""davis-rs as a user runs it, in this process: to start another one takes longer than most of what is tested."""

from __future__ import annotations

import io
import sys
import warnings
from contextlib import redirect_stderr, redirect_stdout
from subprocess import CompletedProcess
from unittest import mock

from davis_rs.cli.main import main


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
