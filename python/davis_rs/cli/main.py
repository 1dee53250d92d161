"""Runs the command line: its commands, and what becomes of errors."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module

from .._util.argument_error import Argument, NamesArguments, in_python, told
from .._util.progress import say
from .._util.terminal_text import tell
from . import leave_at_once
from .ctrl_c import exit_status
from .parser import Parser

COMMANDS = {
    "simulate": ("simulate", "simulate a scene into a dataset folder"),
    "frames": ("frames", "turn a video, images or arrays into events"),
    "sequence": ("simulate", "simulate a sequence of the public dataset"),
    "sequences": ("sequences", "list the public dataset's sequences: the paper's table next to our own"),
    "sensors": ("sensors", "list the sensors that are known, or show one as a file"),
    "plan": ("plan", "say which effects of a sensor matter in a scene"),
    "generate": ("generate", "simulate many sequences with randomised parameters"),
    "verify": ("generate", "compare generated sequences with their manifest"),
    "accuracy": ("accuracy", "measure what accuracy costs in time on a scene"),
    "devices": ("usb", "list the cameras that are plugged in"),
    "record": ("usb", "record a camera"),
    "decode": ("usb", "decode a recording: of record, or AEDAT 2.0, 3.1, 4"),
    "convert": ("files", "convert events from one file format to another"),
    "filter": ("filter", "leave out events that are noise or flicker"),
    "info": ("files", "sum up an event file or a dataset folder"),
    "compare": ("compare", "print the statistics of two streams side by side, such as a recording and a simulation"),
    "reproduce": ("reproduce", "simulate a recording from its own frames, and compare both"),
    "calibrate": ("calibrate", "calibrate a camera, a hand-eye transform, a camera and an IMU, or a sensor"),
    "check": ("look", "check that the events and the images of a dataset agree"),
    "view": (
        "look",
        "look at a dataset, an event file or a recording: a picture, a video, an interactive page, or Rerun",
    ),
    "hard-cases": ("hard_cases", "measure the presets on scenes in which sampling is easily wrong"),
}
"""For each command, the module in this package that defines ``add_COMMAND(parser)``, and a line on what it does."""

_DEBUG = "show the traceback of an error"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status.

    That is 0, 1 for a failure or a check that does not hold, 2 for what is refused before anything is done (options
    that are wrong, a run that would have too much noise), 130 after Ctrl-C.
    """
    return exit_status(partial(_status, arguments), say)


def _status(arguments: Sequence[str] | None) -> int:
    debug = "--debug" in (sys.argv[1:] if arguments is None else arguments)
    options = argparse.Namespace()
    try:
        status = _run(arguments, options)
        sys.stdout.flush()  # here, where a reader that is gone can still be told from an error
        return status
    except BrokenPipeError:
        # Nobody reads any more. What is left in the buffer has nowhere to go when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        if _interrupted(error):
            raise KeyboardInterrupt from error
        if debug:
            tell(traceback.format_exc(), file=sys.stderr, end="")
        tell(f"davis-rs: error: {_in_a_line(error, options, debug)}", file=sys.stderr)
        return 2 if _refuses_noise(error) else 1


def _run(arguments: Sequence[str] | None, options: argparse.Namespace) -> int:
    parser = make_parser()
    if "_ARGCOMPLETE" in os.environ:  # the shell asks what could come next
        import argcomplete

        signal.signal(signal.SIGINT, leave_at_once)  # argcomplete goes on after a KeyboardInterrupt
        for name in os.environ["COMP_LINE"].split():
            if name in parser.commands:
                parser.commands[name].fill()  # argcomplete has to find the arguments there
        argcomplete.autocomplete(parser)
    parser.parse_args(arguments, options)
    warnings.showwarning = lambda message, *_: say(f"davis-rs: warning: {message}")
    run: Callable[[argparse.Namespace], int] = options.run
    return run(options)


def make_parser() -> Parser:
    """Make the parser of all commands, each of which is set up when it is used."""
    parser = Parser(
        prog="davis-rs",
        description="Simulate a DAVIS event camera, and read a real one.",
        formatter_class=partial(argparse.HelpFormatter, max_help_position=16),
    )
    parser.add_argument("--version", action=_VersionAction, nargs=0, help="show the version and leave")
    parser.add_argument("--debug", action="store_true", help=_DEBUG)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=Parser)
    for name, (module, does) in COMMANDS.items():
        parser.commands[name] = commands.add_parser(name, help=does, fill=_fill(name, module))
    return parser


def _fill(name: str, module: str) -> Callable[[argparse.ArgumentParser], None]:
    def fill(parser: argparse.ArgumentParser) -> None:
        getattr(import_module(f".{module}", __package__), f"add_{name.replace('-', '_')}")(parser)
        parser.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help=_DEBUG)

    return fill


class _VersionAction(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from .._core import __version__

        tell(f"davis-rs {__version__}")
        parser.exit()


def _in_a_line(error: Exception, options: argparse.Namespace, debug: bool) -> str:
    said = told(error, partial(_as_option, getattr(options, "written", {})))
    if isinstance(error, OSError) and error.strerror:
        said = said if isinstance(error, NamesArguments) else error.strerror
        return said if error.filename is None else f"{error.filename}: {said}"
    if isinstance(error, ValueError | OSError | ImportError):
        return said
    if isinstance(error, MemoryError):
        return f"there is not enough memory{f': {said}' if said else ''}"
    hint = "" if debug else "; --debug shows where"
    return f"unexpected {type(error).__name__}: {' '.join(said.split())}{hint}"


def _refuses_noise(error: Exception) -> bool:
    from ..simulation.noise_estimate import NoiseError

    return isinstance(error, NoiseError)


def _as_option(written: Mapping[str, str], argument: Argument) -> str:
    """Write what the library calls an argument as its users do: --format, not format."""
    option = written.get(argument.name)
    if option is None:
        return in_python(argument)
    if argument.value == "False":
        return option.replace("--", "--no-", 1)
    return option if argument.value in ("", "True") else f"{option} {argument.value}"


def _interrupted(error: BaseException | None) -> bool:
    """Tell whether a Ctrl-C is behind an error: libraries that are being imported turn it into an ImportError."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False
