"""A sequence's folder: what happens where two make the same one, or one is taken away from its maker."""

from __future__ import annotations

from pathlib import Path

import pytest

from davis_rs.generate.folder import CHECKSUMS, damage, discard, discard_hidden, publish, working_folder


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
