"""davis_rs.convert: a dataset folder into every container that holds its parts, and back."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from davis_rs import DecodeError, EventWindows, open_writer, read_events
from davis_rs.cli.main import main
from davis_rs.events.arrays import EVENT_DTYPE, EventArray
from davis_rs.inspection.check import check_dataset
from davis_rs.inspection.summary import summarize_events
from davis_rs.io.dataset.reader import Dataset
from davis_rs.io.files.conversion import LeftOutWarning, convert
from davis_rs.io.files.read import open_reader
from davis_rs.io.formats import TruncatedFileWarning
from davis_rs.io.formats.parts import ALL_PARTS, PARTS
from davis_rs.io.formats.registry import written_formats
from event_files import assert_same, events_of, many
from recording_files import (
    aedat3,
    aedat3_event,
    aedat3_frame,
    aedat3_imu,
    aedat3_packet,
    aedat3_special,
    aedat4,
    aedat4_events,
    aedat4_frame,
    aedat4_imu,
    aedat4_triggers,
    aedat4_xml,
    frame_of,
)
from recording_folder import SIZE, complete_folder, quietly

for module in ("h5py", "hdf5plugin", "numcodecs", "rosbags"):
    pytest.importorskip(module)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return complete_folder(tmp_path_factory.mktemp("source") / "planes")


CONTAINERS: dict[str, tuple[str, dict[str, Any]]] = {
    "bag": ("a.bag", {}),
    "bag lz4": ("a.bag", {"compression": "lz4", "message_us": 1000}),
    "ros2 sqlite3": ("a", {"format": "ros2"}),
    "ros2 mcap": ("a", {"format": "ros2", "storage": "mcap", "message_events": 50}),
    "mcap file": ("a.mcap", {}),
    "evt3 packets": ("a", {"format": "ros2", "messages": "event_camera_msgs"}),
    "dsec": ("a.h5", {}),
    "mvsec": ("a.h5", {"format": "mvsec"}),
    "folder": ("a", {"events": "aedat4"}),
}


@pytest.mark.few(4)
@pytest.mark.parametrize("kind", CONTAINERS)
def test_a_folder_comes_back(folder: Path, tmp_path: Path, kind: str) -> None:
    """Folder, container, folder: the same events, frames, depth, IMU samples and calibration, bit by bit.

    Flow and poses too, but for MVSEC, whose displacements round to 1e-6 and whose poses are matrices.
    """
    name, options = CONTAINERS[kind]
    report = quietly(folder, tmp_path / name, **options)
    source = Dataset(folder)
    assert report.parts == {
        "camera": 1,
        "frames": len(source.frames),
        "depth": len(source.depth_maps),
        "flow": len(source.flow_maps),
        "imu": len(source.imu),
        "poses": len(source.groundtruth.t_us),
    }
    convert(tmp_path / name, tmp_path / "back")
    back = Dataset(tmp_path / "back")
    assert len(source.events) > 500
    assert_same(back.events, source.events)
    assert back.camera == source.camera
    np.testing.assert_array_equal(back.imu, source.imu)
    for part in ("frames", "depth_maps", "flow_maps"):
        assert [image.t_us for image in getattr(back, part)] == [image.t_us for image in getattr(source, part)]
    exact = kind != "mvsec"
    for index in range(len(source.frames)):
        np.testing.assert_array_equal(back.read_image(index), source.read_image(index))
    for index in range(len(source.depth_maps)):
        np.testing.assert_array_equal(back.read_depth(index), source.read_depth(index))
    for index in range(len(source.flow_maps)):
        np.testing.assert_allclose(back.read_flow(index), source.read_flow(index), rtol=0 if exact else 1e-6)
    np.testing.assert_array_equal(back.groundtruth.t_us, source.groundtruth.t_us)
    np.testing.assert_array_equal(back.groundtruth.positions, source.groundtruth.positions)
    signs = np.sign((back.groundtruth.quaternions * source.groundtruth.quaternions).sum(1, keepdims=True))
    np.testing.assert_allclose(
        signs * back.groundtruth.quaternions, source.groundtruth.quaternions, atol=0 if exact else 1e-14
    )
    checked = check_dataset(tmp_path / "back")
    assert checked.ok, checked
    assert checked.converted


def test_formats_have_the_methods_of_what_they_hold(folder: Path, tmp_path: Path) -> None:
    """`holds` names parts that there are; writers and readers have each part's method, and no others claim it, but for
    AEDAT, of which more is read than written."""
    for name, format in written_formats().items():
        assert set(format.holds) <= set(ALL_PARTS)
        given = {"frames", "imu"} if name in ("aedat2", "aedat4") else set(format.holds)
        with open_writer(tmp_path / name, (240, 180) if name == "aedat2" else SIZE, name) as writer:
            writer.write(events_of((5, 1, 2, 1)))
        with open_reader(tmp_path / name) as reader:
            for part in PARTS:
                assert hasattr(writer, part.write) == (part.name in format.holds), (name, part)
                assert hasattr(reader, part.read) == (part.name in given), (name, part)


def test_what_is_left_out_is_one_warning_and_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With counts from a folder; without, from other containers; nothing where parts are chosen."""
    with pytest.warns(LeftOutWarning, match=r"a\.bag \(bag\) cannot hold, and leaves out: 3 masks, 2 luma maps"):
        report = convert(folder, tmp_path / "a.bag")
    assert report.left_out == "3 masks, 2 luma maps"
    with pytest.warns(LeftOutWarning, match="leaves out: calibration, frames, depth maps, maps of optical flow, IMU"):
        convert(tmp_path / "a.bag", tmp_path / "a.npy")
    assert main(["convert", str(folder), str(tmp_path / "b.npy"), "--parts", "none", "--quiet"]) == 0
    assert not capsys.readouterr().err
    with pytest.raises(ValueError, match=r"parts are camera, .*'depths'; did you mean"):
        convert(folder, tmp_path / "c.bag", parts=("depths",))
    assert not (tmp_path / "c.bag").exists()


RECORDINGS = {
    "aedat3": aedat3(
        aedat3_packet(1, [aedat3_event(t, 3, 2, 1) for t in (900, 1500)]),
        aedat3_packet(2, [aedat3_frame(frame_of(*SIZE, bits=8))]),
        aedat3_packet(2, [aedat3_frame(frame_of(5, 4, t=1200, x=2, y=1))]),
        aedat3_packet(3, [aedat3_imu(1100, [1, 2, 3, 4, 5, 6, 20])]),
        aedat3_packet(0, [aedat3_special(1300, 2)]),
        source="unknown",
    ),
    "aedat4": aedat4(
        (0, aedat4_events(events_of((900, 3, 2, 1), (1500, 3, 2, 1)))),
        (1, aedat4_frame(frame_of(*SIZE, bits=8))),
        (1, aedat4_frame(frame_of(5, 4, t=1200, x=2, y=1), form=2)),
        (2, aedat4_imu([(1100, [20, 1, 2, 3, 4, 5, 6])])),
        (3, aedat4_triggers([(1300, 1)])),
        xml=aedat4_xml(size=SIZE),
    ),
}


@pytest.mark.parametrize("kind", RECORDINGS)
def test_a_recording_brings_its_frames_and_samples(tmp_path: Path, kind: str, recwarn: pytest.WarningsRecorder) -> None:
    """Frames of 8 bits in the middle of their exposure, on the whole sensor. What is lost is told, triggers too."""
    source = tmp_path / "recording"
    source.write_bytes(RECORDINGS[kind])
    warnings.simplefilter("always")
    report = convert(source, tmp_path / "folder", size=SIZE)
    said = [str(one.message) for one in recwarn]
    assert report.parts == {"frames": 2, "imu": 1}
    assert report.left_out == "triggers"
    folder = Dataset(tmp_path / "folder")
    assert folder.events["t"].tolist() == [900, 1500]
    assert [frame.t_us for frame in folder.frames] == [1015, 1215]
    np.testing.assert_array_equal(folder.read_image(0), frame_of(*SIZE, bits=8).pixels >> 8)
    part = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    part[1:5, 2:7] = frame_of(5, 4).pixels >> 8
    np.testing.assert_array_equal(folder.read_image(1), part)
    np.testing.assert_allclose(folder.imu["accel"], [np.array([1, 2, 3]) * 9.80665])
    np.testing.assert_allclose(folder.imu["gyro"], [np.radians([4, 5, 6])])
    assert [one for one in said if "upper 8 are taken" in one]
    assert [one for one in said if "they are 0 elsewhere" in one]
    only = convert(source, tmp_path / "e.npy", size=SIZE)
    assert only.left_out.startswith("frames, IMU samples, triggers")
    assert summarize_events(source, size=SIZE).also == {"frames": 2, "IMU samples": 1}
    assert "also        2 frames, 1 IMU samples" in str(summarize_events(source, size=SIZE))


def test_files_that_do_not_state_the_sensors_size_are_told(tmp_path: Path) -> None:
    with open_writer(tmp_path / "e.aedat4", (240, 180)) as writer:
        writer.write(many(40))
    told = "the sensor's size, 240 x 180"
    for name in ("e.npy", "e.npz", "e.txt"):
        with pytest.warns(LeftOutWarning, match=told):
            assert convert(tmp_path / "e.aedat4", tmp_path / name).left_out == told
    assert convert(tmp_path / "e.aedat4", tmp_path / "sized.txt", size_line=True).left_out == ""
    assert convert(tmp_path / "e.aedat4", tmp_path / "e.raw").left_out == ""
    # Where it was not known from the source, nothing is lost.
    assert convert(tmp_path / "e.npy", tmp_path / "again.npz", size=(240, 180)).left_out == ""


@pytest.mark.parametrize(("first_us", "shift_us"), [(3_600_000_000, 0), (1_589_163_147_365_215, 1_589_163_147_365_215)])
def test_folders_do_not_have_the_times_of_a_clock(first_us: int, shift_us: int, tmp_path: Path) -> None:
    """Unix times are counted from the first one, and a line says so; those of a recording's first hour stay."""
    events = many(40)
    events["t"] += first_us - events["t"][0]
    np.save(tmp_path / "e.npy", events)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        convert(tmp_path / "e.npy", tmp_path / "folder", size=(240, 180))
    assert any("times are counted from the first one" in str(one.message) for one in told) == (shift_us > 0)
    found = Dataset(tmp_path / "folder")
    assert found.meta["first_time_us"] == shift_us
    assert found.events["t"][0] == first_us - shift_us
    quietly(tmp_path / "e.npy", tmp_path / "kept", size=(240, 180), from_zero=False)
    assert Dataset(tmp_path / "kept").events["t"][0] == first_us
    # Windows of such a folder begin at its first event.
    windows = EventWindows(tmp_path / "kept", duration_us=10)
    assert windows[0].start_us == (first_us if shift_us else 0)


def test_a_part_without_anything_is_told(folder: Path, tmp_path: Path) -> None:
    """Seconds given as microseconds, or the other way round, make an empty file: a line says so."""
    with pytest.warns(UserWarning, match=r"nothing in the part that was asked for, 200000 s to its end"):
        convert(folder, tmp_path / "e.npy", start_us=200_000_000_000, parts=())
    # A calibration belongs to all times, so that it is nothing of the part.
    with pytest.warns(UserWarning, match="nothing in the part"):
        convert(folder, tmp_path / "copy", start_us=200_000_000_000, parts=("camera",))


def test_a_slice_that_begins_at_zero(folder: Path, tmp_path: Path) -> None:
    """start and stop hold for all parts; from_zero takes the first time off all of them."""
    report = quietly(
        folder, tmp_path / "part", start_us=30_000, stop_us=80_000, from_zero=True, parts=("frames", "imu")
    )
    source, part = Dataset(folder), Dataset(tmp_path / "part")
    events = source.events[(source.events["t"] >= 30_000) & (source.events["t"] < 80_000)].copy()
    samples = source.imu[(source.imu["t"] >= 30_000) & (source.imu["t"] < 80_000)]
    first = min(int(events["t"][0]), int(samples["t"][0]))
    events["t"] -= first
    assert_same(part.events, events)
    assert part.imu["t"].tolist() == (samples["t"] - first).tolist()
    assert [frame.t_us for frame in part.frames] == [f.t_us - first for f in source.frames if 30_000 <= f.t_us < 80_000]
    assert set(report.parts) == {"frames", "imu"}


@pytest.mark.parametrize("kind", ["bag", "ros2 sqlite3", "mcap file"])
def test_messages_stand_in_order_of_time(folder: Path, tmp_path: Path, kind: str) -> None:
    """In the file itself, at the time of their stamp (1 ns for 0); with each frame comes its calibration."""
    from davis_rs.io.formats.bag_records import scan_messages
    from davis_rs.io.formats.mcap_records import McapScan
    from davis_rs.io.formats.sqlite_records import SqliteScan

    name, options = CONTAINERS[kind]
    quietly(folder, tmp_path / name, **options)
    path = tmp_path / name
    if kind == "bag":
        found = list(scan_messages(path, 1 << 26))
    elif kind == "mcap file":
        found = list(McapScan(path, 1 << 26).messages())
    else:
        found = list(SqliteScan(path / "a.db3", 1 << 26).messages())
    times = [message.t_ns for message in found]
    assert times == sorted(times)
    at = {topic: [m.t_ns for m in found if m.topic == topic] for topic in {m.topic for m in found}}
    assert set(at) == {
        "/dvs/events", "/dvs/image_raw", "/dvs/imu", "/dvs/camera_info", "/optitrack/davis", "/dvs/depthmap",
        "/dvs/optic_flow",
    }  # fmt: skip
    assert at["/dvs/image_raw"] == at["/dvs/camera_info"] == [max(1, f.t_us * 1000) for f in Dataset(folder).frames]
    assert len(at["/dvs/events"]) > 5


def test_a_sample_waits_for_the_events_before_it(tmp_path: Path) -> None:
    """Events that are still gathered when a later sample comes stand before it."""
    from davis_rs.io.formats.bag_records import scan_messages

    writer: Any = open_writer(tmp_path / "a.bag", SIZE, message_us=10_000)
    writer.write(events_of((1_000, 1, 2, 1)))
    writer.write_imu(2_000, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    writer.write(events_of((20_000, 1, 2, 1)))
    writer.finish()
    found = scan_messages(tmp_path / "a.bag", 1 << 26)
    assert [message.t_ns for message in found] == [1_000_000, 2_000_000, 20_000_000]


def test_the_index_of_an_image_is_of_the_last_event_before_it(tmp_path: Path) -> None:
    """As MVSEC's converter has it: an event at the image's own time is not before it; -1 where there is none."""
    import h5py

    writer: Any = open_writer(tmp_path / "a.h5", SIZE, "mvsec")
    image = np.zeros(SIZE[::-1], np.uint8)
    writer.write_image(0, image)
    writer.write(events_of((5, 1, 2, 1), (7, 1, 2, 0), (7, 3, 2, 0)))
    writer.write_image(7, image)
    writer.write_image(8, image)
    writer.finish()
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["davis/left/image_raw_event_inds"][:].tolist() == [-1, 0, 2]


@st.composite
def streams(draw: st.DrawFn) -> EventArray:
    """Events with ties, and with silences of many rounds of EVT 3.0's clock, from 0 or in Unix time."""
    steps = draw(
        st.lists(
            st.tuples(
                st.sampled_from([0, 1, 4095, 9_999, 16_777_216, 100_000_000]),
                st.integers(0, 2047),
                st.integers(0, 2047),
                st.integers(0, 1),
            ),
            min_size=1,
            max_size=30,
        )
    )
    events = np.array(steps, EVENT_DTYPE)
    events["t"] = draw(st.sampled_from([0, 16_777_215, 1_700_000_000_123_456])) + np.cumsum(events["t"])
    return events


@settings(max_examples=40)
@given(events=streams(), name=st.sampled_from(["dvs", "", "camera_1", "ab"]))
def test_event_arrays_are_those_of_rosbags(events: EventArray, name: str) -> None:
    """Packed by us, bytes are those of rosbags' own serializer; what it packs (in either byte order) is read by us."""
    from davis_rs.io.formats.ros_events import pack_event_array, unpack_event_array
    from davis_rs.io.formats.ros_messages import header, typestore

    store = typestore(2)
    types = store.types
    time = types["builtin_interfaces/msg/Time"]
    message = types["dvs_msgs/msg/EventArray"](
        header=header(store, 0, int(events["t"][-1]), name),
        height=2048,
        width=2048,
        events=[
            types["dvs_msgs/msg/Event"](int(x), int(y), time(int(t) // 10**6, int(t) % 10**6 * 1000), bool(p))
            for t, x, y, p in events.tolist()
        ],
    )
    theirs = bytes(store.serialize_cdr(message, "dvs_msgs/msg/EventArray"))
    assert theirs.rstrip(b"\0") == pack_event_array(events, (2048, 2048), name).rstrip(b"\0")
    for data in (theirs, bytes(store.serialize_cdr(message, "dvs_msgs/msg/EventArray", little_endian=False))):
        found, size = unpack_event_array(Path("a"), data)
        assert_same(found, events)
        assert size == (2048, 2048)


@settings(max_examples=40)
@given(events=streams())
def test_event_packets_can_be_read_from_any_one_on(events: EventArray) -> None:
    """Each begins with its own time: all together, and the later half by itself, give the events that were packed."""
    from davis_rs.io.formats.ros_events import PacketDecoder, packet_message
    from davis_rs.io.formats.ros_messages import typestore

    parts = np.array_split(events, min(len(events), 4))
    packets = [packet_message(typestore(2), part, (2048, 2048), number, "dvs") for number, part in enumerate(parts)]
    assert all(packet.events.view("<u2")[0] >> 12 == 8 for packet in packets)
    for first in (0, len(packets) // 2):
        decoder = PacketDecoder(Path("a"))
        found = np.concatenate([decoder.unpack(packet)[0] for packet in packets[first:]])
        assert_same(found, np.concatenate(parts[first:]))


@pytest.mark.parametrize("kind", ["mcap file", "ros2 sqlite3", "ros2 mcap", "mvsec", "dsec", "bag", "folder"])
def test_what_was_flushed_is_there(tmp_path: Path, kind: str) -> None:
    """What lies on the disk after a flush, as if the process had been killed then: it reads with a warning."""
    name, options = CONTAINERS[kind]
    left = tmp_path / "left" / name
    left.parent.mkdir()
    options = {name: value for name, value in options.items() if name != "message_events"}
    events = many(50_000)
    writer: Any = open_writer(
        tmp_path / name, (240, 180), options.pop("format", None) or ("folder" if kind == "folder" else None), **options
    )
    writer.write(events[:30_000])
    writer.write_imu(5, [1.0, 2.0, 3.0], [4.0, 5.0, 6.0])
    writer.write_image(7, np.full((180, 240), 9, np.uint8))
    writer.flush()
    writer.write(events[30_000:])
    (shutil.copytree if (tmp_path / name).is_dir() else shutil.copy)(tmp_path / name, left)
    writer.finish()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", TruncatedFileWarning)
        with open_reader(left) as reader:
            found = reader.read()
            samples, images = list(reader.imu()), list(reader.images())  # type: ignore[attr-defined]
    assert told or kind == "folder"  # whose meta.json says it
    assert len(found) >= 30_000
    assert_same(found, events[: len(found)])
    assert [sample.t_us for sample in samples] == [5]
    assert [t_us for t_us, _ in images] == [7]
    with open_reader(tmp_path / name) as reader:
        assert_same(reader.read(), events)


def test_ros2_paths_are_replaced_only_where_a_bag_is(tmp_path: Path) -> None:
    """A folder that holds anything else stays as it is; so does a bag without overwrite."""
    for _ in range(2):
        with open_writer(tmp_path / "a", SIZE, "ros2", overwrite=True) as writer:
            writer.write(events_of((1, 2, 3, 1)))
    with pytest.raises(FileExistsError, match="overwrite=True"):
        open_writer(tmp_path / "a", SIZE, "ros2")
    (tmp_path / "a" / "notes.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="no rosbag2"):
        open_writer(tmp_path / "a", SIZE, "ros2", overwrite=True)
    assert (tmp_path / "a" / "notes.txt").read_text() == "mine"
    assert len(read_events(tmp_path / "a")) == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"storage": "lmdb"}, "sqlite3, mcap"),
        ({"messages": "dvs"}, "event_camera_msgs"),
        ({"message_us": 0}, "at least"),
    ],
)
def test_wrong_options_of_ros2_are_told(tmp_path: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        open_writer(tmp_path / "a", SIZE, "ros2", **options)
    assert not (tmp_path / "a").exists()


# ---- bytes of others ----


def mcap_bomb(path: Path) -> None:
    import struct

    record = struct.pack("<QQQII", 0, 0, 1 << 40, 0, 4) + b"zstd" + struct.pack("<Q", 0)
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(record)) + record)


def event_array_that_counts_too_many(path: Path) -> None:
    from davis_rs.io.formats.ros_events import pack_event_array

    data = pack_event_array(events_of((1, 2, 3, 1)), SIZE, "dvs")
    place = data.index(b"\x01\x00\x00\x00\x02\x00\x03\x00")
    writer: Any = open_writer(path, SIZE)
    writer._put(writer._events_topic, 1, data[:place] + b"\xff\xff\xff\xff" + data[place + 4 :])
    writer.finish()


def packet_of_another_encoding(path: Path) -> None:
    writer: Any = open_writer(path, SIZE, messages="event_camera_msgs")
    writer.write(events_of((1, 2, 3, 1)))
    writer.finish()
    path.write_bytes(path.read_bytes().replace(b"evt3", b"mono"))


def mvsec_events_of_three_columns(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["davis/left/events"] = np.zeros((5, 3))


def mvsec_event_between_pixels(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["davis/left/events"] = np.array([[1.0, 2.0, 0.1, 1.0], [np.nan, 2.0, 0.1, 1.0]])


@pytest.mark.parametrize(
    ("make", "name", "words"),
    [
        (mcap_bomb, "a.mcap", "max_packet_bytes"),
        (event_array_that_counts_too_many, "a.mcap", "events need"),
        (packet_of_another_encoding, "a.mcap", "'mono'"),
        (mvsec_events_of_three_columns, "a.h5", "davis/left/events must be of rows"),
        (mvsec_event_between_pixels, "a.h5", "event 1 is at"),
    ],
)
def test_malformed_containers_are_refused(tmp_path: Path, make: Callable[[Path], None], name: str, words: str) -> None:
    make(tmp_path / name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TruncatedFileWarning)
        with pytest.raises(DecodeError, match=words):
            read_events(tmp_path / name)


@pytest.mark.few(2)
@pytest.mark.parametrize("kind", ["mcap file", "ros2 sqlite3", "mvsec", "dsec"])
def test_mutants_are_read_or_refused(folder: Path, tmp_path: Path, kind: str) -> None:
    """Any bytes changed: a reader gives what it finds, or a DecodeError, from events and from all parts."""
    name, options = CONTAINERS[kind]
    quietly(folder, tmp_path / name, **options)
    path = tmp_path / name / f"{name}.db3" if kind == "ros2 sqlite3" else tmp_path / name
    whole, rng, refused = path.read_bytes(), np.random.default_rng(3), 0
    for _ in range(40):
        data = bytearray(whole)
        for place in rng.integers(0, len(data), 3) if rng.random() < 0.5 else rng.integers(0, 4000, 3):
            data[place] = rng.integers(0, 256)
        path.write_bytes(data[: len(data) - int(rng.integers(0, 2) * rng.integers(0, 5000))])
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                with open_reader(path, max_packet_bytes=1 << 24) as reader:
                    reader.read()
                    for part in PARTS:
                        list(getattr(reader, part.read)())
        except DecodeError:
            refused += 1
    assert refused > 3


# ---- the event file of a folder ----


@pytest.mark.parametrize("format", ["text", "npy", "evt3", "aedat2", "aedat4", "dsec", "parquet"])
def test_a_folder_gets_the_event_file_that_was_asked_for(tmp_path: Path, format: str) -> None:
    """One file in place of events.txt; everything that reads a folder reads it, and overwriting removes it."""
    from davis_rs.events.packet import Packet
    from davis_rs.io.dataset.files import EVENT_FILES
    from davis_rs.io.dataset.writer import DatasetWriter

    events = events_of((10, 1, 2, 1), (20, 3, 4, 0), (20, 5, 6, 1))
    for _ in range(2):
        size = (240, 180) if format == "aedat2" else SIZE
        with DatasetWriter(tmp_path / "d", size, events_format=format, overwrite=True) as writer:
            writer.write(Packet(0, 30, events, None))
        assert [path.name for path in (tmp_path / "d").iterdir() if path.name != "meta.json"] == [EVENT_FILES[format]]
        assert_same(Dataset(tmp_path / "d").events, events)
        assert_same(read_events(tmp_path / "d"), events)
    with DatasetWriter(tmp_path / "d", SIZE, overwrite=True) as writer:
        writer.write(Packet(0, 30, events[:1], None))
    assert (tmp_path / "d" / EVENT_FILES[format]).exists() == (format == "text")
    assert len(read_events(tmp_path / "d")) == 1
    with pytest.raises(ValueError, match="events_format must be one of text, npy"):
        DatasetWriter(tmp_path / "e", SIZE, events_format="csv")
