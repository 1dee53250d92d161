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
    ["cli", "cli_plan", "cli_common", "cli_inertial", "cli_accuracy", "cli_usb", "cli_files", "cli_calibrate"],
    ["accuracy_report", "accuracy", "accuracy_settings", "reference_events"],
    ["record", "virtual_scene"],
    ["simulate"],
    ["plan"],
    ["sensor_parameters"],
    ["check", "compare", "video", "view", "convert", "summary"],
    ["calibrate"],
    ["read", "read_events"],
    ["dataset", "write_trajectory", "dataset_files"],
    ["decoded_output", "backward"],
    ["write"],
    ["formats"],
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
        *["scenes", "checkerboard_scene", "fence_scene", "builtin_scenes", "scene_parts", "textures"],
        *["scene", "light_course", "checkerboard"],
    ],
    ["motions", "waypoints", "trajectory_file", "sampled_trajectory"],
    ["packet", "views", "trajectory", "pose"],
    ["recordings"],
    ["camera", "lattice", "luma"],
    ["davis", "raw_file", "davis_settings", "davis_description", "stream_reader", "stream_gap", "usb_link"],
    ["virtual_backend", "virtual_davis", "usb_descriptors", "usb_protocol"],
    ["biases"],
    ["represent", "dtypes"],
    ["decoded", "events"],
    ["_mitsuba", "_llvm"],
    ["_core"],
]
RANK = {module: (layer, place) for layer, modules in enumerate(LAYERS) for place, module in enumerate(modules)}
LATE = {"mitsuba", "drjit", "scipy", "matplotlib", "imageio", "OpenEXR", "PIL", "tqdm", "usb", "lz4", "zstandard"}
LATE |= {"h5py", "hdf5plugin", "pyarrow", "rosbags", "cv2"}
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
    layer = module.parts[0].removesuffix(".py")  # a folder is one module of its layer
    for name in imports(tree, depth=len(module.parts) - 1):
        if name.startswith("."):
            assert RANK[name[1:]] > RANK[layer], f"{module} imports {name[1:]}"


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
    assert not early & LATE


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_heavy_libraries_are_imported_late(module: Path) -> None:
    """`import davis_rs` must be quick and work where they are not installed."""
    tree = ast.parse((PACKAGE / module).read_text())
    at_import = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    early = set().union(*(imports(node) for node in at_import)) & LATE
    assert early <= PLUG_INS.get(module.stem, set()), f"{module} imports {early} when it is imported"
    assert not {f".{plug_in}" for plug_in in PLUG_INS} & set().union(*(imports(node) for node in at_import))


def test_rust_modules_keep_apart() -> None:
    """Engine, file formats and camera stream know nothing of each other, and nobody but python/ knows PyO3."""
    sources = {path: path.read_text() for path in (ROOT / "rust" / "src").rglob("*.rs")}
    assert len(sources) > 10
    for path, text in sources.items():
        place = path.relative_to(ROOT / "rust" / "src")
        used = set(re.findall(r"crate::(\w+)", text))
        if place.parts[0] == "crossing":
            assert not used & {"write", "read", "aer", "python"}, place
        if place.parts[0] == "aer":
            assert not used & {"crossing", "write", "read", "python", "order"}, place
        if place.parts[0] in {"write", "read"}:
            assert not used & {"crossing", "aer", "python", "order"}, place
        if place.parts[0] != "python":
            assert "pyo3" not in text, place
            assert "unsafe" not in text, place
