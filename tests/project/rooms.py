"""Prints the packages of davis_rs and which of them imports which: python tests/project/rooms.py

A room is a direct child of the package, or of its ``render``; an arrow is one room that imports another at least once.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "python" / "davis_rs"


def imported(path: Path) -> Iterator[Path]:
    """Yield what a module imports of the package, as paths without suffix."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for alias in node.names:
                named = base / alias.name
                yield named if named.is_dir() or named.with_suffix(".py").exists() else base


def arrows(of: Path) -> tuple[list[str], dict[str, set[str]]]:
    """Find the rooms of a package, and those that each of them imports."""
    rooms = sorted(path.stem for path in of.iterdir() if path.is_dir() and path.name != "__pycache__")
    found: dict[str, set[str]] = {room: set() for room in rooms}
    for room in rooms:
        for path in (of / room).rglob("*.py"):
            for target in imported(path):
                if target.is_relative_to(of) and target != of:
                    other = target.relative_to(of).parts[0]
                    if other in found and other != room:
                        found[room].add(other)
    return rooms, found


def main() -> int:
    """Print both packages."""
    for package in (PACKAGE, PACKAGE / "render"):
        rooms, found = arrows(package)
        print(f"{package.name}: {len(rooms)} rooms, {sum(map(len, found.values()))} arrows")
        for room in rooms:
            print(f"  {room}: {', '.join(sorted(found[room])) or '-'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
