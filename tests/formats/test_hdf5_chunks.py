"""Chunks of HDF5 are unpacked once, whatever is read of them, and are limited."""

from __future__ import annotations

import os
import re
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import davis_rs
from davis_rs import DecodeError
from davis_rs.io.formats.hdf5_chunks import Rows

h5py = pytest.importorskip("h5py")
hdf5plugin = pytest.importorskip("hdf5plugin")

COUNT = 300_000
"""Events: five of the pieces in which columns are put together."""


def events() -> Any:
    rng = np.random.default_rng(1)
    found = np.zeros(COUNT, davis_rs.EVENT_DTYPE)
    found["t"] = np.sort(rng.integers(0, 10_000_000, COUNT))
    found["x"], found["y"], found["p"] = (
        rng.integers(0, 240, COUNT),
        rng.integers(0, 180, COUNT),
        rng.integers(0, 2, COUNT),
    )
    return found


def columns(layout: str) -> dict[str, Any]:
    """The datasets of a layout."""
    e = events()
    if layout == "dsec":
        return {f"events/{name}": e[name] for name in "txyp"}
    if layout == "e2vid":
        return {f"events/{name}s": e[name] for name in "xyp"} | {"events/ts": e["t"] / 1e6}
    return {"davis/left/events": np.stack([e["x"], e["y"], e["t"] / 1e6, e["p"] * 2.0 - 1.0], 1)}


def written(path: Path, layout: str, chunk: tuple[int, ...] = (COUNT,), **filters: Any) -> Path:
    """A file of a layout, with all its events in one chunk if nothing else is said."""
    with h5py.File(path, "w") as file:
        for name, values in columns(layout).items():
            side = chunk if len(chunk) == values.ndim else (*chunk, *values.shape[1:])
            file.create_dataset(name, data=values, chunks=side, **(filters or {"compression": "gzip"}))
        file.attrs["sensor_resolution"] = [180, 240]
    return path


def opened(path: Path) -> Any:
    """A reader, with the methods of its format."""
    return davis_rs.open_reader(path)


class Unpackings:
    """Counts what zlib is asked to unpack."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.count = 0
        self.decompressobj = zlib.decompressobj
        monkeypatch.setattr("davis_rs.io.formats.hdf5_chunks.zlib.decompressobj", self)

    def __call__(self) -> Any:
        self.count += 1
        return self.decompressobj()


LAYOUTS: dict[str, tuple[str, dict[str, Any], int]] = {
    "dsec": ("dsec", {}, 4),
    "dsec, shuffled": ("dsec", {"compression": "gzip", "shuffle": True}, 4),
    "dsec, two chunks": ("dsec", {"compression": "gzip", "chunk": (COUNT // 2,)}, 8),
    "e2vid": ("e2vid", {}, 4),
    "mvsec": ("mvsec", {}, 1),
    "mvsec, a chunk a column": ("mvsec", {"compression": "gzip", "chunk": (COUNT, 1)}, 4),
}


@pytest.mark.parametrize("kind", LAYOUTS)
def test_a_chunk_is_unpacked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """Also where it is read in pieces."""
    layout, options, chunks = LAYOUTS[kind]
    path = written(tmp_path / "e.h5", layout, **options)
    unpackings = Unpackings(monkeypatch)
    with davis_rs.open_reader(path) as reader:
        np.testing.assert_array_equal(np.concatenate(list(reader.iter(10_000))), events())
    assert unpackings.count == chunks


@pytest.mark.parametrize(
    "filters",
    [
        {"compression": "lzf", "chunk": (COUNT // 4,)},
        {"compression": "gzip", "fletcher32": True},
        hdf5plugin.Blosc("zstd"),
        hdf5plugin.LZ4(),
        hdf5plugin.Bitshuffle(),
        hdf5plugin.Zstd(),
    ],
    ids=["lzf", "gzip with checksums", "Blosc", "LZ4", "bitshuffle", "Zstandard"],
)
def test_chunks_that_hdf5_unpacks_are_asked_for_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, filters: Any
) -> None:
    path = written(tmp_path / "e.h5", "dsec", **filters)
    asked = []
    unpack = Rows._unpack

    def counted(rows: Rows, place: tuple[int, ...]) -> Any:
        asked.append(place)
        return unpack(rows, place)

    monkeypatch.setattr(Rows, "_unpack", counted)
    with davis_rs.open_reader(path) as reader:
        np.testing.assert_array_equal(np.concatenate(list(reader.iter(10_000))), events())
    assert len(asked) == (16 if "chunk" in filters else 4)


def test_a_slice_of_time_unpacks_a_chunk_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where it begins and ends is found by bisection, which looks at single times."""
    path = written(tmp_path / "e.h5", "dsec")
    unpackings = Unpackings(monkeypatch)
    found = davis_rs.read_events(path, start_us=1_000_000, stop_us=9_000_000)
    expected = events()
    np.testing.assert_array_equal(found, expected[(expected["t"] >= 1_000_000) & (expected["t"] < 9_000_000)])
    assert unpackings.count == 4


def test_a_chunk_of_many_images_is_unpacked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path / "e.h5", "dsec")
    images = np.arange(50 * 6 * 4, dtype=np.uint8).reshape(50, 6, 4)
    with h5py.File(path, "a") as file:
        file.create_dataset("images/data", data=images, chunks=(50, 6, 2), compression="gzip")
        file["images/t"] = np.arange(50)
    unpackings = Unpackings(monkeypatch)
    with opened(path) as reader:
        found = [image for _, image in reader.images()]
    np.testing.assert_array_equal(found, images)
    assert unpackings.count == 2


def test_chunks_are_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path / "e.h5", "dsec")
    monkeypatch.setenv("DAVIS_RS_READ_BUDGET", "bytes=3MiB")
    with pytest.raises(
        DecodeError, match=r"a chunk of /events/y needs 586 KiB, 2.86 MiB are in use; 3 MiB may be held"
    ):
        davis_rs.read_events(path)


@pytest.mark.parametrize("size", [-1, 1])
@pytest.mark.parametrize("shuffle", [False, True])
def test_a_chunk_that_unpacks_to_another_size(tmp_path: Path, size: int, shuffle: bool) -> None:
    path = written(tmp_path / "e.h5", "dsec", compression="gzip", shuffle=shuffle)
    with h5py.File(path, "a") as file:
        data = zlib.compress(bytes(file["events/x"].dtype.itemsize * COUNT + size))
        file["events/x"].id.write_direct_chunk((0,), data)
    with pytest.raises(DecodeError, match=r"a chunk of /events/x is damaged: it does not unpack to its 600000 bytes"):
        davis_rs.read_events(path)


def test_a_chunk_that_was_left_as_it_is(tmp_path: Path) -> None:
    """HDF5 notes with each chunk which filters were not applied."""
    path = written(tmp_path / "e.h5", "dsec", compression="gzip", shuffle=True)
    with h5py.File(path, "a") as file:
        file["events/p"].id.write_direct_chunk((0,), file["events/p"][:].tobytes(), filter_mask=0b11)
    np.testing.assert_array_equal(davis_rs.read_events(path), events())


@pytest.mark.parametrize("order", ["<", ">"])
def test_values_in_either_order_of_bytes(tmp_path: Path, order: str) -> None:
    path = written(tmp_path / "e.h5", "dsec")
    with h5py.File(path, "a") as file:
        values = file["events/x"][:]
        del file["events/x"]
        file.create_dataset("events/x", data=values.astype(f"{order}i4"), compression="gzip", shuffle=True)
    np.testing.assert_array_equal(davis_rs.read_events(path), events())


def huge(file: Any, name: str, shape: tuple[int, ...]) -> None:
    """A dataset of zeros in few bytes."""
    file.create_dataset(name, shape, "u1", chunks=shape, compression="gzip")
    file[name].id.write_direct_chunk((0,) * len(shape), zlib.compress(bytes(int(np.prod(shape)))))


def test_images_and_intervals_are_limited(tmp_path: Path) -> None:
    """They were read whole, whatever their size."""
    path = written(tmp_path / "e.h5", "e2vid")
    with h5py.File(path, "a") as file:
        huge(file, "images/image0", (8_192, 9_000))
        file["images/image0"].attrs["timestamp"] = 0.0
    with (
        opened(path) as reader,
        pytest.raises(DecodeError, match="a chunk of /images/image0 may have 67108864 bytes"),
    ):
        list(reader.images())
    path = written(tmp_path / "m.h5", "mvsec")
    with h5py.File(path, "a") as file:
        file.create_dataset("davis/left/flow_dist", (1, 2, 1, 1), "f4")
        file["davis/left/flow_dist_ts"] = [0.0]
        huge(file, "davis/left/flow_dist_dt", (70_000_000,))
    with (
        opened(path) as reader,
        pytest.raises(DecodeError, match="a chunk of /davis/left/flow_dist_dt may have 67108864 bytes"),
    ):
        list(reader.flow_maps())


def test_an_offset_of_many_numbers(tmp_path: Path) -> None:
    path = written(tmp_path / "e.h5", "dsec")
    with h5py.File(path, "a") as file:
        file["t_offset"] = [5]
    assert davis_rs.read_events(path)["t"][0] == events()["t"][0] + 5
    with h5py.File(path, "a") as file:
        del file["t_offset"]
        huge(file, "t_offset", (70_000_000,))
    with pytest.raises(DecodeError, match="t_offset: it must be one number"):
        davis_rs.read_events(path)


def test_links_to_other_files_are_not_followed(tmp_path: Path) -> None:
    """HDF5 would wait for ever for a pipe."""
    os.mkfifo(tmp_path / "pipe")
    for number, layout in enumerate(("dsec", "e2vid", "mvsec")):
        path = written(tmp_path / f"{number}.h5", layout)
        name = next(iter(columns(layout)))
        with h5py.File(path, "a") as file:
            del file[name]
            file[name] = h5py.ExternalLink(str(tmp_path / "pipe"), "/t")
        with pytest.raises(DecodeError, match=f"{name} lies in another file: it must be in this one"):
            davis_rs.read_events(path)
    path = written(tmp_path / "parts.h5", "dsec")
    with h5py.File(path, "a") as file:
        file["t_offset"] = h5py.SoftLink("/elsewhere")
        file["elsewhere"] = h5py.ExternalLink(str(tmp_path / "pipe"), "/t")
    with pytest.raises(DecodeError, match="elsewhere lies in another file"):
        davis_rs.read_events(path)


def test_soft_links_are_followed_and_not_in_circles(tmp_path: Path) -> None:
    path = written(tmp_path / "e.h5", "dsec")
    with h5py.File(path, "a") as file:
        file["events/moved"] = file["events/x"]
        del file["events/x"]
        file["events/x"] = h5py.SoftLink("moved")
        file["t_offset"] = h5py.SoftLink("/nowhere")
    np.testing.assert_array_equal(davis_rs.read_events(path), events())
    with h5py.File(path, "a") as file:
        del file["t_offset"]
        file["t_offset"] = h5py.SoftLink("/circle")
        file["circle"] = h5py.SoftLink("/t_offset")
    with pytest.raises(DecodeError, match="leads in circles"):
        davis_rs.read_events(path)


@pytest.mark.parametrize("name", ["Blosc", "Bitshuffle"])
def test_a_filter_without_its_parameters_is_refused(tmp_path: Path, name: str) -> None:
    """It would read beyond its parameters, and the process would end."""
    path = written(tmp_path / "e.h5", "dsec", **getattr(hdf5plugin, name)())
    number = {"Blosc": 32001, "Bitshuffle": 32008}[name]
    # A filter in an object's header: its number, the length of its name, flags, and how many parameters follow.
    head = re.compile(
        struct.pack("<H", number) + rb"(.\x00)(.\x00)[\x01-\x20]\x00" + name.lower()[:4].encode(), re.DOTALL
    )
    content, count = head.subn(
        lambda found: struct.pack("<H", number) + found[1] + found[2] + b"\0\0" + name.lower()[:4].encode(),
        path.read_bytes(),
    )
    assert count == 4
    path.write_bytes(content)
    with pytest.raises(DecodeError, match=f"has 0 parameters of HDF5's filter {number}: expected [34] or more"):
        davis_rs.read_events(path)


def test_times_too_large_for_seconds_are_refused_without_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "e.h5"
    with h5py.File(path, "w") as file:
        for name, values in {"xs": [1], "ys": [1], "ps": [1], "ts": [1e304]}.items():
            file[f"events/{name}"] = np.array(values, np.float64 if name == "ts" else np.int16)
        file.attrs["sensor_resolution"] = [180, 240]
    with pytest.raises(DecodeError, match="times must be finite"):
        davis_rs.read_events(path)


def test_a_chunk_that_says_more_bytes_than_the_file_has(tmp_path: Path) -> None:
    """HDF5 would take memory for all of them first."""
    path = written(tmp_path / "e.h5", "dsec", (COUNT // 4,))
    with h5py.File(path) as file:
        stored = file["events/x"].id.get_chunk_info(0)
    # In the index of chunks a chunk's size and filter mask come before its place in the dataset.
    content = path.read_bytes()
    at = content.index(struct.pack("<IIQ", stored.size, 0, 0))
    path.write_bytes(content[:at] + struct.pack("<I", 0xF0000000) + content[at + 4 :])
    with pytest.raises(DecodeError, match=r"says 4026531840 bytes, more than the file has"):
        davis_rs.read_events(path)
