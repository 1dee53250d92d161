"""Generates all sequences of a plan into a folder."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, overload

from .._util.argument_error import ArgumentError
from .._util.budget import readable_bytes
from .._util.memory_forecast import MemoryForecast
from .._util.platforms import usable_cores
from .._util.progress import each, progress
from .._util.progress import say as say_above
from ..scene.scene import Scene
from ..simulation.noise_estimate import NoiseError
from .folder import ManifestLine, discard_hidden
from .job import begin_worker, make_sequence, noise_of, warn_of_looks
from .manifest import Manifest, claim_root, describe_folder, read_manifest, write_plan
from .sequence import DrawnSequence, SceneKey
from .sequence_plan import SequencePlan, sequence_name
from .shards import Packing
from .verify import taken_up

if TYPE_CHECKING:
    from distributed import Client

    from .local import Outcome

MOST_WORKERS = 1024
"""More processes than a machine has cores."""

_NAMED = 10
"""Of sequences without events that are told of by name."""

CHECKED_FIRST = 200
"""The most sequences that are checked before the first one is made. One process does it, and a hand-held path takes
0.1 s."""


@dataclass(frozen=True)
class Generated:
    """Says what :func:`generate_sequences` did.

    Attributes:
        root: the folder.
        sequences: how many of the plan's are in it, whole.
        made: how many of them are new.
        failed: what went wrong, by the names of the sequences that are not.
    """

    root: Path
    sequences: int
    made: int
    failed: dict[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        failed = f", {len(self.failed)} failed" if self.failed else ""
        return f"{self.root}: {self.sequences} sequences, {self.made} of them new{failed}"


def generate_sequences(
    plan: SequencePlan,
    root: str | Path,
    *,
    workers: int | None = None,
    cluster: str | Path | Client | None = None,
    quiet: bool = False,
    report: Callable[[str], None] | None = None,
) -> Generated:
    """Make the sequences of a plan that ``root`` does not hold yet.

    Each is a folder ``sequence_00000`` and so on, in the layout of :class:`~davis_rs.DatasetWriter`, with
    ``sha256sums.txt``; ``manifest.jsonl`` has a line for each. A folder with such a name is whole. However often a run
    or one of its workers is killed, and with however many workers, what is there in the end is the same, byte by byte.

    Where the plan asks for ``shards``, the folders of a shard's sequences become one file (``shard_00000.h5`` or
    ``.tar``) once all of them are whole, and are then removed; the manifest's lines name it, with its SHA-256.

    Args:
        plan: see :func:`load_sequence_plan`.
        root: made if it does not exist. One of the same plan, perhaps with fewer sequences, is continued.
        workers: processes of this machine, which share its cores; None for one a core. There are fewer where they would
            take more memory than is available.
        cluster: a Dask cluster in their place: the address of its scheduler, a scheduler file or a client. Its workers
            must see ``root`` and the plan's files under the same paths, and have the same versions of everything.
        quiet: no progress bar, and no line that says how many events of the first new sequence will be Monte Carlo
            noise where Mitsuba's integrators render it.
        report: is told of workers that died, of folders that are made again, and of new sequences without events;
            standard error if not given.

    Raises:
        NoiseError: if too many events of the first new sequence would be Monte Carlo noise, and the plan does not
            accept that.
        ValueError: if one of the first 200 sequences that are to be made breaks a rule that can be seen beforehand (a
            later one is among those that failed), ``root`` holds sequences of another plan, or ``workers`` is not in
            1..:data:`MOST_WORKERS`.
        OSError: if ``root`` cannot be written, or is at work already.
        KeyboardInterrupt: after Ctrl-C, once workers have stopped; whole sequences stay.

    A program that calls it without a cluster must be importable (``if __name__ == "__main__":``), as with every spawned
    process.
    """
    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise ArgumentError("{workers} must lie in 1..{}, got {}", MOST_WORKERS, workers)
    say = report or (lambda text: say_above(f"davis-rs: warning: {text}"))
    folder = Path(root).absolute()
    sequences = draw_sequences(plan)
    names = [sequence_name(k) for k in range(plan.sequences)]
    with claim_root(folder, plan):
        there = {name for name, line in read_manifest(folder).items() if "shard" in line}
        absent = (k for k, name in enumerate(names) if name not in there and not (folder / name).is_dir())
        new = DrawnSequences(plan, [*islice(absent, CHECKED_FIRST)])
        memory = check_sequences(plan, new, quiet=quiet)
        if cluster is None and new:
            workers = _fitting_workers(workers, plan.sequences, memory, say)
        if new and not (quiet and plan.accept_noise):
            _look_at_noise(new[0], quiet=quiet)
        write_plan(folder, plan)
        discard_hidden(folder)
        manifest = Manifest(folder, taken_up(sequences, folder, say, plan.shards))
        lines = manifest.lines
        kept, failed = set(lines), dict[str, str]()
        missing = DrawnSequences(plan, [k for k, name in enumerate(names) if name not in lines])
        if missing:
            warn_of_looks(missing[0])
        packing = None if plan.shards is None else Packing(folder, plan.shards, names)
        if packing is not None and plan.shards is not None:
            for k in range(0, plan.sequences, plan.shards.sequences):
                packing.offer(k, lines)
        outcomes = _outcomes(missing, folder, workers, cluster, say)
        try:
            with progress("simulating", len(sequences), unit="sequences", start=len(kept), show=not quiet) as bar:
                for outcome in outcomes:
                    if outcome.result is not None:
                        manifest.add(outcome.result)
                        if packing is not None:
                            packing.offer(outcome.task.index, lines)
                            packing.take(lines, manifest.write)
                    else:
                        failed[outcome.task.name] = str(outcome.error)
                    bar.advance()
            if packing is not None:
                packing.take(lines, manifest.write, wait=True)
        finally:
            outcomes.close()
            if packing is not None:
                packing.close()
            discard_hidden(folder)
            # Some may have got their names without a word: Ctrl-C, or a worker's death, came in between.
            unsaid = [name for name in names if name not in lines and (folder / name).is_dir()]
            lines |= {name: describe_folder(folder / name) for name in unsaid}
            manifest.write()
    failed = {name: error for name, error in failed.items() if name not in lines}
    if silent := [name for name in names if name in lines and name not in kept and not lines[name]["events"]]:
        more = f" and {len(silent) - _NAMED} more" if len(silent) > _NAMED else ""
        say(f"0 events in {', '.join(silent[:_NAMED])}{more}")
    return Generated(Path(root), len(lines), len(lines) - len(kept), failed)


class DrawnSequences(Sequence[DrawnSequence]):
    """Draws each sequence of a plan when it is asked for: a plan of a million takes no more memory than one of ten.

    Args:
        plan: what they are drawn from.
        indices: which of them; all if not given.
    """

    def __init__(self, plan: SequencePlan, indices: Sequence[int] | None = None) -> None:
        self._plan = plan
        self._indices = range(plan.sequences) if indices is None else indices
        self._base, self._digest = plan.file.absolute().parent, plan.sha256

    def __len__(self) -> int:
        return len(self._indices)

    @overload
    def __getitem__(self, index: int) -> DrawnSequence: ...
    @overload
    def __getitem__(self, index: slice) -> DrawnSequences: ...
    def __getitem__(self, index: int | slice) -> DrawnSequence | DrawnSequences:
        if isinstance(index, slice):
            return DrawnSequences(self._plan, self._indices[index])
        index = self._indices[index]
        parameters = self._plan.parameters(index)
        name = sequence_name(index)
        return DrawnSequence(name, index, parameters, self._base, self._digest, self._plan.accept_noise)


def draw_sequences(plan: SequencePlan) -> DrawnSequences:
    """Return all sequences of a plan."""
    return DrawnSequences(plan)


def check_sequences(
    plan: SequencePlan, sequences: Sequence[DrawnSequence], *, quiet: bool = True
) -> MemoryForecast | None:
    """Refuse a plan of which a sequence cannot be made, as far as that can be told without rendering.

    Returns:
        What the largest of the sequences is forecast to take; None if there are none.

    Raises:
        ValueError: naming plan, sequence, keys, values and rule.
    """

    @cache
    def scene_at(key: SceneKey) -> Scene:
        return key.load()

    def scene_of(drawn: DrawnSequence) -> Scene:
        return drawn.scene() if drawn.scene_key is None else scene_at(drawn.scene_key)

    try:
        checked = each(sequences, "checking", len(sequences), unit="sequences", show=not quiet)
        forecasts = [sequence.check(scene_of) for sequence in checked]
    except ValueError as error:
        raise ValueError(f"{plan.file}: {error}") from None
    return max(forecasts, key=lambda forecast: forecast.bytes, default=None)


def _fitting_workers(
    workers: int | None, sequences: int, memory: MemoryForecast | None, say: Callable[[str], None]
) -> int:
    """Return how many processes work at a time; says so where memory allows fewer than there would be."""
    wanted = min(workers or usable_cores(), sequences)
    if memory is None:
        return wanted
    fitting = memory.workers(wanted)
    if fitting < wanted:
        say(
            f"{fitting} of {wanted} processes at a time: a sequence of {memory.width} x {memory.height} pixels will "
            f"take about {readable_bytes(memory.bytes)} of memory"
        )
    return fitting


def _look_at_noise(sequence: DrawnSequence, *, quiet: bool) -> None:
    """Say how many events of a sequence will be Monte Carlo noise; refuse more than its plan accepts."""
    try:
        noise = noise_of(sequence)
    except NoiseError:
        raise
    except (ValueError, OSError):
        return  # it is this sequence alone that cannot be made: whoever makes it says why
    if noise is not None and noise.noisy and not quiet:
        say_above(f"{sequence}: {noise}")


def _outcomes(
    missing: Sequence[DrawnSequence],
    root: Path,
    workers: int | None,
    cluster: str | Path | Client | None,
    say: Callable[[str], None],
) -> Generator[Outcome[DrawnSequence, ManifestLine], None, None]:
    if not missing:
        return
    if cluster is not None:
        from .cluster import connect, run_on_cluster

        client = connect(cluster)
        try:
            yield from run_on_cluster(partial(_make_on_cluster, root), missing, client)
        finally:
            if client is not cluster:
                client.close()
        return
    from .local import run_locally

    cores = usable_cores()
    workers = min(workers or cores, len(missing))
    threads = max(1, cores // workers)
    yield from run_locally(
        partial(_make, root, threads), missing, workers=workers, begin=partial(begin_worker, threads), report=say
    )


def _make(root: Path, threads: int, sequence: DrawnSequence) -> ManifestLine:
    return make_sequence(sequence, root, threads)


def _make_on_cluster(root: Path, sequence: DrawnSequence, threads: int) -> ManifestLine:
    begin_worker(threads)
    return make_sequence(sequence, root, threads)
