"""Compares glossy surfaces of the renderers without noise with Mitsuba's path tracer, material by material.

    python benches/gloss.py [--samples 4096] [--size 64] [--rays 32] [--only NAME] [--pictures FOLDER] [--kept FOLDER]

Each scene has a ball of one material over a diffuse floor, next to a diffuse block, under one light. A row says: the
root mean square of log luma against the path tracer, in units of C = 0.15, over pixels of the ball and over all others,
where the reference's standard error is below 0.1 C; the fraction of the ball's pixels for which that is so; that error
itself; and processor time a frame. With --pictures, light_gloss.png has a row for each material and a column for each
light: the picture, the path tracer's, and their difference (grey where there is none, white and black at 3 C).
References are kept in a folder if one is named. The table of docs/light.md.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from labelled_sheet import labelled_sheet
from path_tracer import C, difference, first_view, luma_of, reference, shown
from PIL import Image

import davis_rs
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.motions import slider
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.renderer import NativeRenderer

MATERIALS = {
    "plastic": '<bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.1, 0.3, 0.5"/></bsdf>',
    "roughplastic 0.1": '<bsdf type="roughplastic"><float name="alpha" value="0.1"/></bsdf>',
    "conductor Au": '<bsdf type="conductor"><string name="material" value="Au"/></bsdf>',
    "roughconductor 0.05": '<bsdf type="roughconductor"><string name="material" value="Al"/>'
    '<float name="alpha" value="0.05"/><string name="distribution" value="ggx"/></bsdf>',
    "roughconductor 0.3": '<bsdf type="roughconductor"><string name="material" value="Cu"/>'
    '<float name="alpha" value="0.3"/></bsdf>',
    "principled metal 0.3": '<bsdf type="principled"><rgb name="base_color" value="0.9, 0.6, 0.3"/>'
    '<float name="metallic" value="1"/><float name="roughness" value="0.3"/></bsdf>',
    "principled 0.5": '<bsdf type="principled"><rgb name="base_color" value="0.2, 0.5, 0.3"/>'
    '<float name="roughness" value="0.5"/></bsdf>',
    "principled, coated": '<bsdf type="principled"><rgb name="base_color" value="0.3, 0.03, 0.02"/>'
    '<float name="roughness" value="0.5"/><float name="clearcoat" value="1"/>'
    '<float name="clearcoat_gloss" value="0.9"/></bsdf>',
    "principled, sheen": '<bsdf type="principled"><rgb name="base_color" value="0.1, 0.1, 0.4"/>'
    '<float name="roughness" value="0.9"/><float name="sheen" value="1"/><float name="sheen_tint" value="0.5"/>'
    '<float name="spec_tint" value="0.5"/></bsdf>',
    "dielectric": '<bsdf type="dielectric"/>',
    "roughdielectric 0.2": '<bsdf type="roughdielectric"><float name="alpha" value="0.2"/></bsdf>',
    "thindielectric": '<bsdf type="thindielectric"/>',
}

LIGHTS = {
    "point": '<emitter type="point"><point name="position" value="-2, -2, 3"/><rgb name="intensity" value="12"/>'
    '</emitter><emitter type="constant"><rgb name="radiance" value="0.3"/></emitter>',
    "lamp": '<shape type="rectangle"><transform name="to_world"><scale value="0.6"/>'
    '<lookat origin="-1.5, -1, 2.5" target="0, 0, 0" up="1, 0, 0"/></transform>'
    '<emitter type="area"><rgb name="radiance" value="8, 7, 6"/></emitter></shape>'
    '<emitter type="constant"><rgb name="radiance" value="0.1"/></emitter>',
    "sky": '<emitter type="envmap"><string name="filename" value="sky.exr"/>'
    '<transform name="to_world"><rotate x="1" angle="90"/></transform></emitter>',
}

SCENE = """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="8"/></integrator>
<sensor type="perspective"><float name="fov" value="38"/><transform name="to_world">
<lookat origin="0.3, -3, 1.3" target="0.15, 0, 0.45" up="0, 0, 1"/></transform>
<film type="hdrfilm"><integer name="width" value="128"/><integer name="height" value="128"/></film></sensor>
{light}
<shape type="rectangle" id="floor"><transform name="to_world"><scale value="4"/></transform>
<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.45, 0.4"/></bsdf></bsdf></shape>
<shape type="cube" id="block"><transform name="to_world"><scale value="0.25"/><translate x="0.75" y="-0.3" z="0.25"/>
</transform><bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.2, 0.1"/></bsdf></shape>
<shape type="sphere" id="ball"><float name="radius" value="0.5"/><point name="center" value="0, 0, 0.5"/>
{material}</shape></scene>
"""


def write_sky(file: Path) -> None:
    """Write an environment map: a bright horizon, a blue zenith, a dark ground and a soft sun."""
    import mitsuba as mi

    rows, columns = np.mgrid[:64, :128]
    elevation, azimuth = np.pi * (0.5 - (rows + 0.5) / 64), 2 * np.pi * (columns + 0.5) / 128
    up = np.sin(elevation)
    sun = np.cos(elevation) * np.cos(azimuth - 2.2) * np.cos(0.7) + up * np.sin(0.7)
    sky = np.where(up[..., None] > 0, [0.3, 0.5, 0.9] + 0.6 * (1 - up[..., None]) ** 4, [0.15, 0.12, 0.1])
    sky = sky + 15 * np.exp(60 * (sun[..., None] - 1)) * np.array([1.0, 0.9, 0.7])
    mi.Bitmap(sky.astype(np.float32)).write(str(file))


def side_by_side(pictures: Sequence[Image.Image]) -> Image.Image:
    """Return pictures of one size as one."""
    return Image.fromarray(np.concatenate([np.asarray(picture) for picture in pictures], axis=1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=4096, help="of the reference, in all (if not given: 4096)")
    parser.add_argument("--size", type=int, default=64, help="pixels along a side (if not given: 64)")
    parser.add_argument("--rays", type=int, default=32, help="of the native renderer a pixel (if not given: 32)")
    parser.add_argument("--error", type=float, default=0.02, help="of baked light (if not given: 0.02)")
    parser.add_argument("--only", default="", help="take rows whose names contain this")
    parser.add_argument("--pictures", type=Path, help="folder for pictures")
    parser.add_argument("--kept", type=Path, help="folder for references, which are used again")
    given = parser.parse_args()
    for folder in (given.pictures, given.kept):
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
    print("| material | light | ball: rms log luma / C | of its pixels | else: rms / C | reference's error / C | ms |")
    print("|---|---|---:|---:|---:|---:|---:|")
    rows = dict[str, dict[str, Image.Image]]()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "scene.xml")
        sky_written = False
        for light, lit in LIGHTS.items():
            for material, bsdf in MATERIALS.items():
                name = f"{material}, {light}"
                if given.only not in name:
                    continue
                file.write_text(SCENE.format(light=lit, material=bsdf))
                if light == "sky" and not sky_written:
                    with davis_rs._mitsuba.variants.variant("scalar_rgb"):
                        write_sky(Path(folder, "sky.exr"))
                    sky_written = True
                scene = davis_rs.load_scene(file)
                scene = replace(scene, trajectory=slider(davis_rs.start_pose(scene), distance_m=0.02, speed_m_s=1.0))
                size = given.size
                focal = 0.5 * size / np.tan(np.radians(38) / 2)
                camera = Camera(width=size, height=size, fx=focal, fy=focal, cx=(size - 1) / 2, cy=(size - 1) / 2)
                renderer = make_renderer(
                    scene, camera, kind="baked", lattice_rays_per_pixel=given.rays, bake_error=given.error, blur=False
                )
                assert isinstance(renderer, NativeRenderer)
                views = first_view(scene)
                luma = luma_of(renderer, views)
                start = time.process_time()
                luma_of(renderer, views)
                spent = 1e3 * (time.process_time() - start)
                pixels = np.arange(size * size)
                shapes, _ = renderer.shapes_seen(views, 0 * pixels, pixels)
                ball = (shapes == renderer.table.names.index("ball")).reshape(size, size)
                kept = given.kept and given.kept / f"{name}_{size}_{given.samples}.npy"
                true, error = reference(scene, camera, given.samples, kept)
                floor = 1e-3 * np.median(true)
                off = np.log(luma + floor) - np.log(true + floor)
                error = error / (true + floor)
                sure = error < 0.1 * C
                rms = [
                    np.sqrt(np.mean(values[chosen] ** 2)) / C if chosen.any() else np.nan
                    for values, chosen in ((off, sure & ball), (off, sure & ~ball), (error, sure))
                ]
                print(
                    f"| {material} | {light} | {rms[0]:.2f} | {sure[ball].mean():.0%} | {rms[1]:.2f} | {rms[2]:.3f} |"
                    f" {spent:.0f} |",
                    flush=True,
                )
                white = float(np.quantile(true, 0.98))
                picture = side_by_side([shown(luma, white), shown(true, white), difference(off)])
                rows.setdefault(material, {})[f"{light}: ours, path tracer, difference"] = picture
    if given.pictures is not None:
        labelled_sheet(rows).save(given.pictures / "light_gloss.png", optimize=True)


if __name__ == "__main__":
    main()
