"""Extends argparse: errors of one line, and commands that are set up when they are used."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from .._util.close_names import did_you_mean

_REGIONS = ("--roi", "--quiet-region")
"""Options that are WIDTHxHEIGHT+LEFT+TOP in pixels."""


class Parser(argparse.ArgumentParser):
    """Parses arguments that are added when it is used; options are taken by their whole names.

    So only the command that is called imports what it needs, and ``davis-rs --help`` needs next to nothing.

    Args:
        fill: adds the arguments; called once, before the first arguments are read.

    Attributes:
        commands: the parsers of its commands, by name.
    """

    def __init__(self, *, fill: Callable[[argparse.ArgumentParser], None] | None = None, **more: Any):
        super().__init__(allow_abbrev=False, **more)
        self._fill = fill
        self.commands: dict[str, Parser] = {}

    def fill(self) -> None:
        """Add the arguments, if that is still to be done."""
        fill, self._fill = self._fill, None
        if fill is not None:
            fill(self)

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        self.fill()
        # Each of its arguments by what the library calls it; a command's are put in the place of its parent's.
        self.set_defaults(written={action.dest: _written(action) for action in self._actions})
        self._refuse_corners(args or ())
        values, unknown = super().parse_known_args(args, namespace)
        if unknown:  # said here, because only the command's own parser knows its options
            named = next((given for given in unknown if given.startswith("--")), "").split("=")[0]
            self.error(f"unrecognized arguments: {' '.join(unknown)}{self._meant(named)}")
        return values, unknown

    def _refuse_corners(self, args: Sequence[str]) -> None:
        """Refuse a region by its corners, X0 Y0 X1 Y1, as some commands once took it; say its present form."""
        for option in {*_REGIONS} & {*args} & {*self._option_string_actions}:
            at = args.index(option) + 1
            corners = args[at : at + 4]
            if len(corners) == 4 and all(corner.isdecimal() for corner in corners):
                x0, y0, x1, y1 = map(int, corners)
                form = f"{x1 - x0}x{y1 - y0}+{x0}+{y0}" if x0 < x1 and y0 < y1 else "WIDTHxHEIGHT+LEFT+TOP"
                said = f"in place of the corners {' '.join(corners)} give size and place, {option} {form}"
                self.error(f"argument {option}: {said}")

    def _meant(self, option: str) -> str:
        options = [option for action in self._actions for option in action.option_strings if option.startswith("--")]
        effects: dict[str, str] = {}
        if "--effect" in options:
            from ..sensor.effects import EFFECTS

            effects = {name: f"--effect {name}=VALUE" for name in EFFECTS}
        return did_you_mean(option, options, effects) if option else ""

    def error(self, message: str) -> NoReturn:
        """Print one line in place of the whole usage."""
        self.exit(2, f"davis-rs: error: {message} (see {self.prog} --help)\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        names = [str(choice) for choice in action.choices]
        near = did_you_mean(str(value), names)
        if isinstance(action, argparse._SubParsersAction):
            # What has a line of help is for users.
            listed = ", ".join(choice.dest for choice in action._choices_actions)
            raise argparse.ArgumentError(None, f"there is no such command: {value}{near or f'; there are {listed}'}")
        raise argparse.ArgumentError(action, f"invalid choice: {value}{near} (choose from {', '.join(names)})")


def _written(action: argparse.Action) -> str:
    """Return how users write an argument."""
    options = [*(option for option in action.option_strings if option.startswith("--")), *action.option_strings]
    return options[0] if options else str(action.metavar or action.dest)
