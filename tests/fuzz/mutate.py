"""Mutants of a file: bytes changed, left out, doubled, moved and replaced by numbers that are seldom meant."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

_NUMBERS = [
    0,
    1,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0x8000,
    0xFFFF,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**62,
    2**63 - 1,
    2**63,
    2**64 - 1,
]
_WORDS = [
    b"-1", b"0", b"1e999999999", b"-1e-999999999", b"1e150", b"nan", b"inf", b"-Infinity", b"9" * 30, b"9" * 6000,
    b"null", b"true", b'"text"', b"{}", b"[]", b"[" * 3000, b'{"a":' * 3000, b"<a>" * 3000, b"\xff\xfe",
    b"\xef\xbb\xbf", b"\x00", b"0x10", b"*a", b"&a [*a]", b"65536", b"18446744073709551615",
]  # fmt: skip


def mutant(seeds: list[bytes], rng: random.Random) -> bytes:
    """One to eight changes of one of the files, more often few."""
    data = bytearray(rng.choice(seeds))
    for _ in range(min(8, 1 + int(rng.expovariate(0.7)))):
        rng.choice(_CHANGES)(data, seeds, rng)
    return bytes(data)


def _place(data: bytearray, rng: random.Random) -> int:
    """Anywhere; a third of the time near the beginning or the end, where files say what they are."""
    near = rng.random()
    span = min(len(data), 300)
    if near < 0.17:
        return rng.randrange(span + 1)
    return len(data) - rng.randrange(span + 1) if near < 0.33 else rng.randrange(len(data) + 1)


def _bit(data: bytearray, _: list[bytes], rng: random.Random) -> None:
    if data:
        data[min(_place(data, rng), len(data) - 1)] ^= 1 << rng.randrange(8)


def _byte(data: bytearray, _: list[bytes], rng: random.Random) -> None:
    if data:
        data[min(_place(data, rng), len(data) - 1)] = rng.choice([0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)])


def _number(data: bytearray, _: list[bytes], rng: random.Random) -> None:
    size, place = rng.choice([1, 2, 4, 8]), _place(data, rng)
    number = rng.choice(_NUMBERS) & (1 << 8 * size) - 1
    data[place : place + size] = number.to_bytes(size, rng.choice(["little", "big"]))


def _cut(data: bytearray, _: list[bytes], rng: random.Random) -> None:
    del data[_place(data, rng) :]


def _leave_out(data: bytearray, _: list[bytes], rng: random.Random) -> None:
    place = _place(data, rng)
    del data[place : place + rng.choice([1, 2, 4, 8, 16, rng.randrange(1, 1000)])]


def _double(data: bytearray, _: list[bytes], rng: random.Random) -> None:
    place, size = _place(data, rng), rng.choice([1, 4, 16, rng.randrange(1, 1000)])
    data[place:place] = data[place : place + size] * rng.choice([1, 1, 2, 20])


def _splice(data: bytearray, seeds: list[bytes], rng: random.Random) -> None:
    other = rng.choice(seeds)
    begin = rng.randrange(len(other) + 1)
    place, size = _place(data, rng), rng.choice([4, 16, 64, rng.randrange(1, 1000)])
    data[place : place + rng.choice([0, size])] = other[begin : begin + size]


def _word(data: bytearray, _: list[bytes], rng: random.Random) -> None:
    """Replaces a word of a text, or puts one in."""
    begin = _place(data, rng)
    found = re.compile(rb"[-+.\w]+").search(data, begin, begin + 200)
    place = (begin, begin) if found is None else found.span()
    data[place[0] : place[1]] = rng.choice(_WORDS)


_CHANGES: list[Callable[[bytearray, list[bytes], random.Random], None]] = [
    _bit, _bit, _byte, _byte, _number, _number, _cut, _leave_out, _double, _splice, _word,
]  # fmt: skip
