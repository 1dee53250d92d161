"""When a camera is back at its first pose, and that info, a run and its page say so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import davis_rs
from davis_rs.cli.main import main
from davis_rs.geometry.pose import GroundTruth
from davis_rs.inspection.path_returns import returns_us


def path(x: list[float], *, turn: list[float] | None = None, step_us: int = 1000) -> GroundTruth:
    """Positions along x, and rotations around z in radians."""
    angle = np.zeros(len(x)) if turn is None else np.array(turn)
    quaternions = np.stack([0 * angle, 0 * angle, np.sin(angle / 2), np.cos(angle / 2)], axis=1)
    positions = np.stack([np.array(x), np.ones(len(x)), np.zeros(len(x))], axis=1)
    return GroundTruth(np.arange(len(x), dtype=np.int64) * step_us, positions, quaternions)


@pytest.mark.parametrize(
    ("truth", "expected"),
    [
        (path([0, 1, 2, 3]), []),
        (path([0, 1, 2, 1, 0]), [4000]),
        (path([0, 2, 3, -1, -2]), [2750]),  # between two samples
        (path([0, 1, 0, 1, 0, 0, 1]), [2000, 4000]),  # it rests there at the second return
        (path([0, 0, 0, 0]), []),
        (path([0, 1, 0.1, 1]), []),  # near, but not there
        (path([0, 1, 0], turn=[0, 1, 1]), []),  # the place alone
        (path([0, 1, 0], turn=[0, 1, 0]), [2000]),
        (path([0, 0, 0], turn=[0, 1, 0]), [2000]),
        (path([0, 0, 0], turn=[0, np.pi, 2 * np.pi]), [2000]),  # the other quaternion of the same rotation
        (path([0, 1]), []),
        (path([0, 1, 0, 0.05, 0, 1]), [2000, 4000]),  # it need not go far
        (path([0, 1e-12, -1e-12], turn=[0, 1, 0]), [2000]),  # rounding is no motion
        (path([0, 1, 0.0005, -0.0005, -1]), [2000]),  # one return, not two
    ],
)
def test_returns(truth: GroundTruth, expected: list[int]) -> None:
    assert returns_us(truth).tolist() == expected


def test_a_run_and_its_page_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As info does: of a path that goes away and comes back, not of one that does not."""
    pose = davis_rs.load_scene("three_planes").path.pose(0)
    rotation = " ".join(map(str, pose.quaternion))
    for back, said in ((0.0, True), (0.02, False)):
        lines = []
        for t_s, away in ((0, 0.0), (0.02, 0.01), (0.04, back), (0.05, back - 0.005)):
            x, y, z = pose.position + np.array([away, 0, 0])
            lines.append(f"{t_s} {x} {y} {z} {rotation}\n")
        (tmp_path / "path.txt").write_text("".join(lines))
        out = tmp_path / f"{back}"
        run = f"simulate three_planes -o {out} --size 24x18 --accuracy fast --rays-per-pixel 1"
        assert main([*run.split(), "--trajectory", str(tmp_path / "path.txt")]) == 0
        printed = capsys.readouterr()
        note = "the camera is back at its first pose at 0.04 s"
        assert (f"note: {note}" in printed.err) == said
        davis_rs.view_html(out, tmp_path / "page.html")
        page = (tmp_path / "page.html").read_text()
        assert (f"Note: {note}" in page) == said
        assert (f'aria-label="event rate over time" title="{note}' in page) == said, "where one points at the peak"


@pytest.mark.long
def test_info_says_so_of_pixels_in_step(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """three_planes is back at 1.999 s; with start phases of their own its pixels are not in step."""
    scene = davis_rs.load_scene("three_planes")
    settings = {"rays_per_pixel": 1, "accuracy": "fast", "quiet": True, "size": (24, 18)}
    for phase, said in (("zero", True), ("stationary", False)):
        out = tmp_path / phase
        davis_rs.simulate_to_folder(scene, out, start_phase=phase, **settings)  # type: ignore[arg-type]
        assert main(["info", str(out), "--quiet"]) == 0
        printed = capsys.readouterr().out
        assert ("the camera is back at its first pose at 1.999 s" in printed) == said
