"""Which libLLVM is chosen, and that one which would abort the process never runs a kernel."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from davis_rs._core import RUST_SYSROOT
from davis_rs._mitsuba import llvm as _llvm
from davis_rs._mitsuba.llvm import find_libllvm, libllvm_major
from davis_rs._mitsuba.variants import FAST

INSTALLED = find_libllvm()
LLVM_15 = Path("/usr/lib/x86_64-linux-gnu/libLLVM-15.so.1")
needs_usable_llvm = pytest.mark.skipif(
    INSTALLED is None, reason=f"needs a libLLVM >= {_llvm.OLDEST_USABLE} on this machine"
)
needs_llvm_15 = pytest.mark.skipif(not LLVM_15.exists(), reason=f"needs {LLVM_15}")


def chosen() -> Path | None:
    found = find_libllvm()
    return None if found is None else found.path


def touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in place of those of the system where libraries are looked for, and no Rust."""
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(_llvm, "RUST_SYSROOT", str(tmp_path / "no-rust"))
    monkeypatch.setenv("RUSTUP_HOME", str(tmp_path / "rustup"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(_llvm, "_SHARED_RUSTUP_HOME", str(tmp_path / "shared-rustup"))
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "no-conda"))
    patterns = [f"{tmp_path}{pattern}" for pattern in _llvm._PATTERNS]
    monkeypatch.setattr(_llvm, "_PATTERNS", patterns)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "major"),
    [
        ("libLLVM-15.so.1", 15),
        ("libLLVM-14.0.6.so.1", 14),
        ("libLLVM-19.so", 19),
        ("libLLVM.so.19.1", 19),
        ("libLLVM.so.22.0git", 22),
        ("libLLVM-17.so.1", 17),
        ("libLLVM.so.22.1-rust-1.95.0-stable", 22),
    ],
)
def test_version_from_the_file_name(tmp_path: Path, name: str, major: int) -> None:
    """Each distribution's way to name a libLLVM tells its major version; the file itself is not loaded."""
    assert libllvm_major(touch(tmp_path / name)) == major


def test_version_from_the_file_behind_a_link(tmp_path: Path) -> None:
    """A link counts as the file that it leads to, whatever the link is called; a dangling one is none."""
    real = touch(tmp_path / "libLLVM.so.19.1")
    for name in ("libLLVM-19.so", "libLLVM.so", "libLLVM-15.so"):
        (tmp_path / name).symlink_to(real)
        assert libllvm_major(tmp_path / name) == 19
    (tmp_path / "libLLVM-18.so").symlink_to(tmp_path / "gone")
    assert libllvm_major(tmp_path / "libLLVM-18.so") is None
    assert libllvm_major(tmp_path / "libLLVM-20.so") is None


def test_a_file_that_cannot_be_asked_has_no_version(tmp_path: Path) -> None:
    """A libLLVM.so without version that is no library is asked, fails in its own process, and counts as unusable."""
    assert libllvm_major(touch(tmp_path / "libLLVM.so")) is None


@needs_usable_llvm
def test_a_library_without_version_in_its_name_is_asked(system: Path) -> None:
    """A real libLLVM under a bare name tells its version when asked; a library that merely looks alike is not asked."""
    assert INSTALLED is not None
    bare = system / "usr/lib/libLLVM.so"
    bare.parent.mkdir(parents=True)
    shutil.copy(INSTALLED.path, bare)
    assert libllvm_major(bare) == libllvm_major(INSTALLED.path)
    assert chosen() == bare
    bare.rename(bare.with_name("libLLVMSPIRVLib.so"))
    assert find_libllvm() is None


def test_the_newest_usable_is_chosen(system: Path) -> None:
    """Of several the newest from 17 on, wherever it lies and however it is named; 9 is not newer than 19."""
    assert find_libllvm() is None
    touch(system / "usr/lib/x86_64-linux-gnu/libLLVM-9.so.1")
    touch(system / "usr/lib/x86_64-linux-gnu/libLLVM-15.so.1")
    touch(system / "usr/lib/libLLVM-16.so")
    touch(system / "usr/lib/x86_64-linux-gnu/libLLVM-14.0.6.so.1")
    assert find_libllvm() is None, "15 and 16 abort the process; older ones are refused"
    touch(system / "usr/lib64/libLLVM-17.so")
    assert chosen() == system / "usr/lib64/libLLVM-17.so"
    touch(system / "usr/lib/llvm-19/lib/libLLVM.so.19.1")
    assert chosen() == system / "usr/lib/llvm-19/lib/libLLVM.so.19.1"
    touch(system / "usr/local/lib/libLLVM-18.so")
    assert chosen() == system / "usr/lib/llvm-19/lib/libLLVM.so.19.1"
    touch(system / "no-conda/lib/libLLVM-20.so")
    assert chosen() == system / "no-conda/lib/libLLVM-20.so"


def test_the_library_of_the_environment_is_the_only_candidate(system: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """DRJIT_LIBLLVM_PATH overrides what is installed: a usable one is taken, a 15 or a missing file means none."""
    touch(system / "usr/lib/libLLVM-19.so")
    for name, usable in (("libLLVM-18.so.1", True), ("libLLVM-15.so.1", False), ("libLLVM-16.so.1", False)):
        path = touch(system / "own" / name)
        monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(path))
        assert chosen() == (path if usable else None)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(system / "own/missing.so"))
    assert find_libllvm() is None


OF_RUST = "lib/libLLVM.so.22.1-rust-1.95.0-stable"


def test_rust_brings_one_where_the_system_has_none(system: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The toolchain of the build is taken before others of rustup, each only where the system has no usable LLVM."""
    touch(system / "usr/lib/x86_64-linux-gnu/libLLVM-15.so.1")
    touch(system / "home/.rustup/toolchains/old/lib/libLLVM.so.20.1-rust-1.88.0-stable")
    assert chosen() == system / "home/.rustup/toolchains/old/lib/libLLVM.so.20.1-rust-1.88.0-stable"
    newer = touch(system / "rustup/toolchains/new/lib/libLLVM.so.21.1-rust-1.90.0-stable")
    assert find_libllvm() == (newer, "of a Rust toolchain; the system has none")
    monkeypatch.setattr(_llvm, "RUST_SYSROOT", str(system / "sysroot"))
    built_with = touch(system / "sysroot/lib/libLLVM.so.19.1-rust-1.88.0-stable")
    assert find_libllvm() == (built_with, "of the Rust toolchain that built davis_rs; the system has none")
    of_the_system = touch(system / "usr/lib/x86_64-linux-gnu/libLLVM-17.so.1")
    assert find_libllvm() == (of_the_system, "the newest of the system")
    named = touch(system / "own/libLLVM-18.so.1")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(named))
    assert find_libllvm() == (named, "named in DRJIT_LIBLLVM_PATH")


def test_a_toolchains_linker_script_is_no_library(system: Path) -> None:
    """Rust's libLLVM-22-rust-1.95.0-stable.so is a text for the linker: Dr.Jit could not load it."""
    touch(system / "rustup/toolchains/stable/lib/libLLVM-22-rust-1.95.0-stable.so")
    assert chosen() is None
    real = touch(system / "rustup/toolchains/stable" / OF_RUST)
    assert chosen() == real


def test_an_unusable_choice_is_named(system: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever names a library that cannot serve is told which, and what it is."""
    assert _llvm.why_none() == "no usable LLVM (>= 17) was found"
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(touch(system / "own/libLLVM-15.so.1")))
    assert _llvm.why_none().endswith("own/libLLVM-15.so.1, which is LLVM 15")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nonexistent/libLLVM.so")
    assert _llvm.why_none().endswith("names /nonexistent/libLLVM.so, which is no library that can be loaded")


@pytest.mark.long
@pytest.mark.skipif(
    next(iter(Path(RUST_SYSROOT or "/nonexistent").glob("lib/libLLVM.so.*")), None) is None,
    reason="needs the Rust toolchain that built davis_rs, with a libLLVM of its own",
)
def test_the_toolchain_of_the_build_renders(run_python: Callable[..., str]) -> None:
    """With no other LLVM on the machine, and no rustc on the path, the library of the build's toolchain is taken."""
    no_other = "import davis_rs._mitsuba.llvm as l; l._PATTERNS = (); l._of_rustup = lambda: ()\n"
    told = "from davis_rs._mitsuba.variants import default_variant; print(default_variant()[1])\n"
    program = no_other + RENDER + told
    variant, reason, why = run_python(program, DRJIT_LIBLLVM_PATH="", PATH="/nonexistent").splitlines()
    assert variant == FAST
    assert reason == "diffuse triangles under point light, with shadows"
    assert RUST_SYSROOT in why
    assert "of the Rust toolchain that built davis_rs" in why


RENDER = """
import os
import sys
if "preload" in sys.argv:
    import mitsuba
    mitsuba.set_variant("llvm_ad_rgb")
    import drjit
    assert drjit.detail.llvm_version()[0] == 15
    del os.environ["DRJIT_LIBLLVM_PATH"]
from davis_rs import Camera, Pose, Scene
from davis_rs.render.choice import make_renderer
from davis_rs.geometry.trajectory.views import Views

floor = {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": 0.5}}
light = {"type": "point", "position": [0.0, 0.0, 2.0], "intensity": 1.0}
scene = Scene("floor", lambda: {"type": "scene", "by": {"type": "direct"}, "light": light, "floor": floor})
kind = "integrator" if "integrator" in sys.argv else "table"
renderer = make_renderer(scene, Camera(5, 4, 9.0, 9.0, 2.0, 1.5), rays_per_pixel=1, kind=kind)
assert renderer.luma(Views.at_rest([Pose([0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0])])).min() > 0
print(renderer.variant)
print(renderer.reason)
"""


@needs_llvm_15
def test_an_llvm_that_would_abort_is_never_run(run_python: Callable[..., str]) -> None:
    """With DRJIT_LIBLLVM_PATH naming an LLVM 15 the scalar variant renders, and the process lives."""
    variant, reason = run_python(RENDER, "integrator", DRJIT_LIBLLVM_PATH=str(LLVM_15)).splitlines()
    assert variant == "scalar_rgb"
    assert "no usable LLVM (>= 17) was found" in reason


@pytest.mark.long
@needs_llvm_15
@needs_usable_llvm
def test_an_llvm_that_is_loaded_already_is_not_run(run_python: Callable[..., str]) -> None:
    """A program that had Dr.Jit load an LLVM 15 before us gets the scalar variant, with the version named."""
    variant, reason = run_python(RENDER, "preload", "integrator", DRJIT_LIBLLVM_PATH=str(LLVM_15)).splitlines()
    assert variant == "scalar_rgb"
    assert reason.startswith("LLVM 15")
    assert "loaded already" in reason


@needs_usable_llvm
def test_a_usable_llvm_gives_the_fast_variant(run_python: Callable[..., str]) -> None:
    """Where a usable library is found, a fresh process has the fast variant, and so the table kernel."""
    assert INSTALLED is not None
    variant, reason = run_python(RENDER, DRJIT_LIBLLVM_PATH=str(INSTALLED.path)).splitlines()
    assert variant == FAST
    assert reason == "diffuse triangles under point light, with shadows"
