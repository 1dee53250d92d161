"""Documents of the repository's root as pages of the site, and links between them and those in ``docs``.

In the repository a document names another by its path. The same link must lead to that document's page on the site.
Links to other files, such as a script, let readers download that file.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils.nodes import Node
from docutils.utils import new_document
from myst_parser.sphinx_ import Parser
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

DOCS = Path(__file__).resolve().parents[1]
ROOT = DOCS.parent
PAGES = {
    ROOT / "README.md": DOCS / "start.rst",
    **{
        ROOT / f"{name.upper()}.md": DOCS / "project" / f"{name}.rst"
        for name in ("architecture", "changelog", "contributing", "security")
    },
}
"""Documents in the root, and the page of the site that each of them is."""

LINK = re.compile(r"(\]\()(?!\w+:|#)([^)#\s]+)")


class FromRepository(SphinxDirective):
    """``.. from-repository:: README.md``: what that document says."""

    required_arguments = 1

    def run(self) -> list[Node]:
        """Its nodes."""
        path = ROOT / self.arguments[0]
        self.env.note_dependency(path)
        document = new_document(str(path), self.state.document.settings)
        Parser().parse(for_the_site(path.read_text(), path, Path(self.env.doc2path(self.env.docname))), document)
        return list(document.children)


def for_the_site(text: str, source: Path, page: Path) -> str:
    """Its links as the page needs them."""

    def link(found: re.Match[str]) -> str:
        target = (source.parent / found[2]).resolve()
        return found[1] + relative(PAGES.get(target, target), page.parent)

    return LINK.sub(link, text)


def relative(target: Path, folder: Path) -> str:
    import os

    return Path(os.path.relpath(target, folder)).as_posix()


def rewrite(app: Sphinx, name: str, content: list[str]) -> None:
    """Links of a document in ``docs``."""
    path = Path(app.env.doc2path(name))
    if path.suffix == ".md":
        content[0] = for_the_site(content[0], path, path)


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("from-repository", FromRepository)
    app.connect("source-read", rewrite)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
