"""The site has a page for each command, with an example that the command takes. Sphinx is not needed."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from davis_rs.cli.main import COMMANDS, make_parser

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = {path.stem: path.read_text() for path in sorted((DOCS / "commands").glob("*.rst"))}


def test_each_command_has_a_page_in_the_list() -> None:
    """And no page is of a command that is gone; the list says of each what ``--help`` says."""
    assert set(PAGES) == set(COMMANDS)
    listed = re.findall(r":doc:`(\S+) <commands/(\S+)>`\n +- (.+)", (DOCS / "command_line.rst").read_text())
    assert listed == [(name, name, summary) for name, (_, summary) in COMMANDS.items()]
    assert re.findall(r"^   commands/(\S+)$", (DOCS / "command_line.rst").read_text(), re.M) == list(COMMANDS)


@pytest.mark.parametrize("name", PAGES)
def test_a_page_has_an_example_that_the_command_takes(name: str) -> None:
    """Nothing is run; a wrong option or value ends the parser. The page's pictures are there."""
    page = PAGES[name]
    lines = [shlex.split(line.split(" > ")[0]) for line in re.findall(r"^ +\$ davis-rs (.+)$", page, re.M)]
    assert any(line[0] == name for line in lines)
    for line in lines:
        make_parser().parse_args(line)
    assert f":func: {name.replace('-', '_')}\n" in page
    for picture in re.findall(r"figure:: (\S+)", page):
        assert (DOCS / "commands" / picture).is_file()
