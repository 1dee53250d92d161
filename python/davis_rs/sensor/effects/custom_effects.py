"""Calls effects of a user's own, and checks what they return."""

from __future__ import annotations

import hashlib
import inspect
import json
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from ..._core import log_intensity
from ..._util.named_entry import load_entry
from ...events.arrays import EVENT_DTYPE, EventArray, as_events

_METHODS = ("luma", "log_intensity", "events")
_Float = TypeVar("_Float", np.float32, np.float64)


class CustomEffects:
    """Holds a user's own effects, in the order in which they act; docs/effects.md says what methods one may have.

    Each is an object with one or more of these methods, and need not derive from anything:

    - ``luma(t_us, luma)``: linear luma, float32 (H, W), of each keyframe in the order of time; behind the lens, before
      the pixels. Returns luma of the same shape, finite and >= 0.
    - ``log_intensity(t_us, log_intensity)``: likewise ln(luma + log_eps), float64 (H, W), before the photoreceptor.
      Returns finite numbers.
    - ``events(start_us, end_us, events)``: the events in (start_us, end_us], behind the bus; the intervals follow each
      other without a gap. Returns events in that interval, sorted by (t, y, x), or behind a bus by t, in the sensor.
      An effect keeps what shall come later for a later call. After the last interval ``end_us`` is None: then it
      returns all that it kept.
    - ``begin(width, height, seed)``: called before all others, at the begin of a run.

    Args:
        effects: one such object, ``MODULE:NAME``, ``FILE.py:NAME``, or a sequence of these; None for none. A name that
            stands for a class or a function is called without arguments, and gives the object.
        width, height: of the sensor in pixels.
        seed: of the simulation.
        behind_bus: whether a bus (:class:`~davis_rs.sensor.effects.Readout`) orders the events of one stamp.

    Raises:
        ValueError: for an object without any of these methods, or an entry that is not there.
        OSError: if a file cannot be read.
    """

    def __init__(self, effects: object, width: int, height: int, seed: int, *, behind_bus: bool = False) -> None:
        if effects is None:
            given: Sequence[object] = ()
        else:
            given = effects if isinstance(effects, list | tuple) else (effects,)
        self._effects = [load_custom_effect(one) if isinstance(one, str) else one for one in given]
        for effect in self._effects:
            if isinstance(effect, type) or not any(callable(getattr(effect, method, None)) for method in _METHODS):
                hint = "; an object is wanted, this is a class" if isinstance(effect, type) else ""
                raise ValueError(
                    f"a custom effect must have one of the methods {', '.join(_METHODS)}, got {effect!r}{hint}"
                )
        self._width, self._height, self._behind_bus = width, height, behind_bus
        for effect in self._effects:
            if callable(getattr(effect, "begin", None)):
                effect.begin(width, height, seed)  # type: ignore[attr-defined]

    def __bool__(self) -> bool:
        """Return whether there are any effects."""
        return bool(self._effects)

    @property
    def on_luma(self) -> bool:
        """Return whether an effect acts on luma."""
        return any(True for _ in self._having("luma"))

    @property
    def on_log_intensity(self) -> bool:
        """Return whether an effect acts on log intensity."""
        return any(True for _ in self._having("log_intensity"))

    @property
    def on_events(self) -> bool:
        """Return whether an effect acts on events."""
        return any(True for _ in self._having("events"))

    def luma(self, t_us: int, luma: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Apply the effects on luma.

        Raises:
            ValueError: for a result that is not luma, naming effect, time, rule and pixel.
        """
        for effect, act in self._having("luma"):
            luma = _frame(effect, "luma", t_us, act(t_us, luma.copy()), luma.shape, np.float32)
            if luma.min() < 0:
                y, x = np.unravel_index(luma.argmin(), luma.shape)
                raise ValueError(f"{_at(effect, 'luma', t_us)} must be >= 0, got {luma[y, x]} at pixel ({x}, {y})")
        return luma

    def log_intensity(self, t_us: int, luma: npt.NDArray[np.float32], log_eps: float) -> npt.NDArray[np.float64]:
        """Apply the effects on log intensity.

        Raises:
            ValueError: for a result that is not log intensity, naming effect, time, rule and pixel.
        """
        logs: npt.NDArray[np.float64] = np.asarray(log_intensity(luma, log_eps))
        for effect, act in self._having("log_intensity"):
            logs = _frame(effect, "log_intensity", t_us, act(t_us, logs.copy()), logs.shape, np.float64)
        return logs

    def events(self, start_us: int, end_us: int | None, events: EventArray) -> EventArray:
        """Apply the effects on the events of (start_us, end_us]; with None as the end, return all that they still keep.

        Raises:
            ValueError: for a result that is not a stream of this interval and this sensor, naming effect, rule and
                event.
        """
        for effect, act in self._having("events"):
            events = self._stream(effect, start_us, end_us, act(start_us, end_us, events.copy()))
        return events

    def describe(self) -> list[dict[str, object]]:
        """Return a record of each effect: its class, where it acts, its parameters, its source file's SHA-256."""
        return [_described(one) for one in self._effects]

    def _having(self, method: str) -> Iterable[tuple[object, Callable[..., npt.ArrayLike]]]:
        return ((one, getattr(one, method)) for one in self._effects if callable(getattr(one, method, None)))

    def _stream(self, effect: object, start_us: int, end_us: int | None, result: npt.ArrayLike) -> EventArray:
        end = "the end" if end_us is None else f"{end_us}"
        where = f"{_name(effect)}.events of ({start_us}, {end}] us"
        try:
            events = as_events(result)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{where}: {error}") from None
        t, x, y = events["t"], events["x"].astype(np.int64), events["y"].astype(np.int64)
        late = np.zeros(len(t), np.bool_) if end_us is None else t > end_us
        pixel = np.zeros_like(y) if self._behind_bus else y * 65536 + x
        backward = np.zeros(len(t), np.bool_)
        backward[1:] = (t[1:] < t[:-1]) | ((t[1:] == t[:-1]) & (pixel[1:] < pixel[:-1]))
        for wrong, rule in (
            ((x >= self._width) | (y >= self._height), f"events must lie in {self._width} x {self._height} pixels"),
            (events["p"] > 1, "p must be 0 or 1"),
            ((t <= start_us) | late, "events must lie in that interval"),
            (backward, f"events must be sorted by {'t' if self._behind_bus else '(t, y, x)'}"),
        ):
            if wrong.any():
                first = int(wrong.argmax())
                raise ValueError(f"{where}: {rule}, got {events[first]} as number {first} of {len(t)}")
        whole = np.zeros(len(t), EVENT_DTYPE)  # padding included: equal streams are equal bytes
        for name in EVENT_DTYPE.names or ():
            whole[name] = events[name]
        return whole


def load_custom_effect(entry: str) -> object:
    """Load the object that ``MODULE:NAME`` or ``FILE.py:NAME`` stands for.

    A class or a function is called without arguments.

    Raises:
        ValueError: if there is no such module or name.
        OSError: if there is no such file.
    """
    entity = load_entry(entry, "custom effect")
    if isinstance(entity, type) or inspect.isfunction(entity):
        try:
            inspect.signature(entity).bind()
        except TypeError as error:
            name = entry.rpartition(":")[2]
            raise ValueError(f"custom effect {entry!r}: {name}() is called without arguments: {error}") from None
        return entity()
    return entity


def _frame(
    effect: object, method: str, t_us: int, result: npt.ArrayLike, shape: tuple[int, ...], dtype: type[_Float]
) -> npt.NDArray[_Float]:
    """Check that an effect returned a finite frame of this shape, and return it."""
    where = _at(effect, method, t_us)
    array = np.asarray(result)
    if array.shape != shape:
        raise ValueError(f"{where} must have the shape {shape}, got {'None' if result is None else array.shape}")
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{where} must be numbers, got dtype {array.dtype}")
    with np.errstate(over="ignore"):  # reported below
        frame = np.ascontiguousarray(array, dtype)
    finite = np.isfinite(frame)
    if not finite.all():
        y, x = np.unravel_index(finite.argmin(), shape)
        raise ValueError(f"{where} must be finite, got {frame[y, x]} at pixel ({x}, {y})")
    return frame


def _at(effect: object, method: str, t_us: int) -> str:
    return f"{_name(effect)}.{method} at {t_us} us"


def _name(effect: object) -> str:
    return type(effect).__qualname__


def _described(effect: object) -> dict[str, object]:
    kind = type(effect)
    source = inspect.getsourcefile(kind) if kind.__module__ in sys.modules else None
    sha256 = hashlib.sha256(Path(source).read_bytes()).hexdigest() if source and Path(source).is_file() else None
    return {
        "class": f"{kind.__module__}:{kind.__qualname__}",
        "acts_on": [method for method in _METHODS if callable(getattr(effect, method, None))],
        "parameters": _parameters(effect),
        "source_sha256": sha256,
    }


def _parameters(effect: object) -> object:
    """Return a dataclass's fields, or else the repr; where that has an address of memory, which differs between runs,
    the public attributes that JSON can hold, None if there are none."""
    if is_dataclass(effect) and not isinstance(effect, type) and _is_plain(fields := asdict(effect)):
        return fields
    if not re.search(r" at 0x[0-9a-fA-F]+", text := repr(effect)):
        return text
    public = {name: value for name, value in getattr(effect, "__dict__", {}).items() if not name.startswith("_")}
    return {name: value for name, value in public.items() if _is_plain(value)} or None


def _is_plain(value: object) -> bool:
    try:
        json.dumps(value)
    except (TypeError, ValueError):
        return False
    return True
