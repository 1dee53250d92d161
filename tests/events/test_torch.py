"""EventDataset: the samples of PyTorch are the windows and representations, in this process and in workers."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import EventWindows, open_writer, simulate_to_folder
from davis_rs.data.windows import event_windows
from davis_rs.events.represent import count_image, event_spike_tensor, last_event_times, time_surface, voxel_grid
from davis_rs.scene.load import load_scene
from event_files import SIZE, many

torch = pytest.importorskip("torch")

from davis_rs.data.torch import EventDataset, collate  # noqa: E402

WHOLE = many(20_000)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("torch") / "e.aedat4"
    with open_writer(path, SIZE) as writer:
        writer.write(WHOLE)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("torch") / "run"
    simulate_to_folder(
        load_scene("three_planes"), path, duration_s=0.06, rays_per_pixel=1, size=(32, 24), frame_rate_hz=50,
        depth_rate_hz=50,
        flow_rate_hz=50, flow_interval_s=0.03, mask_rate_hz=50,
    )  # fmt: skip
    return path


@pytest.mark.parametrize("representation", ["voxel_grid", "count", "time_surface", "est", "last_times"])
def test_grids_are_those_of_the_representations(file: Path, representation: str) -> None:
    """Over the window's own time, float32 (channels, height, width)."""
    dataset = EventDataset(file, duration_us=1000, representation=representation)
    start_us = 3000 + int(WHOLE["t"][0])
    limits: dict[str, Any] = {"start_us": start_us, "stop_us": start_us + 1000}
    events = WHOLE[(WHOLE["t"] >= start_us) & (WHOLE["t"] < start_us + 1000)]
    expected: dict[str, Callable[[], Any]] = {
        "voxel_grid": lambda: voxel_grid(events, SIZE, 5, **limits),
        "count": lambda: count_image(events, SIZE).astype(np.float32),
        "time_surface": lambda: time_surface(events, SIZE, 30_000.0, t_us=limits["stop_us"]),
        "est": lambda: event_spike_tensor(events, SIZE, 9, **limits),
        "last_times": lambda: last_event_times(events, SIZE, **limits),
    }
    sample = dataset[3]
    assert sample["events"].dtype == torch.float32
    np.testing.assert_array_equal(sample["events"].numpy(), expected[representation]())
    assert (sample["start_us"], sample["end_us"], sample["source"]) == (*limits.values(), 0)


def test_raw_events_share_memory_and_are_joined(file: Path) -> None:
    """Without a copy; a batch has them one after the other, with offsets."""
    dataset = EventDataset(file, by="count", count=70, stride=100, representation="raw")
    sample = dataset[2]["events"]
    assert [sample[name].dtype for name in "txyp"] == [torch.int64, torch.int16, torch.int16, torch.uint8]
    for name in "txyp":
        np.testing.assert_array_equal(sample[name].numpy(), WHOLE[name][200:270])
        assert sample[name].stride() == (16 // WHOLE.dtype[name].itemsize,)
    batch = collate([dataset[0], dataset[2]])
    assert batch["events"]["offsets"].tolist() == [0, 70, 140]
    np.testing.assert_array_equal(batch["events"]["t"].numpy(), [*WHOLE["t"][:70], *WHOLE["t"][200:270]])
    assert batch["start_us"].tolist() == WHOLE["t"][[0, 200]].tolist()


def test_several_sources_follow_each_other(file: Path) -> None:
    windows = EventWindows(file, duration_us=2000)
    dataset = EventDataset([windows[:2], windows[2:5]], representation="count")
    assert len(dataset) == 5
    assert [dataset[k]["source"] for k in range(-5, 0)] == [0, 0, 1, 1, 1]
    assert [one["start_us"] for one in (dataset[k] for k in range(5))] == [one.start_us for one in windows[:5]]
    with pytest.raises(IndexError):
        dataset[5]


def test_images_come_as_tensors(folder: Path) -> None:
    """Frames, depth, flow, displacements and masks with their times; windows of one kind make one batch."""
    images = ("frames", "depth", "flow", "displacement", "masks")
    dataset = EventDataset(folder, by="frames", images=images)
    window, sample = dataset.windows[0][1], dataset[1]
    np.testing.assert_array_equal(sample["frames"].numpy(), np.stack(window.frames[:]))
    np.testing.assert_array_equal(sample["depth"].numpy(), np.stack(window.depth_maps[:]))
    np.testing.assert_array_equal(sample["flow"][1].permute(1, 2, 0).numpy(), window.flow_maps[1])
    np.testing.assert_array_equal(sample["occluded"][0].numpy(), window.displacements[0].occluded)
    np.testing.assert_array_equal(sample["masks"][0].numpy(), window.masks[0])
    assert sample["flow_us"].tolist() == [20_000, 40_000]
    batch = collate([dataset[0], dataset[1]])
    assert batch["flow"].shape == (2, 2, 2, 24, 32)
    assert batch["events"].shape == (2, 5, 24, 32)
    uneven = collate([EventDataset(folder, duration_us=5_000, images=["frames"])[k] for k in (0, 1)])
    assert [len(one) for one in uneven["frames"]] == [1, 0]


def test_kinds_of_images_are_declared_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One more kind is known to windows and to samples; what it holds comes as tensors without another word."""
    monkeypatch.setitem(event_windows.IMAGE_KINDS, "labels", event_windows.IMAGE_KINDS["masks"])
    windows = EventWindows(folder, by="frames").with_images("labels")
    sample = EventDataset(folder, by="frames", images=["labels"])[1]
    assert sample["labels"].dtype == torch.int32
    np.testing.assert_array_equal(sample["labels"].numpy(), np.stack(windows[1].masks[:]))
    assert sample["labels_us"].tolist() == windows[1].masks.t_us.tolist()


def test_only_complete_windows(folder: Path) -> None:
    """Those that have one of each image, by time, between frames and by count; all samples then make batches."""
    images = ["frames", "flow"]
    every = EventDataset(folder, duration_us=5_000, images=images)
    whole = EventDataset(folder, duration_us=5_000, images=images, complete=True)
    expected = [k for k in range(len(every)) if len(every[k]["frames_us"]) and len(every[k]["flow_us"])]
    assert 0 < len(expected) < len(every)
    assert [one["start_us"] for one in (whole[k] for k in range(len(whole)))] == [
        every[k]["start_us"] for k in expected
    ]
    assert collate([whole[k] for k in range(len(whole))])["frames"].shape[:2] == (len(expected), 1)
    for options in ({"by": "frames"}, {"by": "count", "count": 50}):
        every = EventDataset(folder, images=images, **options)
        whole = EventDataset(folder, images=images, complete=True, **options)
        full = [k for k in range(len(every)) if len(every[k]["frames_us"]) and len(every[k]["flow_us"])]
        assert [whole[k]["start_us"] for k in range(len(whole))] == [every[k]["start_us"] for k in full]
    later = whole.windows[0][1:]
    assert [one.start_us for one in later] == [one.start_us for one in whole.windows[0]][1:]


def test_a_window_between_frames_has_its_own_displacement_alone(folder: Path) -> None:
    """That of its first frame, not that of the next window; so all complete windows make batches."""
    dataset = EventDataset(folder, by="frames", images=["displacement"], complete=True)
    every = EventDataset(folder, by="frames", images=["displacement"])
    assert 0 < len(dataset) < len(every)  # the last map's interval would end after the path
    samples = [dataset[k] for k in range(len(dataset))]
    assert [one["displacement_us"].tolist() for one in samples] == [[one["start_us"]] for one in samples]
    assert collate(samples)["displacement"].shape == (len(samples), 1, 2, 24, 32)
    assert collate(samples)["occluded"].shape == (len(samples), 1, 24, 32)


def test_windows_that_cannot_be_complete_are_refused(folder: Path, file: Path) -> None:
    with pytest.raises(ValueError, match="leaves out windows without images: name some"):
        EventDataset(folder, duration_us=5_000, complete=True)
    with pytest.raises(ValueError, match="is a file, which has no images"):
        EventDataset(file, duration_us=5_000, images=["frames"], complete=True)
    with pytest.raises(ValueError, match=r"images are frames, .*, got imu"):
        EventWindows(folder, duration_us=5_000).with_images("imu")


def double(sample: dict[str, Any]) -> dict[str, Any]:
    return sample | {"events": 2 * sample["events"]}


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork")
@pytest.mark.parametrize("start", ["fork", pytest.param("spawn", marks=pytest.mark.long)])
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_workers_read_the_same(file: Path, start: str) -> None:
    """With a transform, in batches, whether the file was opened before the fork or not."""
    dataset = EventDataset(file, duration_us=4000, representation="count", transform=double)
    alone = [dataset[k]["events"] for k in range(len(dataset))]
    torch.testing.assert_close(alone[0], 2 * EventDataset(file, duration_us=4000, representation="count")[0]["events"])
    workers = 2 if start == "fork" else 1  # a new process takes seconds to import torch
    loader = torch.utils.data.DataLoader(
        dataset, batch_size=2, num_workers=workers, multiprocessing_context=start, collate_fn=collate
    )
    torch.testing.assert_close(torch.cat([batch["events"] for batch in loader]), torch.stack(alone))


def test_functions_of_windows_are_representations(file: Path) -> None:
    """Such as tonic's transforms."""
    dataset = EventDataset(file, duration_us=1000, representation=lambda window: np.array([len(window.events)]))
    assert dataset[0]["events"].tolist() == [len(dataset.windows[0][0].events)]


def test_a_pickled_data_set_is_small(file: Path) -> None:
    dataset = EventDataset(file, duration_us=1000)
    data = pickle.dumps(dataset)
    assert len(data) < 10_000
    torch.testing.assert_close(pickle.loads(data)[7]["events"], dataset[7]["events"])


def test_what_would_fail_or_be_ignored_is_refused(file: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "e.npy", WHOLE)
    windows = EventWindows(file, duration_us=1000)
    for source, options, rule in (
        (file, {"representation": "grid"}, "must be one of count, est, last_times, time_surface, voxel_grid, raw"),
        (file, {"parameters": {"tau_us": 3}}, "voxel_grid takes no parameter tau_us"),
        (file, {"representation": "raw", "parameters": {"bins": 3}}, "raw takes no parameter bins"),
        (file, {"images": ["frame"]}, "images must be of frames, depth, flow, displacement, masks: got frame"),
        (tmp_path / "e.npy", {}, "does not say the sensor's size"),
        ([], {}, "at least one file or folder"),
    ):
        with pytest.raises(ValueError, match=rule):
            EventDataset(source, duration_us=1000, **options)
    with pytest.raises(ValueError, match="windows already: duration_us would have no effect"):
        EventDataset(windows, duration_us=1000)
    with pytest.raises(ValueError, match="must have the same entries"):
        collate([{"events": torch.zeros(1)}, {"start_us": 1}])


def test_without_torch_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("davis_rs.data.torch")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ImportError, match=r"torch is not installed: pip install 'davis_rs\[torch\]'"):
        __import__("davis_rs.data.torch")
