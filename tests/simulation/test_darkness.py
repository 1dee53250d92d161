"""That most of the image is dark is told before a run."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from davis_rs import Camera, load_scene
from davis_rs.cli.main import main
from davis_rs.render.choice import make_renderer
from davis_rs.simulation.darkness import Darkness, estimate_darkness
from gltf_files import Gltf, quad

pytestmark = pytest.mark.without_llvm

CAMERA = Camera(width=64, height=48, fx=55.0, fy=55.0, cx=31.5, cy=23.5)


def lit(folder: Path, reach: float) -> Path:
    """A wall before the camera, and a lamp before or behind it."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf), scale=[9, 9, 1])
    gltf.light({"type": "point", "intensity": 6000.0}, translation=[0, 0, reach])
    camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.8}})
    gltf.node(camera=camera, translation=[0, 0, 3])
    return gltf.save(folder / "wall.glb")


def run(path: Path, folder: Path) -> None:
    """In so short a time, a plain wall makes no events."""
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["simulate", str(path), "-o", str(folder), "--duration", "0.02", "--size", "32x24"]) == 0


def test_what_no_light_reaches_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The lamp is behind the wall."""
    run(lit(tmp_path, -2.0), tmp_path / "out")
    assert "100 % of the image is dark (luma below 0.001), and has no events" in capsys.readouterr().err


def test_what_is_lit_is_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(lit(tmp_path, 2.0), tmp_path / "out")
    assert "is dark" not in capsys.readouterr().err


def test_the_share_is_a_mean_over_the_path() -> None:
    """Above a luma that all pixels have, none is dark; below it, all are."""
    scene = load_scene("three_planes").crop(0.0, 0.1)
    renderer = make_renderer(scene, CAMERA, kind="native")
    assert estimate_darkness(renderer, scene.path, log_eps=1e-3) is None
    assert estimate_darkness(renderer, scene.path, log_eps=1e3) == Darkness(1.0, 1e3)
