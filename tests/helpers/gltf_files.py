"""glTF files made in code."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

_KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
CORNERS_PACKED = "oAAAAAEzAAAA//8AAAABDAAAAP8AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAIC/AACAvwAAAAA="
FACES_PACKED = "4fAAAHaHVmd4qYZliWiYAWkAAA=="
"""The corners and faces of a square, as meshoptimizer compresses them."""

_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Gltf:
    """A document that grows, and its binary data."""

    def __init__(self, **parts: Any) -> None:
        self.document: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], **parts}
        self.data = bytearray()

    def add(self, kind: str, item: dict[str, Any]) -> int:
        """Add to one of the document's lists; returns the number that it has there."""
        items = self.document.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def view(self, data: bytes) -> int:
        """Bytes as a buffer view."""
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.data += data
        return self.add("bufferViews", view)

    def array(self, values: npt.ArrayLike, kind: str = "f4", **more: Any) -> int:
        """Numbers (n,) or (n, width) as an accessor."""
        array = np.asarray(values, f"<{kind}")
        wide = array.reshape(len(array), -1)
        accessor = {"bufferView": self.view(array.tobytes()), "componentType": _KINDS[kind], "count": len(array)}
        return self.add("accessors", {**accessor, "type": _TYPES[wide.shape[1]], **more})

    def node(self, *, root: bool = True, **parts: Any) -> int:
        """A node, of the scene itself if it is no other's child."""
        number = self.add("nodes", parts)
        if root:
            self.document["scenes"][0]["nodes"].append(number)
        return number

    def mesh(self, corners: npt.ArrayLike, faces: npt.ArrayLike, **more: Any) -> int:
        """Triangles: vertices (n, 3), faces (m, 3); ``uv``, ``normals``, ``colours`` and ``material`` as well."""
        attributes = {"POSITION": self.array(corners)}
        for key, name in (("uv", "TEXCOORD_0"), ("normals", "NORMAL"), ("colours", "COLOR_0")):
            if key in more:
                attributes[name] = self.array(more.pop(key))
        primitive = {"attributes": attributes, "indices": self.array(np.ravel(faces), "u2"), **more}
        return self.add("meshes", {"primitives": [primitive]})

    def material(self, name: str = "paint", *, double_sided: bool = True, more: Any = None, **surface: Any) -> int:
        """One that is no metal."""
        pbr = {"metallicFactor": 0.0, **surface}
        return self.add(
            "materials", {"name": name, "pbrMetallicRoughness": pbr, "doubleSided": double_sided} | (more or {})
        )

    def texture(self, image: dict[str, Any], sampler: dict[str, Any] | None = None) -> dict[str, int]:
        """A texture's index as a material wants it."""
        texture = {"source": self.add("images", image)}
        if sampler is not None:
            texture["sampler"] = self.add("samplers", sampler)
        return {"index": self.add("textures", texture)}

    def light(self, light: dict[str, Any], **node: Any) -> int:
        """A light of KHR_lights_punctual on a node of its own."""
        self.document.setdefault("extensionsUsed", []).append("KHR_lights_punctual")
        lights = self.document.setdefault("extensions", {}).setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append(light)
        return self.node(extensions={"KHR_lights_punctual": {"light": len(lights) - 1}}, **node)

    def animate(self, node: int, path: str, times: npt.ArrayLike, values: npt.ArrayLike, kind: str = "LINEAR") -> None:
        """A channel of the one animation."""
        animations = self.document.setdefault("animations", [{"samplers": [], "channels": []}])
        sampler = {"input": self.array(times), "output": self.array(values), "interpolation": kind}
        animations[0]["samplers"].append(sampler)
        target = {"node": node, "path": path}
        animations[0]["channels"].append({"sampler": len(animations[0]["samplers"]) - 1, "target": target})

    def save(self, path: Path, *, buffer: str | None = None) -> Path:
        """Write a .glb, or a .gltf with its data embedded, or in the file ``buffer`` next to it.

        Buffers of the document itself come after that of the data.
        """
        document = dict(self.document)
        others = document.get("buffers", [])
        if path.suffix == ".glb":
            if self.data:
                document["buffers"] = [{"byteLength": len(self.data)}, *others]
            text = json.dumps(document).encode()
            text += b" " * (-len(text) % 4)
            data = bytes(self.data) + b"\0" * (-len(self.data) % 4)
            chunks = [(text, b"JSON"), *([(data, b"BIN\0")] if data else [])]
            body = b"".join(len(chunk).to_bytes(4, "little") + kind + chunk for chunk, kind in chunks)
            path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body)
            return path
        if self.data:
            uri = f"data:application/octet-stream;base64,{base64.b64encode(self.data).decode()}"
            if buffer is not None:
                (path.parent / buffer).write_bytes(self.data)
                uri = buffer
            document["buffers"] = [{"byteLength": len(self.data), "uri": uri}, *others]
        path.write_text(json.dumps(document))
        return path


def png(pixels: npt.ArrayLike) -> bytes:
    """A PNG file of pixels of 8 bits."""
    file = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(file, "PNG")
    return file.getvalue()


CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)


def quad(gltf: Gltf, **more: Any) -> int:
    """A mesh: a square of 2 x 2 m in the plane z = 0."""
    return gltf.mesh(CORNERS, FACES, **more)


def with_camera(gltf: Gltf, distance: float = 3.0, **node: Any) -> int:
    """A camera on +z that looks along -z, 4:3, 90 degrees high."""
    camera = {"type": "perspective", "perspective": {"yfov": np.pi / 2, "aspectRatio": 4 / 3, "znear": 0.1}}
    number = gltf.add("cameras", camera)
    return gltf.node(camera=number, **{"translation": [0, 0, distance], **node})


def packed_square(name: str = "EXT_meshopt_compression", **changes: object) -> Gltf:
    """A square whose vertices and faces are compressed by an extension, and nothing of it is there in plain."""
    gltf = Gltf(extensionsRequired=[name])
    views = []
    for text, mode, count, stride in ((CORNERS_PACKED, "ATTRIBUTES", 4, 12), (FACES_PACKED, "TRIANGLES", 6, 2)):
        number = gltf.view(base64.b64decode(text))
        stored = gltf.document["bufferViews"][number]
        packed = {**stored, "byteStride": stride, "count": count, "mode": mode, **changes}
        plain = {"buffer": 1, "byteLength": count * stride, "extensions": {name: packed}}
        views.append(plain)
    gltf.document["bufferViews"] = views
    gltf.document["buffers"] = [{"byteLength": 60, "extensions": {name: {"fallback": True}}}]
    corners = {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}
    faces = {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}
    gltf.document["accessors"] = [corners, faces]
    gltf.document["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]
    gltf.node(mesh=0)
    return gltf
