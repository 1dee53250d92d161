"""A folder of generated sequences is summed up, and names a sequence to look at."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from command_line import davis_rs


def plan_folder(root: Path, lines: list[dict[str, object]], sequences: int) -> Path:
    root.mkdir()
    record = {"davis_rs": "0.3.0", "model": 2, "plan_sha256": "0" * 64, "sequences": sequences}
    (root / "plan.json").write_text(json.dumps(record))
    (root / "manifest.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return root


LINES: list[dict[str, object]] = [
    {"name": "sequence_00000", "events": 1200, "duration_us": 20_000},
    {"name": "sequence_00001", "events": 300, "duration_us": 50_000},
]


def test_info_sums_up_the_sequences_of_a_plan(tmp_path: Path) -> None:
    root = plan_folder(tmp_path / "train", LINES, 3)
    done = davis_rs("info", root)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [
        f"{root}: sequences of a plan",
        "made by     davis_rs 0.3.0, model 2",
        "sequences   2 of 3",
        "time        0.07 s; 0.02 to 0.05 s each",
        "events      1,500; 300 to 1,200 each",
    ]
    done = davis_rs("info", plan_folder(tmp_path / "none", [], 3))
    assert done.stdout.endswith("sequences   0 of 3\n")
    packed = [{**line, "shard": {"name": "shard_00000.h5", "bytes": 9, "sha256": ""}} for line in LINES]
    done = davis_rs("info", plan_folder(tmp_path / "packed", packed, 2))
    assert "sequences   2 of 2, in 1 shards\n" in done.stdout
    done = davis_rs("info", root, "--picture", tmp_path / "rates.png")
    assert (done.returncode, "--picture is that of one sequence" in done.stderr) == (1, True)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (LINES, "has sequences of a plan: look at one of them, such as {root}/sequence_00000"),
        ([{**LINES[0], "shard": {}}], "has sequences of a plan in shards, which are read by h5py or WebDataset"),
        ([], "has sequences of a plan, none of which is complete"),
    ],
)
def test_view_names_a_sequence(tmp_path: Path, lines: list[dict[str, object]], message: str) -> None:
    root = plan_folder(tmp_path / "train", lines, 3)
    for kind in ("-o", "--html", "--video"):
        done = davis_rs("view", root, kind, tmp_path / "out.mp4")
        assert done.returncode == 1
        assert done.stderr == f"davis-rs: error: {root} {message.format(root=root)}\n"


def test_a_manifest_of_something_else_is_refused(tmp_path: Path) -> None:
    root = plan_folder(tmp_path / "train", [{"name": "sequence_00000", "events": 3}], 1)
    done = davis_rs("info", root)
    assert done.returncode == 1
    assert done.stderr == f"davis-rs: error: {root}/manifest.jsonl: sequence_00000 has no number 'duration_us'\n"
