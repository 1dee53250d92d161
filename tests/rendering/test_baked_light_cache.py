"""Files of the cache of baked light that were made to harm: they cost a line, and the light is baked again."""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs.render.baked import cache
from davis_rs.render.baked.kept_arrays import packed_arrays, unpacked_arrays
from davis_rs.render.baked.light_maps import LightMaps, check_maps, layouts_of, texel_count, vector_layouts_of
from davis_rs.render.baked.partial import PartialBake

KEY = "0" * 64
TWO_SIDED, BUMPY = np.array([False, True]), np.array([False, True])
TESTS = np.array([0.0, 0.5, 1.0])
LIGHTS = 2


def maps(**changes: Any) -> LightMaps:
    """Light of two triangles and two lights at two instants."""
    divisions = np.array([[1, -1], [0, 2]])
    texels = [np.full((texel_count(layouts_of(divisions)), 3), 0.25 * k, np.float32) for k in range(4)]
    vectors = [np.full((texel_count(vector_layouts_of(divisions, BUMPY)), 9), 0.5 - k, np.float32) for k in range(4)]
    instants = np.array([0.0, 1.0])
    whole = LightMaps(divisions, texels, BUMPY, vectors, instants, 0.01, 0.02, 40, (16, 64), True, 1.5)
    return replace(whole, **changes)


def loaded() -> LightMaps | None:
    return cache.load(KEY, partial(check_maps, two_sided=TWO_SIDED, bumpy=BUMPY, lights=LIGHTS, tests=TESTS))


@pytest.fixture
def file(light_cache: Path) -> Path:
    """Where light is kept under a key."""
    light_cache.mkdir(exist_ok=True)
    return light_cache / f"{KEY}.light"


def arrays_of(data: bytes) -> dict[str, Any]:
    return dict(unpacked_arrays(data))


def with_checksum(data: bytes) -> bytes:
    return hashlib.sha256(data).digest() + data


def refused(capsys: pytest.CaptureFixture[str], rule: str) -> None:
    """Nothing is loaded, and one line says why."""
    capsys.readouterr()
    assert loaded() is None
    said = capsys.readouterr().err
    assert rule in said
    assert "it is baked again" in said
    assert said.count("\n") == 1


def test_what_is_kept_is_loaded(file: Path) -> None:
    """Also where light goes on below 0 beyond a triangle's third edge: at the last texels of the first map."""
    texels = maps().texels
    texels[0][24] = -3.0
    cache.store(KEY, maps(texels=texels))
    found = loaded()
    assert found is not None
    assert repr(found) == repr(maps(texels=texels))
    assert found.texels[0][24].tolist() == [-3.0] * 3


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "divisions of other triangles": ({"divisions": np.array([[1, -1]])}, "divisions must be int64 (2, 2)"),
    "divisions of floats": ({"divisions": np.array([[1.0, -1.0], [0, 2]])}, "divisions must be int64"),
    "divisions beyond memory": ({"divisions": np.array([[60, -1], [0, 2]])}, "divisions must be 0..10"),
    "divisions below 0": ({"divisions": np.array([[-7, -1], [0, 2]])}, "divisions must be 0..10"),
    "a back that does not reflect": ({"divisions": np.array([[1, 0], [0, 2]])}, "divisions must be 0..10"),
    "a back that has none": ({"divisions": np.array([[1, -1], [0, -1]])}, "divisions must be 0..10"),
    "other divisions": ({"divisions": np.array([[1, -1], [0, 3]])}, "texels must be float32"),
    "another instant": ({"instants": np.array([0.0, 0.25])}, "its instants are not those"),
    "no instant": ({"instants": np.zeros(0)}, "its instants are not those"),
    "instants that go back": ({"instants": np.array([1.0, 0.0])}, "its instants are not those"),
    "an instant that is no number": ({"instants": np.array([0.0, np.nan])}, "its instants are not those"),
    "one instant": ({"instants": np.array([0.0])}, "1 instants of 2 lights need as many maps, found 4"),
    "three maps": ({"texels_3": None}, "2 instants of 2 lights need as many maps, found 3"),
    "a map is missing": ({"texels_1": None}, "its arrays are not those of baked light"),
    "too few texels": ({"texels_0": np.zeros((5, 3), np.float32)}, "texels must be float32"),
    "texels of another type": ({"texels_0": np.zeros((90, 3))}, "texels must be float32"),
    "grey texels": ({"texels_0": np.zeros((90,), np.float32)}, "texels must be float32"),
    "NaN": ({"texels_0": np.full((90, 3), np.nan, np.float32)}, "texels must be finite, and >= 0 within triangles"),
    "negative light": (
        {"texels_0": np.full((90, 3), -1, np.float32)},
        "texels must be finite, and >= 0 within triangles",
    ),
    "infinite light": (
        {"texels_0": np.full((90, 3), np.inf, np.float32)},
        "texels must be finite, and >= 0 within triangles",
    ),
    "vectors of other triangles": ({"bumpy": np.array([True, False])}, "its irradiance vectors are not those"),
    "vectors are missing": ({f"vectors_{k}": None for k in range(4)}, "4 maps need as many of irradiance vectors"),
    "a vector is missing": ({"vectors_1": None}, "its arrays are not those of baked light"),
    "too few vectors": ({"vectors_0": np.zeros((5, 9), np.float32)}, "irradiance vectors must be finite float32"),
    "infinite vectors": ({"vectors_2": np.full((74, 9), np.inf, np.float32)}, "irradiance vectors must be finite"),
    "two numbers": ({"numbers": np.zeros(2)}, "its numbers must be 7"),
    "an error below 0": ({"numbers": np.array([-1.0, 0, 0, 0, 0, 0, 0])}, "its numbers must be 7"),
    "numbers that are none": ({"numbers": np.full(7, np.nan)}, "its numbers must be 7"),
    "text": ({"numbers": np.array(["a"])}, "it holds an array of <U1"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_valid_checksum_is_no_reason_to_believe(file: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    changes, rule = WRONG[kind]
    arrays = arrays_of(cache._packed(maps())) | changes
    file.write_bytes(packed_arrays({name: array for name, array in arrays.items() if array is not None}))
    refused(capsys, rule)


def zipped(shape: tuple[int, ...], content: bytes, method: int = zipfile.ZIP_STORED) -> bytes:
    """An archive with one array that says a shape."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": shape})
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        archive.writestr("divisions.npy", head.getvalue() + content)
    return with_checksum(buffer.getvalue())


@pytest.mark.parametrize(
    ("data", "rule"),
    [
        (zipped((2**40,), b""), "has other bytes"),
        (zipped((-1,), bytes(8)), "has other bytes"),
        (zipped((2,), bytes(16), zipfile.ZIP_DEFLATED), "arrays that are compressed"),
        (with_checksum(b"PK\x03\x04"), "is damaged"),
        (with_checksum(b""), "is damaged"),
    ],
    ids=["beyond memory", "less than nothing", "compressed", "no archive", "nothing"],
)
def test_archives_of_others(file: Path, data: bytes, rule: str, capsys: pytest.CaptureFixture[str]) -> None:
    file.write_bytes(data)
    refused(capsys, rule)


@pytest.mark.parametrize(
    "make", [os.mkfifo, partial(os.symlink, "/dev/zero"), os.mkdir], ids=["pipe", "zero", "folder"]
)
def test_what_is_no_file(file: Path, make: Callable[[Path], None], capsys: pytest.CaptureFixture[str]) -> None:
    """A pipe waits for ever, a device goes on for ever."""
    make(file)
    refused(capsys, "baked light cannot be read from its cache")


def test_files_are_limited(file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    cache.store(KEY, maps())
    assert loaded() is not None
    monkeypatch.setenv("DAVIS_RS_READ_BUDGET", "bytes=2KiB")
    refused(capsys, "baked light needs")


PLACES = np.arange(6.0).reshape(2, 3)


@pytest.mark.parametrize(
    ("light", "rule"),
    [
        (np.zeros((2, 3), np.float32), "light must be float64 (n, 3)"),
        (np.zeros(6), "light must be float64 (n, 3)"),
        (np.full((2, 3), np.nan), "light must be finite and >= 0"),
        (np.full((2, 3), -1.0), "light must be finite and >= 0"),
    ],
    ids=["float32", "flat", "NaN", "negative"],
)
def test_a_partial_bake_that_is_none(file: Path, light: Any, rule: str, capsys: pytest.CaptureFixture[str]) -> None:
    file.with_suffix(".partial").write_bytes(packed_arrays({"ab" * 32: light}))
    assert len(cache.load_partial(KEY)) == 0
    assert rule in capsys.readouterr().err


def test_a_partial_bake_of_other_places(file: Path) -> None:
    """Light for another number of places is computed again."""
    bake = PartialBake()
    bake.known_or((b"", PLACES, PLACES), lambda: np.ones((2, 3)))
    [(name, _)] = arrays_of(bake.packed()).items()
    file.with_suffix(".partial").write_bytes(packed_arrays({name: np.ones((5, 3))}))
    found = cache.load_partial(KEY).known_or((b"", PLACES, PLACES), lambda: np.full((2, 3), 7.0))
    assert found.tolist() == [[7.0] * 3] * 2
