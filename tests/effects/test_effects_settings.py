"""Effects as settings: composition, the command line's words, neutral values, and nonsense refused by name."""

from __future__ import annotations

import dataclasses
import json
import math
import pickle
import re
from typing import Any

import numpy as np
import pytest

import davis_rs
from davis_rs import CrossingEngine, Effects, Simulator, load_scene
from davis_rs._core import check_effects
from davis_rs.sensor.effects import (
    EFFECTS,
    Aps,
    Effect,
    HotPixels,
    LeakRate,
    LensBlur,
    PhotoreceptorBandwidth,
    Readout,
    RefractoryPeriod,
    ShotNoise,
    ThresholdMismatch,
    Vignetting,
    parse_effect,
)
from davis_rs.sensor.effects.effects import read_effects
from davis_rs.simulation.from_frames.array_frames import ArrayFrames
from davis_rs.simulation.from_frames.frame_run import FrameRun
from davis_rs.simulation.planning import planner
from davis_rs.simulation.planning.omission_estimator import ESTIMATORS
from davis_rs.simulation.settings import FrameSettings, complete
from places import ROOT

PLANES = load_scene("three_planes")

ALL: list[Effect] = [
    Vignetting(),
    LensBlur(0.7),
    PhotoreceptorBandwidth(300.0, source_follower_hz=3e3),
    ThresholdMismatch(0.1),
    RefractoryPeriod(10.0),
    LeakRate(0.1),
    ShotNoise(1.0),
    HotPixels(0.01),
    Readout(),
    Aps(),
]
"""One of each, on."""

FORMS: list[Any] = [
    Effects(leak_rate_hz=0.5, hot_pixels=HotPixels(0.01, rate_hz=9)),
    {"leak_rate_hz": 0.5, "hot_pixels": {"fraction": 0.01, "rate_hz": 9}},
    {"leak_rate_hz": LeakRate(0.5), "hot_pixels": HotPixels(0.01, rate_hz=9)},
    ["leak_rate_hz=0.5", "hot_pixels=0.01,rate_hz=9"],
    [LeakRate(0.5), "hot_pixels=0.01,rate_hz=9"],
]
"""The same effects, in all forms that there are."""

NEUTRAL: list[Effect] = [
    Vignetting(0),
    LensBlur(0),
    PhotoreceptorBandwidth(math.inf),
    ThresholdMismatch(0),
    RefractoryPeriod(0),
    LeakRate(0),
    ShotNoise(0),
    ShotNoise(-0.0, 3.0),
    HotPixels(0.0),
    HotPixels(0.3, 0.0),
    Readout(math.inf),
    Readout(math.inf, drop_after_us=3.0),
    Aps(0, read_noise_dn=0, bits=None, full_scale_luma=None),
]


def by_name(effect: Effect) -> str:
    return effect.name


def words(effect: Effect) -> dict[str, Any]:
    """Its parameters, infinity as a word."""
    return {name: "inf" if value == math.inf else value for name, value in effect.settings().items()}


# Composition.


@pytest.mark.parametrize("effect", ALL, ids=by_name)
def test_an_effect_is_an_argument_of_its_own_name(effect: Effect) -> None:
    """As an object, among those that are on; its class is listed under that name, and all others are off."""
    arguments: dict[str, Any] = {effect.name: effect}
    effects = Effects(**arguments)
    assert list(effects) == [effect]
    assert effects
    assert getattr(effects, effect.name) is effect
    assert EFFECTS[effect.name] is type(effect)
    assert json.loads(json.dumps(effects.describe())) == {effect.name: words(effect)}
    assert effects == Effects.of([effect])
    assert hash(effects) == hash(Effects.of([effect]))
    assert effects != Effects()
    assert pickle.loads(pickle.dumps(effects)) == effects


@pytest.mark.parametrize("effect", NEUTRAL, ids=repr)
def test_a_neutral_effect_is_off(effect: Effect) -> None:
    """It is not among those that are on, and nothing of it reaches the engine."""
    assert effect.neutral
    effects = Effects.of([effect])
    assert effects == Effects()
    assert not effects
    assert effects.engine_settings() == effects.describe() == {}


def test_a_number_is_the_first_parameter() -> None:
    """As ``leak_rate_hz=0.1``; zero is off."""
    effects = Effects(
        photoreceptor_bandwidth_hz=300, threshold_mismatch=0.1, refractory_period_us=5, leak_rate_hz=0.2, readout=1e6
    )
    assert list(effects) == [
        PhotoreceptorBandwidth(300),
        ThresholdMismatch(0.1),
        RefractoryPeriod(5),
        LeakRate(0.2),
        Readout(1e6),
    ]
    others = Effects(vignetting=2.0, lens_blur_px=0.5, shot_noise_rms=3.0, hot_pixels=0.1, aps=5_000)
    assert list(others) == [Vignetting(2.0), LensBlur(0.5), ShotNoise(3.0), HotPixels(0.1), Aps(5_000)]
    assert Effects(leak_rate_hz=0, readout=math.inf) == Effects()


def test_effects_come_in_the_order_in_which_light_and_events_meet_them() -> None:
    """However they were given; of several of one kind the last is taken."""
    effects = Effects.of(reversed(ALL))
    assert list(effects) == ALL
    assert (
        [effect.name for effect in ALL]
        == list(EFFECTS)
        == [field.name for field in dataclasses.fields(effects) if field.compare]
    )
    assert Effects.of([LeakRate(1), LeakRate(2)]) == Effects(leak_rate_hz=2)
    assert Effects.of([LeakRate(1), LeakRate(0)]) == Effects()


def test_each_effect_is_documented_and_planned() -> None:
    """A row of docs/effects.md says where it acts; the plan estimates all that act on events."""
    rows = re.findall(r"^\| `(\w+)` \| ([\w ]+) \|", (ROOT / "docs/effects.md").read_text(), re.M)
    assert rows == [(name, effect.acts_on) for name, effect in EFFECTS.items()]
    assert set(ESTIMATORS) == set(EFFECTS.values()) - {Aps}


def test_the_engine_gets_what_it_carries_out() -> None:
    """All that acts on the log signal, in the pixel and on the stream, with all parameters."""
    settings = Effects.of(ALL).engine_settings()
    assert list(settings) == [effect.name for effect in ALL if effect.acts_on in ("log intensity", "pixel", "stream")]
    assert settings["readout"] == {
        "events_per_s": 12e6,
        "latency_us": 0.0,
        "jitter_us": 0.0,
        "drop_after_us": None,
        "row_us": 0.0,
        "by_columns": 0,
    }
    assert settings["photoreceptor_bandwidth_hz"] == {"hz": 300.0, "source_follower_hz": 3e3}
    CrossingEngine(2, 2, effects=settings)


def test_effects_do_not_change() -> None:
    """Neither the composition nor an effect."""
    with pytest.raises(dataclasses.FrozenInstanceError):
        Effects().leak_rate_hz = LeakRate(1)  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        LeakRate(1).rate_hz = 2  # type: ignore[misc]


def test_an_effect_that_is_not_there_is_refused() -> None:
    """By its name."""
    with pytest.raises(TypeError, match="leak_rate"):
        Effects(leak_rate=0.1)  # type: ignore[call-arg]
    with pytest.raises(ValueError, match=r"no effect 'leak_rate'; .*did you mean leak_rate_hz"):
        CrossingEngine(1, 1, effects={"leak_rate": {"rate_hz": 1.0}})
    with pytest.raises(ValueError, match=r"leak_rate_hz.*rate_hz"):
        CrossingEngine(1, 1, effects={"leak_rate_hz": {}})
    with pytest.raises(ValueError, match=r"effects must be Effects, a mapping by name, or texts NAME=VALUE, got 3"):
        CrossingEngine(1, 1, effects=3)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="vignetting does not act in the crossing engine"):
        CrossingEngine(1, 1, effects="vignetting")
    with pytest.raises(davis_rs.ArgumentError, match="is for a scene that can be rendered"):
        CrossingEngine(1, 1, effects="auto")
    # As the core is told, without a parser.
    with pytest.raises(ValueError, match='no effect "leak_rate" of the crossing engine'):
        check_effects({"leak_rate": {"rate_hz": 1.0}})
    with pytest.raises(ValueError, match="leak_rate_hz must have rate_hz"):
        check_effects({"leak_rate_hz": {}})


# The command line's words.


@pytest.mark.parametrize(
    ("text", "effect"),
    [
        ("vignetting", Vignetting()),
        ("readout", Readout()),
        ("aps", Aps()),
        ("leak_rate_hz=0.1", LeakRate(0.1)),
        ("leak_rate_hz=rate_hz=0.1", LeakRate(0.1)),
        ("leak_rate_hz=1e-1", LeakRate(0.1)),
        ("refractory_period_us=100", RefractoryPeriod(100)),
        ("shot_noise_rms=5,half_luma=0.2", ShotNoise(5, 0.2)),
        ("shot_noise_rms=half_luma=0.2,rms=5", ShotNoise(5, 0.2)),
        ("hot_pixels=0.01,rate_hz=200", HotPixels(0.01, 200)),
        ("readout=latency_us=3", Readout(latency_us=3)),
        ("readout=1e6,drop_after_us=50,jitter_us=.5", Readout(1e6, 0.0, 0.5, 50)),
        ("readout=inf,drop_after_us=none", Readout(math.inf)),
        ("photoreceptor_bandwidth_hz=inf,source_follower_hz=1e4", PhotoreceptorBandwidth(math.inf, 1e4)),
        ("aps=10000,bits=8,full_scale_luma=NONE", Aps(10_000, bits=8, full_scale_luma=None)),
        ("threshold_mismatch=0", ThresholdMismatch(0)),
    ],
)
def test_words_are_effects(text: str, effect: Effect) -> None:
    """A name alone, with a value, with parameters in any order; ``none`` and ``inf`` among the values."""
    assert parse_effect(text) == effect


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "there is no effect ''; there are vignetting, lens_blur_px, "),
        ("leak", "there is no effect 'leak'; there are "),
        ("=3", "there is no effect ''"),
        ("leak_rate_hz", "effect leak_rate_hz needs a value: leak_rate_hz=RATE_HZ"),
        ("leak_rate_hz=", "effect leak_rate_hz needs a value: leak_rate_hz=RATE_HZ"),
        ("hot_pixels=rate_hz=3", "effect hot_pixels needs a value: hot_pixels=FRACTION"),
        (
            "hot_pixels=0.1,rate=3",
            "effect hot_pixels has the parameters fraction, rate_hz, rate_spread, least_cv, most_cv, got 'rate=3'",
        ),
        (
            "hot_pixels=0.1,3",
            "effect hot_pixels has the parameters fraction, rate_hz, rate_spread, least_cv, most_cv, got '3'",
        ),
        (
            "hot_pixels=0.1,",
            "effect hot_pixels has the parameters fraction, rate_hz, rate_spread, least_cv, most_cv, got ''",
        ),
        ("leak_rate_hz=fast", "leak_rate_hz rate_hz must be a number or none, got 'fast'"),
        ("leak_rate_hz=1Hz", "leak_rate_hz rate_hz must be a number or none, got '1Hz'"),
        ("leak_rate_hz=rate_hz=", "leak_rate_hz rate_hz must be a number or none, got ''"),
        ("leak_rate_hz=²", "leak_rate_hz rate_hz must be a number or none, got '²'"),
        ("leak_rate_hz=-1", "leak_rate_hz must lie in 0..1e6 Hz, got -1"),
        ("leak_rate_hz=none", "leak_rate_hz"),
        ("readout=none", "readout"),
        ("leak_rate_hz=1" + "0" * 400, "leak_rate_hz"),
        ("vignetting=1" + "0" * 400, "vignetting"),
    ],
)
def test_words_that_make_no_effect_are_refused(text: str, message: str) -> None:
    """With what there is, what is missing, or what was not understood."""
    with pytest.raises(ValueError, match=re.escape(message)):
        parse_effect(text)


# Nonsense.

NONSENSE: list[tuple[type[Effect], dict[str, Any], str]] = [
    (LeakRate, {"rate_hz": -0.1}, "leak_rate_hz must lie in 0..1e6 Hz, got -0.1"),
    (LeakRate, {"rate_hz": math.nan}, "leak_rate_hz must lie in 0..1e6 Hz, got NaN"),
    (LeakRate, {"rate_hz": 1.1e6}, "leak_rate_hz must lie in 0..1e6 Hz, got 1100000"),
    (ThresholdMismatch, {"sigma": -0.1}, "threshold_mismatch must lie in 0..1 of the threshold, got -0.1"),
    (ThresholdMismatch, {"sigma": 1.01}, "threshold_mismatch must lie in 0..1 of the threshold, got 1.01"),
    (ThresholdMismatch, {"sigma": math.nan}, "threshold_mismatch must lie in 0..1 of the threshold, got NaN"),
    (RefractoryPeriod, {"period_us": -1}, "refractory_period_us must lie in 0..1e15 us, got -1"),
    (RefractoryPeriod, {"period_us": math.inf}, "refractory_period_us must lie in 0..1e15 us, got inf"),
    (RefractoryPeriod, {"period_us": math.nan}, "refractory_period_us must lie in 0..1e15 us, got NaN"),
    (ShotNoise, {"rms": -5}, "shot_noise_rms must lie in 0..1e6 of log intensity, got -5"),
    (ShotNoise, {"rms": math.inf}, "shot_noise_rms must lie in 0..1e6 of log intensity, got inf"),
    (ShotNoise, {"rms": 1, "half_luma": 0}, "shot_noise_rms: half_luma must be > 0 units of luma, got 0"),
    (ShotNoise, {"rms": 1, "half_luma": math.nan}, "shot_noise_rms: half_luma must be > 0 units of luma, got NaN"),
    (HotPixels, {"fraction": -0.1}, "hot_pixels: fraction must lie in 0..1 of the pixels, got -0.1"),
    (HotPixels, {"fraction": 1.5}, "hot_pixels: fraction must lie in 0..1 of the pixels, got 1.5"),
    (HotPixels, {"fraction": math.nan}, "hot_pixels: fraction must lie in 0..1 of the pixels, got NaN"),
    (HotPixels, {"fraction": 0.1, "rate_hz": -1}, "hot_pixels: rate_hz must lie in 0..1e7 Hz, got -1"),
    (HotPixels, {"fraction": 0.0, "rate_hz": math.nan}, "hot_pixels: rate_hz must lie in 0..1e7 Hz, got NaN"),
    (PhotoreceptorBandwidth, {"hz": 0}, "photoreceptor_bandwidth_hz must be > 0 Hz, got 0"),
    (PhotoreceptorBandwidth, {"hz": -3}, "photoreceptor_bandwidth_hz must be > 0 Hz, got -3"),
    (PhotoreceptorBandwidth, {"hz": math.nan}, "photoreceptor_bandwidth_hz must be > 0 Hz, got NaN"),
    (
        PhotoreceptorBandwidth,
        {"hz": 9, "source_follower_hz": 0},
        "photoreceptor_bandwidth_hz: source_follower_hz must be 0.001 Hz or more, got 0",
    ),
    (
        PhotoreceptorBandwidth,
        {"hz": 9, "source_follower_hz": math.nan},
        "photoreceptor_bandwidth_hz: source_follower_hz must be 0.001 Hz or more, got NaN",
    ),
    (Readout, {"events_per_s": 0}, "readout: events_per_s must be at least 1 per second, got 0"),
    (Readout, {"events_per_s": -1e6}, "readout: events_per_s must be at least 1 per second, got -1000000"),
    (Readout, {"events_per_s": math.nan}, "readout: events_per_s must be at least 1 per second, got NaN"),
    (Readout, {"latency_us": -1}, "readout: latency_us must lie in 0..1e9 us, got -1"),
    (Readout, {"latency_us": math.inf}, "readout: latency_us must lie in 0..1e9 us, got inf"),
    (Readout, {"jitter_us": math.nan}, "readout: jitter_us must lie in 0..1e9 us, got NaN"),
    (Readout, {"row_us": -0.5}, "readout: row_us must lie in 0..1e9 us, got -0.5"),
    (Readout, {"by_columns": 2}, "readout: by_columns must be 0 or 1, got 2"),
    (LeakRate, {"rate_hz": 1, "spread": 1.5}, "leak_rate_hz: spread must lie in 0..1 of the rate, got 1.5"),
    (LeakRate, {"rate_hz": 1, "double_luma": 0}, "leak_rate_hz: double_luma must be > 0 units of luma, got 0"),
    (HotPixels, {"fraction": 0.1, "least_cv": 0.6}, "hot_pixels: least_cv must lie in 0..0.5 of an interval, got 0.6"),
    (ThresholdMismatch, {"sigma": 0, "column_parity": 0.6}, "threshold_mismatch: column_parity must lie in -0.5..0.5"),
    (Readout, {"drop_after_us": -0.5}, "readout: drop_after_us must lie in 0..1e9 us, got -0.5"),
    (Readout, {"drop_after_us": math.nan}, "readout: drop_after_us must lie in 0..1e9 us, got NaN"),
]


@pytest.mark.parametrize(("kind", "values", "message"), NONSENSE, ids=lambda value: repr(value)[:40])
def test_nonsense_is_refused(kind: type[Effect], values: dict[str, Any], message: str) -> None:
    """By the name of the effect and its parameter, with the value and the allowed range; by the engine as well."""
    with pytest.raises(ValueError, match=re.escape(message)):
        kind(**values)
    on = next(effect for effect in ALL if isinstance(effect, kind))
    with pytest.raises(ValueError, match=re.escape(message)):
        CrossingEngine(1, 1, effects={kind.name: {**on.settings(), **values}})


@pytest.mark.parametrize("kind", [LeakRate, ThresholdMismatch, RefractoryPeriod, ShotNoise, HotPixels, Readout])
@pytest.mark.parametrize("value", ["1", None, [1], LeakRate(1)])
def test_what_is_no_number_is_refused(kind: type[Any], value: Any) -> None:
    """By an error that is about arguments."""
    with pytest.raises((TypeError, ValueError), match="number"):
        kind(value)


@pytest.mark.parametrize("values", [(0.0,), (1e6,), (1e-300,)])
def test_ends_of_a_range_belong_to_it(values: tuple[float]) -> None:
    """Zero, the largest, and what is next to nothing."""
    assert LeakRate(*values).settings()["rate_hz"] == values[0]
    assert ThresholdMismatch(1.0).sigma == 1.0
    assert RefractoryPeriod(1e15).period_us == 1e15
    assert PhotoreceptorBandwidth(9.0, 1e-3).source_follower_hz == 1e-3
    assert ShotNoise(0.1, math.inf).half_luma == math.inf


def test_a_seed_out_of_range_is_refused() -> None:
    """Seeds are whole numbers of 64 bits; both ends are taken."""
    for seed in (0, 2**64 - 1):
        CrossingEngine(1, 1, seed=seed)
    for seed in (-1, 2**64):
        with pytest.raises(ValueError, match=re.escape(f"got {seed}")):
            CrossingEngine(1, 1, seed=seed)


@pytest.mark.parametrize("form", FORMS)
def test_effects_are_taken_in_one_grammar_everywhere(form: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a simulator, a run over frames, the engine and the planner; the simulation plans what it is asked for."""
    assert repr(CrossingEngine(2, 2, effects=form)) == repr(CrossingEngine(2, 2, effects=FORMS[0]))
    assert pickle.dumps(CrossingEngine(2, 2, effects=form)) == pickle.dumps(CrossingEngine(2, 2, effects=FORMS[0]))
    assert Simulator(PLANES, size=(6, 4), effects=form).effects == FORMS[0]
    frames = ArrayFrames(np.ones((2, 4, 6), np.float32), [0, 1000])
    assert FrameRun(frames, complete(FrameSettings, {"effects": form}, taker="a test")).effects == FORMS[0]
    taken: list[Effects] = []
    monkeypatch.setattr(
        planner, "plan_effects_of", lambda _, __, effects, *, keep, **___: taken.extend([effects, keep])
    )
    planner.plan_effects(PLANES, form, keep={"leak_rate_hz": 0.5}, size=(6, 4), sensor="ideal")
    assert taken == [Effects(hot_pixels=HotPixels(0.01, rate_hz=9)), Effects(leak_rate_hz=0.5)]
    assert read_effects(form) == (FORMS[0], False)


def test_dataclasses_replace_keeps_what_was_switched_off() -> None:
    effects = Effects(leak_rate_hz=0.1, refractory_period_us=100, hot_pixels=0)
    changed = dataclasses.replace(effects, leak_rate_hz=None)
    assert changed == Effects(refractory_period_us=100)
    assert changed.switched_off == effects.switched_off == {"hot_pixels"}
    back = dataclasses.replace(effects, hot_pixels=HotPixels(0.01))
    assert back.hot_pixels == HotPixels(0.01)
    assert back.switched_off == frozenset()
    assert pickle.loads(pickle.dumps(changed)).switched_off == {"hot_pixels"}
    with pytest.raises(ValueError, match="there is no effect 'leek'"):
        Effects(switched_off={"leek"})


def test_one_effect_may_stand_alone_and_auto_among_others() -> None:
    assert read_effects("leak_rate_hz=0.5") == read_effects(LeakRate(0.5)) == (Effects(leak_rate_hz=0.5), False)
    assert read_effects("auto") == (Effects(), True)
    assert read_effects(["auto", "leak_rate_hz=0.5"]) == (Effects(leak_rate_hz=0.5), True)
    assert read_effects({"leak_rate_hz": 0})[0].switched_off == {"leak_rate_hz"}
    assert read_effects({"readout": {}})[0] == Effects(readout=Readout())
    with pytest.raises(ValueError, match=r"effects='auto' must be resolved before a simulator is made: .*simulate\("):
        Simulator(PLANES, effects=["auto", "leak_rate_hz=0.5"])
    with pytest.raises(ValueError, match="effects='auto' is for a scene that can be rendered; for frames name sensor"):
        davis_rs.events_from_frames(np.ones((2, 4, 6), np.float32), fps=9, effects="auto")


@pytest.mark.parametrize(
    ("form", "message"),
    [
        ({"leak": 1}, "there is no effect 'leak'; there are vignetting"),
        ({"shot_noise_rate_hz": 1}, "did you mean shot_noise_rms? (shot_noise_rate_hz in v2e; here an rms"),
        ({"hot_pixels": {"frac": 1}}, "hot_pixels has the parameters fraction, rate_hz, rate_spread"),
        ({"hot_pixels": {"frac": 1}}, "got 'frac'; did you mean fraction?"),
        ({"hot_pixels": {"rate_hz": 1}}, "effect hot_pixels needs a value: hot_pixels=FRACTION"),
        ({"readout": None}, "effect readout must be Readout, a number, or a mapping, got None"),
        ({"leak_rate_hz": "0.1"}, "leak_rate_hz: rate_hz must be a number, got '0.1'"),
        (
            {"leak_rate_hz": HotPixels(0.1)},
            "must be LeakRate, a number, or a mapping, got HotPixels",
        ),
        ([3], "effects must be Effects, a mapping by name, or texts NAME=VALUE, got 3"),
        ([{"leak_rate_hz": 1}], "got {'leak_rate_hz': 1}"),
    ],
)
def test_effects_that_are_none_are_refused_by_name(form: Any, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        Simulator(PLANES, effects=form)


def test_an_argument_of_effects_that_is_none_is_told_with_the_closest() -> None:
    with pytest.raises(TypeError, match=r"Effects has no argument 'leak_rate'; did you mean leak_rate_hz\?"):
        Effects(leak_rate=0.1)  # type: ignore[call-arg]
    with pytest.raises(
        TypeError, match=r"did you mean shot_noise_rms\? \(shot_noise_rate_hz in v2e; .*ShotNoise.of_rate"
    ):
        Effects(shot_noise_rate_hz=0.1)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"has no argument 'pos_thres' \(pos_thres in v2e is contrast_threshold here\)"):
        Effects(pos_thres=0.1)  # type: ignore[call-arg]
