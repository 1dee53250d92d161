"""Prints the tables of docs/settings.md: python benches/settings_tables.py"""

from __future__ import annotations

from collections.abc import Mapping

from davis_rs.simulation.settings import Declared, FolderSettings, FrameFolderSettings, Setting, settings_of


def settings_markdown() -> str:
    """Return one table for each group of settings; those of ``davis-rs frames`` that no simulation has come last."""
    simulation, frames = settings_of(FolderSettings), settings_of(FrameFolderSettings)
    own = {name: setting for name, setting in frames.items() if setting.declared != _declared(simulation.get(name))}
    return f"{_tables(simulation)}\n\n## Settings of events from frames\n\n{_SHARED}\n\n{_tables(own)}"


_SHARED = (
    "`davis-rs frames`, `davis_rs.events_from_frames` and `davis_rs.frames_to_folder` take these, and of the settings "
    "above\n`--sensor`, the contrast thresholds, `--lux-per-luma`, `--start-phase`, `--seed`, `--threads`, "
    "`--signal-window` and `--image-gain`.\nThey are no keys of plans."
)


def _declared(setting: Setting | None) -> Declared | None:
    return None if setting is None else setting.declared


def _tables(chosen: Mapping[str, Setting]) -> str:
    groups: dict[str, list[Setting]] = {}
    for setting in chosen.values():
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


if __name__ == "__main__":
    print(settings_markdown())
