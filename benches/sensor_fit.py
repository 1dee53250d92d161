"""How far fits of sensors are off, and what they say their errors are: recordings of sensors with hidden parameters.

python benches/sensor_fit.py [RECORDINGS [SEED]]

For each parameter: how many recordings told it, mean and mean square of (fitted - true) / error, which is 1 where
errors are as large as they are said to be, and the largest.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from hidden_sensors import HiddenSensor, pulls


def main() -> None:
    """Draw, fit, print."""
    recordings, seed = (int(word) for word in (sys.argv[1:] + ["48", "7001"][len(sys.argv) - 1 :]))
    found: dict[str, list[float]] = {}
    for number in range(recordings):
        for name, pull in pulls(seed, number).items():
            found.setdefault(name, []).append(pull)
    print("| parameter | told by | mean | chi^2 / n | largest |")
    print("|---|---|---|---|---|")
    for name in (name for name in HiddenSensor._fields if name in found):
        own = np.array(found[name])
        largest = np.abs(own).max()
        print(f"| `{name}` | {len(own)} | {own.mean():+.2f} | {np.mean(own**2):.2f} | {largest:.1f} |")
    all_of_them = np.abs(np.concatenate(list(map(np.array, found.values()))))
    print(f"{np.count_nonzero(all_of_them > 3)} of {len(all_of_them)} values are beyond 3 sigma")


if __name__ == "__main__":
    main()
