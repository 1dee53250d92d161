"""The decoder and encoder of the camera's stream from Python: arrays, buffers, errors."""

from __future__ import annotations

import itertools
import threading
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import davis_rs
from davis_rs import Decoder, Device, Encoder, Frame, TriggerKind
from places import SHARED

STREAMS = SHARED / "aer"
EVENT = np.array([(100, 7, 5, 1)], dtype=davis_rs.EVENT_DTYPE)


def scene() -> dict[str, Any]:
    """A little of everything, in what a DAVIS240 can send."""
    events = np.zeros(1000, dtype=davis_rs.EVENT_DTYPE)
    events["t"], events["x"], events["y"] = np.arange(1000) * 977, np.arange(1000) % 240, np.arange(1000) % 180
    events["p"] = np.arange(1000) % 2
    imu = np.zeros(3, dtype=davis_rs.IMU_COUNTS_DTYPE)
    imu["t"], imu["accel"], imu["gyro"], imu["temperature"] = [5, 10_000, 900_000], [1, -2, 3], [[7], [8], [9]], -340
    imu["groups"], imu["accel_range"], imu["gyro_range"] = 7, [0, 1, 3], 2
    pixels = np.arange(0, 12 * 128, 128, dtype=np.uint16).reshape(3, 4)
    frames = [Frame(20, 30, 40, 50, 100, 60, pixels, False, 133.3), Frame(100, 100, 100, 100, 0, 0, pixels)]
    kinds = [(0, TriggerKind.TIMESTAMP_RESET), (3, TriggerKind.INPUT_RISING), (7, TriggerKind.GENERATOR_FALLING)]
    return {"events": events, "imu": imu, "frames": frames, "triggers": np.array(kinds, dtype=davis_rs.TRIGGER_DTYPE)}


def assert_same_frames(frames: list[Frame], expected: list[Frame]) -> None:
    """Frames are equal in every field; the exposure is counted in cycles of 30 MHz."""
    for frame, other in zip(frames, expected, strict=True):
        np.testing.assert_array_equal(frame.pixels, other.pixels)
        assert frame.pixels.dtype == np.uint16
        assert frame.exposure_us == pytest.approx(other.exposure_us, abs=1 / 60)
        assert frame._replace(pixels=other.pixels, exposure_us=0) == other._replace(exposure_us=0)


def test_decoding_undoes_encoding() -> None:
    """Events, counts, frames and triggers come back as they were, and nothing is counted as odd."""
    given = scene()
    decoder = Decoder("DAVIS240C", imu_counts=True)
    decoded = decoder.push(Encoder("DAVIS240C").encode(**given))
    for name in ("events", "imu", "triggers"):
        np.testing.assert_array_equal(getattr(decoded, name), given[name])
        assert getattr(decoded, name).dtype == given[name].dtype
    assert_same_frames(decoded.frames, given["frames"])
    assert set(decoder.stats.values()) == {0}


def test_si_units() -> None:
    """Half of full scale is what it says, in m/s^2 and rad/s; encoding SI samples rounds them to counts."""
    imu = np.zeros(1, dtype=davis_rs.IMU_COUNTS_DTYPE)
    imu["accel"], imu["gyro"], imu["temperature"], imu["groups"] = 16384, -16384, 340, 7
    imu["accel_range"], imu["gyro_range"] = 1, 1
    stream = Encoder("DAVIS240C").encode(imu=imu)
    (sample,) = Decoder("DAVIS240C").push(stream).imu
    np.testing.assert_allclose(sample["accel"], 2 * 9.80665)
    np.testing.assert_allclose(sample["gyro"], -np.radians(250))
    assert sample["temperature"] == pytest.approx(36)
    other = Device("DAVIS240C", imu_type=2, imu_flips=4)
    (flipped,) = Decoder(other).push(stream).imu
    np.testing.assert_allclose(flipped["accel"], [-2 * 9.80665, 2 * 9.80665, 2 * 9.80665])
    assert flipped["temperature"] == pytest.approx(340 / 333.87 + 21)
    assert Encoder("DAVIS240C").encode(imu=np.array([sample])) == stream
    assert Encoder(other).encode(imu=np.array([flipped])) == stream


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview, np.uint8, np.uint16])
def test_every_kind_of_data_is_taken(kind: Any) -> None:
    """Bytes and words of any holder decode alike."""
    stream = Encoder("DAVIS240C").encode(EVENT)
    data = np.frombuffer(stream, kind) if kind in (np.uint8, np.uint16) else kind(stream)
    np.testing.assert_array_equal(Decoder("DAVIS240C").push(data).events, EVENT)
    assert len(Decoder("DAVIS240C").push(data[:0]).events) == 0


@pytest.mark.parametrize(
    "data",
    [np.zeros(4, np.float32), np.zeros(8, np.uint16)[::2], np.zeros(4, ">u2"), np.zeros(4, np.int32), "text", 7, None],
    ids=repr,
)
def test_other_data_is_refused(data: Any) -> None:
    """Bytes that mean something else are not taken for words."""
    with pytest.raises(ValueError, match="data must be contiguous bytes or 16-bit words"):
        Decoder("DAVIS240C").push(data)


@settings(max_examples=50)
@given(st.lists(st.integers(0, 5000), max_size=6))
def test_any_pieces_decode_alike(cuts: list[int]) -> None:
    """An odd byte waits for the next piece, as does half a frame."""
    stream = Encoder("DAVIS240C").encode(**scene())
    whole = Decoder("DAVIS240C").push(stream)
    decoder = Decoder("DAVIS240C")
    places = sorted({0, len(stream), *cuts})
    pieces = [decoder.push(stream[a:b]) for a, b in itertools.pairwise(places)]
    np.testing.assert_array_equal(np.concatenate([piece.events for piece in pieces]), whole.events)
    np.testing.assert_array_equal(np.concatenate([piece.imu for piece in pieces]), whole.imu)
    assert_same_frames([frame for piece in pieces for frame in piece.frames], whole.frames)


def test_devices_know_their_size() -> None:
    """The image of a chip whose x and y are swapped on the wire is upright; registers go before the chip's values."""
    sizes = {"DAVIS240A": (240, 180), "DAVIS346B": (346, 260), "DAVIS128": (128, 128), "DAVIS640": (640, 480)}
    for chip, size in sizes.items():
        device = Device(chip)
        assert (device.chip, device.width, device.height) == (chip, *size)
        assert (device.frame_width, device.frame_height) == size
    assert Device(9).chip == "DAVIS346C"
    turned = Device("DAVIS240C", dvs_columns=3, dvs_rows=2, dvs_orientation=4, aps_columns=5, aps_rows=4, adc_mhz=29.5)
    assert (turned.width, turned.height, turned.frame_width, turned.frame_height) == (2, 3, 5, 4)
    assert Decoder(turned).device.adc_mhz == Encoder(turned).device.adc_mhz == 29.5
    assert repr(turned) == 'Device("DAVIS240C", 2 x 3)'


@pytest.mark.parametrize(
    ("build", "rule"),
    [
        (lambda: Decoder("DAVIS999"), 'a chip must be one of DAVIS240A, .*got "DAVIS999"'),
        (lambda: Device(7), "chip identifier 7"),
        (lambda: Device("DAVIS240C", dvs_rows=0), "dvs_rows must lie in 1..4096, got 0"),
        (lambda: Device("DAVIS240C", aps_columns=4097), "aps_columns must lie in 1..4096, got 4097"),
        (lambda: Device("DAVIS240C", aps_rows=-1), "aps_rows must lie in 1..4096, got -1"),
        (lambda: Device("DAVIS240C", adc_mhz=0), "adc_mhz must be positive, got 0"),
        (lambda: Encoder("DAVIS240C", accel_range=4), "accel_range must lie in 0..3, got 4"),
    ],
)
def test_bad_cameras_are_refused(build: Any, rule: str) -> None:
    """An argument out of range is a ValueError that names it and its value."""
    with pytest.raises(ValueError, match=rule):
        build()


def test_what_cannot_be_sent_is_refused() -> None:
    """The index of what is wrong is named, and the encoder goes on as if it had not been asked."""
    encoder = Encoder("DAVIS240C")
    pixels = np.zeros((2, 2), np.uint16)
    cases: list[tuple[dict[str, Any], str]] = [
        ({"events": np.array([(5, 240, 0, 1)], davis_rs.EVENT_DTYPE)}, "event 0: .240, 0. lies outside of 240 x 180"),
        ({"events": np.array([(5, 0, 0, 1), (4, 0, 0, 1)], davis_rs.EVENT_DTYPE)}, "event 1"),
        ({"triggers": np.array([(5, 9)], davis_rs.TRIGGER_DTYPE)}, "trigger 0: there is no kind 9"),
        ({"triggers": EVENT}, 'a field "kind" is needed'),
        ({"frames": [Frame(1, 1, 1, 1, 239, 0, pixels)]}, "frame 0: its region of 2 x 2 pixels at .239, 0."),
        ({"frames": [Frame(1, 1, 1, 1, 0, 0, pixels.astype(float))]}, "uint16 array"),
        ({"frames": [Frame(1, 1, 1, 1, 0, 0, pixels, True, 1e9)]}, "exposure"),
    ]
    for packet, rule in cases:
        with pytest.raises(ValueError, match=rule):
            encoder.encode(**packet)
    assert encoder.encode(EVENT) == Encoder("DAVIS240C").encode(EVENT)


def test_oddities_are_counted_by_kind() -> None:
    """The dictionary has a name for each kind, and only what happened is not zero."""
    decoder = Decoder("DAVIS240C")
    decoder.push(np.array([0x0000, 0x2001, 0x1FFF, 0x4001, 0x0007], np.uint16))
    odd = {name: count for name, count in decoder.stats.items() if count}
    assert odd == {
        "unknown_words": 1,
        "columns_without_row": 1,
        "addresses_out_of_range": 1,
        "frame_stray_words": 1,
        "imu_stray_words": 1,
    }


def test_the_gil_is_released() -> None:
    """While a long stream is decoded, another thread gets to run."""
    stream = Encoder("DAVIS240C").encode(**scene()) * 5000
    decoder, ticks, done = Decoder("DAVIS240C"), [], threading.Event()
    started = threading.Event()

    def tick() -> None:
        started.set()
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.0005)

    thread = threading.Thread(target=tick)
    thread.start()
    started.wait()
    begin = time.perf_counter()
    decoder.push(stream)
    end = time.perf_counter()
    done.set()
    thread.join()
    assert sum(begin < t < end for t in ticks) > 3


@pytest.mark.skipif(not STREAMS.is_dir(), reason="no reference streams in ../shared/aer")
@pytest.mark.parametrize("chip", ["DAVIS240C", "DAVIS346B"])
def test_reference_streams_encode_to_the_same_scene(chip: str) -> None:
    """A stream decoded, encoded and decoded again is the same; its events are the reference's."""
    decoded = Decoder(chip, imu_counts=True).push((STREAMS / f"{chip}-full-11.bin").read_bytes())
    again = Decoder(chip, imu_counts=True).push(Encoder(chip).encode(*decoded))
    for name in ("events", "imu", "triggers"):
        np.testing.assert_array_equal(getattr(again, name), getattr(decoded, name))
    assert_same_frames(again.frames, decoded.frames)
    rows = [
        line[2:].split(",") for line in (STREAMS / f"{chip}-full-11.csv").read_text().splitlines() if line[0] == "P"
    ]
    np.testing.assert_array_equal(
        decoded.events, np.array([tuple(map(int, row)) for row in rows], davis_rs.EVENT_DTYPE)
    )
