"""Cuts Mitsuba's meshes along the opacity masks of their materials, so that the renderers without noise show them.

Mitsuba's ``mask`` lets a part of the rays through, by a texture (Mitsuba 3 documentation, Opacity mask). Where that
texture is opaque or clear almost everywhere, what is left of the mesh is the part that is more than half opaque. Meshes
with other masks stay whole, and blend.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import Mitsuba, MitsubaBsdf, MitsubaShape, MitsubaTexture
from ..scene.files.alpha_mask import AlphaMask
from ..scene.texel_lookup import WRAP_MODES
from .diffuse_materials import children
from .mesh_buffers import MeshBuffers, mesh_attributes
from .texels import (
    LUMINANCE,
    Texels,
    bilinear_meaning,
    looked_up,
    lookup_positions,
    nearest_meaning,
    uv_map_of,
)

FloatArray = npt.NDArray[np.float64]

_CUTOFF = 0.5
"""The opacity from which on a surface is seen."""


class CutMesh(NamedTuple):
    """Holds what is left of a mesh.

    Attributes:
        mesh: its triangles.
        bsdf: the material that the mask was around.
        tolerance_texels: how far the outline may have moved; None where no mask hides anything.
    """

    mesh: MeshBuffers
    bsdf: MitsubaBsdf
    tolerance_texels: float | None = None


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
    if not shape.is_mesh() or shape.is_emitter() or mesh_attributes(shape, mi):
        return None
    inside, mesh = children(shape.bsdf()), MeshBuffers.of(shape)
    parameters = mi.traverse(inside["opacity"])
    if mesh.texcoords is None or "data" not in parameters:
        return None
    uv_map = uv_map_of(parameters)
    mask = _alpha_mask(inside["opacity"], np.asarray(parameters["data"]), uv_map, mi)
    if mask is None or mask.is_soft:
        return None
    tolerance = None
    if mask.is_divided:
        uv = mesh.texcoords @ uv_map[:2, :2].T + uv_map[:2, 2]
        pieces = mask.cut(uv[mesh.faces])
        if pieces is None or not len(pieces.source):
            return None
        tolerance = pieces.tolerance_texels
        mesh = MeshBuffers(
            np.arange(3 * len(pieces.source), dtype=np.uint32).reshape(-1, 3),
            pieces.of(mesh.positions[mesh.faces]).reshape(-1, 3),
            pieces.of(mesh.texcoords[mesh.faces]).reshape(-1, 2),
            None if mesh.normals is None else pieces.normals(mesh.normals[mesh.faces]).reshape(-1, 3),
        )
    elif mask.alpha.max() < 255 * _CUTOFF:
        return None
    return CutMesh(mesh, inside["nested_bsdf"], tolerance)


def _alpha_mask(
    texture: MitsubaTexture, data: npt.NDArray[np.generic], uv_map: FloatArray, mi: Mitsuba
) -> AlphaMask | None:
    """Return the mask that a bitmap is; None where its lookups are neither bilinear nor nearest."""
    uv, mapped = lookup_positions(uv_map)
    opacity = looked_up(texture.eval_1, uv, mi)
    meant, nearest = bilinear_meaning(data, mapped, opacity, LUMINANCE), False
    if meant is None:
        meant, nearest = nearest_meaning(data, mapped, opacity, LUMINANCE), True
    return None if meant is None else AlphaMask(_alpha(meant[0]), _CUTOFF, WRAP_MODES[meant[1]], nearest)


def _alpha(texels: Texels) -> npt.NDArray[np.uint8]:
    """Return opacity (H, W) in 256 steps."""
    opacity = np.concatenate([piece @ LUMINANCE for _, piece in texels.pieces()])
    return np.round(255 * np.clip(opacity, 0, 1)).astype(np.uint8).reshape(texels.shape[:2])
