"""Resident memory over a long simulation: python benches/memory.py [SECONDS] [fast | balanced]

Laps of three_planes' circle, written to a dataset folder that is removed afterwards; prints the memory after the first
0.3 s (some 100 renders by the paper's rule) and then every 2.5 s (some 900).
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import davis_rs


def resident_mb() -> float:
    """Resident set size of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def laps(scene: davis_rs.Scene, duration_s: float) -> davis_rs.Trajectory:
    """The scene's circle, gone round again and again."""
    own = scene.trajectory
    assert own is not None
    lap_s = 1.999
    return davis_rs.CallableTrajectory(
        duration_s,
        position=lambda t: own.positions(np.mod(t, lap_s)),
        quaternion=lambda t: own.quaternions(np.mod(t, lap_s)),
        velocity=lambda t: own.velocities(np.mod(t, lap_s)),
        angular_rate=lambda t: own.angular_rates(np.mod(t, lap_s)),
        description={"path": "laps of three_planes' circle"},
    )


def main() -> None:
    duration_s = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    scene = davis_rs.load_scene("three_planes")
    accuracy = sys.argv[2] if len(sys.argv) > 2 else "paper"
    simulator = davis_rs.Simulator(scene.with_trajectory(laps(scene, duration_s)), rays_per_pixel=4, accuracy=accuracy)
    events, next_s = 0, 0.3
    with (
        tempfile.TemporaryDirectory() as folder,
        davis_rs.DatasetWriter(Path(folder) / "out", simulator.camera) as writer,
    ):
        for packet in simulator.run():
            writer.write(packet)
            events += len(packet.events)
            if packet.end_us * 1e-6 >= next_s:
                print(f"{next_s:5.1f} s simulated: {events:>12,} events, {resident_mb():6.0f} MB resident", flush=True)
                next_s = 2.5 * (next_s // 2.5 + 1)


if __name__ == "__main__":
    main()
