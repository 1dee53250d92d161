"""What an object shows of itself at a prompt: one line, with sizes and durations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from davis_rs import (
    EVENT_DTYPE,
    Dataset,
    Displacement,
    Packet,
    Scene,
    SegmentTrajectory,
    load_scene,
    open_reader,
    open_writer,
)
from davis_rs.simulation.simulator import Simulator
from written_sequence import HEIGHT, WIDTH, write_sequence


def test_scene_and_trajectories_tell_their_length() -> None:
    scene = load_scene("three_planes")
    assert repr(scene) == "<Scene 'three_planes', 240 x 180 px, 2 s, C = 0.15>"
    assert repr(scene.path.crop(0.5, 0.25)) == "<Cropped of 0.25 s>"
    assert repr(SegmentTrajectory(scene.path.pose(0), scene.path.pose(1), 0.5)) == "<SegmentTrajectory of 0.5 s>"
    assert "no trajectory" in repr(Scene("empty", dict))


def test_a_dataset_tells_its_sensor_and_duration(tmp_path: Path) -> None:
    write_sequence(tmp_path / "d")
    assert f"{WIDTH} x {HEIGHT} px, 0.06 s>" in repr(Dataset(tmp_path / "d"))


def test_readers_and_writers_tell_their_file(tmp_path: Path) -> None:
    with open_writer(tmp_path / "e.npy", (24, 18)) as writer:
        assert repr(writer) == f"<npy writer of {tmp_path / 'e.npy'}, 24 x 18 px, 0 events>"
    with open_reader(tmp_path / "e.npy") as reader:
        assert repr(reader) == f"<npy reader of {tmp_path / 'e.npy'}, size unknown>"


def test_packets_and_displacements_tell_what_they_hold() -> None:
    moved = Displacement(np.zeros((18, 24, 2), np.float32), np.eye(18, 24, dtype=np.bool_))
    assert repr(moved) == "<Displacement of 24 x 18 px, 18 occluded>"
    events = np.zeros(1200, EVENT_DTYPE)
    assert str(Packet(0, 25_000, events, None)) == "<Packet 0..25000 us, 1,200 events>"
    luma = np.zeros((18, 24), np.float32)
    shown = str(Packet(0, 25_000, events, None, luma=luma, displacement=moved))
    assert shown == "<Packet 0..25000 us, 1,200 events, luma, displacement>"


@pytest.mark.usefixtures("llvm")
def test_a_simulator_tells_where_it_is() -> None:
    assert (
        repr(Simulator(load_scene("three_planes"))) == "<Simulator of 'three_planes', 240 x 180 px, C = 0.15, at 0 s>"
    )
