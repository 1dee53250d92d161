"""The parsers of the commands with all their arguments, which ``make_parser`` adds only when they are needed.

Each is a function of this module, for the pages in ``docs/commands``: ``hard_cases()`` is the parser of ``hard-cases``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

from davis_rs.cli.main import COMMANDS, make_parser
from davis_rs.cli.parser import Parser


def __getattr__(name: str) -> Callable[[], argparse.ArgumentParser]:
    """The function that makes the parser of a command."""
    command = name.replace("_", "-")
    if command not in COMMANDS:
        raise AttributeError(name)
    return lambda: whole_parser(command)


def whole_parser(command: str) -> argparse.ArgumentParser:
    """One command, and its own in turn."""
    (commands,) = (action for action in make_parser()._actions if isinstance(action, argparse._SubParsersAction))
    parser: argparse.ArgumentParser = commands.choices[command]
    fill(parser)
    return parser


def fill(parser: argparse.ArgumentParser) -> None:
    if isinstance(parser, Parser):
        parser.fill()
    for action in parser._actions:
        if action.default == []:
            action.default = None  # an option that may be given several times: the page would say "default: []"
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                fill(command)
