"""The checkerboard and the scene that shows it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration_views import BOARD, CAMERA, SCENE, board_camera, exact_view, frames, path
from davis_rs.geometry.trajectory.views import Views
from davis_rs.scene.builtin.checkerboard import Checkerboard


def test_the_board_is_the_datasets() -> None:
    """6 x 7 tiles of 70 mm: 5 x 6 inner corners in rows, 70 mm apart, the first where the first four tiles meet."""
    assert (BOARD.rows, BOARD.columns, BOARD.tile_m) == (6, 7, 0.07)
    assert BOARD.corners.shape == (30, 3)
    np.testing.assert_allclose(
        BOARD.corners[[0, 1, 6, 29]], 0.07 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 4, 0]])
    )
    np.testing.assert_allclose(BOARD.corners.mean(0), BOARD.centre)
    assert len(BOARD.black_tiles) == 21
    np.testing.assert_allclose(BOARD.black_tiles[0], [-0.035, -0.035, 0])


@pytest.mark.parametrize(
    ("rows", "columns", "tile"), [(6, 6, 0.07), (5, 7, 0.07), (2, 7, 0.07), (6, 7, 0.0), (6, 7, np.nan)]
)
def test_boards_that_look_alike_upside_down_are_refused(rows: int, columns: int, tile: float) -> None:
    """Which corner is the first could not be told of them."""
    with pytest.raises(ValueError, match="a checkerboard"):
        Checkerboard(rows, columns, tile)


def test_the_whole_board_stays_in_view_and_is_seen_from_many_sides() -> None:
    """Every tenth of a second all corners lie in the image; tilts, distances and rolls are as wide as documented."""
    t = np.arange(0, 20, 0.1)
    poses = np.stack([board_camera(s) for s in t])
    corners = np.stack([exact_view(pose).corners for pose in poses])
    assert (corners > 8).all()
    assert (corners < (CAMERA.width - 9, CAMERA.height - 9)).all()
    away = BOARD.centre - poses[:, :3, 3]
    distance = np.linalg.norm(away, axis=1)
    assert 0.55 < distance.min() < 0.7
    assert 1.1 < distance.max() < 1.25
    tilt = np.degrees(np.arccos(away[:, 2] / distance))
    assert tilt.max() > 35
    yaw, pitch, roll = np.degrees(Rotation.from_matrix(poses[:, :3, :3]).as_euler("YXZ")).T
    for angle, least in ((yaw, 30), (pitch, 25), (roll, 25)):
        assert angle.max() > least
        assert angle.min() < -least


@pytest.mark.usefixtures("llvm")
def test_the_board_is_where_it_is_said_to_be_and_evenly_lit() -> None:
    """Middles of black tiles are black, white ones white, each the same all over the board and the path."""
    t_us, _, luma = frames()
    row, column = np.indices((4, 5))
    black = ((row + column) % 2 == 0).ravel()
    seen = []
    for t, image in zip(t_us[::10], luma[::10], strict=True):
        grid = exact_view(board_camera(t * 1e-6)).corners.reshape(5, 6, 2)
        x, y = np.round((grid[1:, 1:] + grid[:-1, :-1]) / 2).astype(int).reshape(-1, 2).T
        seen.append(image[y, x])
    tiles = np.stack(seen)
    for colour in (tiles[:, black], tiles[:, ~black]):
        np.testing.assert_allclose(colour, colour.mean(), rtol=1e-3)
    assert tiles[:, ~black].mean() / tiles[:, black].mean() == pytest.approx(0.9 / 0.08, rel=1e-3)


@pytest.mark.usefixtures("llvm")
def test_every_pixel_sees_something() -> None:
    """No pixel is dark, so that none makes events of nothing."""
    assert frames().luma.min() > 0.01


def test_the_path_is_smooth() -> None:
    """Its speeds are those that the scene's description gives, and views of it can be made anywhere."""
    views = Views.along(path(), np.linspace(0, path().duration_s, 2001))
    assert 0.8 < np.linalg.norm(views.velocities, axis=1).max() < 1.3
    assert 90 < np.degrees(np.linalg.norm(views.angular_rates, axis=1)).max() < 140
    assert SCENE.own_camera.k1 != 0
