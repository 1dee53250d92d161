"""Whole runs with the effects that a plan chose, and with all of a sensor's: do they make as many events?

python benches/auto_effects.py            # parts of 0.1 to 0.3 s
python benches/auto_effects.py --whole    # whole camera paths

Three scenes are seen by the davis240c in dim, common and very bright light: once with `effects="auto"`, and once with
all of the sensor's effects, both with the same seed. The difference of the counts of events is printed next to the one
that the plan forecast.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

from davis_rs import SENSORS, Scene, load_scene
from davis_rs.simulation.settings import SimulationSettings, complete
from davis_rs.simulation.simulate import make_simulator

SCENES = {"three_walls": (0.5, 0.3), "three_planes": (0.5, 0.1), "fence": (0.5, 0.3)}
"""From where on, and for how long, in seconds, where a part is looked at."""

LIGHTS_LUX = 5.0, 300.0, 20_000.0

SENSOR = replace(SENSORS["davis240c"], width=None, height=None)
"""What auto takes."""


def shown(name: str, *, whole: bool) -> Scene:
    """Load a scene, or the part of it that is looked at."""
    return load_scene(name) if whole else load_scene(name).crop(*SCENES[name])


def counted(scene: Scene, lux: float, **settings: object) -> tuple[int, float, str]:
    """Events of a whole run, the error that was forecast in percent, and the effects on events that it had."""
    rates = {"frame_rate_hz": 0, "depth_rate_hz": 0, "lux_per_luma": lux}
    made = make_simulator(scene, complete(SimulationSettings, {**rates, **settings}, taker=counted))
    events = sum(len(packet.events) for packet in made.simulator.run())
    together = None if made.plan is None else made.plan.together
    forecast = float("nan") if together is None else together.omission.count_percent
    return events, forecast, ", ".join(effect.name for effect in made.simulator.effects if effect.name != "aps")


def main() -> None:
    """Print one row a scene and light."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--whole", action="store_true", help="whole camera paths")
    whole = options.parse_args().whole
    print("| scene | lux at luma 1 | all effects | auto | difference | forecast | left out |")
    print("|---|---:|---:|---:|---:|---:|---|")
    for name in SCENES:
        for lux in LIGHTS_LUX:
            everything, _, names = counted(shown(name, whole=whole), lux, sensor=SENSOR)
            chosen, forecast, called_for = counted(shown(name, whole=whole), lux, effects="auto")
            left = ", ".join(sorted(set(names.split(", ")) - set(called_for.split(", ")))) or "none"
            difference = 100 * (chosen / everything - 1)
            cells = [
                name,
                f"{lux:,.0f}",
                f"{everything:,}",
                f"{chosen:,}",
                f"{difference:+.2f} %",
                f"{forecast:+.2f} %",
            ]
            print(f"| {' | '.join([*cells, left])} |", flush=True)


if __name__ == "__main__":
    main()
