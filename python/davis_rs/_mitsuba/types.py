"""Names the objects of Mitsuba and Dr.Jit for signatures.

Which classes both packages have depends on the variant in force, so no checker can read their types: each name here is
``Any`` to it. To a reader a signature says with them what it takes and gives. Nothing but the objects of these two
packages may be called so.
"""

from __future__ import annotations

from typing import Any, TypeAlias

Mitsuba: TypeAlias = Any
"""The module ``mitsuba`` under the variant in force."""

DrJit: TypeAlias = Any
"""The module ``drjit``."""

MitsubaObject: TypeAlias = Any
"""Any object of a scene: a shape, a material, a texture, an emitter, an integrator."""

MitsubaScene: TypeAlias = Any
"""``mi.Scene``, loaded under the variant in force."""

MitsubaShape: TypeAlias = Any
"""``mi.Shape``: a mesh, or another surface such as a sphere."""

MitsubaBsdf: TypeAlias = Any
"""``mi.BSDF``, a material."""

MitsubaTexture: TypeAlias = Any
"""``mi.Texture``: a bitmap, or one value everywhere."""

MitsubaEmitter: TypeAlias = Any
"""``mi.Emitter``, a light."""

MitsubaIntegrator: TypeAlias = Any
"""``mi.Integrator``."""

MitsubaMedium: TypeAlias = Any
"""``mi.Medium``, what light goes through."""

MitsubaSampler: TypeAlias = Any
"""``mi.Sampler``, or a class of one: random numbers."""

MitsubaParameters: TypeAlias = Any
"""``mi.SceneParameters``: what ``mi.traverse`` gives, the parameters of an object by their names."""

MitsubaValue: TypeAlias = Any
"""The value of a parameter: a number, a vector, a transform, a tensor."""

MitsubaBox: TypeAlias = Any
"""``mi.BoundingBox3f``."""

MitsubaHit: TypeAlias = Any
"""``mi.PreliminaryIntersection3f`` or ``mi.SurfaceInteraction3f``: where rays meet surfaces."""

SceneDictionary: TypeAlias = dict[str, Any]
"""A scene, or a part of one, as ``mi.load_dict`` takes it."""

JitFloat: TypeAlias = Any
"""``mi.Float``: a number for each lane."""

JitIndex: TypeAlias = Any
"""``mi.UInt32`` or ``mi.Int32``: a whole number for each lane."""

JitMask: TypeAlias = Any
"""``mi.Mask``: true or false for each lane."""

JitVector: TypeAlias = Any
"""``mi.Point3f``, ``mi.Vector3f`` or ``mi.Color3f``: three numbers for each lane."""

JitMatrix: TypeAlias = Any
"""``mi.Matrix3f``: a matrix for each lane."""

JitRay: TypeAlias = Any
"""``mi.Ray3f``: a ray for each lane."""

JitTensor: TypeAlias = Any
"""``mi.TensorXf``: an array with a shape."""

TensorLike: TypeAlias = Any
"""What ``mi.TensorXf`` can be made of: one of Dr.Jit's arrays, which stays attached, or anything that NumPy takes."""

JitArray: TypeAlias = Any
"""Any of Dr.Jit's arrays, or the class of one."""
