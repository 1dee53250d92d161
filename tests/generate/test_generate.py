"""Generating sequences: whole, the same whatever happens on the way, and checked."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

import davis_rs
from davis_rs.cli.main import main
from davis_rs.generate import Generated, generate_sequences, load_sequence_plan, verify_sequences
from davis_rs.generate.folder import CHECKSUMS
from davis_rs.simulation.model_version import MODEL
from generated import files_of, write_plan

PATIENCE_S = 120.0


@contextmanager
def running(plan: Path, root: Path, workers: int) -> Iterator[subprocess.Popen[str]]:
    """The command, in a process group of its own."""
    command = [sys.executable, "-m", "davis_rs.cli", "generate", str(plan), "-o", str(root), "--workers", str(workers)]
    with subprocess.Popen(
        [*command, "--quiet"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def workers_of(pid: int) -> list[psutil.Process]:
    return [child for child in psutil.Process(pid).children() if "spawn_main" in " ".join(child.cmdline())]


def whole(root: Path) -> int:
    return len(list(root.glob("sequence_*")))


def at_work(root: Path) -> bool:
    return any(root.glob(".sequence_*.part/events.txt"))


def wait_until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six sequences that one worker made, and their plan."""
    folder = tmp_path_factory.mktemp("undisturbed")
    made = generate_sequences(load_sequence_plan(write_plan(folder, sequences=6)), folder / "root", workers=1)
    assert (made.sequences, made.made, made.failed) == (6, 6, {})
    return folder / "root"


@contextmanager
def killing(root: Path, most: int) -> Iterator[None]:
    """Kill workers of this process half-way, at most so many at once."""

    def kill() -> None:
        wait_until(lambda: whole(root) >= 2 and at_work(root))
        for worker in workers_of(os.getpid())[:most]:
            worker.kill()

    killer = threading.Thread(target=kill)
    killer.start()
    yield
    killer.join()


@pytest.mark.long
def test_a_killed_worker_costs_nothing(undisturbed: Path, tmp_path: Path, long: bool) -> None:
    """SIGKILL half-way, two workers for one: every file of every folder and the manifest are the same bytes."""
    root, told = tmp_path / "root", list[str]()
    plan = load_sequence_plan(write_plan(tmp_path, sequences=6))
    with killing(root, most=2 if long else 1):
        made = generate_sequences(plan, root, workers=2, quiet=True, report=told.append)
    assert (made.sequences, made.made, made.failed) == (6, 6, {})
    assert "its worker was killed by SIGKILL; it is tried again" in told[0]
    files = files_of(root)
    assert len(files) > 6 * 8
    assert files == files_of(undisturbed)
    assert verify_sequences(root) == {}


@pytest.mark.long
@pytest.mark.parametrize("what", ["all", "parent"])
def test_a_killed_run_is_gone_on_with(undisturbed: Path, tmp_path: Path, what: str, long: bool) -> None:
    """SIGKILL of all processes, or of the one that the user sees: its workers end by themselves. What has its name by
    then is whole, and is not made again."""
    root, plan = tmp_path / "root", write_plan(tmp_path, sequences=5)
    with running(plan, root, 2 if long else 1) as process:
        wait_until(lambda: whole(root) >= 2 and at_work(root))
        workers = workers_of(process.pid)
        assert workers
        if what == "all":
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
        process.wait()
    psutil.wait_procs(workers, timeout=PATIENCE_S)
    assert not any(worker.is_running() for worker in workers)
    reference = files_of(undisturbed)
    there = {name: data for name, data in files_of(root).items() if name.startswith("sequence_")}
    finished = {name.partition("/")[0] for name in there}
    assert 2 <= len(finished) < 5
    assert there == {name: data for name, data in reference.items() if name.partition("/")[0] in finished}

    made_at = {name: (root / name).stat().st_mtime_ns for name in finished}
    generated = generate_sequences(load_sequence_plan(plan), root, workers=1, quiet=True)
    assert (generated.sequences, generated.made, generated.failed) == (5, 5 - len(finished), {})
    assert {name: (root / name).stat().st_mtime_ns for name in finished} == made_at
    files = files_of(root)
    assert not any(name.startswith(".") for name in files)
    assert files.pop("manifest.jsonl") == b"".join(reference["manifest.jsonl"].splitlines(keepends=True)[:5])
    assert json.loads(files.pop("plan.json"))["sequences"] == 5
    assert files == {name: data for name, data in reference.items() if name[:14] in set(json_names(root))}


def json_names(root: Path) -> list[str]:
    return [json.loads(line)["name"] for line in (root / "manifest.jsonl").read_text().splitlines()]


@pytest.mark.long
def test_ctrl_c_ends_cleanly(tmp_path: Path) -> None:
    """Exit status 130, no worker left, what is whole stays in the manifest and the rest leaves nothing."""
    root = tmp_path / "root"
    with running(write_plan(tmp_path), root, 2) as process:
        wait_until(lambda: whole(root) >= 2 and at_work(root))
        workers = workers_of(process.pid)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of them
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert not any(worker.is_running() for worker in workers)
    assert 2 <= len(json_names(root)) == whole(root) < 20
    assert not [path.name for path in root.iterdir() if path.name.startswith(".") and path.name != ".lock"]


def test_a_failure_is_told_and_the_others_go_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What only the simulator can refuse: an exposure longer than the frames' period. The manifest lacks it, and so
    does the folder. Those that were made without events are named."""
    exposure, threshold = {"choice": [100, 50_000]}, {"choice": [0.3, 15.0]}
    plan = write_plan(tmp_path, sequences=4, effects={"aps": {"exposure_us": exposure}}, contrast_threshold=threshold)
    parameters = [load_sequence_plan(plan).parameters(index) for index in range(4)]
    bad = [f"sequence_{k:05d}" for k, one in enumerate(parameters) if one["effects"]["aps"]["exposure_us"] > 10_000]
    assert 0 < len(bad) < 4
    assert main(["generate", str(plan), "-o", str(tmp_path / "root"), "--workers", "1", "--quiet"]) == 1
    told = capsys.readouterr()
    for name in bad:
        assert f"{name}: the exposure of 50000 us must not exceed the frames' period of 10000 us" in told.err
    assert f"{4 - len(bad)} sequences, {4 - len(bad)} of them new, {len(bad)} failed" in told.out
    silent = [f"sequence_{k:05d}" for k, one in enumerate(parameters) if one["contrast_threshold"] > 10]
    silent = [name for name in silent if name not in bad]
    assert 0 < len(silent) < 4 - len(bad)
    assert f"davis-rs: warning: 0 events in {', '.join(silent)}\n" in told.err
    assert not set(bad) & {*json_names(tmp_path / "root"), *(path.name for path in (tmp_path / "root").iterdir())}


@pytest.mark.long
def test_what_is_not_checked_first_fails_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Checking all of many would keep every worker waiting: of later ones the workers find out, and make the others."""
    plan = load_sequence_plan(write_plan(tmp_path, seed=25, sequences=4, accuracy={"choice": ["fast", "no"]}))
    bad = [index for index in range(4) if plan.parameters(index)["accuracy"] == "no"]
    assert 0 < bad[0] < bad[-1]
    with pytest.raises(ValueError, match=rf"sequence_0000{bad[0]}: accuracy = 'no': accuracy must be one of"):
        generate_sequences(plan, tmp_path / "root", workers=1, quiet=True)
    monkeypatch.setattr("davis_rs.generate.generate.CHECKED_FIRST", bad[0])
    generated = generate_sequences(plan, tmp_path / "root", workers=1, quiet=True)
    assert generated.failed.keys() == {f"sequence_0000{index}" for index in bad}
    assert all("accuracy must be one of" in error for error in generated.failed.values())
    assert generated.made == 4 - len(bad)


@pytest.mark.long
def test_moving_scenes_are_the_same_with_any_workers(tmp_path: Path) -> None:
    """Sequences of the public dataset, with a person that walks through one of them: also those are bytes of the plan
    alone, whoever made what before."""
    path = write_plan(
        tmp_path,
        scene={"choice": ["dynamic_6dof", "slider_depth"]},
        seed=0,
        sequences=2,
        motion=None,
        duration={"uniform": [0.01, 0.02]},
        frame_rate=50,
        depth_rate=0,
        max_displacement=4,
    )
    plan = load_sequence_plan(path)
    assert len({plan.parameters(index)["scene"] for index in range(2)}) == 2
    for workers in (1, 2):
        made = generate_sequences(plan, tmp_path / f"root{workers}", workers=workers, quiet=True)
        assert (made.made, made.failed) == (2, {})
    assert files_of(tmp_path / "root1") == files_of(tmp_path / "root2")


@pytest.fixture
def root(undisturbed: Path, tmp_path: Path) -> Path:
    """A copy of three of the sequences, which a test may spoil, and a plan of these three."""
    write_plan(tmp_path, sequences=3)
    copy = tmp_path / "root"
    copy.mkdir()
    for name in ("sequence_00000", "sequence_00001", "sequence_00002"):
        shutil.copytree(undisturbed / name, copy / name)
    lines = (undisturbed / "manifest.jsonl").read_text().splitlines(keepends=True)[:3]
    (copy / "manifest.jsonl").write_text("".join(lines))
    record = json.loads((undisturbed / "plan.json").read_text())
    (copy / "plan.json").write_text(json.dumps(record | {"sequences": 3}, indent=2, sort_keys=True) + "\n")
    return copy


def go_on(root: Path, told: list[str], **changes: object) -> Generated:
    plan = load_sequence_plan(write_plan(root.parent, **({"sequences": 3} | changes)))
    return generate_sequences(plan, root, workers=1, quiet=True, report=told.append)


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.long
def test_what_is_there_is_kept(root: Path) -> None:
    """With the manifest's word for it, or, where a run was killed before it wrote that, after reading it."""
    before = files_of(root)
    assert go_on(root, []).made == 0
    assert files_of(root) == before
    (root / "manifest.jsonl").unlink()
    assert go_on(root, []).made == 0
    assert files_of(root) == before


@pytest.mark.long
@pytest.mark.parametrize(
    "names", [["events.txt", "images/frame_00000001.png", "meta.json"], [CHECKSUMS]], ids=["files", "checksums"]
)
def test_a_flipped_bit_is_found_and_made_again(
    root: Path, names: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """By verify whatever the manifest says, and by the next run, which reads what the manifest does not vouch for."""
    before = files_of(root)
    assert main(["verify", str(root)]) == 0
    assert "all files are unchanged" in capsys.readouterr().out
    for index, name in enumerate(names):
        flip(root / f"sequence_0000{index}" / name)
    assert main(["verify", str(root)]) == 1
    out = capsys.readouterr().out
    for index, name in enumerate(names):
        fault = "" if name == CHECKSUMS else f"{name} has changed"
        assert f"sequence_0000{index}: {fault}" in out
    assert f"{len(names)} sequences have changed" in out
    (root / "manifest.jsonl").unlink()
    told: list[str] = []
    assert go_on(root, told).made == len(names)
    assert [line.partition(":")[0] for line in told] == [f"sequence_0000{k} is made again" for k in range(len(names))]
    assert files_of(root) == before


def test_files_that_are_gone_or_strange_are_found(root: Path) -> None:
    """In a folder, whole folders, and lines of the manifest."""
    (root / "sequence_00000" / "calib.txt").unlink()
    shutil.copytree(root / "sequence_00002", root / "sequence_00003")
    lines = (root / "manifest.jsonl").read_text().splitlines(keepends=True)
    (root / "manifest.jsonl").write_text("".join([*lines[:2], lines[2].replace('"events": ', '"events": 1')]))
    assert verify_sequences(root) == {
        "sequence_00000": "calib.txt is missing",
        "sequence_00002": "its line in the manifest has changed",
        "sequence_00003": "the manifest does not have it",
    }
    shutil.rmtree(root / "sequence_00002")
    assert verify_sequences(root)["sequence_00002"] == "it is missing"
    plan = (root / "plan.json").read_text()
    (root / "plan.json").write_text("{}")
    with pytest.raises(ValueError, match=r"plan.json says of no plan"):
        verify_sequences(root)
    (root / "plan.json").write_text(plan)
    (root / "manifest.jsonl").write_text(lines[0] + "{}\n")
    with pytest.raises(ValueError, match=r"manifest.jsonl, line 2: expected a sequence as JSON, found '\{\}'"):
        verify_sequences(root)
    with pytest.raises(FileNotFoundError, match="there is no manifest"):
        verify_sequences(root / "sequence_00000")


def test_what_was_never_made_is_told(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A root whose sequences failed, or whose manifest lost lines, is not what its plan says."""
    shutil.rmtree(root / "sequence_00001")
    lines = (root / "manifest.jsonl").read_text().splitlines(keepends=True)
    (root / "manifest.jsonl").write_text(lines[0])
    assert main(["verify", str(root)]) == 1
    out = capsys.readouterr().out
    assert "sequence_00001: it was never made" in out
    assert "sequence_00002: the manifest does not have it" in out
    assert "2 sequences have changed" in out


@pytest.mark.parametrize("option", [["-o", "x"], ["--workers", "2"], ["--cluster", "x"], ["--dry-run"]], ids=str)
def test_verify_takes_no_options_of_making(root: Path, option: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Who gives them expects something that would not happen."""
    with pytest.raises(SystemExit) as refused:
        main(["verify", str(root), *option])
    assert refused.value.code == 2
    assert f"unrecognized arguments: {' '.join(option)}" in capsys.readouterr().err


@pytest.mark.long
def test_files_of_others_are_kept(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In a folder that is as it was they are no fault; one that is damaged keeps all, under another name."""
    before = files_of(root)
    added = root / "sequence_00001" / "labels.txt"
    added.write_text("car")
    assert main(["verify", str(root)]) == 0
    out = capsys.readouterr().out
    assert "sequence_00001: there are other files than those that it was made with: labels.txt" in out
    assert "all files are unchanged" in out
    for unknown in (False, True):
        if unknown:
            (root / "manifest.jsonl").unlink()
        assert go_on(root, []).made == 0
        assert files_of(root) == before | {"sequence_00001/labels.txt": b"car"}

    (root / "sequence_00001" / "events.txt").unlink()
    told: list[str] = []
    assert go_on(root, told).made == 1
    aside = root / "damaged_sequence_00001_0"
    assert told == [
        "sequence_00001 is made again: events.txt is missing; "
        f"the old folder is kept as {aside}, because labels.txt was added to it"
    ]
    kept = {f"{aside.name}/{name}": data for name, data in files_of(aside).items()}
    assert kept[f"{aside.name}/labels.txt"] == b"car"
    assert files_of(root) == before | kept
    assert verify_sequences(root) == {}


def test_another_plan_is_refused(root: Path) -> None:
    """Two plans' sequences under the same names would be one data set that nobody asked for; a plan may only grow."""
    before = files_of(root)
    with pytest.raises(ValueError, match=r"another plan than .*plan.yaml \(it differs in rays_per_pixel, seed\)"):
        go_on(root, [], seed=12, rays_per_pixel=2)
    with pytest.raises(ValueError, match="is the folder of 3 sequences: a plan can grow, but not to 2"):
        go_on(root, [], sequences=2)
    record = json.loads((root / "plan.json").read_text())
    (root / "plan.json").write_text(json.dumps(record | {"davis_rs": "0.0.1"}))
    with pytest.raises(ValueError, match=r"that davis_rs 0.0.1 made, and this is"):
        go_on(root, [])
    (root / "plan.json").write_text(json.dumps({key: value for key, value in record.items() if key != "model"}))
    with pytest.raises(ValueError, match=f"that were made by model 1, and today's is {MODEL}"):
        go_on(root, [])
    (root / "plan.json").write_bytes(before["plan.json"])
    assert files_of(root) == before


@pytest.mark.long
def test_a_plan_may_grow(root: Path, undisturbed: Path) -> None:
    """What is there is what the larger plan would have made."""
    assert go_on(root, [], sequences=5).made == 2
    reference = files_of(undisturbed)
    files = files_of(root)
    assert {name for name in files if name.startswith("sequence_00004/")}
    assert all(data == reference[name] for name, data in files.items() if name.startswith("sequence_"))


def test_a_folder_of_something_else_is_left_alone(root: Path, tmp_path: Path) -> None:
    """Nothing is written into it, and nothing in it is removed."""
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.tex").write_text("years of work")
    with pytest.raises(FileExistsError, match=r"holds no sequences of a plan \(no plan.json\)"):
        go_on(other, [])
    assert files_of(other) == {"thesis.tex": b"years of work"}
    with pytest.raises(FileExistsError, match="a file is in the way"):
        go_on(other / "thesis.tex", [])
    shutil.rmtree(root / "sequence_00001")
    (root / "sequence_00001").mkdir()
    (root / "sequence_00001" / "thesis.tex").write_text("years of work")
    (root / "manifest.jsonl").unlink()
    with pytest.raises(FileExistsError, match="sequence_00001 is in the way"):
        go_on(root, [])
    assert (root / "sequence_00001" / "thesis.tex").exists()


@pytest.mark.long
def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    """The second would remove what the first is at; after a kill the lock is free again by itself."""
    root, plan = tmp_path / "root", write_plan(tmp_path)
    with running(plan, root, 1) as process:
        wait_until(lambda: at_work(root))
        with pytest.raises(FileExistsError, match="another process generates into this folder"):
            generate_sequences(load_sequence_plan(plan), root, quiet=True)
        assert process.poll() is None
        assert at_work(root) or whole(root)


def test_no_folder_tells_where_or_when_it_was_made(undisturbed: Path) -> None:
    """No absolute path, no time, no command: what is in it is a function of the plan and of versions."""
    meta = json.loads((undisturbed / "sequence_00000" / "meta.json").read_text())
    assert meta["scene"]["file"] == "scenes/board.xml"
    assert meta["generated"]["index"] == 0
    assert meta["parameters"]["seed"] == meta["generated"]["parameters"]["seed"]
    for name, data in files_of(undisturbed).items():
        if name.endswith((".json", ".jsonl", ".yaml", ".txt")):
            assert str(undisturbed.parent).encode() not in data, name
    assert {"command", "threads", "wall_s"}.isdisjoint(meta)
    for name in ("sequence_00000", "sequence_00005"):
        done = subprocess.run(["sha256sum", "--check", "--quiet", CHECKSUMS], cwd=undisturbed / name, check=False)
        assert done.returncode == 0


def test_a_sequence_is_what_its_parameters_say(undisturbed: Path) -> None:
    """Drawn values arrive at simulator, path, effects, IMU and files."""
    for line in (undisturbed / "manifest.jsonl").read_text().splitlines():
        entry = json.loads(line)
        drawn, dataset = entry["parameters"], davis_rs.Dataset(undisturbed / entry["name"])
        meta = json.loads((undisturbed / entry["name"] / "meta.json").read_text())
        assert meta["parameters"]["contrast_threshold"] == drawn["contrast_threshold"]
        assert meta["trajectory"]["start_s"] == drawn["start"]
        assert meta["duration_us"] == entry["duration_us"] == round(drawn["duration"] * 1e6)
        assert meta["effects"].keys() == {name for name, value in drawn["effects"].items() if value}
        assert (meta["imu"] is None) == (drawn["imu"] is None) == (not (dataset.path / "imu.txt").exists())
        assert (dataset.path / "depthmaps.txt").exists() == (drawn["depth_rate"] > 0)
        assert meta["camera"]["fx"] == davis_rs.load_camera(drawn["camera"]).fx
        assert entry["events"] == len(dataset.events) > 0
