"""Dataset folders: what DatasetWriter writes, Dataset reads; and what happens when something goes wrong."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from clips import write_exr
from davis_rs import DecodeError
from davis_rs.budget import VARIABLE
from davis_rs.dataset.files import stamp
from davis_rs.dataset.reader import Dataset
from davis_rs.dataset.writer import DatasetWriter
from davis_rs.events import EventArray
from davis_rs.packet import Packet
from davis_rs.pose import Pose
from places import SHARED
from written_sequence import (
    CAMERA,
    DEPTH_STEPS,
    FRAME_STEPS,
    HEIGHT,
    STEP_US,
    STEPS,
    WIDTH,
    depth_at,
    luma_at,
    packet_of,
    parameters,
    pose_at,
    some_events,
    write_sequence,
)


def contents(path: Path) -> dict[str, bytes]:
    return {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}


def test_everything_written_is_read_back(tmp_path: Path) -> None:
    """Events, frames, depth, luma, poses, calibration and counts of a sequence come back as they went in."""
    events = write_sequence(tmp_path / "d")
    dataset = Dataset(tmp_path / "d")
    assert len(events) > 1000
    assert np.array_equal(dataset.events, events)
    assert dataset.camera == CAMERA

    frame_steps = list(range(0, STEPS + 1, FRAME_STEPS))
    assert [image.t_us for image in dataset.frames] == [step * STEP_US for step in frame_steps]
    for index, step in enumerate(frame_steps):
        grey = np.clip(np.rint(255 * dataset.meta["image_gain"] * luma_at(step).astype(np.float64)), 0, 255)
        assert np.array_equal(dataset.read_image(index), grey.astype(np.uint8))
    depth_steps = list(range(0, STEPS + 1, DEPTH_STEPS))
    assert [image.t_us for image in dataset.depth_maps] == [step * STEP_US for step in depth_steps]
    for index, step in enumerate(depth_steps):
        assert np.array_equal(dataset.read_depth(index), depth_at(step))

    t_us, positions, quaternions = dataset.groundtruth
    poses = [pose_at(step) for step in range(STEPS + 1)]
    assert np.array_equal(t_us, np.arange(STEPS + 1) * STEP_US)
    assert t_us.dtype == np.int64
    assert np.array_equal(positions, [pose.position for pose in poses])
    assert np.array_equal(quaternions, [pose.quaternion for pose in poses])

    meta = dataset.meta
    assert meta["parameters"] == parameters()
    assert meta["sensor"] == {"width": WIDTH, "height": HEIGHT}
    assert meta["counts"] == {
        "events": len(events),
        "on_events": int(events["p"].sum()),
        "frames": 7,
        "depth_maps": 4,
        "luma_maps": 4,
        "poses": STEPS + 1,
        "imu_samples": 0,
    }
    assert (meta["duration_us"], meta["complete"], meta["interrupted"]) == (STEPS * STEP_US, True, False)


@pytest.mark.parametrize(("check_frames", "stored"), [(2, [0, 2, 4, 6]), (4, [0, 4, 6]), (8, [0, 6]), (0, [0, 6])])
def test_exact_luma_is_stored_for_the_check(tmp_path: Path, check_frames: int, stored: list[int]) -> None:
    """The first frame's luma, every n-th and the last are kept bit for bit."""
    write_sequence(tmp_path / "d", check_frames=check_frames)
    dataset = Dataset(tmp_path / "d")
    assert [image.t_us for image in dataset.luma] == [frame * FRAME_STEPS * STEP_US for frame in stored]
    for index, frame in enumerate(stored):
        assert np.array_equal(dataset.read_luma(index), luma_at(frame * FRAME_STEPS))


def test_files_have_the_layout_of_the_public_dataset(tmp_path: Path) -> None:
    """The text and image formats, literally, as strict readers of the public dataset expect them."""
    with DatasetWriter(tmp_path / "d", CAMERA, image_gain=1.0) as writer:
        luma, depth = luma_at(0), depth_at(0)
        writer.write(
            packet_of(0, 0, luma=luma, depth=depth), [(0, Pose(np.array([0.1, 0, -2]), np.array([0, 0, 0, 1])))]
        )
        writer.write(packet_of(0, 1_000_001, (7, 23, 17, 1), (1_000_001, 0, 0, 0), luma=luma))
    root = tmp_path / "d"
    assert (root / "events.txt").read_text() == "0.000007000 23 17 1\n1.000001000 0 0 0\n"
    assert (root / "images.txt").read_text() == (
        "0.000000000 images/frame_00000000.png\n1.000001000 images/frame_00000001.png\n"
    )
    assert (root / "depthmaps.txt").read_text() == "0.000000000 depthmaps/frame_00000000.exr\n"
    assert (root / "groundtruth.txt").read_text() == "0.000000000 0.1 0.0 -2.0 0.0 0.0 0.0 1.0\n"
    assert (root / "calib.txt").read_text() == "20.5 20.25 11.5 8.5 -0.1 0.0 0.0 0.0 0.0\n"
    with Image.open(root / "images/frame_00000001.png") as image:
        assert (image.mode, image.size) == ("L", (WIDTH, HEIGHT))
    with OpenEXR.File(str(root / "depthmaps/frame_00000000.exr")) as file:
        assert list(file.channels()) == ["Z"]
        assert file.channels()["Z"].pixels.dtype == np.float32
        assert file.header()["compression"] == OpenEXR.ZIP_COMPRESSION
    with OpenEXR.File(str(root / "luma/frame_00000000.exr")) as file:
        assert list(file.channels()) == ["Y"]


def test_lists_that_would_be_empty_are_not_written(tmp_path: Path) -> None:
    """A sequence of events alone leaves no list of frames, depth maps, luma or poses; they read as empty."""
    with DatasetWriter(tmp_path / "d", CAMERA) as writer:
        writer.write(packet_of(0, 10, (5, 1, 1, 1)))
    assert sorted(contents(tmp_path / "d")) == ["calib.txt", "events.txt", "meta.json"]
    dataset = Dataset(tmp_path / "d")
    assert (dataset.frames, dataset.depth_maps, dataset.luma) == ([], [], [])
    assert [part.shape for part in dataset.groundtruth] == [(0,), (0, 3), (0, 4)]
    assert dataset.meta["image_gain"] is None


@given(st.integers(0, 10**14))
def test_stamps_are_exact(t_us: int) -> None:
    """A stamp has nine decimals and is the time exactly, up to years (a float64 of seconds is not)."""
    assert re.fullmatch(r"[0-9]+\.[0-9]{6}000", stamp(t_us))
    assert int(stamp(t_us).replace(".", "")) == t_us * 1000


def test_exposure_follows_the_first_frame(tmp_path: Path) -> None:
    """The first frame's 98th percentile comes to 0.8 of full scale, and a brighter later frame does not change that."""
    first = np.linspace(0, 4, WIDTH * HEIGHT, dtype=np.float32).reshape(HEIGHT, WIDTH)
    with DatasetWriter(tmp_path / "d", CAMERA) as writer:
        writer.write(packet_of(0, 0, luma=first))
        writer.write(packet_of(0, 10, luma=10 * first))
        assert writer.image_gain == pytest.approx(0.8 / np.percentile(first, 98), rel=1e-6)
    dataset = Dataset(tmp_path / "d")
    assert dataset.meta["image_gain"] == writer.image_gain
    assert np.percentile(dataset.read_image(0), 98) == pytest.approx(0.8 * 255, abs=1)
    assert (dataset.read_image(1) == 255).mean() > 0.8


def test_exposure_of_a_black_first_frame_is_one(tmp_path: Path) -> None:
    """A black frame gives no scale, and no division by zero."""
    with DatasetWriter(tmp_path / "d", CAMERA) as writer:
        writer.write(packet_of(0, 0, luma=np.zeros((HEIGHT, WIDTH), np.float32)))
    assert Dataset(tmp_path / "d").meta["image_gain"] == 1.0
    assert not Dataset(tmp_path / "d").read_image(0).any()


@pytest.mark.parametrize("image_gain", [0.0, -1.0, float("nan"), float("inf")])
def test_a_senseless_exposure_is_refused(tmp_path: Path, image_gain: float) -> None:
    """Refused before the folder is made."""
    with pytest.raises(ValueError, match="image_gain must be positive and finite"):
        DatasetWriter(tmp_path / "d", CAMERA, image_gain=image_gain)
    assert not (tmp_path / "d").exists()


NAN_LUMA = np.full((HEIGHT, WIDTH), np.nan, np.float32)


@pytest.mark.parametrize(
    ("packet", "pose_us", "rule"),
    [
        (packet_of(9, 20), 20, r"packets must follow .* from 9 us to 20 us, the last one ended at 10 us"),
        (packet_of(12, 11), 20, "packets must follow"),
        (packet_of(10, 20, (12, 0, 0, 1), (11, 0, 0, 1)), 20, "must not go back: 11 us follows 12 us"),
        (packet_of(10, 20, (10, 0, 0, 1)), 20, r"interval \(10, 20\] us, got 10 to 10 us"),
        (packet_of(10, 20, (11, 0, 0, 1), (21, 0, 0, 1)), 20, r"interval \(10, 20\] us, got 11 to 21 us"),
        (packet_of(10, 20, (11, WIDTH, 0, 1)), 20, "x < 24, .* got x = 24, y = 0, p = 1 at 11 us"),
        (packet_of(10, 20, (11, 0, HEIGHT, 1)), 20, "y < 18"),
        (packet_of(10, 20, (11, 0, 0, 2)), 20, "p 0 or 1"),
        (packet_of(10, 20, (11, 0, 0, 1)), 5, "pose times must be >= 0 and increase, got 5 us after 5 us"),
        (packet_of(10, 20, luma=NAN_LUMA), 20, r"luma must lie in .* got nan at 20 us, pixel \(0, 0\)"),
        (packet_of(10, 20, luma=luma_at(0)[:-1]), 20, r"luma at 20 us must have the sensor's shape \(18, 24\)"),
        (packet_of(10, 20, depth=-depth_at(0)), 20, "depth must lie in 0..inf"),
    ],
)
def test_a_bad_packet_leaves_nothing_of_itself(tmp_path: Path, packet: Packet, pose_us: int, rule: str) -> None:
    """What does not fit is refused before anything of the packet is written, and the writer goes on."""
    with DatasetWriter(tmp_path / "d", CAMERA) as writer:
        writer.write(packet_of(0, 10, (10, 3, 3, 1)), [(5, pose_at(0))])
        before = contents(tmp_path / "d")
        with pytest.raises(ValueError, match=rule):
            writer.write(packet, [(pose_us, pose_at(0))])
        assert contents(tmp_path / "d") == before
        writer.write(packet_of(10, 20, (11, 3, 3, 1)), [(20, pose_at(0))])
    assert Dataset(tmp_path / "d").events.tolist() == [(10, 3, 3, 1), (11, 3, 3, 1)]


def test_an_empty_folder_is_taken_and_a_filled_one_refused(tmp_path: Path) -> None:
    """Nothing that exists is written into without being asked, and the refusal names the way out."""
    (tmp_path / "d").mkdir()
    write_sequence(tmp_path / "d")
    before = contents(tmp_path / "d")
    with pytest.raises(FileExistsError, match=r"not empty; overwrite=True.*d'"):
        DatasetWriter(tmp_path / "d", CAMERA)
    assert contents(tmp_path / "d") == before


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_file_in_the_way_is_refused(tmp_path: Path, overwrite: bool) -> None:
    """A file is never replaced by a folder, not even with overwrite."""
    (tmp_path / "d").write_text("mine")
    with pytest.raises(FileExistsError, match="a file is in the way"):
        DatasetWriter(tmp_path / "d", CAMERA, overwrite=overwrite)
    assert (tmp_path / "d").read_text() == "mine"


def test_overwrite_removes_the_old_dataset_and_nothing_else(tmp_path: Path) -> None:
    """Old frames, maps and the IMU file go, so that nothing of two sequences mixes; the user's files stay."""
    root = tmp_path / "d"
    write_sequence(root)
    mine = {"notes.txt": b"a", "images/mine.png": b"b", "images/frame_1.png": b"c", "bag/events.txt": b"d"}
    for name, data in mine.items():
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_bytes(data)
    (root / "imu.txt").write_text("0.0 0 0 0 0 0 0\n")
    with DatasetWriter(root, CAMERA, overwrite=True) as writer:
        writer.write(packet_of(0, 10, (5, 1, 1, 1)))
    left = contents(root)
    assert mine.items() <= left.items()
    assert left.keys() - mine.keys() == {"calib.txt", "events.txt", "meta.json"}
    assert Dataset(root).events.tolist() == [(5, 1, 1, 1)]


def test_overwrite_does_not_follow_links(tmp_path: Path) -> None:
    """An image folder that is a link to elsewhere keeps its files."""
    root, elsewhere = tmp_path / "d", tmp_path / "elsewhere"
    write_sequence(root)
    (root / "images").rename(elsewhere)
    (root / "images").symlink_to(elsewhere)
    before = contents(elsewhere)
    with DatasetWriter(root, CAMERA, overwrite=True) as writer:
        writer.write(packet_of(0, 10, luma=10 * luma_at(0)))
    assert contents(elsewhere) == before
    assert len(list((root / "images").iterdir())) == 1


@pytest.mark.parametrize("names", [["thesis.tex"], ["events.txt"], ["meta.json"]])
def test_overwrite_refuses_a_folder_that_is_no_dataset(tmp_path: Path, names: list[str]) -> None:
    """Without both of the files that every dataset has, overwrite touches nothing."""
    for name in names:
        (tmp_path / name).write_text("precious")
    with pytest.raises(FileExistsError, match="no dataset in it"):
        DatasetWriter(tmp_path, CAMERA, overwrite=True)
    assert contents(tmp_path) == dict.fromkeys(names, b"precious")


def test_an_unwritable_path_is_named(tmp_path: Path) -> None:
    """The system's refusal surfaces at once, with the path in it."""
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError, match=r"file/d"):
        DatasetWriter(tmp_path / "file" / "d", CAMERA)


def test_a_file_that_takes_nothing_more_stops_the_writer(tmp_path: Path) -> None:
    """A write that the system refuses raises OSError with the path; the writer closes and keeps what it wrote."""
    if not Path("/dev/full").exists():
        pytest.skip("needs /dev/full")
    writer = DatasetWriter(tmp_path / "d", CAMERA)
    (tmp_path / "d" / "groundtruth.txt").symlink_to("/dev/full")
    writer.write(packet_of(0, 10, (5, 1, 1, 1)))
    with pytest.raises(OSError, match=r"groundtruth\.txt") as caught:
        writer.write(packet_of(10, 20, (15, 2, 2, 0)), [(20, pose_at(0))])
    assert caught.value.errno == errno.ENOSPC
    with pytest.raises(ValueError, match="is closed"):
        writer.write(packet_of(20, 30))
    dataset = Dataset(tmp_path / "d")
    assert dataset.events.tolist() == [(5, 1, 1, 1), (15, 2, 2, 0)]
    assert dataset.meta["complete"] is False


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 256 KiB."""
    mount = tmp_path / "disk"
    mount.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(mount)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("needs mount")
    if done.returncode != 0:
        pytest.skip(f"mounting a small disk is not permitted: {done.stderr.strip()}")
    yield mount
    subprocess.run(["umount", str(mount)], check=True)


@pytest.mark.parametrize("events_a_packet", [0, 40, 3000])
def test_a_full_disk_surfaces_and_leaves_whole_packets(small_disk: Path, events_a_packet: int) -> None:
    """When the disk is full an OSError names the file, and the folder reads to the last packet that went through."""
    rows = [(0, x % WIDTH, x % HEIGHT, x % 2) for x in range(events_a_packet)]
    events = some_events(*rows)
    done: list[EventArray] = []

    def fill_the_disk() -> None:
        with DatasetWriter(small_disk / "d", CAMERA) as writer:
            for step in range(100_000):
                packet = Packet(step, step + 1, events.copy(), pose_at(0), luma_at(step), None)
                packet.events["t"] = step + 1
                writer.write(packet, [(step + 1, pose_at(step))])
                done.append(packet.events)

    with pytest.raises(OSError, match=f"{small_disk}/d/") as caught:
        fill_the_disk()
    assert caught.value.errno == errno.ENOSPC
    dataset = Dataset(small_disk / "d")
    # The packet that failed may have got as far as its events or its frame.
    assert len(done) <= len(dataset.frames) <= len(done) + 1
    assert len(dataset.events) in (len(done) * events_a_packet, (len(done) + 1) * events_a_packet)
    assert np.array_equal(dataset.events[: len(done) * events_a_packet], np.concatenate(done))
    for index in range(len(dataset.frames)):
        assert dataset.read_image(index).shape == (HEIGHT, WIDTH)
    assert len(dataset.groundtruth.t_us) == len(done)
    assert dataset.meta["complete"] is False
    assert not list((small_disk / "d").glob("*.part"))


def test_a_full_disk_leaves_no_half_written_poses(small_disk: Path) -> None:
    """Poses that do not fit are cut off again, to the end of the packet before."""
    writer = DatasetWriter(small_disk / "d", CAMERA)
    writer.write(packet_of(0, 1), [(0, pose_at(0))])
    before = (small_disk / "d" / "groundtruth.txt").read_bytes()
    with pytest.raises(OSError, match=r"groundtruth\.txt"):
        writer.write(packet_of(1, 10_000), [(t_us, pose_at(1)) for t_us in range(1, 10_000)])
    assert (small_disk / "d" / "groundtruth.txt").read_bytes() == before


ENDLESS_WRITER = """
import sys
import numpy as np
from davis_rs import EVENT_DTYPE
from davis_rs.dataset.writer import DatasetWriter
from davis_rs.packet import Packet
from written_sequence import CAMERA, depth_at, luma_at, parameters, pose_at
events = np.zeros(5000, EVENT_DTYPE)
with DatasetWriter(sys.argv[1], CAMERA, meta={"parameters": parameters()}) as writer:
    for step in range(10**9):
        events["t"] = step + 1
        writer.write(Packet(step, step + 1, events, pose_at(0), luma_at(step), depth_at(step)), [(step, pose_at(0))])
        print(step + 1, flush=True)
"""


def test_a_killed_process_leaves_what_it_had_written(tmp_path: Path) -> None:
    """After kill -9 the folder reads: at least every packet whose write had returned, and no half image."""
    process = subprocess.Popen(
        [sys.executable, "-c", ENDLESS_WRITER, str(tmp_path / "d")],
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([*sys.path])},
    )
    assert process.stdout is not None
    with process.stdout:
        returned = [int(process.stdout.readline()) for _ in range(20)][-1]
        process.send_signal(signal.SIGKILL)
        process.wait()
    dataset = Dataset(tmp_path / "d")
    assert len(dataset.events) >= 5000 * returned
    assert np.array_equal(dataset.events["t"], np.arange(len(dataset.events)) // 5000 + 1)
    assert len(dataset.frames) >= returned
    assert all(dataset.read_image(index).shape == (HEIGHT, WIDTH) for index in range(len(dataset.frames)))
    assert np.array_equal(dataset.read_depth(returned - 1), depth_at(returned - 1))
    assert len(dataset.groundtruth.t_us) >= returned
    assert dataset.meta["complete"] is False
    assert dataset.meta["parameters"] == parameters()


@pytest.mark.parametrize("name", ["events.txt", "images.txt", "groundtruth.txt"])
def test_a_torn_last_line_is_left_out_of_an_unfinished_dataset_only(tmp_path: Path, name: str) -> None:
    """A process can be killed in the middle of a line: without its newline that line does not count."""
    write_sequence(tmp_path / "d")
    text = (tmp_path / "d" / name).read_bytes()
    (tmp_path / "d" / name).write_bytes(text[:-3] if name == "events.txt" else text[: text[:-1].rfind(b"\n") + 8])

    def count() -> int:
        dataset = Dataset(tmp_path / "d")
        return {
            "events.txt": lambda: len(dataset.events),
            "images.txt": lambda: len(dataset.frames),
            "groundtruth.txt": lambda: len(dataset.groundtruth.t_us),
        }[name]()

    with pytest.raises(DecodeError, match=name):
        count()
    meta = json.loads((tmp_path / "d" / "meta.json").read_text())
    (tmp_path / "d" / "meta.json").write_text(json.dumps(meta | {"complete": False}))
    assert count() == text.count(b"\n") - 1


def test_meta_is_there_from_the_start(tmp_path: Path) -> None:
    """Before the first packet meta.json says what is known, and that the dataset is not complete."""
    with DatasetWriter(tmp_path / "d", CAMERA, meta={"scene": "box", "seed": 1}) as writer:
        meta = json.loads((tmp_path / "d" / "meta.json").read_text())
        assert (meta["scene"], meta["complete"], meta["sensor"]["width"]) == ("box", False, WIDTH)
        assert writer.finish({"seed": 2}) == json.loads((tmp_path / "d" / "meta.json").read_text())
    meta = Dataset(tmp_path / "d").meta
    assert (meta["scene"], meta["seed"], meta["complete"]) == ("box", 2, True)


def test_numpy_values_and_paths_become_json(tmp_path: Path) -> None:
    """Meta may hold NumPy scalars, arrays and paths; what JSON cannot hold is refused while the writer stays open."""
    with DatasetWriter(tmp_path / "d", CAMERA) as writer:
        with pytest.raises(TypeError, match=r"meta\.json cannot hold"):
            writer.finish({"scene": object()})
        with pytest.raises(ValueError, match="not JSON compliant"):
            writer.finish({"rate": np.float64("nan")})
        writer.write(packet_of(0, 10, (5, 1, 1, 1)))
        writer.finish({"a": np.float32(0.5), "b": np.arange(3), "c": Path("x/y")})
    meta = Dataset(tmp_path / "d").meta
    assert (meta["a"], meta["b"], meta["c"]) == (0.5, [0, 1, 2], "x/y")


def test_the_caller_can_end_early(tmp_path: Path) -> None:
    """finish(interrupted=True) makes a shorter dataset that says so."""
    with DatasetWriter(tmp_path / "d", CAMERA) as writer:
        writer.write(packet_of(0, 10, (5, 1, 1, 1)))
        writer.finish(interrupted=True)
    meta = Dataset(tmp_path / "d").meta
    assert (meta["complete"], meta["interrupted"], meta["duration_us"]) == (False, True, 10)


@pytest.mark.parametrize(("error", "interrupted"), [(KeyboardInterrupt, True), (RuntimeError, False)])
def test_an_exception_in_the_block_keeps_what_was_written(
    tmp_path: Path, error: type[BaseException], interrupted: bool
) -> None:
    """Ctrl-C and errors pass through unchanged; the folder is closed, shorter and says so."""

    def fail() -> None:
        with DatasetWriter(tmp_path / "d", CAMERA) as writer:
            writer.write(packet_of(0, 10, (5, 1, 1, 1), luma=luma_at(0)))
            raise error("mine")

    with pytest.raises(error, match=r"^mine$"):
        fail()
    dataset = Dataset(tmp_path / "d")
    assert dataset.events.tolist() == [(5, 1, 1, 1)]
    assert (dataset.meta["complete"], dataset.meta["interrupted"]) == (False, interrupted)
    assert dataset.meta["counts"]["frames"] == 1


def test_a_finished_writer_takes_nothing_more(tmp_path: Path) -> None:
    """Writing or finishing after finish is an error, not a silent loss."""
    writer = DatasetWriter(tmp_path / "d", CAMERA)
    writer.finish()
    for call in (writer.finish, lambda: writer.write(packet_of(0, 1))):
        with pytest.raises(ValueError, match=r"writer of .*d is closed"):
            call()


def test_the_public_dataset_reads() -> None:
    """A folder without meta.json, luma and depth opens; its nanoseconds go to the nearest microsecond."""
    folder = SHARED / "data" / "slider_depth"
    if not folder.is_dir():
        pytest.skip("needs the public slider_depth sequence")
    dataset = Dataset(folder)
    assert (dataset.camera.fx, dataset.camera.width, dataset.camera.height) == (335.419462958, 240, 180)
    assert dataset.meta == {}
    assert [image.t_us for image in dataset.frames[:3]] == [0, 38766, 77531]
    assert dataset.groundtruth.t_us[:3].tolist() == [22292, 31785, 42391]
    assert dataset.groundtruth.positions[0].tolist() == [0.1116875, 0.0, 0.0]
    assert (dataset.depth_maps, dataset.luma) == ([], [])
    with pytest.raises(FileNotFoundError, match="frame_00000000"):
        dataset.read_image(0)


@pytest.mark.parametrize(
    ("text", "t_us"),
    [
        ("0", 0),
        ("1000.000001", 1_000_000_001),
        ("0.0000005", 1),
        ("0.000000499", 0),
        ("9007199254.740993", 9007199254740993),
    ],
)
def test_times_are_parsed_without_floats(tmp_path: Path, text: str, t_us: int) -> None:
    """Times beyond what a float holds exactly come out exact, and decimals beyond microseconds are rounded."""
    (tmp_path / "images.txt").write_text(f"# time file\n\n{text} images/a.png\n")
    assert Dataset(tmp_path).frames == [(t_us, tmp_path / "images/a.png")]


@pytest.mark.parametrize("text", ["-0.1", "1e-3", "0,5", "nan", "1.", ".5", "1_0.0", "٣.0"])
def test_a_malformed_time_is_named(tmp_path: Path, text: str) -> None:
    """What is not decimal seconds is refused with file and line."""
    (tmp_path / "images.txt").write_text(f"0.0 a.png\n{text} b.png\n")
    with pytest.raises(DecodeError, match=r"images\.txt, line 2: expected a time"):
        _ = Dataset(tmp_path).frames


@pytest.mark.parametrize("line", ["0.1 1 2 3 0 0 0", "0.1 1 2 3 0 0 x 1", "0.1 1 2 nan 0 0 0 1"])
def test_a_malformed_pose_is_named(tmp_path: Path, line: str) -> None:
    """A pose with a number missing, unreadable or not finite is refused with file and line."""
    (tmp_path / "groundtruth.txt").write_text(f"0.0 0 0 0 0 0 0 1\n{line}\n")
    with pytest.raises(DecodeError, match=r"groundtruth\.txt, line 2"):
        _ = Dataset(tmp_path).groundtruth


@pytest.mark.parametrize("data", [b"", b"{", b"[1]", b'{"sensor": 5}', b"\xff\xfe"])
def test_a_malformed_meta_is_named(tmp_path: Path, data: bytes) -> None:
    """meta.json that is no JSON object, or has no sensor size where it should, is refused by name."""
    (tmp_path / "meta.json").write_bytes(data)
    (tmp_path / "calib.txt").write_text(CAMERA.to_calib())
    with pytest.raises(DecodeError, match=r"meta\.json"):
        _ = Dataset(tmp_path).camera


@pytest.mark.parametrize("keep", [0, 20, 200])
def test_a_malformed_image_is_named(tmp_path: Path, keep: int) -> None:
    """A truncated PNG or EXR gives a DecodeError with its path, not an error of the library behind."""
    write_sequence(tmp_path / "d")
    dataset = Dataset(tmp_path / "d")
    for series, read in ((dataset.frames, dataset.read_image), (dataset.depth_maps, dataset.read_depth)):
        path = series[1].path
        path.write_bytes(path.read_bytes()[:keep])
        with pytest.raises(DecodeError, match=path.name):
            read(1)


def test_images_of_another_kind_are_refused(tmp_path: Path) -> None:
    """A colour frame and an EXR without the channel are not taken for grey and depth."""
    write_sequence(tmp_path / "d")
    dataset = Dataset(tmp_path / "d")
    Image.new("RGB", (WIDTH, HEIGHT)).save(dataset.frames[0].path)
    with pytest.raises(DecodeError, match="8-bit grey image, found mode RGB"):
        dataset.read_image(0)
    dataset.depth_maps[0].path.write_bytes(dataset.luma[0].path.read_bytes())
    with pytest.raises(DecodeError, match=r"float32 channel 'Z', found \['Y'\]"):
        dataset.read_depth(0)


def test_a_folder_that_is_no_dataset_is_refused(tmp_path: Path) -> None:
    """Opening anything else says so at once."""
    with pytest.raises(FileNotFoundError, match="is not a dataset"):
        Dataset(tmp_path)
    (tmp_path / "sequence_00000").mkdir()
    (tmp_path / "sequence_00000" / "meta.json").write_text("{}")
    with pytest.raises(FileNotFoundError, match=r"its folders are datasets, such as .*sequence_00000$"):
        Dataset(tmp_path)
    with pytest.raises(FileNotFoundError, match="nowhere"):
        Dataset(tmp_path / "nowhere")
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError, match="file"):
        Dataset(tmp_path / "file")


def test_heavy_libraries_are_imported_only_when_needed() -> None:
    """Importing the package and these modules loads no image, plotting or rendering library."""
    program = (
        "import sys, davis_rs.dataset.writer, davis_rs.dataset.reader\n"
        "from davis_rs.inspection import check, figure, video\n"
        "print(sorted({'OpenEXR', 'PIL', 'matplotlib', 'imageio', 'mitsuba', 'tqdm'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_sizes_of_images_are_charged_before_they_are_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of all the channels that an EXR has, not only of those that are asked for."""
    (tmp_path / "images").mkdir()
    Image.new("L", (200, 100)).save(tmp_path / "images" / "a.png")
    (tmp_path / "images.txt").write_text("0.0 images/a.png\n")
    (tmp_path / "depthmaps").mkdir()
    maps = {name: np.ones((100, 200), np.float32) for name in ("Z", "a", "b")}
    write_exr(tmp_path / "depthmaps" / "a.exr", maps)
    (tmp_path / "depthmaps.txt").write_text("0.0 depthmaps/a.exr\n")
    dataset = Dataset(tmp_path)
    assert dataset.read_image(0).shape == dataset.read_depth(0).shape == (100, 200)
    monkeypatch.setenv(VARIABLE, "bytes=120KiB")
    with pytest.raises(DecodeError, match=r"a\.png: an image of 200 x 100 pixels needs 156 KiB"):
        dataset.read_image(0)
    with pytest.raises(DecodeError, match=r"a\.exr: (3 channels of 200 x 100 pixels|the file .*) needs"):
        dataset.read_depth(0)
