"""Dataset folders whose writer was killed: what is in them is told and read, and they can be replaced."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import davis_rs
from command_line import davis_rs as run
from davis_rs import Camera, DecodeError
from davis_rs.dataset import files
from davis_rs.dataset.files import EVENT_FILES
from davis_rs.dataset.reader import Dataset
from davis_rs.dataset.writer import DatasetWriter

KILLED = """
import os, signal, sys
import numpy as np
import davis_rs
from davis_rs.dataset.writer import DatasetWriter
writer = DatasetWriter(sys.argv[1], (8, 6), events_format=sys.argv[2], meta={"scene": {"name": "planes"}})
events = np.array([(5000, 1, 2, 1), (9000, 3, 4, 0)], davis_rs.EVENT_DTYPE)
image = np.full((6, 8), 0.5, np.float32)
writer.write(davis_rs.Packet(0, 10_000, events, davis_rs.Pose([0, 0, 0], [0, 0, 0, 1]), luma=image, frame=image))
events = np.array([(25000, 1, 1, 1)], davis_rs.EVENT_DTYPE)
writer.write(davis_rs.Packet(10_000, 30_000, events, davis_rs.Pose([0, 0, 0], [0, 0, 0, 1])))
os.kill(os.getpid(), signal.SIGKILL)
"""


def killed(folder: Path, format: str) -> Path:
    """A folder with three events and a frame whose writer was killed."""
    done = subprocess.run([sys.executable, "-c", KILLED, str(folder), format], capture_output=True, timeout=60)
    assert done.returncode == -9, done.stderr.decode()[-2000:]
    return folder


def replaced(folder: Path) -> None:
    """Another writer replaces what is there."""
    DatasetWriter(folder, (8, 6), overwrite=True).finish()
    assert sorted(path.name for path in folder.iterdir()) == ["events.txt", "meta.json"]
    assert Dataset(folder).meta["complete"] is True


def test_npz_is_read_as_far_as_it_was_written(tmp_path: Path) -> None:
    folder = killed(tmp_path / "d", "npz")
    assert Dataset(folder).events.tolist() == [(5000, 1, 2, 1), (9000, 3, 4, 0), (25000, 1, 1, 1)]
    with pytest.warns(davis_rs.TruncatedFileWarning, match=r"events.npz.part: the archive was cut, or never finished"):
        assert len(davis_rs.read_events(folder)) == 3
    said = run("info", folder, "--quiet")
    assert said.returncode == 0, said.stderr
    for line in (
        "sensor      8 x 6",
        "events      3",
        "scene       planes",
        "the folder was never finished",
        "T = 0.020 s",
    ):
        assert line in said.stdout
    replaced(folder)


def test_parquet_cannot_be_read_and_the_rest_is_told(tmp_path: Path) -> None:
    folder = killed(tmp_path / "d", "parquet")
    with pytest.raises(DecodeError, match=r"events.parquet.part: .* never finished, or was cut. The writer of this"):
        _ = Dataset(folder).events
    assert Dataset(folder).read_image(0).shape == (6, 8)
    said = run("info", folder, "--quiet")
    assert said.returncode == 1
    for line in ("dataset folder", "scene       planes", "also        1 frames", "the folder was never finished"):
        assert line in said.stdout
    assert "events.parquet.part" in said.stderr
    assert "--overwrite" in said.stderr
    replaced(folder)


@pytest.mark.parametrize("step", ["_remove_parts", "EventFile", "write_file"])
def test_a_writer_that_is_killed_at_once_leaves_what_can_be_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    """Before there is an event file, or while an older dataset is removed."""
    folder = tmp_path / "d"
    with DatasetWriter(folder, Camera(8, 6, 5.0, 5.0, 4.0, 3.0)):
        pass

    class Killed(BaseException):
        pass

    def kill(*_: object, **__: object) -> None:
        raise Killed

    with monkeypatch.context() as patch:
        where = files if hasattr(files, step) and step == "_remove_parts" else sys.modules[DatasetWriter.__module__]
        patch.setattr(where, step, kill)
        with pytest.raises(Killed):
            DatasetWriter(folder, Camera(8, 6, 5.0, 5.0, 4.0, 3.0), overwrite=True)
    replaced(folder)


@pytest.mark.parametrize("meta", [b"{}", b'{"complete": false}', b'{"complete": false}\n ', b""])
def test_a_folder_of_others_stays(tmp_path: Path, meta: bytes) -> None:
    """With no events in it, only what a writer of ours leaves to the byte is a dataset."""
    (tmp_path / "meta.json").write_bytes(meta)
    (tmp_path / "calib.txt").write_text("precious")
    with pytest.raises(FileExistsError, match="no dataset in it"):
        DatasetWriter(tmp_path, (8, 6), overwrite=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["calib.txt", "meta.json"]
    assert (tmp_path / "meta.json").read_bytes() == meta


@pytest.mark.parametrize("name", [f"{name}.part" for name in EVENT_FILES.values()])
def test_a_part_alone_is_no_dataset(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("precious")
    with pytest.raises(FileExistsError, match="no dataset in it"):
        DatasetWriter(tmp_path, (8, 6), overwrite=True)
    assert (tmp_path / name).read_text() == "precious"


def test_events_that_are_whole_come_before_a_part(tmp_path: Path) -> None:
    folder = killed(tmp_path / "d", "npz")
    (folder / "events.txt").write_text("0.000001000 1 1 1\n")
    assert Dataset(folder).events.tolist() == [(1, 1, 1, 1)]
