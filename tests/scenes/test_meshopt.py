"""Compressed buffer views of glTF files, against streams of the reference encoder (meshoptimizer, both versions)."""

from __future__ import annotations

import base64
import hashlib
import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from davis_rs import Camera, DecodeError, load_scene
from davis_rs import _core as core
from davis_rs._util.budget import VARIABLE
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.truth.scene_surfaces import SceneSurfaces
from davis_rs.scene.load import start_pose
from gltf_files import Gltf, packed_square, quad

SMALL = Camera(24, 18, 20.0, 20.0, 11.5, 8.5)

STREAMS: dict[str, tuple[str, str, str, int, int, str]] = {
    "attributes": (
        "oOUAJJWGGYEp4PMQDQ0JCOYAQRgDeQCG3sEFfdLteTwlk6ZsAAAA6QApYISIESAAACBtgO0g7RAcAKA4AEDzofSrgYkskWckUmYAAADlACiGlQQWQI8ACg1wqiANkAAYAJJJP6wVShGyd3iidoUAAADpABUUJUoQEAIC9QozUBoBgAswDgBVDt08YtsAzeiif38VK1UAAADlACZQqCZiEPAMBQQNAKsAARoE0gtqluGZ5D74velWHB0dAAAA6QARVFmYIRICAOoOCAwA0KAAAxcAcE7X0FA9YSycYFtU1g4AAADlABQgWhgFWszAEAkIC7VQNQIFsAIlm12szxTPFIUuSD+EAAAA5QAWQAJoAWXwwwYHBgS8AKAOjAAAEFZHDTyJQnrlw+WFNFoAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAD/AAH/AAH/AA==",
        "ATTRIBUTES",
        "NONE",
        77,
        8,
        "be061461ba796ae9",
    ),
    "two blocks": (
        "oFUVVVEAAggIAAIgCIIACACAAAAAgIoIAAAAAAIAAgAAAIgAAAAgAAAgCAAAAAgKAKAAAAAAAgAAAIAAChVUVVEIAAoAAAAACCACCAAAggAAKAggAIAAAIAgAAgIACKAAAAACgKAKAAAIAAgACggAAAAAAgAVVUBVSAgAAAAACAggCAAgAoIAgAAACAAIAAAgIAgAAACAAAAICAACIAAAAIAAAACAAAAgAgCqABBRRVVAAAACAAAAggAAAAqCAAAAAAAAgACAgAIAAAgACAACAAAgAAIAAAgAAIAAgCIAAgAFQIAAKACIAAAAAAiABUACAAAAAAAggAAggAVAAAAgIgCggCAAAAAFKAAAAIAggAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=",
        "ATTRIBUTES",
        "NONE",
        300,
        4,
        "494c397cec17bbec",
    ),
    "newer attributes": (
        "oXNml5rqAIe1oUWNjoVZZzmqGcG4iVN3XhamAiYgQCIAy2G1HhHh+m6PCOssSbLLVAFoGGcCAQVRMVVVExMPAAMBAwMCD/sEePzDRA8PHBMPHwAEDwwIDwAGZP//////EQD//wBu5yaD+V+VlP0ATGMUqvp56vGmPgUqqqqqqoAAAAUQACQACQAAAAYBJiURUHFHYXdAAAAEAwD6BgED/voGAQP++gYBA/76BgED/nIEEOkACIA/zwABCQAAAAAAAAAAAAAAIiI=",
        "ATTRIBUTES",
        "NONE",
        21,
        20,
        "7f63c8c67c532053",
    ),
    "newer attributes of shorts": (
        "oXNml5ZaAIe1oUWNjoVZZzmqGcG4iVN3XhamTcatn6J8nVtoLKePTH4flwomIEAiAAICAADLYbUeEeH6bo8I6yxJsstUAWgYZ4Quheivr4d0pf3ENFxBXV8KAQVRMVVVExMxMwExFwFVcRcAAwMFBwoP+wR4/MNEDw8cEw9PyPzPQ8BDQA8PGw8ADA8HAwAGZP//////0eH//////////xgA//8Abucmg/lflZT9AExjFKr6eerxpj7JY4O6WT2y5hMPdE24aQvvFSqqqqqqqqqqqoAAAAUQACQACQACQBAAAgD+7YD///9/gH+AgICA/4Bd93+AgICAf/9/f39/fwMAf38VAhCEmBAmQAkkAAAAADjngID/gID/gID/nHOAgP+AgP+AgP8OAICA/wU0PQ9DfX59fn1+0PQ9D31+fX59fn0ZAAF+fXIEEOkACIA/zwABCQAAAAAAAAAAAAAAAAE=",
        "ATTRIBUTES",
        "NONE",
        37,
        20,
        "94b23bb2a1884d6d",
    ),
    "newer attributes in two blocks": (
        "oRn6////AAIiRERmaIiKqszM7u///xAQEBASEhIUFBQUFhYWGBgYGBoaGhwcHBweHh4gICAgIiIiJCQkJCYmJigoKCgqKiosLCwsLi4uMDAwMDIyMjQ0NDQ2NjY4ODg4Ojo6PDw8PD4+PkBAQEBCQkJERERERkZGSEhISEpKSkxMTExOTk5QUFBQUlJSVFRUVFZWVlhYWFhaWlpcXFxcXl5eYGBgYGJiYmRkZGRmZmZoaGhoampqbGxsbG5ubnBwcHBycnJ0dHR0dnZ2eHh4eHp6enx8fHx+fn6AgICAgoKChISEhIaGhoiIiIiKioqMjIyMjo6OkJCQkJJVVVVVOqqqqgWqqqqrzOqqqqrHqqqqr46Jqqqqqqqqqr5QS6qqqqqqqqr6Eg2qqqqqqqqr6tTPqqqqqqqqr6qWkaqqqqqqqr6qWFOqqqqqqqr6qhoVVURERAIABwCABgEABgDABgYAYAYGADAGBgAYBQUADAUFAAYFBQADBQUbkpKUlJSUlpaWmJiYmJqampycnJyenp6goKCgoqKipKSkpKampqioqKiqqqoVqqqqqqqr6qrc16qqqgAEgAEEBAAAAAAAAAAAAAAAAAAAAAAAAAAAAIQDAQ==",
        "ATTRIBUTES",
        "NONE",
        300,
        4,
        "94ed0ae2fb53fbd8",
    ),
    "triangles": (
        "4f4eEA4QDhAOzh4WDhUOFA7OHhQOFA4UDs4eFA4UDhQO///////+///////////+////////Hh8PHw8fD84eFg4VDhQOzh4UDhQOFA7OHhQOFA4UDg8K/1wSSfIfHo8PIv9EPx7/W0ZZ/36TAfE6bE9XJv9JSCD/DQYp/zZ1A/+CAQkl8xcb/xEGOv8dGNI2/0lLpgH/CTkz/y8mC/8TDmD/QQIIBwoHCgcKAHaHVmd4qYZliWiYAWkAAA==",
        "TRIANGLES",
        "NONE",
        252,
        4,
        "707526ced37411bd",
    ),
    "short triangles": (
        "4f4eEA4QDhAOzh4WDhUOFA7OHhQOFA4UDs4eFA4UDhQO///////+///////////+////////Hh8PHw8fD84eFg4VDhQOzh4UDhQOFA7OHhQOFA4UDg8K/1wSSfIfHo8PIv9EPx7/W0ZZ/36TAfE6bE9XJv9JSCD/DQYp/zZ1A/+CAQkl8xcb/xEGOv8dGNI2/0lLpgH/CTkz/y8mC/8TDmD/QQIIBwoHCgcKAHaHVmd4qYZliWiYAWkAAA==",
        "TRIANGLES",
        "NONE",
        252,
        2,
        "d5b712c6e277ea28",
    ),
    "indices": (
        "0QAMDAwMDAwMDAwMDAwMDAwMDAwM1Q8VCRsdCwcRDwfCAQICAgICAgICAAAAAA==",
        "INDICES",
        "NONE",
        39,
        4,
        "913f73eb1487ba4c",
    ),
}
FILTERED: dict[str, tuple[str, str, str, int, int, list[list[float]]]] = {
    "octahedral 4": (
        "oAE/8AAAl1kQcqYBP/AAAGSOGYnlAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA5Ex/Bw==",
        "ATTRIBUTES",
        "OCTAHEDRAL",
        6,
        4,
        [
            [-42, 115, 35, 7],
            [-1, 28, -124, 7],
            [107, -31, -61, 7],
            [85, -19, -93, 7],
            [-18, 64, -108, 7],
            [-1, 0, 127, 7],
        ],
    ),
    "octahedral 8": (
        "oAE/8AAAYa9LBjEBP/AAAB0ECgwTAT/wAADvlrMH2AE98AAAEQwPEgAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAADEB/EG/wcHAA==",
        "ATTRIBUTES",
        "OCTAHEDRAL",
        6,
        8,
        [
            [5084, 1111, -32351, 7],
            [-30703, -3202, -10987, 7],
            [-27601, 14527, -10041, 7],
            [-5642, 14837, 28666, 7],
            [16944, -20537, -19100, 7],
            [-23695, 22609, 1017, 7],
        ],
    ),
    "quaternion 8": (
        "oAE/8AAA7bRL+ioBJ9AAAAMGAT/wAADn2oYDsQEvwAAAAwYJAT/wAAAUb9NDtQE9MAAABwMEAQ+QAAAEAwAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAADXAz4BTQT8Bw==",
        "ATTRIBUTES",
        "QUATERNION",
        6,
        8,
        [
            [27957, 11126, 3599, 12462],
            [29098, 12677, 8082, 985],
            [623, -5444, 30447, 10798],
            [30119, 4573, 10074, -6644],
            [-7029, 29424, 11783, -4437],
            [30914, 9123, -5444, -2264],
        ],
    ),
    "exponential 8": (
        "oAE/8AAAwjoWkwsBP/AAABd6nugmAT/wAAAk27UtvwE+8AAAJQ0QIAE/8AAA20M6CSEBP/AAAKRhbI2vAT/wAADd2dD9ZgE/8AAAKC0aIB0AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAABFIPsQqyvW8g==",
        "ATTRIBUTES",
        "EXPONENTIAL",
        6,
        8,
        [
            [-20933443584.0, -167.31768798828125],
            [107156.75, 434065216.0],
            [-6187.5595703125, -2.8513565063476562],
            [8784.40234375, 403491.5],
            [1477186.0, -7722553344.0],
            [-109190381568.0, 187492.25],
        ],
    ),
}
"""For each stream: its bytes, mode, filter, count and stride, and what the reference decoder makes of it."""


def decode(data: bytes, mode: str, kind: str, count: int, stride: int) -> bytes:
    return core.decode_meshopt(np.frombuffer(data, np.uint8), mode, kind, count, stride).tobytes()


@pytest.mark.parametrize("name", STREAMS)
def test_streams_decode_to_the_bytes_that_were_encoded(name: str) -> None:
    packed, mode, kind, count, stride, digest = STREAMS[name]
    decoded = decode(base64.b64decode(packed), mode, kind, count, stride)
    assert len(decoded) == count * stride
    assert hashlib.sha256(decoded).hexdigest().startswith(digest)


@pytest.mark.parametrize("name", FILTERED)
def test_filters_give_the_numbers_of_the_reference(name: str) -> None:
    """Integers within one, as the specification allows."""
    packed, mode, kind, count, stride, expected = FILTERED[name]
    decoded = decode(base64.b64decode(packed), mode, kind, count, stride)
    number = "<f4" if kind == "EXPONENTIAL" else f"<i{stride // 4}"
    found = np.frombuffer(decoded, number).reshape(count, -1).astype(float)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=0 if number == "<f4" else 1)


def colour_of(luma: int, orange: int, green: int, opacity: int, one: int) -> list[int]:
    """What the filter COLOR makes of an element, by its definition in whole numbers and fractions."""
    bits = opacity.bit_length()
    scale = one / (2**bits - 1)
    clear = opacity - 2 ** (bits - 1)
    given = (luma + orange - green, luma + green, luma - orange - green, 2 * clear + clear % 2)
    return [int(number * scale + 0.5) for number in given]


@pytest.mark.parametrize(("size", "one"), [(1, 255), (2, 65535)])
def test_colours_are_made_of_luma_and_differences(size: int, one: int) -> None:
    """With as many bits as the highest of the opacity says; the elements are stored one by one, without differences."""
    elements = [(100, 20, -30, 0xFF), (7, 3, -4, 0x0B), (0, 0, 0, 0x80)] if size == 1 else [
        (30000, 2000, -9000, 0xFFFF), (700, 300, -200, 0x5A3), (1, 1, 0, 0b11),
    ]  # fmt: skip
    packed = np.array(elements, np.int64).astype(f"<i{size}").view(np.uint8).reshape(len(elements), -1)
    turned = np.diff(packed.astype(np.int8), axis=0, prepend=packed[:1].astype(np.int8)).astype(np.int8)
    deltas = ((turned.view(np.uint8) << 1) ^ (turned >> 7).view(np.uint8)).T
    stream = b"\xa1" + b"\xff" * size + deltas.tobytes()  # each byte as it is
    stream += bytes(max(0, 24 - 5 * size)) + packed[0].tobytes() + bytes(size)
    found = np.frombuffer(decode(stream, "ATTRIBUTES", "COLOR", len(elements), 4 * size), f"<u{size}").reshape(-1, 4)
    assert found.tolist() == [colour_of(*element, one) for element in elements]


@pytest.mark.parametrize("name", STREAMS)
def test_damaged_streams_are_refused_or_give_as_many_bytes(name: str) -> None:
    """No other error, and no read beyond the data; streams that are cut short are always refused."""
    packed, mode, kind, count, stride, _ = STREAMS[name]
    data = base64.b64decode(packed)
    for length in range(len(data)):
        with pytest.raises(ValueError, match=r".+"):
            decode(data[:length], mode, kind, count, stride)
    random = np.random.RandomState(11)
    for _ in range(300):
        damaged = bytearray(data)
        for at in random.randint(0, len(data), 3):
            damaged[at] = random.randint(0, 256)
        with suppress(ValueError):
            assert len(decode(bytes(damaged), mode, kind, count, stride)) == count * stride
    with pytest.raises(ValueError, match=r".+"):
        decode(data, mode, kind, count + 300, stride)


def test_a_channel_of_no_mode_is_refused() -> None:
    data = bytearray(base64.b64decode(STREAMS["newer attributes"][0]))
    for mode in (0x03, 0x10, 0x0F):
        data[-5] = mode
        rule = re.escape(f"attributes must have channels of mode 0, 1 or 2, got {mode:#04x} (byte {len(data) - 5})")
        with pytest.raises(DecodeError, match=rule):
            decode(bytes(data), "ATTRIBUTES", "NONE", 21, 20)


def test_what_there_is_not_is_refused() -> None:
    """Names and sizes; DecodeError is for streams alone."""
    data = base64.b64decode(STREAMS["attributes"][0])
    for mode, kind, count, stride, rule in (
        ("CUBES", "NONE", 77, 8, "there is no mode 'CUBES'"),
        ("ATTRIBUTES", "SEPIA", 77, 8, "there is no filter 'SEPIA' of 'ATTRIBUTES'"),
        ("INDICES", "OCTAHEDRAL", 77, 4, "there is no filter 'OCTAHEDRAL' of 'INDICES'"),
        ("ATTRIBUTES", "NONE", 77, 6, "attributes must have a stride of 4, 8 ... 256 bytes, got 6"),
        ("ATTRIBUTES", "NONE", 77, 260, "attributes must have a stride of 4, 8 ... 256 bytes, got 260"),
        ("ATTRIBUTES", "OCTAHEDRAL", 77, 12, "the filter OCTAHEDRAL needs a stride of 4 or 8 bytes, got 12"),
        ("ATTRIBUTES", "COLOR", 77, 16, "the filter COLOR needs a stride of 4 or 8 bytes, got 16"),
        ("ATTRIBUTES", "QUATERNION", 77, 4, "the filter QUATERNION needs a stride of 8 bytes, got 4"),
        ("TRIANGLES", "NONE", 77, 4, "triangles must have a stride of 2 or 4 bytes and be whole, got 77 of 4"),
        ("INDICES", "NONE", 77, 8, "indices must have a stride of 2 or 4 bytes and be whole, got 77 of 8"),
    ):
        with pytest.raises(ValueError, match=re.escape(rule)) as raised:
            decode(data, mode, kind, count, stride)
        assert type(raised.value) is ValueError


def test_memory_is_charged_before_it_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gltf = packed_square(count=10**8)
    view = gltf.document["bufferViews"][0]
    view["byteLength"] = 12 * 10**8
    monkeypatch.setenv(VARIABLE, "bytes=1GiB")
    rule = r"bufferViews\[0\]: EXT_meshopt_compression: 100000000 elements of 12 bytes needs 1\.12 GiB"
    with pytest.raises(DecodeError, match=rule):
        load_scene(gltf.save(tmp_path / "large.glb"))


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_a_compressed_file_is_the_scene_that_it_was(tmp_path: Path, name: str, suffix: str) -> None:
    compressed = load_scene(packed_square(name).save(tmp_path / f"packed{suffix}"))
    gltf = Gltf()
    gltf.node(mesh=quad(gltf))
    plain = load_scene(gltf.save(tmp_path / f"plain{suffix}"))
    assert compressed.note.partition(" ")[2] == plain.note.partition(" ")[2]
    found, expected = (
        SceneSurfaces(scene, SMALL).frame(Views.at_rest([start_pose(scene)])) for scene in (compressed, plain)
    )
    assert np.isfinite(found.depth).any()
    assert np.array_equal(found.depth, expected.depth, equal_nan=True)
    assert np.array_equal(found.back, expected.back)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mode": "CUBES"}, "there is no mode 'CUBES'"),
        ({"filter": "SEPIA"}, "there is no filter 'SEPIA'"),
        (
            {"count": 2**31 - 1},
            r"bufferViews\[0\]: EXT_meshopt_compression: has 2147483647 elements of 12 bytes for a view of",
        ),
        ({"byteLength": 10**6}, r"byteLength: must be a number of bytes of its buffer"),
        ({"buffer": 1}, r"buffers\[1\]: has data by EXT_meshopt_compression alone"),
        ({"byteOffset": 4}, "must begin with the byte 0xa0 or 0xa1"),
    ],
)
def test_a_file_that_breaks_a_rule_is_refused_by_its_place(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(DecodeError, match=message):
        load_scene(packed_square(**changes).save(tmp_path / "broken.glb"))
