"""Other people's programs read our HDF5, Parquet and bags, and we read theirs; representations against tonic's."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import DecodeError, open_writer, read_events
from davis_rs.events.arrays import EVENT_DTYPE, EventArray
from davis_rs.events.dtypes import to_structured
from davis_rs.events.represent import count_image, time_surface, voxel_grid
from davis_rs.io.files.read import open_reader
from davis_rs.io.formats.e2vid import E2vidReader, E2vidWriter

SIZE = (240, 180)


def many(count: int, *, start_us: int = 0) -> EventArray:
    """Events on the sensor with ties and pauses of some milliseconds."""
    rng = np.random.default_rng(5)
    events = np.zeros(count, EVENT_DTYPE)
    pauses = np.where(rng.random(count) < 1e-3, 3_700, 0)
    events["t"] = start_us + np.cumsum(rng.integers(0, 30, count) + pauses)
    for field, limit in (("x", SIZE[0]), ("y", SIZE[1]), ("p", 2)):
        events[field] = rng.integers(0, limit, count)
    return events


def write(path: Path, events: EventArray, format: str | None = None, **options: Any) -> None:
    with open_writer(path, SIZE, format, **options) as writer:
        for start in range(0, len(events), 7_777):
            writer.write(events[start : start + 7_777])


# ---- HDF5 ----


class EventSlicer:
    """How DSEC's published loader cuts out a window, written anew from its rules.

    Source: https://github.com/uzh-rpg/DSEC, scripts/utils/eventslicer.py.
    """

    def __init__(self, file: Any) -> None:
        self.events = {name: file[f"events/{name}"] for name in ("t", "x", "y", "p")}
        self.ms_to_idx = np.asarray(file["ms_to_idx"], dtype="int64")
        self.t_offset = int(file["t_offset"][()])

    def window(self, start_us: int, stop_us: int) -> dict[str, npt.NDArray[Any]] | None:
        start_us, stop_us = start_us - self.t_offset, stop_us - self.t_offset
        first_ms, last_ms = math.floor(start_us / 1000), math.ceil(stop_us / 1000)
        if last_ms >= len(self.ms_to_idx):
            return None
        first, last = int(self.ms_to_idx[first_ms]), int(self.ms_to_idx[last_ms])
        t = np.asarray(self.events["t"][first:last])
        inner = slice(first + np.searchsorted(t, start_us), first + np.searchsorted(t, stop_us))
        found = {name: np.asarray(dataset[inner]) for name, dataset in self.events.items()}
        found["t"] = found["t"].astype(np.int64) + self.t_offset
        return found


@pytest.mark.parametrize("start_us", [0, 1_234_567, 1_700_000_000_123_456])
def test_dsecs_rules_hold(tmp_path: Path, start_us: int) -> None:
    """t[ms_to_idx[ms]] >= 1000 ms > t[ms_to_idx[ms] - 1] for every ms, and DSEC's windows are those of a mask."""
    h5py = pytest.importorskip("h5py")
    pytest.importorskip("hdf5plugin")
    events, path = many(200_000, start_us=start_us), tmp_path / "events.h5"
    write(path, events)
    with h5py.File(path) as file:
        assert [file[f"events/{name}"].dtype.str for name in "pxyt"] == ["|u1", "<u2", "<u2", "<u4"]
        t, index = file["events/t"][:].astype(np.int64), file["ms_to_idx"][:].astype(np.int64)
        assert len(index) == t[-1] // 1000 + 1
        due = np.arange(len(index)) * 1000
        assert (t[index] >= due).all()
        assert (t[index - 1][index > 0] < due[index > 0]).all()
        slicer = EventSlicer(file)
        for first, last in ((events["t"][100], events["t"][5_000] + 1), (events["t"][60_000], events["t"][140_000])):
            window = slicer.window(int(first), int(last))
            assert window is not None
            expected = events[(events["t"] >= first) & (events["t"] < last)]
            for name, column in window.items():
                np.testing.assert_array_equal(column, expected[name])


def test_e2vids_columns_are_what_its_loader_reads(tmp_path: Path) -> None:
    """Types, seconds, and the attributes of event_cnn_minimal, with h5py alone (no filter plugin)."""
    h5py = pytest.importorskip("h5py")
    events, path = many(100_000), tmp_path / "events.h5"
    with open_writer(path, SIZE, "e2vid") as writer:
        assert isinstance(writer, E2vidWriter)
        writer.write(events[:50_000])
        writer.write_image(500_000, (np.arange(240 * 180) % 256).astype(np.uint8).reshape(180, 240))
        writer.write(events[50_000:])
    with h5py.File(path) as file:
        assert [file[f"events/{name}"].dtype.str for name in ("xs", "ys", "ts", "ps")] == ["<i2", "<i2", "<f8", "|b1"]
        np.testing.assert_array_equal(file["events/ts"][:], events["t"] / 1e6)
        np.testing.assert_array_equal(file["events/ps"][:], events["p"] == 1)
        assert file.attrs["sensor_resolution"].tolist() == [180, 240]
        assert file.attrs["num_events"] == len(events)
        assert (file.attrs["t0"], file.attrs["tk"]) == (events["t"][0] / 1e6, events["t"][-1] / 1e6)
        assert list(file["images"]) == ["image000000000"]
        image = file["images/image000000000"]
        assert (image.attrs["timestamp"], image.attrs["event_idx"], image.shape) == (0.5, 50_000, (180, 240))
        assert file.attrs["num_imgs"] == 1
    with open_reader(path) as reader:
        assert isinstance(reader, E2vidReader)
        ((t_us, pixels),) = reader.images()
        assert (t_us, int(pixels[3, 4])) == (500_000, 3 * 240 % 256 + 4)


def test_hdf5_of_others_is_read(tmp_path: Path) -> None:
    """A file that h5py wrote by itself, contiguous and without our attributes, in either layout."""
    h5py = pytest.importorskip("h5py")
    pytest.importorskip("hdf5plugin")
    events = many(1_000)
    with h5py.File(tmp_path / "dsec.h5", "w") as file:
        for name in "xyp":
            file[f"events/{name}"] = events[name]
        file["events/t"] = events["t"].astype(np.uint32)
        file["t_offset"] = 5_000_000
    moved = read_events(tmp_path / "dsec.h5")
    assert (moved["t"] - 5_000_000).tolist() == events["t"].tolist()
    with h5py.File(tmp_path / "e2vid.h5", "w") as file:
        for name, field in (("xs", "x"), ("ys", "y")):
            file[f"events/{name}"] = events[field].astype(np.int16)
        file["events/ts"], file["events/ps"] = events["t"] * 1e-6, events["p"] * 2.0 - 1  # polarity as -1 and 1
    assert read_events(tmp_path / "e2vid.h5").tolist() == events.tolist()
    with h5py.File(tmp_path / "cut.h5", "w") as file:
        for name in "xypt":
            file[f"events/{name}"] = events[name][: 500 if name == "y" else None]
    with pytest.raises(DecodeError, match="differ in length"):
        read_events(tmp_path / "cut.h5")


# ---- Parquet ----


def test_pandas_and_polars_read_parquet(tmp_path: Path) -> None:
    """The columns t, x, y, p, each as NumPy would have them."""
    pytest.importorskip("pyarrow")
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    events, path = many(100_000), tmp_path / "events.parquet"
    write(path, events, row_group=30_000)
    for frame in (pandas.read_parquet(path), polars.read_parquet(path)):
        assert list(frame.columns) == ["t", "x", "y", "p"]
        for name in ("t", "x", "y", "p"):
            np.testing.assert_array_equal(np.asarray(frame[name]), events[name])


def test_parquet_of_others_is_read(tmp_path: Path) -> None:
    """Columns of wider types, from polars; floats, missing columns and values out of range are told."""
    pytest.importorskip("pyarrow")
    polars = pytest.importorskip("polars")
    events, path = many(1_000), tmp_path / "events.parquet"
    columns = {name: events[name].astype(np.int64) for name in ("t", "x", "y", "p")}
    polars.DataFrame(columns).write_parquet(path)
    assert read_events(path).tolist() == events.tolist()
    for change, words in (
        ({"x": events["x"] * 1.0}, "integers"),
        ({"x": columns["x"] - 1_000}, "x of event 0"),
        ({"p": columns["p"] * 2}, "p of event"),
    ):
        polars.DataFrame({**columns, **change}).write_parquet(path)
        with pytest.raises(DecodeError, match=words):
            read_events(path)
    polars.DataFrame({"t": columns["t"]}).write_parquet(path)
    with pytest.raises(DecodeError, match="no column x, y, p"):
        read_events(path)


# ---- bags ----


def test_rosbags_reads_our_bag(tmp_path: Path) -> None:
    """Types and checksums are those of the public bags, and every message is deserialized by rosbags alone."""
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    events, path = many(100_000), tmp_path / "events.bag"
    write(path, events)
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("uint16 x\nuint16 y\ntime ts\nbool polarity\n", "dvs_msgs/msg/Event"))
    definition = "Header header\nuint32 height\nuint32 width\nEvent[] events\n"
    store.register(get_types_from_msg(definition, "dvs_msgs/msg/EventArray"))
    found = []
    with rosbag1.Reader(path) as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.digest) == ("/dvs/events", "5e8beee5a6c107e504c2e78903c224b8")
        for _, t_ns, data in reader.messages():
            message = store.deserialize_ros1(data, connection.msgtype)
            assert (message.width, message.height) == SIZE
            last = message.events[-1].ts
            assert max(1, last.sec * 10**9 + last.nanosec) == t_ns
            found += [(e.ts.sec * 10**6 + e.ts.nanosec // 1000, e.x, e.y, int(e.polarity)) for e in message.events]
    assert found == events.tolist()


def test_all_topics_of_the_public_bags(tmp_path: Path) -> None:
    """Images, depth, calibration, IMU and poses with the public types, read back by rosbags' checksums and by us."""
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    from davis_rs import Camera
    from davis_rs.io.formats.bag import BagWriter
    from davis_rs.io.formats.bag_reader import BagReader

    path = tmp_path / "all.bag"
    rng = np.random.default_rng(2)
    image = rng.integers(0, 256, (180, 240), np.uint8)
    depth = rng.random((180, 240), np.float32)
    camera = Camera(240, 180, 199.1, 199.7, 133.7, 113.9, -0.38, 0.19, -0.001, -0.0005)
    quaternion = np.array([0.5, 0.1, -0.3, 0.8])
    quaternion /= np.linalg.norm(quaternion)
    with open_writer(path, SIZE) as writer:
        assert isinstance(writer, BagWriter)
        writer.write_camera(0, camera)
        writer.write_image(0, image)
        writer.write(many(100))
        writer.write_depth(1_000_001, depth)
        writer.write_imu(1_000_002, [0.1, -9.8, 0.3], [1.0, 2.0, -3.0])
        writer.write_pose(1_000_003, [1.0, 2.0, 3.0], quaternion)
    with rosbag1.Reader(path) as bag:
        assert {(c.topic, c.msgtype.split("/")[-1], c.digest) for c in bag.connections} == {
            ("/dvs/events", "EventArray", "5e8beee5a6c107e504c2e78903c224b8"),
            ("/dvs/camera_info", "CameraInfo", "c9a58c1b0b154e0e6da7578cb991d214"),
            ("/dvs/image_raw", "Image", "060021388200f6f0f447d0fcd9c64743"),
            ("/dvs/depthmap", "Image", "060021388200f6f0f447d0fcd9c64743"),
            ("/dvs/imu", "Imu", "6a62c6daae103f4ff57a132d6f95cec2"),
            ("/optitrack/davis", "PoseStamped", "d3812c3cbc69362b77dc0b19b345f8f5"),
        }
    with open_reader(path) as reader:
        assert isinstance(reader, BagReader)
        assert reader.read().tolist() == many(100).tolist()
        ((t_us, found),) = reader.images()
        assert t_us == 0
        np.testing.assert_array_equal(found, image)
        ((t_us, metres),) = reader.depth_maps()
        assert t_us == 1_000_001
        np.testing.assert_array_equal(metres, depth)
        calibration = reader.camera()
        assert calibration is not None
        assert Camera(*calibration) == camera
        (sample,) = reader.imu()
        assert (sample.t_us, sample.acceleration.tolist()) == (1_000_002, [0.1, -9.8, 0.3])
        assert sample.angular_velocity.tolist() == [1.0, 2.0, -3.0]
        (pose,) = reader.poses()
        assert (pose.t_us, pose.position.tolist()) == (1_000_003, [1.0, 2.0, 3.0])
        np.testing.assert_array_equal(pose.quaternion, quaternion)


def test_bags_of_others_are_read(tmp_path: Path) -> None:
    """A bag of message objects in wall-clock nanoseconds, as the public ones are, on a topic of another name."""
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    from davis_rs.io.formats.ros_messages import header, typestore

    store, path = typestore(), tmp_path / "theirs.bag"
    event = store.types["dvs_msgs/msg/Event"]
    time = store.types["builtin_interfaces/msg/Time"]
    with rosbag1.Writer(path) as bag:
        connection = bag.add_connection("/cam0/events", "dvs_msgs/msg/EventArray", typestore=store)
        for number in range(3):
            stamps = [time(1_468_940_293, 840_156_238 + 1_000 * number), time(1_468_940_294, 999_999_500)]
            message = store.types["dvs_msgs/msg/EventArray"](
                header=header(store, number, 0, "cam0"),
                height=180,
                width=240,
                events=[event(number, 7, stamp, bool(number % 2)) for stamp in stamps[: 1 + (number == 2)]],
            )
            data = store.serialize_ros1(message, "dvs_msgs/msg/EventArray")
            bag.write(connection, 1_468_940_295 * 10**9 + number, data)
    assert read_events(path).tolist() == [
        (1_468_940_293_840_156, 0, 7, 0),
        (1_468_940_293_840_157, 1, 7, 1),
        (1_468_940_293_840_158, 2, 7, 0),
        (1_468_940_295_000_000, 2, 7, 0),
    ]
    # Times of such a bag are not those of its events: slices look at every message.
    assert len(read_events(path, start_us=1_468_940_293_840_157, stop_us=1_468_940_293_840_158)) == 1


# ---- representations ----


def tonics(events: EventArray) -> npt.NDArray[np.void]:
    """In tonic's order of fields, with a polarity that its voxel grid can turn into -1."""
    return to_structured(events, np.dtype([("x", "i2"), ("y", "i2"), ("t", "i8"), ("p", "i1")]))


def test_representations_are_tonics() -> None:
    """Count images, voxel grids and time surfaces, to rounding."""
    functional = pytest.importorskip("tonic.functional")
    events = many(20_000)
    sensor = (*SIZE, 2)
    counts = functional.to_frame_numpy(tonics(events), sensor, n_event_bins=1)[0]
    np.testing.assert_array_equal(count_image(events, SIZE), counts)
    grid = functional.to_voxel_grid_numpy(tonics(events), sensor, n_time_bins=7)[:, 0]
    np.testing.assert_allclose(voxel_grid(events, SIZE, 7, endpoint=False, dtype=np.float64), grid, atol=1e-10)
    dt, tau, start = 50_000, 20_000.0, int(events["t"][0])
    surfaces = functional.to_timesurface_numpy(tonics(events), sensor, dt=dt, tau=tau)
    assert len(surfaces) > 3
    for number, surface in enumerate(surfaces):
        # Its window ends before dt, ours is given by its last moment.
        moment = start + (number + 1) * dt
        seen = events[events["t"] < moment]
        ours = time_surface(seen, SIZE, tau, t_us=moment, dtype=np.float64)
        np.testing.assert_allclose(ours, surface, rtol=1e-12)
