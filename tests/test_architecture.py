"""The rules of ARCHITECTURE.md: imports go one way, heavy libraries are imported late."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "python" / "davis_rs"

# From the top down: a module may import only from the layers below its own, and from its own to its right.
LAYERS = [
    ["cli", "cli_accuracy", "cli_files"],
    ["accuracy_report", "accuracy", "accuracy_settings", "reference_events"],
    ["record"],
    ["simulate"],
    ["check", "compare", "video", "view", "convert", "summary"],
    ["read", "read_events"],
    ["dataset", "dataset_files"],
    ["write"],
    ["formats"],
    ["observe", "interpolate"],
    ["presets", "refine", "tolerance", "sampling", "displacement", "keyframes"],
    ["differentiable", "differentiable_kernel", "differentiable_poses"],
    [
        *["renderers", "render_table", "render_scalar", "render_integrator", "render_scene"],
        *["table_kernel", "moving_lanes", "scene_table", "scene_updates"],
        *["scene_texture", "render", "rate_difference", "neighbours", "camera_rays", "flow"],
        *["swept_objects", "swept", "scene_motion"],
    ],
    ["scenes", "fence_scene", "builtin_scenes", "scene_parts", "textures", "scene", "light_course"],
    ["trajectory_file", "sampled_trajectory"],
    ["packet", "views", "trajectory", "pose"],
    ["camera", "lattice", "luma"],
    ["represent", "dtypes"],
    ["events"],
    ["_mitsuba", "_llvm"],
    ["_core"],
]
RANK = {module: (layer, place) for layer, modules in enumerate(LAYERS) for place, module in enumerate(modules)}
LATE = {"mitsuba", "drjit", "scipy", "matplotlib", "imageio", "OpenEXR", "PIL", "tqdm"}

MODULES = sorted(path.stem for path in PACKAGE.glob("*.py") if path.stem != "__init__")


def imports(node: ast.AST) -> set[str]:
    """Modules that a tree imports: those of the package as '.name', others by their first name."""
    found: set[str] = set()
    for child in ast.walk(node):
        if isinstance(child, ast.Import):
            found |= {alias.name.split(".")[0] for alias in child.names}
        elif isinstance(child, ast.ImportFrom):
            name = (child.module or "").split(".")[0]
            found |= {f".{name}"} if child.level else {name}
    return found


@pytest.mark.parametrize("module", MODULES)
def test_python_imports_go_one_way(module: str) -> None:
    """A cycle, or a lower layer that knows a higher one, would tie everything to everything."""
    tree = ast.parse((PACKAGE / f"{module}.py").read_text())
    for name in imports(tree):
        if name.startswith("."):
            assert RANK[name[1:]] > RANK[module], f"{module} imports {name[1:]}"


@pytest.mark.parametrize("path", sorted((PACKAGE / "formats").glob("*.py")), ids=lambda path: path.stem)
def test_a_format_knows_events_and_the_core_alone(path: Path) -> None:
    """So that a format can be read, and another one added, without the rest; and `interface` knows none of them."""
    tree = ast.parse(path.read_text())
    own = {
        (node.level, (node.module or "").split(".")[0]) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
    }
    assert {name for level, name in own if level == 2} <= {"_core", "events"}
    if path.stem in {"interface", "files"}:
        assert not {name for level, name in own if level == 1}
    early = set().union(*(imports(node) for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)))
    assert not early & (LATE | {"h5py", "hdf5plugin", "pyarrow", "rosbags"})


@pytest.mark.parametrize("module", MODULES)
def test_heavy_libraries_are_imported_late(module: str) -> None:
    """`import davis_rs` must be quick and work where they are not installed."""
    tree = ast.parse((PACKAGE / f"{module}.py").read_text())
    at_import = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    early = set().union(*(imports(node) for node in at_import)) & LATE
    assert not early, f"{module} imports {early} when it is imported"


def test_rust_modules_keep_apart() -> None:
    """The crossing engine and the file formats know nothing of each other, and nobody but python/ knows PyO3."""
    sources = {path: path.read_text() for path in (ROOT / "rust" / "src").rglob("*.rs")}
    assert len(sources) > 10
    for path, text in sources.items():
        place = path.relative_to(ROOT / "rust" / "src")
        used = set(re.findall(r"crate::(\w+)", text))
        if place.parts[0] == "crossing":
            assert not used & {"write", "read", "python"}, place
        if place.parts[0] in {"write", "read"}:
            assert not used & {"crossing", "python", "order"}, place
        if place.parts[0] != "python":
            assert "pyo3" not in text, place
            assert "unsafe" not in text, place
