"""Which effects a plan calls for in different light, and how the chosen set does in whole simulations.

python benches/plans.py

Three recordings of three_planes by the davis240c: dim, bright and very bright. For each the plan is made, and then
whole simulations with other seeds have all of the sensor's effects, the chosen ones, and none. Errors are those of the
chosen set against all effects, by the plan's own measures of count and rate.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from davis_rs import SENSORS, Effects, load_scene, plan_effects, simulate
from davis_rs.events import EventArray, concatenate_events

LIGHTS_LUX, DURATION_S, SEEDS = (30.0, 1000.0, 20_000.0), 0.25, (11, 12)


def events_of(lux: float, effects: Effects, seed: int) -> EventArray:
    """A whole run; the sensor gives thresholds, and no effect that is not named."""
    sensor = replace(SENSORS["davis240c"])
    scene = load_scene("three_planes").crop(0.0, DURATION_S)
    settings = {"frame_rate_hz": 0, "depth_rate_hz": 0, "seed": seed, "lux_per_luma": lux}
    packets = simulate(scene, sensor=sensor, effects=effects, **settings)  # type: ignore[arg-type]
    return concatenate_events([packet.events for packet in packets])


def rate_error_percent(chosen: EventArray, everything: EventArray) -> float:
    """Of each pixel and polarity, added up without signs, of the larger stream."""
    counts = []
    for events in (chosen, everything):
        index = (events["y"].astype(np.int64) * 240 + events["x"]) * 2 + events["p"]
        counts.append(np.bincount(index, minlength=2 * 240 * 180))
    return float(100 * np.abs(counts[0] - counts[1]).sum() / max(len(chosen), len(everything)))


def main() -> None:
    """One row a light."""
    print("| lux at luma 1 | called for | forecast: count, rate | with fresh seeds: count, rate | without any: rate |")
    print("|---:|---|---:|---:|---:|")
    for lux in LIGHTS_LUX:
        scene = load_scene("three_planes").crop(0.0, DURATION_S)
        plan = plan_effects(scene, sensor="davis240c", lux_per_luma=lux)
        candidates = SENSORS["davis240c"].effects(lux)
        everything = Effects.of(effect for effect in candidates if effect.name != "aps")
        chosen = Effects.of(effect for effect in plan.effects if effect.name != "aps")
        none = plan.effects.without(effect.name for effect in plan.effects)
        found = []
        for seed in SEEDS:
            all_of_them = events_of(lux, everything, seed)
            of_set, of_none = events_of(lux, plan.effects, seed), events_of(lux, none, seed)
            count = 100 * (len(of_set) - len(all_of_them)) / max(len(of_set), len(all_of_them))
            found.append((count, rate_error_percent(of_set, all_of_them), rate_error_percent(of_none, all_of_them)))
        count, rate, without = np.mean(found, axis=0)
        omission = plan.together.omission if plan.together is not None else None
        forecast = "-" if omission is None else f"{omission.count_percent:+.2f} %, {omission.rate_percent:.2f} %"
        names = ", ".join(effect.name for effect in chosen)
        print(f"| {lux:,.0f} | {names} | {forecast} | {count:+.2f} %, {rate:.2f} % | {without:.1f} % |", flush=True)


if __name__ == "__main__":
    main()
