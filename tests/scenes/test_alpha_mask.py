"""Alpha masks: what is left of triangles is where the bilinear alpha reaches the cutoff, in every kind of file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy.ndimage import gaussian_filter

from davis_rs import Camera, Scene, load_scene
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs._util.budget import Budget
from davis_rs.geometry.pose import Pose
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene.files.alpha_mask import TOLERANCE_TEXELS, AlphaMask, Pieces, blended, masked
from davis_rs.scene.files.obj_file import read_obj
from davis_rs.scene.files.ply_file import read_ply
from davis_rs.scene.lost_looks import NO_MASK
from davis_rs.scene.mesh_part import MeshPart
from gltf_files import UV, Gltf, quad

FloatArray = npt.NDArray[np.float64]
WRAPS = ["repeat", "clamp", "mirror"]
DISC = 20.0
"""Radius of the disc on textures of 64 x 64 texels."""


def blobs(seed: int, shape: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """A smooth random alpha of which about a half is seen, as clouds."""
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=shape), 2.0, mode="wrap")
    return np.clip(127.5 + 90 * noise / noise.std(), 0, 255).astype(np.uint8)


def disc(radius: float = DISC, size: int = 64) -> npt.NDArray[np.uint8]:
    """A disc whose edge is one texel soft."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    return np.asarray(255 * np.clip(radius - np.hypot(x, y) + 0.5, 0, 1), np.uint8)


def bilinear(mask: AlphaMask, uv: FloatArray) -> FloatArray:
    """Alpha (n,), 0 to 255, by the definition."""
    height, width = mask.alpha.shape
    x, y = (uv * (width, height) - 0.5).T
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)

    def wrapped(index: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.int64]:
        if mask.wrap == "clamp":
            return np.clip(index, 0, count - 1)
        if mask.wrap == "repeat":
            return index % count
        return np.minimum(index % (2 * count), 2 * count - 1 - index % (2 * count))

    def at(dy: int, dx: int) -> FloatArray:
        return mask.alpha[wrapped(row + dy, height), wrapped(column + dx, width)].astype(np.float64)

    right, down = x - column, y - row
    upper, lower = ((1 - right) * at(dy, 0) + right * at(dy, 1) for dy in (0, 1))
    return np.asarray((1 - down) * upper + down * lower)


def covered(pieces: Pieces, triangle: int, weights: FloatArray) -> npt.NDArray[np.int64]:
    """In how many pieces of a triangle each of its points lies."""
    count = np.zeros(len(weights), np.int64)
    for corners in pieces.weights[pieces.source == triangle]:
        count += (np.linalg.solve(corners.T, weights.T) >= 0).all(0)
    return count


def areas(pieces: Pieces, count: int) -> FloatArray:
    """The area of all pieces of each triangle, as a fraction of it."""
    weights = pieces.weights
    a, b = weights[:, 1, 1:] - weights[:, 0, 1:], weights[:, 2, 1:] - weights[:, 0, 1:]
    twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    assert (twice > 0).all()  # turned as their triangle
    return np.asarray(np.bincount(pieces.source, twice, count), np.float64)


@pytest.mark.parametrize("wrap", WRAPS)
@given(data=st.data())
def test_what_is_left_is_where_alpha_reaches_the_cutoff(wrap: str, data: st.DataObject) -> None:
    """At any point of any triangle, over tiles, turned or mirrored, but for an eighth of a texel along outlines."""
    seed = data.draw(st.integers(0, 2**32 - 1))
    shape = data.draw(st.sampled_from([(16, 16), (9, 24), (17, 6)]))
    mask = AlphaMask(blobs(seed, shape), data.draw(st.sampled_from([0.3, 0.5, 0.65])), wrap)
    rng = np.random.default_rng(seed)
    uv = rng.uniform(-1.4, 1.9, (3, 3, 2))
    pieces = mask.cut(uv)
    assert pieces is not None
    assert pieces.tolerance_texels == TOLERANCE_TEXELS
    assert (np.diff(pieces.source) >= 0).all()
    np.testing.assert_allclose(pieces.weights.sum(2), 1.0, rtol=0, atol=1e-12)
    assert (pieces.weights >= -1e-12).all()
    weights = rng.dirichlet([1, 1, 1], 400)
    for triangle in range(3):
        points = weights @ uv[triangle]
        # Alpha an eighth of a texel around says whether the outline is near.
        angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
        ring = np.stack([np.cos(angle), np.sin(angle)], 1) / 8 / (shape[1], shape[0])
        around = [bilinear(mask, points + step) >= 255 * mask.cutoff for step in [*ring, np.zeros(2)]]
        clear = np.all(around, 0) | ~np.any(around, 0)
        assert clear.mean() > 0.5
        count = covered(pieces, triangle, weights)
        assert np.array_equal(count[clear] > 0, around[-1][clear])
        assert (count > 1).mean() <= 0.005  # no two pieces overlap


@pytest.mark.parametrize("wrap", WRAPS)
def test_tiles_meet_without_cracks(wrap: str) -> None:
    """Points as near as a 300th of a texel to the seam between two tiles are covered where alpha is far above the
    cutoff."""
    seen = 0
    for seed in range(30):
        mask = AlphaMask(blobs(seed, (16, 16)), 0.3, wrap)
        uv = np.array([[[-0.7, 0.1], [1.9, 0.1], [0.6, 3.0]]])
        pieces = mask.cut(uv)
        assert pieces is not None
        along, off = np.linspace(0.15, 0.99, 200), np.array([-1, 1])[:, None] / (300 * 16)
        points = np.stack(np.broadcast_arrays(1 + off, along), -1).reshape(-1, 2)
        second, third = np.linalg.solve((uv[0, 1:] - uv[0, 0]).T, (points - uv[0, 0]).T)
        weights = np.stack([1 - second - third, second, third], 1)
        inside = (weights > 0).all(1) & (bilinear(mask, points) > 255 * mask.cutoff + 60)
        assert (covered(pieces, 0, weights[inside]) > 0).all(), seed
        seen += int(inside.sum())
    assert seen > 2000


@pytest.mark.parametrize("wrap", WRAPS)
def test_the_area_of_a_disc(wrap: str) -> None:
    """Of a soft edge the middle counts; a triangle that is seen as a whole stays as it is; one that is not, goes."""
    mask = AlphaMask(disc(), 0.5, wrap)
    half = np.array([[0.0, 0], [1, 0], [1, 1]])
    inside = np.array([[0.4, 0.4], [0.6, 0.45], [0.5, 0.6]])
    outside = np.array([[0.02, 0.02], [0.1, 0.02], [0.02, 0.1]])
    mirrored = half[:, ::-1]
    pieces = mask.cut(np.array([half, inside, outside, mirrored, half + 3.0]))
    assert pieces is not None
    found = areas(pieces, 5)
    expected = np.pi * DISC**2 / 64**2
    assert found[:4] == pytest.approx([expected, 1, 0, expected], rel=4e-3)
    assert found[4] == pytest.approx(0.0 if wrap == "clamp" else expected, rel=4e-3)
    assert np.array_equal(pieces.weights[pieces.source == 1], [np.eye(3)])


def test_a_triangle_without_area_among_coordinates_takes_its_texel() -> None:
    """As palettes of colours have: all corners lie at one point, or on a line."""
    alpha = np.array([[128, 127]], np.uint8)
    mask = AlphaMask(alpha, 0.5, "repeat")
    points = np.array([[0.25, 0.5], [0.75, 0.5], [1.25, 0.5], [-0.25, 0.5]])
    uv = np.repeat(points[:, None], 3, 1)
    line = np.array([[0.1, 0.5], [0.2, 0.5], [0.3, 0.5]])
    pieces = mask.cut(np.concatenate([uv, line[None]]))
    assert pieces is not None
    assert pieces.source.tolist() == [0, 2, 4]
    assert np.array_equal(pieces.weights, np.tile(np.eye(3), (3, 1, 1)))
    last = AlphaMask(alpha, 0.5, "clamp").cut(uv)
    assert last is not None
    assert last.source.tolist() == [0, 3]
    reflected = AlphaMask(alpha, 0.5, "mirror").cut(uv)
    assert reflected is not None
    assert reflected.source.tolist() == [0, 3]


@pytest.mark.long
def test_outlines_get_coarser_before_there_are_too_many_pieces() -> None:
    """By how much is told; what would still be too much is not cut."""
    mask = AlphaMask(blobs(3, (128, 128)), 0.5, "repeat")
    square = np.array([[[0.0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]])
    few, many = (mask.cut(np.tile(square, (copies, 1, 1))) for copies in (1, 250))
    assert few is not None
    assert many is not None
    assert few.tolerance_texels == TOLERANCE_TEXELS < many.tolerance_texels <= 8
    assert len(many.source) <= 300_000
    assert areas(many, 500) == pytest.approx(np.tile(areas(few, 2), 250), rel=0.05)
    assert mask.cut(1000.0 * square) is None
    wire = np.zeros((4, 4), np.uint8)
    wire[1] = 255
    assert AlphaMask(wire, 0.5, "repeat").cut(500.0 * square) is None  # coarser, there would be nothing left


@pytest.mark.long
def test_a_mask_as_fine_as_noise_is_taken_in_larger_cells() -> None:
    """So it takes neither hours nor all memory."""
    noise = np.random.default_rng(1).integers(0, 256, (1024, 1024), np.uint8)
    pieces = AlphaMask(noise, 0.5, "repeat").cut(np.array([[[0.0, 0], [0.1, 0], [0, 0.1]]]))
    assert pieces is not None
    assert pieces.tolerance_texels >= 2 * TOLERANCE_TEXELS


@pytest.mark.long
def test_many_triangles_are_cut_as_a_few() -> None:
    """However they are divided for the work."""
    mask = AlphaMask(blobs(4, (128, 128)), 0.5, "repeat")
    rng = np.random.default_rng(5)
    uv = rng.uniform(size=(6000, 1, 2)) + rng.uniform(-0.01, 0.01, (6000, 3, 2))
    whole, *parts = (mask.cut(some) for some in (uv, uv[:100], uv[-100:]))
    assert whole is not None
    for first, part in zip((0, 5900), parts, strict=True):
        assert part is not None
        rows = (whole.source >= first) & (whole.source < first + 100)
        assert np.array_equal(whole.source[rows] - first, part.source)
        assert np.array_equal(whole.weights[rows], part.weights)


@pytest.mark.long
def test_large_and_plain_textures_keep_their_texels() -> None:
    """Cells are counted where the outline passes."""
    alpha = np.full((600, 600), 255, np.uint8)
    alpha[250:350, 250:350] = 0
    pieces = AlphaMask(alpha, 0.5, "repeat").cut(np.array([[[0.0, 0], [1, 0], [1, 1]]]))
    assert pieces is not None
    assert pieces.tolerance_texels == TOLERANCE_TEXELS
    huge = np.full((5000, 5000), 255, np.uint8)
    huge[2000:3000] = 0
    band = AlphaMask(huge, 0.5, "repeat").cut(np.array([[[0.0, 0], [1, 0], [1, 1]]]))
    assert band is not None
    assert areas(band, 1) == pytest.approx(0.8, rel=1e-3)
    assert band.tolerance_texels == 2 * TOLERANCE_TEXELS


def test_texels_with_hard_edges() -> None:
    """Texels are seen or not, each as a whole, over tiles."""
    alpha = np.where(np.random.default_rng(2).uniform(size=(6, 8)) < 0.5, 255, 0).astype(np.uint8)
    weights = np.random.default_rng(3).dirichlet([1, 1, 1], 500)
    for wrap in WRAPS:
        mask = AlphaMask(alpha, 0.5, wrap, nearest=True)
        uv = np.array([[[-0.7, -0.4], [1.8, 0.1], [0.2, 1.9]]])
        pieces = mask.cut(uv)
        assert pieces is not None
        points = weights @ uv[0]
        inside = (np.abs((points * (8, 6)) % 1 - 0.5) < 0.49).all(1)
        shown = covered(pieces, 0, weights) > 0
        assert np.array_equal(shown[inside], mask._seen(points)[inside])
    single = AlphaMask(np.full((1, 1), 255, np.uint8), 0.5, "clamp", nearest=True).cut(uv)
    assert single is not None
    assert np.array_equal(single.weights, [np.eye(3)])


@pytest.mark.long
def test_coarser_outlines_of_a_part_are_told(tmp_path: Path) -> None:
    """And so is a mask that cannot be followed; a part without texture coordinates is as it was."""
    budget = Budget(tmp_path / "part")
    corners = np.random.default_rng(1).uniform(size=(2, 3, 3))
    square = np.array([[[0.0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]])
    part = MeshPart(corners, square, None, np.ones(3), None, "leaf", lost=("gloss",))
    noise = np.random.default_rng(1).integers(0, 256, (1024, 1024), np.uint8)
    coarse = masked(part, AlphaMask(noise, 0.5, "repeat"), budget)
    assert coarse.lost[0] == "gloss"
    assert coarse.lost[1].startswith("outlines of the alpha mask to less than ")
    fine = masked(part, AlphaMask(disc(), 0.5, "repeat"), budget)
    assert fine.lost == ("gloss",)
    far = masked(part._replace(uv=1000 * square), AlphaMask(disc(), 0.5, "repeat"), budget)
    assert far.lost == ("gloss", "transparency")
    assert np.array_equal(far.corners, corners)
    assert masked(part._replace(uv=None), AlphaMask(disc(), 0.5, "repeat"), budget).lost == ("gloss",)


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("size", [1e6, 1e12, 1e30])
def test_coordinates_of_any_size(wrap: str, size: float) -> None:
    """Triangles over more tiles than can be followed, far away, or at one point there, take no time."""
    mask = AlphaMask(disc(), 0.5, wrap)
    wide = np.array([[[0.0, 0], [size, 0], [0, size]]])
    point = np.full((1, 3, 2), size + 0.5)
    far = np.array([[[0.0, 0], [0.1, 0], [0, 0.1]]]) + size
    found = mask.cut(np.concatenate([wide, point, far, -wide]))
    assert found is None if wrap != "clamp" else found is not None
    assert mask.cut(point) is not None
    assert mask.cut(far) is not None


def test_values_of_pieces_are_interpolated() -> None:
    pieces = Pieces(np.array([1]), np.array([[[1.0, 0, 0], [0.5, 0.5, 0], [0, 0, 1]]]), TOLERANCE_TEXELS)
    corners = np.arange(18.0).reshape(2, 3, 3)
    np.testing.assert_allclose(pieces.of(corners)[0], np.array([[9, 10, 11], [10.5, 11.5, 12.5], [15, 16, 17]]))
    normals = np.array([np.eye(3), [[0, 0, 1.0], [0, 1.0, 0], [1, 0, 0]]])
    np.testing.assert_allclose(pieces.normals(normals)[0], np.array([[0, 0, 1], [0, 0.5**0.5, 0.5**0.5], [1, 0, 0]]))
    opposite = np.array([np.eye(3), [[0, 0, 1.0], [0, 0, -1.0], [1, 0, 0]]])
    np.testing.assert_allclose(pieces.normals(opposite)[0, 1], [0, 0, 1])


def test_how_an_alpha_blends() -> None:
    """Cut where it is half opaque; soft ones are told; one that never passes a half is lost."""
    soft = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (8, 1))
    sharp = np.where(np.arange(64) < 32, 255, 0).astype(np.uint8)[None]
    mask, looks = blended(soft)
    assert mask is not None
    assert mask.cutoff == 0.5
    assert looks == ("soft transparency (it is cut where it is half opaque)",)
    assert not mask.nearest
    mask, looks = blended(sharp, factor=0.8, wrap="clamp", nearest=True)
    assert mask is not None
    assert (mask.cutoff, mask.wrap, mask.nearest, looks) == (0.625, "clamp", True, ())
    assert blended(sharp, factor=0.4) == (None, ("transparency",))
    assert blended(None, factor=0.4) == (None, ("transparency",))
    assert blended(None) == (None, ())


def png(alpha: npt.NDArray[np.uint8], grey: int = 200) -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.dstack([np.full((*alpha.shape, 3), grey, np.uint8), alpha])).save(file, "PNG")
    return file.getvalue()


def leaf(gltf: Gltf, more: dict[str, Any], alpha: npt.NDArray[np.uint8] | None = None, factor: float = 1.0) -> int:
    """A material whose texture is a disc."""
    image = gltf.texture({"bufferView": gltf.view(png(disc() if alpha is None else alpha))})
    return gltf.material("leaf", baseColorTexture=image, baseColorFactor=[1, 1, 1, factor], more=more)


def loaded(gltf: Gltf, folder: Path) -> Scene:
    return load_scene(gltf.save(folder / "scene.glb"))


def area_of(scene: Scene, shape: str) -> float:
    with variant(SCALAR) as (mi, _):
        found = {one.id(): one.surface_area() for one in load_scene_source(scene.source(), mi).shapes()}
    return float(np.array(found[shape]).reshape(()))


def lost(scene: Scene) -> list[str]:
    return [str(look) for look in scene.lost_looks]


DISC_AREA = 4 * np.pi * DISC**2 / 64**2
"""On a square of 2 x 2 m."""


@pytest.mark.parametrize(
    ("more", "factor", "cutoff"),
    [
        ({"alphaMode": "MASK"}, 1.0, 0.5),
        ({"alphaMode": "MASK", "alphaCutoff": 0.1}, 1.0, 0.1),
        ({"alphaMode": "MASK", "alphaCutoff": 0.36}, 0.4, 0.9),
        ({"alphaMode": "BLEND"}, 1.0, 0.5),
        ({"alphaMode": "BLEND"}, 0.625, 0.8),
    ],
)
def test_a_gltf_leaf(tmp_path: Path, more: dict[str, Any], factor: float, cutoff: float) -> None:
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, uv=UV, material=leaf(gltf, more, factor=factor)))
    scene = loaded(gltf, tmp_path)
    points = (np.stack(np.meshgrid(np.arange(1000), np.arange(1000)), -1).reshape(-1, 2) + 0.5) / 1000
    seen = bilinear(AlphaMask(disc(), cutoff, "repeat"), points) >= 255 * cutoff
    assert area_of(scene, "mesh_leaf") == pytest.approx(4 * seen.mean(), rel=4e-3)
    assert lost(scene) == []


@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_a_gltf_leaf_of_hard_texels(tmp_path: Path, mode: str) -> None:
    """Whole texels are seen; the bilinear outline of one of four would have another area."""
    gltf = Gltf()
    alpha = np.array([[255, 0], [0, 0]], np.uint8)
    image = gltf.texture({"bufferView": gltf.view(png(alpha))}, {"magFilter": 9728})
    material = gltf.material("leaf", baseColorTexture=image, more={"alphaMode": mode, "alphaCutoff": 0.5})
    gltf.node(mesh=quad(gltf, uv=UV, material=material))
    assert area_of(loaded(gltf, tmp_path), "mesh_leaf") == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize(("below", "mask"), [(0, True), (40, False)], ids=["plain", "drawn"])
def test_an_alpha_that_hides_a_drawing_is_no_mask(tmp_path: Path, below: int, mask: bool) -> None:
    """Such as gloss in the alpha of a colour's texture; map_d says a mask, whatever is below."""
    random = np.random.default_rng(3)
    shown = np.arange(64) < 32
    texels = 100 + random.integers(0, np.where(shown, 20, 1 + below), (64, 64))
    rgba = np.dstack([np.repeat(texels[..., None], 3, 2), np.where(shown, 255, 0) + 0 * texels]).astype(np.uint8)
    Image.fromarray(rgba).save(tmp_path / "a.png")
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    path = tmp_path / "m.obj"
    path.write_text(f"mtllib m.mtl\nusemtl m\n{corners}f 1/1 2/2 3/3 4/4\n")
    (tmp_path / "m.mtl").write_text("newmtl m\nmap_Kd a.png\n")
    (part,) = read_obj(path, Budget(path))
    assert (part.corners[..., 0].max() < 0.6) == mask
    assert part.lost == (() if mask else (NO_MASK,))
    (tmp_path / "m.mtl").write_text("newmtl m\nmap_Kd a.png\nmap_d a.png\n")
    (part,) = read_obj(path, Budget(path))
    assert part.corners[..., 0].max() < 0.6
    assert part.lost == ()
    ply = tmp_path / "m.ply"
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "s", "t"))
    ply.write_text(
        f"ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 4\n{properties}element face 1\n"
        "property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n4 0 1 2 3\n"
    )
    (part,) = read_ply(ply, Budget(ply))
    assert (part.corners[..., 0].max() < 0.6) == mask
    assert part.lost == (() if mask else (NO_MASK,))


@pytest.mark.parametrize("more", [{}, {"alphaMode": "OPAQUE"}])
def test_an_opaque_gltf_material_ignores_alpha(tmp_path: Path, more: dict[str, Any]) -> None:
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, uv=UV, material=leaf(gltf, more)))
    assert area_of(loaded(gltf, tmp_path), "mesh_leaf") == pytest.approx(4.0)


def test_what_an_alpha_hides_is_left_out(tmp_path: Path) -> None:
    """In one line; a mask that shows everything changes nothing."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf, uv=UV, material=leaf(gltf, {"alphaMode": "MASK"}, np.full((2, 2), 40, np.uint8))))
    gltf.node(
        mesh=quad(gltf, material=gltf.material("glass", baseColorFactor=[1, 1, 1, 0.2], more={"alphaMode": "MASK"}))
    )
    full = gltf.material("full", baseColorFactor=[1, 1, 1, 0.6], more={"alphaMode": "MASK"})
    gltf.node(mesh=quad(gltf, material=full))
    with pytest.warns(UserWarning, match="triangles that the alpha of their material hides are left out: 4"):
        scene = loaded(gltf, tmp_path)
    assert lost(scene) == []
    assert area_of(scene, "mesh_full") == pytest.approx(4.0)
    with pytest.raises(KeyError):
        area_of(scene, "mesh_glass")


def test_soft_metal_is_told(tmp_path: Path) -> None:
    """What blends is diffuse."""
    for metal in (0.0, 1.0):
        gltf = Gltf()
        haze = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (64, 1))
        material = leaf(gltf, {"alphaMode": "BLEND"}, haze)
        gltf.document["materials"][material]["pbrMetallicRoughness"]["metallicFactor"] = metal
        gltf.node(mesh=quad(gltf, uv=UV, material=material))
        scene = loaded(gltf, tmp_path)
        assert lost(scene) == (["metal of leaf"] if metal else [])
        assert area_of(scene, "mesh_leaf") == pytest.approx(4.0)


def test_what_is_soft_at_its_edges_alone_is_cut(tmp_path: Path) -> None:
    """So that its shadow is not that of the card: a leaf of which two fifths are soft, and a haze of three fifths."""
    for soft, told in ((0.4, True), (0.6, False)):
        count = round(64 * soft)
        alpha = np.full(64, 255, np.uint8)
        alpha[:count] = np.linspace(26, 229, count)
        gltf = Gltf()
        material = leaf(gltf, {"alphaMode": "BLEND"}, np.tile(alpha, (64, 1)))
        gltf.node(mesh=quad(gltf, uv=UV, material=material))
        scene = loaded(gltf, tmp_path)
        cut = ["soft transparency (it is cut where it is half opaque) of leaf"]
        assert lost(scene) == (cut if told else [])
        assert (area_of(scene, "mesh_leaf") < 3.5) == told
        grey(tmp_path, "soft.png", np.tile(alpha, (64, 1)))
        (tmp_path / "m.mtl").write_text("newmtl leaf\nmap_d soft.png\n")
        (tmp_path / "m.obj").write_text(OBJ.format(FACE))
        (part,) = read_obj(tmp_path / "m.obj", Budget(tmp_path / "m.obj"))
        assert part.lost == (("soft transparency (it is cut where it is half opaque)",) if told else ())
        assert (part.blend is None) == told


def test_a_mask_on_what_deforms_is_lost(tmp_path: Path) -> None:
    """A skin moves vertices, and pieces of triangles would not follow."""
    gltf = Gltf()
    mesh = quad(gltf, uv=UV, material=leaf(gltf, {"alphaMode": "MASK"}))
    attributes = gltf.document["meshes"][mesh]["primitives"][0]["attributes"]
    attributes |= {"JOINTS_0": gltf.array(np.zeros((4, 4)), "u1"), "WEIGHTS_0": gltf.array(np.eye(4)[[0] * 4])}
    joint = gltf.node(name="joint")
    gltf.animate(joint, "translation", [0.0, 1.0], np.array([[0, 0, 0], [0.5, 0, 0]]))
    gltf.node(name="body", mesh=mesh, skin=gltf.add("skins", {"joints": [joint]}))
    scene = loaded(gltf, tmp_path)
    assert lost(scene) == ["transparency of leaf"]
    assert area_of(scene, "body_leaf") == pytest.approx(4.0)


def test_a_mask_on_what_moves(tmp_path: Path) -> None:
    gltf = Gltf()
    node = gltf.node(name="kite", mesh=quad(gltf, uv=UV, material=leaf(gltf, {"alphaMode": "MASK"})))
    gltf.animate(node, "translation", [0.0, 1.0], np.array([[0, 0, 0], [0.5, 0, 0]]))
    scene = loaded(gltf, tmp_path)
    assert list(scene.objects) == ["kite_leaf"]
    assert area_of(scene, "kite_leaf") == pytest.approx(DISC_AREA, rel=4e-3)


def test_depth_light_and_shadow_are_those_of_the_disc(tmp_path: Path) -> None:
    """Through what is cut out the floor is seen; the sun's shadow on it is round."""
    gltf = Gltf()
    floor = gltf.material("floor", baseColorFactor=[0.5, 0.5, 0.5, 1])
    gltf.node(mesh=quad(gltf, material=floor), scale=[4, 4, 1], translation=[0, 0, -1])
    gltf.node(mesh=quad(gltf, uv=UV, material=leaf(gltf, {"alphaMode": "MASK"})))
    slanted = np.array([np.sin(-0.5), 0, 0, np.cos(-0.5)])  # light goes towards -y and the floor
    gltf.light({"type": "directional", "intensity": 2000.0}, rotation=slanted.tolist())
    scene = loaded(gltf, tmp_path)
    camera = Camera(121, 121, 60.0, 60.0, 60.0, 60.0)
    # 3 m in front of the leaf; in the world z of the file is -y.
    turn = np.array([np.sin(np.pi / 4), 0, 0, np.cos(np.pi / 4)])
    view = Views.at_rest([Pose([0.0, -3.0, 0.0], [-turn[0], 0, 0, turn[3]])])
    renderer = make_renderer(scene, camera, rays_per_pixel=16)
    depth, luma = renderer.depth(view)[0], renderer.luma(view)[0]
    y, x = (np.mgrid[:121, :121] - 60.0) / 60.0
    radius = 2 * DISC / 64
    away = np.abs(3 * np.hypot(x, y) - radius) > 0.04
    leaf_seen = 3 * np.hypot(x, y) < radius
    np.testing.assert_allclose(depth[away], np.where(leaf_seen, 3.0, 4.0)[away], rtol=1e-5)
    # A point of the floor is in shadow if the way to the sun passes the disc: 1 m up to it, tan(1 rad) m along y.
    distance = np.hypot(4 * x, 4 * y - np.tan(1.0))  # light goes down the image
    shaded = (distance < radius - 0.07) & ~leaf_seen & away
    lit = (distance > radius + 0.07) & ~leaf_seen & away
    assert shaded.any()
    assert luma[shaded].max() < 0.2 * luma[lit].min()


OBJ = "mtllib m.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl leaf\n{}\n"
FACE = "f 1/1 2/2 3/3 4/4"
UPPER = np.repeat(np.where(np.arange(64) < 16, 255, 0).astype(np.uint8)[:, None], 64, 1)
"""What is seen is the upper quarter of the image."""


def grey(folder: Path, name: str, values: npt.NDArray[np.uint8]) -> None:
    Image.fromarray(values).save(folder / name)


@pytest.mark.parametrize(
    ("lines", "height"),
    [
        ("map_Kd alpha.png", 0.25),
        ("map_Kd solid.png\nmap_d grey.png", 0.25),
        ("map_d grey.png", 0.25),
        ("map_d alpha.png", 0.25),
        ("map_Kd alpha.png\nmap_d white.png", 1.0),
    ],
)
def test_an_obj_leaf(tmp_path: Path, lines: str, height: float) -> None:
    """By map_d, its alpha or else its grey, or by the alpha of the texture. The upper edge of images is at v = 1."""
    (tmp_path / "m.mtl").write_text(f"newmtl leaf\n{lines}\n")
    (tmp_path / "m.obj").write_text(OBJ.format(FACE))
    (tmp_path / "alpha.png").write_bytes(png(UPPER))
    grey(tmp_path, "grey.png", UPPER)
    grey(tmp_path, "solid.png", np.full((4, 4), 90, np.uint8))
    grey(tmp_path, "white.png", np.full((4, 4), 255, np.uint8))
    (part,) = read_obj(tmp_path / "m.obj", Budget(tmp_path / "m.obj"))
    assert part.lost == ()
    assert (part.corners[..., 1].min(), part.corners[..., 1].max()) == pytest.approx((1 - 2 * height, 1.0), abs=1e-9)
    assert part.uv is not None
    np.testing.assert_allclose(part.uv, (part.corners[..., :2] + 1) / 2, atol=1e-12)
    for name in (line.split()[1] for line in lines.splitlines()):
        assert tmp_path / name in part.files


@pytest.mark.parametrize(
    ("lines", "face"),
    [
        ("map_d -clamp on grey.png", FACE),
        ("map_d missing.png", FACE),
        ("map_d grey.png", "f 1 2 3 4"),
        ("d -halo 0.4", FACE),
        ("Tr 1.5", FACE),
        ("Tr 1", FACE),
        ("d 0", FACE),
    ],
)
def test_an_obj_opacity_that_is_not_followed_is_told(tmp_path: Path, lines: str, face: str) -> None:
    (tmp_path / "m.mtl").write_text(f"newmtl leaf\n{lines}\n")
    (tmp_path / "m.obj").write_text(OBJ.format(face))
    grey(tmp_path, "grey.png", UPPER)
    (part,) = read_obj(tmp_path / "m.obj", Budget(tmp_path / "m.obj"))
    assert part.lost == ("transparency",)
    assert len(part.corners) == 2
    assert part.blend is None


def test_an_opacity_that_is_1_everywhere_needs_no_coordinates(tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_text("newmtl leaf\nmap_d white.png\n")
    (tmp_path / "m.obj").write_text(OBJ.format("f 1 2 3 4"))
    grey(tmp_path, "white.png", np.full((4, 4), 255, np.uint8))
    (part,) = read_obj(tmp_path / "m.obj", Budget(tmp_path / "m.obj"))
    assert part.lost == ()


def test_a_ply_leaf(tmp_path: Path) -> None:
    header = ["ply", "format ascii 1.0", "comment TextureFile leaf.png", "element vertex 4"]
    header += [f"property float {name}" for name in ("x", "y", "z", "s", "t")]
    header += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{x} {y} 0 {(x + 1) / 2} {(y + 1) / 2}" for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    (tmp_path / "m.ply").write_text("\n".join([*header, *rows, "4 0 1 2 3", ""]))
    (tmp_path / "leaf.png").write_bytes(png(UPPER))
    part = read_ply(tmp_path / "m.ply", Budget(tmp_path / "m.ply"))[0]
    assert part.lost == ()
    assert part.corners[..., 1].min() == pytest.approx(0.5)
