"""The command line's parser with all its arguments, which ``make_parser`` adds only when they are needed."""

from __future__ import annotations

import argparse

from davis_rs.cli.main import make_parser
from davis_rs.cli.parser import Parser


def whole_parser() -> Parser:
    """All commands, and theirs in turn."""
    parser = make_parser()
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
