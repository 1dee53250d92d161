"""Meshes of glTF files that are compressed by Draco."""

from __future__ import annotations

import base64
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import DecodeError, SceneFileWarning, load_scene
from davis_rs.scene.files.gltf_file import GltfFile
from gltf_files import CORNERS, FACES, Gltf

PACKED = base64.b64decode(
    "RFJBQ08CAgEAAAACBAEAAQIAAgMBAgMJAgEAAAkDAAEAAgAAAAAAAAAAAACAPwAAAAAAAIA/AACAPwAAAAAAAIA/AAEBAAMDATAB"
    "EAMANIKIBAAAAAD/PwAAAACAvwAAgL8AAAAAAAAAQA4="
)
"""A square with texture coordinates (attribute 0) and positions (attribute 1), of the reference encoder."""


def square(data: bytes = PACKED, counts: tuple[int, int] = (4, 6), **changes: Any) -> Gltf:
    """The square, of so many vertices and indices by its accessors; nothing of it is there in plain."""
    gltf = Gltf(extensionsRequired=["KHR_draco_mesh_compression"])
    packed = {"bufferView": gltf.view(data), "attributes": {"POSITION": 1, "TEXCOORD_0": 0}, **changes}
    accessors = [(5126, counts[0], "VEC3"), (5126, counts[0], "VEC2"), (5123, counts[1], "SCALAR")]
    for component, count, kind in accessors:
        gltf.add("accessors", {"componentType": component, "count": count, "type": kind})
    primitive = {
        "attributes": {"POSITION": 0, "TEXCOORD_0": 1},
        "indices": 2,
        "extensions": {"KHR_draco_mesh_compression": packed},
    }
    gltf.node(mesh=gltf.add("meshes", {"primitives": [primitive]}))
    return gltf


def test_a_compressed_mesh_is_what_it_was(tmp_path: Path) -> None:
    pytest.importorskip("DracoPy")
    path = square().save(tmp_path / "packed.glb")
    assert "2 m x 0 m wide and 2 m high" in load_scene(path).note
    file = GltfFile(path)
    primitive = file.document.meshes[0].primitives[0]
    packed = primitive.extensions["KHR_draco_mesh_compression"]
    file.unpack_draco(packed, {"POSITION": 0, "TEXCOORD_0": 1, "indices": 2}, "here")
    assert np.array_equal(file.array(2, "here", width=(1,)).reshape(-1, 3), FACES)
    np.testing.assert_allclose(file.array(0, "here", width=(3,)), CORNERS, atol=2e-4)
    np.testing.assert_allclose(file.array(1, "here", width=(2,)), CORNERS[:, :2] / 2 + 0.5, atol=2e-4)


@pytest.mark.parametrize("counts", [(3, 6), (7, 6), (4, 9)])
def test_other_counts_than_those_of_the_file_are_told(tmp_path: Path, counts: tuple[int, int]) -> None:
    """Encoders part vertices at seams, and leave out triangles without area."""
    pytest.importorskip("DracoPy")
    path = square(counts=counts).save(tmp_path / "packed.glb")
    with pytest.warns(SceneFileWarning, match=r"in Draco's data than the file says: the data decide: 1 \(the first: "):
        assert "2 m x 0 m wide and 2 m high" in load_scene(path).note


def test_what_breaks_a_rule_is_refused_by_its_place(tmp_path: Path) -> None:
    pytest.importorskip("DracoPy")
    for gltf, message in (
        (square(attributes=None), "KHR_draco_mesh_compression: must have a bufferView and attributes"),
        (square(attributes={"POSITION": 0}), "POSITION must have 4 elements of 3 numbers, got 4 of 2 numbers"),
        (square(attributes={"POSITION": 9}), "got 0 of 1 numbers"),
        (square(b"DRACO" + bytes(60)), r"broken\.glb, meshes\[0\]\.primitives\[0\]: KHR_draco_mesh_compression: "),
    ):
        with pytest.raises(DecodeError, match=message):
            load_scene(gltf.save(tmp_path / "broken.glb"))


def test_damaged_data_end_in_an_error_of_ours(tmp_path: Path, long: bool) -> None:
    pytest.importorskip("DracoPy")
    random = np.random.RandomState(2)
    for _ in range(100 if long else 20):
        data = bytearray(PACKED)
        for at in random.randint(0, len(data), 2):
            data[at] = random.randint(0, 256)
        with suppress(DecodeError, SceneFileWarning):
            load_scene(square(bytes(data)).save(tmp_path / "damaged.glb"))


def test_without_the_library_its_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(ImportError, match=r"pip install 'davis_rs\[gltf\]'"):
        load_scene(square().save(tmp_path / "packed.glb"))
