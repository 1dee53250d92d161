"""The rules of ARCHITECTURE.md for Python: imports go one way, heavy libraries are imported late."""

from __future__ import annotations

import ast
import graphlib
from pathlib import Path

import pytest

import davis_rs
from places import ROOT

PACKAGE = ROOT / "python" / "davis_rs"

# From the top down: a module or package may import only from those below it, and from those to its right.
LAYERS = [
    ["cli"],
    ["generate", "accuracy", "sequence_report", "differentiable"],
    ["simulation_folder", "virtual_scene", "frames_to_events"],
    ["simulation"],
    ["simulator", "effect_planning", "monte_carlo_noise"],
    ["due_instants", "run_description", "no_events"],
    ["settings"],
    ["sensor_fit"],
    ["sensors"],
    ["sensor_parameters"],
    ["calibrate", "inspection", "stream_statistics"],
    ["torch"],
    ["windows"],
    ["event_files", "dataset", "formats"],
    ["clocks", "imu", "motion_capture"],
    ["ground_truth", "sampling", "effects", "rendering"],
    ["scenes", "sequences", "scene"],
    ["trajectory", "packet", "pose"],
    ["recordings", "camera", "lattice", "luma"],
    ["usb", "biases"],
    ["event_matching", "represent", "dtypes", "decoded", "events", "whole_file", "holding"],
    [
        "_mitsuba",
        "_llvm",
        "_mitsuba_files",
        "yaml_file",
        "untrusted",
        "budget",
        "_core",
        "extras",
        "close_names",
        "names_elsewhere",
        "memory_forecast",
        "argument_checks",
        "argument_error",
        "random_words",
        "progress",
        "read_ahead",
        "stop_requests",
        "folder_report",
        "noise_estimate",
        "model_version",
    ],
]
RANK = {name: (layer, place) for layer, names in enumerate(LAYERS) for place, name in enumerate(names)}
LATE = {"mitsuba", "drjit", "scipy", "matplotlib", "imageio", "OpenEXR", "PIL", "tqdm", "usb", "lz4", "zstandard"}
LATE |= {
    "h5py",
    "hdf5plugin",
    "pyarrow",
    "rosbags",
    "cv2",
    "yaml",
    "distributed",
    "argcomplete",
    "av",
    "pygltflib",
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


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_python_imports_go_one_way(module: Path) -> None:
    """A cycle, or a lower layer that knows a higher one, would tie everything to everything."""
    tree = ast.parse((PACKAGE / module).read_text())
    own = module.parts[0].removesuffix(".py")  # a package is one place of its layer
    for name in imports(tree, depth=len(module.parts) - 1):
        if name.startswith("."):
            assert RANK[name[1:]] > RANK[own], f"{module} imports {name[1:]}"


@pytest.mark.parametrize("package", sorted({path.parts[0] for path in MODULES if len(path.parts) > 1}))
def test_no_cycles_within_a_package(package: str) -> None:
    """Each of its modules can be read after those that it imports."""
    siblings = {
        path.stem: {
            name
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.ImportFrom) and node.level == 1
            for name in ([node.module.split(".")[0]] if node.module else [alias.name for alias in node.names])
        }
        for path in (PACKAGE / package).glob("*.py")
    }
    graphlib.TopologicalSorter(siblings).prepare()


@pytest.mark.parametrize("path", sorted((PACKAGE / "formats").glob("*.py")), ids=lambda path: path.stem)
def test_a_format_knows_events_recordings_and_the_core_alone(path: Path) -> None:
    """So that a format can be read, and another one added, without the rest; and `interface` knows none of them."""
    tree = ast.parse(path.read_text())
    own = {
        (node.level, (node.module or "").split(".")[0]) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
    }
    assert {name for level, name in own if level == 2} <= {
        "_core",
        "events",
        "budget",
        "argument_checks",
        "argument_error",
        "extras",
        "recordings",
        "untrusted",
        "whole_file",
    }
    if path.stem in {"interface", "files"}:
        assert {name for level, name in own if level == 1} <= {"reading", "blocks"}
    early = set().union(*(imports(node) for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)))
    assert not early & LATE


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_heavy_libraries_are_imported_late(module: Path) -> None:
    """`import davis_rs` must be quick and work where they are not installed."""
    tree = ast.parse((PACKAGE / module).read_text())
    at_import = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    early = set().union(*(imports(node) for node in at_import)) & LATE
    if module.parts[0] == "torch":  # itself imported late
        early -= {"torch"}
    assert early <= PLUG_INS.get(module.stem, set()), f"{module} imports {early} when it is imported"
    named = {
        name
        for node in at_import
        if isinstance(node, ast.ImportFrom)
        for name in [*(node.module or "").split("."), *(alias.name for alias in node.names)]
    }
    assert not named & PLUG_INS.keys()


def test_every_public_name_is_there() -> None:
    """Those that are imported late too; what there is not says so as any module does."""
    assert all(hasattr(davis_rs, name) for name in davis_rs.__all__)
    assert set(davis_rs.__all__) <= set(dir(davis_rs))
    assert not hasattr(davis_rs, "no_such_name")
