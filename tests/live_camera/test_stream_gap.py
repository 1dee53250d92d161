"""Words in place of lost ones: what comes after a gap decodes as if there had been none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import davis_rs
from davis_rs.usb.stream_gap import gap_words
from streams import CHIPS, contents, decode, encode

STREAMS = {chip: encode(chip, contents(chip, events=3000)) for chip in CHIPS}
WHOLE = {chip: decode(chip, STREAMS[chip]) for chip in CHIPS}


@given(chip=st.sampled_from(CHIPS), data=st.data())
def test_events_after_a_gap_are_the_same(chip: str, data: st.DataObject) -> None:
    """Times hang on wraps and places on rows: both survive the gap; no frame is made of two halves."""
    words = STREAMS[chip]
    total = len(words) // 2
    start, end = sorted(data.draw(st.tuples(st.integers(0, total), st.integers(0, total))))
    lost = words[2 * start : 2 * end]
    decoder = davis_rs.Decoder(chip, imu_counts=True)
    before, gap = decoder.push(words[: 2 * start]), decoder.push(gap_words(lost))
    after = decoder.push(words[2 * end :])
    whole = WHOLE[chip]
    assert len(gap.events) == len(gap.triggers) == 0
    np.testing.assert_array_equal(before.events, whole.events[: len(before.events)])
    np.testing.assert_array_equal(after.events, whole.events[len(whole.events) - len(after.events) :])
    events_lost = int((np.frombuffer(lost, "<u2") >> 13 == 1).sum())
    assert len(before.events) + len(after.events) + events_lost == len(whole.events)
    sent = {(frame.t_end, frame.pixels.tobytes()) for frame in whole.frames}
    frames = [*before.frames, *after.frames]
    assert {(frame.t_end, frame.pixels.tobytes()) for frame in frames} <= sent
    samples = {sample.tobytes() for sample in whole.imu}
    assert {sample.tobytes() for part in (before, gap, after) for sample in part.imu} <= samples


@pytest.mark.parametrize("chip", CHIPS)
@pytest.mark.parametrize("mark", [0x0005, 0x0008])
@pytest.mark.parametrize("part", [0.1, 0.5, 0.9])
def test_two_halves_make_no_whole(chip: str, mark: int, part: float) -> None:
    """A gap from within a sample or frame to the same place of the next leaves as many words as one of them has."""
    stream = np.frombuffer(STREAMS[chip], "<u2")
    first, second = np.flatnonzero(stream == mark)[:2]
    end = np.flatnonzero(stream == (0x0007 if mark == 0x0005 else 0x000A))[0]
    # Counted in the words of its own, for events come in between.
    own = (stream >> 12 == 5) if mark == 0x0005 else (stream >> 12 == 4) | ((stream > 0x0A) & (stream < 0x10))
    places = np.flatnonzero(own)
    count = round(part * np.count_nonzero(own[first:end]))
    start, stop = (places[np.searchsorted(places, at) + count] for at in (first, second))
    decoder = davis_rs.Decoder(chip, imu_counts=True)
    decoder.push(stream[:start])
    got = decoder.push(gap_words(stream[start:stop].tobytes()) + stream[stop:].tobytes())
    whole = WHOLE[chip]
    assert {frame.pixels.tobytes() for frame in got.frames} <= {frame.pixels.tobytes() for frame in whole.frames}
    assert {sample.tobytes() for sample in got.imu} <= {sample.tobytes() for sample in whole.imu}


def test_a_reset_of_the_clock_survives_a_gap() -> None:
    """It may come after the last wrap, and then nothing else would say that time began anew."""
    words = STREAMS["DAVIS240C"]
    decoder = davis_rs.Decoder("DAVIS240C")
    decoder.push(words)
    got = decoder.push(gap_words(words[-100:] + b"\x01\x00" + words[:100]) + words[100:])
    np.testing.assert_array_equal(got.events, WHOLE["DAVIS240C"].events[-len(got.events) :])


@given(st.binary(max_size=200).map(lambda data: data[: len(data) // 2 * 2]))
def test_gaps_grow_with_time_only(words: bytes) -> None:
    """Many lost chunks merge into one gap: what is kept are the clock's words, and at most six more."""
    merged = gap_words(gap_words(words) + words)
    clock = np.frombuffer(words, "<u2")
    assert len(merged) // 2 <= 2 * int(((clock >> 12 == 7) | (clock == 1)).sum()) + 6
