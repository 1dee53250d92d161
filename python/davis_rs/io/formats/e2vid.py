"""Writes and reads HDF5 in the layout of e2vid and event_cnn_minimal: events/{xs, ys, ts, ps}, times in seconds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.array_types import UncheckedArray
from ..._util.untrusted import decoding
from ...events.arrays import EventArray
from .destination import Limits
from .hdf5 import Hdf5Format, Hdf5Reader, Hdf5Writer
from .hdf5_links import find_inside
from .interface import Failing
from .parts import FRAMES


class E2vidWriter(Hdf5Writer):
    """Writes events in the layout that e2vid's training and inference code reads, with its attributes.

    Source: Stoffregen et al., "Reducing the Sim-to-Real Gap for Event Cameras", ECCV 2020; event_cnn_minimal,
    ``events_contrast_maximization/tools/event_packagers.py``.
    """

    def _create(self) -> None:
        for name, dtype, bits in (("ts", "<f8", True), ("xs", "<i2", False), ("ys", "<i2", False), ("ps", "?", True)):
            self._columns[name] = self._column(f"events/{name}", dtype, bits=bits)
        self._hdf5.file.create_group("images")
        self._on = self._off = 0
        self._first_s = self._last_s = 0.0
        root = self._hdf5.file.attrs
        for name in ("num_events", "num_pos", "num_neg", "num_imgs", "num_flow"):
            root[name] = np.int64(0)
        for name in ("duration", "t0", "tk"):
            root[name] = np.float64(0)
        root["source"] = "davis_rs"

    def write_image(self, t_us: int, image: npt.NDArray[np.uint8]) -> None:
        """Write an intensity frame, after the events before it: uint8, shape (height, width).

        Raises:
            ValueError: for another shape or type, or a negative time.
            OSError: if the system refuses.
        """
        width, height = self.size
        if image.shape != (height, width) or image.dtype != np.uint8 or t_us < 0:
            raise ValueError(
                f"an image must be uint8 of shape {(height, width)} at 0 us or later: "
                f"got {image.dtype}, {image.shape}, {t_us} us"
            )
        with self._turn:
            self._refuse_if_over()
            self._append_image(t_us, image)

    def _append_image(self, t_us: int, image: npt.NDArray[np.uint8]) -> None:
        with Failing(self), self._telling():
            root, images = self._hdf5.file.attrs, self._hdf5.file["images"]
            dataset = images.create_dataset(f"image{len(images):09d}", data=image)
            dataset.attrs["timestamp"] = t_us / 1e6
            dataset.attrs["size"] = image.shape
            dataset.attrs["type"] = "greyscale"
            dataset.attrs["event_idx"] = self._on + self._off
            root.modify("num_imgs", np.int64(len(images)))
            self._hdf5.check()

    def _append(self, packet: EventArray) -> None:
        # Correctly rounded quotients, so that rint(1e6 t) gives the microseconds back.
        seconds = packet["t"] / 1e6
        if self._on + self._off == 0:
            self._first_s = float(seconds[0])
        self._last_s = float(seconds[-1])
        on = int(np.count_nonzero(packet["p"]))
        self._on, self._off = self._on + on, self._off + len(packet) - on
        self._columns["ts"].append(seconds)
        for name, field in (("xs", "x"), ("ys", "y"), ("ps", "p")):
            self._columns[name].append(packet[field])

    def _settle(self) -> None:
        for column in self._columns.values():
            column.settle()
        values = {
            "num_events": np.int64(self._on + self._off),
            "num_pos": np.int64(self._on),
            "num_neg": np.int64(self._off),
            "duration": np.float64(self._last_s - self._first_s),
            "t0": np.float64(self._first_s),
            "tk": np.float64(self._last_s),
        }
        for name, value in values.items():
            self._hdf5.file.attrs.modify(name, value)


class E2vidReader(Hdf5Reader):
    """Reads e2vid's layout; times are rounded to the nearest microsecond."""

    names = ("events/ts", "events/xs", "events/ys", "events/ps")

    def images(self) -> Iterator[tuple[int, npt.NDArray[np.uint8]]]:
        """Yield intensity frames as (t_us, uint8 (height, width)), in the order of their names."""
        with decoding(self.path, "images"):
            group = self._find("images")
            names = [] if group is None else sorted(group)
        for name in names:
            with decoding(self.path, f"image {name}"):
                dataset = find_inside(self.path, group, name)
                t_us, height = round(float(dataset.attrs["timestamp"]) * 1e6), len(dataset)
                with (
                    self._budget.borrow(dataset.size * dataset.dtype.itemsize, f"image {name}"),
                    self._rows_of(dataset, height, (None,)) as rows,
                ):
                    image = rows.read(0, height)
            yield t_us, image

    def _times(self, values: UncheckedArray) -> npt.NDArray[np.int64]:
        with np.errstate(over="ignore"):  # what is infinite is refused
            microseconds = np.rint(np.asarray(values, np.float64) * 1e6)
        if not (np.abs(microseconds) < 2.0**63).all():  # NaN is not, either
            raise DecodeError(f"{self.path}: times must be finite, and below 2^63 us")
        return microseconds.astype(np.int64)


class E2vidFormat(Hdf5Format):
    """Describes e2vid's HDF5. It holds what float64 seconds and int16 coordinates do."""

    name = "e2vid"
    holds = (FRAMES.name,)
    limits = Limits(latest_us=2**31 * 1_000_000 - 1, width=32_768, height=32_768)
    marks = ("events/ts",)
    default_compression = "none"
    writer = E2vidWriter
    reader = E2vidReader
