"""The event array, the one type at which everything meets, and what importing the package may take."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import (
    EVENT_DTYPE,
    ArgumentError,
    CrossingEngine,
    DatasetWriter,
    DecodeError,
    Device,
    Encoder,
    Packet,
    as_events,
    compare_events,
    compare_streams,
    event_array,
    from_structured,
    measure_recording,
    measure_stream,
    open_writer,
    reconstruct,
    represent,
    to_tonic,
)
from davis_rs.events.arrays import EventArray
from davis_rs.sensor.effects import event_draws

FIELDS = [("t", "<i8", 0), ("x", "<u2", 8), ("y", "<u2", 10), ("p", "|u1", 12)]


def some_events() -> EventArray:
    return np.array([(5, 1, 2, 1), (7, 3, 4, 0), (7, 65535, 0, 1), (1 << 62, 0, 65535, 0)], EVENT_DTYPE)


def converted(dtypes: dict[str, str]) -> npt.NDArray[np.void]:
    """``some_events`` with other fields, in the order given, without padding."""
    other = np.zeros(4, list(dtypes.items()))
    for name, column in ((name, some_events()[name]) for name, _, _ in FIELDS):
        other[name] = column
    return other


# ---- layout ----


def test_an_event_is_16_bytes_with_the_fields_where_the_core_has_them() -> None:
    """The layout of the core's repr(C) struct, which reads and writes these arrays in place."""
    assert EVENT_DTYPE.itemsize == 16
    assert EVENT_DTYPE.alignment == 8
    assert EVENT_DTYPE.fields is not None
    assert [(name, field[0].str, field[1]) for name, field in EVENT_DTYPE.fields.items()] == FIELDS


def test_the_core_and_numpy_agree_on_every_field() -> None:
    """Events out of the engine have the values, and events into reconstruct() the meaning, that the fields say."""
    engine = CrossingEngine(300, 200, contrast_threshold=0.5)
    first, second = np.zeros((200, 300)), np.zeros((200, 300))
    second[199, 258], second[3, 299] = 0.5, -0.5
    assert engine.push_log(1 << 40, first).dtype == EVENT_DTYPE
    events = engine.push_log((1 << 40) + 9, second)
    assert events.dtype == EVENT_DTYPE
    assert events.tolist() == [((1 << 40) + 9, 299, 3, 0), ((1 << 40) + 9, 258, 199, 1)]
    assert events.flags.writeable
    np.testing.assert_array_equal(reconstruct(events, first, 1 << 41, 0.5), second)


# ---- as_events ----


def test_event_arrays_pass_without_a_copy() -> None:
    """What is an event array already, read-only or not, comes back as itself."""
    events = some_events()
    assert np.shares_memory(as_events(events), events)
    events.flags.writeable = False
    assert np.shares_memory(as_events(events), events)
    assert as_events(np.zeros(0, EVENT_DTYPE)).dtype == EVENT_DTYPE


@pytest.mark.parametrize("part", [slice(None, None, 2), slice(None, None, -1), slice(1, 3)])
def test_slices_become_contiguous_with_the_same_events(part: slice) -> None:
    """Strided and reversed views are copied into place; their source keeps its bytes."""
    events = some_events()
    before = events.tobytes()
    result = as_events(events[part])
    assert result.flags.c_contiguous
    np.testing.assert_array_equal(result, events[part])
    assert events.tobytes() == before


def test_misaligned_events_are_aligned() -> None:
    """Events at an odd address, as in a file mapped after its header, are copied to where the core can read them."""
    events = some_events()
    memory = np.zeros(events.nbytes + 1, np.uint8)
    misaligned = memory[1:].view(EVENT_DTYPE)
    misaligned[:] = events
    assert not misaligned.flags.aligned
    assert as_events(misaligned).flags.aligned
    np.testing.assert_array_equal(as_events(misaligned), events)


@pytest.mark.parametrize(
    "dtypes",
    [
        {"t": "<i8", "x": "<u2", "y": "<u2", "p": "u1"},
        {"t": ">i8", "x": ">u2", "y": ">u2", "p": "u1"},
        {"x": "u4", "y": "i4", "p": "?", "t": "u8"},
        {"p": "i8", "extra": "f8", "t": "f8", "y": "f4", "x": "i4"},
    ],
    ids=["packed", "big-endian", "other integers", "floats and one field more"],
)
def test_other_layouts_are_converted_without_loss(dtypes: dict[str, str]) -> None:
    """Any structured array with t, x, y, p that hold whole numbers in range is taken, by the names of its fields."""
    source = converted(dtypes)
    before = source.tobytes()
    result = as_events(source)
    assert result.dtype == EVENT_DTYPE
    np.testing.assert_array_equal(result, some_events())
    assert source.tobytes() == before


@pytest.mark.parametrize(
    ("name", "dtype", "value"),
    [
        ("t", "u8", 1 << 63),
        ("t", "f8", 0.5),
        ("x", "i4", -1),
        ("x", "i4", 65536),
        ("y", "f4", 1.5),
        ("p", "i2", 256),
        ("p", "i1", -1),
    ],
)
def test_values_that_an_event_cannot_hold_are_refused(name: str, dtype: str, value: float) -> None:
    """No wrapping and no rounding: the error names the field."""
    source = np.zeros(3, [(n, dtype if n == name else d) for n, d, _ in FIELDS])
    source[name][1] = value
    with pytest.raises(ValueError, match=rf"event field '{name}' holds values that \w+ cannot hold exactly"):
        as_events(source)


@pytest.mark.parametrize(
    "source",
    [
        np.zeros((2, 2), EVENT_DTYPE),
        np.zeros((), EVENT_DTYPE),
        np.zeros((4, 4)),
        np.zeros(4, [("t", "i8"), ("x", "u2"), ("y", "u2")]),
        [(0, 1, 2, 1)],
        None,
    ],
    ids=["two dimensions", "a scalar", "columns", "no polarity", "a list", "None"],
)
def test_what_is_not_events_is_refused(source: npt.ArrayLike) -> None:
    """The error states the rule and what came instead."""
    with pytest.raises(ValueError, match=r"structured array with fields t, x, y, p .*; got .*; davis_rs\."):
        as_events(source)


COLUMNS = {"t": [5, 7], "x": [1, 65535], "y": [2, 0], "p": [1, 0]}


def test_columns_become_events_by_their_names() -> None:
    """As arguments, in a dictionary or in anything that has columns; floats and truth values that are whole, too."""
    expected = [(5, 1, 2, 1), (7, 65535, 0, 0)]
    assert event_array(**COLUMNS).tolist() == expected
    assert as_events(COLUMNS).tolist() == expected
    assert event_array(t=[5.0, 7.0], x=np.array([1, 65535], np.uint32), y=(2, 0), p=[True, False]).tolist() == expected
    assert event_array([], [], [], []).dtype == EVENT_DTYPE
    assert event_array(**COLUMNS).tobytes()[13:16] == b"\0\0\0"  # equal streams are equal bytes


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("t", [0.1, 0.2], "t must be whole microseconds (np.rint(1e6 * t) of seconds), got 0.1 at index 0"),
        ("t", [1, 2**63], "t must be whole microseconds"),
        ("t", [1, np.nan], "got nan at index 1"),
        ("x", [0, 65536], "x must be whole pixels in 0..65535, got 65536 at index 1"),
        ("y", [-1, 0], "y must be whole pixels in 0..65535, got -1 at index 0"),
        ("p", [1, -1], "p must be 0 or 1 (p > 0 of polarities -1 and 1), got -1 at index 1"),
        ("p", [1, 2], "p must be 0 or 1"),
        ("p", [1], "t, x, y and p must have one length, got t 2, x 2, y 2, p 1"),
        ("t", [[1], [2]], "t must be a column of numbers (n,), got shape (2, 1)"),
        ("t", ["1", "2"], "t must be a column of numbers (n,)"),
    ],
)
def test_columns_that_events_cannot_hold_are_refused(name: str, values: list[Any], message: str) -> None:
    """Nothing wraps, nothing is rounded; the error has the column, the value and its index."""
    with pytest.raises(ArgumentError, match=re.escape(message)) as refused:
        event_array(**{**COLUMNS, name: values})
    assert name in refused.value.arguments


PLAIN: Any = np.array([[1, 2, 3, 1], [2, 2, 3, 0]])
SIZE = (9, 9)
TAKERS: dict[str, Callable[[Path], object]] = {
    "event_frame": lambda _: represent.event_frame(PLAIN, SIZE),
    "count_image": lambda _: represent.count_image(PLAIN, SIZE),
    "time_surface": lambda _: represent.time_surface(PLAIN, SIZE, 5),
    "voxel_grid": lambda _: represent.voxel_grid(PLAIN, SIZE, 3),
    "event_spike_tensor": lambda _: represent.event_spike_tensor(PLAIN, SIZE, 3),
    "last_event_times": lambda _: represent.last_event_times(PLAIN, SIZE),
    "to_tonic": lambda _: to_tonic(PLAIN),
    "from_structured": lambda _: from_structured(PLAIN),
    "compare_events": lambda _: compare_events(PLAIN, PLAIN, size=SIZE),
    "compare_streams": lambda _: compare_streams(PLAIN, PLAIN, size=SIZE),
    "measure_stream": lambda _: measure_stream(PLAIN),
    "measure_stream of a list": lambda _: measure_stream(PLAIN.tolist()),
    "measure_recording": lambda _: measure_recording(PLAIN, size=SIZE),
    "reconstruct": lambda _: reconstruct(PLAIN, np.zeros((9, 9)), 5, 0.2),
    "event_draws": lambda _: event_draws(PLAIN, 1),
    "Encoder": lambda _: Encoder(Device("DAVIS240C")).encode(events=PLAIN),
    "open_writer": lambda folder: open_writer(folder / "x.txt", SIZE).write(PLAIN),
    "DatasetWriter": lambda folder: DatasetWriter(folder / "x", SIZE).write(Packet(0, 5, PLAIN, None)),
}


@pytest.mark.parametrize("taker", TAKERS)
def test_columns_without_names_are_refused_by_all_that_take_events(taker: str, tmp_path: Path) -> None:
    """Other software has them in another order; the error says what makes events of them."""
    with pytest.raises(ValueError, match=r"got shape \(2, 4\) and dtype int64; davis_rs.event_array\(t=..., x="):
        TAKERS[taker](tmp_path)


# ---- importing ----


def test_importing_takes_nothing_heavy_along(run_python: Callable[..., str]) -> None:
    """`import davis_rs` loads no renderer, no file format and no plotting library."""
    heavy = ("mitsuba", "drjit", "scipy", "matplotlib", "OpenEXR", "PIL", "imageio", "tqdm")
    program = f"import davis_rs, sys; print(sorted(set({heavy}) & set(sys.modules)))"
    assert run_python(program) == "[]\n"


def test_importing_works_without_the_renderer_and_the_rest(run_python: Callable[..., str]) -> None:
    """With all but NumPy made impossible to import, the engine still runs."""
    program = """
import sys
for name in ("mitsuba", "drjit", "scipy", "matplotlib", "OpenEXR", "PIL", "imageio", "tqdm"):
    sys.modules[name] = None  # importing it raises ImportError
import numpy, davis_rs
engine = davis_rs.CrossingEngine(1, 1, contrast_threshold=0.5)
engine.push_log(0, numpy.zeros((1, 1)))
print(engine.push_log(4, numpy.ones((1, 1)))["t"].tolist())
"""
    assert run_python(program) == "[2, 4]\n"


def test_decode_errors_pickle() -> None:
    """DecodeError comes out of worker processes as itself, a ValueError."""
    error = pickle.loads(pickle.dumps(DecodeError("line 3")))
    assert type(error) is DecodeError
    assert isinstance(error, ValueError)
    assert str(error) == "line 3"
