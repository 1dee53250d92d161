"""The rules of ARCHITECTURE.md for Python: imports go one way, heavy libraries are imported late."""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path

import davis_rs
from places import ROOT

PACKAGE = ROOT / "python" / "davis_rs"

LATE = {"mitsuba", "drjit", "scipy", "matplotlib", "imageio", "OpenEXR", "PIL", "tqdm", "usb", "lz4", "zstandard"}
LATE |= {
    "DracoPy",
    "h5py",
    "hdf5plugin",
    "pyarrow",
    "rosbags",
    "cv2",
    "yaml",
    "distributed",
    "argcomplete",
    "av",
    "rerun",
    "torch",
}
PLUG_INS = {"virtual_backend": {"usb"}}
"""Modules that derive from a class of a heavy library: imported late themselves."""

MODULES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def imports(node: ast.AST, depth: int = 0) -> set[str]:
    """Modules that a tree imports: those of the package as '.name', others by their first name.

    ``depth`` folders down, what lies in the same folder is not named.
    """
    found: set[str] = set()
    for child in ast.walk(node):
        if isinstance(child, ast.Import):
            found |= {alias.name.split(".")[0] for alias in child.names}
        elif isinstance(child, ast.ImportFrom) and child.level == 0:
            found.add((child.module or "").split(".")[0])
        elif isinstance(child, ast.ImportFrom) and child.level > depth:
            names = [child.module] if child.module else [alias.name for alias in child.names]
            found |= {f".{name.split('.')[0]}" for name in names}
    return found


def test_python_imports_go_one_way() -> None:
    """The contracts in pyproject.toml: a circle, or a lower layer that knows a higher one, ties everything together."""
    done = subprocess.run(["lint-imports"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_heavy_libraries_are_imported_late() -> None:
    """`import davis_rs` must be quick and work where they are not installed."""
    for module in MODULES:
        _check_imports(module)


def _check_imports(module: Path) -> None:
    tree = ast.parse((PACKAGE / module).read_text())
    at_import = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    early = set().union(*(imports(node) for node in at_import)) & LATE
    if module.parts[:2] == ("data", "torch"):  # itself imported late
        early -= {"torch"}
    assert early <= PLUG_INS.get(module.stem, set()), f"{module} imports {early} when it is imported"
    named = {
        name
        for node in at_import
        if isinstance(node, ast.ImportFrom)
        for name in [*(node.module or "").split("."), *(alias.name for alias in node.names)]
    }
    assert not named & PLUG_INS.keys(), f"{module} imports {named & PLUG_INS.keys()}"


def test_every_public_name_is_there() -> None:
    """Those that are imported late too; what there is not says so as any module does."""
    assert all(hasattr(davis_rs, name) for name in davis_rs.__all__)
    assert set(davis_rs.__all__) <= set(dir(davis_rs))
    assert not hasattr(davis_rs, "no_such_name")
