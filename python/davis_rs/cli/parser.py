"""argparse, with errors of one line, and with commands that are set up when they are used."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from ..close_names import did_you_mean


class Parser(argparse.ArgumentParser):
    """An argument parser that adds its arguments when it is used.

    So only the command that is called imports what it needs, and ``davis-rs --help`` needs next to nothing.

    Args:
        fill: adds the arguments; called once, before the first arguments are read.

    Attributes:
        commands: the parsers of its commands, by name.
    """

    def __init__(self, *arguments: Any, fill: Callable[[argparse.ArgumentParser], None] | None = None, **more: Any):
        super().__init__(*arguments, **more)
        self._fill = fill
        self.commands: dict[str, Parser] = {}

    def fill(self) -> None:
        """Add the arguments, if that is still to be done."""
        fill, self._fill = self._fill, None
        if fill is not None:
            fill(self)

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        self.fill()
        values, unknown = super().parse_known_args(args, namespace)
        if unknown:  # said here, because only the command's own parser knows its options
            options = [option for action in self._actions for option in action.option_strings]
            named = next((given for given in unknown if given.startswith("--")), "")
            self.error(f"unrecognized arguments: {' '.join(unknown)}{did_you_mean(named.split('=')[0], options)}")
        return values, unknown

    def error(self, message: str) -> NoReturn:
        """One line in place of the whole usage."""
        self.exit(2, f"davis-rs: error: {message} (see {self.prog} --help)\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            names = [str(choice) for choice in action.choices]
            what = "there is no such command" if isinstance(action, argparse._SubParsersAction) else "invalid choice"
            listed = f"{what}: {value}{did_you_mean(str(value), names)} (choose from {', '.join(names)})"
            raise argparse.ArgumentError(None if what.startswith("there") else action, listed)
