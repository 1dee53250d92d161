"""Tables and pictures of the sequences of the public dataset, for docs/sequences.md.

python benches/sequence_tables.py table [NAME ...]              # the list as a table of Markdown
python benches/sequence_tables.py sheet -o PNG [NAME ...]       # a frame and events of each sequence
python benches/sequence_tables.py count -o CSV [NAME ...]       # counts the events of whole sequences: hours

`count` adds to a CSV file; the same command again resumes. Copy its files to python/davis_rs/scene/sequences.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable, Iterable
from collections.abc import Sequence as Rows
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
import numpy.typing as npt

from davis_rs._util.argument_error import ArgumentError
from davis_rs._util.progress import each, progress
from davis_rs._util.srgb import to_srgb
from davis_rs._util.whole_file import whole_file
from davis_rs.geometry.trajectory.views import Views
from davis_rs.inspection.figure import event_picture
from davis_rs.io.dataset.files import as_grey
from davis_rs.io.dataset.writer import image_gain_for
from davis_rs.render.choice import make_renderer
from davis_rs.sampling.rules import MaxDisplacement
from davis_rs.scene.sequences import SEQUENCES, Sequence, sequence_named
from davis_rs.scene.sequences.event_counts import MEASURED, EventCount, read_counts
from davis_rs.scene.sequences.listing import HEAD, WORDS, table
from davis_rs.sensor.presets import IDEAL, RECORDED
from davis_rs.simulation.simulator import Simulator

COARSE_PX, COARSE_SAMPLES = 2.0, 5
"""A render for so much motion, and rays a pixel: a third of a pixel and 8 rays find 3 to 10 % more events, for eight
times the work (docs/sequences.md)."""

_LOOK = 0.7


def mean_luma(sequence: Sequence) -> float:
    """The mean luma of a view of the sequence, at 70 % of its time: another scene or path has another."""
    scene = sequence.scene()
    renderer = make_renderer(scene, scene.own_camera, rays_per_pixel=1)
    view = Views.along(scene.path, np.array([_LOOK * scene.path.duration_s]))
    return float(renderer.luma(view).mean(dtype=np.float64))


def count_events(
    sequence: Sequence,
    *,
    sensor: str = IDEAL,
    duration_s: float | None = None,
    max_displacement_px: float = COARSE_PX,
    rays_per_pixel: int = COARSE_SAMPLES,
    progress: Callable[[float], object] | None = None,
) -> EventCount:
    """Simulate a sequence and count its events.

    Args:
        sensor: ``ideal`` for ideal pixels with the scene's threshold, ``recorded`` for the sensor of the recording.
        duration_s: from its start; all of it by default.
        max_displacement_px, rays_per_pixel: a render for so much motion, and rays a pixel; see :data:`COARSE_PX`.
        progress: called with the simulated seconds since the call before.

    Raises:
        ValueError: for a recorded sensor where nothing was recorded.
    """
    scene = sequence.scene().crop(0.0, duration_s)
    simulator = Simulator(
        scene,
        frame_rate_hz=0,
        depth_rate_hz=0,
        sampling=MaxDisplacement(max_displacement_px),
        rays_per_pixel=rays_per_pixel,
        sensor=sensor,
    )
    events = on_events = 0
    for packet in simulator.run():
        events += len(packet.events)
        on_events += int(packet.events["p"].sum())
        if progress is not None:
            progress((packet.end_us - packet.start_us) * 1e-6)
    return EventCount(
        sequence.name,
        round(scene.path.duration_s, 6),
        events,
        on_events,
        max_displacement_px,
        rays_per_pixel,
        simulator.contrast_threshold,
        round(mean_luma(sequence), 7),
        sensor,
    )


def write_counts(path: str | Path, counts: Iterable[EventCount]) -> None:
    """Replace a CSV file by one of these counts; a reader sees the old file or the new one, whole."""
    with whole_file(path) as place, place.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(EventCount)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(count) for count in counts)


_SLICE_S = 0.1
_EVENTS_A_PIXEL = 0.15
_COLUMNS, _GAP, _TITLE = 3, 8, 20
"""Tiles a row; pixels between tiles; pixels of a tile's title."""


def draw_sheet(sequences: Iterable[Sequence], output_png: str | Path, *, share: float = 0.7) -> Path:
    """Draw a frame of each sequence, next to the same frame, faded, with the events that lead up to it.

    The frame is exposed by the rule of :class:`~davis_rs.io.dataset.writer.DatasetWriter` and drawn with sRGB's
    curve; as many of the last 0.1 s's events are shown as make 0.15 a pixel.

    Args:
        share: of the sequence's time that has passed, in 0..1.

    Raises:
        ValueError: for a share out of range, or no sequences.
        OSError: if it cannot be written.
    """
    from PIL import Image, ImageDraw, ImageFont

    if not 0 <= share <= 1:
        raise ArgumentError("{share} must lie in 0..1, got {}", share)
    with whole_file(output_png) as place:  # fails before the rendering, if it must
        tiles = [(sequence.name, _tile(sequence, share)) for sequence in sequences]
        if not tiles:
            raise ValueError("a contact sheet needs at least one sequence")
        height, width = tiles[0][1].shape[:2]
        rows = -(-len(tiles) // _COLUMNS)
        sheet = Image.new("RGB", (_COLUMNS * (width + _GAP) - _GAP, rows * (height + _TITLE + _GAP) - _GAP), "white")
        draw = ImageDraw.Draw(sheet)
        for number, (name, tile) in enumerate(tiles):
            left, top = (number % _COLUMNS) * (width + _GAP), (number // _COLUMNS) * (height + _TITLE + _GAP)
            draw.text((left, top), name, "black", ImageFont.load_default(size=14))
            sheet.paste(Image.fromarray(tile), (left, top + _TITLE))
        sheet.save(place, format="PNG")
    return Path(output_png)


def _tile(sequence: Sequence, share: float) -> npt.NDArray[np.uint8]:
    """Frame and events side by side, (height, 2 width, 3)."""
    whole_s = sequence.paper.duration_s
    slice_s = min(_SLICE_S, whole_s)
    scene = sequence.scene().crop(share * (whole_s - slice_s), slice_s)
    simulator = Simulator(scene, frame_rate_hz=1 / slice_s, depth_rate_hz=0, accuracy="fast")
    packets = list(simulator.run())
    luma = next(packet.luma for packet in reversed(packets) if packet.luma is not None)
    events = np.concatenate([packet.events for packet in packets])
    grey = to_srgb(as_grey(luma, image_gain_for(luma)) / 255.0)
    shown = events[len(events) - min(len(events), round(_EVENTS_A_PIXEL * luma.size)) :]
    frame = np.repeat(np.rint(255 * grey)[..., None], 3, axis=2).astype(np.uint8)
    return np.concatenate([frame, event_picture(grey, shown)], axis=1)


def as_markdown(rows: Rows[Rows[str]]) -> str:
    """Write rows under their head as a table of Markdown."""
    lines = [HEAD, ["---"] * WORDS + ["--:"] * (len(HEAD) - WORDS), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _count(chosen: Rows[Sequence], path: Path, sensor: str) -> None:
    counts = read_counts(path) if path.exists() else {}
    places = {name: place for place, name in enumerate(SEQUENCES)}
    write_counts(path, counts.values())  # fails before the counting, if it must
    for count in counts.values():
        if count.sensor != sensor:
            raise ValueError(f"{path} has counts of --sensor {count.sensor}, these are of {sensor}")
    for sequence in chosen:
        if sequence.name in counts or (sensor == RECORDED and sequence.biases is None):
            continue
        with progress(sequence.name, sequence.paper.duration_s, unit="s") as bar:
            counts[sequence.name] = count_events(sequence, sensor=sensor, progress=bar.advance)
        write_counts(path, sorted(counts.values(), key=lambda count: places.get(count.name, len(places))))
        print(f"{sequence.name}: {counts[sequence.name].events:,} events")


def main(arguments: Rows[str] | None = None) -> int:
    """Run one of the commands; see the head of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("table", "sheet", "count"))
    parser.add_argument("names", nargs="*", metavar="NAME", help="all if not given")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="the picture, or the counts")
    parser.add_argument("--sensor", choices=(IDEAL, RECORDED), default=IDEAL, help="whose events are counted")
    parser.add_argument("--measured", type=Path, metavar="CSV", default=MEASURED)
    options = parser.parse_args(arguments)
    chosen = [sequence_named(name) for name in options.names or SEQUENCES]
    if options.what != "table" and options.output is None:
        parser.error(f"{options.what} needs -o FILE")
    if options.what == "table":
        counts = read_counts(options.measured)
        print(as_markdown(table(each(chosen, "listing", len(chosen), unit="sequences"), counts)))
    elif options.what == "sheet":
        print(draw_sheet(each(chosen, "simulating", len(chosen), unit="sequences"), options.output))
    else:
        _count(chosen, options.output, options.sensor)
    return 0


if __name__ == "__main__":
    sys.exit(main())
