"""Reads glTF 2.0 files (.gltf and .glb): their JSON, and the numbers and images that it refers to.

The files are untrusted: every index, size and offset is checked, and no file outside of the scene's folder is read.

Source: Khronos Group, glTF 2.0 Specification (ISO/IEC 12113:2022), sections 3.6 (binary data) and 4 (GLB).
"""

from __future__ import annotations

import base64
import binascii
import errno
import json
import re
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError, decode_meshopt
from ..._util.budget import Budget
from ..._util.extras import from_extra
from ..._util.untrusted import decoding, read_charged
from ..named_file import GREY_UNKNOWN, named_file
from .rounding import within

_VALUE_BYTES = 100
"""About what a value of the JSON takes in memory; in the text it may be as short as one punctuation mark."""
_FORMER_REMEDY = "; Blender and gltf-pipeline convert files of version 1.0"
_HEADER_BYTES = 20
"""Bytes before the JSON of a GLB file: the file's header, and that of its first chunk."""

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

DRACO = "KHR_draco_mesh_compression"
_READ = {
    DRACO,
    *_MESHOPT,
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
}
"""Extensions that are read; those of materials have names of their own kind (:func:`unknown`)."""
_UNSEEN = {
    "EXT_instance_features",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_structural_metadata",
    "FB_ngon_encoding",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_lod",
}
"""Extensions that do not change what a camera sees; of levels of detail the finest is the node itself."""
_OTHER_IMAGES = ("EXT_texture_avif", "MSFT_texture_dds")
"""Images that a file may offer next to others; the readers check that these are there."""

Values = npt.NDArray[np.float64] | npt.NDArray[np.int64]


class Item(dict[str, Any]):
    """Holds an object of the JSON, whose values are read as attributes: unchecked, and None where they are missing."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self.get(name)


class GltfFile:
    """Reads a glTF file.

    Args:
        path: of the file.
        budget: what the file may take, with all files that it names; a new one if not given.

    Attributes:
        path, budget: the same.
        document: its JSON.
        files: other files that were read.

    Raises:
        OSError: if it cannot be read.
        DecodeError: naming the file and the place that breaks a rule; from all methods, too.
    """

    def __init__(self, path: Path, budget: Budget | None = None) -> None:
        self.path, self.budget = path, budget or Budget(path)
        self.files: dict[Path, None] = {}
        self._arrays: dict[int, Values] = {}
        self._finite: set[int] = set()
        """The accessors that were checked, so that each is checked once, however many users it has."""
        self._buffers: dict[int, memoryview] = {}
        self._names: dict[str, Path] = {}
        """What each name leads to, so that each is told once."""
        self._decoded: dict[int, memoryview] = {}
        """The buffer views that were compressed, so that each is decoded once, however many users it has."""
        with decoding(path):
            text, self._chunk = _parts(read_charged(path, self.budget))
            self.document = self._parsed(text)
        required = [
            name for name in map(str, self.document.extensionsRequired or []) if name in _OTHER_IMAGES or unknown(name)
        ]
        if required:
            advice = "; export its textures as PNG, JPEG or WebP" if required[0] in _OTHER_IMAGES else ""
            raise self.error("extensionsRequired", f"{plain(required[0])} is not read{advice}")

    def error(self, where: str, rule: str) -> DecodeError:
        """Return the error to raise for a broken rule; ``where`` names the part of the file."""
        return DecodeError(f"{self.path}: {where}: {rule}")

    def item(self, name: str, index: object, where: str) -> Item:
        """Return object ``index`` of the document's list ``name``, to which ``where`` refers."""
        items = getattr(self.document, name) or []
        return items[self.whole(index, where, f"of the {len(items)} {name}", len(items) - 1)]

    def whole(self, value: object, where: str, counted: str, most: int) -> int:
        """Return a whole number from 0 to ``most``; ``counted`` says in the message what it counts: ``of bytes``."""
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
            raise self.error(where, f"must be a number {counted}, counted from 0, got {plain(value)}")
        return value

    def numbers(
        self, value: object, where: str, count: int, *, low: float = -1e18, high: float = 1e18
    ) -> npt.NDArray[np.float64]:
        """Return ``count`` finite numbers of the JSON, float64; a number just beyond a bound, by rounding, is
        clipped."""
        items = value if isinstance(value, list | tuple) else [value]
        kinds = (isinstance(one, int | float) and not isinstance(one, bool) for one in items)
        got = within(np.array(items, np.float64), low, high) if len(items) == count and all(kinds) else None
        if got is None:
            wanted = "a number" if count == 1 else f"{count} numbers"
            raise self.error(where, f"must be {wanted} from {low:g} to {high:g}, got {plain(value)}")
        return got

    def array(self, index: object, where: str, *, width: tuple[int, ...], finite: bool = True) -> Values:
        """Return the values (n, width) of an accessor: float64, or int64 where they are not normalised.

        Args:
            width: how many numbers an element may have.
            finite: refuse numbers that are not finite.
        """
        accessor = self.item("accessors", index, where)
        assert isinstance(index, int)
        if index not in self._arrays:
            self._arrays[index] = self._read(accessor, f"accessors[{index}]")
        values = self._arrays[index]
        if values.shape[1] not in width:
            raise self.error(f"accessors[{index}]", f"must have {' or '.join(map(str, width))} numbers each ({where})")
        if finite and index not in self._finite:
            if not (np.abs(values) < 1e18).all():  # squares of lengths must fit in float32; False for NaN too
                raise self.error(f"accessors[{index}]", f"must have finite values ({where})")
            self._finite.add(index)
        return values

    def unbacked(self, index: object, where: str) -> bool:
        """Return whether an accessor has no data of its own: all of it is 0."""
        accessor = self.item("accessors", index, where)
        return accessor.bufferView is None and accessor.sparse is None

    def unpack_draco(self, packed: object, accessors: dict[str, object], where: str) -> bool:
        """Decode a primitive that is compressed by Draco, and keep its values for the accessors that have no data.

        Args:
            packed: the extension's object.
            accessors: the number of the accessor of each attribute, and of the ``indices``.

        Returns:
            Whether the accessors say how many vertices and indices there are. Some encoders part vertices at seams and
            leave out faces, and the accessors know nothing of it.

        Raises:
            ImportError: if the library is missing, with the extra that brings it.
        """
        with from_extra("gltf"):
            import DracoPy
        where = f"{where}: {DRACO}"
        if not isinstance(packed, Item) or not isinstance(packed.attributes, dict):
            raise self.error(where, "must have a bufferView and attributes")
        data, _ = self._view(packed.bufferView, where)
        for name, index in accessors.items():
            accessor = self.item("accessors", index, f"{where}: {name}")
            count = self.whole(accessor.count, f"accessors[{index}].count", "of elements", 2**31 - 1)
            most = _WIDTHS.get(accessor.type, 16)
            self.budget.take(2 * 8 * count * most, f"{where}: {count} elements of {name}")
        with decoding(self.path, where):
            mesh = DracoPy.decode(bytes(data))
            decoded = {attribute["unique_id"]: np.asarray(attribute["data"]) for attribute in mesh.attributes}
            faces = np.asarray(getattr(mesh, "faces", np.empty((0, 3))))
        vertices, as_said = max(map(len, decoded.values()), default=0), True
        for name, index in accessors.items():
            accessor, values = self.item("accessors", index, where), faces.reshape(-1, 1)
            count = len(values)
            if name != "indices":
                if name not in packed.attributes:
                    continue
                values, count = decoded.get(packed.attributes[name], np.empty((0, 1))), vertices
            width = _WIDTHS.get(accessor.type)
            if values.shape != (count, width):
                got = f"{len(values)} of {values.shape[-1]} numbers"
                raise self.error(where, f"{name} must have {plain(count)} elements of {width} numbers, got {got}")
            as_said &= count == accessor.count
            more = max(0, count - accessor.count) * width
            self.budget.take(2 * 8 * more, f"{where}: {count} elements of {name}")
            if values.dtype.kind == "f":
                self._arrays[int(str(index))] = values.astype(np.float64)
            elif accessor.normalized:
                self._arrays[int(str(index))] = np.maximum(values / np.iinfo(values.dtype).max, -1.0)
            else:
                self._arrays[int(str(index))] = values.astype(np.int64)
        return as_said

    def image(self, item: Item, where: str) -> tuple[bytes | memoryview, Path | None]:
        """Return the bytes of an image, to which ``where`` refers, and its file if it has one of its own."""
        if item.bufferView is not None:
            return self._view(item.bufferView, where)[0], None
        if not isinstance(item.uri, str):
            raise self.error(where, "must have a bufferView or a uri")
        if item.uri.startswith("data:"):
            return self._embedded(item.uri, where), None
        if self.lacks_image(item, where):
            rule = f"is not there; put it there, or take surfaces with missing textures as grey: {GREY_UNKNOWN}"
            raise _missing(f"{self.path}: {where}: the file {plain(item.uri)} {rule}")
        file = self._local(item.uri, where)
        return read_charged(file, self.budget), file

    def lacks_image(self, item: Item, where: str) -> bool:
        """Return whether an image, to which ``where`` refers, is in a file that is not there."""
        if item.bufferView is not None or not isinstance(item.uri, str) or item.uri.startswith("data:"):
            return False
        return not self._named(item.uri, where).is_file()

    def _parsed(self, text: bytes) -> Item:
        """Parse the JSON; what it will take is charged before."""
        values = sum(map(text.count, (b",", b":", b"[", b"{")))
        self.budget.take(_VALUE_BYTES * values, f"JSON with {values} values")
        self.budget.count(text.count(b"{"), "objects of the JSON")
        with self.budget.borrow(4 * len(text), "JSON, while it is parsed,"):
            try:
                document = json.loads(text.decode("utf-8-sig"), object_hook=Item)
            except ValueError as error:
                raise ValueError(f"its JSON cannot be read: {error}") from None
        version = getattr(getattr(document, "asset", None), "version", None)
        if not str(version).startswith("2."):
            remedy = _FORMER_REMEDY if str(version).split(".")[0] == "1" else ""
            raise ValueError(f"must be glTF 2.0, got version {plain(version)}{remedy}")
        return document

    def _read(self, accessor: Item, where: str) -> Values:
        count = self.whole(accessor.count, f"{where}.count", "of elements", 2**31 - 1)
        kind, width = _COMPONENTS.get(accessor.componentType), _WIDTHS.get(accessor.type)
        if kind is None or width is None:
            got = f"{plain(accessor.componentType)}, {plain(accessor.type)}"
            raise self.error(where, f"must have a componentType and a type of glTF 2.0, got {got}")
        wanted = f"{where}: {count} elements of {width} numbers"
        if accessor.bufferView is not None:
            values = self._elements(accessor.bufferView, accessor.byteOffset, count, width, kind, where)
            self.budget.take(8 * count * width, wanted)
        else:
            self.budget.take(8 * count * width, wanted)
            values = np.zeros((count, width), kind)
        if accessor.sparse is not None:
            values = self._with_sparse(values, accessor.sparse, kind, where)
        if values.dtype.kind != "f" and accessor.normalized:
            return np.asarray(np.maximum(values / np.iinfo(kind).max, -1.0))
        if values.dtype.kind != "f":
            return values.astype(np.int64)
        return values.astype(np.float64)

    def _elements(self, view: object, offset: object, count: int, width: int, kind: str, where: str) -> Values:
        data, stride = self._view(view, where)
        size = width * np.dtype(kind).itemsize
        begin = self.whole(0 if offset is None else offset, f"{where}.byteOffset", "of bytes", len(data))
        stride = size if stride is None else self.whole(stride, f"{where}: byteStride", "of bytes", 252)
        if stride < size or begin + (count - 1) * stride + size > len(data):
            raise self.error(where, f"{count} elements of {size} bytes, {stride} apart, exceed its bufferView")
        return np.ndarray((count, width), kind, data, begin, (stride, np.dtype(kind).itemsize))

    def _with_sparse(self, values: Values, sparse: Item, kind: str, where: str) -> Values:
        count = self.whole(sparse.count, f"{where}.sparse.count", "of elements", len(values))
        values_of = sparse.get("values")  # as an attribute it is a dictionary's method
        if count == 0 or sparse.indices is None or values_of is None:
            raise self.error(f"{where}.sparse", "must have a count, indices and values")
        indices_kind = _COMPONENTS.get(sparse.indices.componentType, "")
        if indices_kind[1:2] != "u":
            raise self.error(f"{where}.sparse.indices", "must be unsigned integers")
        inside = f"{where}.sparse"
        indices = self._elements(
            sparse.indices.bufferView, sparse.indices.byteOffset, count, 1, indices_kind, inside
        ).ravel()
        if indices.max() >= len(values):
            raise self.error(inside, f"names element {indices.max()} of {len(values)}")
        changed = values.copy()
        changed[indices] = self._elements(
            values_of.bufferView, values_of.byteOffset, count, values.shape[1], kind, inside
        )
        return changed

    def _view(self, index: object, where: str) -> tuple[memoryview, object]:
        """Return the bytes of a buffer view, and its stride."""
        view = self.item("bufferViews", index, f"{where}.bufferView")
        where = f"bufferViews[{index}]"
        extension = next((name for name in _MESHOPT if name in dictionary(view.extensions)), None)
        if extension is not None and self._lacks_data(view.buffer, where):
            assert isinstance(index, int)
            if index not in self._decoded:
                self._decoded[index] = self._unpacked(view, view.extensions[extension], f"{where}: {extension}")
            return self._decoded[index], view.byteStride
        buffer = self._buffer(view.buffer, where)
        offset = self.whole(0 if view.byteOffset is None else view.byteOffset, where, "of bytes", len(buffer))
        length = self.whole(view.byteLength, f"{where}.byteLength", "of bytes of its buffer", len(buffer) - offset)
        return buffer[offset : offset + length], view.byteStride

    def _lacks_data(self, index: object, where: str) -> bool:
        """Return whether a buffer only says how long its data would be without compression."""
        buffer = self.item("buffers", index, f"{where}.buffer")
        return buffer.uri is None and not (index == 0 and len(self._chunk))

    def _unpacked(self, view: Item, packed: object, where: str) -> memoryview:
        """Return the bytes of a buffer view that is compressed."""
        if not isinstance(packed, Item):
            raise self.error(where, f"must be an object, got {plain(packed)}")
        buffer = self._buffer(packed.buffer, where)
        offset = self.whole(0 if packed.byteOffset is None else packed.byteOffset, where, "of bytes", len(buffer))
        length = self.whole(packed.byteLength, f"{where}.byteLength", "of bytes of its buffer", len(buffer) - offset)
        count = self.whole(packed.get("count"), f"{where}.count", "of elements", 2**31 - 1)
        stride = self.whole(packed.byteStride, f"{where}.byteStride", "of bytes", 256)
        if view.byteLength != count * stride:
            raise self.error(where, f"has {count} elements of {stride} bytes for a view of {plain(view.byteLength)}")
        kind, filter_name = str(packed.mode), str(packed.get("filter") or "NONE")
        self.budget.take(count * stride, f"{where}: {count} elements of {stride} bytes")
        self.budget.check_time("decoding its compressed buffer views")
        data = np.frombuffer(buffer, np.uint8)[offset : offset + length]
        try:
            return decode_meshopt(data, kind, filter_name, count, stride).data
        except ValueError as error:
            raise self.error(where, str(error)) from None

    def _buffer(self, index: object, where: str) -> memoryview:
        buffer = self.item("buffers", index, f"{where}.buffer")
        assert isinstance(index, int)
        if index not in self._buffers:
            where = f"buffers[{index}]"
            if isinstance(buffer.uri, str):
                embedded = buffer.uri.startswith("data:")
                data: bytes | memoryview = (
                    self._embedded(buffer.uri, where)
                    if embedded
                    else read_charged(self._local(buffer.uri, where), self.budget)
                )
            else:
                data = self._chunk if index == 0 else b""
                if not len(data):
                    compressed = [one for one in buffer.extensions or {} if one in _MESHOPT]
                    if compressed:
                        raise self.error(where, f"has data by {compressed[0]} alone, which is not read")
                    raise self.error(where, "has neither a uri nor a binary chunk")
            length = self.whole(buffer.byteLength, f"{where}.byteLength", f"of the {len(data)} bytes", len(data))
            self._buffers[index] = memoryview(data)[:length]
        return self._buffers[index]

    def _embedded(self, uri: str, where: str) -> bytes:
        head, _, text = uri.partition(",")
        if not head.endswith(";base64"):
            raise self.error(where, "a data: uri must be in base64")
        self.budget.take(3 * len(text) // 4, f"{where}: its data: uri")
        try:
            return base64.b64decode(unquote(text), validate=True)
        except (binascii.Error, ValueError) as error:
            raise self.error(where, f"is no base64: {error}") from None

    def _named(self, uri: str, where: str) -> Path:
        """Return the path of a file next to this one, or in a folder below. It need not be there."""
        name = unquote(uri)
        if re.match(r"[A-Za-z][\w+.-]*:", name) or "\\" in name:
            raise self.error(where, f"must name a file in the scene's folder, got {plain(uri)}")
        if name not in self._names:
            self._names[name] = named_file(name, self.path, self.path.parent, f"{self.path}: {where}")
        return self._names[name]

    def _local(self, uri: str, where: str) -> Path:
        """Return the path of a file that is there, next to this one, or in a folder below."""
        file = self._named(uri, where)
        if not file.is_file():
            raise _missing(f"{self.path}: {where}: the file {plain(uri)} is not there")
        self.files[file] = None
        return file


def _missing(message: str) -> FileNotFoundError:
    """Return the error for a file that is not there, as the operating system would report it."""
    error = FileNotFoundError(message)
    error.errno = errno.ENOENT
    return error


def unknown(extension: str) -> bool:
    """Return whether an extension is unknown, so that it may change where surfaces are."""
    known = extension in _READ | _UNSEEN or extension in _OTHER_IMAGES
    return not known and re.fullmatch(r"[A-Z0-9]+_materials_\w+", extension) is None


def dictionary(value: object) -> Item:
    """Return ``value`` if it is an object of the JSON, else {}."""
    return value if isinstance(value, Item) else Item()


def plain(value: object) -> str:
    """Return a value of the file for a message: short, and on one line."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _parts(data: bytes) -> tuple[bytes, memoryview]:
    """Return the JSON of a file, and its binary chunk, which may be empty."""
    if data[:4] != b"glTF":
        if not re.match(rb"(\xef\xbb\xbf)?\s*\{", data):
            raise ValueError(f"a glTF file must begin with 'glTF' (binary) or be a JSON object, got {data[:16]!r}")
        return data, memoryview(b"")
    if len(data) < _HEADER_BYTES:
        raise ValueError(f"a GLB file must have a header and a chunk of JSON, this has {len(data)} bytes")
    version, length, first = struct.unpack_from("<3I", data, 4)
    end = _HEADER_BYTES + first
    if version == 1:
        raise ValueError(f"must be glTF 2.0, got a GLB file of version 1{_FORMER_REMEDY}")
    if version != 2 or not end <= length <= len(data) or data[16:20] != b"JSON":
        got = f"version {version}, {length} of {len(data)} bytes"
        raise ValueError(f"a GLB file must be of version 2, whole, and begin with its JSON, got {got}")
    text, at = data[_HEADER_BYTES:end], end
    while at + 8 <= length:  # chunks of unknown kinds are skipped
        size, kind = struct.unpack_from("<I4s", data, at)
        if kind == b"BIN\0":
            if at + 8 + size > length:
                raise ValueError(f"its binary chunk has {length - at - 8} of {size} bytes")
            return text, memoryview(data)[at + 8 : at + 8 + size]
        at += 8 + size
    return text, memoryview(b"")
