"""The command line of cameras, run as a user runs it, on a camera in software."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from command_line import davis_rs
from davis_rs import load_scene, read_events, simulate
from recording_files import aedat2, aedat2_event


def libusb() -> bool:
    """Whether libusb is installed, without which no camera can be looked for."""
    from usb.backend import libusb1

    return libusb1.get_backend() is not None


def test_a_scene_is_recorded_and_decoded(tmp_path: Path) -> None:
    """From the simulator through words, the camera's USB, a file, and the decoder: the same events."""
    raw, arrays = tmp_path / "planes.davis", tmp_path / "planes.npz"
    recorded = davis_rs("record", "--virtual", "three_planes", "--duration", 0.05, "-o", raw)
    assert recorded.returncode == 0, recorded.stderr
    assert "bytes of DAVIS240C VIRTUAL" in recorded.stdout
    decoded = davis_rs("decode", raw, "-o", arrays)
    assert decoded.returncode == 0, decoded.stderr
    assert "oddities" not in decoded.stdout
    scene = load_scene("three_planes")
    packets = list(simulate(scene, duration_s=0.05))
    with np.load(arrays) as found:
        np.testing.assert_array_equal(found["events"], np.concatenate([packet.events for packet in packets]))
        assert found["frame_times"][:, 3].tolist() == [25_000, 50_000]
    counted = davis_rs("decode", raw)
    assert counted.returncode == 0
    assert "2 frames, 0 triggers" in counted.stdout

    again = davis_rs("record", "--virtual", "three_planes", "--duration", 0.05, "-o", raw)
    assert (again.returncode, "exists: choose another file" in again.stderr) == (1, True)
    live = davis_rs("record", "--virtual", "three_planes", "--duration", 0.05, "-o", tmp_path / "events.txt")
    assert live.returncode == 0, live.stderr
    assert "2 frames" in live.stdout
    events = read_events(tmp_path / "events.txt")
    np.testing.assert_array_equal(events, np.concatenate([packet.events for packet in packets]))


def test_a_recording_of_other_software_is_decoded_alike(tmp_path: Path) -> None:
    """Its times count from its first; what the file says of itself is told."""
    recording, text = tmp_path / "old.aedat", tmp_path / "events.txt"
    recording.write_bytes(aedat2([(aedat2_event(3, 5, 1), 700), (aedat2_event(4, 5, 0), 1_700)]))
    decoded = davis_rs("decode", recording, "-o", text)
    assert decoded.returncode == 0, decoded.stderr
    assert decoded.stdout.startswith("AEDAT 2.0, DAVIS240C, ")
    assert "from 700 us on: 2 events" in decoded.stdout
    assert text.read_text().splitlines() == ["0.000000000 3 5 1", "0.001000000 4 5 0"]


def test_what_cannot_be_done_is_one_sentence(tmp_path: Path) -> None:
    """No traceback, no file left behind."""
    nobody = "serial number NOBODY on the USB; --virtual SCENE records a simulated one"
    for arguments, message in (
        (["record", "-o", tmp_path / "a.davis", "--duration", 0], "duration must be positive"),
        (["record", "-o", tmp_path / "a.davis", "--serial", "NOBODY"], nobody if libusb() else "libusb 1.0 was not"),
        (["record", "-o", tmp_path / "a.davis", "--virtual", "no_such_scene"], "no_such_scene"),
        (["decode", tmp_path / "missing.davis"], "missing.davis"),
    ):
        failed = davis_rs(*arguments)
        assert (failed.returncode, "Traceback" in failed.stderr) == (1, False)
        assert message in failed.stderr
    assert list(tmp_path.iterdir()) == []
