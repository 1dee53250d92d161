"""Packs what a page shows behind the events: frames, and maps of the ground truth, as pictures."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._util.progress import progress
from .._util.srgb import to_srgb
from .flow_picture import flow_picture
from .sampling_for_display import evenly_spaced
from .truth_pictures import HIDDEN, depth_picture, normals_picture, shape_colours
from .visual_sequence import VisualSequence

_FRAME_BYTES, _MAP_BYTES = 3_000_000, 1_000_000
"""What frames take of the page, and each kind of maps."""

_LOOKED_AT = 9
"""So many maps say which colours a kind of them has."""

Picture = npt.NDArray[np.float64] | npt.NDArray[np.uint8]
"""Grey (H, W) or colours (H, W, 3): float64 from 0 to 1, or uint8."""


class Layer(NamedTuple):
    """Holds one kind of pictures of a sequence.

    Attributes:
        name: for the page's control.
        maps: what they are called in counts.
        times: in microseconds.
        picture: the picture of a number.
        says: what the colours mean.
        bytes: what all pictures may take.
        names: of what has one colour everywhere, by that colour: six hexadecimal digits of red, green and blue.
    """

    name: str
    maps: str
    times: Sequence[int]
    picture: Callable[[int], Picture]
    says: str
    bytes: int
    names: dict[str, str] | None = None

    def packed(self, start_us: int, most: int | None, *, show_progress: bool) -> dict[str, object]:
        """Return the layer as the page's program takes it: as many pictures as asked for, or as fit.

        Args:
            start_us: when the page's times begin.
            most: how many pictures; None for as many as fit.
        """
        total = len(self.times)
        encoded: dict[int, bytes] = {}

        def encode(chosen: Sequence[int]) -> int:
            """Return their bytes, all together."""
            show = show_progress and len(chosen) > 8
            with progress(self.maps, len(chosen), unit=self.maps, show=show) as bar:
                for number in chosen:
                    if number not in encoded:
                        encoded[number] = _png(self.picture(number))
                    bar.advance()
            return sum(len(encoded[number]) for number in chosen)

        if most is None:
            few = evenly_spaced(total, 4).tolist()
            most = max(1, self.bytes * len(few) // encode(few))
            while (taken := encode(evenly_spaced(total, most).tolist())) > self.bytes and most > 1:
                most = max(1, min(most, total) * self.bytes // taken)
        chosen = evenly_spaced(total, most).tolist()
        encode(chosen)
        return {
            "name": self.name,
            "maps": self.maps,
            "says": self.says,
            "names": self.names or {},
            "total": total,
            "t": [self.times[number] - start_us for number in chosen],
            "png": [base64.b64encode(encoded[number]).decode() for number in chosen],
        }


def layers_of(sequence: VisualSequence) -> Iterator[Layer]:
    """Yield the layers that a sequence has, frames first."""
    if sequence.frame_times:
        yield Layer(
            "frame",
            "frames",
            sequence.frame_times,
            lambda number: to_srgb(sequence.read_frame(number)),
            "",
            _FRAME_BYTES,
        )
    if sequence.depth_times:
        yield _depth(sequence)
    if sequence.flow_times:
        yield _flow(sequence)
    if sequence.mask_times:
        yield _shapes(sequence)
    if sequence.normal_times:
        yield Layer(
            "normals",
            "normal maps",
            sequence.normal_times,
            lambda number: normals_picture(sequence.read_normals(number)),
            "red to the right, green up, blue to the camera",
            _MAP_BYTES,
        )
    if sequence.disparity_times:
        yield _disparity(sequence)


def _range(count: int, read: Callable[[int], npt.NDArray[np.float32]]) -> tuple[float, float]:
    """Return between which values nearly all of some maps lie."""
    values = np.concatenate([read(number).ravel() for number in evenly_spaced(count, _LOOKED_AT).tolist()])
    known = values[np.isfinite(values)]
    least, most = np.percentile(known, (1, 99)).tolist() if len(known) else (0.0, 1.0)
    return least, most


def _depth(sequence: VisualSequence) -> Layer:
    least, most = _range(len(sequence.depth_times), sequence.read_depth)
    return Layer(
        "depth",
        "depth maps",
        sequence.depth_times,
        lambda number: depth_picture(sequence.read_depth(number), least, most),
        f"from {least:.3g} m (yellow) to {most:.3g} m (violet)",
        _MAP_BYTES,
    )


def _disparity(sequence: VisualSequence) -> Layer:
    least, most = _range(len(sequence.disparity_times), sequence.read_disparity)

    def picture(number: int) -> Picture:
        disparity = sequence.read_disparity(number)
        # What is near has a small depth and a large disparity: both are yellow.
        colours = depth_picture(-disparity, -most, -least)
        colours[sequence.read_occlusion(number) & np.isfinite(disparity)] = HIDDEN
        return colours

    return Layer(
        "disparity",
        "disparity maps",
        sequence.disparity_times,
        picture,
        f"from {most:.3g} px (yellow) to {least:.3g} px (violet); red where cam1 does not see it",
        _MAP_BYTES,
    )


def _flow(sequence: VisualSequence) -> Layer:
    times = sequence.flow_times
    flows = [sequence.read_flow(i).reshape(-1, 2) for i in evenly_spaced(len(times), _LOOKED_AT).tolist()]
    speed = np.hypot(*np.concatenate(flows).T)
    known = speed[np.isfinite(speed)]
    most = float(np.percentile(known, 99)) if len(known) else 1.0
    return Layer(
        "flow",
        "flow maps",
        times,
        lambda number: flow_picture(sequence.read_flow(number), most),
        f"full colour at {most:,.0f} px/s; right red, down yellow-green, left light blue, up violet",
        _MAP_BYTES,
    )


def _shapes(sequence: VisualSequence) -> Layer:
    colours = np.rint(255 * shape_colours(np.iinfo(np.uint16).max)).astype(np.uint8)
    numbered = zip(colours[1:], sequence.shape_names, strict=False)  # there are fewer names than colours
    names = {bytes(colour).hex(): name for colour, name in numbered}
    counted = f"{len(names)} shapes, each in one colour; point at one to read its name"
    return Layer(
        "shapes",
        "masks",
        sequence.mask_times,
        lambda number: colours[sequence.read_mask(number)],
        counted if names else "each in one colour",
        _MAP_BYTES,
        names,
    )


def _png(picture: Picture) -> bytes:
    from PIL import Image

    if picture.dtype != np.uint8:
        picture = np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "PNG", optimize=True)
    return stream.getvalue()
