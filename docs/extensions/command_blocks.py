"""Blocks of commands, which Markdown indents without a language, in the colours of a shell."""

from __future__ import annotations

import shlex
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

PROGRAMS = ("apt-get", "cargo", "davis-rs", "git", "pip", "pytest", "python", "python3")


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("doctree-read", coloured)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def coloured(app: Sphinx, doctree: nodes.document) -> None:
    """A block with a prompt is a session, which has what a command prints; one without is commands."""
    for block in doctree.findall(nodes.literal_block):
        first = block.astext().split()[:1]
        if block.get("language", "none") not in ("none", "default", "text"):
            continue
        if first == ["$"]:
            block["language"] = "console"
        elif first and first[0] in PROGRAMS and all(map(is_shell, block.astext().splitlines())):
            block["language"] = "bash"


def is_shell(line: str) -> bool:
    """Whether a shell could read it; what is said of a command behind it may have an apostrophe."""
    try:
        shlex.split(line, comments=True)
    except ValueError:
        return False
    return True
