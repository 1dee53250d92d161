"""The command line: davis-rs settings."""

from __future__ import annotations

import argparse

from ..settings import FolderSettings, Setting, settings_of


def add_settings(table: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    table.description = (
        "List all settings of a simulation: option of the command line, key of a plan, argument of Python."
    )
    table.set_defaults(run=_settings)


def _settings(_: argparse.Namespace) -> int:
    print(settings_markdown())
    return 0


def settings_markdown() -> str:
    """One table for each group of settings."""
    groups: dict[str, list[Setting]] = {}
    for setting in settings_of(FolderSettings).values():
        groups.setdefault(setting.declared.group, []).append(setting)
    return "\n\n".join(_table(heading, settings) for heading, settings in groups.items())


def _table(heading: str, settings: list[Setting]) -> str:
    rows = [f"### {heading[0].upper()}{heading[1:].partition(' (docs')[0]}", ""]
    rows += ["| option, plan key | Python | values | default | |", "|---|---|---|---|---|"]
    rows += [_row(setting) for setting in settings]
    return "\n".join(rows)


def _row(setting: Setting) -> str:
    one = setting.declared
    option = "-" if setting.kind is None else f"`{setting.option}`"
    default = one.default_help if one.default is None else str(one.default)
    values = " ".join(part for part in (setting.range_text, one.unit) if part)
    cells = (option, f"`{setting.name}`", values, default or "not given", one.help)
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"
