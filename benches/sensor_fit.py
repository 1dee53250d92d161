"""How far fits of sensors are off, and what they say their errors are: recordings of sensors with hidden parameters.

python benches/sensor_fit.py [RECORDINGS [SEED]]

First recordings of a moving scene with frames, then the same of sensors with a photoreceptor, whose corner goes with
light, then pairs of static scenes in known light. For each parameter: how many recordings told it, mean and mean square
of (fitted - true) / error, which is 1 where errors are as large as they are said to be, and the largest.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import Pool
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from hidden_sensors import OVER_LIGHT, HiddenSensor, HiddenStaticSensor, pulls, pulls_over_light, static_pulls


def table(pulls_of: Callable[[int], dict[str, float]], recordings: int, parameters: Sequence[str]) -> list[float]:
    """Print the table of so many recordings, which are drawn by all cores, and return all pulls."""
    found: dict[str, list[float]] = {}
    with Pool() as pool:
        for one in pool.imap(pulls_of, range(recordings)):
            for name, pull in one.items():
                found.setdefault(name, []).append(pull)
    print("| parameter | told by | mean | chi^2 / n | largest |")
    print("|---|---|---|---|---|")
    for name in (name for name in parameters if name in found):
        own = np.array(found[name])
        largest = np.abs(own).max()
        print(f"| `{name}` | {len(own)} | {own.mean():+.2f} | {np.mean(own**2):.2f} | {largest:.1f} |")
    return [pull for own in found.values() for pull in own]


def main() -> None:
    """Draw, fit, print."""
    recordings, seed = (int(word) for word in (sys.argv[1:] + ["48", "7001"][len(sys.argv) - 1 :]))
    of_frames = table(partial(pulls, seed), recordings, HiddenSensor._fields)
    print(flush=True)
    over_light = table(partial(pulls_over_light, seed), recordings, OVER_LIGHT)
    print(flush=True)
    of_static = table(partial(static_pulls, seed), recordings, HiddenStaticSensor._fields)
    all_of_them = np.abs(of_frames + over_light + of_static)
    print(f"\n{np.count_nonzero(all_of_them > 3)} of {len(all_of_them)} values are beyond 3 sigma")


if __name__ == "__main__":
    main()
