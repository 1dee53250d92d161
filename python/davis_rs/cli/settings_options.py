"""Adds the options of the command line that follow from the declarations of settings, and reads them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Mapping
from typing import Any

from .._util.argument_checks import parse_roi, parse_size
from .._util.argument_error import ArgumentError
from .._util.former_names import is_now
from .._util.progress import say
from ..simulation.settings import Setting, Settings, settings_of
from .common import unnamed

_FORMS: Mapping[str, Callable[[str], object]] = {"size": parse_size, "roi": parse_roi}
"""What refuses a text that a setting cannot be, so that this is told before anything is read."""


def add_settings(
    parser: argparse.ArgumentParser, declaration: type[Settings], *, only: Collection[str] | None = None
) -> None:
    """Add an option for each setting that can be given as text, under the headings that it declares.

    Options that are not given leave nothing in the namespace: their defaults are the declaration's.

    Args:
        only: names of the settings to add; all by default.
    """
    groups: dict[str, argparse._ArgumentGroup] = {}
    for setting in settings_of(declaration).values():
        if setting.kind is None or (only is not None and setting.name not in only):
            continue
        heading = setting.declared.group
        if heading not in groups:
            groups[heading] = parser.add_argument_group(heading)
        _add_option(groups[heading], setting)


def given_settings(options: argparse.Namespace, declaration: type[Settings]) -> dict[str, Any]:
    """Return the settings that the options give, by name."""
    return {name: getattr(options, name) for name in settings_of(declaration) if hasattr(options, name)}


def _add_option(group: argparse._ArgumentGroup, setting: Setting) -> None:
    declared = setting.declared
    default = declared.default_help if declared.default is None else str(declared.default)
    text = f"{declared.help}{f' (default: {default})' if default else ''}".replace("%", "%%")
    common: dict[str, Any] = {"dest": setting.name, "default": argparse.SUPPRESS}
    if setting.kind is bool:
        group.add_argument(setting.option, action=argparse.BooleanOptionalAction, help=text, **common)
    elif setting.kind is list:
        form = f"{declared.help}; may be given several times{f' (default: {default})' if default else ''}"
        names = (setting.option, f"{setting.option}s")
        group.add_argument(*names, action="append", metavar=declared.metavar, help=form.replace("%", "%%"), **common)
    else:
        if declared.former_name:
            former = "--" + declared.former_name.replace("_", "-")  # before the present one, which messages name
            group.add_argument(
                former,
                action=_FormerOption,
                type=_reader(setting),
                const=setting.option,
                help=argparse.SUPPRESS,
                **common,
            )
        option = group.add_argument(
            setting.option, type=_reader(setting), metavar=_metavar(setting), help=text, **common
        )
        if declared.choices:
            # What the shell's completion offers, by argcomplete's convention. argparse's own choices would refuse a
            # value in other words than Python and plans do.
            option.completer = lambda **_: declared.choices  # type: ignore[attr-defined]


class _FormerOption(argparse.Action):
    """Takes a setting by its former option, and says the present one, its ``const``."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, value: object, option: str | None = None
    ) -> None:
        say(f"davis-rs: warning: {is_now(str(option), self.const)}")
        setattr(namespace, self.dest, value)


def _metavar(setting: Setting) -> str | None:
    choices = setting.declared.choices
    return setting.declared.metavar or ("{" + ",".join(choices) + "}" if choices else None)


def _reader(setting: Setting) -> Callable[[str], Any]:
    """Make what reads an option's text, or refuses it; argparse's message begins with the option."""
    kind = setting.kind or str

    def read(text: str) -> Any:
        try:
            value = text if text in setting.declared.words else kind(text)
        except ValueError:
            wanted = ", or ".join(["an integer" if kind is int else "a number", *setting.declared.words])
            raise argparse.ArgumentTypeError(f"must be {wanted}, got {text!r}") from None
        try:
            setting.check(value)
            if setting.name in _FORMS:
                _FORMS[setting.name](value)
        except ArgumentError as error:
            raise argparse.ArgumentTypeError(unnamed(error)) from None
        return value

    return read
