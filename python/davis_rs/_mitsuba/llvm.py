"""Decides which libLLVM Mitsuba's fast variant shall use, before Dr.Jit is imported.

Dr.Jit takes the first libLLVM that it finds. Versions 15 and 16 pass its initialisation and then abort the process at
the first kernel, which nothing can catch; 14 and older are refused. So a usable library is looked for here, by version,
and named to Dr.Jit through ``DRJIT_LIBLLVM_PATH``. The system's libraries come first. Where there is none, that of a
Rust toolchain from rustup serves: it exports what Dr.Jit needs, and every machine that built this package has one.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from .._core import RUST_SYSROOT

OLDEST_USABLE = 17
"""The oldest major version that compiles Dr.Jit's kernels."""

HOW_TO_GET_IT = (
    "install LLVM 17 or newer for the fast one (Debian 12: apt-get install libllvm19; Ubuntu: libllvm18; "
    "or any Rust toolchain of rustup, which brings one; or name a libLLVM.so in DRJIT_LIBLLVM_PATH)"
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

# libLLVM.so.22.1-rust-1.95.0-stable; not libLLVM-22-rust-1.95.0-stable.so next to it, which is a linker script.
_OF_A_TOOLCHAIN = "lib/libLLVM.so.[0-9]*"


_SHARED_RUSTUP_HOME = "/usr/local/rustup"  # of Rust's container images


class Libllvm(NamedTuple):
    """A libLLVM that Dr.Jit can use, and why it was chosen."""

    path: Path
    origin: str


def find_libllvm() -> Libllvm | None:
    """Find the libLLVM to use, or return None.

    A library named in ``DRJIT_LIBLLVM_PATH`` is the only candidate. Otherwise it is the newest of the system (or of a
    conda environment); without one that of the Rust toolchain that built this package; without that the newest of
    rustup's toolchains.
    """
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if named:
        sources: list[tuple[Iterable[Path], str]] = [([Path(named)], "named in DRJIT_LIBLLVM_PATH")]
    else:
        sources = [
            (_of_the_system(), "the newest of the system"),
            (_of_the_build(), "of the Rust toolchain that built davis_rs; the system has none"),
            (_of_rustup(), "of a Rust toolchain; the system has none"),
        ]
    for candidates, origin in sources:
        if (newest := _newest_usable(candidates)) is not None:
            return Libllvm(newest, origin)
    return None


def why_none() -> str:
    """Return why :func:`find_libllvm` gives None, in words."""
    none = f"no usable LLVM (>= {OLDEST_USABLE}) was found"
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if not named:
        return none
    major = libllvm_major(Path(named))
    return f"{none}: DRJIT_LIBLLVM_PATH names {named}, which " + (
        "is no library that can be loaded" if major is None else f"is LLVM {major}"
    )


def libllvm_major(path: Path) -> int | None:
    """Return the major version of a libLLVM, from its real file name or else by asking it; None if it cannot be
    loaded."""
    if not path.is_file():
        return None
    match = re.search(r"libLLVM-(\d+)|libLLVM\.so\.(\d+)", path.resolve().name)
    if match:
        return int(match.group(1) or match.group(2))
    return _ask_version(path)


def _newest_usable(candidates: Iterable[Path]) -> Path | None:
    versions = {path.resolve(): libllvm_major(path) for path in candidates}
    usable = [(major, str(path)) for path, major in versions.items() if major is not None and major >= OLDEST_USABLE]
    return Path(max(usable)[1]) if usable else None


def _of_the_system() -> Iterable[Path]:
    root = Path("/")
    for pattern in _PATTERNS:
        yield from root.glob(pattern.lstrip("/"))
    yield from Path(sys.prefix).glob("lib/libLLVM[-.][0-9s]*")  # conda


def _of_the_build() -> Iterable[Path]:
    return Path(RUST_SYSROOT).glob(_OF_A_TOOLCHAIN) if RUST_SYSROOT else ()


def _of_rustup() -> Iterable[Path]:
    homes = [os.environ.get("RUSTUP_HOME"), os.path.expanduser("~/.rustup"), _SHARED_RUSTUP_HOME]
    for home in homes:
        if home:
            yield from Path(home).glob(f"toolchains/*/{_OF_A_TOOLCHAIN}")


def _ask_version(path: Path) -> int | None:
    """Return LLVMGetVersion (there since LLVM 16), called in a process of its own: a library loaded here would be
    Dr.Jit's."""
    program = (
        "import ctypes, sys; v = ctypes.c_uint(); "
        "ctypes.CDLL(sys.argv[1]).LLVMGetVersion(ctypes.byref(v), None, None); print(v.value)"
    )
    asked = subprocess.run([sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=False)
    return int(asked.stdout) if asked.returncode == 0 else None
