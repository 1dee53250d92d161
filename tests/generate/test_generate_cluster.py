"""The same plan on a cluster of Dask: the same bytes, whatever dies."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from davis_rs.cli.main import main
from davis_rs.generate import generate_sequences, load_sequence_plan, verify_sequences
from generated import files_of, write_plan

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two worker processes of this machine."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        pids = [nanny.pid for nanny in cluster.workers.values()]
        yield cluster
    assert not any(psutil.pid_exists(pid) for pid in pids)


@contextmanager
def killing(cluster: Any, root: Path, *, workers: int) -> Iterator[None]:
    """Kill ``workers`` of the workers once one is at a sequence."""

    def kill() -> None:
        while not any(root.glob(".sequence_*.part/events.txt")):
            time.sleep(0.002)
        for nanny in list(cluster.workers.values())[:workers]:
            psutil.Process(nanny.pid).kill()

    killer = threading.Thread(target=kill)
    killer.start()
    yield
    killer.join()


@pytest.mark.long
def test_a_cluster_makes_the_same_bytes(cluster: Any, tmp_path: Path) -> None:
    """By its address, with a worker killed half-way; and a failure is told as on one machine."""
    exposure = {"choice": [100, 50_000], "weights": [3, 1]}
    path = write_plan(tmp_path, sequences=8, effects={"aps": {"exposure_us": exposure}}, frame_rate=100)
    plan = load_sequence_plan(path)
    alone = generate_sequences(plan, tmp_path / "alone", workers=1, quiet=True)
    assert 0 < len(alone.failed) < 8

    with distributed.Client(cluster) as client, killing(cluster, tmp_path / "root", workers=1):
        generated = generate_sequences(plan, tmp_path / "root", cluster=client, quiet=True)
    assert generated.failed == alone.failed
    assert files_of(tmp_path / "root") == files_of(tmp_path / "alone")


@pytest.mark.long
def test_the_command_line_takes_an_address_or_a_scheduler_file(
    cluster: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The two ways in which a scheduler makes itself known."""
    plan = write_plan(tmp_path, sequences=2)
    file = tmp_path / "scheduler.json"
    file.write_text(json.dumps({"address": cluster.scheduler_address}))  # what a client reads of it
    for number, where in enumerate((cluster.scheduler_address, file)):
        root = tmp_path / f"root{number}"
        assert main(["generate", str(plan), "-o", str(root), "--cluster", str(where), "--quiet"]) == 0
        assert "2 sequences, 2 of them new" in capsys.readouterr().out
    assert files_of(tmp_path / "root0") == files_of(tmp_path / "root1")


@pytest.mark.long
def test_what_the_scheduler_gives_up_is_told_and_made_by_the_next_run(cluster: Any, tmp_path: Path) -> None:
    """A scheduler that allows no failure: sequences of workers that die fail, by its words, and the others are made."""
    plan = load_sequence_plan(write_plan(tmp_path, sequences=6))
    root, allowed = tmp_path / "root", cluster.scheduler.allowed_failures
    cluster.scheduler.allowed_failures = 0
    try:
        with distributed.Client(cluster) as client, killing(cluster, root, workers=2):
            generated = generate_sequences(plan, root, cluster=client, quiet=True)
    finally:
        cluster.scheduler.allowed_failures = allowed
    assert generated.failed
    assert all(error.startswith("KilledWorker: ") for error in generated.failed.values())
    assert generated.sequences == 6 - len(generated.failed)
    again = generate_sequences(plan, root, workers=1, quiet=True)
    assert (again.made, again.failed) == (len(generated.failed), {})
    assert verify_sequences(root) == {}
