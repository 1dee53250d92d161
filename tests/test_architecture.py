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
    ["cli", "cli_plan", "cli_common", "cli_inertial", "cli_accuracy", "cli_calibrate"],
    ["accuracy_report", "accuracy", "accuracy_settings", "reference_events"],
    ["record"],
    ["simulate"],
    ["plan"],
    ["sensor_parameters"],
    ["check", "compare", "video", "view"],
    ["calibrate"],
    ["read"],
    ["dataset", "write_trajectory", "dataset_files"],
    ["clocks"],
    ["imu", "motion_capture"],
    ["observe", "interpolate"],
    ["presets", "refine", "tolerance", "sampling", "exposure", "displacement", "keyframes"],
    ["effects"],
    ["differentiable", "differentiable_kernel", "differentiable_poses"],
    [
        *["renderers", "render_table", "render_scalar", "render_integrator", "render_scene"],
        *["table_kernel", "moving_lanes", "scene_table", "scene_updates"],
        *["scene_texture", "render", "rate_difference", "neighbours", "camera_rays", "flow"],
        *["swept_objects", "swept", "scene_motion"],
    ],
    [
        *["scenes", "calibration_scene", "fence_scene", "builtin_scenes", "scene_parts", "textures"],
        *["scene", "light_course", "checkerboard"],
    ],
    ["motions", "waypoints", "trajectory_file", "sampled_trajectory"],
    ["packet", "views", "trajectory", "pose"],
    ["camera", "lattice", "luma", "biases"],
    ["events"],
    ["_mitsuba", "_llvm"],
    ["_core"],
]
RANK = {module: (layer, place) for layer, modules in enumerate(LAYERS) for place, module in enumerate(modules)}
LATE = {"mitsuba", "drjit", "scipy", "matplotlib", "imageio", "OpenEXR", "PIL", "tqdm", "cv2"}

MODULES = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def imports(node: ast.AST, depth: int = 0) -> set[str]:
    """Modules that a tree imports: those of the package as '.name', others by their first name.

    ``depth`` folders down, what lies in the same folder is not named.
    """
    found: set[str] = set()
    for child in ast.walk(node):
        if isinstance(child, ast.Import):
            found |= {alias.name.split(".")[0] for alias in child.names}
        elif isinstance(child, ast.ImportFrom):
            name = (child.module or "").split(".")[0]
            if child.level == 0:
                found.add(name)
            elif child.level > depth:
                found.add(f".{name}")
    return found


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_python_imports_go_one_way(module: Path) -> None:
    """A cycle, or a lower layer that knows a higher one, would tie everything to everything."""
    tree = ast.parse((PACKAGE / module).read_text())
    layer = module.parts[0].removesuffix(".py")  # a folder is one module of its layer
    for name in imports(tree, depth=len(module.parts) - 1):
        if name.startswith("."):
            assert RANK[name[1:]] > RANK[layer], f"{module} imports {name[1:]}"


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_heavy_libraries_are_imported_late(module: Path) -> None:
    """`import davis_rs` must be quick and work where they are not installed."""
    tree = ast.parse((PACKAGE / module).read_text())
    at_import = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    early = set().union(*(imports(node) for node in at_import)) & LATE
    assert not early, f"{module} imports {early} when it is imported"


def test_rust_modules_keep_apart() -> None:
    """The crossing engine and the text format know nothing of each other, and nobody but python/ knows PyO3."""
    sources = {path: path.read_text() for path in (ROOT / "rust" / "src").rglob("*.rs")}
    assert len(sources) > 10
    for path, text in sources.items():
        place = path.relative_to(ROOT / "rust" / "src")
        used = set(re.findall(r"crate::(\w+)", text))
        if place.parts[0] == "crossing":
            assert not used & {"text", "python"}, place
        if place.parts[0].startswith("text"):
            assert not used & {"crossing", "python", "order"}, place
        if place.parts[0] != "python":
            assert "pyo3" not in text, place
            assert "unsafe" not in text, place
