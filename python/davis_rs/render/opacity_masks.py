"""Cuts Mitsuba's meshes along the opacity masks of their materials, so that the renderers without noise show them.

Mitsuba's ``mask`` lets a part of the rays through, by a texture (Mitsuba 3 documentation, Opacity mask). Where that
texture is opaque or clear almost everywhere, what is left of the mesh is the part that is more than half opaque. Soft
masks are left to Mitsuba's integrators.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import Mitsuba, MitsubaBsdf, MitsubaShape
from .._mitsuba.variants import FAST
from ..events.luma import LUMA_WEIGHTS
from ..scene.files.alpha_mask import AlphaMask
from .diffuse_materials import children
from .mesh_buffers import MeshBuffers
from .texels import WRAP_MODES, Texels, bilinear_meaning, lookup_positions, nearest_meaning, uv_map_of

FloatArray = npt.NDArray[np.float64]

_CUTOFF = 0.5
"""The opacity from which on a surface is seen."""


class CutMesh(NamedTuple):
    """Holds what is left of a mesh.

    Attributes:
        mesh: its triangles.
        bsdf: the material that the mask was around.
        is_part: whether the mask hides anything.
    """

    mesh: MeshBuffers
    bsdf: MitsubaBsdf
    is_part: bool


def is_masked(shape: MitsubaShape) -> bool:
    """Return whether a shape's material has an opacity mask."""
    bsdf = shape.bsdf()
    return bsdf is not None and bool(bsdf.class_name() == "MaskBSDF")


def cut_mesh(shape: MitsubaShape, mi: Mitsuba) -> CutMesh | None:
    """Cut a mesh along the mask of its material.

    Args:
        shape: whose material has a mask (:func:`is_masked`).
        mi: Mitsuba, under the variant that loaded the scene.

    Returns:
        None where the mesh has to stay as it is: the mask is soft, hides all or has no texels, it would have too many
        pieces, or the mesh shines or has attributes of its own.
    """
    if not shape.is_mesh() or shape.is_emitter() or _has_attributes(shape, mi):
        return None
    inside, mesh = children(shape.bsdf()), MeshBuffers.of(shape)
    parameters = mi.traverse(inside["opacity"])
    if mesh.texcoords is None or "data" not in parameters:
        return None
    uv_map = uv_map_of(parameters)
    mask = _alpha_mask(inside["opacity"], np.asarray(parameters["data"]), uv_map, mi)
    if mask is None or mask.is_soft:
        return None
    if mask.is_divided:
        uv = mesh.texcoords @ uv_map[:2, :2].T + uv_map[:2, 2]
        pieces = mask.cut(uv[mesh.faces])
        if pieces is None or not len(pieces.source):
            return None
        mesh = MeshBuffers(
            np.arange(3 * len(pieces.source), dtype=np.uint32).reshape(-1, 3),
            pieces.of(mesh.positions[mesh.faces]).reshape(-1, 3),
            pieces.of(mesh.texcoords[mesh.faces]).reshape(-1, 2),
            None if mesh.normals is None else pieces.normals(mesh.normals[mesh.faces]).reshape(-1, 3),
        )
    elif mask.alpha.max() < 255 * _CUTOFF:
        return None
    return CutMesh(mesh, inside["nested_bsdf"], mask.is_divided)


def _has_attributes(shape: MitsubaShape, mi: Mitsuba) -> bool:
    own = ("vertex_positions", "vertex_normals", "vertex_texcoords")
    return any(name.startswith(("vertex_", "face_")) and name not in own for name, _ in mi.traverse(shape))


def _alpha_mask(
    texture: MitsubaBsdf, data: npt.NDArray[np.generic], uv_map: FloatArray, mi: Mitsuba
) -> AlphaMask | None:
    """Return the mask that a bitmap is; None where its lookups are neither bilinear nor nearest."""
    uv, mapped = lookup_positions(uv_map)
    looked_up, weights = _opacity_at(texture, uv, mi), np.array(LUMA_WEIGHTS)[:, None]
    meant, nearest = bilinear_meaning(data, mapped, looked_up, weights), False
    if meant is None:
        meant, nearest = nearest_meaning(data, mapped, looked_up, weights), True
    return None if meant is None else AlphaMask(_alpha(meant[0]), _CUTOFF, WRAP_MODES[meant[1]], nearest)


def _opacity_at(texture: MitsubaBsdf, uv: npt.NDArray[np.float32], mi: Mitsuba) -> FloatArray:
    """Return the opacity (n, 1) that Mitsuba looks up at uv (2, n)."""

    def at(uv: npt.NDArray[np.float32] | list[float]) -> FloatArray:
        si = mi.SurfaceInteraction3f()
        si.uv = mi.Point2f(uv)
        return np.array(texture.eval_1(si), np.float64)

    return at(uv).reshape(-1, 1) if mi.variant() == FAST else np.array([[at(pair)] for pair in uv.T.tolist()])


def _alpha(texels: Texels) -> npt.NDArray[np.uint8]:
    """Return opacity (H, W) in 256 steps."""
    opacity = np.concatenate([piece @ np.array(LUMA_WEIGHTS) for _, piece in texels.pieces()])
    return np.round(255 * np.clip(opacity, 0, 1)).astype(np.uint8).reshape(texels.shape[:2])
