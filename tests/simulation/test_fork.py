"""Simulations in processes that were forked after a simulation: their threads are their own."""

from __future__ import annotations

from collections.abc import Callable

import pytest

FORKED = """
import os, signal, warnings
import davis_rs

warnings.simplefilter("ignore", DeprecationWarning)  # from Python 3.12: a fork of a process that has threads
SCENE = davis_rs.load_scene("three_planes").crop(1.0, 0.01)
OPTIONS = dict(size=(64, 48), rays_per_pixel=4, renderer="native")

def simulated():
    return sum(len(packet.events) for packet in davis_rs.simulate(SCENE, **OPTIONS))

def stepped(simulator):
    return sum(len(packet.events) for packet in simulator.step(10_000, SCENE.path.pose(0.01)))

def begun():
    simulator = davis_rs.Simulator(SCENE, threads=2, **OPTIONS)
    simulator.step(0, SCENE.path.pose(0.0))
    return simulator

expected, expected_of_step, simulator = simulated(), stepped(begun()), begun()
assert min(expected, expected_of_step) > 100
child = os.fork()
if child == 0:
    signal.alarm(20)  # ends a child that hangs
    os._exit(0 if (simulated(), stepped(simulator)) == (expected, expected_of_step) else 1)
print(os.waitpid(child, 0)[1], (simulated(), stepped(simulator)) == (expected, expected_of_step))
"""

LOADER = """
import warnings
import davis_rs
from torch.utils.data import DataLoader, Dataset

warnings.simplefilter("ignore", DeprecationWarning)

class Sequences(Dataset):
    def __len__(self):
        return 8

    def __getitem__(self, index):
        scene = davis_rs.load_scene("three_planes").crop(1.0 + 0.02 * index, 0.005)
        return sum(len(packet.events) for packet in davis_rs.simulate(scene, size=(64, 48), rays_per_pixel=4))

here = [Sequences()[index] for index in range(8)]
made = [int(one) for batch in DataLoader(Sequences(), batch_size=2, num_workers=4, timeout=120) for one in batch]
print(made == here, min(here) > 10)
"""


@pytest.mark.long
def test_a_forked_child_simulates_as_its_parent_does(run_python: Callable[..., str]) -> None:
    """A fork copies no threads: the child starts its own, in place of waiting for those of its parent. So it is with
    those that all share, and with those of a simulator that was begun before."""
    assert run_python(FORKED) == "0 True\n"


@pytest.mark.long
def test_workers_of_a_data_loader_make_simulators(run_python: Callable[..., str]) -> None:
    """PyTorch forks its workers from a process that has simulated before."""
    pytest.importorskip("torch")
    assert run_python(LOADER) == "True True\n"
