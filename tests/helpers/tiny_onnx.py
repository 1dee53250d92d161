"""Writes a network of three operations as an ONNX file, by the protobuf wire format: (before, after, t) -> blend."""

from __future__ import annotations

_FLOAT, _IR_VERSION, _OPSET = 1, 8, 13


def blending_network() -> bytes:
    """Return an ONNX model: before + t (after - before), images of any size with three channels."""
    nodes = [
        _node("Sub", ["after", "before"], "change"),
        _node("Mul", ["change", "t"], "step"),
        _node("Add", ["before", "step"], "between"),
    ]
    images = [_field(11, _value(name, ["n", 3, "h", "w"])) for name in ("before", "after")]
    graph = b"".join(_field(1, node) for node in nodes) + _field(2, b"blend") + b"".join(images)
    graph += _field(11, _value("t", [1, 1, 1, 1])) + _field(12, _value("between", ["n", 3, "h", "w"]))
    return _number(1, _IR_VERSION) + _field(7, graph) + _field(8, _field(1, b"") + _number(2, _OPSET))


def _node(kind: str, inputs: list[str], output: str) -> bytes:
    return b"".join(_field(1, name.encode()) for name in inputs) + _field(2, output.encode()) + _field(4, kind.encode())


def _value(name: str, sides: list[int | str]) -> bytes:
    dims = (_number(1, side) if isinstance(side, int) else _field(2, side.encode()) for side in sides)
    shape = b"".join(_field(1, dim) for dim in dims)
    return _field(1, name.encode()) + _field(2, _field(1, _number(1, _FLOAT) + _field(2, shape)))


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _field(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    low = value & 0x7F
    return bytes([low | 0x80]) + _varint(value >> 7) if value > 0x7F else bytes([low])
