"""Plans for training: scenes that are drawn, start poses, and shards."""

from __future__ import annotations

import io
import json
import re
import tarfile
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import yaml
from PIL import Image

from davis_rs import Dataset, LostLookWarning, Pose, Simulator, load_scene
from davis_rs.cli.main import main
from davis_rs.generate import generate_sequences, load_sequence_plan, verify_sequences
from davis_rs.generate.generate import draw_sequences
from davis_rs.generate.job import make_sequence
from davis_rs.generate.local import Outcome
from davis_rs.generate.random_scene import make_random_scene
from davis_rs.geometry.trajectory.trajectory import SegmentTrajectory
from davis_rs.render import scene_cache
from davis_rs.scene.builtin.random_planes import random_textured_planes
from generated import files_of

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.fixture(autouse=True, scope="module")
def in_this_process() -> Iterator[None]:
    """Sequences are made here: what workers are and survive is tested elsewhere, and each takes a second to start."""

    def run_here(function: Any, tasks: Any, **_: Any) -> Iterator[Outcome[Any, Any]]:
        return (Outcome(task, function(task)) for task in tasks)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("davis_rs.generate.local.run_locally", run_here)
        patch.setattr(scene_cache, "_cache", None)
        yield


PLAN: dict[str, Any] = {
    "seed": 5,
    "sequences": 3,
    "scene": {"kind": "random_planes", "textures": "images", "planes": {"integers": [1, 3]}, "tilt_deg": 30},
    "duration": 0.05,
    "size": "64x48",
    "camera": "calib.txt",
    "accuracy": "fast",
    "flow_rate": 40,
    "flow_interval": 0.02,
    "mask_rate": 40,
    "imu": "ideal",
    "event_truth": "npz",
    "contrast_threshold": {"uniform": [0.15, 0.3]},
    "contrast_threshold_off": {"uniform": [0.15, 0.3]},
}


def write_images(folder: Path, count: int = 4) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(1)
    for k in range(count):
        grey = np.kron(random.integers(0, 256, (6, 8, 3)), np.ones((5, 5, 1)))
        Image.fromarray(grey.astype(np.uint8)).save(folder / f"{k}.png")
    return folder


def write_plan(folder: Path, **changes: Any) -> Path:
    write_images(folder / "images")
    (folder / "calib.txt").write_text("50 50 31.5 23.5 0 0 0 0 0\n")
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump(PLAN | changes, sort_keys=False))
    return path


def test_random_planes_are_a_function_of_their_seed(tmp_path: Path) -> None:
    """Of seed and object's number alone: another plane more changes none of those before; every object moves as its
    path says, no faster than it may, and the background fills the view."""
    images = write_images(tmp_path / "images")
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "tetrahedron.obj").write_text(TETRAHEDRON)
    scene = random_textured_planes(images, seed=3, planes=2, meshes=tmp_path / "meshes", duration_s=0.2)
    assert list(scene.objects) == ["plane_1", "plane_2", "mesh_1"]
    t = np.linspace(0, 0.2, 41)
    for more in (random_textured_planes(images, seed=3, planes=5, duration_s=0.2),):
        for name in ("plane_1", "plane_2"):
            assert np.array_equal(more.objects[name].positions(t), scene.objects[name].positions(t))
    other = random_textured_planes(images, seed=4, planes=2, duration_s=0.2)
    assert not np.array_equal(other.objects["plane_1"].positions(t), scene.objects["plane_1"].positions(t))
    first, second = (scene.objects[name].velocities(t) for name in ("plane_1", "plane_2"))
    assert not np.isclose(first, second).any()
    still = random_textured_planes(images, seed=3, planes=2, duration_s=0.2, top_speed_m_s=0, top_rate_rad_s=0)
    for name, path in still.objects.items():  # at half of the time all are where they were drawn
        assert np.allclose(path.positions([0.1]), scene.objects[name].positions([0.1]), atol=1e-12)
        assert np.allclose(path.quaternions([0.1]), scene.objects[name].quaternions([0.1]), atol=1e-12)
    for path in scene.objects.values():
        assert np.linalg.norm(path.velocities(t), axis=1).max() <= 2.0
        assert np.linalg.norm(path.angular_rates(t), axis=1).max() <= 2.0
        between = np.diff(path.positions(t), axis=0) / np.diff(t)[:, None]
        assert np.allclose(between, (path.velocities(t)[1:] + path.velocities(t)[:-1]) / 2, atol=1e-9)
        q, dt = path.quaternions(t), t[1] - t[0]
        assert np.allclose(2 * np.arccos(np.abs((q[1:] * q[:-1]).sum(1)).clip(0, 1)) / dt,
                           np.linalg.norm(path.angular_rates(t[:-1] + dt / 2), axis=1), atol=1e-3)  # fmt: skip
    packet = list(Simulator(scene, mask_rate_hz=10, flow_rate_hz=10, accuracy="fast").run())[-1]
    assert packet.shapes is not None
    assert packet.flow is not None
    assert packet.shapes.min() == 1  # something is seen everywhere
    assert len(np.unique(packet.shapes)) >= 3
    assert np.isfinite(packet.flow).all()


def test_random_planes_without_a_folder_have_built_in_textures(tmp_path: Path) -> None:
    """The same for the same seed, each with contrast, and in a plan too."""
    t = np.linspace(0, 0.1, 5)
    scene, again = (random_textured_planes(seed=3, planes=3, duration_s=0.1, texture_px=128) for _ in range(2))
    assert scene.note == again.note
    assert scene.note.count("built-in texture ") == 4
    textured = random_textured_planes(write_images(tmp_path / "images"), seed=3, planes=3, duration_s=0.1)
    assert np.array_equal(scene.objects["plane_2"].positions(t), textured.objects["plane_2"].positions(t))
    first, second = (next(iter(Simulator(one.crop(0, 0.01), size=(48, 36)).run())) for one in (scene, again))
    assert first.luma is not None
    assert second.luma is not None
    assert np.array_equal(first.luma, second.luma)
    assert first.luma.std() > 0.05
    assert len({random_textured_planes(seed=seed, planes=0).note for seed in range(30)}) > 15
    plan = load_sequence_plan(write_plan(tmp_path, scene={"kind": "random_planes", "planes": 2}))
    drawn = make_random_scene(plan.parameters(0)["scene"], 0.1, tmp_path)
    assert "built-in texture" in drawn.note
    for named in ("random_planes", {"choice": ["random_planes"]}):  # the kind alone
        plan = load_sequence_plan(write_plan(tmp_path, scene=named))
        assert plan.parameters(0)["scene"].keys() == {"kind", "seed"}


def test_images_stand_upright_and_unmirrored(tmp_path: Path) -> None:
    """The background shows its image as it is in the file: bright at the top left."""
    folder = tmp_path / "images"
    folder.mkdir()
    pixels = np.full((32, 32, 3), 60, np.uint8)
    pixels[:16, :16] = 250
    Image.fromarray(pixels).save(folder / "corner.png")
    scene = random_textured_planes(folder, planes=0, camera_speed_m_s=0, camera_rate_rad_s=0)
    [first, *_] = Simulator(scene.crop(0, 0.01)).run()
    assert first.luma is not None
    bright = first.luma > 0.5
    rows, columns = np.nonzero(bright)
    height, width = first.luma.shape
    assert bright[height // 2 - 10, width // 2 - 10]
    assert not bright[height // 2 + 10, width // 2 - 10]
    assert not bright[height // 2 - 10, width // 2 + 10]
    assert rows.max() < height / 2 + 3
    # Next to the image lies its mirror image, so that no seam is seen.
    pose, camera = scene.path.pose(0), scene.own_camera
    aside = Pose(pose.position + pose.rotation[:, 0] * 4.0 * camera.width / camera.fx, pose.quaternion)
    [mirrored, *_] = Simulator(scene.with_trajectory(SegmentTrajectory(aside, aside, 0.01))).run()
    assert mirrored.luma is not None
    assert np.allclose(mirrored.luma, first.luma[:, ::-1], atol=1e-3)
    assert columns.max() < width / 2 + 3
    assert np.isclose(first.luma[bright].max(), ((250 / 255 + 0.055) / 1.055) ** 2.4, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("none.txt", b"", r"images: there are no images in it \(.png, "),
        ("broken.png", b"not an image", r"broken.png: not an image that can be read as a texture"),
        ("small.png", None, r"small.png: an image must have at least 16 pixels each way, this has 8 x 40"),
    ],
)
def test_a_folder_that_cannot_be_used_is_told(tmp_path: Path, name: str, data: bytes | None, message: str) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    if data is None:
        Image.new("RGB", (8, 40)).save(folder / name)
    else:
        (folder / name).write_bytes(data)
    with pytest.raises(ValueError, match=message):
        random_textured_planes(folder)
    with pytest.raises(NotADirectoryError, match="nowhere is no folder"):
        random_textured_planes(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"nearest_m": 3.0}, "0 < nearest_m < farthest_m < background_m, got 3.0, 3.0 and 4.0"),
        ({"smallest": 0.0}, "0 < smallest <= largest, got 0.0"),
        ({"mesh_objects": 2}, "mesh_objects is 2, but no folder of meshes is given"),
        ({"planes": -1}, "planes must lie in 0..1000, got -1"),
        ({"duration_s": 0.0}, "duration_s must be finite and > 0"),
        ({"top_speed_m_s": float("nan")}, "must be finite and >= 0"),
    ],
)
def test_numbers_out_of_range_are_refused(tmp_path: Path, given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        random_textured_planes(write_images(tmp_path / "images"), **given)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": {"kind": "planes"}}, "scene.kind: must be one of random_planes, got 'planes'"),
        ({"scene": {"textures": "images"}}, "scene: must be a name or a file, a mapping with the scene's kind"),
        ({"shards": 3}, "shards: must be a mapping with format and sequences, got 3"),
        ({"shards": {"format": "zip", "sequences": 2}}, "shards.format: must be one of hdf5, webdataset, got 'zip'"),
        ({"shards": {"format": "hdf5"}}, "shards.sequences: must be an integer in 1..100000, got None"),
        ({"start_pose": {"place": 1}}, "start_pose.place: there is no such key; there are time, position_m"),
        ({"start_pose": {"position_m": [0, 1]}}, "position_m: must be a list of three numbers"),
    ],
)
def test_faults_of_a_plan_are_named(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        load_sequence_plan(write_plan(tmp_path, **changes))


def test_another_image_makes_another_plan(tmp_path: Path) -> None:
    before = load_sequence_plan(write_plan(tmp_path)).sha256
    (tmp_path / "images" / "notes.txt").write_text("not drawn from")
    assert load_sequence_plan(tmp_path / "plan.yaml").sha256 == before
    (tmp_path / "images" / "3.png").rename(tmp_path / "images" / "4.png")
    assert load_sequence_plan(tmp_path / "plan.yaml").sha256 != before


@pytest.mark.long
def test_a_path_starts_where_it_is_drawn(tmp_path: Path) -> None:
    """Moved in the camera's own axes, from the scene's own path at a time; a sequence's path keeps its shape."""
    offset = {"position_m": [0.1, 0, {"uniform": [0.2, 0.3]}], "rotation_deg": [0, 0, 90]}
    own = load_scene("three_walls").path
    for motion in (None, {"kind": "slider", "distance_m": 1, "speed_m_s": 1}):
        pose = offset if motion is None else {**offset, "time": {"uniform": [0.5, 1.5]}}
        plan = write_plan(
            tmp_path, scene="three_walls", motion=motion, start_pose=pose, start=0.2 if motion is None else 0.0
        )
        for one in draw_sequences(load_sequence_plan(plan)):
            drawn = one.parameters["start_pose"]
            start = own.pose(0.2 if motion is None else drawn["time"])
            path = one.on_path(one.scene()).path
            assert 0.2 <= drawn["position_m"][2] <= 0.3
            at = start.position + start.rotation @ np.array(drawn["position_m"])
            assert np.allclose(path.pose(0).position, at, atol=1e-12)
            turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
            assert np.allclose(path.pose(0).rotation, start.rotation @ turn, atol=1e-9)
            if motion is None:
                for t in (0.02, 0.05):  # the same path, seen from its start
                    moved, kept = path.pose(t), own.pose(0.2 + t)
                    assert np.allclose(path.pose(0).rotation.T @ (moved.position - path.pose(0).position),
                                       start.rotation.T @ (kept.position - start.position), atol=1e-9)  # fmt: skip
    plan = write_plan(tmp_path, scene="three_walls", start_pose={"time": 0.5})
    assert main(["generate", str(plan), "--dry-run", "--quiet"]) != 0


def groups_of(folder: Path) -> dict[str, dict[str, Any]]:
    """What a shard must hold of a sequence, by the public reader."""
    dataset = Dataset(folder)
    with np.load(folder / "event_truth.npz") as archive:
        truth = {name: archive[name] for name in archive.files}
    return {
        "events": {name: dataset.events[name] for name in "txyp"},
        "frames": {"maps": np.stack([dataset.read_image(k) for k in range(len(dataset.frames))])},
        "depth": {"maps": np.stack([dataset.read_depth(k) for k in range(len(dataset.depth_maps))])},
        "flow": {
            "t": [image.t_us for image in dataset.flow_maps],
            "maps": np.stack([dataset.read_flow(k) for k in range(len(dataset.flow_maps))]),
        },
        "masks": {"maps": np.stack([dataset.read_mask(k) for k in range(len(dataset.masks))])},
        "displacement": {"occluded": np.stack([dataset.read_displacement(k).occluded for k in range(2)])},
        "poses": {"position": dataset.groundtruth.positions, "quaternion": dataset.groundtruth.quaternions},
        "imu": {"accel": dataset.imu["accel"]},
        "event_truth": {name: truth[name] for name in ("t", "depth", "flow_x", "shape")},
    }


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three sequences as folders."""
    folder = tmp_path_factory.mktemp("folders")
    assert generate_sequences(load_sequence_plan(write_plan(folder)), folder / "root", workers=1, quiet=True).made == 3
    return folder / "root"


@pytest.mark.long
@pytest.mark.parametrize("kind", ["hdf5", "webdataset"])
def test_shards_hold_what_the_folders_do(folders: Path, tmp_path: Path, kind: str) -> None:
    """All of it, as other people's readers see it; verify reads them, the next run keeps them, and one that was damaged
    or grows is made again."""
    root, shards = tmp_path / "root", {"format": kind, "sequences": 2}
    plan = load_sequence_plan(write_plan(tmp_path, shards=shards))
    root.mkdir()
    assert generate_sequences(plan, root, workers=1, quiet=True).made == 3
    suffix = {"hdf5": ".h5", "webdataset": ".tar"}[kind]
    files = files_of(root)
    assert set(files) == {"manifest.jsonl", "plan.json", f"shard_00000{suffix}", f"shard_00001{suffix}"}
    assert verify_sequences(root) == {}
    for number in range(3):
        name, path = f"sequence_0000{number}", root / f"shard_0000{number // 2}{suffix}"
        for group, columns in groups_of(folders / name).items():
            for column, values in columns.items():
                found = read_hdf5(path, name, group, column) if kind == "hdf5" else read_tar(path, name, group, column)
                np.testing.assert_array_equal(found, values, err_msg=f"{group}/{column}")
    if kind == "hdf5":
        with h5py.File(root / "shard_00000.h5") as file:
            one = file["sequence_00001"]
            t, starts = one["events/t"][()], one["ms_to_idx"][()]
            assert bytes(one["files/calib.txt"][()]) == (folders / "sequence_00001" / "calib.txt").read_bytes()
            assert json.loads(one["meta"][()])["counts"]["events"] == len(t)
            assert all((t[:k] < 1000 * ms).all() and (t[k:] >= 1000 * ms).all() for ms, k in enumerate(starts))
    else:
        with tarfile.open(root / "shard_00000.tar") as archive:
            keys = [name.partition(".")[0] for name in archive.getnames()]
        assert keys == sorted(keys)  # WebDataset takes files of one key that follow each other
        assert set(keys) == {"sequence_00000", "sequence_00001"}

    assert generate_sequences(plan, root, workers=1, quiet=True).made == 0
    assert files_of(root) == files
    data = bytearray(files[f"shard_00001{suffix}"])
    data[len(data) // 2] ^= 1
    (root / f"shard_00001{suffix}").write_bytes(data)
    assert verify_sequences(root) == {"sequence_00002": f"shard_00001{suffix} has changed"}
    (root / f"shard_00001{suffix}").write_bytes(data[:-1])
    (root / f".shard_00000{suffix}.{'0' * 32}.part").write_bytes(b"of a run that was killed")
    told: list[str] = []
    assert generate_sequences(plan, root, workers=1, quiet=True, report=told.append).made == 1
    assert told == [f"shard_00001{suffix} is made again: shard_00001{suffix} has changed"]
    assert files_of(root) == files


def read_hdf5(path: Path, name: str, group: str, column: str) -> Any:
    with h5py.File(path) as file:
        return file[f"{name}/{group}/{column}"][()]


def read_tar(path: Path, name: str, group: str, column: str) -> Any:
    with tarfile.open(path) as archive:
        member = archive.extractfile(f"{name}.{group}.npz")
        assert member is not None
        with np.load(io.BytesIO(member.read())) as arrays:
            return arrays[column]


def test_a_kill_between_the_steps_of_packing_costs_nothing(tmp_path: Path) -> None:
    """A shard that the manifest does not have yet is packed again, from folders that are there; folders of one that it
    has are removed."""
    plan = load_sequence_plan(write_plan(tmp_path, shards={"format": "webdataset", "sequences": 2}, sequences=2))
    root, kept = tmp_path / "root", tmp_path / "kept"
    kept.mkdir()
    lines = [make_sequence(one, kept, 1) for one in draw_sequences(plan)]
    generate_sequences(plan, root, workers=1, quiet=True)
    files = files_of(root)
    for manifest in (files["manifest.jsonl"], "".join(json.dumps(line) + "\n" for line in lines).encode()):
        for folder in kept.iterdir():
            for name, data in files_of(folder).items():
                (root / folder.name / name).parent.mkdir(parents=True, exist_ok=True)
                (root / folder.name / name).write_bytes(data)
        (root / "manifest.jsonl").write_bytes(manifest)
        assert generate_sequences(plan, root, workers=1, quiet=True).made == 0
        assert files_of(root) == files


@pytest.mark.long
def test_a_scene_that_is_kept_gives_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker keeps what it made of a scene: later sequences are those of a worker that keeps nothing."""
    scenes = {"choice": ["three_planes", "three_walls"]}
    changes = {"scene": scenes, "start": {"uniform": [0, 1]}, "duration": 0.02, "sequences": 4}
    plan = load_sequence_plan(write_plan(tmp_path, **changes, flow_interval=None))
    assert len({plan.parameters(k)["scene"] for k in range(4)}) == 2
    for name, keeps in (("kept", True), ("fresh", False)):
        monkeypatch.setattr(scene_cache, "_cache", OrderedDict() if keeps else None)
        (tmp_path / name).mkdir()
        for one in draw_sequences(plan):
            make_sequence(one, tmp_path / name, 1)
        assert not keeps or 0 < len(scene_cache._cache or ()) <= 6  # of two scenes, for all sequences
    assert files_of(tmp_path / "kept") == files_of(tmp_path / "fresh")


@pytest.mark.long
def test_looks_that_are_lost_are_told_once(tmp_path: Path) -> None:
    """Of the first sequence before all; each sequence's meta.json has its own share."""
    (tmp_path / "lamp.mtl").write_text("newmtl lamp\nKd 1 1 1\nPm 1\n")
    (tmp_path / "lamp.obj").write_text("mtllib lamp.mtl\nusemtl lamp\n" + TETRAHEDRON)
    plan = {"seed": 1, "sequences": 2, "scene": "lamp.obj", "duration": 0.01, "size": "64x48", "accuracy": "fast"}
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump(plan | {"start": {"uniform": [0, 5]}}))
    with pytest.warns(LostLookWarning, match=r"metal of lamp \([\d.]+ %\)$") as caught:
        generate_sequences(load_sequence_plan(tmp_path / "plan.yaml"), tmp_path / "root", workers=1, quiet=True)
    assert len(caught) == 1
    for folder in ("sequence_00000", "sequence_00001"):
        described = json.loads((tmp_path / "root" / folder / "meta.json").read_text())
        assert 0.02 < described["lost_looks"]["metal of lamp"] < 0.4
