"""The recording for Rerun's viewer, read back with Rerun's own reader."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from command_line import davis_rs
from davis_rs import convert, view_rerun
from davis_rs.inspection.figure import event_picture
from davis_rs.io.dataset.reader import Dataset
from written_sequence import HEIGHT, STEPS, WIDTH, write_sequence

rr: Any = pytest.importorskip("rerun")
reader: Any = pytest.importorskip("rerun.chunk")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rerun") / "d"
    write_sequence(path)
    rows = [f"{0.001 * k:.9f} {k} 2 3 0.1 {-0.01 * k} 0.3" for k in range(STEPS + 1)]
    (path / "imu.txt").write_text("\n".join(rows) + "\n")
    return path


def rows_of(path: Path, entity: str, component: str) -> list[tuple[int | None, Any]]:
    """(time in microseconds, value) of all rows of a component, in the order of time; no time where it is static."""
    found: list[tuple[int | None, Any]] = []
    for chunk in reader.RrdReader(path).store().stream():
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if name.endswith(component)]
        if str(chunk.entity_path) != entity or not names:
            continue
        values = batch.column(names[0]).to_pylist()
        times: Any = [None] * len(values)
        if "time" in batch.schema.names:
            times = np.asarray(batch.column("time").cast("int64")).astype(np.int64) // 1000
        found += [
            (None if t is None else int(t), value) for t, value in zip(times, values, strict=True) if value is not None
        ]
    return sorted(found, key=lambda row: row[0] or 0)


@pytest.mark.long
def test_all_parts_are_in_the_file(folder: Path, tmp_path: Path) -> None:
    """Each at its own times, with its own values."""
    output = tmp_path / "r.rrd"
    made = view_rerun(folder, output)
    dataset = Dataset(folder)
    n = len(dataset.events)
    assert made.kept == {
        "frames": (7, 7),
        "events": (n, n),
        "depth maps": (4, 4),
        "poses": (61, 61),
        "IMU samples": (61, 61),
    }
    assert "distortion is left out" in str(made)
    frame_times = [image.t_us for image in dataset.frames]
    assert [t for t, _ in rows_of(output, "/camera/image/frame", "blob")] == frame_times
    assert [t for t, _ in rows_of(output, "/events/accumulated", "blob")] == frame_times
    between = dataset.events[(dataset.events["t"] > frame_times[2]) & (dataset.events["t"] <= frame_times[3])]
    blob = rows_of(output, "/events/accumulated", "blob")[3][1][0]
    with Image.open(io.BytesIO(np.array(blob, np.uint8).tobytes())) as image:
        assert np.array_equal(np.array(image), event_picture(np.ones((HEIGHT, WIDTH)), between))
    depth = rows_of(output, "/camera/image/depth", "DepthImage:buffer")
    assert [t for t, _ in depth] == [image.t_us for image in dataset.depth_maps]
    metres = np.frombuffer(np.array(depth[1][1][0], np.uint8).tobytes(), np.float32).reshape(HEIGHT, WIDTH)
    expected = dataset.read_depth(1)
    assert np.array_equal(metres, np.where(np.isfinite(expected), expected, 0))
    poses = rows_of(output, "/camera", "translation")
    assert [t for t, _ in poses] == dataset.groundtruth.t_us.tolist()
    assert np.allclose([value[0] for _, value in poses], dataset.groundtruth.positions, atol=1e-6)
    turns = rows_of(output, "/camera", "quaternion")
    assert np.allclose([value[0] for _, value in turns], dataset.groundtruth.quaternions, atol=1e-6)
    matrix = rows_of(output, "/camera/image", "image_from_camera")[0][1][0]
    assert np.allclose(matrix, [20.5, 0, 0, 0, 20.25, 0, 12.0, 9.0, 1])  # by columns; centres at halves
    for entity, name in (("/imu/acceleration", "accel"), ("/imu/angular_rate", "gyro")):
        samples = rows_of(output, entity, "scalars")
        assert [t for t, _ in samples] == dataset.imu["t"].tolist()
        assert np.allclose([value for _, value in samples], dataset.imu[name])
    rates = rows_of(output, "/events/rate", "scalars")
    assert sum(on + off for _, (on, off) in rates) * 0.06 / len(rates) == pytest.approx(n)


@pytest.mark.long
def test_the_cloud_is_sampled_and_the_pictures_are_not(folder: Path, tmp_path: Path) -> None:
    """A point for each kept event, between the instants of the frames around it."""
    ran = davis_rs("view", folder, "--rerun", tmp_path / "r.rrd", "--max-events", "300", "--max-frames", "3")
    events = Dataset(folder).events
    assert ran.returncode == 0, ran.stderr
    assert f"3 of 7 frames, 300 of {len(events):,} events" in ran.stdout
    cloud = rows_of(tmp_path / "r.rrd", "/events/cloud", "positions")
    assert [t for t, _ in cloud] == [0, 30_000, 60_000]
    points = np.concatenate([np.array(value).reshape(-1, 3) for _, value in cloud])
    assert len(points) == 300
    pixels = {(x, y) for _, x, y, _ in events.tolist()}
    assert {(round(x), round(y)) for x, y, _ in points} <= pixels
    assert (np.diff(points[:, 2]) >= 0).all()


@pytest.mark.long
def test_an_event_file_has_pictures_of_equal_intervals(folder: Path, tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="leaves out"):
        convert(folder, tmp_path / "e.npy")
    made = view_rerun(tmp_path / "e.npy", tmp_path / "r.rrd", size=(WIDTH, HEIGHT))
    assert made.kept.keys() == {"events"}
    assert len(rows_of(tmp_path / "r.rrd", "/events/accumulated", "blob")) == 201


def test_without_a_file_a_viewer_is_started(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By Rerun's own call; here it is only noted."""
    calls: list[dict[str, Any]] = []
    monkeypatch.setattr(rr.RecordingStream, "spawn", lambda self, **arguments: calls.append(arguments))
    ran = davis_rs("view", folder, "--rerun")
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.startswith("Rerun viewer: 7 of 7 frames")
    assert list(calls[0]) == ["default_blueprint"]


def test_senseless_recordings_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"must end in \.rrd"):
        view_rerun(folder, tmp_path / "r.txt")
    with pytest.raises(ValueError, match="max_frames must be an integer >= 1"):
        view_rerun(folder, tmp_path / "r.rrd", max_frames=0)
    with pytest.raises(FileNotFoundError):
        view_rerun(folder, tmp_path / "missing" / "r.rrd")
    assert not list(tmp_path.iterdir())


def test_a_missing_sdk_says_how_to_get_it(folder: Path) -> None:
    program = (
        "import sys; sys.modules['rerun'] = None\nfrom davis_rs import view_rerun\n"
        f"try: view_rerun({str(folder)!r})\nexcept ImportError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "pip install 'davis_rs[rerun]'" in done.stdout
