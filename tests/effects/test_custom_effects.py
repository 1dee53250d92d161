"""Effects of a user's own: what they do to luma, log intensity and events, what is promised, and what is refused."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from command_line import davis_rs as command
from davis_rs import CrossingEngine, Effects, Simulator, check_dataset, load_scene, simulate
from davis_rs._core import log_intensity
from davis_rs.events.arrays import EVENT_DTYPE, EventArray, concatenate_events
from davis_rs.geometry.camera import Camera
from davis_rs.inspection.visual_sequence import open_visual_sequence
from davis_rs.sampling.exposure import KeyframeExposure
from davis_rs.sensor.effects import Aps, CustomEffects, Readout, event_draws
from davis_rs.sensor.effects.custom_effects import load_custom_effect
from long_form import long_values

SMALL = Camera(48, 36, 40.0, 40.0, 23.5, 17.5)
PLANES = load_scene("three_planes").crop(0.5, 0.3)
Frame = npt.NDArray[Any]


@dataclass
class Crosstalk:
    """A share of the events is seen by the pixel to the right as well, a microsecond later."""

    share: float = 0.3

    def begin(self, width: int, height: int, seed: int) -> None:
        self._width, self._seed = width, seed
        self._late = np.zeros(0, EVENT_DTYPE)

    def events(self, start_us: int, end_us: int | None, events: EventArray) -> EventArray:
        copies = events[(event_draws(events, self._seed) < self.share) & (events["x"] < self._width - 1)]
        copies["x"] += 1
        copies["t"] += 1
        merged = np.sort(np.concatenate([self._late, events, copies]), order=("t", "y", "x"), kind="stable")
        now = np.ones(len(merged), np.bool_) if end_us is None else merged["t"] <= end_us
        self._late = merged[~now]
        return merged[now]


class SecondLate:
    """Events leave a second later: of a shorter run all of them at the end."""

    def begin(self, width: int, height: int, seed: int) -> None:
        self._held: list[EventArray] = []

    def events(self, start_us: int, end_us: int | None, events: EventArray) -> EventArray:
        events["t"] += 1_000_000
        self._held.append(events)
        return concatenate_events(self._held) if end_us is None else events[:0]


class Dimmer:
    """Luma grows by a factor that depends on the pixel and on time."""

    def luma(self, t_us: int, luma: Frame) -> Frame:
        luma *= np.linspace(1, 2, luma.shape[1], dtype=np.float32)  # what is given may be changed
        return luma * np.float32(1 + t_us * 1e-6)


class Drift:
    """Log intensity rises by 3 a second, and remembers how often it was asked."""

    def __init__(self) -> None:
        self.calls: list[int] = []

    def log_intensity(self, t_us: int, log_intensity: Frame) -> Frame:
        self.calls.append(t_us)
        return log_intensity + 3e-6 * t_us


def stream(custom: object, **settings: Any) -> EventArray:
    """The events of a short run."""
    given: dict[str, Any] = {
        "camera": SMALL,
        "renderer": "native",
        "render_rate_hz": 200.0,
        "rays_per_pixel": 4,
    } | settings
    return concatenate_events([packet.events for packet in simulate(PLANES, custom_effects=custom, **given)])


def key(events: EventArray) -> Frame:
    return (events["t"] * 65536 + events["y"]) * 65536 + events["x"]


def test_an_effect_on_events_acts_on_the_stream_behind_the_pixels() -> None:
    """All events are still there, and the share that was asked for has a neighbour a microsecond later."""
    plain, seen = stream(None), stream(Crosstalk(0.3))
    assert np.isin(key(plain), key(seen)).all()
    assert np.all(np.diff(key(seen)) >= 0)
    copies = len(seen) - len(plain)
    candidates = np.count_nonzero(plain["x"] < SMALL.width - 1)
    assert candidates > 3000
    assert abs(copies / candidates - 0.3) < 5 * np.sqrt(0.3 * 0.7 / candidates)


def test_what_is_held_back_comes_at_the_end() -> None:
    """In a packet behind the last one, with the bus's own late events, and in the order of the bus."""
    bus = Effects(readout=Readout(math.inf, latency_us=3_000.0))
    plain = list(simulate(PLANES, camera=SMALL, renderer="native", effects=bus))
    held = list(simulate(PLANES, camera=SMALL, renderer="native", effects=bus, custom_effects=SecondLate()))
    assert len(held) == len(plain)
    assert all(not len(packet.events) for packet in held[:-1])
    whole = concatenate_events([packet.events for packet in plain])
    assert np.any(whole != np.sort(whole, order=("t", "y", "x")))
    whole["t"] += 1_000_000
    np.testing.assert_array_equal(held[-1].events, whole)
    assert (held[-1].start_us, held[-1].end_us) == (300_000, whole["t"][-1])


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "cut",
    [{"frame_rate_hz": 0.0, "depth_rate_hz": 0.0}, {"frame_rate_hz": 200.0}, {"poses_per_launch": 3}, {"threads": 2}],
    ids=["no frames", "many frames", "launches", "threads"],
)
@pytest.mark.parametrize("custom", [Crosstalk, *long_values(Dimmer, Drift)])
def test_how_a_run_is_cut_changes_nothing(custom: Callable[[], object], cut: dict[str, Any]) -> None:
    """Packets end where frames fall due: the stream is the same bytes, however often that is."""
    whole = stream(custom(), effects=Effects(readout=1e6, shot_noise_rms=0.05))
    assert len(whole) > 3000
    other = stream(custom(), effects=Effects(readout=1e6, shot_noise_rms=0.05), **cut)
    assert other.tobytes() == whole.tobytes()


def test_the_seed_makes_a_run_repeatable() -> None:
    """The same object serves run after run: it begins anew each time."""
    effect = Crosstalk()
    first, again, other = stream(effect), stream(effect), stream(effect, seed=1)
    assert first.tobytes() == again.tobytes()
    assert len(other) != len(first)


def test_an_effect_on_luma_is_what_the_pixels_see() -> None:
    """Luma of each render goes through it, and comes out with the frames; the events are those of the result."""
    packets = list(simulate(PLANES, custom_effects=Dimmer(), camera=SMALL, renderer="native", frame_rate_hz=200.0,
                            depth_rate_hz=0.0, render_rate_hz=200.0))  # fmt: skip
    plain = list(simulate(PLANES, camera=SMALL, renderer="native", frame_rate_hz=200.0, depth_rate_hz=0.0,
                          render_rate_hz=200.0))  # fmt: skip
    engine = CrossingEngine(SMALL.width, SMALL.height, contrast_threshold=0.15)
    for packet, before in zip(packets, plain, strict=True):
        assert packet.luma is not None
        assert before.luma is not None
        np.testing.assert_array_equal(packet.luma, Dimmer().luma(packet.end_us, before.luma.copy()))
        assert packet.events.tobytes() == engine.push(packet.end_us, packet.luma).tobytes()


def test_an_effect_on_log_intensity_is_what_the_photoreceptor_sees() -> None:
    """Once a keyframe, in the order of time, from 0 on; frames stay as they are."""
    drift = Drift()
    given: dict[str, Any] = {"camera": SMALL, "renderer": "native", "frame_rate_hz": 200.0, "render_rate_hz": 200.0}
    packets = list(simulate(PLANES, custom_effects=drift, **given))
    assert drift.calls == list(range(0, 300_001, 5000))
    engine = CrossingEngine(SMALL.width, SMALL.height, contrast_threshold=0.15)
    for packet in packets:
        assert packet.luma is not None
        logs = log_intensity(packet.luma, 1e-3) + 3e-6 * packet.end_us
        assert packet.events.tobytes() == engine.push_log(packet.end_us, logs).tobytes()
    assert np.mean(concatenate_events([packet.events for packet in packets])["p"]) > 0.7


def test_several_act_in_their_order() -> None:
    """Luma before log intensity before events; of two on luma the first one first."""

    class Add:
        def luma(self, t_us: int, luma: Frame) -> Frame:
            return luma + np.float32(1)

    class Double:
        def luma(self, t_us: int, luma: Frame) -> Frame:
            return 2 * luma

    frame = np.ones((2, 3), np.float32)
    assert CustomEffects([Add(), Double()], 3, 2, 0).luma(0, frame)[0, 0] == 4
    assert CustomEffects((Double(), Add()), 3, 2, 0).luma(0, frame)[0, 0] == 3
    assert frame[0, 0] == 1
    assert CustomEffects(None, 3, 2, 0).luma(0, frame) is frame
    assert CustomEffects(Dimmer(), 3, 2, 0).luma(0, frame)[0, 2] == 2
    assert frame[0, 2] == 1  # what an effect was given to change is a copy


def test_steps_and_their_flush_bring_what_a_run_brings() -> None:
    """An effect that keeps events back gives all of them at the end."""
    settings: dict[str, Any] = {
        "camera": SMALL,
        "renderer": "native",
        "render_rate_hz": 200.0,
        "custom_effects": Crosstalk(),
    }
    run = concatenate_events([packet.events for packet in Simulator(PLANES, **settings).run()])
    simulator = Simulator(PLANES, **settings)
    steps = [
        packet for t_us in range(0, 300_001, 50_000) for packet in simulator.step(t_us, PLANES.path.pose(t_us * 1e-6))
    ]
    assert all(a.end_us == b.start_us for a, b in pairwise(steps))
    stepped = concatenate_events([packet.events for packet in steps + simulator.flush()])
    copies = [len(events) for events in (run, stepped)]
    assert abs(copies[0] - copies[1]) < 0.02 * copies[0]  # chords of the path, not the path
    assert simulator.flush() == []


BASE = np.array([(3, 1, 1, 1), (7, 2, 0, 0)], EVENT_DTYPE)


def changed(**columns: list[int]) -> EventArray:
    events = BASE.copy()
    for name, values in columns.items():
        events[name] = values
    return events


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (None, "events must be a one-dimensional structured array"),
        (np.zeros(3), "events must be a one-dimensional structured array"),
        (changed(t=[7, 3]), "events must be sorted by (t, y, x), got (3, 2, 0, 0) as number 1 of 2"),
        (changed(t=[7, 7]), "events must be sorted by (t, y, x), got (7, 2, 0, 0) as number 1 of 2"),
        (changed(t=[2, 7]), "events must lie in that interval, got (2, 1, 1, 1) as number 0 of 2"),
        (changed(t=[3, 11]), "events must lie in that interval, got (11, 2, 0, 0) as number 1 of 2"),
        (changed(x=[1, 4]), "events must lie in 4 x 3 pixels, got (7, 4, 0, 0)"),
        (changed(y=[3, 0]), "events must lie in 4 x 3 pixels, got (3, 1, 3, 1)"),
        (changed(p=[1, 2]), "p must be 0 or 1, got (7, 2, 0, 2)"),
    ],
)
def test_events_that_are_no_stream_are_refused(result: Any, message: str) -> None:
    """The error names the effect, the interval, the rule and the event."""

    class Broken:
        def events(self, start_us: int, end_us: int | None, events: EventArray) -> Any:
            return result

    with pytest.raises(ValueError, match=re.escape(f"Broken.events of (2, 10] us: {message}")):
        CustomEffects(Broken(), 4, 3, 0).events(2, 10, BASE)


def test_events_of_the_right_interval_are_taken() -> None:
    """The ends count as they are told: (start, end], and no end after the last interval."""

    class Same:
        def events(self, start_us: int, end_us: int | None, events: EventArray) -> EventArray:
            return events

    effects = CustomEffects([Same()], 4, 3, 0)
    for end_us, given in ((7, BASE), (None, changed(t=[3, 2**40]))):
        np.testing.assert_array_equal(effects.events(2, end_us, given), given)


@pytest.mark.parametrize("method", ["luma", "log_intensity"])
@pytest.mark.parametrize(
    ("result", "message"),
    [
        (None, "must have the shape (2, 3), got None"),
        (np.ones((3, 2)), "must have the shape (2, 3), got (3, 2)"),
        (1.0, "must have the shape (2, 3), got ()"),
        (np.full((2, 3), "a"), "must be numbers, got dtype <U1"),
        (np.ones((2, 3), complex), "must be numbers, got dtype complex128"),
        (np.array([[1, 1, 1], [1, np.nan, 1]]), "must be finite, got nan at pixel (1, 1)"),
        (np.array([[1, 1, np.inf], [1, 1, 1]]), "must be finite, got inf at pixel (2, 0)"),
    ],
)
def test_frames_that_are_no_light_are_refused(method: str, result: Any, message: str) -> None:
    """The error names the effect, the time, the rule and the pixel."""
    broken = type("Broken", (), {method: lambda self, t_us, frame: result})()
    effects, luma = CustomEffects(broken, 3, 2, 0), np.ones((2, 3), np.float32)
    with pytest.raises(ValueError, match=re.escape(f"Broken.{method} at 25 us {message}")):
        effects.luma(25, luma) if method == "luma" else effects.log_intensity(25, luma, 1e-3)


def test_negative_luma_is_refused_and_negative_log_intensity_is_not() -> None:
    """Light cannot be less than none."""

    class Negative:
        def luma(self, t_us: int, luma: Frame) -> Frame:
            luma[1, 2] = -1
            return luma

    with pytest.raises(ValueError, match=re.escape("Negative.luma at 25 us must be >= 0, got -1.0 at pixel (2, 1)")):
        CustomEffects(Negative(), 3, 2, 0).luma(25, np.ones((2, 3), np.float32))
    assert CustomEffects(Drift(), 3, 2, 0).log_intensity(0, np.zeros((2, 3), np.float32), 1e-3).max() < 0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (object(), "a custom effect must have one of the methods luma, log_intensity, events, got <object"),
        (Crosstalk, "an object is wanted, this is a class"),
        ("nowhere", "a custom effect must be MODULE:NAME or FILE.py:NAME, got 'nowhere'"),
        ("no_such_module:Name", "custom effect 'no_such_module:Name': there is no module 'no_such_module'"),
        ("math:sqr", "custom effect 'math:sqr': math has no sqr; did you mean sqrt?"),
        ("json:decodr", "custom effect 'json:decodr': json has no decodr; did you mean JSONDecoder?"),
        ("math:tay", "custom effect 'math:tay': math has no tay; did you mean tan?"),
        ("math:pi", "a custom effect must have one of the methods luma, log_intensity, events, got 3.14"),
        ("fractions:Decimal", "must have one of the methods"),
    ],
)
def test_what_is_no_effect_is_refused(given: Any, message: str) -> None:
    """Before anything is rendered."""
    with pytest.raises(ValueError, match=re.escape(message)):
        Simulator(PLANES, camera=SMALL, renderer="native", custom_effects=given)


def test_light_of_ones_own_has_rules_of_sampling_that_fit() -> None:
    """Straight lines between whole frames; what contradicts that is an error, and events alone change nothing."""

    def sampling(custom: object, **given: Any) -> str:
        return repr(Simulator(PLANES, camera=SMALL, renderer="native", custom_effects=custom, **given).sampling)

    assert sampling(Drift()) == "MaxDisplacement(pixels=0.3333333333333333, hermite=False)"
    assert sampling(Dimmer(), accuracy="exact") == "MaxDisplacement(pixels=0.16666666666666666, hermite=False)"
    assert sampling(Dimmer(), accuracy="fast") == sampling(None, accuracy="fast")
    assert sampling(Dimmer(), render_rate_hz=700.0) == "FixedRate(rate_hz=700.0, hermite=False)"
    assert sampling(Crosstalk()) == sampling(None)
    with pytest.raises(ValueError, match="custom effects on light need whole frames"):
        sampling(Dimmer(), tolerance=0.1)
    with pytest.raises(ValueError, match="refine asks the renderer for times"):
        sampling(Drift(), refine=True, render_rate_hz=700.0)


def test_exposed_frames_have_the_effect_on_luma() -> None:
    """The mean of what the effect gave while the shutter was open."""

    class Ramp:
        def luma(self, t_us: int, luma: Frame) -> Frame:
            return np.full_like(luma, t_us * 1e-6)

    aps = Aps(10_000, read_noise_dn=0, bits=16, full_scale_luma=1.0)
    packets = list(simulate(PLANES, custom_effects=Ramp(), camera=SMALL, renderer="native", effects=Effects(aps=aps)))
    for packet in packets[1:]:
        assert packet.frame is not None
        np.testing.assert_allclose(packet.frame, packet.end_us * 1e-6 - 0.005, atol=1e-4)


def test_the_mean_of_keyframes_is_that_of_straight_lines() -> None:
    """Also where the shutter opens between two keyframes, before the first one, or not at all."""
    times, values = [0, 4, 10, 11, 30], [0.0, 8.0, 2.0, 2.0, 21.0]
    for exposure_us in (0, 1, 5, 19, 25, 40):
        exposure = KeyframeExposure(exposure_us)
        for t_us, value in zip(times, values, strict=True):
            exposure.add(t_us, np.full((1, 1), value, np.float32))
            open_us = max(t_us - exposure_us, 0)
            fine = np.interp(np.linspace(open_us, t_us, 100_001), times, values)
            assert exposure.mean(t_us)[0, 0] == pytest.approx(np.trapezoid(fine, dx=1) / 100_000, rel=1e-6)


FILE = """
import numpy as np

class Brighter:
    def luma(self, t_us, luma):
        return luma * np.float32(1 + 4 * t_us * 1e-6)

def some():
    return Brighter()

def needs(more):
    return Brighter()

ready = Brighter()
"""


def test_the_command_line_takes_one_from_a_file(tmp_path: Path) -> None:
    """And the record names it, with the digest of its source; the check still explains the luma by the events."""
    (tmp_path / "mine.py").write_text(FILE)
    entry = f"{tmp_path / 'mine.py'}:Brighter"
    short = ["--duration", "0.05", "--size", "48x36", "--renderer", "native", "--quiet", "--render-rate", "400"]
    done = command("simulate", "three_planes", "-o", tmp_path / "out", "--custom-effect", entry, *short)
    assert (done.returncode, done.stderr) == (0, "")
    meta = json.loads((tmp_path / "out" / "meta.json").read_text())
    [described] = meta["custom_effects"]
    assert (described["class"], described["acts_on"]) == ("custom_effects.mine:Brighter", ["luma"])
    assert re.fullmatch("[0-9a-f]{64}", described["source_sha256"])
    assert "effects     Brighter\n" in command("info", tmp_path / "out").stdout
    assert open_visual_sequence(tmp_path / "out").label.endswith("sensor 48 x 36, with Brighter")
    report = check_dataset(tmp_path / "out")
    assert report.ok
    assert report.instants
    assert report.counts["on_events"] > 0.6 * report.counts["events"]
    failed = command("simulate", "three_planes", "-o", tmp_path / "no", "--custom-effect", "nowhere:Name", *short)
    assert failed.returncode == 1
    assert "there is no module 'nowhere'" in failed.stderr
    assert not (tmp_path / "no").exists()


def test_the_check_does_not_explain_light_by_events_that_an_effect_changed(tmp_path: Path) -> None:
    """It says so, and names the effect."""
    from davis_rs import simulate_to_folder

    simulate_to_folder(
        PLANES, tmp_path / "out", camera=SMALL, renderer="native", custom_effects=Crosstalk(), quiet=True
    )
    report = check_dataset(tmp_path / "out")
    assert report.ok
    assert report.void == [f"{__name__}:Crosstalk"]
    [described] = json.loads((tmp_path / "out" / "meta.json").read_text())["custom_effects"]
    assert described["parameters"] == {"share": 0.3}


class Dust:
    """Has parameters, next to what it keeps for itself, but no repr of its own."""

    def __init__(self) -> None:
        self.grains, self.radii, self._seen, self.shape = 3, [1.5, 2.0], 0, "round"

    def luma(self, t_us: int, luma: Frame) -> Frame:
        return luma


class Haze:
    """Has nothing that a record could hold."""

    density = 0.5

    def __init__(self) -> None:
        self.map = np.ones(3)

    def luma(self, t_us: int, luma: Frame) -> Frame:
        return luma


class Smear(Dust):
    def __repr__(self) -> str:
        return "Smear(3)"


@pytest.mark.parametrize(
    ("effect", "parameters"),
    [
        (Crosstalk(), {"share": 0.3}),
        (Smear(), "Smear(3)"),
        (Dust(), {"grains": 3, "radii": [1.5, 2.0], "shape": "round"}),
        (Haze(), None),
    ],
)
def test_a_record_has_no_address_of_memory(effect: object, parameters: object) -> None:
    """So that a second run writes the same bytes."""
    [described] = CustomEffects(effect, 48, 36, 0).describe()
    assert described["parameters"] == parameters


def test_entries_of_modules_and_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Classes and functions are called, objects are taken; modules of the working directory are found."""
    (tmp_path / "mine_too.py").write_text(FILE)
    monkeypatch.chdir(tmp_path)
    for name in ("Brighter", "some", "ready"):
        for where in ("mine_too", "mine_too.py"):
            assert type(load_custom_effect(f"{where}:{name}")).__name__ == "Brighter"
    with pytest.raises(ValueError, match=r"needs\(\) is called without arguments: missing a required argument: 'more'"):
        load_custom_effect("mine_too:needs")
    with pytest.raises(FileNotFoundError):
        load_custom_effect("none.py:Brighter")


def test_draws_belong_to_events() -> None:
    """Uniform, one number an event, whatever the stream is cut into; another seed or purpose gives others."""
    rng = np.random.default_rng(5)
    events = np.zeros(200_000, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(-(10**12), 10**12, len(events)))
    for name, end in (("x", 65536), ("y", 65536), ("p", 2)):
        events[name] = rng.integers(0, end, len(events))
    draws = event_draws(events, 7)
    assert draws.min() >= 0 > draws.max() - 1
    counts = np.histogram(draws, 100, (0, 1))[0]
    assert 60 < ((counts - 2000) ** 2 / 2000).sum() < 140  # chi^2 of 99 degrees of freedom, within 3 sigma
    np.testing.assert_array_equal(np.concatenate([event_draws(events[:77], 7), event_draws(events[77:], 7)]), draws)
    for other in (event_draws(events, 8), event_draws(events, 7, 1), np.roll(draws, 1)):
        assert abs(np.corrcoef(draws, other)[0, 1]) < 0.01
    for name in ("t", "x", "y", "p"):
        moved = events.copy()
        moved[name] ^= 1
        assert abs(np.corrcoef(draws, event_draws(moved, 7))[0, 1]) < 0.01, name
    with pytest.raises(ValueError, match=r"seed must be an integer in 0\.\.2\^64 - 1, got -1"):
        event_draws(events, -1)


def test_plans_run_nobodys_code(tmp_path: Path) -> None:
    """A plan is data that may come from elsewhere."""
    path = tmp_path / "plan.yaml"
    path.write_text("scene: three_planes\ncustom_effects: [os:abort]\n")
    done = command("generate", path, "--dry-run")
    assert done.returncode == 1
    assert "custom_effects: there is no such key" in done.stderr
