"""The event array, the one type at which everything meets, and what importing the package may take."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import EVENT_DTYPE, CrossingEngine, DecodeError, as_events, reconstruct
from davis_rs.events import EventArray

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
    with pytest.raises(ValueError, match=r"one-dimensional structured array with fields t, x, y, p .*; got shape"):
        as_events(source)


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
