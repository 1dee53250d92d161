"""Pixels that an occlusion edge may sweep: none is missed, against rays and against points of the edges themselves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Pose, SegmentTrajectory
from davis_rs._mitsuba.variants import FAST, load_scene_source, variant
from davis_rs.render.edges.swept import Silhouettes, mesh_edges

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Parts = dict[str, dict[str, Any]]

PLAIN = Camera(48, 36, 40.0, 42.0, 23.1, 18.4)
LENS = Camera(48, 36, 40.0, 42.0, 26.1, 20.4, k1=-0.38, k2=0.19, p1=-0.002, p2=0.003, k3=-0.02)
CAMERAS = pytest.mark.parametrize("camera", [PLAIN, LENS], ids=["pinhole", "lens"])
ALWAYS = np.full((1, 2, 3), np.nan)


def pose(position: npt.ArrayLike = (0.0, 0.0, 0.0), turn: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
    """Turned from looking along the world's z; turn in radians."""
    return Pose(position, Rotation.from_rotvec(turn).as_quat())


def placed(kind: str, centre: npt.ArrayLike, half: npt.ArrayLike, turn: npt.ArrayLike = (0, 0, 0)) -> dict[str, Any]:
    to_world = np.eye(4)
    to_world[:3, :3] = Rotation.from_rotvec(turn).as_matrix() * half
    to_world[:3, 3] = centre
    return {"type": kind, "to_world": to_world}


def load(parts: Parts) -> tuple[Any, Silhouettes]:
    with variant(FAST) as (mi, _):
        scene = load_scene_source({"type": "scene", **parts}, mi)
        return scene, Silhouettes.of_scene(scene)


def hits(scene: Any, camera: Camera, before: Pose, after: Pose, *, instants: int = 13) -> tuple[Any, FloatArray]:
    """Shape numbers (0: none) and depths, (instants, H, W, 5, 5), of rays that fill every pixel's square."""
    places = np.linspace(-0.5, 0.5, 5)
    x, y = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack(np.broadcast_arrays(x[..., None, None] + places, y[..., None, None] + places[:, None]), -1)
    rays = camera.rays(pixels).reshape(-1, 2)
    directions = np.concatenate([rays, np.ones((len(rays), 1))], 1)
    path = SegmentTrajectory(before, after, 1.0)
    shapes, depths = [], []
    with variant(FAST) as (mi, dr):
        for t_s in np.linspace(0.0, 1.0, instants):
            at = path.pose(t_s)
            ray = mi.Ray3f(mi.Point3f(at.position.tolist()), mi.Vector3f((directions @ at.rotation.T).T))
            found = scene.ray_intersect_preliminary(ray)
            hit = found.is_valid().numpy()
            shapes.append(np.where(hit, dr.reinterpret_array(mi.UInt32, found.shape).numpy(), 0))
            depths.append(np.where(hit, found.t.numpy(), np.inf))
    shape = (instants, *pixels.shape[:-1])
    return np.array(shapes).reshape(shape), np.array(depths, np.float64).reshape(shape)


def several_shapes(shapes: npt.NDArray[Any]) -> BoolArray:
    """Pixels (H, W) in which more than one shape, or a shape and none, is seen at some time and place."""
    return shapes.max((0, 3, 4)) != shapes.min((0, 3, 4))


def swept(edges: Silhouettes, camera: Camera, before: Pose, after: Pose, *, margin_px: float = 0.0) -> BoolArray:
    return edges.swept(camera, [before], [after], margin_px=margin_px)[0] > 0


def assert_none_missed(mask: BoolArray, needed: BoolArray) -> None:
    assert needed.any(), "nothing moves: nothing would be compared"
    missed = np.argwhere(needed & ~mask)
    assert not len(missed), f"{len(missed)} of {needed.sum()} pixels missed, the first (row, column) = {missed[0]}"


OBJECTS: Parts = {
    "wall": placed("rectangle", (0, 0, 6), (9, 9, 1), (0, np.pi, 0)),
    "plate": placed("rectangle", (-0.9, -0.5, 3), (0.5, 0.4, 1), (0.3, 0.4, 0.5)),
    "box": placed("cube", (0.7, 0.2, 3), (0.3, 0.4, 0.3), (0.6, 0.5, 0.2)),
    "rod": placed("cube", (0.1, -0.9, 2.5), (0.9, 0.004, 0.004), (0, 0, 0.2)),
}
MOTIONS = {
    "sideways": (pose(), pose((0.1, 0.03, 0))),
    "forward": (pose(), pose((0, 0, 0.3))),
    "panning": (pose(), pose(turn=(0.02, 0.06, 0))),
    "rolling": (pose(), pose(turn=(0, 0, 0.12))),
    "all at once": (pose((0.1, 0, 0), (0.1, 0, 0.4)), pose((0.05, 0.1, 0.1), (0.12, 0.06, 0.45))),
    "far in one step": (pose((-0.5, 0, 0), (0, -0.5, 0)), pose((0.5, 0, 0.2), (0, 0.6, 0.3))),
}


@pytest.mark.few(3)
@CAMERAS
@pytest.mark.parametrize("motion", MOTIONS)
def test_no_pixel_with_an_outline_is_missed(llvm: str, camera: Camera, motion: str) -> None:
    """Wherever rays at any time of the interval find two shapes in a pixel, it is marked, without any margin."""
    scene, edges = load(OBJECTS)
    mask = swept(edges, camera, *MOTIONS[motion])
    assert_none_missed(mask, several_shapes(hits(scene, camera, *MOTIONS[motion])[0]))
    assert motion == "far in one step" or mask.mean() < 0.4


@pytest.mark.few(1)
@CAMERAS
def test_little_more_than_needed_is_marked(llvm: str, camera: Camera) -> None:
    """Around a bar in front of a wall, each marked pixel is next to one in which rays find the outline."""
    bar = placed("rectangle", (0.1, -0.3, 3), (4, 0.3, 1), (0.2, 0, 0.3))
    scene, edges = load({"wall": OBJECTS["wall"], "bar": bar})
    rolled, closer = pose(turn=(0, 0, 0.04)), pose((0, 0, 1.2))
    for before, after in (MOTIONS["sideways"], MOTIONS["all at once"], (pose(), rolled), (pose(), closer)):
        needed = several_shapes(hits(scene, camera, before, after, instants=25)[0])
        mask = swept(edges, camera, before, after)
        assert_none_missed(mask, needed)
        assert not (mask & ~binary_dilation(needed, np.ones((3, 3)))).any()


def test_an_edge_in_view_only_half_way() -> None:
    """Panned past, a point's image is an arc: below the image at both ends, and within it half way."""
    camera = Camera(240, 180, 200.0, 200.0, 119.5, 89.5)
    edges = Silhouettes([[[-0.001, 89 / 200, 1.0], [0.001, 89 / 200, 1.0]]], ALWAYS)
    before, after = pose(turn=(0, -0.24, 0)), pose(turn=(0, 0.24, 0))
    mask = swept(edges, camera, before, after)
    assert mask[178:, 118:122].all()
    assert not mask[:177].any()


@CAMERAS
@given(
    edge=st.lists(st.floats(-3, 3), min_size=6, max_size=6),
    travel=st.lists(st.floats(-0.4, 0.4), min_size=3, max_size=3),
    turn=st.lists(st.floats(-1.2, 1.2), min_size=3, max_size=3),
    margin_px=st.sampled_from([0.0, 1.0]),
)
@settings(max_examples=60)
def test_every_point_of_an_edge_is_marked(
    camera: Camera, edge: list[float], travel: list[float], turn: list[float], margin_px: float
) -> None:
    """The pixels around the points of any edge are marked, be it behind, at the side of or in front of the camera."""
    assume(np.abs([travel, turn]).max() > 1e-6)
    before, after = pose((0.1, 0.2, -0.5)), pose(np.add((0.1, 0.2, -0.5), travel), turn)
    ends = np.array(edge).reshape(2, 3)
    mask = swept(Silhouettes([ends], ALWAYS), camera, before, after, margin_px=margin_px)
    path = SegmentTrajectory(before, after, 1.0)
    times = np.linspace(0, 1, 41)
    points = ends[0] + np.linspace(0, 1, 400)[:, None] * (ends[1] - ends[0])
    seen = (points - path.positions(times)[:, None]) @ path.rotations(times)
    image = camera.project(seen[(np.abs(seen[..., :2]) < 1.3 * seen[..., 2:]).all(-1)])
    for corner in np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) * margin_px:
        x, y = np.rint(image + corner).astype(int).T
        inside = (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
        assert mask[y[inside], x[inside]].all()


@pytest.mark.long
def test_a_thin_rod_marks_the_pixels_that_it_jumps_over(llvm: str) -> None:
    """Two triangles 0.05 px wide cross a column of pixels between two instants that both show nothing of it there."""
    depth, fine = 2.0, 0.025
    rod = placed("rectangle", ((20.0 - PLAIN.cx) / PLAIN.fx * depth, 0, depth), (fine / PLAIN.fx * depth, 9, 1))
    scene, edges = load({"rod": rod})
    before, after = (pose(((20.0 - column) / PLAIN.fx * depth, 0, 0)) for column in (19.7, 21.8))
    shapes, _ = hits(scene, PLAIN, before, after, instants=101)
    assert not shapes[[0, -1], :, 21].any(), "the rod is seen at one of the ends"
    assert shapes[:, :, 21].any((0, 2, 3)).all(), "the rod does not cross the column"
    mask = swept(edges, PLAIN, before, after)
    assert mask[:, 20:23].all()
    assert not mask[:, :19].any()
    assert not mask[:, 24:].any()
    wider = swept(edges, PLAIN, before, after, margin_px=1.0)
    assert wider[:, 19:24].all()
    assert not wider[:, 25:].any()


def test_a_camera_inside_a_box_sees_no_edge_of_it(llvm: str) -> None:
    """The corners of a room occlude nothing, whichever way it is moved through; what stands in the room does."""
    room = placed("cube", (0, 0, 0), (4, 4, 8), (0.1, 0.2, 0.3))
    _, edges = load({"room": room})
    for before, after in MOTIONS.values():
        assert not swept(edges, PLAIN, before, after).any()
    scene, edges = load({"room": room, "box": OBJECTS["box"]})
    before, after = MOTIONS["all at once"]
    mask = swept(edges, PLAIN, before, after)
    assert_none_missed(mask, several_shapes(hits(scene, PLAIN, before, after)[0]))
    assert mask.mean() < 0.2


def test_a_crease_seen_from_both_sides_is_not_marked(llvm: str) -> None:
    """Of a cube seen corner first the outline is marked, and the three edges that meet in the middle are not."""
    corner_first = Rotation.align_vectors([[0, 0, -1]], [[1, 1, 1]])[0].as_rotvec()
    _, edges = load({"cube": placed("cube", (0, 0, 5), (0.8, 0.8, 0.8), corner_first)})
    before, after = pose(), pose((0.01, 0, 0))
    mask = swept(edges, PLAIN, before, after)
    assert mask.any()
    x, y = np.rint(PLAIN.project([0, 0, 4])).astype(int)
    assert not mask[y - 4 : y + 5, x - 4 : x + 5].any()


def test_a_fold_that_occludes_only_on_the_way_is_marked() -> None:
    """A camera that passes both wings' planes sees them to both sides at both ends, and one behind the other between.

    Without passing them it never does, and nothing is marked.
    """
    edge, wings = [[[0.0, -9.0, 3.0], [0.0, 9.0, 3.0]]], [[[1.0, 0.0, 4.0], [-1.0, 0.0, 4.0]]]
    fold = Silhouettes(edge, wings)
    front = pose((0.0, 0, -1))
    inside = pose((0.0, 0, 3.5), turn=(0, np.pi, 0))
    assert not swept(fold, PLAIN, front, pose((0.1, 0, -1))).any()
    assert not swept(fold, PLAIN, inside, pose((0.1, 0, 3.5), turn=(0, np.pi, 0))).any()
    beyond = pose((1.5, 0, 4.6))  # past both planes, having left the fold to the left
    before = pose((1.2, 0, 1.0), turn=(0, -0.5, 0))
    assert swept(fold, PLAIN, before, Pose(beyond.position, before.quaternion)).any()


def torus(path: Path) -> dict[str, Any]:
    """A ring of radius 1 and thickness 0.6, of 3,200 smooth triangles with doubled vertices along a seam."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 41), np.linspace(0, 2 * np.pi, 41), indexing="ij")
    u[-1], v[:, -1] = 0.0, 0.0  # the same places as at the start, to the bit
    ring = 1 + 0.3 * np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), 0.3 * np.sin(v)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(40), np.arange(40), indexing="ij")
    a = (i * 41 + j).ravel() + 1
    faces = np.concatenate([np.stack([a, a + 41, a + 42], 1), np.stack([a, a + 42, a + 1], 1)])
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices] + [f"f {p} {q} {r}" for p, q, r in faces]
    path.write_text("\n".join(lines) + "\n")
    return {**placed("obj", (0, 0, 3), (1, 1, 1), (1.25, 0.2, 0)), "filename": str(path)}


@pytest.mark.few(1)
@CAMERAS
def test_a_smooth_mesh_that_hides_itself(llvm: str, tmp_path: Path, camera: Camera) -> None:
    """Of a ring its outline, and where its near side ends before its far side; not the thousands of edges between."""
    scene, edges = load({"ring": torus(tmp_path / "ring.obj")})
    assert len(edges.edges) == 3 * 1600 * 2 // 2
    before, after = pose(), pose((0.05, 0.02, 0.05), (0, 0, 0.02))
    shapes, depth = hits(scene, camera, before, after)
    finite = np.where(np.isinf(depth), 1e3, depth)
    # Depth along the surface changes by less from ray to ray.
    jumps = np.maximum(np.abs(np.diff(finite, axis=3)).max((0, 3, 4)), np.abs(np.diff(finite, axis=4)).max((0, 3, 4)))
    hides_itself = (jumps > 0.5) & (shapes.min((0, 3, 4)) > 0)
    assert hides_itself.sum() >= 10
    mask = swept(edges, camera, before, after)
    assert_none_missed(mask, hides_itself | several_shapes(shapes))
    assert mask.mean() < 0.4


def test_shapes_that_are_not_meshes_sweep_their_boxes(llvm: str) -> None:
    """A sphere's outline is found although it has no edges, and from inside of its box every pixel counts."""
    scene, edges = load({"ball": {"type": "sphere", "center": [0.3, 0.1, 3.0], "radius": 0.4}})
    for name in ("sideways", "panning", "all at once", "far in one step"):
        mask = swept(edges, PLAIN, *MOTIONS[name])
        assert_none_missed(mask, several_shapes(hits(scene, PLAIN, *MOTIONS[name])[0]))
        assert name == "far in one step" or mask.mean() < 0.4
    assert swept(edges, PLAIN, pose((0.3, 0.1, 2.8)), pose((0.3, 0.1, 2.9))).all()
    assert not swept(edges, PLAIN, pose(turn=(0, np.pi, 0)), pose((0, 0, 0.1), turn=(0, np.pi, 0))).any()


def test_an_edge_through_the_camera_marks_everything() -> None:
    """An edge that the camera's centre passes through sweeps the whole image; one just behind it sweeps nothing."""
    before, after = pose((0, -0.1, 0)), pose((0, 0.2, 0.0))
    assert swept(Silhouettes([[[-1, 0, 0], [1, 0, 0]]], ALWAYS), PLAIN, before, after).all()
    assert not swept(Silhouettes([[[-1, 0, -0.01], [1, 0, -0.01]]], ALWAYS), PLAIN, before, after).any()


@CAMERAS
def test_an_edge_past_the_camera_marks_a_strip(camera: Camera) -> None:
    """An edge that begins behind the camera and passes it closely is cut off, not projected through it."""
    edges = Silhouettes([[[0.02, 0.03, -2], [-0.02, 0.02, 3]]], ALWAYS)
    for travel in ((0.0, 0.0, 0.02), (0.001, 0.0, 0.0)):
        mask = swept(edges, camera, pose(), pose(travel))
        assert mask[camera.height // 2 + 4 :].any(1).all()
        assert not mask[: camera.height // 2 - 2].any()
        assert mask.mean() < 0.1


def test_at_rest_nothing_is_swept_and_intervals_are_apart() -> None:
    """Many intervals in one call give what each gives alone; those without motion give nothing."""
    edges = Silhouettes([[[-0.4, -0.3, 2], [0.5, 0.4, 3]], [[0.2, -9, 1], [0.3, 9, 4]]], np.full((2, 2, 3), np.nan))
    path: Sequence[Pose] = [at for pair in MOTIONS.values() for at in pair]
    flipped = Pose(path[-1].position, -path[-1].quaternion)
    before, after = [*path[:-1], path[3], path[-1]], [*path[1:], path[3], flipped]
    together = edges.swept(LENS, before, after, margin_px=1.0)
    assert together.shape == (len(before), LENS.height, LENS.width)
    assert together.any((1, 2)).sum() >= len(MOTIONS)
    for mask, start, end in zip(together > 0, before, after, strict=True):
        assert np.array_equal(mask, swept(edges, LENS, start, end, margin_px=1.0))
    assert not together[-2:].any()
    assert edges.swept(LENS, [], [], margin_px=1.0).shape == (0, LENS.height, LENS.width)
    assert not Silhouettes((), ()).swept(LENS, before, after, margin_px=1.0).any()


def test_edges_that_sweep_a_pixel_are_counted() -> None:
    """One edge alone counts once, but for its ends; between two that lie closer than the margin is where both count."""
    one = [[-0.4, -9.0, 2.0], [-0.4, 9.0, 2.0]]
    other = [[-0.38, -9.0, 2.0], [-0.38, 9.0, 2.0]]
    far = [[0.4, -9.0, 2.0], [0.4, 9.0, 2.0]]
    before, after = pose(), pose((0.01, 0.0, 0.0))
    apart, close = (
        Silhouettes(edges, np.full((2, 2, 3), np.nan)).swept(PLAIN, [before], [after], margin_px=0.0)[0]
        for edges in ([one, far], [one, other])
    )
    alone = Silhouettes([one], np.full((1, 2, 3), np.nan)).swept(PLAIN, [before], [after], margin_px=0.0)[0]
    assert alone.max() == apart.max() == 1
    assert close.max() == 2
    assert np.array_equal(close > 0, swept(Silhouettes([one, other], np.full((2, 2, 3), np.nan)), PLAIN, before, after))
    assert (close == 2).any(1).all()


def test_edges_of_a_mesh_by_hand() -> None:
    """Two triangles share one edge, whose wings are known; a third on that edge makes it count always."""
    a, b, c, d, e = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 1], [0, 0, 1]])
    edges, wings = mesh_edges(np.array([[a, b, c], [b, a, d], [a, a, e]]))
    assert len(edges) == 5
    inner = np.isfinite(wings).all((1, 2))
    assert inner.sum() == 1
    assert sorted(edges[inner][0].tolist()) == sorted([a.tolist(), b.tolist()])
    assert sorted(wings[inner][0].tolist()) == sorted([c.tolist(), d.tolist()])
    edges, wings = mesh_edges(np.array([[a, b, c], [b, a, d], [a, b, e]]))
    assert len(edges) == 7
    assert np.isnan(wings).all()


def test_what_cannot_be_is_refused() -> None:
    """Unequal numbers, negative margins and corners that are not finite raise a ValueError that gives the value."""
    edges = Silhouettes([[[0, 0, 1], [1, 0, 1]]], ALWAYS)
    with pytest.raises(ValueError, match="2 intervals begin, but 1 end"):
        edges.swept(PLAIN, [pose(), pose()], [pose()], margin_px=1.0)
    for margin_px in (-1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match=f"margin_px must be finite and >= 0, got {margin_px}"):
            swept(edges, PLAIN, pose(), pose(), margin_px=margin_px)
    with pytest.raises(ValueError, match="got 0 edges and wings of 1"):
        Silhouettes((), ALWAYS)
    with pytest.raises(ValueError, match="must be finite"):
        Silhouettes([[[0.0, 0.0, np.inf], [1.0, 0.0, 1.0]]], ALWAYS)
