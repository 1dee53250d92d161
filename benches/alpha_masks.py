"""What alpha masks cost, and how well cards are cut along them: python benches/alpha_masks.py [--picture FILE]

A crown of cards with twigs of leaves, as OBJ with a PNG that has alpha. First, one card that faces the camera: by how
much the coverage of pixels is off (root mean square), by lines and by rays, from the bilinear alpha itself at 16 x 16
places in each. Then crowns of 30 to 1,000 cards, 240 x 180, 8 rays a pixel, on one thread: pieces, the tolerance of
their outlines, the time to read the file, and the least processor time of a frame, next to the same cards without a
mask.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image
from render_native import measure
from scipy.ndimage import map_coordinates

from davis_rs import Camera, Pose, load_scene
from davis_rs._util.budget import Budget
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene.files.alpha_mask import TOLERANCE_TEXELS
from davis_rs.scene.files.obj_file import read_obj

CARDS = (30, 100, 300, 1_000)
TEXELS = 256
VIEWS = 4


def twig() -> npt.NDArray[np.uint8]:
    """Draw a twig with leaves on both sides, RGBA (256, 256, 4), with edges one texel soft."""
    y, x = np.mgrid[:TEXELS, :TEXELS] + 0.5
    inside = 1.5 - np.abs(x - 128)
    rng = np.random.default_rng(1)
    for number, height in enumerate(np.linspace(30, 225, 14)):
        angle = (0.7 if number % 2 else np.pi - 0.7) + rng.uniform(-0.2, 0.2)
        length = rng.uniform(35, 55)
        along = np.array([np.cos(angle), -np.sin(angle)])
        centre = np.array([128, height]) + along * length * 0.55
        u = (x - centre[0]) * along[0] + (y - centre[1]) * along[1]
        v = (x - centre[0]) * -along[1] + (y - centre[1]) * along[0]
        inside = np.maximum(inside, (1 - np.hypot(u / (length / 2), v / (length / 5))) * length / 5)
    alpha = np.clip(inside + 0.5, 0, 1)
    shade = 0.75 + 0.25 * np.sin(x / 5) * np.sin(y / 7)
    colour = np.array([90, 150, 60]) * shade[..., None]
    return np.dstack([colour, 255 * alpha]).astype(np.uint8)


def crown(folder: Path, cards: int, *, masked: bool = True, facing: bool = False) -> Path:
    """Write a crown of cards of 0.5 m; ``facing``: one card of 2 m in the plane z = 0."""
    image = Image.fromarray(twig())
    (image if masked else image.convert("RGB")).save(folder / "twig.png")
    (folder / "crown.mtl").write_text("newmtl twig\nmap_Kd twig.png\n")
    rng = np.random.default_rng(2)
    lines = ["mtllib crown.mtl", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", "usemtl twig"]
    for card in range(cards):
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        middle = rng.normal(size=3)
        middle *= rng.uniform(0.3, 1.0) ** (1 / 3) / np.linalg.norm(middle)
        half = 0.25
        if facing:
            axes, middle, half = np.eye(3), np.zeros(3), 1.0
        for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            lines.append("v {:.6f} {:.6f} {:.6f}".format(*(middle + half * (u * axes[0] + v * axes[1]))))
        lines.append("f " + " ".join(f"{4 * card + corner}/{corner}" for corner in (1, 2, 3, 4)))
    path = folder / "crown.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def coverage_row(folder: Path, pixels: int) -> None:
    """Print how far the coverage of pixels is off where so many of them see the card from side to side."""
    path = crown(folder, 1, facing=True)
    Image.fromarray(np.dstack([np.full((TEXELS, TEXELS, 3), 255, np.uint8), twig()[..., 3]])).save(folder / "twig.png")
    scene = load_scene(path, up="z")
    source = scene.source()
    assert isinstance(source, dict)
    parts = {name: part for name, part in source.items() if name not in ("sun", "sky")}
    sun = {"type": "directional", "direction": [0, 0, -1], "irradiance": np.pi}
    white = replace(scene, source=lambda: {**parts, "sun": sun})
    camera = Camera(pixels, pixels, pixels / 2, pixels / 2, pixels / 2 - 0.5, pixels / 2 - 0.5)
    # From 1 m above, from where the card fills the image; its rows are the image's.
    above = Views.at_rest([Pose([0, 0, 1], [1, 0, 0, 0])])
    off = {}
    finely = (np.arange(16 * pixels) + 0.5) / (16 * pixels) * TEXELS - 0.5
    alpha = map_coordinates(
        twig()[..., 3].astype(float), np.meshgrid(finely, finely, indexing="ij"), order=1, mode="grid-wrap"
    )
    true = (alpha >= 127.5).reshape(pixels, 16, pixels, 16).mean((1, 3))
    for estimator in ("lines", "rays"):
        renderer = make_renderer(white, camera, kind="native", pixel=estimator, lattice_rays_per_pixel=32, threads=1)
        off[estimator] = renderer.luma(above)[0] - true
    rms = [np.sqrt((off[name] ** 2).mean()) for name in ("lines", "rays")]
    print(
        f"| {TEXELS / pixels:g} | {rms[0]:.4f} | {rms[1]:.4f} | {abs(off['lines'].mean()) / true.mean():.2%} |",
        flush=True,
    )


def crown_row(folder: Path, cards: int) -> None:
    """Print what a crown of so many cards costs."""
    renderers = []
    for masked in (False, True):
        path = crown(folder, cards, masked=masked)
        begun = time.process_time()
        scene = load_scene(path, up="z")
        read = time.process_time() - begun
        part = read_obj(path, Budget(path))[0]
        renderers.append(make_renderer(scene, scene.own_camera, kind="native", rays_per_pixel=8, threads=1))
    told = [look.removeprefix("outlines of the alpha mask to less than ") for look in part.lost]
    views = Views.along(scene.path, 0.1 + 0.01 * np.arange(VIEWS))
    least = measure({"whole": lambda: renderers[0].luma(views), "cut": lambda: renderers[1].luma(views)})
    whole, cut = (least[name][1] / VIEWS for name in ("whole", "cut"))
    tolerance = told[0] if told else f"{TOLERANCE_TEXELS:g} texels"
    print(f"| {cards:,} | {len(part.corners):,} | {tolerance} | {read:.1f} | {whole:.1f} | {cut:.1f} |", flush=True)


def draw(folder: Path, path: Path) -> None:
    """Draw the crown of 300 cards, whole and cut."""
    images = []
    for masked in (False, True):
        scene = load_scene(crown(folder, 300, masked=masked), up="z")
        camera = Camera(480, 360, 720.0, 720.0, 239.5, 179.5)
        renderer = make_renderer(scene, camera, kind="native", rays_per_pixel=32)
        images.append(renderer.luma(Views.along(scene.path, np.array([0.0])))[0])
    both = np.concatenate(images, 1) / 0.6
    Image.fromarray((255 * np.clip(both, 0, 1) ** (1 / 2.2)).astype(np.uint8)).save(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", type=Path, help="draw the crown of 300 cards, whole and cut, into this file")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if options.picture is not None:
            draw(folder, options.picture)
        print("| texels a pixel | coverage, 16 lines: rms off | 32 rays: rms off | area off (lines) |")
        print("|---:|---:|---:|---:|")
        for pixels in (1024, 256, 64):
            coverage_row(folder, pixels)
        print("\n| cards | pieces | outlines to | read, s | whole cards, ms a frame | cut, ms a frame |")
        print("|---:|---:|---|---:|---:|---:|")
        for cards in CARDS:
            crown_row(folder, cards)


if __name__ == "__main__":
    main()
