"""Events in a browser as they come: what is served, to whom, and what a browser draws of it."""

from __future__ import annotations

import http.client
import shutil
import struct
import subprocess
import threading
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from davis_rs import EVENT_DTYPE
from davis_rs.cli.main import main
from davis_rs.cli.show import ShownEvents
from davis_rs.inspection import live_view
from davis_rs.inspection.live_view import LiveView

HEAD = struct.Struct("<IqQ")


def get(address: str, path: str = "") -> tuple[int, bytes]:
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=10)
    connection.request("GET", parts.path + path)
    response = connection.getresponse()
    return response.status, response.read()


def pictures_of(stream: bytes) -> list[tuple[int, int, dict[int, int]]]:
    """Of each picture the time, the events so far, and the polarity of each pixel that changed."""
    pictures: list[tuple[int, int, dict[int, int]]] = []
    at = 0
    while True:
        count, t_us, events = HEAD.unpack_from(stream, at)
        at += HEAD.size
        if count == 2**32 - 1:
            assert at == len(stream)
            return pictures
        words = np.frombuffer(stream, "<u4", count, at)
        at += 4 * count
        pictures.append((t_us, events, {int(word) >> 1: int(word) & 1 for word in words}))


def test_a_picture_has_the_last_event_of_each_pixel_that_changed() -> None:
    first = np.array([(1, 2, 0, 1), (2, 2, 0, 0), (3, 0, 1, 1)], EVENT_DTYPE)
    with LiveView((4, 3), "a test", browser=False) as view:
        view.add(first, 10)
        assert view._changed(0)[0] == HEAD.pack(2, 10, 3) + struct.pack("<2I", 2 * 2 + 0, 2 * 4 + 1)
        view.add(np.array([(11, 3, 2, 0)], EVENT_DTYPE), 20)
        data, picture, over = view._changed(1)
        assert data == HEAD.pack(1, 20, 4) + struct.pack("<I", 2 * 11)
        assert not over
        assert view._changed(picture)[0] == HEAD.pack(0, 20, 4)
        # Who comes late gets what there is.
        assert view._changed(0)[0] == HEAD.pack(3, 20, 4) + struct.pack("<3I", 4, 9, 22)


def test_the_stream_ends_with_all_that_came(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_view, "PICTURE_S", 0.005)
    found: list[bytes] = []
    random = np.random.default_rng(0)
    expected: dict[int, int] = {}
    with LiveView((40, 30), "a test", browser=False) as view:
        watching = threading.Thread(target=lambda: found.append(get(view.address, "pictures")[1]))
        watching.start()
        for t_us in range(0, 5000, 100):
            events = np.zeros(50, EVENT_DTYPE)
            events["x"], events["y"] = random.integers(0, 40, 50), random.integers(0, 30, 50)
            events["p"] = random.integers(0, 2, 50)
            for event in events:
                expected[int(event["y"]) * 40 + int(event["x"])] = int(event["p"])
            view.add(events, t_us)
        assert view._watched.wait(10)
    watching.join(10)
    pictures = pictures_of(found[0])
    assert pictures[-1][:2] == (4900, 2500)
    drawn: dict[int, int] = {}
    for _, _, changed in pictures:
        drawn.update(changed)
    assert drawn == expected


def test_only_this_machine_and_only_with_its_word_is_answered() -> None:
    with LiveView((4, 3), "<b>&", browser=False) as view:
        assert view.address.startswith("http://127.0.0.1:")
        assert view._server.server_address[0] == "127.0.0.1"
        status, page = get(view.address)
        assert status == 200
        assert b"<title>&lt;b&gt;&amp;</title>" in page
        assert b"$" not in page.replace(b"${", b"")
        root = view.address.rsplit("/", 2)[0]
        for path in ("/", "/pictures", "/live.html"):
            assert get(root, path)[0] == 404
    with pytest.raises(OSError, match="refused"):
        get(view.address)


def test_a_run_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The page is served while the run goes on; its stream has the run's events."""
    streams: list[bytes] = []

    def browse(address: str) -> bool:
        threading.Thread(target=lambda: streams.append(get(address, "pictures")[1])).start()
        return True

    monkeypatch.setattr("webbrowser.open", browse)
    np.save(tmp_path / "e.npy", np.random.default_rng(1).integers(0, 256, (6, 20, 30), np.uint8))
    words = ["frames", tmp_path / "e.npy", "--fps", "50", "-o", tmp_path / "out", "--show", "--interpolation", "linear"]
    assert main(list(map(str, words))) == 0
    printed = capsys.readouterr()
    assert "events are shown at http://127.0.0.1:" in printed.err
    while not streams:
        pass
    _, events, _ = pictures_of(streams[0])[-1]
    assert f"{events:,} events of 6 frames" in printed.out
    assert main(["simulate", "three_planes", "--rig", "stereo-davis346", "-o", str(tmp_path / "r"), "--show"]) == 1
    assert "--show shows one camera" in capsys.readouterr().err


def test_nothing_is_served_unless_it_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_view, "LiveView", None)
    with ShownEvents("a test", wanted=False) as shown:
        shown.add(np.zeros(1, EVENT_DTYPE), 0, (4, 3))


CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
def test_a_browser_draws_it() -> None:
    with LiveView((4, 3), "a test", browser=False) as view:
        view.add(np.array([(1, 2, 0, 1)], EVENT_DTYPE), 1500)
        command = [
            str(CHROMIUM),
            "--headless",
            "--no-sandbox",
            "--virtual-time-budget=2000",
            "--dump-dom",
            view.address,
        ]

        # Virtual time does not wait for a stream that goes on.
        def end() -> None:
            view._watched.wait(50)
            view.__exit__()

        ending = threading.Thread(target=end)
        ending.start()
        drawn = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60).stdout
        ending.join()
    assert "t = 0.002 s · 1 events" in drawn
    assert 'data-state="over"' in drawn
