"""Forecasts how much memory a run will take: told if it is much, refused if there is not so much."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from .argument_error import ArgumentError
from .budget import readable_bytes

TOLD_ABOVE = 0.25
"""A forecast above this share of what is available is told."""

WORKER_BYTES = 250 << 20
"""What a process takes that simulates a sensor of a few pixels: Python and its libraries."""


@dataclass(frozen=True)
class MemoryForecast:
    """Says what a run will take in addition to what its process has when it begins, with the scene's textures.

    Args:
        width, height: of the sensor, in pixels.
        bytes_per_pixel: by what takes them.
    """

    width: int
    height: int
    bytes_per_pixel: Mapping[str, float]

    @property
    def bytes(self) -> int:
        """Return the sum of all."""
        return math.ceil(self.width * self.height * sum(self.bytes_per_pixel.values()))

    def refuse(self, available: int | None = None) -> None:
        """Refuse a run for which there is not enough memory.

        Args:
            available: bytes; what the system says, if left out.

        Raises:
            ValueError: with what takes how much, and the size that fits.
        """
        available = available_bytes() if available is None else available
        if available is None or self.bytes <= available:
            return
        pixels = self.width * self.height
        takes = ", ".join(f"{what} {readable_bytes(int(pixels * size))}" for what, size in self.bytes_per_pixel.items())
        side = math.sqrt(available / self.bytes)
        fits = f"{max(1, math.floor(self.width * side))} x {max(1, math.floor(self.height * side))}"
        raise ArgumentError(
            "a {size} of {} x {} pixels needs about {} of memory ({}), and {} are available: {} would fit",
            *(self.width, self.height, readable_bytes(self.bytes), takes, readable_bytes(available), fits),
        )

    def line(self, available: int | None = None) -> str:
        """Return what is to be said of a run that takes much of the memory; "" of others."""
        return _told(f"{self.width} x {self.height} pixels", self.bytes, available)

    def workers(self, most: int, available: int | None = None) -> int:
        """Return how many of ``most`` processes can make such runs at the same time; at least 1."""
        available = available_bytes() if available is None else available
        if available is None:
            return most
        return max(1, min(most, available // (self.bytes + WORKER_BYTES)))


@dataclass(frozen=True)
class MeshForecast:
    """Says what the tables of a scene's triangles will take, those of the renderer's core included.

    Bytes a triangle are measured (``python benches/render_meshes.py``).

    Args:
        triangles: how many there are.
        textured: their texture coordinates count.
        smooth: their shading normals vary.
        sharp_lights: how many lights throw sharp shadows.
    """

    triangles: int
    textured: bool
    smooth: bool
    sharp_lights: int

    @property
    def bytes(self) -> int:
        """Return the sum of all."""
        each = _TRIANGLE + _TEXTURED * self.textured + _SMOOTH * self.smooth + _CONE * self.sharp_lights
        return each * self.triangles

    def refuse(self, available: int | None = None) -> None:
        """Refuse a scene for which there is not enough memory.

        Args:
            available: bytes; what the system says, if left out.

        Raises:
            ValueError: with what it takes, and how many triangles fit.
        """
        available = available_bytes() if available is None else available
        if available is None or self.bytes <= available:
            return
        fits = available * self.triangles // self.bytes
        raise ValueError(
            f"a scene of {self.triangles:,} triangles needs about {readable_bytes(self.bytes)} of memory, and "
            f"{readable_bytes(available)} are available: {fits:,} triangles would fit"
        )

    def line(self, available: int | None = None) -> str:
        """Return what is to be said of a scene that takes much of the memory; "" of others."""
        return _told(f"the scene's {self.triangles:,} triangles", self.bytes, available)


def _told(subject: str, taken: int, available: int | None) -> str:
    """Return what is to be said of something that takes much of the memory; "" of what does not.

    Args:
        subject: what takes it; the message begins with it.
        taken: bytes.
        available: bytes; None asks the system.
    """
    available = available_bytes() if available is None else available
    if available is None or taken <= TOLD_ABOVE * available:
        return ""
    return f"{subject} will take about {readable_bytes(taken)} of memory; {readable_bytes(available)} are available"


def simulation_forecast(
    size: tuple[int, int],
    *,
    cubic: bool = False,
    refine: bool = False,
    effects: bool = False,
    twin: bool = False,
    frames: bool = False,
    truth: bool = False,
    ray_bytes: float = 0,
) -> MemoryForecast:
    """Forecast the memory of a simulation.

    Bytes a pixel are measured (``python benches/memory_forecast.py``), with room to spare for events.

    Args:
        size: of the sensor, (width, height) in pixels.
        cubic: keyframes have rates.
        refine: event times are refined.
        effects: pixels are not ideal.
        twin: there is a twin of the pixels without noise.
        frames: active pixels are not ideal.
        truth: there are maps of flow, shapes or normals.
        ray_bytes: what the rays of a pixel take.
    """
    bytes_by_use = {
        "the state of pixels": (_STATE + _STATE_OF_EFFECTS * effects) * (1 + twin),
        "luma": _LUMA + _RATES * cubic + _FRAMES * frames,
        "events": _EVENTS + _REFINED * refine,
        "ground truth": _TRUTH * truth,
        "rays": ray_bytes,
    }
    return MemoryForecast(*size, {use: taken for use, taken in bytes_by_use.items() if taken})


def frames_forecast(
    size: tuple[int, int],
    *,
    frame_bytes: float,
    flow: bool = False,
    planes: int = 1,
    effects: bool = False,
    twin: bool = False,
) -> MemoryForecast:
    """Forecast the memory of a run over frames.

    Args:
        size: of the sensor, (width, height) in pixels.
        frame_bytes: of a frame as it is read, by pixel of the sensor.
        flow: light between frames is interpolated along optical flow.
        planes: of light in a frame: 3 behind colour filters.
        effects: pixels are not ideal.
        twin: there is a twin of the pixels without noise.
    """
    bytes_by_use = {
        "the state of pixels": (_STATE + _STATE_OF_EFFECTS * effects) * (1 + twin),
        "frames": _OF_FRAMES + _OF_MORE_PLANES * (planes - 1) + _FRAMES_AT_ONCE * frame_bytes,
        "events": _EVENTS,
        "optical flow": _FLOW * flow,
    }
    return MemoryForecast(*size, {use: taken for use, taken in bytes_by_use.items() if taken})


_STATE, _STATE_OF_EFFECTS = 36, 150
_LUMA, _RATES, _FRAMES = 50, 28, 20
_EVENTS, _REFINED = 30, 230
_TRUTH = 640
_OF_FRAMES, _OF_MORE_PLANES, _FRAMES_AT_ONCE, _FLOW = 155, 40, 8, 2400
_TRIANGLE, _TEXTURED, _SMOOTH, _CONE = 410, 140, 210, 64


def available_bytes() -> int | None:
    """Return what this process may still take, by the system, its control groups and its limits; None if nobody
    says."""
    limits = [_of_the_system(), _of_the_limit(), *_of_the_groups()]
    return min((max(0, size) for size in limits if size is not None), default=None)


def _of_the_system() -> int | None:
    kib = _fields(Path("/proc/meminfo")).get("MemAvailable:")
    return None if kib is None else kib * 1024


def _of_the_limit() -> int | None:
    """Return what RLIMIT_AS leaves of the address space; Windows has no such limit."""
    try:
        import resource
    except ImportError:
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    pages = _read(Path("/proc/self/statm")).split()
    if limit == resource.RLIM_INFINITY or not pages:
        return None
    return limit - int(pages[0]) * os.sysconf("SC_PAGE_SIZE")


def _of_the_groups(root: Path = Path("/sys/fs/cgroup"), own: Path = Path("/proc/self/cgroup")) -> list[int]:
    """Return what the control groups leave that this process is in, of both versions; caches can be given up."""
    left = []
    for line in _read(own).splitlines():
        number, controllers, path = line.split(":", 2)
        version_2 = (number, controllers) == ("0", "")
        if not version_2 and "memory" not in controllers.split(","):
            continue
        base = root if version_2 else root / "memory"
        limit, usage = (
            ("memory.max", "memory.current") if version_2 else ("memory.limit_in_bytes", "memory.usage_in_bytes")
        )
        # A limit of any group around holds too; a container often sees its own as the root.
        inner = base / path.lstrip("/")
        for group in {inner, *(up for up in inner.parents if up == base or base in up.parents)}:
            most, used = _read(group / limit).strip(), _read(group / usage).strip()
            if most.isdigit() and used.isdigit() and int(most) < _NO_LIMIT:
                stat = _fields(group / "memory.stat")
                cached = stat.get("inactive_file", 0) if version_2 else stat.get("total_inactive_file", 0)
                left.append(int(most) - int(used) + cached)
    return left


_NO_LIMIT = 1 << 60


def _fields(path: Path) -> dict[str, int]:
    lines = (line.split() for line in _read(path).splitlines())
    return {words[0]: int(words[1]) for words in lines if len(words) > 1 and words[1].isdigit()}


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""
