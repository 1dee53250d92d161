"""The reprs of the Rust core's classes say what an object is set to and how far it has come."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from davis_rs import EVENT_DTYPE, CrossingEngine, Decoder, Device, Effects, Encoder
from davis_rs._core import EventFileReader, EventFileWriter, PixelRays
from one_triangle import one_triangle


def events(times: list[int]) -> np.ndarray:
    """An event at each of these times."""
    return np.array([(t, 1, 2, 1) for t in times], EVENT_DTYPE)


def test_an_engine_says_its_settings_and_its_time() -> None:
    engine = CrossingEngine(4, 3, contrast_threshold=0.25, log_eps=1e-6, interpolation="hermite")
    settings = "4 x 3, contrast_threshold=0.25, contrast_threshold_off=0.25, log_eps=1e-6"
    assert (
        repr(engine)
        == f'CrossingEngine({settings}, interpolation="hermite", effects=[], start_phase="zero", t_us=None)'
    )
    engine.push(1000, np.ones((3, 4), np.float32), np.ones((3, 4), np.float32))
    assert repr(engine).endswith("t_us=1000)")


def test_an_engine_says_which_effects_are_on() -> None:
    thresholds = np.full((3, 4), 0.2)
    thresholds[1, 2] = 0.3
    effects = Effects(leak_rate_hz=0.1, refractory_period_us=100, threshold_mismatch=0.0)
    text = repr(CrossingEngine(4, 3, contrast_threshold=thresholds, contrast_threshold_off=0.5, effects=effects))
    assert "contrast_threshold=0.2000..0.3000 by pixel, contrast_threshold_off=0.5," in text
    assert "effects=[refractory_period_us, leak_rate_hz]" in text


def test_decoder_and_encoder_say_their_camera() -> None:
    device = Device("DAVIS346B", dvs_columns=100)
    assert repr(device) == 'Device("DAVIS346B", 346 x 100)'
    encoder = Encoder(device, gyro_range=3)
    assert repr(encoder) == f"Encoder({device!r}, accel_range=1, gyro_range=3, t_us=0)"
    words = encoder.encode(events([5, 70_000]))
    assert repr(encoder).endswith("t_us=70000)")
    decoder = Decoder(device, imu_counts=True)
    decoder.push(words)
    assert repr(decoder) == f"Decoder({device!r}, imu_counts=True, stats: all zero)"
    decoder.push(bytes(4) + b"\x07\x00")
    assert repr(decoder).endswith("stats: unknown_words=2, imu_stray_words=1)")


def test_writers_and_readers_say_their_file_and_how_far_they_are(tmp_path: Path) -> None:
    path = tmp_path / "events.raw"
    writer = EventFileWriter(path, "evt2", width=8, height=6)
    begun = len(path.read_bytes())
    assert repr(writer) == f'EventFileWriter("{path}", "evt2", 8 x 6, 0 events in {begun} bytes, open)'
    writer.write(events([1, 2, 3]))
    size = writer.finish()
    assert repr(writer) == f'EventFileWriter("{path}", "evt2", 8 x 6, 3 events in {size} bytes, closed)'
    reader = EventFileReader(path, "evt2")
    assert repr(reader) == f'EventFileReader("{path}", "evt2", size unknown, 0 events in 0 of {size} bytes)'
    reader.read(10)
    assert repr(reader) == f'EventFileReader("{path}", "evt2", 8 x 6, 3 events in {size} of {size} bytes)'


def test_a_scene_renderer_says_what_it_renders() -> None:
    assert repr(PixelRays(3, 2, 4, np.zeros(48, np.float32))) == "PixelRays(3 x 2, rays=4)"
    assert repr(one_triangle()) == "SceneRenderer(triangles=1, frames=1, lights=1, shadows=True, threads=2)"
