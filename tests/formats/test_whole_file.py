"""Files that get their name when they are whole: conversions, and whatever else is made at once."""

from __future__ import annotations

import errno
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from PIL import Image

from command_line import davis_rs as command
from davis_rs import Camera, convert, frames_to_folder, load_scene, open_writer, read_events, simulate_to_folder
from davis_rs._util.whole_file import Workplace, whole_file, write_whole
from davis_rs.inspection import video
from davis_rs.io.dataset.writer import DatasetWriter
from davis_rs.io.formats import EventWriter
from davis_rs.simulation import folder as simulation_folder
from event_files import SIZE, assert_same, many
from recording_files import aedat2, aedat2_event

pytestmark = pytest.mark.filterwarnings("ignore:.*leaves out. the sensor's size")

EVENTS = many(2000)
HDF5, ROS = ("h5py", "hdf5plugin", "numcodecs"), ("rosbags",)
TARGETS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "e.txt": ({}, ()),
    "e.npy": ({}, ()),
    "e.npz": ({}, ()),
    "e.raw": ({}, ()),
    "e.aedat4": ({}, ()),
    "e.h5": ({}, HDF5),
    "e.parquet": ({}, ("pyarrow",)),
    "e.bag": ({}, ROS),
    "e.mcap": ({}, ROS),
    "ros2": ({"format": "ros2"}, ROS),
    "folder": ({}, ()),
    "folder of h5": ({"events": "dsec"}, HDF5),
}
"""By what is made: options of the conversion, and libraries that it needs."""


@pytest.fixture(params=TARGETS)
def name(request: pytest.FixtureRequest) -> str:
    for library in TARGETS[request.param][1]:
        pytest.importorskip(library)
    return str(request.param)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A file to convert, alone in its folder."""
    with open_writer(tmp_path / "source.aedat4", SIZE) as writer:
        writer.write(EVENTS)
    return tmp_path / "source.aedat4"


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def stop(_: float) -> NoReturn:
    raise KeyboardInterrupt


def test_a_conversion_that_is_stopped_leaves_nothing(source: Path, name: str) -> None:
    """After Ctrl-C there is no file, no folder and no litter. The second try needs nothing else."""
    target, options = source.parent / name, TARGETS[name][0]
    with pytest.raises(KeyboardInterrupt):
        convert(source, target, progress=stop, **options)
    assert names(source.parent) == ["source.aedat4"]
    report = convert(source, target, **options)
    assert (report.path, report.events) == (str(target), len(EVENTS))
    assert names(source.parent) == sorted([name, "source.aedat4"])
    assert_same(read_events(target), EVENTS)


def test_what_was_there_stays_until_the_new_one_is_whole(source: Path, name: str) -> None:
    """An overwrite that is stopped changes nothing; one that ends replaces all of it."""
    target, options = source.parent / name, TARGETS[name][0]
    convert(source, target, stop_us=500, **options)
    there = read_events(target)
    with pytest.raises(KeyboardInterrupt):
        convert(source, target, overwrite=True, progress=stop, **options)
    with pytest.raises(FileExistsError, match="overwrite=True replaces"):
        convert(source, target, **options)
    assert_same(read_events(target), there)
    assert 0 < len(there) < len(EVENTS)
    convert(source, target, overwrite=True, **options)
    assert_same(read_events(target), EVENTS)
    assert names(source.parent) == sorted([name, "source.aedat4"])


@pytest.mark.parametrize(("name", "library"), [(name, one) for name, (_, some) in TARGETS.items() for one in some])
def test_a_missing_library_is_told_before_anything_is_made(
    source: Path, name: str, library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line with the extra, from the command and from writers; once the library is there the second try succeeds."""
    pytest.importorskip(library)
    target, options = source.parent / name, TARGETS[name][0]
    words = [word for key, value in options.items() for word in _as_words(key, value)]
    events = {key: value for key, value in options.items() if key == "events"}
    kind = "folder" if events else options.get("format")
    with monkeypatch.context() as without:
        without.setitem(sys.modules, library, None)
        done = command("convert", source, target, "--quiet", *words)
        assert done.returncode == 1
        assert re.fullmatch(
            rf"davis-rs: error: {library} is not installed: pip install 'davis_rs\[\w+\]'\n", done.stderr
        )
        with pytest.raises(ImportError, match="pip install"):
            open_writer(target, SIZE, kind, **events)
        if events:
            with pytest.raises(ImportError, match="pip install"):
                DatasetWriter(target, Camera(*SIZE, 200, 200, 120, 90), events_format=events["events"])
        assert names(source.parent) == ["source.aedat4"]
    assert command("convert", source, target, "--quiet", *words).returncode == 0
    assert_same(read_events(target), EVENTS)


def _as_words(key: str, value: str) -> list[str]:
    return ["--format", value] if key == "format" else ["--option", f"{key}={value}"]


@pytest.mark.parametrize("settings", [{"event_truth": "h5"}, {"events_format": "dsec"}])
def test_a_missing_library_is_told_before_a_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any]
) -> None:
    """Not when all is rendered, and without a folder that the second try would find in its way."""
    monkeypatch.setitem(sys.modules, "h5py", None)
    monkeypatch.setattr(simulation_folder, "make_simulator", lambda *_: pytest.fail("it is made too early"))
    with pytest.raises(ImportError, match=r"h5py is not installed: pip install 'davis_rs\[hdf5\]'"):
        simulate_to_folder(load_scene("three_planes"), tmp_path / "d", duration_s=0.01, **settings)
    if "events_format" in settings:
        with pytest.raises(ImportError, match="h5py is not installed"):
            frames_to_folder(tmp_path, tmp_path / "d", **settings)
    assert names(tmp_path) == []


@pytest.mark.long
def test_a_killed_conversion_leaves_what_the_next_one_removes(source: Path, run_python: Callable[..., str]) -> None:
    """kill -9 leaves a hidden folder that has the target's name in its own. It does not stop the second try."""
    program = """
import os, signal, sys
import davis_rs
for name in sys.argv[2:]:
    child = os.fork()
    if not child:
        davis_rs.convert(sys.argv[1], name, progress=lambda _: os.kill(os.getpid(), signal.SIGKILL))
    os.waitpid(child, 0)
"""
    targets = ["e.npz", "e.txt", "folder"]
    run_python(program, str(source), *(str(source.parent / name) for name in targets))
    *left, last = names(source.parent)
    assert [re.sub("[0-9a-f]{32}", "*", one) for one in left] == [f".{name}.*.part" for name in targets]
    assert last == "source.aedat4"
    for name in targets:
        convert(source, source.parent / name)
        assert_same(read_events(source.parent / name), EVENTS)
    assert names(source.parent) == [*targets, "source.aedat4"]


def test_a_full_disk_is_told_by_the_name_of_the_target(small_disk: Path, tmp_path: Path) -> None:
    """ENOSPC with the path that the caller gave, and room again afterwards."""
    with open_writer(tmp_path / "source.npy", SIZE) as writer:
        writer.write(many(200_000))
    for name in ("e.txt", "e.npy"):
        with pytest.raises(OSError, match=re.escape(str(small_disk / name))) as refused:
            convert(tmp_path / "source.npy", small_disk / name, size=SIZE)
        assert (refused.value.errno, ".part" in str(refused.value)) == (errno.ENOSPC, False)
        assert names(small_disk) == []


def test_one_process_at_a_time_makes_a_file(source: Path) -> None:
    """EBUSY with the path: for a second conversion, and while a writer writes there."""
    target = source.parent / "e.txt"
    first = Workplace(target)
    with pytest.raises(OSError, match=re.escape(str(target))) as refused:
        convert(source, target)
    assert refused.value.errno == errno.EBUSY
    first.discard()
    with open_writer(target, SIZE), pytest.raises(OSError, match="another program is writing") as refused:
        convert(source, target, overwrite=True)
    assert refused.value.errno == errno.EBUSY
    convert(source, target, overwrite=True)
    assert names(source.parent) == ["e.txt", "source.aedat4"]


def test_places_that_cannot_be_written_are_told(source: Path) -> None:
    """A folder that is not there, and one where a file is to be; the folder of a dataset is made with those above."""
    nowhere = source.parent / "no" / "such"
    with pytest.raises(FileNotFoundError, match=re.escape(f"'{nowhere / 'e.txt'}'")):
        convert(source, nowhere / "e.txt")
    with pytest.raises(KeyboardInterrupt):
        convert(source, nowhere / "folder", progress=stop)
    assert names(source.parent) == ["source.aedat4"]
    convert(source, nowhere / "folder")
    with pytest.raises(IsADirectoryError):
        convert(source, nowhere, format="text", overwrite=True)
    assert_same(read_events(nowhere / "folder"), EVENTS)


def test_other_files_in_a_folder_stay(source: Path) -> None:
    """What is not the dataset's is neither removed nor moved, and a folder without one is refused."""
    target = source.parent / "folder"
    convert(source, target)
    (target / "notes.md").write_text("mine")
    convert(source, target, overwrite=True, events="npy")
    assert names(target) == ["events.npy", "meta.json", "notes.md"]
    (target / "meta.json").unlink()
    with pytest.raises(FileExistsError, match="no dataset in it"):
        convert(source, target, overwrite=True)
    assert names(target) == ["events.npy", "notes.md"]


def test_a_folder_that_is_there_stays_the_same_one(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that whoever is in it, as in the current one, finds what was made."""
    (source.parent / "folder").mkdir()
    monkeypatch.chdir(source.parent / "folder")
    assert convert(source, ".", format="folder").path == "."
    assert names(Path()) == ["events.txt", "meta.json"]
    assert names(source.parent) == ["folder", "source.aedat4"]


def test_a_file_system_without_locks_keeps_what_others_make(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What cannot be told from what a killed process has left stays. NFS locks no file that is open for reading."""

    def refuse(*_: object) -> NoReturn:
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))

    monkeypatch.setattr("fcntl.flock", refuse)
    other = Workplace(source.parent / "e.txt")
    convert(source, source.parent / "e.txt")
    convert(source, source.parent / "e.txt", overwrite=True)
    assert_same(read_events(source.parent / "e.txt"), EVENTS)
    assert other.working_path.parent.is_dir()


def test_links_and_pipes_stay_what_they_are(source: Path) -> None:
    """What a link leads to is replaced, and a pipe gets the bytes."""
    (source.parent / "far.npy").write_bytes(b"old")
    link, pipe = source.parent / "near.npy", source.parent / "pipe"
    link.symlink_to("far.npy")
    convert(source, link, overwrite=True)
    assert link.is_symlink()
    assert_same(read_events(source.parent / "far.npy"), EVENTS)
    os.mkfifo(pipe)
    received: list[bytes] = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_bytes()))
    reader.start()
    convert(source, pipe, format="text")
    reader.join()
    assert received[0].count(b"\n") == len(EVENTS)


def test_a_writer_is_whole_or_there_at_any_time(tmp_path: Path) -> None:
    """As its caller wants: with whole=True nothing is there before the end, nor after an error."""
    with open_writer(tmp_path / "whole.txt", SIZE, whole=True) as writer:
        writer.write(EVENTS)
        writer.flush()
        assert not (tmp_path / "whole.txt").exists()
    assert writer.finish().path == str(tmp_path / "whole.txt")
    with pytest.raises(ValueError, match="must not decrease"):
        _write_twice(open_writer(tmp_path / "b.txt", SIZE, whole=True))
    assert names(tmp_path) == ["whole.txt"]
    appeared = open_writer(tmp_path / "c.txt", SIZE, whole=True)
    (tmp_path / "c.txt").write_text("precious")
    with pytest.raises(FileExistsError, match=r"c\.txt"):
        appeared.finish()
    assert (tmp_path / "c.txt").read_text() == "precious"
    assert names(tmp_path) == ["c.txt", "whole.txt"]


def _write_twice(writer: EventWriter) -> None:
    with writer:
        writer.write(EVENTS)
        writer.write(EVENTS)


@pytest.mark.parametrize("suffix", [".txt", ".npz"])
def test_a_recording_that_cannot_be_decoded_leaves_nothing(tmp_path: Path, suffix: str) -> None:
    """Neither what was decoded before the error, nor an empty file that the second try would find in its way."""
    rows = [(aedat2_event(3, 5, 1), 700), (aedat2_event(4, 5, 0), 300)]
    (tmp_path / "r.aedat").write_bytes(aedat2(rows) + b"\0")
    done = command("decode", tmp_path / "r.aedat", "-o", tmp_path / f"e{suffix}")
    if suffix == ".txt":
        assert (done.returncode, "times may not go back" in done.stderr) == (1, True)
        assert names(tmp_path) == ["r.aedat"]
        done = command("decode", tmp_path / "r.aedat", "-o", tmp_path / "e.txt", "--backward", "split")
    assert done.returncode == 0
    again = command("decode", tmp_path / "r.aedat", "-o", tmp_path / f"e{suffix}")
    assert (again.returncode, "exists" in again.stderr) == (1, True)


def test_arrays_are_there_when_they_are_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A .npz of decode or record is not there before its end: whoever is killed leaves no empty file."""
    (tmp_path / "r.aedat").write_bytes(aedat2([(aedat2_event(3, 5, 1), 700)]))

    def full(place: Path, **_: object) -> NoReturn:
        place.write_bytes(b"some")
        raise OSError(errno.ENOSPC, "No space left on device", str(place))

    with monkeypatch.context() as small:
        small.setattr(np, "savez", full)
        done = command("decode", tmp_path / "r.aedat", "-o", tmp_path / "e.npz")
    assert done.stderr == f"davis-rs: error: {tmp_path / 'e.npz'}: No space left on device\n"
    assert names(tmp_path) == ["r.aedat"]


def test_files_that_are_made_at_once(tmp_path: Path) -> None:
    """They appear when the block ends, replace what was there, and leave it after an error."""
    path = tmp_path / "page.html"
    with whole_file(path) as place:
        place.write_text("first")
        assert (place.suffix, path.exists()) == (".html", False)
    write_whole(path, "second")

    def fail() -> None:
        with whole_file(path) as place:
            place.write_text("third")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    with pytest.raises(FileExistsError), whole_file(path, overwrite=False):
        pass
    assert (path.read_text(), names(tmp_path)) == ("second", ["page.html"])


def test_a_video_that_is_stopped_leaves_nothing(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a picture or a page does; imageio has written some of it by then."""
    pytest.importorskip("imageio")

    def pictures(*_: object) -> Iterator[Any]:
        yield np.zeros((8, 8, 3), np.uint8)
        raise KeyboardInterrupt

    monkeypatch.setattr(video, "_pictures", pictures)
    with pytest.raises(KeyboardInterrupt):
        video.make_video(source, source.parent / "v.gif")
    assert names(source.parent) == ["source.aedat4"]


@pytest.mark.parametrize(
    "words",
    [
        ("compare", "nowhere", "nowhere", "--figure", "e.png"),
        ("info", "nowhere", "--picture", "e.png"),
        ("calibrate", "sensor", "nowhere", "--figure", "e.png"),
        ("accuracy", "three_walls", "-o", "nowhere"),
    ],
)
def test_a_figure_that_cannot_be_drawn_is_told_first(
    tmp_path: Path, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is read or measured, which may take hours."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    done = command(*words)
    assert (done.returncode, "matplotlib is not installed: pip install 'davis_rs[view]'" in done.stderr) == (1, True)


@pytest.mark.parametrize(
    ("library", "words", "message"),
    [
        ("matplotlib", ("view", "nowhere"), r"matplotlib is not installed: pip install 'davis_rs\[view\]'"),
        ("imageio", ("view", "nowhere", "--video", "v.mp4"), r"imageio\S* is not installed: .*'davis_rs\[view\]'"),
        ("rerun", ("view", "nowhere", "--rerun", "r.rrd"), r"rerun is not installed: pip install 'davis_rs\[rerun\]'"),
        ("cv2", ("calibrate", "intrinsics", "nowhere"), r"OpenCV: pip install 'davis_rs\[calibrate\]'"),
        ("cv2", ("generate", "plan.yaml", "-o", "sequences"), r"cv2 is not installed: pip install 'davis_rs\[video\]'"),
    ],
)
def test_a_missing_extra_is_one_line_before_any_work(
    tmp_path: Path, library: str, words: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Even where what is to be read is not there."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "images").mkdir()
    Image.new("RGB", (64, 32)).save(tmp_path / "images" / "wide.png")
    (tmp_path / "plan.yaml").write_text(
        "sequences: 1\nseed: 1\nduration: 0.01\nscene: {kind: random_planes, textures: images, texture_px: 32}\n"
    )
    monkeypatch.setitem(sys.modules, library, None)
    if library == "imageio":
        monkeypatch.setitem(sys.modules, "imageio.v2", None)
    done = command(*words)
    assert done.returncode == 1
    assert re.search(message, done.stderr), done.stderr
    assert "Traceback" not in done.stderr
