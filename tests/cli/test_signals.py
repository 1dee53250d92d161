"""Ctrl-C at any instant of a command: exit status 130, one line, and nothing else."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("signals.py")


def test_ctrl_c_at_random_instants_ends_in_one_line() -> None:
    """The short form of the program: its long one is in .ci/nightly."""
    only = [word for name in ("convert", "help") for word in ("--only", name)]
    done = subprocess.run(
        [sys.executable, str(PROGRAM), "--runs", "4", "--seed", "3", *only],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


CTRL_C = """
    import os, signal, sys

    class CtrlC:
        '''Sends it when a module is looked for.'''

        def find_spec(self, name, *_):
            if name == AWAITED:
                sys.meta_path.remove(self)
                os.kill(os.getpid(), signal.SIGINT)

    sys.argv = ["davis-rs", *sys.argv[1:]]
    sys.meta_path.insert(0, CtrlC())
"""
"""A program's beginning: it passes for davis-rs, and Ctrl-C comes at a known place."""


def ended_at(awaited: str, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """How a program ends to which Ctrl-C comes when it imports a module."""
    text = textwrap.dedent(CTRL_C).replace("AWAITED", repr(awaited)) + textwrap.dedent(program)
    command = [sys.executable, "-c", text, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def printed(program: str, awaited: str = "none") -> str:
    """What a program prints that ends well and says nothing else."""
    ended = ended_at(awaited, program)
    assert (ended.returncode, ended.stderr) == (0, "")
    return ended.stdout


@pytest.mark.few(2)
@pytest.mark.parametrize("awaited", ["argparse", "davis_rs.cli.parser", "davis_rs.cli.sensors", "numpy.linalg", "yaml"])
def test_ctrl_c_while_modules_load(awaited: str) -> None:
    """Modules of Python, of the command line, of a command, of NumPy amid its own import, and what is needed late."""
    program = "from davis_rs.cli import main\nsys.exit(main(sys.argv[1:]))"
    ended = ended_at(awaited, program, "sensors")
    assert (ended.returncode, ended.stderr) == (130, "davis-rs: stopped by Ctrl-C\n")


def test_the_core_finds_numpy_when_it_is_imported() -> None:
    """NumPy's functions are not looked up when the first array is made: Ctrl-C would then be a panic."""
    assert printed("import davis_rs._core\nprint('numpy' in sys.modules)") == "True\n"


def test_ctrl_c_after_the_result_changes_nothing() -> None:
    """What comes while Python ends would only print a traceback of the threads that are waited for."""
    program = """
    import threading, time
    from davis_rs.cli import main
    status = main(["sensors"])
    threading.Thread(target=lambda: (time.sleep(0.05), os.kill(os.getpid(), signal.SIGINT), time.sleep(0.05))).start()
    sys.exit(status)
    """
    assert "davis240c" in printed(program)


def test_ctrl_c_that_waited_for_an_import_is_told_once() -> None:
    """A command that ends early by itself, and has said so, gets no second line about it."""
    program = """
    import time
    from davis_rs._util.stop_requests import stop_requests
    from davis_rs.cli.ctrl_c import exit_status

    def run():
        import wave  # Ctrl-C comes here

        with stop_requests() as asked:
            while not asked():
                time.sleep(0.001)
        return 130

    print(exit_status(run, print))
    """
    assert printed(program, "wave") == "130\n"


def test_ctrl_c_in_a_program_that_calls_the_command_line_keeps_its_meaning() -> None:
    """The program's own handler is there again when a command has ended."""
    program = """
    sys.argv[0] = "mine"
    from davis_rs.cli import main
    print(main(["sensors"]), signal.getsignal(signal.SIGINT) is signal.default_int_handler)
    """
    assert printed(program).splitlines()[-1] == "0 True"


def test_ctrl_c_waits_until_a_lazy_export_is_whole() -> None:
    """For users of the library, too: the name is there afterwards, and Ctrl-C is raised."""
    program = """
    import davis_rs
    try:
        davis_rs.load_scene
    except KeyboardInterrupt:
        print("davis_rs.scene.load" in sys.modules, "numpy.linalg" in sys.modules)
    """
    assert printed(program, "davis_rs.scene.load") == "True True\n"


def test_ctrl_c_while_the_shell_completes_ends_it() -> None:
    """The library that completes goes on after a KeyboardInterrupt, and then fails at what it has left half done."""
    pytest.importorskip("argcomplete")
    program = """
    from davis_rs.cli import main
    from davis_rs.cli.parser import Parser

    def interrupted(*arguments, **more):
        os.kill(os.getpid(), signal.SIGINT)
        return parse(*arguments, **more)

    parse, Parser.parse_known_args = Parser.parse_known_args, interrupted
    os.environ |= {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_STDOUT_FILENAME": os.devnull}
    os.environ |= {"COMP_LINE": "davis-rs sim", "COMP_POINT": "12"}
    sys.exit(main())
    """
    ended = ended_at("none", program)
    assert (ended.returncode, ended.stderr.splitlines()[-1:]) == (130, ["davis-rs: stopped by Ctrl-C"])


ANOTHER_THREAD = """
import signal, sys, threading, time
from multiprocessing import util
from davis_rs.generate.local import run_locally

def nothing(): pass

if __name__ == "__main__":
    started, spawn = threading.Event(), util.spawnv_passfds

    def interrupt():
        started.wait()
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)
        started.clear()

    def spawn_and_interrupt(path, arguments, descriptors):
        number = spawn(path, arguments, descriptors)
        if "spawn_main" in str(arguments):
            started.set()
            while started.is_set():
                time.sleep(0.001)
        return number

    util.spawnv_passfds = spawn_and_interrupt
    threading.Thread(target=interrupt).start()
    try:
        list(run_locally(str, ["a"], workers=1, begin=nothing, report=print))
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.long
def test_ctrl_c_while_a_worker_is_started_waits_until_it_has_all(tmp_path: Path) -> None:
    """Also if another thread than the one that starts it receives the signal; the worker would miss what it is sent."""
    script = tmp_path / "starts.py"
    script.write_text(ANOTHER_THREAD)
    ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False)
    assert (ended.returncode, ended.stderr) == (130, "")
