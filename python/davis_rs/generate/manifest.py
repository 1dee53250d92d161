"""Records what a folder of generated sequences holds: the plan, and a line for each sequence that is whole."""

from __future__ import annotations

import errno
import json
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypedDict

from .._core import __version__
from ..io.dataset.files import META, PLAN
from ..simulation.model_version import MODEL
from .folder import ManifestLine, folder_sha256, listed_files, sync
from .sequence_plan import SequencePlan


class PlanRecord(TypedDict):
    """Holds what a folder says of its plan. Folders of davis_rs 0.2.0 have no ``model``."""

    davis_rs: str
    model: int
    plan_sha256: str
    sequences: int
    plan: Mapping[str, object]
    files: Mapping[str, str]


MANIFEST, _LOCK = "manifest.jsonl", ".lock"

PERIOD_S = 5.0
"""A run at work writes its manifest so often: each time all of it, which for each sequence would take long in the end.
What a kill keeps from it is in the sequences' folders."""


def describe_folder(folder: Path) -> ManifestLine:
    """Return the manifest's line of a sequence: a function of what is in its folder.

    Raises:
        OSError, ValueError: if ``meta.json`` or the list of checksums cannot be read.
    """
    meta = json.loads((folder / META).read_text())
    return {
        "name": folder.name,
        "parameters": meta["generated"]["parameters"],
        "events": meta["counts"]["events"],
        "duration_us": meta["duration_us"],
        "files": len(listed_files(folder)) + 1,
        "sha256": folder_sha256(folder),
    }


class Manifest:
    """Writes the manifest of a run at work: at the beginning, every ``period_s`` at most, and by :meth:`write`.

    Attributes:
        lines: of the sequences that are whole, by name.
    """

    def __init__(self, root: Path, lines: dict[str, ManifestLine], *, period_s: float = PERIOD_S) -> None:
        self._root, self._period_s = root, period_s
        self.lines = lines
        self.write()

    def add(self, line: ManifestLine) -> None:
        """Have one more line, for the disk if that is due."""
        self.lines[line["name"]] = line
        if time.monotonic() - self._written_s >= self._period_s:
            self.write()

    def write(self) -> None:
        """Bring all lines to the disk."""
        write_manifest(self._root, self.lines.values())
        self._written_s = time.monotonic()


def write_manifest(root: Path, lines: Iterable[ManifestLine]) -> None:
    """Put a manifest in place of the one before, in the order of the sequences' names; at no instant there is half a
    manifest."""
    # The longer name comes later, should there be more than 100,000.
    in_order = sorted(lines, key=lambda line: (len(line["name"]), line["name"]))
    _replace(root / MANIFEST, "".join(json.dumps(line) + "\n" for line in in_order))


def read_manifest(root: Path) -> dict[str, ManifestLine]:
    """Read the lines of a manifest by their sequence's name; none where there is none.

    Raises:
        OSError: if it cannot be read.
        ValueError: if a line is no manifest's, naming it.
    """
    path = root / MANIFEST
    if not path.exists():
        return {}
    lines: dict[str, ManifestLine] = {}
    for number, text in enumerate(path.read_text().splitlines(), 1):
        try:
            line = json.loads(text)
            lines[line["name"]] = line
        except (ValueError, KeyError, TypeError):
            raise ValueError(f"{path}, line {number}: expected a sequence as JSON, found {text[:80]!r}") from None
    return lines


def read_plan(root: Path) -> PlanRecord:
    """Read what a folder of sequences says of its plan, see :func:`write_plan`.

    Raises:
        OSError: if it cannot be read.
        ValueError: if it says of no plan.
    """
    try:
        record: PlanRecord = json.loads((root / PLAN).read_text())
        if not (isinstance(record["sequences"], int) and {"plan_sha256", "davis_rs"} <= record.keys()):
            raise ValueError(f"no number of sequences, or no plan: {sorted(record)}")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{root / PLAN} says of no plan whose sequences are in {root}: {error!r}") from None
    return record


@contextmanager
def claim_root(root: Path, plan: SequencePlan) -> Iterator[None]:
    """Have ``root`` as the folder of a plan, for this process alone until the end.

    Raises:
        FileExistsError: if there is something else, or another process at work.
        ValueError: if it is the folder of another plan, of more sequences, or of another version.
        OSError: if it cannot be made.
    """
    if root.exists() and not root.is_dir():
        raise FileExistsError(errno.EEXIST, "a file is in the way of the folder", str(root))
    if root.is_dir() and not (root / PLAN).exists() and any(path.name != _LOCK for path in root.iterdir()):
        raise FileExistsError(
            errno.EEXIST, f"the folder is not empty, and it holds no sequences of a plan (no {PLAN})", str(root)
        )
    root.mkdir(parents=True, exist_ok=True)
    with (root / _LOCK).open("w") as lock:
        _lock(lock.fileno(), root)
        _refuse_another(root, plan)
        yield


def write_plan(root: Path, plan: SequencePlan) -> None:
    """Say whose folder it is from now on."""
    _replace(root / PLAN, json.dumps(_description(plan), indent=2, sort_keys=True) + "\n")


def _description(plan: SequencePlan) -> PlanRecord:
    return {
        "davis_rs": __version__,
        "model": MODEL,
        "plan_sha256": plan.sha256,
        "sequences": plan.sequences,
        "plan": plan.identity,
        "files": plan.digests,
    }


def _refuse_another(root: Path, plan: SequencePlan) -> None:
    if not (root / PLAN).exists():
        return
    before = read_plan(root)
    digest, count, version = before["plan_sha256"], before["sequences"], before["davis_rs"]
    if digest != plan.sha256:
        different: list[str] = []
        for old, new in ((before.get("plan", {}), plan.identity), (before.get("files", {}), plan.digests)):
            different += (key for key in sorted(old.keys() | new.keys()) if old.get(key) != new.get(key))
        raise ValueError(
            f"{root} holds sequences of another plan than {plan.file} (it differs in {', '.join(different)}): "
            "choose another folder"
        )
    if version != __version__:
        raise ValueError(
            f"{root} holds sequences that davis_rs {version} made, and this is {__version__}: choose another folder"
        )
    if (model := before.get("model", 1)) != MODEL:
        raise ValueError(
            f"{root} holds sequences that were made by model {model}, and today's is {MODEL} (CHANGELOG.md): choose "
            "another folder"
        )
    if count > plan.sequences:
        raise ValueError(f"{root} is the folder of {count} sequences: a plan can grow, but not to {plan.sequences}")


def _lock(descriptor: int, root: Path) -> None:
    """Keep others out as long as the file is open: also after SIGKILL there is nothing to clear away."""
    try:
        import fcntl
    except ImportError:
        return  # Windows has no such lock: two at once cost time, but still no sequence
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise FileExistsError(errno.EEXIST, "another process generates into this folder", str(root)) from None
    except OSError as error:
        # A file system without locks: two at once cost time, but still no sequence.
        if error.errno not in (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP):
            raise


def _replace(path: Path, text: str) -> None:
    unfinished = path.with_name(f".{path.name}.part")
    unfinished.write_text(text)
    sync(unfinished)
    unfinished.replace(path)
    sync(path.parent)
