"""Sums up a folder of generated sequences."""

from __future__ import annotations

from pathlib import Path

from .._util.terminal_text import printable
from ..generate.manifest import MANIFEST, read_manifest, read_plan


def plan_folder_contents(root: str | Path) -> str:
    """Return a few lines on the sequences of a plan: how many are complete, their durations and events.

    Raises:
        OSError: if plan or manifest cannot be read.
        ValueError: if one of them is none.
    """
    plan, lines = read_plan(Path(root)), read_manifest(Path(root)).values()
    numbers: dict[str, list[int]] = {"duration_us": [], "events": []}
    for line in lines:
        for key, values in numbers.items():
            value = dict(line).get(key)
            if not isinstance(value, int):
                raise ValueError(f"{Path(root) / MANIFEST}: {line['name']} has no number {key!r}")
            values.append(value)
    shards = {str(line["shard"]) for line in lines if "shard" in line}
    made = f"davis_rs {plan['davis_rs']}, model {plan.get('model', 1)}"
    packed = f", in {len(shards)} shards" if shards else ""
    told = [
        f"{root}: sequences of a plan",
        f"made by     {made}",
        f"sequences   {len(lines)} of {plan['sequences']}{packed}",
    ]
    if lines:
        seconds, events = [1e-6 * t_us for t_us in numbers["duration_us"]], numbers["events"]
        told += [
            f"time        {sum(seconds):.6g} s; {min(seconds):.6g} to {max(seconds):.6g} s each",
            f"events      {sum(events):,}; {min(events):,} to {max(events):,} each",
        ]
    return "\n".join(map(printable, told))


def instead_of_plan_folder(root: str | Path) -> ValueError:
    """Return the error for a folder of sequences where one sequence is wanted; it names one.

    Raises:
        OSError, ValueError: if the manifest cannot be read.
    """
    lines = read_manifest(Path(root)).values()
    for line in lines:
        if "shard" not in line:
            return ValueError(
                f"{root} has sequences of a plan: look at one of them, such as {Path(root) / line['name']}"
            )
    if lines:
        return ValueError(f"{root} has sequences of a plan in shards, which are read by h5py or WebDataset")
    return ValueError(f"{root} has sequences of a plan, none of which is complete")
