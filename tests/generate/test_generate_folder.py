"""A sequence's folder: what happens where two make the same one, or one is taken away from its maker."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from davis_rs.generate.folder import (
    CHECKSUMS,
    ManifestLine,
    damage,
    discard,
    discard_hidden,
    publish,
    set_aside,
    unlisted_files,
    working_folder,
)
from davis_rs.generate.manifest import MANIFEST, Manifest, read_manifest


def made(root: Path, text: str = "same") -> Path:
    folder = working_folder(root, "sequence_00007")
    (folder / "images").mkdir(parents=True)
    (folder / "images" / "a.png").write_text(text)
    (folder / "events.txt").write_text(text)
    return folder


def test_of_two_that_make_the_same_the_first_stays(tmp_path: Path) -> None:
    """As where a cluster gives up a worker that is alive: no error, and nothing of the second is left."""
    final = tmp_path / "sequence_00007"
    first, second = made(tmp_path), made(tmp_path)
    assert first != second
    publish(first, final)
    inode = final.stat().st_ino
    publish(second, final)
    assert final.stat().st_ino == inode
    assert [path.name for path in tmp_path.iterdir()] == ["sequence_00007"]
    assert damage(final) is None
    assert (final / CHECKSUMS).read_text().split()[1::2] == ["events.txt", "images/a.png"]


def test_what_was_taken_away_cannot_be_published(tmp_path: Path) -> None:
    """A maker that was given up and goes on must not give a name to what is left of its folder."""
    folder = made(tmp_path)
    discard(folder)
    assert not list(tmp_path.iterdir())
    folder.mkdir()  # as if it wrote on
    discard_hidden(tmp_path)
    with pytest.raises(FileNotFoundError):
        publish(folder, tmp_path / "sequence_00007")
    assert not list(tmp_path.iterdir())
    discard(folder)  # once more does no harm


def test_only_what_is_ours_is_cleared_away(tmp_path: Path) -> None:
    """Hidden names of another form are somebody else's."""
    others = [".sequence_00007", ".sequence_00007.part", ".git", ".sequence_00007.0123.part", "sequence_00007.part"]
    for name in others:
        (tmp_path / name).mkdir()
    made(tmp_path)
    (tmp_path / f".sequence_00008.{'0' * 32}.gone").mkdir()
    discard_hidden(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(others)


def test_added_files_are_no_damage(tmp_path: Path) -> None:
    """They belong to who added them: links and files in folders of their own too."""
    final = tmp_path / "sequence_00007"
    publish(made(tmp_path), final)
    assert unlisted_files(final) == []
    (final / "mine").mkdir()
    (final / "mine" / "labels.txt").write_text("car")
    (final / "elsewhere").symlink_to(tmp_path)
    assert damage(final) is None
    assert unlisted_files(final) == ["elsewhere", "mine/labels.txt"]
    (final / CHECKSUMS).unlink()
    assert unlisted_files(final) == ["elsewhere", "events.txt", "images/a.png", "mine/labels.txt"]


def test_each_folder_set_aside_has_a_name_of_its_own(tmp_path: Path) -> None:
    """The second time that a sequence is damaged does not cost what was kept the first time."""
    final = tmp_path / "sequence_00007"
    for number in range(2):
        publish(made(tmp_path, str(number)), final)
        assert set_aside(final) == tmp_path / f"damaged_sequence_00007_{number}"
    assert (tmp_path / "damaged_sequence_00007_0" / "events.txt").read_text() == "0"
    assert not final.exists()


KILLED_AT = """
import os, signal, sys
from pathlib import Path
from davis_rs.generate.folder import withdraw

def count(event, arguments):
    global left
    if event in ("os.rename", "os.remove", "os.rmdir"):
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        left -= 1

for line in sys.stdin:
    left = int(line)
    child = os.fork()
    if child == 0:
        sys.addaudithook(count)
        withdraw(Path(sys.argv[1]))
        os._exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""
"""A process that removes a folder again and again, each time in a child that dies at the step that it reads."""


def test_a_kill_leaves_all_of_a_folder_or_nothing(tmp_path: Path) -> None:
    """Before each of the steps that remove one: never a part of it under its name, which would stop every later run."""
    final, step, status = tmp_path / "sequence_00007", 0, -signal.SIGKILL
    command = [sys.executable, "-c", KILLED_AT, str(final)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        while status == -signal.SIGKILL:
            if not final.exists():
                publish(made(tmp_path), final)
            process.stdin.write(f"{step}\n")
            status = int(process.stdout.readline())
            assert damage(final) is None if final.exists() else step > 0
            discard_hidden(tmp_path)
            assert {path.name for path in tmp_path.iterdir()} <= {final.name}
            step += 1
    assert status == 0
    assert step > 5  # two names, two files and two folders
    assert not final.exists()


def test_a_manifest_is_not_written_for_every_line(tmp_path: Path) -> None:
    """All of it each time: for many sequences that would take longer than making them. It is whole at the end."""
    lines: list[ManifestLine] = [
        {"name": f"sequence_{number:05d}", "parameters": {}, "events": 0, "duration_us": 0, "files": 0, "sha256": ""}
        for number in range(3)
    ]
    for period_s, known in ((3600.0, 1), (0.0, 3)):
        manifest = Manifest(tmp_path, {lines[0]["name"]: lines[0]}, period_s=period_s)
        for line in lines[1:]:
            manifest.add(line)
        assert len(read_manifest(tmp_path)) == known
        manifest.write()
        assert list(read_manifest(tmp_path).values()) == lines
        (tmp_path / MANIFEST).unlink()
