"""Other people's programs read whole recordings of ours: rosbags, mcap, h5py, evo, tonic."""

from __future__ import annotations

import json
import os
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import open_writer, read_events
from davis_rs.io.dataset.reader import Dataset
from event_files import assert_same, events_of
from recording_folder import SIZE, complete_folder, quietly

for module in ("h5py", "hdf5plugin", "numcodecs", "rosbags"):
    pytest.importorskip(module)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return complete_folder(tmp_path_factory.mktemp("source") / "planes")


def store_of(reader: Any) -> Any:
    """Message types as the bag itself defines them."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for connection in reader.connections:
        if connection.msgtype not in store.types:
            store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
    return store


@pytest.mark.parametrize("options", [{}, {"storage": "mcap"}, {"messages": "event_camera_msgs"}], ids=str)
def test_rosbags_reads_our_rosbag2(folder: Path, tmp_path: Path, options: dict[str, Any]) -> None:
    """Every message is deserialized by the definitions in the bag; counts, stamps and pixels are the folder's."""
    from rosbags.highlevel import AnyReader

    quietly(folder, tmp_path / "a", format="ros2", **options)
    source = Dataset(folder)
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([tmp_path / "a"]) as reader:
        for connection, t_ns, data in reader.messages():
            message: Any = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((t_ns, message))
    frames = [message for _, message in found["/dvs/image_raw"]]
    assert [m.header.stamp.nanosec // 1000 for m in frames] == [frame.t_us for frame in source.frames]
    np.testing.assert_array_equal(frames[1].data.reshape(frames[1].height, frames[1].width), source.read_image(1))
    assert len(found["/dvs/imu"]) == len(source.imu)
    assert len(found["/optitrack/davis"]) == len(source.groundtruth.t_us)
    assert found["/dvs/camera_info"][0][1].d.tolist() == list(source.camera.distortion)
    if "messages" in options:
        packets = [message for _, message in found["/dvs/events"]]
        assert {packet.encoding for packet in packets} == {"evt3"}
        assert sum(int((packet.events.view("<u2") >> 12 == 2).sum()) for packet in packets) == len(source.events)
    else:
        events = [event for _, message in found["/dvs/events"] for event in message.events]
        assert [(e.ts.nanosec // 1000, e.x, e.y, int(e.polarity)) for e in events] == source.events.tolist()


def test_rosbags_reads_our_bag_of_all_parts(folder: Path, tmp_path: Path) -> None:
    """AnyReader deserializes every message of a bag of ROS 1 by the definitions that stand in it."""
    from rosbags.highlevel import AnyReader

    quietly(folder, tmp_path / "a.bag")
    counts: dict[str, int] = {}
    with AnyReader([tmp_path / "a.bag"]) as reader:
        for connection, _, data in reader.messages():
            message: Any = reader.deserialize(data, connection.msgtype)
            counts[connection.topic] = counts.get(connection.topic, 0) + len(getattr(message, "events", "x"))
    assert counts["/dvs/events"] == len(Dataset(folder).events)
    assert counts["/dvs/image_raw"] == counts["/dvs/camera_info"] == len(Dataset(folder).frames)


def test_we_read_mcap_of_the_mcap_library(folder: Path, tmp_path: Path) -> None:
    """It reads our file in order of time; what it writes, compressed by either codec, is read by us."""
    mcap_reader, mcap_writer = pytest.importorskip("mcap.reader"), pytest.importorskip("mcap.writer")
    quietly(folder, tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = mcap_reader.make_reader(file)
        summary = reader.get_summary()
        messages = list(reader.iter_messages(log_time_order=False))
    times = [message.log_time for _, _, message in messages]
    assert times == sorted(times)
    assert summary.statistics.message_count == len(messages)
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    for compression in mcap_writer.CompressionType:
        with (tmp_path / "b.mcap").open("wb") as file:
            writer = mcap_writer.Writer(file, chunk_size=10_000, compression=compression)
            writer.start("ros2")
            channels = {}
            for schema, channel, message in messages:
                if channel.topic not in channels:
                    number = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
                writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
            writer.finish()
        assert_same(read_events(tmp_path / "b.mcap"), Dataset(folder).events)


def test_a_killed_sqlite_writer_is_recovered(tmp_path: Path) -> None:
    """A journal next to the database is played back before it is read, as SQLite asks for."""
    import shutil
    import sqlite3

    with open_writer(tmp_path / "a", SIZE, "ros2") as writer:
        writer.write(events_of((1, 2, 3, 1)))
    database = sqlite3.connect(tmp_path / "a" / "a.db3")
    database.execute("PRAGMA cache_size = 1")
    for _ in range(200):
        database.execute(
            "INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, timestamp, data FROM messages LIMIT 9"
        )
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    database.rollback()
    database.close()
    assert (tmp_path / "b" / "a.db3-journal").exists()
    assert read_events(tmp_path / "b").tolist() == [(1, 2, 3, 1)]


def test_mvsecs_layout(folder: Path, tmp_path: Path) -> None:
    """Names, shapes and types of MVSEC, by h5py alone; an image's index is of the last event before it."""
    import h5py

    quietly(folder, tmp_path / "a.h5", format="mvsec")
    source = Dataset(folder)
    events, (width, height) = source.events, SIZE
    with h5py.File(tmp_path / "a.h5") as file:
        left = file["davis/left"]
        table = left["events"][:]
        assert table.dtype == np.float64
        np.testing.assert_array_equal(table[:, 2], events["t"] / 1e6)
        np.testing.assert_array_equal(table[:, :2], np.stack([events["x"], events["y"]], 1))
        np.testing.assert_array_equal(table[:, 3] > 0, events["p"] == 1)
        times = left["image_raw_ts"][:]
        expected = np.searchsorted(table[:, 2], times) - 1
        np.testing.assert_array_equal(left["image_raw_event_inds"][:], expected)
        assert left["image_raw"].shape == (len(times), height, width)
        assert left["imu"].shape == (len(source.imu), 6)
        assert left["pose"].shape == (len(source.groundtruth.t_us), 4, 4)
        np.testing.assert_allclose(left["pose"][3][:3, 3], source.groundtruth.positions[3])
        flow, flow_s = left["flow_dist"], left["flow_dist_ts"][:]
        assert flow.shape == (len(source.flow_maps), 2, height, width)
        moved = source.read_flow(0) * (flow_s[1] - flow_s[0])
        np.testing.assert_allclose(np.moveaxis(flow[0], 0, -1), moved, rtol=1e-6)


def test_mvsecs_own_files_are_read(tmp_path: Path) -> None:
    """As its converter writes them: whole datasets, lzf, no attributes, Unix times, flow without our intervals."""
    import h5py

    from davis_rs.io.files.read import open_reader

    times = np.array([1_506_119_776.1, 1_506_119_776.2, 1_506_119_776.3])
    flow = np.ones((3, 2, 4, 5))
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        left = file.create_group("davis/left")
        left["events"] = np.array([[1, 2, 1_506_119_776.123456, -1], [3, 0, 1_506_119_776.123457, 1]], np.float64)
        images = np.arange(60, dtype=np.uint8).reshape(3, 4, 5)
        left.create_dataset("image_raw", data=images, compression="lzf", chunks=(1, 4, 5))
        left.create_dataset("flow_dist", data=flow, compression="lzf", chunks=(1, 2, 4, 5))
        left["image_raw_ts"] = left["flow_dist_ts"] = times
    with open_reader(tmp_path / "a.hdf5") as reader:
        assert reader.size == (5, 4)
        assert reader.read().tolist() == [(1_506_119_776_123_456, 1, 2, 0), (1_506_119_776_123_457, 3, 0, 1)]
        found: Any = reader
        assert [int(image[0, 0]) for _, image in found.images()] == [0, 20, 40]
        for t_us, pixels_per_second in found.flow_maps():
            assert t_us % 100_000 == 0
            np.testing.assert_allclose(pixels_per_second, 10.0, rtol=1e-5)


def test_evo_reads_our_poses(folder: Path, tmp_path: Path) -> None:
    """From a bag of ROS 1, and from the folder's groundtruth.txt, which is a TUM trajectory: the same path."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file_interface = pytest.importorskip("evo.tools.file_interface")
        from rosbags.rosbag1 import Reader

        quietly(folder, tmp_path / "a.bag")
        with Reader(tmp_path / "a.bag") as reader:
            ours = file_interface.read_bag_trajectory(reader, "/optitrack/davis")
        theirs = file_interface.read_tum_trajectory_file(folder / "groundtruth.txt")
    truth = Dataset(folder).groundtruth
    for path in (ours, theirs):
        np.testing.assert_allclose(path.timestamps, truth.t_us / 1e6, atol=1e-9)
        np.testing.assert_array_equal(path.positions_xyz, truth.positions)


READ_BY_TONIC = """
import json, sys
from tonic.datasets.davisdataset import DAVISDATA
dataset = DAVISDATA.__new__(DAVISDATA)
dataset.transform = dataset.target_transform = dataset.transforms = None
dataset.location_on_system, dataset.selection = sys.argv[1], ["a"]
(events, imu, images), target = dataset[0]
print(json.dumps([len(events), len(images["frames"]), len(imu["ts"]), len(target["point"])]))
"""


def test_tonic_loads_our_bag(folder: Path, tmp_path: Path) -> None:
    """The loader of tonic's DAVISDATA finds events, frames, IMU samples and poses.

    Its reader of bags needs NumPy < 2, so it runs in an environment of its own, without davis_rs.
    """
    python = os.environ.get("DAVIS_RS_TONIC_PYTHON")
    if python is None:
        pytest.skip("needs DAVIS_RS_TONIC_PYTHON, the Python of an environment with tonic and NumPy < 2")
    quietly(folder, tmp_path / "a.bag")
    command = [python, "-W", "ignore", "-c", READ_BY_TONIC, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    source = Dataset(folder)
    counts = [len(source.events), len(source.frames), len(source.imu), len(source.groundtruth.t_us)]
    assert json.loads(done.stdout.splitlines()[-1]) == counts
