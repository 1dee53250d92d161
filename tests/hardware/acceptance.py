"""The acceptance test of the live camera: pyusb, libusb and the kernel's usbcore talk to a virtual DAVIS over USB/IP.

Root only, on a machine with vhci_hcd; run_qemu.sh runs it in one of its own. Exit status 0: all of it held.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import vhci

import davis_rs
from davis_rs.usb.link import find_devices

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "helpers"))

from streams import START, STOP, assert_same, contents, encode, join  # noqa: E402

SILENT_CHUNKS = 20
"""The stream counts as over after this many empty reads in a row, of 0.1 s each. The machine may be far slower than a
real camera."""


@dataclass
class Served:
    """A camera that is plugged in, and after it was pulled out what it has to tell."""

    words: bytes
    report: dict[str, Any] | None = None


@contextmanager
def plugged_in(chip: str, words: bytes, *options: str) -> Iterator[Served]:
    """Serve a camera in a process of its own and plug it into this kernel; at the end pull it out."""
    with tempfile.TemporaryDirectory() as folder:
        stream, report = Path(folder, "stream.bin"), Path(folder, "report.json")
        stream.write_bytes(words)
        files = ["--stream", str(stream), "--report", str(report)]
        command = [sys.executable, str(HERE / "usbip_server.py"), "--chip", chip, *files, *options]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            assert server.stdout.readline() == "listening\n"
            vhci.attach()
            served = Served(words)
            try:
                yield served
            finally:
                if server.poll() is None and not vhci.is_free():
                    vhci.detach()
                server.wait(30)
                vhci.wait_until_gone()
        served.report = json.loads(report.read_text())


def in_child(act: Callable[[], None]) -> None:
    """In a process of its own: without udev, libusb sees only the devices that were there when it began."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0, "failed in the child, see above"
        return
    try:
        act()
        status = 0
    except BaseException:
        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    os._exit(status)


def receive(camera: davis_rs.Davis, *, reset_after: int | None = None) -> davis_rs.Decoded:
    """All until the camera is silent; on the way, perhaps, a timestamp reset."""
    packets: list[davis_rs.Decoded] = []
    events = silent = 0
    for chunk in camera.chunks():
        packets.append(camera.decode(chunk))
        events += len(packets[-1].events)
        silent = 0 if chunk else silent + 1
        if reset_after is not None and events >= reset_after:
            camera.reset_timestamps()
            reset_after = None
        if silent == SILENT_CHUNKS and events:
            camera.stop()
    return join(packets)


def check_same(chip: str) -> None:
    """Events sent = events received; start and stop in the reference's order."""
    sent = contents(chip, events=100_000)
    words = encode(chip, sent)
    expected = davis_rs.Decoder(chip).push(words)

    def child() -> None:
        (found,) = find_devices()
        assert found.serial == "VIRTUAL"
        with davis_rs.Davis.open() as camera:
            assert camera.description.chip == chip
            got = receive(camera)
            assert camera.lost_bytes == 0
            assert not any(camera.stats.values()), camera.stats
        assert_same(got, expected)

    with plugged_in(chip, words) as served:
        in_child(child)
    report = served.report
    assert report is not None
    assert report["sent"] == {"bytes": len(words), "sha256": hashlib.sha256(words).hexdigest()}
    log = [entry if isinstance(entry, str) else tuple(entry) for entry in report["log"]]
    run = log[log.index("clear halt") - len(STOP) :]
    assert run == [*START, *STOP], run
    kinds = (
        f"{len(sent.events)} events, {len(sent.imu)} samples, {len(sent.frames)} frames, {len(sent.triggers)} triggers"
    )
    print(f"  {kinds} in {len(words)} bytes, sent = received; start and stop in order")


def check_unplugging(chip: str) -> None:
    """What arrived is delivered, then the error says that the camera was unplugged."""
    words = encode(chip, contents(chip, events=100_000))
    cut = len(words) // 3 * 2

    def child() -> None:
        packets: list[davis_rs.Decoded] = []
        ending: OSError | None = None
        try:
            with davis_rs.Davis.open() as camera:
                for packet in camera:
                    packets.append(packet)
        except OSError as error:
            ending = error
        assert ending is not None, "the iteration ended without an error"
        assert ending.errno == errno.ENODEV, ending
        assert "unplugged" in str(ending), ending
        got = join(packets)
        assert_same(got, davis_rs.Decoder(chip).push(words[:cut]))
        print(f"  {len(got.events)} events in the {cut} bytes before the end, all delivered; then ENODEV")

    with plugged_in(chip, words, "--unplug-after", str(cut)):
        in_child(child)


def check_reset(chip: str) -> None:
    """A timestamp reset in the middle: the clock starts anew, and a trigger says where."""
    sent = contents(chip, events=100_000)
    words = encode(chip, sent)

    def child() -> None:
        with davis_rs.Davis.open() as camera:
            got = receive(camera, reset_after=20_000)
        assert got.triggers["kind"].tolist().count(davis_rs.TriggerKind.TIMESTAMP_RESET) == 1
        first = len(got.events) - len(sent.events)
        assert 20_000 <= first < len(sent.events)
        assert (got.events[:first] == sent.events[:first]).all()
        assert (got.events[first:] == sent.events).all()
        print(f"  reset after {first} events, then all {len(sent.events)} from time 0")

    with plugged_in(chip, words) as served:
        in_child(child)
    assert served.report is not None
    at = served.report["log"].index([0, 2, 1])
    assert served.report["log"][at + 1] == [0, 2, 0]


def main() -> int:
    """Run all; returns the exit status."""
    failed = 0
    checks = (check_same, check_unplugging, check_reset)
    for chip in ("DAVIS240C", "DAVIS346B"):
        for check in checks if chip == "DAVIS240C" else checks[:1]:
            print(f"{chip}: {check.__doc__}", flush=True)
            started = time.monotonic()
            try:
                check(chip)
                print(f"  passed in {time.monotonic() - started:.1f} s", flush=True)
            except Exception:
                traceback.print_exc()
                failed += 1
    print("acceptance: " + (f"{failed} FAILED" if failed else "all passed"), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
