"""Which libLLVM Mitsuba's fast variant shall use, decided before Dr.Jit is imported.

Dr.Jit takes the first libLLVM that it finds. Versions 15 and 16 pass its initialisation and then abort the process at
the first kernel, which nothing can catch; 14 and older are refused. So a usable library is looked for here, by version,
and named to Dr.Jit through ``DRJIT_LIBLLVM_PATH``.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

OLDEST_USABLE = 17
"""The oldest major version that compiles Dr.Jit's kernels."""

HOW_TO_GET_IT = (
    "install LLVM 17 or newer for the fast one (Debian 12: apt-get install libllvm19; Ubuntu: libllvm18; "
    "or name a libLLVM.so in DRJIT_LIBLLVM_PATH)"
)

# libLLVM-19.so, libLLVM.so.19.1; not what merely links to it, such as libLLVMSPIRVLib.so.19.
_PATTERNS = (
    "/usr/lib/*-linux-gnu/libLLVM[-.][0-9s]*",
    "/usr/lib64/libLLVM[-.][0-9s]*",
    "/usr/lib/libLLVM[-.][0-9s]*",
    "/usr/lib/llvm*/lib/libLLVM[-.][0-9s]*",
    "/usr/lib64/llvm*/lib/libLLVM[-.][0-9s]*",
    "/usr/local/lib/libLLVM[-.][0-9s]*",
)


def find_libllvm() -> Path | None:
    """The newest usable libLLVM, or None; a library named in ``DRJIT_LIBLLVM_PATH`` is the only candidate."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    candidates = [Path(named)] if named else _installed()
    versions = {path.resolve(): libllvm_major(path) for path in candidates}
    usable = [(major, str(path)) for path, major in versions.items() if major is not None and major >= OLDEST_USABLE]
    return Path(max(usable)[1]) if usable else None


def libllvm_major(path: Path) -> int | None:
    """The major version of a libLLVM, from its real file name or else by asking it; None if it cannot be loaded."""
    if not path.is_file():
        return None
    match = re.search(r"libLLVM-(\d+)|libLLVM\.so\.(\d+)", path.resolve().name)
    if match:
        return int(match.group(1) or match.group(2))
    return _ask_version(path)


def _installed() -> Iterable[Path]:
    root = Path("/")
    for pattern in _PATTERNS:
        yield from root.glob(pattern.lstrip("/"))
    yield from Path(sys.prefix).glob("lib/libLLVM[-.][0-9s]*")  # conda


def _ask_version(path: Path) -> int | None:
    """LLVMGetVersion (there since LLVM 16), called in a process of its own: a library loaded here would be Dr.Jit's."""
    program = (
        "import ctypes, sys; v = ctypes.c_uint(); "
        "ctypes.CDLL(sys.argv[1]).LLVMGetVersion(ctypes.byref(v), None, None); print(v.value)"
    )
    asked = subprocess.run([sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=False)
    return int(asked.stdout) if asked.returncode == 0 else None
