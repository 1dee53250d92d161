"""Which effects a plan calls for in different light, and how the chosen set does in whole simulations.

python benches/plans.py

A tenth of a second of three_planes is seen by the davis240c in dim, common and very bright light. For each light the
plan is made. Then the scene is simulated whole with seeds that the plan never saw: with all of the sensor's effects,
with the chosen ones, and with none. Errors are the plan's own measures of count and rate, compared with all effects.
"""

from __future__ import annotations

import time

import numpy as np

from davis_rs import SENSORS, EffectPlan, Effects, Scene, load_scene, plan_effects, simulate
from davis_rs.events.arrays import EventArray, concatenate_events

LIGHTS_LUX, START_S, DURATION_S, SEEDS, TOLERANCE = (5.0, 1_000.0, 50_000.0), 0.5, 0.1, (11, 12, 13), 0.06


def scene() -> Scene:
    return load_scene("three_planes").crop(START_S, DURATION_S)


def events_of(lux: float, effects: Effects, seed: int) -> tuple[EventArray, float]:
    """A whole run with these effects alone, and the processor time that it took."""
    named = {effect.name for effect in effects}
    alone = effects.without(effect.name for effect in SENSORS["davis240c"].effects(lux) if effect.name not in named)
    settings = {"frame_rate_hz": 0, "depth_rate_hz": 0, "seed": seed, "lux_per_luma": lux}
    begin = time.process_time()
    packets = simulate(scene(), sensor="davis240c", effects=alone, **settings)  # type: ignore[arg-type]
    events = concatenate_events([packet.events for packet in packets])
    return events, time.process_time() - begin


def rate_error_percent(one: EventArray, other: EventArray) -> float:
    """Of each pixel and polarity, added up without signs, as a share of the larger stream."""
    counts = []
    for events in (one, other):
        index = (events["y"].astype(np.int64) * 240 + events["x"]) * 2 + events["p"]
        counts.append(np.bincount(index, minlength=2 * 240 * 180))
    return float(100 * np.abs(counts[0] - counts[1]).sum() / max(len(one), len(other)))


def count_error_percent(one: EventArray, other: EventArray) -> float:
    return 100 * abs(len(one) - len(other)) / max(len(one), len(other))


def measured(lux: float, plan: EffectPlan) -> tuple[list[float], list[float], float]:
    """Count and rate errors of the chosen set, and of no effects, in percent; processor time of the set over all."""
    everything = SENSORS["davis240c"].effects(lux)
    sets: tuple[list[list[float]], list[list[float]]] = ([], [])
    times: tuple[list[float], list[float]] = ([], [])
    for seed in SEEDS:
        truth, all_s = events_of(lux, everything, seed)
        times[1].append(all_s)
        for errors, effects in zip(sets, (plan.effects, Effects()), strict=True):
            events, took_s = events_of(lux, effects, seed)
            errors.append([count_error_percent(events, truth), rate_error_percent(events, truth)])
            if effects:
                times[0].append(took_s)
    chosen, none = (np.mean(errors, axis=0).tolist() for errors in sets)
    return chosen, none, min(times[0]) / min(times[1])


def main() -> None:
    """One row a light."""
    print("| lux at luma 1 | called for | forecast: count, rate | whole runs: count, rate | none: count, rate | time |")
    print("|---:|---|---:|---:|---:|---:|")
    for lux in LIGHTS_LUX:
        plan = plan_effects(scene(), sensor="davis240c", lux_per_luma=lux, effects_tolerance=TOLERANCE)
        chosen, none, share = measured(lux, plan)
        omission = plan.together.omission if plan.together is not None else None
        forecast = "-" if omission is None else f"{abs(omission.count_percent):.2f} %, {omission.rate_percent:.2f} %"
        names = ", ".join(effect.name for effect in plan.effects if effect.name != "aps")
        cells = [f"{lux:,.0f}", names, forecast, *(f"{c:.2f} %, {r:.2f} %" for c, r in (chosen, none)), f"{share:.2f}"]
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
