"""The modules of a Rust crate and which of them use which, read from its source files.

A module is a file. What a file uses is the file that defines the item: a name that an index file (``mod.rs``,
``lib.rs``) re-exports by ``pub use`` is followed to where it comes from, so that ``use crate::crossing::Frame`` counts
as a use of ``crossing::frame`` alone. Tests within files (``#[cfg(test)]``) may use anything and are left out.

It reads paths, not types: a method of a type of another module is no use unless a path names it. That is what an import
is, and all that is needed to see which file cannot be read without which.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

Module = tuple[str, ...]
"""The path of a module from the crate's root; the root itself is ()."""

_TOKEN = re.compile(
    r"""//[^\n]*|/\*.*?\*/|r(\#*)".*?"\1|"(?:\\.|[^"\\])*"|'(?:\\[^']+|[^'\\])'""",
    re.DOTALL,
)
_USE = re.compile(r"\b(pub(?:\([^)]*\))?\s+)?use\s+([^;]+);")
_PATH = re.compile(r"(?<![\w:])((?:crate|super|self|[a-z_][a-z0-9_]*)(?:\s*::\s*\w+)+)")


def bare(source: str) -> str:
    """The source without comments, strings and what is compiled for tests alone."""
    text = _TOKEN.sub(lambda token: " " if token[0].startswith("/") else '""', source)
    while found := re.search(r"#\s*\[\s*cfg\s*\(\s*test\s*\)\s*\]", text):
        text = text[: found.start()] + text[_item_end(text, found.end()) :]
    return text


def _item_end(text: str, start: int) -> int:
    """Where the item that begins at ``start`` ends: behind its semicolon, or behind its braces."""
    depth = 0
    for place in range(start, len(text)):
        depth += {"{": 1, "}": -1}.get(text[place], 0)
        if depth == 0 and text[place] in ";}":
            return place + 1
    return len(text)


def paths_of_use(tree: str) -> Iterator[tuple[str, ...]]:
    """The paths that a use tree names: ``a::{b, c::d as e}`` gives (a, b), (a, c, d)."""
    head, brace, rest = tree.strip().partition("{")
    names = [name.strip() for name in head.split("::") if name.strip()]
    if not brace:
        yield tuple(name.split(" as ")[0].split()[0] for name in names)
        return
    inner, depth, part = rest.rstrip()[:-1], 0, ""
    for sign in [*inner, ","]:
        depth += {"{": 1, "}": -1}.get(sign, 0)
        if sign == "," and depth == 0:
            if part.strip():
                yield from ((*names, *path) for path in paths_of_use(part))
            part = ""
        else:
            part += sign


class Crate:
    """The files of a crate.

    Args:
        root: the folder of ``lib.rs``.
    """

    def __init__(self, root: Path) -> None:
        self.files: dict[Module, Path] = {}
        for path in sorted(root.rglob("*.rs")):
            parts = path.relative_to(root).with_suffix("").parts
            self.files[parts[:-1] if parts[-1] in {"mod", "lib"} else parts] = path
        self._text = {module: bare(path.read_text()) for module, path in self.files.items()}
        self._exports: dict[Module, dict[str, tuple[str, ...]]] = {}
        for module, text in self._text.items():
            exports = [path for public, tree in _USE.findall(text) if public for path in paths_of_use(tree)]
            self._exports[module] = {path[-1]: path for path in exports}

    def uses(self, module: Module) -> set[Module]:
        """The modules that define what a module names, itself left out."""
        text = self._text[module]
        named = {path for public, tree in _USE.findall(text) if not public for path in paths_of_use(tree)}
        rest = _USE.sub("", text)
        named |= {tuple(re.sub(r"\s", "", path).split("::")) for path in _PATH.findall(rest)}
        return {found for path in named if (found := self._defining(module, path)) is not None} - {module}

    def _defining(self, module: Module, path: tuple[str, ...], followed: int = 0) -> Module | None:
        """The module of this crate that defines what a path means in a module; None for what is not of this crate."""
        assert followed < 20, f"{'::'.join(path)} re-exports itself"
        first, *rest = path
        if first == "crate":
            at: Module = ()
        elif first == "self":
            at = module
        elif first == "super":
            at = module[:-1]
            while rest and rest[0] == "super":
                at, rest = at[:-1], rest[1:]
        elif (*module, first) in self.files:
            at, rest = module, [*path]
        else:
            return None
        while rest and (*at, rest[0]) in self.files:
            at, rest = (*at, rest[0]), rest[1:]
        if rest and rest[0] in self._exports[at]:
            return self._defining(at, (*self._exports[at][rest[0]], *rest[1:]), followed + 1)
        return at

    def circles(self) -> list[list[Module]]:
        """The groups of modules each of which needs all others of its group, in order; one-way imports have none."""
        reached: dict[Module, set[Module]] = {}
        edges = {module: self.uses(module) for module in self.files}
        for module in edges:
            todo, seen = [module], set[Module]()
            while todo:
                for other in edges[todo.pop()] - seen:
                    seen.add(other)
                    todo.append(other)
            reached[module] = seen
        groups = {
            frozenset(other for other in reached[module] if module in reached[other])
            for module in reached
            if module in reached[module]
        }
        return sorted(sorted(group) for group in groups)
