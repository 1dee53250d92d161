"""Compares the renderers without noise with Mitsuba's path tracer, on any worlds.

    python benches/worlds_light.py WORLD ... [--samples 4096] [--width 96] [--rays 0] [--error 0.03] [--zoom 1]
        [--renderers auto native] [--pictures FILE] [--kept FOLDER]

A world is a Mitsuba, glTF, OBJ or PLY file. It is seen from its own camera at the start of its path. Each gets a row
for each renderer: ``auto`` bakes the light of meshes and glTF files quickly, ``native`` gives them direct light and a
sky without shadow, and ``baked`` takes the time that --error asks for. A row says the root mean square of
log luma against the path tracer, in units of C = 0.15, over pixels of surfaces where the reference's standard error is
below 0.1 C; its median; the fraction of these pixels for which that is so; processor time a frame; and seconds to
prepare, the bake included. A pixel is what ``--accuracy balanced`` makes of it, unless --rays says something else. The
backs of surfaces that have one side are shown, because Mitsuba shows them. With --pictures, a file has a row for each
world: the pictures of the renderers, the path tracer's, and the difference of the last renderer from it (grey where
there is none, white and black at 3 C). References are kept in a folder if one is named.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from labelled_sheet import labelled_sheet
from path_tracer import PIXELS, C, at_width, difference, first_view, luma_of, reference, shown, with_paths, world_name
from PIL import Image

import davis_rs
from davis_rs.render.choice import make_renderer

SURE = 0.1 * C
"""The reference's largest standard error of pixels that count."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("worlds", type=Path, nargs="+", metavar="WORLD")
    parser.add_argument("--samples", type=int, default=4096, help="of the reference, in all (if not given: 4096)")
    parser.add_argument("--width", type=int, default=96, help="pixels of a row (if not given: 96)")
    parser.add_argument(
        "--rays",
        type=int,
        default=0,
        help="of the renderers without noise, a pixel; 0 (if not given): as balanced has it",
    )
    parser.add_argument("--error", type=float, default=0.03, help="of baked light (if not given: 0.03)")
    parser.add_argument("--zoom", type=float, default=1.0, help="how much larger things are seen (if not given: 1)")
    parser.add_argument(
        "--renderers", nargs="+", default=["auto", "native"], help="one row each (if not given: auto native)"
    )
    parser.add_argument("--pictures", type=Path, help="file for pictures")
    parser.add_argument("--kept", type=Path, help="folder for references, which are used again")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print(
        "| world | renderer | rms log luma / C | median / C | of the pixels | reference's error / C | ms | prepared s |"
    )
    print("|---|---|---:|---:|---:|---:|---:|---:|", flush=True)
    rows = dict[str, dict[str, Image.Image]]()
    for world in given.worlds:
        scene = replace(davis_rs.load_scene(world), one_sided=())
        camera, views, paths = at_width(scene.own_camera, given.width, given.zoom), first_view(scene), with_paths(scene)
        name = world_name(world)
        kept = given.kept and given.kept / f"{name}_{given.width}_{given.zoom:g}_{given.samples}.npy"
        if given.kept is not None:
            given.kept.mkdir(parents=True, exist_ok=True)
        true, error = reference(paths, camera, given.samples, kept)
        floor = 1e-3 * np.median(true)
        certain = error / (true + floor) < SURE
        pictures, white, off = {}, float(np.quantile(true, 0.98)), np.zeros_like(true)
        for kind in given.renderers:
            start = time.perf_counter()
            renderer = make_renderer(
                scene,
                camera,
                kind=kind,
                rays_per_pixel=given.rays or None,
                **PIXELS,
                bake_error=given.error,
                blur=False,
            )
            luma = luma_of(renderer, views)
            prepared, start = time.perf_counter() - start, time.process_time()
            luma = luma_of(renderer, views)
            spent = 1e3 * (time.process_time() - start)
            off = np.log(luma + floor) - np.log(true + floor)
            surfaces = np.isfinite(renderer.depth(views)[0])
            sure = certain & surfaces & (true > floor)
            rms, middle = np.sqrt(np.mean(off[sure] ** 2)) / C, np.median(np.abs(off[sure])) / C
            err = np.sqrt(np.mean((error / (true + floor))[sure] ** 2)) / C
            print(
                f"| {name} | {kind}: {renderer.reason.partition(' triangles under ')[2][:40] or renderer.name} |"
                f" {rms:.2f} | {middle:.2f} | {sure.sum() / surfaces.sum():.0%} | {err:.3f} | {spent:.0f} |"
                f" {prepared:.1f} |",
                flush=True,
            )
            pictures[kind] = shown(luma, white)
        rows[name] = {**pictures, "path tracer": shown(true, white), "difference": difference(off)}
    if given.pictures is not None:
        given.pictures.parent.mkdir(parents=True, exist_ok=True)
        labelled_sheet(rows).save(given.pictures, optimize=True)


if __name__ == "__main__":
    main()
