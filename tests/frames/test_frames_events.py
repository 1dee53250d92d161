"""Events from frames: those of the exact oracle, with all settings, in bounded memory."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import davis_rs
from clips import moving_bars
from davis_rs import CrossingEngine, Effects, SensorParameters, events_from_frames, log_intensity
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.events.packet import Packet
from davis_rs.simulation.from_frames.array_frames import ArrayFrames
from davis_rs.simulation.from_frames.frame_run import FrameRun
from davis_rs.simulation.settings import FrameSettings, complete
from reference import exact_events

BARS = moving_bars()
STAMPS = [0, 20_000, 35_000, 70_001, 70_002, 120_000]
"""In microseconds: at no fixed rate."""


def all_events(packets: Iterator[Packet]) -> EventArray:
    return concatenate_events([packet.events for packet in packets])


def srgb_to_linear(values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """IEC 61966-2-1, written once more."""
    v = np.asarray(values, np.float64) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


@given(
    st.lists(st.integers(1, 40_000), min_size=2, max_size=5),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.15, 0.05, 0.4]),
    st.sampled_from([0.15, 0.21]),
)
def test_linear_interpolation_is_the_exact_oracle_event_for_event(
    steps: list[int], seed: int, on: float, off: float
) -> None:
    times = [0, *itertools.accumulate(steps)]
    frames = np.random.default_rng(seed).uniform(0, 1, (len(times), 3, 4)).astype(np.float32)
    found = all_events(
        events_from_frames(
            frames, times, interpolation="linear", contrast_threshold=on, contrast_threshold_off=off, log_eps=1e-3
        )
    )
    expected = exact_events(times, [log_intensity(frame, 1e-3) for frame in frames], on, off)
    assert np.array_equal(found, expected)


def test_eight_bit_frames_are_those_of_the_oracle_in_linear_light() -> None:
    frames = BARS[:, :6, :8]
    packets = list(events_from_frames(frames, STAMPS, interpolation="linear", log_eps=2e-3))
    luma = srgb_to_linear(frames).astype(np.float32)
    expected = exact_events(STAMPS, [log_intensity(frame, 2e-3) for frame in luma], 0.15, 0.15)
    assert len(expected) > 50
    assert np.array_equal(concatenate_events([packet.events for packet in packets]), expected)
    for packet, frame in zip(packets, luma, strict=True):
        assert packet.luma is not None
        assert packet.pose is None
        assert np.array_equal(packet.luma, frame)


def test_packets_tile_the_time_of_the_frames() -> None:
    packets = list(events_from_frames(BARS, [t + 7000 for t in STAMPS], interpolation="linear"))
    assert [packet.end_us for packet in packets] == [t + 7000 for t in STAMPS]
    assert [packet.start_us for packet in packets] == [7000, *[t + 7000 for t in STAMPS[:-1]]]
    assert len(packets[0].events) == 0


def by_hand(luma: npt.NDArray[np.float32], **settings: Any) -> EventArray:
    height, width = luma.shape[1:]
    engine = CrossingEngine(width, height, **settings)
    events = [engine.push(t_us, frame) for t_us, frame in zip(STAMPS, luma, strict=True)]
    return concatenate_events([*events, engine.flush()])


@pytest.mark.parametrize(
    "effects",
    [
        Effects(refractory_period_us=5000, leak_rate_hz=20.0),
        Effects(threshold_mismatch=0.1, shot_noise_rms=0.1),
        Effects(photoreceptor_bandwidth_hz=50.0),
        Effects(readout=1e5),
    ],
    ids=lambda effects: "+".join(effects.describe()),
)
def test_effects_and_seeds_are_the_engines_own(effects: Effects) -> None:
    luma = srgb_to_linear(BARS).astype(np.float32)
    found = all_events(
        events_from_frames(BARS, STAMPS, interpolation="linear", log_eps=0.01, effects=effects, seed=5, threads=1)
    )
    expected = by_hand(luma, log_eps=0.01, effects=effects.engine_settings(), seed=5)
    assert len(expected) > 100
    assert np.array_equal(found, expected)
    assert not np.array_equal(found, by_hand(luma, log_eps=0.01))


def test_effects_may_be_texts_and_a_sensor_brings_its_own() -> None:
    sensor = SensorParameters(
        width=48, height=32, contrast_threshold=0.2, refractory_period_us=8000, aps_exposure_us=4000
    )
    run = FrameRun(
        ArrayFrames(BARS, [1000 * t for t in STAMPS]),
        complete(FrameSettings, {"sensor": sensor, "effects": ["leak_rate_hz=3"]}, taker="a test"),
    )
    assert run.contrast_threshold == run.contrast_threshold_off == 0.2
    assert run.effects == Effects(refractory_period_us=8000, leak_rate_hz=3)
    assert run.left_out == ("aps",)  # and meta.json says so
    assert run.describe()["effects_left_out"] == ["aps"]
    with pytest.raises(ValueError, match="aps makes intensity frames"):
        events_from_frames(BARS, STAMPS, effects="aps")
    with pytest.raises(ValueError, match="effects='auto' is for a scene"):
        events_from_frames(BARS, STAMPS, effects="auto")


def test_start_phases_are_a_setting_and_those_of_a_sensor() -> None:
    """Ideal pixels begin at the first frame, a sensor's anywhere between two levels; a leak of nothing changes nothing.

    In four frames that differ by a quarter of C, most events hang on that.
    """
    frames = (0.3 * np.exp(0.05 * np.random.default_rng(0).normal(size=(4, 60, 60)).cumsum(0))).astype(np.float32)

    def made(**settings: Any) -> FrameRun:
        settings = {"interpolation": "linear", "contrast_threshold": 0.2, "log_eps": 1e-3, **settings}
        return FrameRun(
            ArrayFrames(frames, [0, 40_000, 80_000, 120_000]), complete(FrameSettings, settings, taker="a test")
        )

    counts: dict[str, int] = {}
    for start_phase in ("zero", "stationary"):
        leak = Effects(leak_rate_hz=1e-6)
        for effects in (None, leak):
            run = made(start_phase=start_phase, effects=effects)
            events = all_events(run.packets())
            assert run.describe()["parameters"]["start_phase"] == start_phase
            assert len(events) == counts.setdefault(start_phase, len(events)) > 50
            assert 0.4 < events["p"].mean() < 0.6
    assert counts["stationary"] > 3 * counts["zero"]
    assert made().start_phase == made(effects=Effects(leak_rate_hz=1.0)).start_phase == "zero"
    sensor = SensorParameters(leak_rate_hz=1e-6)
    assert made(sensor=sensor).start_phase == "stationary"
    assert len(all_events(made(sensor=sensor).packets())) == counts["stationary"]
    assert made(sensor=sensor, start_phase="zero").start_phase == "zero"


def test_a_lens_shades_and_blurs_what_the_pixels_see() -> None:
    flat = np.full((2, 32, 48), 0.5, np.float32)
    camera = davis_rs.Camera(48, 32, 40.0, 40.0, 23.5, 15.5)
    packet = next(events_from_frames(flat, fps=10, effects="vignetting=4", camera=camera))
    assert packet.luma is not None
    assert packet.luma[16, 24] == pytest.approx(0.5, rel=1e-3)
    corner = (1 + (23.5**2 + 15.5**2) / 40**2) ** -2
    assert packet.luma[0, 0] == pytest.approx(0.5 * corner, rel=1e-5)
    with pytest.raises(ValueError, match="vignetting depends on the lens: give camera"):
        events_from_frames(flat, fps=10, effects="vignetting=4")
    with pytest.raises(ValueError, match="the camera has 240 x 180 pixels, but the frames asks for 48 x 32"):
        events_from_frames(flat, fps=10, camera="ideal")
    spot = np.zeros((2, 32, 48), np.float32)
    spot[:, 10, 10] = 1
    blurred = next(events_from_frames(spot, fps=10, effects="lens_blur_px=1")).luma
    assert blurred is not None
    assert 0.1 < blurred[10, 10] < 0.3
    assert blurred.sum() == pytest.approx(1, rel=1e-4)


@pytest.mark.parametrize("interpolation", ["linear", "cubic", "flow"])
def test_images_at_a_rate_of_their_own_change_no_event(interpolation: str) -> None:
    """Packets end at even instants, and their images follow the light between the frames; events stay."""
    settings: dict[str, Any] = {"interpolation": interpolation, "log_eps": 0.01}
    plain = list(events_from_frames(BARS, STAMPS, **settings))
    slow = list(events_from_frames(BARS, STAMPS, image_rate_hz=400, **settings))
    instants = [2500 * k for k in range(49)]
    assert [packet.end_us for packet in slow] == instants
    assert [packet.start_us for packet in slow] == [0, *instants[:-1]]
    assert np.array_equal(all_events(iter(slow)), all_events(iter(plain)))
    for packet in slow:
        assert packet.luma is not None
        assert ((packet.start_us < packet.events["t"]) & (packet.events["t"] <= packet.end_us)).all()
    for t_us, frame in zip(STAMPS, plain, strict=True):
        if t_us in instants:
            assert np.array_equal(slow[instants.index(t_us)].luma, frame.luma)  # type: ignore[arg-type]
    # The engine sees the same light: events until an instant rebuild the image there, to within a threshold.
    first = slow[0].luma
    assert first is not None
    counted = np.zeros(first.shape)
    for packet in slow:
        np.add.at(counted, (packet.events["y"], packet.events["x"]), np.where(packet.events["p"] == 1, 0.15, -0.15))
        assert packet.luma is not None
        rebuilt = np.log(first + 0.01) + counted
        assert np.abs(np.log(packet.luma + 0.01) - rebuilt).max() < 0.15 + 1e-5
    odd = list(events_from_frames(BARS, STAMPS, image_rate_hz=70, **settings))
    assert [packet.end_us for packet in odd] == [round(k / 70 * 1e6) for k in range(9)] + [120_000]
    assert odd[-1].luma is None
    assert len(all_events(iter(odd))) == len(all_events(iter(plain)))


def test_frames_are_read_as_they_are_needed() -> None:
    """Of an endless generator only a few frames are read ahead, however slowly events are taken."""
    read = 0

    def endless() -> Iterator[npt.NDArray[np.uint8]]:
        nonlocal read
        for frame in itertools.cycle(BARS):
            read += 1
            yield frame

    packets = events_from_frames(endless(), itertools.count(0, 1000), interpolation="linear")
    for _, packet in zip(range(30), packets, strict=False):
        assert read <= packet.end_us // 1000 + 8
    packets.close()  # type: ignore[attr-defined]
    assert read < 40


def test_the_part_the_sensor_sees() -> None:
    """A crop is the middle, a region has its corner, and a size averages areas of linear light."""
    frames = np.random.default_rng(1).integers(0, 256, (2, 32, 48), np.uint8)
    luma = srgb_to_linear(frames[0])

    def first(**settings: Any) -> npt.NDArray[np.float32]:
        packet = next(events_from_frames(frames, fps=30, **settings))
        assert packet.luma is not None
        return packet.luma

    assert np.array_equal(first(crop="40x20"), luma[6:26, 4:44].astype(np.float32))
    assert np.array_equal(first(roi="10x8+3+5"), luma[5:13, 3:13].astype(np.float32))
    halved = luma.reshape(16, 2, 24, 2).mean((1, 3))
    assert np.allclose(first(size="24x16"), halved, rtol=1e-5)
    assert first(crop="40x20", size=(20, 10)).shape == (10, 20)


def test_a_frame_fits_a_sensor_of_any_size() -> None:
    """Crop fills the sensor and keeps the middle, pad keeps all with black around, scale stretches each side."""
    luma = np.zeros((20, 40), np.float32)
    luma[:, 10:30] = 0.5  # the middle half
    luma[8:12] += 0.25
    frames = np.stack([luma, luma])

    def first(fit: str, **settings: Any) -> npt.NDArray[np.float32]:
        packet = next(events_from_frames(frames, fps=30, fit=fit, **settings))
        assert packet.luma is not None
        return packet.luma

    # Twice as large: 80 x 40, of which 60 x 40 are the middle. Straight lines change only the pixels next to an edge.
    crop = first("crop", size="60x40")
    assert crop.shape == (40, 60)
    assert np.array_equal(crop[0], [*[0.0] * 9, 0.125, 0.375, *[0.5] * 38, 0.375, 0.125, *[0.0] * 9])
    # 30 x 15 of 40 x 20 in the middle of 30 x 21.
    pad = first("pad", size="30x21")
    assert pad.shape == (21, 30)
    assert not pad[:3].any()
    assert not pad[18:].any()
    assert pad[3:18].mean() == pytest.approx(luma.mean(), rel=1e-5)
    assert pad[3:18, 12].min() == pytest.approx(0.5)
    # Wider by 2, lower by 2.
    scale = first("scale", size="80x10")
    assert scale.shape == (10, 80)
    assert scale[:, 40].tolist() == pytest.approx([*[0.5] * 4, 0.75, 0.75, *[0.5] * 4])
    # Of a part, and to the size of a sensor; the same size and shape changes nothing.
    assert np.array_equal(first("crop", roi="20x10+10+5", size="20x10"), luma[5:15, 10:30])
    assert np.array_equal(first("crop", size="10x20"), luma[:, 15:25])
    assert first("pad", sensor="davis346").shape == (260, 346)
    assert not first("pad", sensor="davis346")[:43].any()


def test_padding_makes_no_events_of_its_own() -> None:
    """An ideal pixel in the black around a padded image sees nothing change, whatever lies between frames."""
    settings: dict[str, Any] = {"fit": "pad", "size": "48x64", "interpolation": "linear"}
    events = all_events(events_from_frames(BARS, STAMPS, **settings))
    plain = all_events(events_from_frames(BARS, STAMPS, interpolation="linear"))
    assert events["y"].min() >= 16
    assert events["y"].max() < 48
    assert len(plain) > 1000
    moved = plain.copy()
    moved["y"] += 16
    assert np.array_equal(events, moved)


BAD_PARTS: dict[str, tuple[dict[str, Any], str]] = {
    "both": ({"crop": "4x4", "roi": "4x4+0+0"}, "only one of crop and roi"),
    "crop outside": ({"crop": "49x32"}, "crop 49x32 does not lie inside the frames of 48 x 32 pixels"),
    "roi outside": ({"roi": "40x20+10+0"}, r"roi 40x20\+10\+0 does not lie inside"),
    "roi malformed": ({"roi": "40x20"}, "roi must be WIDTHxHEIGHT"),
    "crop malformed": ({"crop": "big"}, "crop must be WIDTHxHEIGHT"),
    "larger": ({"size": "96x64"}, "must not be larger than the 48 x 32 pixels"),
    "stretched": ({"size": "24x24"}, "would stretch the image: crop='32x32' fits"),
    "smaller": (
        {"sensor": "davis346"},
        "has 346 x 260 pixels, the frames give 48 x 32: fit crop, pad or scale enlarges",
    ),
    "sensor": (
        {"sensor": SensorParameters(width=24, height=16)},
        "the sensor has 24 x 16 pixels, the frames give 48 x 32: size='24x16' reduces them, or fit crop, pad or scale",
    ),
    "fit without a size": ({"fit": "pad"}, "fit needs the size of the sensor: give size, or a sensor that has one"),
    "fit unknown": ({"fit": "fill", "size": "9x9"}, "fit must be one of crop, pad, scale, got 'fill'"),
    "fit to another size": (
        {"fit": "pad", "size": "9x9", "sensor": "davis346"},
        "size 9x9 is not the sensor's, which has 346 x 260 pixels",
    ),
}


@pytest.mark.parametrize("name", BAD_PARTS)
def test_parts_that_cannot_be(name: str) -> None:
    settings, said = BAD_PARTS[name]
    with pytest.raises(ValueError, match=said):
        events_from_frames(BARS, STAMPS, **settings)


def test_a_part_of_the_time_and_slow_motion() -> None:
    """``start_s`` and ``stop_s`` count from the first frame; slow motion divides what lies between stamps."""
    packets = list(events_from_frames(BARS, [t + 500 for t in STAMPS], start_s=0.02, stop_s=0.070001))
    assert [packet.end_us for packet in packets] == [20_500, 35_500, 70_501]
    packets = list(events_from_frames(BARS, [8 * t for t in STAMPS], slow_motion=8))
    assert [packet.end_us for packet in packets] == STAMPS
    packets = list(events_from_frames(BARS[:3], fps=29.97, slow_motion=2.5))
    assert [packet.end_us for packet in packets] == [0, round(1e6 / 29.97 / 2.5), round(2e6 / 29.97 / 2.5)]


BAD_FRAMES: dict[str, tuple[Callable[[], Any], str]] = {
    "another size": (lambda: [BARS[0], BARS[1, :20]], "frame 1: all frames must have one size, this has 48 x 20"),
    "colour after grey": (lambda: [BARS[0], np.stack([BARS[1]] * 3, -1)], "frame 1: all frames must have one size"),
    "16 bits after 8": (
        lambda: [BARS[0], BARS[1].astype(np.uint16) << 8],
        "frame 1: all frames must have one type, this has uint16, the first uint8",
    ),
    "NaN": (lambda: [np.zeros((4, 4)), np.full((4, 4), np.nan)], r"frame 1: light must be finite .* pixel \(0, 0\)"),
    "negative": (lambda: np.array([np.zeros((4, 4)), -np.eye(4)]), r"frame 1: light must .*, got -1.0 at pixel"),
    "one": (lambda: BARS[:1], "frame 0: one frame makes no events: two are needed"),
    "none": (list, "there are no frames"),
    "alpha": (lambda: np.zeros((2, 4, 4, 4), np.uint8), "must not have an alpha channel"),
    "integers": (lambda: np.zeros((2, 4, 4), np.int32), "must be uint8, uint16 or floating point, got int32"),
    "booleans": (lambda: np.zeros((2, 4, 4), bool), "must be uint8, uint16 or floating point, got bool"),
    "flat": (lambda: np.zeros((2, 4), np.uint8), r"a stack of frames must have the shape \(n, H, W\)"),
    "empty": (lambda: np.zeros((2, 0, 4), np.uint8), r"must have the shape \(H, W\)"),
    "a path": (lambda: "clip.mp4", "open it by davis_rs.open_frames"),
}


@pytest.mark.parametrize("name", BAD_FRAMES)
def test_frames_that_cannot_be_taken(name: str) -> None:
    """The error names the frame; packets before it come out whole."""
    frames, said = BAD_FRAMES[name]
    with pytest.raises(ValueError, match=said):
        list(events_from_frames(frames(), fps=30, interpolation="linear"))


BAD_STAMPS: dict[str, tuple[Any, str]] = {
    "repeat": ([0, 10, 10, 30, 40, 50], "frame 2: stamps must increase, got 1e-05 s after 1e-05 s"),
    "back": ([0, 10, 20, 15, 40, 50], "frame 3: stamps must increase, got 1.5e-05 s after 2e-05 s"),
    "few": (STAMPS[:-1], "6 frames need as many stamps, got 5"),
    "many": ([*STAMPS, 200_000], "6 frames need as many stamps, got 7"),
    "few, in passing": (iter(STAMPS[:-1]), "frame 5: there are only 5 stamps, and more frames"),
    "NaN": ([0, 1, np.nan, 3, 4, 5], "stamp 2 must be finite"),
    "words": (["a"] * 6, "stamps must be one row of numbers"),
    "negative": ([-5, 1, 2, 3, 4, 5], "frame 0: stamps must be >= 0"),
    "none": (None, "one of t_us and fps must be given"),
}


@pytest.mark.parametrize("name", BAD_STAMPS)
def test_stamps_that_cannot_be(name: str) -> None:
    stamps, said = BAD_STAMPS[name]
    with pytest.raises(ValueError, match=said):
        list(events_from_frames(BARS, stamps, interpolation="linear"))


def test_more_that_cannot_be() -> None:
    with pytest.raises(ValueError, match="one of t_us and fps"):
        events_from_frames(BARS, STAMPS, fps=30)
    with pytest.raises(ValueError, match="fps must be finite and > 0"):
        events_from_frames(BARS, fps=0)
    with pytest.raises(ValueError, match=r"stop_s must be after start_s, got 0.01 s and 0.02 s"):
        events_from_frames(BARS, STAMPS, start_s=0.02, stop_s=0.01)
    with pytest.raises(ValueError, match="there are no frames between 3 s and the end"):
        events_from_frames(BARS, STAMPS, start_s=3)
    with pytest.raises(ValueError, match="frame 1: it falls on the same microsecond"):
        list(events_from_frames(BARS, STAMPS, slow_motion=1e5))
    with pytest.raises(TypeError, match="no argument 'contrast'; did you mean contrast_threshold"):
        events_from_frames(BARS, STAMPS, contrast=0.2)  # type: ignore[call-arg]


def test_the_error_of_a_frame_comes_after_the_packets_before_it() -> None:
    frames = [*BARS[:4], BARS[4, :20]]
    packets = events_from_frames(frames, STAMPS[:5], interpolation="linear")
    with pytest.raises(ValueError, match="frame 4"):
        list(packets)
    whole = list(events_from_frames(BARS[:4], STAMPS[:4], interpolation="linear"))
    taken = list(itertools.islice(events_from_frames(frames, STAMPS[:5], interpolation="linear"), 4))
    assert all(np.array_equal(a.events, b.events) for a, b in zip(taken, whole, strict=True))


@pytest.mark.long
def test_nothing_heavy_is_imported(run_python: Callable[..., str]) -> None:
    """Neither Mitsuba nor SciPy, OpenCV or PyAV for arrays by lines."""
    program = (
        "import sys, numpy as np, davis_rs\n"
        "list(davis_rs.events_from_frames(np.zeros((3, 8, 8), np.uint8), fps=30, interpolation='linear'))\n"
        "print(sorted({'mitsuba', 'drjit', 'scipy', 'cv2', 'av', 'PIL', 'OpenEXR'} & set(sys.modules)))"
    )
    assert run_python(program).strip() == "[]"
