"""What other systems lack is not asked of them."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest

from davis_rs._util.holding import Hold
from davis_rs._util.memory_forecast import available_bytes
from davis_rs._util.platforms import ctrl_c_blocked, unblock_ctrl_c, usable_cores


def test_cores_without_affinity(monkeypatch: pytest.MonkeyPatch) -> None:
    assert usable_cores() == len(os.sched_getaffinity(0))
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    assert usable_cores() == 6


def test_ctrl_c_waits_where_it_can(monkeypatch: pytest.MonkeyPatch) -> None:
    def blocked() -> bool:
        return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, set())

    with ctrl_c_blocked():
        assert blocked()
        unblock_ctrl_c()
        assert not blocked()
    assert not blocked()
    monkeypatch.delattr(signal, "pthread_sigmask")
    with ctrl_c_blocked():
        unblock_ctrl_c()


def test_without_locks_and_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = Hold(tmp_path)
    assert first.is_exclusive
    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setitem(sys.modules, "resource", None)
    second = Hold(tmp_path)
    assert not second.is_exclusive
    second.release()
    available_bytes()
