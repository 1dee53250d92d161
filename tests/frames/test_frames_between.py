"""Between frames: cubics, optical flow, a user's interpolator, and the choice among them."""

from __future__ import annotations

import itertools
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clips import moving_texture
from davis_rs import CrossingEngine, compare_events, events_from_frames, frames_to_folder
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.simulation.from_frames.array_frames import ArrayFrames
from davis_rs.simulation.from_frames.frame_run import FrameRun
from davis_rs.simulation.from_frames.frames_between import instants
from davis_rs.simulation.from_frames.interpolation import SensorFrame, with_rates
from davis_rs.simulation.from_frames.optical_flow import FlowFinder
from davis_rs.simulation.settings import FrameSettings, complete

WIDTH, HEIGHT, FRAME_US = 96, 64, 30_000


def events(frames: npt.NDArray[np.float32], interpolation: Any, frame_us: int = FRAME_US, **more: Any) -> EventArray:
    times = frame_us * np.arange(len(frames))
    packets = events_from_frames(frames, times, interpolation=interpolation, **more)
    return concatenate_events([packet.events for packet in packets])


def dense(step: float, count: int, parts: int = 40) -> EventArray:
    """The events of frames so dense that it does not matter what lies between."""
    frames = moving_texture((count - 1) * parts + 1, step / parts, WIDTH, HEIGHT)
    return events(frames, "linear", FRAME_US // parts)


def errors(found: EventArray, reference: EventArray) -> tuple[float, float]:
    """Median time error in us, and missing and spurious events together in per cent."""
    compared = compare_events(found, reference, size=(WIDTH, HEIGHT), window_us=FRAME_US // 3)
    return compared.median_us, compared.missing_percent + compared.spurious_percent


@given(
    st.lists(st.integers(1, 50_000), min_size=1, max_size=6),
    st.integers(0, 2**32 - 1),
)
def test_cubics_are_monotone(steps: list[int], seed: int) -> None:
    """Between two frames log intensity stays between theirs: the slope has the lines' sign, or is 0, and is at most
    three times either's (Fritsch and Carlson's sufficient condition)."""
    times = [0, *itertools.accumulate(steps)]
    luma = np.random.default_rng(seed).uniform(0, 1, (len(times), 5, 5)).astype(np.float32)
    frames = (SensorFrame(t, one, "") for t, one in zip(times, luma, strict=True))
    rates = list(with_rates(frames, np.float32(1e-3)))
    assert [frame.t_us for frame, _ in rates] == times
    log = np.log(luma.astype(np.float64) + 1e-3)
    chords = np.diff(log, axis=0) / (np.diff(times) * 1e-6)[:, None, None]
    for k, (frame, rate) in enumerate(rates):
        slope = rate / (frame.luma + 1e-3)
        for chord in chords[max(k - 1, 0) : k + 1]:
            tolerance = 1e-3 * np.abs(chord) + 1e-3
            assert (slope * np.sign(chord) >= -tolerance).all()
            assert (np.abs(slope) <= 3 * np.abs(chord) + tolerance).all()


@pytest.mark.long
def test_cubics_are_exact_for_a_steady_change_and_better_for_a_curved_one() -> None:
    t = np.arange(5) * 0.03

    def gray(log: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        return np.broadcast_to((np.exp(log) - 1e-3)[:, None, None], (len(log), 2, 2)).astype(np.float32)

    steady = gray(-2 + 10 * t)
    by_line, by_cubic = events(steady, "linear"), events(steady, "cubic")
    assert len(by_line) == len(by_cubic) == 4 * 8
    assert np.abs(by_line["t"] - by_cubic["t"]).max() <= 2
    curved = gray(-2 + 60 * t**2)
    fine = np.arange(12_001) * 1e-5
    truth = events(gray(-2 + 60 * fine**2), "linear", 10)
    off = [np.abs(events(curved, rule)["t"] - truth["t"]).mean() for rule in ("linear", "cubic")]
    assert off[1] < 0.35 * off[0]


@pytest.mark.parametrize("step", [(3.0, 0.0), (-2.5, 1.25), (0.0, 6.0)])
def test_flow_finds_how_the_image_moves(step: tuple[float, float]) -> None:
    """To a tenth of a pixel away from the edges, and so both ways."""
    from clips import texture

    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    before, after = texture(x, y), texture(x - step[0], y - step[1])
    pair = FlowFinder().between(before, after)
    inner = (slice(12, -12), slice(12, -12))
    assert np.abs(pair.forward[inner] - step).mean() < 0.1
    assert np.abs(pair.backward[inner] + step).mean() < 0.1
    assert pair.displacement_px == pytest.approx(np.hypot(*step), abs=0.8)
    assert pair.occluded < 0.15
    for share, [made] in zip((0.25, 0.5, 0.9), pair.frames([0.25, 0.5, 0.9], [before], [after]), strict=True):
        truth = texture(x - share * step[0], y - share * step[1])
        assert np.abs(made - truth)[inner].mean() < 0.01
        mixed = (1 - share) * before + share * after
        assert np.abs(made - truth)[inner].mean() < 0.5 * np.abs(mixed - truth)[inner].mean()


def test_frames_between_begin_and_end_as_the_frames() -> None:
    frames = moving_texture(2, 4.0, WIDTH, HEIGHT)
    near = [made for [made] in FlowFinder().between(*frames).frames([0.0, 1.0], [frames[0]], [frames[1]])]
    assert np.abs(near[0] - frames[0]).max() < 1e-5
    assert np.abs(near[1] - frames[1]).max() < 1e-5


@pytest.mark.parametrize(("dark", "bright"), [(0.04, 0.7), (0.7, 0.04)])
def test_hard_edges_do_not_swing(dark: float, bright: float) -> None:
    """A square that moves by 3 px a frame: light between stays within that of the frames, and events are those of many
    frames. A swing below the darkest light would be three times as many."""

    def frame(left: float) -> npt.NDArray[np.float32]:
        image = np.full((HEIGHT, WIDTH), dark, np.float32)
        image[15 : HEIGHT - 15, round(left) : round(left) + 20] = bright
        return image

    frames = np.stack([frame(10 + 3 * k) for k in range(8)])
    made = FlowFinder().between(frames[2], frames[3]).frames(np.linspace(0, 1, 9), [frames[2]], [frames[3]])
    for [image] in made:
        assert image.min() >= min(dark, bright) - 1e-6
        assert image.max() <= max(dark, bright) + 1e-6
    truth = events(np.stack([frame(10 + k) for k in range(22)]), "linear")
    assert len(events(frames, "flow")) == pytest.approx(len(truth), rel=0.03)


def test_what_is_hidden_comes_from_the_frame_that_shows_it() -> None:
    """A bright bar moves over a texture: what it uncovers is in the second frame alone, what it covers in the first."""

    def frame(left: float) -> npt.NDArray[np.float32]:
        image = moving_texture(1, 0, WIDTH, HEIGHT)[0] * 0.5
        x = np.arange(WIDTH)
        cover = np.clip(x - left + 0.5, 0, 1) * np.clip(left + 16 - x + 0.5, 0, 1)
        bar = 0.8 + 0.1 * np.sin(np.arange(HEIGHT) * 0.7)[:, None] * np.sin((x - left) * 0.9)
        return np.asarray(image * (1 - cover) + bar * cover, np.float32)

    pair = FlowFinder().between(frame(30), frame(38))
    assert pair.occluded > 0.02
    [made], truth = next(pair.frames([0.5], [pair.before], [pair.after])), frame(34)
    inner = (slice(8, -8), slice(8, -8))
    blended = 0.5 * (frame(30) + frame(38))
    assert np.abs(made - truth)[inner].mean() < 0.4 * np.abs(blended - truth)[inner].mean()


@pytest.mark.parametrize("step", [2.0, 5.0])
def test_flow_beats_lines_and_cubics_where_the_image_moves(step: float) -> None:
    frames, truth = moving_texture(5, step, WIDTH, HEIGHT), dense(step, 5)
    line, cubic, flow, auto = (errors(events(frames, rule), truth) for rule in ("linear", "cubic", "flow", "auto"))
    assert flow[0] < 0.5 * min(line[0], cubic[0])
    assert flow[1] < 0.5 * min(line[1], cubic[1])
    assert auto[0] < 0.6 * cubic[0]


def test_auto_takes_cubics_where_the_image_hardly_moves() -> None:
    slow = moving_texture(5, 0.4, WIDTH, HEIGHT)
    assert np.array_equal(events(slow, "auto"), events(slow, "cubic"))
    mixed = np.concatenate([slow, moving_texture(5, 5.0, WIDTH, HEIGHT)[1:]])
    run = FrameRun(ArrayFrames(mixed, [30_000_000 * k for k in range(9)]), complete(FrameSettings, {}, taker="a test"))
    for _ in run.packets():
        pass
    found = run.describe()["interpolation"]
    assert (found["intervals_without_frames_between"], found["intervals_with_frames_between"]) == (4, 4)
    assert found["largest_displacement_px"] == pytest.approx(5, abs=1)
    assert next(run.findings()).startswith(
        "interpolation auto: 4 of 8 intervals by cubics, where the image moves by 1 px"
    )


def test_a_small_object_counts_as_much_as_its_events() -> None:
    """Before a camera that stands still, a square of 2 % of the image makes all of the events, so it decides."""
    count, step, noise = 4, 5, np.random.default_rng(0)
    still, square = moving_texture(1, 0.0, WIDTH, HEIGHT)[0], moving_texture(1, 0.0, 12, 12)[0][::-1]
    frames = np.repeat(still[None], count, 0)
    for number, frame in enumerate(frames):
        frame[28:40, 20 + step * number : 32 + step * number] = square
    frames += noise.normal(0.0, 1e-3, frames.shape).astype(np.float32)
    finder = FlowFinder()
    for before, after in pairwise(frames):
        assert finder.between(before, after).displacement_px == pytest.approx(step, abs=1.5)
    assert finder.between(still, still).displacement_px == 0
    assert not np.array_equal(events(frames, "auto"), events(frames, "cubic"))


def test_too_much_motion_is_said(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    noise = np.random.default_rng(0).random((4, 40, 60)).astype(np.float32)
    frames_to_folder(ArrayFrames(noise, [0, 10**7, 2 * 10**7, 3 * 10**7]), tmp_path / "out")
    assert "events there are a guess, and a higher frame rate is the only cure" in capsys.readouterr().err


def test_an_interpolator_of_known_motion() -> None:
    """What a learned one would be put in as: its frames are taken as they are, at the instants that it is asked for."""
    step, count = 4.0, 4
    frames = moving_texture(count, step, WIDTH, HEIGHT)
    asked: list[npt.NDArray[np.float64]] = []

    def interpolator(
        before: npt.NDArray[np.float32], after: npt.NDArray[np.float32], shares: npt.NDArray[np.float64]
    ) -> list[npt.NDArray[np.float32]]:
        number = next(k for k in range(count) if np.array_equal(frames[k], before))
        assert np.array_equal(frames[number + 1], after)
        assert before.dtype == np.float32
        asked.append(shares)
        return [moving_texture(2, (number + share) * step, WIDTH, HEIGHT)[1] for share in shares.tolist()]

    found = events(frames, interpolator, max_displacement_px=0.4)
    assert all(((shares > 0) & (shares < 1)).all() and (np.diff(shares) > 0).all() for shares in asked)
    assert max(map(len, asked)) <= 16
    largest = max(np.diff([0.0, *shares, 1.0]).max() for shares in asked)
    assert largest * step <= 0.4 * 1.2  # flow measures the displacement to some per cent
    by_hand = CrossingEngine(WIDTH, HEIGHT)
    expected = [by_hand.push(0, frames[0])]
    for number, shares in enumerate(asked):
        for share in shares.tolist():
            luma = moving_texture(2, (number + share) * step, WIDTH, HEIGHT)[1]
            expected.append(by_hand.push(round((number + share) * FRAME_US), luma))
        expected.append(by_hand.push((number + 1) * FRAME_US, frames[number + 1]))
    assert np.array_equal(found, concatenate_events(expected))
    median_us, wrong_percent = errors(found, dense(step, count))
    assert median_us < 100
    assert wrong_percent < 1


BAD: dict[str, tuple[Any, str]] = {
    "few": (lambda a, b, s: [a] * (len(s) - 1), r"was asked for \d+ frames, and gave \d+"),
    "many": (lambda a, b, s: [a] * (len(s) + 1), r"was asked for \d+ frames, and gave \d+"),
    "size": (lambda a, b, s: [a[1:]] * len(s), r"frames must have the shape \(64, 96\), got \(63, 96\)"),
    "NaN": (lambda a, b, s: [a * np.nan] * len(s), "luma must be finite and >= 0, got nan at pixel"),
    "negative": (lambda a, b, s: [-a] * len(s), "luma must be finite and >= 0, got -"),
}


@pytest.mark.parametrize("name", BAD)
def test_interpolators_that_break_their_contract(name: str) -> None:
    interpolator, said = BAD[name]
    with pytest.raises(ValueError, match=f"the interpolator, between frames, frame 0 and frames, frame 1: .*{said}"):
        events(moving_texture(3, 4.0, WIDTH, HEIGHT), interpolator)


def test_settings_of_what_lies_between() -> None:
    frames = moving_texture(3, 4.0, WIDTH, HEIGHT)
    with pytest.raises(ValueError, match="interpolation must be one of auto, linear, cubic, flow, got 'slomo'"):
        events(frames, "slomo")
    with pytest.raises(ValueError, match=r"max_displacement_px must be 0\.01\.\.100 px"):
        events(frames, "flow", max_displacement_px=0)
    coarse, fine = (len(np.unique(events(frames, "flow", max_displacement_px=px)["t"])) for px in (100, 0.3))
    assert coarse > 0
    assert fine > 0


@given(st.integers(0, 10**6), st.integers(1, 10**5), st.floats(0, 1e4), st.floats(0.01, 100))
def test_instants_are_strictly_between_and_dense_enough(start: int, length: int, moved: float, step: float) -> None:
    found = instants(start, start + length, moved, step)
    ends = np.concatenate([[start], found, [start + length]])
    assert (np.diff(ends) > 0).all()
    if len(found) < 512 and len(found) < length - 1:
        assert np.diff(ends).max() <= (length * step / moved if moved > step else length) * 1.001 + 1


def test_without_opencv_the_error_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "cv2", None)
    frames = moving_texture(3, 1.0)
    for rule in ("auto", "flow"):
        with pytest.raises(
            ImportError, match=r"pip install 'davis_rs\[video\]'; or choose interpolation linear or cubic"
        ):
            events(frames, rule)
    assert len(events(frames, "cubic")) > 0
    with pytest.raises(ImportError, match="bringing frames to another size needs OpenCV"):
        events(frames, "linear", size="48x32")


def test_flow_is_the_same_on_any_number_of_threads() -> None:
    import cv2

    frames = moving_texture(3, 3.0, WIDTH, HEIGHT)
    threads = cv2.getNumThreads()
    try:
        found = []
        for number in (1, 4):
            cv2.setNumThreads(number)
            found.append(events(frames, "flow"))
            assert cv2.getNumThreads() == number
        assert np.array_equal(found[0], found[1])
    finally:
        cv2.setNumThreads(threads)
