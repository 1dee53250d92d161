"""Checks the PLY meshes that scene files name, before Mitsuba reads them.

Mitsuba ends the process at a mesh whose faces name missing vertices.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._util.budget import Budget
from .._util.untrusted import decoding, read_charged

DTYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
"""Types of numbers, by their names in headers."""
FACES = ("vertex_index", "vertex_indices")
"""Names of the lists of faces that have the numbers of vertices."""


class Element(NamedTuple):
    """An element of a header.

    Attributes:
        name: such as ``vertex``.
        number: of its rows.
        properties: the words of each, as ``["float", "x"]`` and ``["list", "uchar", "int", "vertex_indices"]``.
    """

    name: str
    number: int
    properties: list[list[str]]

    @property
    def lists(self) -> list[str]:
        """The names of its lists."""
        return [entry[-1] for entry in self.properties if entry[0] == "list"]


def check_ply(path: Path, budget: Budget) -> None:
    """Refuse a PLY mesh whose faces name missing vertices.

    Raises:
        OSError: if it cannot be read.
        DecodeError: if it is malformed.
    """
    data = read_charged(path, budget)
    with decoding(path, "PLY"):
        form, elements, begin = header(data)
        count = {name: number for name, number, _ in elements}.get("vertex", 0)
        if form == "ascii":
            indices = _ascii_indices(data[begin:].split(), elements)
        else:
            indices = _binary_indices(memoryview(data)[begin:], elements, "<" if "little" in form else ">")
        for block in indices:
            if len(block) and not (int(block.min()) >= 0 and int(block.max()) < count):
                wrong = block[(block < 0) | (block >= count)][0]
                raise ValueError(f"a face names vertex {wrong} of {count}")


def header(data: bytes) -> tuple[str, list[Element], int]:
    """Parse the header: format; name, number and properties of the elements; and where they begin."""
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("it must begin with 'ply', and its header must end")
    begin = data.index(b"\n", end) + 1
    form, elements = "", list[Element]()
    for line in data[:end].decode("ascii").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            form = words[1]
        elif words[:1] == ["element"]:
            number = int(words[2])
            if not 0 <= number <= len(data):  # each takes a byte at least
                raise ValueError(f"there are not {number} of {words[1]}")
            elements.append(Element(words[1], number, []))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(words[1:])
    return form, elements, begin


def _ascii_indices(words: list[bytes], elements: list[Element]) -> Iterator[npt.NDArray[np.int64]]:
    at = 0
    for _, number, properties in elements:
        for _ in range(number):
            for entry in properties:
                length = 1
                if entry[0] == "list":
                    length, at = int(words[at]), at + 1
                if at + length > len(words) or length < 0:
                    raise ValueError("it ends before its elements do")
                if entry[0] == "list" and entry[-1] in FACES:
                    yield np.array(words[at : at + length], np.int64)
                at += length


def _binary_indices(data: memoryview, elements: list[Element], order: str) -> Iterator[npt.NDArray[np.int64]]:
    at = 0
    for _, number, properties in elements:
        if all(entry[0] != "list" for entry in properties):
            at += number * sum(np.dtype(DTYPES[entry[0]]).itemsize for entry in properties)
            continue
        rows = equal_rows(data[at:], number, properties, order)
        if rows is not None:
            at += rows.nbytes
            for k, entry in enumerate(properties):
                if entry[0] == "list" and entry[-1] in FACES:
                    yield rows[f"values{k}"].ravel().astype(np.int64)
            continue
        for _ in range(number):
            for entry in properties:
                length, kind = 1, entry[0]
                if entry[0] == "list":
                    count = np.dtype(order + DTYPES[entry[1]])
                    length, kind, at = int(np.frombuffer(data, count, 1, at)[0]), entry[2], at + count.itemsize
                dtype = np.dtype(order + DTYPES[kind])
                if length < 0:
                    raise ValueError(f"a list of {length} values")
                values = np.frombuffer(data, dtype, length, at) if length else np.zeros(0, dtype)
                if entry[0] == "list" and entry[-1] in FACES:
                    yield values.astype(np.int64)
                at += values.nbytes


def equal_rows(data: memoryview, number: int, properties: list[list[str]], order: str) -> npt.NDArray[np.void] | None:
    """Read the rows as one array if each list is as long as in the first row, as triangles are; else return None.

    Its fields are ``value0`` of a number that is the first property, and ``count1`` and ``values1`` of a list that is
    the second one.
    """
    fields: list[tuple[str, str | np.dtype[np.generic]] | tuple[str, str, tuple[int]]] = []
    at = 0
    for k, entry in enumerate(properties):
        if entry[0] != "list":
            fields.append((f"value{k}", order + DTYPES[entry[0]]))
        elif number:
            count = np.dtype(order + DTYPES[entry[1]])
            length = int(np.frombuffer(data, count, 1, at)[0])
            if not 0 <= length < 1 << 16:
                return None
            fields += [(f"count{k}", count), (f"values{k}", order + DTYPES[entry[2]], (length,))]
        else:
            fields.append((f"values{k}", order + DTYPES[entry[2]], (0,)))
        at = np.dtype(fields).itemsize
    dtype = np.dtype(fields)
    if number * dtype.itemsize > len(data):
        return None
    rows = np.frombuffer(data, dtype, number)
    equal = all((rows[name] == rows[name][:1]).all() for name, *_ in fields if name.startswith("count"))
    return rows if equal else None
