"""Whether sequences that were generated are still what they were."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..dataset.files import META
from .folder import CHECKSUMS, damage, folder_sha256
from .job import origin
from .manifest import MANIFEST, describe_folder, read_manifest
from .sequence import DrawnSequence


def verify_sequences(root: str | Path) -> dict[str, str]:
    """Read everything in a folder of generated sequences and compare it with the manifest.

    Returns:
        What is wrong, in words, by the names of sequences; nothing where all is as it was.

    Raises:
        OSError: if there is no manifest.
        ValueError: if it is malformed.
    """
    folder = Path(root)
    if not (folder / MANIFEST).exists():
        raise FileNotFoundError(f"{folder / MANIFEST}: there is no manifest to compare the sequences with")
    lines = read_manifest(folder)
    wrong = {name: fault for name, line in lines.items() if (fault := _fault(folder / name, line)) is not None}
    for path in folder.glob("sequence_*"):
        if path.name not in lines:
            wrong[path.name] = "the manifest does not have it"
    return dict(sorted(wrong.items()))


def taken_up(sequences: list[DrawnSequence], root: Path, say: Callable[[str], None]) -> dict[str, dict[str, Any]]:
    """The lines of those that are there already.

    One that the manifest knows is looked at, one that it does not know (a run was killed in between) is read. Where a
    folder is not what it was, it goes, and will be made again.
    """
    known, lines = read_manifest(root), dict[str, dict[str, Any]]()
    for sequence in sequences:
        folder = root / sequence.name
        if not folder.exists():
            continue
        try:
            generated = json.loads((folder / META).read_text())["generated"]
        except (OSError, ValueError, KeyError, TypeError):
            generated = None
        line = known.get(sequence.name)
        listed = line is not None and (folder / CHECKSUMS).is_file() and folder_sha256(folder) == line.get("sha256")
        fault = damage(folder, contents=not listed)
        if fault is None and generated != origin(sequence):
            fault = f"its {META} tells of other parameters"
        if fault is None:
            lines[sequence.name] = describe_folder(folder)
            continue
        if not (folder / CHECKSUMS).is_file() and line is None:
            raise FileExistsError(f"{folder} is in the way: no sequence of {root} that is whole ({fault})")
        say(f"{sequence.name} is made again: {fault}")
        shutil.rmtree(folder)
    return lines


def _fault(folder: Path, line: dict[str, Any]) -> str | None:
    if not folder.is_dir():
        return "it is missing"
    fault = damage(folder)
    if fault is not None:
        return fault
    if folder_sha256(folder) != line.get("sha256"):
        return f"{CHECKSUMS} is not what it was"
    return None if describe_folder(folder) == line else "its line in the manifest is not what it was"
