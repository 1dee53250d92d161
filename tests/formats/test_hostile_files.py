"""Files that were made to harm: bombs, damaged metadata, events that break the rules."""

from __future__ import annotations

import bz2
import errno
import os
import struct
import subprocess
import sys
import warnings
import zipfile
import zlib
from collections.abc import Callable
from contextlib import nullcontext
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import davis_rs
from davis_rs import DecodeError
from davis_rs.cli import main
from davis_rs.generate import load_sequence_plan
from davis_rs.generate.generate import draw_sequences
from davis_rs.geometry.camera import PRESETS
from davis_rs.io.dataset.writer import DatasetWriter
from davis_rs.render.choice import make_renderer
from davis_rs.usb.raw_file import RawRecording
from long_form import long_values
from recording_files import aedat4, aedat4_events

DTYPE = davis_rs.EVENT_DTYPE
BOMB = 65 << 20


def events_of(*rows: tuple[int, int, int, int]) -> Any:
    return np.array(list(rows), DTYPE)


def peak_growth(path: Path, call: str) -> int:
    """Bytes by which a process grows that reads a file, and is refused."""
    code = f"""
import resource, sys, davis_rs
davis_rs.read_events  # what is imported late is imported now
try:
    import h5py, hdf5plugin, pyarrow.parquet, rosbags.rosbag1, lz4.frame
except ImportError:
    pass
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    {call}
except davis_rs.DecodeError as error:
    assert any(part in str(error) for part in ("max_packet_bytes", "header may have", "does not unpack to")), error
else:
    raise AssertionError("it was read")
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) << 10)
"""
    run = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr[-2000:]
    return int(run.stdout)


# --- bombs ---


def aedat4_bomb(path: Path) -> None:
    path.write_bytes(aedat4((0, aedat4_events(np.zeros(BOMB // 4, DTYPE))), compression=3))


def npz_bomb(path: Path) -> None:
    """One event of more bytes than the limit."""
    dtype = np.dtype([*((name, DTYPE[name]) for name in "txyp"), ("more", f"V{BOMB}")])
    np.savez_compressed(path, events=np.zeros(1, dtype))


def npz_header_bomb(path: Path) -> None:
    """An array's header that is compressed, and long."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("events.npy", b"\x93NUMPY\x02\x00" + struct.pack("<I", BOMB) + bytes(BOMB))


def hdf5_bomb(path: Path) -> None:
    """Chunks of a few bytes that unpack to many."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, dtype in (("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")):
            data = file.create_dataset(f"events/{name}", (1000,), dtype, chunks=(1000,), compression="gzip")
            data.id.write_direct_chunk((0,), zlib.compress(bytes(BOMB), 9))


def hdf5_chunk_bomb(path: Path) -> None:
    """One chunk of the whole."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, dtype in (("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")):
            shape = (BOMB // 8 + 1,)
            file.create_dataset(f"events/{name}", data=np.zeros(shape, dtype), chunks=shape, compression="gzip")


def parquet_bomb(path: Path) -> None:
    """A page of the whole."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    columns = {name: np.zeros(BOMB // 8, DTYPE[name]) for name in "txyp"}
    pq.write_table(
        pa.table(columns), path, compression="zstd", use_dictionary=False, data_page_size=2 * BOMB,
        row_group_size=BOMB, max_rows_per_page=BOMB, write_batch_size=BOMB,
    )  # fmt: skip


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("make", "most"),
    [
        (npz_bomb, 100), (aedat4_bomb, 200), (npz_header_bomb, 20), (hdf5_bomb, 100), (hdf5_chunk_bomb, 100),
        (parquet_bomb, 100),
    ],
)  # fmt: skip
def test_bombs_are_refused_while_they_are_unpacked(tmp_path: Path, make: Callable[[Path], None], most: int) -> None:
    """By the part that is unpacked, in little memory; the error says what allows more."""
    path = tmp_path / "bomb.npz"
    make(path)
    assert path.stat().st_size < 2 << 20
    assert peak_growth(path, "davis_rs.read_events(sys.argv[1])") < most << 20


@pytest.mark.few(2)
@pytest.mark.parametrize("compression", ["bz2", "lz4"])
@pytest.mark.parametrize("indexed", [True, False])
def test_chunks_of_bags_are_limited(tmp_path: Path, compression: str, indexed: bool) -> None:
    """With and without an index."""
    pytest.importorskip("rosbags")
    path = tmp_path / "bomb.bag"
    with davis_rs.open_writer(path, (240, 180), compression=compression) as writer:
        writer.write(events_of((5, 1, 2, 1)))
    content = bytearray(path.read_bytes())
    import lz4.frame

    packed = bz2.compress(bytes(BOMB)) if compression == "bz2" else lz4.frame.compress(bytes(BOMB))
    # The chunk's own data, in the place of what is there; the index behind it moves.
    at = content.index(b"compression=" + compression.encode())
    at = content.index(b"BZh9" if compression == "bz2" else b"\x04\x22\x4d\x18", at) - 4
    (size,) = struct.unpack_from("<I", content, at)
    content[at : at + 4 + size] = struct.pack("<I", len(packed)) + packed
    place = content.index(b"index_pos=") + len(b"index_pos=")
    (index,) = struct.unpack_from("<Q", content, place)
    struct.pack_into("<Q", content, place, index + len(packed) - size if indexed else 0)
    path.write_bytes(content)
    warned = nullcontext() if indexed else pytest.warns(davis_rs.TruncatedFileWarning)
    with pytest.raises(DecodeError, match=r"a chunk may have 67108864 bytes unpacked.*max_packet_bytes"), warned:
        davis_rs.read_events(path)


@pytest.mark.long
def test_more_is_unpacked_if_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By argument and by option."""
    path = tmp_path / "large.aedat4"
    path.write_bytes(aedat4((0, aedat4_events(np.zeros(BOMB // 16, DTYPE))), compression=3))
    assert len(davis_rs.read_events(path, max_packet_bytes=2 * BOMB)) == BOMB // 16
    for command in (["info", "--quiet"], ["decode"]):
        assert main([*command, str(path)]) == 1
        assert "--max-packet-bytes" in capsys.readouterr().err
        assert main([*command, str(path), "--max-packet-bytes", str(2 * BOMB)]) == 0
    assert main(["convert", "--quiet", str(path), str(tmp_path / "e.npy"), "--max-packet-bytes", str(2 * BOMB)]) == 0
    for wrong in (0, -1, 2**64):
        with pytest.raises(ValueError, match="max_packet_bytes must be a positive number"):
            davis_rs.read_events(path, max_packet_bytes=wrong)


def test_row_groups_and_columns_may_be_larger_than_a_part(tmp_path: Path) -> None:
    """The limit is on what is unpacked at once."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    events = np.zeros(100_000, DTYPE)
    events["t"] = np.arange(len(events))
    pq.write_table(pa.table({name: events[name] for name in "txyp"}), tmp_path / "e.parquet", data_page_size=10_000)
    np.savez_compressed(tmp_path / "e.npz", events=events)
    for name in ("e.parquet", "e.npz"):
        # A dictionary of all times is a part of its own.
        np.testing.assert_array_equal(davis_rs.read_events(tmp_path / name, max_packet_bytes=900_000), events)


# --- rules that all readers share ---


def write_npy(path: Path, events: Any) -> None:
    with path.open("wb") as file:
        np.save(file, events)


def write_npz(path: Path, events: Any) -> None:
    with path.open("wb") as file:
        np.savez(file, events=events)


def write_deflated(path: Path, events: Any) -> None:
    with path.open("wb") as file:
        np.savez_compressed(file, events=events)


def write_text(path: Path, events: Any) -> None:
    path.write_text("".join(f"{t / 1e6:.6f} {x} {y} {p}\n" for t, x, y, p in events.tolist()))


def write_aedat4(path: Path, events: Any) -> None:
    path.write_bytes(aedat4((0, aedat4_events(events))))


def write_hdf5(path: Path, events: Any) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name in "txyp":
            file[f"events/{name}"] = events[name]


def write_parquet(path: Path, events: Any) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    pq.write_table(pa.table({name: events[name] for name in "txyp"}), path)


WRITERS = [write_npy, write_npz, write_deflated, write_text, write_aedat4, write_hdf5, write_parquet]


@pytest.mark.parametrize("write", WRITERS)
def test_times_that_go_back(tmp_path: Path, write: Callable[[Path, Any], None]) -> None:
    """Are refused, dropped or kept, in every format alike; in parts, and in slices."""
    path = tmp_path / "events"
    rows = [(1, 1, 2, 1), (5, 1, 2, 0), (3, 1, 2, 1), (4, 2, 2, 0), (5, 3, 2, 1), (9, 1, 2, 0)]
    write(path, events_of(*rows))
    for chunk in (2, 100):
        with pytest.raises(DecodeError, match=r"must not decrease|may not go back"):
            list(davis_rs.iter_events(path, chunk=chunk))
        dropped = [
            event for part in davis_rs.iter_events(path, chunk=chunk, backward="drop") for event in part.tolist()
        ]
        assert dropped == [rows[0], rows[1], rows[4], rows[5]]
        kept = [event for part in davis_rs.iter_events(path, chunk=chunk, backward="keep") for event in part.tolist()]
        assert kept == rows
    with pytest.raises(DecodeError):
        davis_rs.read_events(path)
    assert davis_rs.read_events(path, backward="keep", start_us=4, stop_us=6).tolist() == [rows[1], rows[3], rows[4]]
    assert davis_rs.read_events(path, backward="drop", start_us=4, stop_us=6).tolist() == [rows[1], rows[4]]
    with pytest.raises(ValueError, match="backward must be one of refuse, drop, keep: got 'split'"):
        davis_rs.read_events(path, backward="split")  # type: ignore[arg-type]


@pytest.mark.parametrize("write", [write for write in WRITERS if write is not write_text])
@pytest.mark.parametrize("keep", [False, True])
def test_values_that_no_event_has(tmp_path: Path, write: Callable[[Path, Any], None], keep: bool) -> None:
    """A time before 0 and a polarity above 1 are always refused, with the event."""
    path = tmp_path / "events"
    policies: Any = {"backward": "keep", "outside": "keep"} if keep else {}
    write(path, events_of((-9, 1, 2, 1), (5, 1, 2, 1)))
    with pytest.raises(DecodeError, match="times may not lie before 0: event 0 is at -9 us"):
        davis_rs.read_events(path, **policies)
    if write is write_aedat4:
        return  # there a polarity is a truth value
    write(path, events_of((4, 1, 2, 1), (5, 1, 2, 200)))
    with pytest.raises(DecodeError, match=r"event 1 is .*200|p of event 1 is 200"):
        davis_rs.read_events(path, **policies)


def outside_evt(version: int) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with davis_rs.open_writer(path, (1000, 1000), f"evt{version}") as writer:
            writer.write(events_of((1, 0, 0, 1), (2, 500, 0, 1), (3, 0, 400, 1), (4, 239, 179, 0)))
        content = path.read_bytes()
        head = content[: content.index(b"% end")]
        assert b"1000" in head
        path.write_bytes(head.replace(b"width=1000", b"width=240").replace(b"height=1000", b"height=180")
                         .replace(b"geometry 1000x1000", b"geometry 240x180") + content[len(head) :])  # fmt: skip

    return write


def outside_aedat4(path: Path) -> None:
    rows = events_of((1, 0, 0, 1), (2, 500, 0, 1), (3, 0, 400, 1), (4, 239, 179, 0))
    path.write_bytes(aedat4((0, aedat4_events(rows))))


def outside_bag(path: Path) -> None:
    pytest.importorskip("rosbags")
    with davis_rs.open_writer(path, (1000, 1000), "bag") as writer:
        writer.write(events_of((1, 0, 0, 1), (2, 500, 0, 1), (3, 0, 400, 1), (4, 239, 179, 0)))
    size = struct.pack("<II", 1000, 1000)
    content = path.read_bytes()
    assert content.count(size) == 1
    path.write_bytes(content.replace(size, struct.pack("<II", 180, 240)))


def outside_text(path: Path) -> None:
    path.write_text("240 180\n0.000001 0 0 1\n0.000002 500 0 1\n0.000003 0 400 1\n0.000004 239 179 0\n")


def outside_hdf5(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    write_hdf5(path, events_of((1, 0, 0, 1), (2, 500, 0, 1), (3, 0, 400, 1), (4, 239, 179, 0)))
    with h5py.File(path, "a") as file:
        file.attrs["sensor_resolution"] = [180, 240]


@pytest.mark.parametrize(
    "write", [outside_evt(2), outside_evt(3), outside_aedat4, outside_bag, outside_text, outside_hdf5]
)
def test_pixels_outside_of_the_files_own_size(
    tmp_path: Path, write: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    """Are refused, dropped or kept, in every format alike; `info` counts them."""
    path = tmp_path / "events"
    write(path)
    with pytest.raises(DecodeError, match=r"pixels must lie within the .* of the file's sensor .*event 1 .*x 500"):
        davis_rs.read_events(path)
    inside = [(1, 0, 0, 1), (4, 239, 179, 0)]
    assert davis_rs.read_events(path, outside="drop").tolist() == inside
    assert len(davis_rs.read_events(path, outside="keep")) == 4
    assert main(["info", "--quiet", str(path)]) == 0
    assert "2 events lie outside of the sensor" in capsys.readouterr().out
    out = str(tmp_path / "out.npy")
    assert main(["convert", "--quiet", str(path), out]) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert main(["convert", "--quiet", "--overwrite", str(path), out, "--outside", "drop"]) == 0
    assert "2 outside of the sensor" in capsys.readouterr().err


def test_negative_coordinates_of_aedat4_are_outside(tmp_path: Path) -> None:
    """Also where the file states no size."""
    xml = '<dv><node name="outInfo"><node name="0"><attr key="typeIdentifier">EVTS</attr></node></node></dv>'
    path = tmp_path / "e.aedat4"
    path.write_bytes(aedat4((0, aedat4_events(np.array([(1, -1 & 0xFFFF, 0, 1)], "<i8,<i4,<i2,u1").astype(
        [("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "u1")]))), xml=xml))  # fmt: skip
    with pytest.raises(DecodeError, match="32768 x 32768"):
        davis_rs.read_events(path)


# --- wrong kinds of errors ---


@pytest.mark.parametrize("header", [
    b"{'descr': '|V1', 'fortran_order': False, 'shape': (", b"{'descr': " + b"(" * 2000,
    b"{'descr': [('t', '<i8'), ('x', '<u2'), ('y', '<u2'), ('p', 'u1')], 'fortran_order': False, 'shape': (-5,), }",
    b"{'descr': [('t', 'V0'), ('x', 'V0'), ('y', 'V0'), ('p', 'V0')], 'fortran_order': False, 'shape': (3,), }",
])  # fmt: skip
def test_headers_of_npy(tmp_path: Path, header: bytes) -> None:
    """Whatever NumPy's parser makes of them: no TokenError, no ZeroDivisionError, and no events where the number of
    them is negative."""
    header = header.ljust(118) + b"\n"
    content = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header
    (tmp_path / "e.npy").write_bytes(content)
    with pytest.raises(DecodeError):
        davis_rs.read_events(tmp_path / "e.npy")
    with zipfile.ZipFile(tmp_path / "e.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("events.npy", content)
    with pytest.raises(DecodeError):
        davis_rs.read_events(tmp_path / "e.npz")


@pytest.mark.long
def test_one_changed_byte_of_parquet_does_not_end_the_process(tmp_path: Path) -> None:
    """Arrow ends the process at a physical type that there is not: the metadata are looked at first."""
    pytest.importorskip("pyarrow")
    path = tmp_path / "e.parquet"
    with davis_rs.open_writer(path, (240, 180)) as writer:
        writer.write(events_of(*((t, 1, 2, 1) for t in range(100))))
    code = """
import sys, davis_rs
content = open(sys.argv[1], "rb").read()
(length,) = __import__("struct").unpack("<I", content[-8:-4])
unknown = 0
for place in range(len(content) - 8 - length, len(content) - 8):
    for change in (0x04,):
        damaged = bytearray(content)
        damaged[place] ^= change
        open(sys.argv[1], "wb").write(damaged)
        try:
            davis_rs.read_events(sys.argv[1])
        except davis_rs.DecodeError as error:
            unknown += "not of the type" in str(error)
print(unknown)
"""
    run = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr[-2000:]
    assert int(run.stdout) > 0


def test_lost_chunks_of_hdf5(tmp_path: Path) -> None:
    """A length without values, which would be zeros for ever, and values that lie in another file."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "e.h5"
    with h5py.File(path, "w") as file:
        for name, dtype in (("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")):
            file.create_dataset(f"events/{name}", (2**50,), dtype, chunks=(1000,))
    with pytest.raises(DecodeError, match="does not hold all of their chunks"):
        davis_rs.read_events(path)
    (tmp_path / "secret").write_bytes(bytes(800))
    with h5py.File(path, "w") as file:
        for name, dtype in (("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")):
            external = [(str(tmp_path / "secret"), 0, 800)]
            file.create_dataset(f"events/{name}", (10,), dtype, external=external)
    with pytest.raises(DecodeError, match="lies in another file"):
        davis_rs.read_events(path)


def test_files_that_never_end(tmp_path: Path) -> None:
    """Devices and pipes are no files."""
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    for path in (Path("/dev/zero"), fifo):
        for read in (davis_rs.read_events, davis_rs.read_recording):
            with pytest.raises(OSError, match="not a regular file"):
                read(path)


LFS_POINTER = b"""version https://git-lfs.github.com/spec/v1
oid sha256:aae51760731104270067a48246cc4d6d91c54af372b9c98281318c30b32e9506
size 132818295
"""


@pytest.mark.parametrize("name", ["events.aedat4", "events.npy", "events.h5", "events.txt", "recording.bag"])
def test_a_pointer_of_git_lfs_is_told_from_the_file(name: str, tmp_path: Path) -> None:
    """A clone without Git LFS has a few lines of text in place of each large file."""
    (path := tmp_path / name).write_bytes(LFS_POINTER)
    for read in (davis_rs.read_events, davis_rs.read_recording):
        with pytest.raises(DecodeError, match=r"a pointer of Git LFS \(git lfs pull"):
            read(path)


@pytest.mark.parametrize("name", ["mesh.obj", "mesh.ply", "world.glb", "world.gltf"])
def test_a_pointer_of_git_lfs_is_told_from_a_world(name: str, tmp_path: Path) -> None:
    (path := tmp_path / name).write_bytes(LFS_POINTER)
    with pytest.raises(DecodeError, match="a pointer of Git LFS"):
        davis_rs.load_scene(path)


@pytest.mark.parametrize("named", ["texture.png", "sky.exr", "mesh.ply", "mesh.obj"])
def test_a_pointer_of_git_lfs_is_found_by_the_scene_that_names_it(named: str, tmp_path: Path) -> None:
    (tmp_path / named).write_bytes(LFS_POINTER)
    filename = f'<string name="filename" value="{named}"/>'
    parts = {
        "texture.png": f'<shape type="cube"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">{filename}'
        "</texture></bsdf></shape>",
        "sky.exr": f'<emitter type="envmap">{filename}</emitter>',
    }
    part = parts.get(named, f'<shape type="{named[-3:]}">{filename}</shape>')
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{part}</scene>')
    with pytest.raises(DecodeError, match=rf"{named}: .*a pointer of Git LFS"):
        make_renderer(davis_rs.load_scene(tmp_path / "scene.xml"), PRESETS["ideal"])


def test_a_short_file_is_no_pointer_of_git_lfs(tmp_path: Path) -> None:
    (path := tmp_path / "events.txt").write_text("0.1 3 4 1\n")
    assert len(davis_rs.read_events(path)) == 1


# --- texts ---


def test_texts_that_never_end(tmp_path: Path) -> None:
    """Neither a device nor a pipe is read."""
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    for path in (Path("/dev/zero"), fifo):
        for read in (davis_rs.read_trajectory, davis_rs.Camera.from_calib, load_sequence_plan, RawRecording):
            with pytest.raises(OSError, match="not a regular file"):
                read(path)


def test_a_byte_order_mark_is_no_number(tmp_path: Path) -> None:
    """Of calibrations as of trajectories."""
    path = tmp_path / "calib.txt"
    path.write_text(davis_rs.load_camera("davis240c").to_calib(), encoding="utf-8-sig")
    assert davis_rs.Camera.from_calib(path) == davis_rs.load_camera("davis240c")


@pytest.mark.parametrize(
    ("word", "rule"),
    [("1e999999999", "a stamp must be in seconds"), ("9" * 1000, "may have 400 characters"), ("-1e999999999", "stamp")],
)
def test_stamps_without_end(tmp_path: Path, word: str, rule: str) -> None:
    """Are refused with their line."""
    path = tmp_path / "groundtruth.txt"
    path.write_text(f"0 0 0 0 0 0 0 1\n{word} 0 0 0 0 0 0 1\n")
    with pytest.raises(DecodeError, match=f"line 2: .*{rule}"):
        davis_rs.read_trajectory(path)


def test_positions_beyond_any_scene(tmp_path: Path) -> None:
    """Are refused before a spline goes through them."""
    path = tmp_path / "groundtruth.txt"
    path.write_text("0 0 0 0 0 0 0 1\n0.01 1e150 0 0 0 0 0 1\n")
    with pytest.raises(DecodeError, match=r"line 2: positions must lie within \+-1e9 m, found '1e150'"):
        davis_rs.read_trajectory(path)


@pytest.mark.parametrize(
    ("lines", "rule"),
    [
        (["a: &a [x, x]", *(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in pairwise("abcdefghi"))],
         "it may hold 20000 values"),
        (["scene: &a [*a]"], "recursive|nested"),
        (["scene: " + "[" * 60 + "]" * 60], "nested 50 levels"),
        (["scene: " + "[" * 5000], "nested 50 levels"),
        (["scene: fence", "sequences: 1000000000"], "sequences: must be at most 1000000"),
        (["scene: fence" + " " * 200_000], "it may have 131072 bytes"),
    ],
)  # fmt: skip
def test_plans_that_would_fill_the_memory(tmp_path: Path, lines: list[str], rule: str) -> None:
    """Or take all time."""
    path = tmp_path / "plan.yaml"
    path.write_text("\n".join(lines))
    with pytest.raises(ValueError, match=rule):
        load_sequence_plan(path)


@pytest.mark.long
def test_a_large_plan_is_drawn_as_it_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A million sequences are not held; --dry-run shows the first ones, and says so."""
    path = tmp_path / "plan.yaml"
    path.write_text("scene: three_planes\nsequences: 1000000\ncontrast_threshold: {uniform: [0.1, 0.2]}\n")
    sequences = draw_sequences(load_sequence_plan(path))
    assert (len(sequences), sequences[999_999].name) == (1_000_000, "sequence_999999")
    assert sequences[5:7][1].parameters == sequences[6].parameters
    assert main(["generate", str(path), "--dry-run", "--quiet"]) == 0
    assert "these are the first 1000 of 1000000 sequences" in capsys.readouterr().out


# --- two writers ---

WRITE = """
import sys, davis_rs, numpy as np
with davis_rs.open_writer(sys.argv[1], (240, 180), overwrite=True) as writer:
    writer.write(np.zeros(1, davis_rs.EVENT_DTYPE))
    print("writing", flush=True)
    sys.stdin.readline()
"""


@pytest.mark.few(2)
@pytest.mark.parametrize("name", ["e.txt", "e.npz", "e.aedat4", "e.parquet", "e.h5", "e.bag"])
@pytest.mark.parametrize("there", [True, *long_values(False)])
def test_a_file_has_one_writer(tmp_path: Path, name: str, there: bool) -> None:
    """The second one is refused by name, and changes nothing; so it is in another process and in this one."""
    path = tmp_path / name
    if there:
        with davis_rs.open_writer(path, (240, 180)) as writer:
            writer.write(events_of((1, 1, 2, 1)))
    process = subprocess.Popen([sys.executable, "-c", WRITE, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == b"writing\n"
        with pytest.raises(OSError, match=rf"another program is writing into it.*{name}") as caught:
            davis_rs.open_writer(path, (240, 180), overwrite=True)
        assert caught.value.errno == errno.EBUSY
    finally:
        process.communicate(b"\n", timeout=60)
    assert davis_rs.read_events(path).tolist() == [(0, 0, 0, 0)]
    with davis_rs.open_writer(path, (240, 180), overwrite=True):
        pass


def test_a_folder_has_one_writer(tmp_path: Path) -> None:
    """As a dataset: the second is refused, and what the first writes stays."""
    camera = davis_rs.load_camera("davis240c")
    (tmp_path / "d").mkdir()
    with DatasetWriter(tmp_path / "d", camera, overwrite=True) as writer:
        for overwrite in (False, True):
            with pytest.raises(OSError, match="another program is writing into it") as caught:
                DatasetWriter(tmp_path / "d", camera, overwrite=overwrite)
            assert caught.value.errno == errno.EBUSY
        writer.finish()
    DatasetWriter(tmp_path / "d", camera, overwrite=True).finish()


# --- what a file does not fill ---


def test_info_on_one_event_far_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Statistics take memory for events, not for the pixels that they span."""
    path = tmp_path / "e.npy"
    np.save(path, events_of((1, 3, 4, 1), (2, 3, 4, 0), (3, 65535, 65535, 1)))
    assert main(["info", "--quiet", str(path)]) == 0
    out = capsys.readouterr().out
    assert "65536 x 65536" in out
    assert "busiest (3, 4) with 2 events; 4,294,967,294 without any" in out


def test_counts_are_the_same_in_an_image_and_one_by_one() -> None:
    """Where the events span more, counts move from one to the other."""
    from davis_rs.inspection.pixel_counts import PixelCounts

    rng = np.random.default_rng(0)
    events = np.zeros(5000, DTYPE)
    events["x"], events["y"] = rng.integers(0, 5000, 5000), rng.integers(0, 30, 5000)
    events["x"][:2500] %= 50
    whole, parts = PixelCounts(None), PixelCounts((5000, 5000))
    for k in range(0, 5000, 500):
        whole.add(events[k : k + 500])
        parts.add(events[k : k + 500])
    far = events_of((0, 4999, 4999, 1))
    whole.add(far)
    parts.add(far)
    expected = np.zeros((5000, 5000), np.uint64)
    np.add.at(expected, (events["y"], events["x"]), np.uint64(1))
    y, x = divmod(int(expected.argmax()), 5000)
    for counts in (whole, parts):
        assert counts.size == (5000, 5000)
        assert counts.busiest == (x, y, int(expected.max()))
        assert counts.with_events == np.count_nonzero(expected) + 1
        with pytest.raises(ValueError, match="too large"):
            counts.image()
