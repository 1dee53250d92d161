"""Verifies that sequences that were generated are still what they were."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from ..io.dataset.files import META
from .folder import CHECKSUMS, ManifestLine, damage, folder_sha256, set_aside, unlisted_files, withdraw
from .job import origin
from .manifest import MANIFEST, describe_folder, read_manifest, read_plan
from .sequence import DrawnSequence
from .sequence_plan import sequence_name
from .shards import Shards, shard_fault, shard_names, taken_from_shards


def verify_sequences(root: str | Path) -> dict[str, str]:
    """Read everything in a folder of generated sequences and compare it with the manifest, and this with the plan.

    Returns:
        What is wrong, in words, by the names of sequences; nothing where all is there and as it was. Files that
        somebody added to a sequence are not wrong, see ``added_files``.

    Raises:
        OSError: if there is no manifest, or no ``plan.json``.
        ValueError: if one of them is malformed.
    """
    folder = Path(root)
    if not (folder / MANIFEST).exists():
        raise FileNotFoundError(f"{folder / MANIFEST}: there is no manifest to compare the sequences with")
    lines = read_manifest(folder)
    faults = {name: shard_fault(folder, shard) for name, shard in shard_names(lines.values()).items()}
    wrong: dict[str, str] = {}
    for name, line in lines.items():
        fault = faults[line["shard"]["name"]] if "shard" in line else _fault(folder / name, line)
        if fault is not None:
            wrong[name] = fault
    for path in folder.glob("shard_*"):
        if path.name not in faults:
            wrong[path.name] = "the manifest does not have it"
    for path in folder.glob("sequence_*"):
        if path.name not in lines:
            wrong[path.name] = "the manifest does not have it"
    for name in map(sequence_name, range(read_plan(folder)["sequences"])):
        if name not in lines:
            wrong.setdefault(name, "it was never made")
    return dict(sorted(wrong.items()))


def added_files(root: Path) -> dict[str, list[str]]:
    """List the files that were added to sequences after they were made, by the sequence's name in the manifest."""
    folders = (name for name, line in read_manifest(root).items() if "shard" not in line)
    return {name: added for name in folders if (added := unlisted_files(root / name))}


def taken_up(
    sequences: Sequence[DrawnSequence], root: Path, say: Callable[[str], None], shards: Shards | None = None
) -> dict[str, ManifestLine]:
    """Return the lines of sequences that are there already.

    One that the manifest knows is looked at, one that it does not know (a run was killed in between) is read. Where a
    folder is not what it was, it goes, and will be made again; one with files that somebody added gets another name.
    Sequences that are in a shard are taken from the manifest.
    """
    known, lines = read_manifest(root), dict[str, ManifestLine]()
    if shards is not None:
        lines = taken_from_shards(root, shards, [sequence.name for sequence in sequences], known, say)
        known = {name: line.copy() for name, line in known.items()}
        for line in known.values():
            line.pop("shard", None)
    for sequence in sequences:
        folder = root / sequence.name
        if sequence.name in lines or not folder.exists():
            continue
        try:
            generated = json.loads((folder / META).read_text())["generated"]
        except (OSError, ValueError, KeyError, TypeError):
            generated = None
        before = known.get(sequence.name)
        listed = before is not None and (folder / CHECKSUMS).is_file() and folder_sha256(folder) == before.get("sha256")
        fault = damage(folder, contents=not listed)
        if fault is None and generated != origin(sequence):
            fault = f"its {META} tells of other parameters"
        if fault is None:
            lines[sequence.name] = describe_folder(folder)
            continue
        if not (folder / CHECKSUMS).is_file() and (before is None or not folder.is_dir()):
            raise FileExistsError(f"{folder} is in the way: no sequence of {root} that is whole ({fault})")
        if added := unlisted_files(folder):
            aside = set_aside(folder)
            say(
                f"{sequence.name} is made again: {fault}; the old folder is kept as {aside}, "
                f"because {added[0]} was added to it"
            )
        else:
            say(f"{sequence.name} is made again: {fault}")
            withdraw(folder)
    return lines


def _fault(folder: Path, line: ManifestLine) -> str | None:
    if not folder.is_dir():
        return "it is missing"
    fault = damage(folder)
    if fault is not None:
        return fault
    if folder_sha256(folder) != line.get("sha256"):
        return f"{CHECKSUMS} has changed"
    return None if describe_folder(folder) == line else "its line in the manifest has changed"
