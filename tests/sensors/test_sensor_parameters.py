"""Sensors: bias currents and words, the formulas from biases to behaviour, what they refuse, and the presets."""

from __future__ import annotations

import math
import re
from dataclasses import FrozenInstanceError, fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from davis_rs.sensor.biases import (
    BIAS_SETS,
    DAVIS240C_BIASES,
    DAVIS346_BIASES,
    ChipBias,
    CoarseFineBias,
    as_biases,
    bias_of_word,
)
from davis_rs.sensor.effects import (
    Aps,
    Effects,
    HotPixels,
    LeakRate,
    PhotoreceptorBandwidth,
    Readout,
    ShotNoise,
    ThresholdMismatch,
)
from davis_rs.sensor.parameters import SensorParameters
from davis_rs.sensor.presets import SENSORS

COARSE, FINE = st.integers(0, 7), st.integers(0, 255)
BIASES = st.builds(CoarseFineBias, COARSE, FINE)
LIT = st.builds(CoarseFineBias, COARSE, st.integers(1, 255))


@pytest.mark.parametrize(
    ("coarse", "current_a"),
    list(enumerate([11e-12, 94e-12, 756e-12, 6054e-12, 48437e-12, 387500e-12, 3.1e-6, 24.8e-6])),
)
def test_currents_are_those_of_the_table(coarse: int, current_a: float) -> None:
    """The coarse value's current at full scale, a 255th share of it for each fine step, nothing at 0."""
    assert CoarseFineBias(coarse, 255).current_a == pytest.approx(current_a, rel=1e-12)
    assert CoarseFineBias(coarse, 51).current_a == pytest.approx(current_a / 5, rel=1e-12)
    assert CoarseFineBias(coarse, 0).current_a == 0


@pytest.mark.parametrize(
    ("coarse", "fine", "message"),
    [
        (8, 0, "coarse must be an integer in 0..7, got 8"),
        (-1, 0, "coarse must be an integer in 0..7, got -1"),
        (0, 256, "fine must be an integer in 0..255, got 256"),
        (0, 1.5, "fine must be an integer in 0..255, got 1.5"),
        (True, 1, "coarse must be an integer in 0..7, got True"),
    ],
)
def test_biases_out_of_range_are_refused(coarse: Any, fine: Any, message: str) -> None:
    """Such a value would spill into the word's other bits."""
    with pytest.raises(ValueError, match=re.escape(message)):
        CoarseFineBias(coarse, fine)


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("DiffBn", 17023),  # 4/39, N: the word that the drivers send
        ("PrSFBp", 1 << 12 | 16 << 4 | 0b1101),  # a P bias has bit 1 clear
        ("ApsCasEpc", 5 << 12 | 185 << 4 | 0b1011),  # a cascode has bit 2 clear
    ],
)
def test_words_hold_the_bits_of_the_chip(name: str, word: int) -> None:
    """Bit 0 enabled, 1 N-type, 2 not cascode, 3 normal current, 4-11 fine, 12-14 coarse."""
    assert DAVIS240C_BIASES[name].word() == word


@given(bias=BIASES, n_type=st.booleans(), cascode=st.booleans())
def test_a_word_gives_its_bias_back(bias: CoarseFineBias, n_type: bool, cascode: bool) -> None:
    """Coarse and fine survive the word whatever the kind of the bias, and the word has 15 bits."""
    word = ChipBias("any", 0, CoarseFineBias(0, 0), n_type, cascode).word(bias)
    assert 0 <= word < 1 << 15
    assert bias_of_word(word) == bias


@pytest.mark.parametrize("word", [-1, 1 << 15])
def test_words_of_more_bits_are_refused(word: int) -> None:
    """They are no coarse-fine words."""
    with pytest.raises(ValueError, match=rf"must lie in 0\.\.32767, got {word}"):
        bias_of_word(word)


@pytest.mark.parametrize("chip", [DAVIS240C_BIASES, DAVIS346_BIASES], ids=["240C", "346"])
def test_addresses_are_unique(chip: dict[str, ChipBias]) -> None:
    """Two biases at one address would overwrite each other; P biases end in Bp, as the drivers name them."""
    assert len({bias.address for bias in chip.values()}) == len(chip)
    assert all(bias.name == name for name, bias in chip.items())
    assert [name for name, bias in chip.items() if not bias.n_type] == [n for n in chip if n.endswith("Bp")]


def test_addresses_of_both_chips() -> None:
    """The six biases of the event pixel are elsewhere on the DAVIS346."""
    six = ["DiffBn", "OnBn", "OffBn", "PrBp", "PrSFBp", "RefrBp"]
    assert [DAVIS240C_BIASES[name].address for name in six] == [0, 1, 2, 8, 9, 10]
    assert [DAVIS346_BIASES[name].address for name in six] == [10, 11, 12, 14, 15, 16]
    assert all(list(biases) == six for biases in BIAS_SETS.values())


def test_bias_names_in_any_case() -> None:
    """The dataset's paper writes ONBn, the drivers OnBn: one bias, of which the second spelling is refused."""
    assert as_biases({"ONBn": (6, 200)}) == {"OnBn": CoarseFineBias(6, 200)}
    with pytest.raises(ValueError, match="bias OnBn is given twice, the second time as 'OnBn'"):
        as_biases({"ONBn": (6, 200), "OnBn": (6, 201)})


@pytest.mark.parametrize(
    ("biases", "message"),
    [
        ("lab", "there is no set of biases 'lab'; there is indoors and outdoors"),
        ({"OnBp": (1, 2)}, "there is no bias 'OnBp'; there are DiffBn, OnBn"),
        ({"OnBn": (1, 256)}, "bias OnBn must be (coarse, fine), got (1, 256): fine must be an integer in 0..255"),
        ({"OnBn": (1,)}, "bias OnBn must be (coarse, fine), got (1,)"),
        ({"OnBn": 7}, "bias OnBn must be (coarse, fine), got 7"),
    ],
)
def test_biases_that_do_not_exist_are_refused(biases: Any, message: str) -> None:
    """A misspelt bias must not count as one that is not given."""
    with pytest.raises(ValueError, match=re.escape(message)):
        SensorParameters.from_biases(biases)


def test_the_indoor_biases() -> None:
    """Thresholds and refractory period of the paper's set, whose photoreceptor is slower than the source follower."""
    sensor = SensorParameters.from_biases("indoors", source_follower_bandwidth_hz=None)
    assert sensor.contrast_threshold == pytest.approx(0.414, abs=5e-4)
    assert sensor.contrast_threshold_off == pytest.approx(0.116, abs=5e-4)
    assert sensor.refractory_period_us == pytest.approx(12.96, abs=5e-3)
    assert sensor.source_follower_bandwidth_hz is None
    assert sensor.photoreceptor_bandwidth_hz is None


def test_the_outdoor_biases() -> None:
    """Its OFF threshold is given, the rest follows; what is given goes in unchanged, whatever it is."""
    sensor = SensorParameters.from_biases("outdoors", contrast_threshold_off=0.2, leak_rate_hz=0.1)
    assert sensor.contrast_threshold == pytest.approx(0.414, abs=5e-4)
    assert sensor.source_follower_bandwidth_hz == pytest.approx(590, abs=1)
    assert sensor.refractory_period_us == pytest.approx(3.37, abs=5e-3)
    assert (sensor.contrast_threshold_off, sensor.leak_rate_hz) == (0.2, 0.1)
    assert sensor == replace(
        SensorParameters.from_biases(BIAS_SETS["outdoors"], contrast_threshold_off=0.2), leak_rate_hz=0.1
    )


@pytest.mark.parametrize(
    ("biases", "known", "message"),
    [
        (
            "outdoors",
            {},
            "contrast_threshold_off does not follow from these biases: OffBn is 4/0, for which the table of currents "
            "gives 0 A; give it, as in from_biases(..., contrast_threshold_off=...), or None",
        ),
        (
            {**BIAS_SETS["indoors"], "OnBn": (1, 255)},
            {},
            "contrast_threshold does not follow from these biases: OnBn 1/255 (9.4e-11 A) must be more than "
            "DiffBn 2/39 (1.16e-10 A)",
        ),
        (
            {**BIAS_SETS["indoors"], "OffBn": (2, 39)},
            {},
            "contrast_threshold_off does not follow from these biases: OffBn 2/39 (1.16e-10 A) must be less than "
            "DiffBn 2/39 (1.16e-10 A)",
        ),
        (
            {**BIAS_SETS["outdoors"], "RefrBp": (4, 0)},
            {"contrast_threshold_off": 0.2},
            "refractory_period_us does not follow from these biases: RefrBp is 4/0",
        ),
        (
            {"OnBn": (5, 255)},
            {},
            "contrast_threshold does not follow from these biases: it needs DiffBn, which is not among them",
        ),
        (
            "indoors",
            {},
            "source_follower_bandwidth_hz does not follow from these biases: PrSFBp 3/96 (2.28e-09 A) must be at most "
            "half of PrBp 3/72 (1.71e-09 A)",
        ),
    ],
    ids=["no OFF current", "ON below the amplifier", "OFF not below", "no reset current", "missing", "fast follower"],
)
def test_what_the_formulas_do_not_cover_is_refused(biases: Any, known: dict[str, float], message: str) -> None:
    """The error says which quantity, why, and what to do, where the formula would give NaN or nonsense."""
    with pytest.raises(ValueError, match=re.escape(message)):
        SensorParameters.from_biases(biases, **known)


def test_no_bias_is_needed_for_what_is_known() -> None:
    """A set of one bias gives the one quantity that depends on it."""
    sensor = SensorParameters.from_biases(
        {"RefrBp": (3, 52)}, contrast_threshold=0.3, contrast_threshold_off=None, source_follower_bandwidth_hz=None
    )
    assert sensor.refractory_period_us == pytest.approx(12.96, abs=5e-3)
    with pytest.raises(TypeError, match="bandwith"):
        SensorParameters.from_biases("indoors", photoreceptor_bandwith_hz=1.0)


def off_threshold(bias: CoarseFineBias) -> float:
    """C_off of a sensor with this OffBn and a strong amplifier."""
    sensor = SensorParameters.from_biases(
        {"DiffBn": (7, 255), "OffBn": bias},
        contrast_threshold=0.3,
        source_follower_bandwidth_hz=None,
        refractory_period_us=None,
    )
    assert sensor.contrast_threshold_off is not None
    return sensor.contrast_threshold_off


def on_threshold(bias: CoarseFineBias) -> float:
    """C_on of a sensor with this OnBn and a weak amplifier."""
    sensor = SensorParameters.from_biases(
        {"DiffBn": (0, 1), "OnBn": bias},
        contrast_threshold_off=0.3,
        source_follower_bandwidth_hz=None,
        refractory_period_us=None,
    )
    assert sensor.contrast_threshold is not None
    return sensor.contrast_threshold


@given(one=LIT, other=LIT)
def test_thresholds_grow_with_the_distance_from_the_amplifier(one: CoarseFineBias, other: CoarseFineBias) -> None:
    """More current in OnBn is a larger ON threshold, more in OffBn a smaller OFF threshold; strictly, as logarithms."""
    less, more = sorted((one, other), key=lambda bias: bias.current_a)
    assume(CoarseFineBias(0, 1).current_a < less.current_a < more.current_a < CoarseFineBias(7, 255).current_a)
    ratio = math.log(more.current_a / less.current_a) / 14
    assert on_threshold(more) - on_threshold(less) == pytest.approx(ratio, rel=1e-9, abs=1e-12)
    assert off_threshold(less) - off_threshold(more) == pytest.approx(ratio, rel=1e-9, abs=1e-12)
    assert 0 < on_threshold(less) < on_threshold(more)
    assert off_threshold(less) > off_threshold(more) > 0


@given(one=LIT, other=LIT)
def test_more_current_is_a_faster_pixel(one: CoarseFineBias, other: CoarseFineBias) -> None:
    """The bandwidth is proportional to the follower's current, the refractory period goes with one over RefrBp."""
    bandwidths, periods = [], []
    for bias in (one, other):
        sensor = SensorParameters.from_biases(
            {"PrSFBp": bias, "RefrBp": bias}, contrast_threshold=0.3, contrast_threshold_off=0.3
        )
        assert sensor.source_follower_bandwidth_hz is not None
        assert sensor.refractory_period_us is not None
        bandwidths.append(sensor.source_follower_bandwidth_hz)
        periods.append(sensor.refractory_period_us)
    ratio = one.current_a / other.current_a
    assert bandwidths[0] / bandwidths[1] == pytest.approx(ratio, rel=1e-9)
    assert periods[1] / periods[0] == pytest.approx(ratio, rel=1e-9)


NAMES = [field.name for field in fields(SensorParameters) if not field.name.startswith("colour_")]  # those are texts
ZERO_IS_OFF = {
    *["threshold_mismatch", "refractory_period_us", "leak_rate_hz"],
    *["shot_noise_rms", "hot_pixel_fraction", "hot_pixel_rate_hz", "readout_latency_us", "readout_jitter_us"],
    *[
        "leak_spread",
        "leak_jitter",
        "temperature_c",
        "threshold_column_parity",
        "threshold_correlation",
        "shot_noise_floor",
        "readout_row_us",
        "readout_by_columns",
        "aps_read_noise_dn",
        *["aps_prnu", "aps_dsnu_dn", "aps_column_offset_dn", "aps_column_noise_dn", "aps_row_readout_us"],
        "vignetting",
        "lens_blur_px",
    ],
}


@pytest.mark.parametrize("name", NAMES)
def test_nonsense_is_refused_by_name(name: str) -> None:
    """Every quantity refuses what is negative, infinite, not a number at all, or zero where zero means nothing."""
    negative = [] if name in ("temperature_c", "threshold_column_parity", "threshold_correlation") else [-1e-9]
    for value in (*negative, math.inf, -math.inf, math.nan, True, "1"):
        with pytest.raises(ValueError, match=rf"^{name} must .*, got {re.escape(repr(value))}$"):
            SensorParameters(**{name: value})  # type: ignore[arg-type]
    if name in ZERO_IS_OFF:
        assert getattr(SensorParameters(**{name: 0}), name) == 0  # type: ignore[arg-type]
    else:
        with pytest.raises(ValueError, match=rf"^{name} must be finite and > 0, got 0$"):
            SensorParameters(**{name: 0})  # type: ignore[arg-type]


def test_a_share_is_at_most_all() -> None:
    """More than all pixels cannot be hot."""
    with pytest.raises(ValueError, match=r"hot_pixel_fraction must lie in 0\.\.1, got 1.5"):
        SensorParameters(hot_pixel_fraction=1.5)
    with pytest.raises(ValueError, match=r"readout_by_columns must be 0 or 1, got 0.5"):
        SensorParameters(readout_by_columns=0.5)  # type: ignore[arg-type]


def test_a_sensor_does_not_change() -> None:
    """Presets are shared: who wants another value makes another sensor."""
    sensor = SENSORS["davis240c"]
    with pytest.raises(FrozenInstanceError):
        sensor.leak_rate_hz = 1.0  # type: ignore[misc]
    assert replace(sensor, leak_rate_hz=1.0).leak_rate_hz == 1.0


def test_the_ideal_sensor_has_no_effect() -> None:
    """Every effect is off, in any light."""
    assert SENSORS["ideal"] == SensorParameters()
    assert SENSORS["ideal"].effects(50.0) == Effects()


@pytest.mark.parametrize(
    ("name", "on", "off", "deviation"), [("davis240c", 0.283, None, 0.035), ("davis346", 0.283, 0.262, 0.03)]
)
def test_the_presets_have_the_published_figures(name: str, on: float, off: float | None, deviation: float) -> None:
    """Driver's default biases through the formulas, and the figures of the papers in their units."""
    sensor = SENSORS[name]
    assert sensor.contrast_threshold == pytest.approx(on, abs=5e-4)
    assert sensor.contrast_threshold_off == (off and pytest.approx(off, abs=5e-4))
    assert sensor.threshold_mismatch is not None
    parity = sensor.threshold_column_parity or 0.0
    assert math.hypot(sensor.threshold_mismatch, parity) * on == pytest.approx(deviation, rel=2e-3)
    assert sensor.refractory_period_us == pytest.approx(3.37, abs=5e-3)
    assert sensor.source_follower_bandwidth_hz == pytest.approx(286, abs=0.5)
    assert sensor.readout_events_per_s == (9e6 if name == "davis240c" else 12e6)
    assert bool(sensor.readout_by_columns) == (name == "davis346")
    assert sensor.leak_rate_hz == (0.011 if name == "davis240c" else 0.003)


@pytest.mark.parametrize("name", ["davis240c", "davis346"])
def test_light_reaches_the_effects_in_lux(name: str) -> None:
    """At 1000 lux a luma the photoreceptor has its 3 kHz at luma 1, at 100 lux a tenth; noise goes by lux, too."""
    bright, dim = (SENSORS[name].effects(lux_per_luma) for lux_per_luma in (1000.0, 100.0))
    for effects, lux_per_luma in ((bright, 1000.0), (dim, 100.0)):
        bandwidth, noise = effects.photoreceptor_bandwidth_hz, effects.shot_noise_rms
        assert isinstance(bandwidth, PhotoreceptorBandwidth)
        assert bandwidth.hz == pytest.approx(3 * lux_per_luma)
        assert bandwidth.source_follower_hz == pytest.approx(286, abs=0.5)
        assert isinstance(noise, ShotNoise)
        on = SENSORS[name].contrast_threshold
        assert on is not None
        rates = noise.rate_hz(on, on, np.geomspace(0.1, 1000, 2000) / lux_per_luma)
        assert rates.max() == pytest.approx(0.22 if name == "davis240c" else 0.07, abs=0.02)
        assert 1e-3 < noise.rate_hz(on, on, 0.5 / lux_per_luma) < 0.1
        assert noise.rate_hz(on, on, 300 / lux_per_luma) < 1e-3
        assert noise.bandwidth_hz == bandwidth.source_follower_hz
        # Where both poles are alike.
        assert bandwidth.hz * noise.half_luma == pytest.approx(bandwidth.source_follower_hz)
    assert bright != dim


@pytest.mark.parametrize("name", ["davis240c", "davis346"])
def test_the_photoreceptor_is_never_slower_than_its_dark_current(name: str) -> None:
    """Half a lux of dark current is 1.5 Hz, whatever the scene's scale; at 33 degrees twice as much."""
    for lux_per_luma in (0.1, 2.0, 1e4):
        sensor = SENSORS[name]
        dark = sensor.dark_luma(lux_per_luma)
        bandwidth = sensor.effects(lux_per_luma).photoreceptor_bandwidth_hz
        assert dark is not None
        assert bandwidth is not None
        assert bandwidth.hz * dark == pytest.approx(1.5)
        assert replace(sensor, temperature_c=33.0).dark_luma(lux_per_luma) == pytest.approx(2 * dark)
    assert SensorParameters().dark_luma(1.0) is None


def test_every_quantity_reaches_its_effect() -> None:
    """No parameter of a sensor is forgotten on its way."""
    effects = SensorParameters(
        threshold_mismatch=0.1,
        threshold_column_parity=-0.05,
        photoreceptor_bandwidth_hz=200.0,
        photoreceptor_bandwidth_lux=50.0,
        source_follower_bandwidth_hz=7.0,
        refractory_period_us=12.0,
        leak_rate_hz=0.3,
        leak_spread=0.2,
        leak_jitter=0.05,
        leak_double_lux=50.0,
        temperature_c=40.0,
        shot_noise_rms=0.04,
        shot_noise_half_lux=5.0,
        shot_noise_bandwidth_hz=70.0,
        hot_pixel_fraction=0.01,
        hot_pixel_rate_hz=40.0,
        readout_events_per_s=1e6,
        readout_row_us=0.4,
        readout_latency_us=4.0,
        readout_jitter_us=2.0,
        readout_by_columns=1,
        aps_exposure_us=3000.0,
        aps_read_noise_dn=1.5,
        aps_bits=8,
        aps_full_scale_lux=400.0,
        aps_full_well_e=9_000.0,
        aps_electrons_per_dn=30.0,
        aps_prnu=0.01,
        aps_dsnu_dn=2.0,
        aps_column_offset_dn=3.0,
        aps_column_noise_dn=0.5,
        aps_row_readout_us=12.0,
        vignetting=4.0,
        lens_blur_px=0.6,
    ).effects(200.0)
    assert effects == Effects(
        vignetting=4.0,
        lens_blur_px=0.6,
        photoreceptor_bandwidth_hz=PhotoreceptorBandwidth(800.0, source_follower_hz=7.0),
        threshold_mismatch=ThresholdMismatch(0.1, -0.05),
        refractory_period_us=12.0,
        leak_rate_hz=LeakRate(0.3, 0.2, 0.05, 40.0, double_luma=0.25),
        shot_noise_rms=ShotNoise(0.04, half_luma=0.025, bandwidth_hz=70.0),
        hot_pixels=HotPixels(0.01, rate_hz=40.0),
        readout=Readout(1e6, row_us=0.4, latency_us=4.0, jitter_us=2.0, by_columns=1),
        aps=Aps(3000.0, 1.5, 8, 2.0, 9_000.0, 30.0, 0.01, 2.0, 3.0, 0.5, 12.0),
    )


def test_a_source_follower_from_biases_holds_in_any_light() -> None:
    """The formula knows no light: the only corner, whatever the scene's scale."""
    sensor = SensorParameters.from_biases("outdoors", contrast_threshold_off=0.2)
    for lux_per_luma in (1.0, 1e5):
        bandwidth = sensor.effects(lux_per_luma).photoreceptor_bandwidth_hz
        assert isinstance(bandwidth, PhotoreceptorBandwidth)
        assert bandwidth.hz == math.inf
        assert bandwidth.source_follower_hz == pytest.approx(590, abs=1)


def test_sensors_work_by_starlight_and_in_the_sun() -> None:
    """No scale of light makes parameters that the effects refuse."""
    for lux_per_luma in (1e-6, 1e-4, 1e17):
        assert SENSORS["davis240c"].effects(lux_per_luma).photoreceptor_bandwidth_hz is not None


def test_noise_has_the_poles_of_the_photoreceptor_unless_it_is_told_others() -> None:
    """Both from the sensor's corners, each replaced by its own value; the effect's own where nothing is known."""
    sensor = SensorParameters(
        photoreceptor_bandwidth_hz=30.0,
        photoreceptor_bandwidth_lux=10.0,
        source_follower_bandwidth_hz=600.0,
        shot_noise_rms=0.1,
    )
    assert sensor.effects(100.0).shot_noise_rms == ShotNoise(0.1, half_luma=2.0, bandwidth_hz=600.0)
    told = replace(sensor, shot_noise_half_lux=50.0, shot_noise_bandwidth_hz=70.0)
    assert told.effects(100.0).shot_noise_rms == ShotNoise(0.1, half_luma=0.5, bandwidth_hz=70.0)
    assert SensorParameters(shot_noise_rms=0.1).effects(100.0).shot_noise_rms == ShotNoise(0.1)


@pytest.mark.parametrize("name", ["photoreceptor_bandwidth_hz", "photoreceptor_bandwidth_lux"])
def test_a_corner_belongs_to_an_illuminance(name: str) -> None:
    """One without the other is refused, and the source follower named, which depends on no light."""
    with pytest.raises(ValueError, match=r"belong together, got .*; a corner that does not depend on light is source_"):
        SensorParameters(**{name: 3.0})  # type: ignore[arg-type]


@pytest.mark.parametrize("lux_per_luma", [0.0, -1.0, math.inf, math.nan])
def test_a_scale_of_light_must_be_positive(lux_per_luma: float) -> None:
    """Without it neither the bandwidth nor the noise has a place on the scale of luma."""
    with pytest.raises(ValueError, match=r"lux_per_luma must be finite and >=? 0 lux, got"):
        SENSORS["davis240c"].effects(lux_per_luma)
