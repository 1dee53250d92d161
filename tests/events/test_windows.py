"""EventWindows: windows of files and folders are slices of the whole, with what a folder has of the same stretch."""

from __future__ import annotations

import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from davis_rs import Dataset, EventWindows, open_writer, simulate_to_folder
from davis_rs.events.arrays import EVENT_DTYPE
from davis_rs.scene.load import load_scene
from event_files import SIZE, assert_same, many

WHOLE = many(20_000, start_us=1_000)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("windows") / "e.npy"
    with open_writer(path, SIZE) as writer:
        writer.write(WHOLE)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with frames, depth, flow, masks, poses and inertial samples at rates that do not agree."""
    path = tmp_path_factory.mktemp("windows") / "run"
    simulate_to_folder(
        load_scene("three_planes"), path, duration_s=0.1, rays_per_pixel=1, size=(32, 24), imu="mpu6150",
        frame_rate_hz=40, depth_rate_hz=20, flow_rate_hz=40, flow_interval_s=0.01, mask_rate_hz=20,
    )  # fmt: skip
    return path


@settings(max_examples=60, deadline=None)
@given(
    duration=st.integers(1, 30_000),
    stride=st.none() | st.integers(1, 30_000),
    limits=st.tuples(st.none() | st.integers(0, 9_000), st.none() | st.integers(9_000, 40_000)),
)
def test_windows_by_time(file: Path, duration: int, stride: int | None, limits: tuple[int | None, int | None]) -> None:
    """All that fit, from the first event on, each with the events of its stretch."""
    start_us, stop_us = limits
    windows = EventWindows(file, duration_us=duration, stride_us=stride, start_us=start_us, stop_us=stop_us)
    first = int(WHOLE["t"][0]) if start_us is None else start_us
    end = int(WHOLE["t"][-1]) + 1 if stop_us is None else stop_us
    starts = range(first, end - duration + 1, stride or duration)
    assert len(windows) == len(starts)
    for index in {0, len(starts) // 2, len(starts) - 1} if starts else ():
        window = windows[index]
        assert (window.start_us, window.end_us) == (starts[index], starts[index] + duration)
        inside = (WHOLE["t"] >= window.start_us) & (WHOLE["t"] < window.end_us)
        assert_same(window.events, WHOLE[inside])


@settings(max_examples=60, deadline=None)
@given(count=st.integers(1, 21_000), stride=st.none() | st.integers(1, 5_000), start_us=st.none() | st.just(9_000))
def test_windows_by_count(file: Path, count: int, stride: int | None, start_us: int | None) -> None:
    whole = WHOLE if start_us is None else WHOLE[WHOLE["t"] >= start_us]
    windows = EventWindows(file, "count", count=count, stride=stride, start_us=start_us)
    starts = range(0, len(whole) - count + 1, stride or count)
    assert len(windows) == len(starts)
    for index in {0, len(starts) // 2, len(starts) - 1} if starts else ():
        window, events = windows[index], whole[starts[index] : starts[index] + count]
        assert_same(window.events, events)
        assert (window.start_us, window.end_us) == (events["t"][0], events["t"][-1] + 1)


def test_indices_slices_and_pickles(file: Path) -> None:
    """As a list's; a slice has the same windows."""
    windows = EventWindows(file, duration_us=1000)
    assert windows[-1].start_us == windows[len(windows) - 1].start_us
    part = windows[3:10:2]
    assert [one.start_us for one in part] == [windows[k].start_us for k in (3, 5, 7, 9)]
    assert part[1:][0].start_us == windows[5].start_us
    assert_same(pickle.loads(pickle.dumps(part))[1].events, windows[5].events)
    with pytest.raises(IndexError, match="4 windows: there is none 4"):
        part[4]


def test_what_a_folder_has_comes_with_a_window(folder: Path) -> None:
    """By time: what lies in [start, end). Images are those that the folder's own reader gives."""
    whole = Dataset(folder)
    windows = EventWindows(folder, duration_us=30_000)
    assert (len(windows), windows.size) == (3, (32, 24))
    window = windows[1]
    assert (window.start_us, window.end_us) == (30_000, 60_000)
    inside = (whole.events["t"] >= 30_000) & (whole.events["t"] < 60_000)
    assert_same(window.events, whole.events[inside])
    assert window.frames.t_us.tolist() == window.flow_maps.t_us.tolist() == [50_000]
    assert window.depth_maps.t_us.tolist() == window.masks.t_us.tolist() == [50_000]
    np.testing.assert_array_equal(window.frames[0], whole.read_image(2))
    np.testing.assert_array_equal(window.flow_maps[-1], whole.read_flow(2))
    np.testing.assert_array_equal(window.depth_maps[:][0], whole.read_depth(1))
    np.testing.assert_array_equal(window.masks[0], whole.read_mask(1))
    np.testing.assert_array_equal(window.displacements[0].pixels, whole.read_displacement(2).pixels)
    with pytest.raises(IndexError):
        window.frames[1]
    imu = whole.imu
    np.testing.assert_array_equal(window.imu, imu[(imu["t"] >= 30_000) & (imu["t"] < 60_000)])
    assert len(window.imu)
    assert window.start_pose is not None
    assert window.end_pose is not None
    at = int(np.flatnonzero(whole.groundtruth.t_us == 30_000)[0])
    np.testing.assert_array_equal(window.start_pose.position, whole.groundtruth.positions[at])


def test_poses_between_samples_are_interpolated(folder: Path) -> None:
    """Positions along lines; none outside of the ground truth."""
    truth = Dataset(folder).groundtruth
    window = EventWindows(folder, duration_us=1_000, start_us=1_250)[0]
    assert window.start_pose is not None
    np.testing.assert_allclose(window.start_pose.position, 0.75 * truth.positions[0] + 0.25 * truth.positions[1])
    after = EventWindows(folder, duration_us=1_000, start_us=99_500, stop_us=200_000)[0]
    assert after.start_pose is not None
    assert after.end_pose is None


def test_windows_between_frames_have_both(folder: Path) -> None:
    whole = Dataset(folder)
    windows = EventWindows(folder, "frames")
    stamps = [frame.t_us for frame in whole.frames]
    assert [(one.start_us, one.end_us) for one in windows] == list(pairwise(stamps))
    assert windows[0].frames.t_us.tolist() == stamps[:2]
    assert sum(len(one.events) for one in windows) == (whole.events["t"] < stamps[-1]).sum()
    assert len(EventWindows(folder, "frames", start_us=20_000, stop_us=80_000)) == 2


def test_options_that_do_not_belong_together_are_refused(file: Path, tmp_path: Path) -> None:
    for options, rule in (
        ({"by": "size"}, "by must be one of time, count, frames: got 'size'"),
        ({"by": 3}, "by must be one of time, count, frames: got 3"),
        ({"by": "tme"}, "by must be one of time, count, frames: got 'tme'; did you mean time?"),
        ({}, "duration_us must be a positive integer of microseconds: got None"),
        ({"duration_us": 0}, "duration_us must be a positive integer of microseconds: got 0"),
        ({"duration_us": 0.02}, "duration_us must be a positive integer of microseconds: got 0.02"),
        ({"duration_us": float("inf")}, "must be a positive integer of microseconds: got inf"),
        ({"duration_us": 5, "stride": 3}, "windows by time take no stride"),
        ({"by": "count", "count": 5, "stride": -1}, "stride must be a positive integer: got -1"),
        ({"by": "frames"}, "need a dataset folder"),
    ):
        with pytest.raises(ValueError, match=rule):
            EventWindows(file, **options)
    np.save(tmp_path / "none.npy", np.zeros(0, EVENT_DTYPE))
    assert len(EventWindows(tmp_path / "none.npy", duration_us=1_000)) == 0


def test_a_map_that_is_not_there_is_named(folder: Path) -> None:
    whole = Dataset(folder)
    with pytest.raises(IndexError, match=rf"has {len(whole.frames)} frames: there is none 99"):
        whole.read_image(99)
    with pytest.raises(NotADirectoryError, match="is a file: a dataset is a folder"):
        Dataset(folder / "meta.json")
