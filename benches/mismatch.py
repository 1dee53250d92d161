"""The pattern of thresholds over a sensor, and what it does to the events of its columns.

python benches/mismatch.py [-o docs/mismatch.png]
"""

from __future__ import annotations

import numpy as np
from effect_figure import picture

from davis_rs import CrossingEngine, Effects
from davis_rs.sensor.effects import ThresholdMismatch

WIDTH, HEIGHT = 240, 180


def main() -> None:
    """Run, print, draw."""
    with picture(__doc__, panels=3, size=(8.4, 2.5)) as axes:
        parity = ThresholdMismatch(0.108, column_parity=0.06)
        for axis, mismatch, name in (
            (axes[0], parity, "davis240c: column_parity=0.06"),
            (axes[1], ThresholdMismatch(0.05, columns=0.1, rows=0.1), "columns=0.1, rows=0.1"),
        ):
            engine = CrossingEngine(WIDTH, HEIGHT, effects=Effects(threshold_mismatch=mismatch))
            axis.imshow(np.asarray(engine.contrast_threshold)[:40, :60], cmap="gray")
            axis.set_title(name, fontsize=7)
            axis.axis("off")
        engine = CrossingEngine(WIDTH, HEIGHT, contrast_threshold=0.283, effects=Effects(threshold_mismatch=parity))
        columns = np.zeros((2, WIDTH))
        for k in range(9):
            events = engine.push_log(k * 100_000, np.full((HEIGHT, WIDTH), 4.0 * (k % 2)))
            np.add.at(columns, (events["p"], events["x"]), 1 / HEIGHT)
        for p, name in ((1, "ON"), (0, "OFF")):
            axes[2].plot(columns[p, :60], ".-", linewidth=0.5, markersize=3, label=name)
            even, odd = columns[p, ::2].mean(), columns[p, 1::2].mean()
            print(f"{name}: {even:.2f} events a pixel in even columns, {odd:.2f} in odd")
        axes[2].set(xlabel="column", ylabel="events a pixel")
        axes[2].legend(fontsize=6)


if __name__ == "__main__":
    main()
