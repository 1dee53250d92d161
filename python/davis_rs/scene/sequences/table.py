"""Lists the 27 rows of the paper's table, and the scene and motion of each.

Source of the figures: Mueggler et al., IJRR 2017, the table of sequences; of motions and places, its list of datasets.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from zlib import crc32

import numpy as np

from ..._util.close_names import did_you_mean
from ...geometry.pose import Pose
from ...geometry.trajectory.motions import Kind, hand_held, running, slider, spiral, walking, zigzag
from ...geometry.trajectory.trajectory import Trajectory
from ..builtin.checkerboard_scene import around_board, checkerboard
from ..builtin.planes_and_walls import three_planes, three_walls
from ..scene import Scene
from .boxes_scene import boxes
from .dynamic_scene import dynamic
from .office_scene import office
from .sequence import PaperRow, Sequence
from .slider_scenes import slider_depth, slider_wall
from .street_scenes import outdoors, urban
from .wall_scenes import poster, shapes

_LENS = "davis240c"


def _board() -> Scene:
    return replace(checkerboard(), contrast_threshold=0.3)


# How each kind of scene differs from the place of the recording.
_SHAPES = "other shapes in other places"
_POSTER = "a procedural pattern of like density in place of a photograph of rocks"
_BOXES = "other boxes, of like density; printed patterns, no folds and tape"
_DYNAMIC = "a body of rigid parts in place of a person; a room of plain furniture"
_OFFICE = "plain furniture in place of an office"
_OUTDOORS = "a straight path between repeated trees and houses, nobody else on it"
_URBAN = "flat facades, and nothing moves"
_WALL = "another picture on the wall"
_DEPTH = "plain objects at like depths"
_BOARD = "nothing but the board before a wall, evenly lit"
_LOST = "textures of like density, as the simulator's own are lost"


def _hand(name: str, make_scene: Callable[[], Scene], differs: str, kind: Kind, paper: PaperRow) -> Sequence:
    """Make a hand's motion of the row's duration and top speeds, with draws of its own."""
    duration_s, speed_m_s, rate_deg_s, _ = paper
    assert speed_m_s is not None
    assert rate_deg_s is not None

    def motion(scene: Scene) -> Trajectory:
        return hand_held(
            _start(scene),
            duration_s,
            kind,
            top_speed_m_s=speed_m_s,
            top_rate_rad_s=np.radians(rate_deg_s),
            seed=crc32(name.encode()),
        )

    return _recorded(name, make_scene, differs, f"{kind} by hand", motion, paper)


def _slider(name: str, make_scene: Callable[[], Scene], differs: str, paper: PaperRow) -> Sequence:
    """Make a motion to the right at the row's speed, for its duration."""
    speed_m_s = paper.speed_m_s
    assert speed_m_s is not None
    return _recorded(
        name,
        make_scene,
        differs,
        "motorized slider",
        lambda scene: slider(_start(scene), speed_m_s * paper.duration_s, speed_m_s),
        paper,
        imu=False,
    )


def _start(scene: Scene) -> Pose:
    assert scene.start is not None
    return scene.start


def _in_time(duration_s: float, path: Callable[[float], Trajectory]) -> Trajectory:
    """Return the path of this duration among paths that differ only in speed."""
    from scipy.optimize import brentq

    slowest, fastest = 0.02, 20.0  # m/s
    speed_m_s = brentq(lambda speed: path(speed).duration_s - duration_s, slowest, fastest, rtol=1e-6)
    return path(speed_m_s)


def _recorded(
    name: str,
    make_scene: Callable[[], Scene],
    differs: str,
    motion: str,
    make_motion: Callable[[Scene], Trajectory],
    paper: PaperRow,
    *,
    biases: str = "indoors",
    imu: bool = True,
) -> Sequence:
    return Sequence(name, paper, make_scene, motion, make_motion, _LENS, biases, 24.0, imu, differs)


def _simulated(name: str, make_scene: Callable[[], Scene], paper: PaperRow) -> Sequence:
    return Sequence(name, paper, make_scene, "path of the scene", None, "ideal", None, 40.0, False, _LOST)


_ROWS = (
    _hand("shapes_rotation", shapes, _SHAPES, "rotation", PaperRow(59.8, 0.83, 730, 23_126_288)),
    _hand("shapes_translation", shapes, _SHAPES, "translation", PaperRow(59.7, 2.60, 271, 17_363_976)),
    _hand("shapes_6dof", shapes, _SHAPES, "6dof", PaperRow(59.7, 2.35, 715, 17_962_477)),
    _hand("poster_rotation", poster, _POSTER, "rotation", PaperRow(59.8, 0.84, 884, 169_350_136)),
    _hand("poster_translation", poster, _POSTER, "translation", PaperRow(59.8, 2.58, 240, 100_033_286)),
    _hand("poster_6dof", poster, _POSTER, "6dof", PaperRow(59.8, 2.51, 937, 133_464_530)),
    _hand("boxes_rotation", boxes, _BOXES, "rotation", PaperRow(59.8, 0.85, 669, 185_688_947)),
    _hand("boxes_translation", boxes, _BOXES, "translation", PaperRow(59.8, 3.43, 319, 112_388_307)),
    _hand("boxes_6dof", boxes, _BOXES, "6dof", PaperRow(59.8, 3.84, 509, 133_085_511)),
    _hand("hdr_poster", partial(poster, hdr=True), _POSTER, "6dof", PaperRow(59.8, 2.28, 597, 102_910_720)),
    _hand("hdr_boxes", partial(boxes, hdr=True), _BOXES, "6dof", PaperRow(59.8, 2.94, 592, 118_499_744)),
    _recorded(
        "outdoors_walking",
        outdoors,
        _OUTDOORS,
        "walking",
        lambda scene: walking(_start(scene), 133.4),
        PaperRow(133.4, None, None, 64_517_638),
        biases="outdoors",
    ),
    _recorded(
        "outdoors_running",
        outdoors,
        _OUTDOORS,
        "running",
        lambda scene: running(_start(scene), 87.6, nod_rad=0.03),
        PaperRow(87.6, None, None, 98_572_164),
        biases="outdoors",
    ),
    _hand("dynamic_rotation", dynamic, _DYNAMIC, "rotation", PaperRow(59.8, 0.45, 542, 71_324_510)),
    _hand("dynamic_translation", dynamic, _DYNAMIC, "translation", PaperRow(59.8, 1.86, 227, 35_809_924)),
    _hand("dynamic_6dof", dynamic, _DYNAMIC, "6dof", PaperRow(59.7, 2.91, 627, 57_174_637)),
    _recorded(
        "calibration",
        _board,
        _BOARD,
        "around the board",
        lambda _: around_board(59.8, pace=0.285, gaze_pace=0.605),
        PaperRow(59.8, 0.32, 67, 21_340_629),
    ),
    _recorded(
        "office_zigzag",
        office,
        _OFFICE,
        "zigzag",
        lambda scene: _in_time(10.9, lambda v: zigzag(_start(scene), 10, 0.06, v, width_m=0.7, through=True)),
        PaperRow(10.9, None, None, 7_735_308),
    ),
    _recorded(
        "office_spiral",
        office,
        _OFFICE,
        "spiral",
        lambda scene: _in_time(11.2, lambda v: spiral(_start(scene), 4.0, 0.42, v, pitch_m=0.1)),
        PaperRow(11.2, None, None, 6_254_774),
    ),
    _recorded(
        "urban",
        urban,
        _URBAN,
        "6dof by hand",
        lambda scene: hand_held(
            _start(scene), 10.7, "6dof", top_speed_m_s=0.5, top_rate_rad_s=0.9, reach_rad=0.3, seed=crc32(b"urban")
        ),
        PaperRow(10.7, None, None, 5_359_539),
        biases="outdoors",
    ),
    _slider("slider_close", partial(slider_wall, 0.231), _WALL, PaperRow(6.5, 0.16, 0, 4_032_668)),
    _slider("slider_far", partial(slider_wall, 0.584), _WALL, PaperRow(6.4, 0.16, 0, 3_442_683)),
    _slider("slider_hdr_close", partial(slider_wall, 0.232, hdr=True), _WALL, PaperRow(6.5, 0.16, 0, 3_337_787)),
    _slider("slider_hdr_far", partial(slider_wall, 0.584, hdr=True), _WALL, PaperRow(6.5, 0.16, 0, 2_509_582)),
    _slider("slider_depth", slider_depth, _DEPTH, PaperRow(3.4, 0.32, 0, 1_078_541)),
    _simulated("simulation_3planes", three_planes, PaperRow(2.0, 0.63, 0, 6_870_278)),
    _simulated("simulation_3walls", three_walls, PaperRow(2.0, 5.31, 109, 4_104_833)),
)

SEQUENCES = MappingProxyType({row.name: row for row in _ROWS})
"""The dataset's sequences by their names, in the paper's order."""


def sequence_named(name: str) -> Sequence:
    """Return the sequence of that name.

    Raises:
        ValueError: if there is none; the message lists those there are.
    """
    if name not in SEQUENCES:
        raise ValueError(
            f"there is no sequence {name!r}{did_you_mean(name, SEQUENCES)}; there are {', '.join(SEQUENCES)}"
        )
    return SEQUENCES[name]
