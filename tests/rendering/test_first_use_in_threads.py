"""The first use of Mitsuba in a process, from several threads at once."""

from __future__ import annotations

import subprocess
import sys

import pytest

SCRIPT = """
import sys, threading
from davis_rs._mitsuba.variants import default_variant, variant

sys.setswitchinterval(1e-6)
start, errors = threading.Barrier(6), []

def use():
    start.wait()
    try:
        with variant(default_variant()[0]) as (mi, dr):
            assert default_variant()[0] in mi.variants()
    except BaseException as error:
        errors.append(repr(error))

threads = [threading.Thread(target=use) for _ in range(6)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
sys.exit("\\n".join(errors) or None)
"""


@pytest.mark.few(1)
@pytest.mark.parametrize("attempt", range(4))
def test_threads_wait_until_mitsuba_is_imported(attempt: int) -> None:
    """Without a lock a thread finds the module half made, about every second time."""
    run = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
