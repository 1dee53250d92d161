"""Makes a scene of a glTF file: meshes, materials, lights, and what its animations move.

Source: Khronos Group, glTF 2.0 Specification (ISO/IEC 12113:2022), and its extension KHR_lights_punctual.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..._mitsuba.types import SceneDictionary
from ..._util.quantities import metres
from ..._util.untrusted import decoding
from ...geometry.camera import Camera
from ...geometry.pose import FloatArray, Pose
from ...geometry.trajectory.trajectory import SegmentTrajectory, Trajectory
from ..default_paths import CAMERA, DEFAULT_DURATION_S
from ..deformation import Deformation, DeformedMesh
from ..image_textures import ImageTextures
from ..keyframes import Track
from ..lost_looks import TRANSPARENCY, LostLook, lost_looks, shown
from ..mesh_part import MeshPart
from ..parts import DIRECT, GLOSSY_DIRECT
from ..repairs import Repairs
from ..scene import Scene
from ..skinned_mesh import SkinnedMesh
from .alpha_mask import masked
from .default_view import default_view
from .gltf_file import GltfFile, Item, plain, unknown
from .gltf_lights import LUMENS_PER_WATT, lights_of, unit_of
from .gltf_materials import GltfMaterials
from .gltf_mesh import COLOURS_LOST, GltfMeshes, Primitive, PrimitiveKind, Vertices, joined, joined_vertices
from .gltf_nodes import NodeTree, NotRigid, breaks
from .gltf_poses import Node
from .mesh_scene import Axis, check_axis_and_scale, mitsuba_shape, to_z_up, usual_light
from .painted_texture import charge, is_painted, patches_of
from .rounding import ROUNDING
from .triangulation import has_area

WHITE_LUX = LUMENS_PER_WATT * np.pi
"""Illuminance of a white surface of luma 1 under such lights."""

_WIDTH = 240
_MOST_JOINTS = 10_000
_MOST_FORMS = 64
"""So many keyframes, or a few less, are looked at for the one at which a mesh that is hidden at first is largest."""
_JOINT_BYTES = 1 << 16
"""About what a joint takes while a batch of instants is computed."""
_VERTEX_BYTES = 400
"""About what a vertex that deforms takes, besides its morph targets."""
_FLIP = np.array([1.0, -1.0, -1.0])
"""glTF's cameras look along -z, and their y points up."""


def gltf_scene(
    path: str | Path,
    *,
    up: Axis | None = None,
    scale: float = 1.0,
    animation: str | None = None,
    grey_unknown: bool = False,
) -> Scene:
    """Return a glTF 2.0 file (.gltf, .glb) as a scene.

    Surfaces are seen from the front alone where they are not ``doubleSided`` (:attr:`Scene.one_sided`). Where an alpha
    masks them, they are cut along its outline; where it is soft, they blend. Base colours and their textures are taken,
    with ``KHR_texture_transform``, or the diffuse ones of ``KHR_materials_pbrSpecularGlossiness``, or the colours of
    vertices. Surfaces with metal, or with a roughness of at most 0.7, reflect by the metallic-roughness model; others
    are diffuse. They emit what ``emissiveFactor``, its texture and ``KHR_materials_emissive_strength`` say, 1 as one
    unit of radiance. Lights of ``KHR_lights_punctual`` shine, 683 lux or candela as one unit. Where that would leave
    the world dark, they are made stronger. A file without any gets those of a mesh file. The first perspective camera
    gives the lens and the path: that of its animation, or one at rest where other things move. A file without a camera
    gets the path around of a mesh file. Nodes that are animated are moving objects with the ids ``NODE_MATERIAL``; all
    others are one shape for each material, ``mesh_MATERIAL``.
    Meshes with a skin, with morph targets, or with an animated scale deform (:attr:`Scene.deformations`). Copies of a
    mesh (``EXT_mesh_gpu_instancing``) are all there. Looks that are not shown (clear coats, occlusion maps) are in
    :attr:`Scene.lost_looks`, of which a simulator warns.

    Args:
        up: the file's axis that points up; None: y, as glTF says.
        scale: metres in the file's unit; glTF's is the metre.
        animation: the name of the animation that is played (``animation_1`` for the second one without a name). None:
            all of them together, or the first where two move the same node; the scene's note tells.
        grey_unknown: colours whose textures are missing are grey; else the file is refused.

    Raises:
        OSError: if the file, or one that it names, cannot be read.
        DecodeError: naming the file and the place that breaks a rule, or has shapes that would be missing or in the
            wrong place, such as those of a compression that is not read.
        ValueError: for another axis or scale, or an animation that the file does not have.

    Warns:
        SceneFileWarning: in one line, of triangles that are left out, and of normals that are mended.
    """
    path = Path(path)
    check_axis_and_scale(up, scale)
    file = GltfFile(path)
    with decoding(path):
        return _GltfScene(file, up or "y", scale, animation, grey_unknown).scene()


class _Deformer(NamedTuple):
    """Holds what may deform the mesh of a node.

    Attributes:
        deforms: whether it has a skin, or morph targets in use; others deform only if their animation scales them.
        nodes: the joints of the skin; the node itself without one.
        inverse: (J, 4, 4), from the mesh's axes to those of each joint.
        strengths: of the morph targets.
        tracks: all that moves the mesh.
    """

    deforms: bool
    nodes: list[int]
    inverse: FloatArray
    strengths: Track
    tracks: list[Track]

    @property
    def moves(self) -> bool:
        """Whether an animation moves it, so that it has no form for good."""
        return any(len(track.times) > 1 for track in self.tracks)


class _GltfScene:
    """Builds a scene from a file."""

    def __init__(self, file: GltfFile, up: Axis, scale: float, animation: str | None, grey_unknown: bool) -> None:
        self.file, self.up, self.scale = file, up, scale
        self.repairs = Repairs(file.path)
        self.tree = NodeTree.of(file, self.repairs, animation)
        self.to_world = np.eye(4)
        self.to_world[:3, :3] = to_z_up(up) * scale
        self.materials = GltfMaterials(file, self.repairs, scale, grey_unknown=grey_unknown)
        self.meshes = GltfMeshes(file, self.materials, self.repairs)
        self.shown: set[int | None] = set()
        self.lost = {what: dict(names) for what, names in self.tree.lost.items()}

    def scene(self) -> Scene:
        """Build the scene."""
        shapes, objects, deformations = self._shapes()
        corners = self._corners(shapes, objects)
        if not len(corners):
            left_out = f" ({self.repairs})" if self.repairs else ""
            raise self.file.error("scene", f"it has no triangles: there is nothing that a camera could see{left_out}")
        low, high = corners.min(0), corners.max(0)
        if not (high > low).sum() >= 2:
            raise self.file.error("scene", "it has no area: all its vertices lie on a point or a line along an axis")
        lights = lights_of(self.file, self.tree, self.to_world, self._lose)
        camera, start, trajectory, of_camera = self._camera()
        default_duration_s: float | None = None
        view = None
        if camera is None:
            counts = [len(part.corners) for part in shapes.values()]
            view = default_view(
                corners.reshape(-1, 3, 3),
                np.repeat(np.arange(len(counts)), counts),
                np.repeat([part.one_sided for part in shapes.values()], counts),
                np.repeat([part.glass is not None for part in shapes.values()], counts),
            )
            camera, trajectory, of_camera = CAMERA, view.trajectory, of_camera.format(view.note)
            default_duration_s = DEFAULT_DURATION_S
        shapes = {name: part.rounded() for name, part in shapes.items()}
        self.repairs.warn()
        for name in map(str, self.file.document.extensionsUsed or []):
            if unknown(name):
                self._lose("what unknown extensions say", plain(name)[1:-1])
        unit = unit_of(lights, corners.reshape(-1, 3, 3)) if lights else 1.0
        names = _UniqueNames()
        described = {names.unused(f"light_{light.name}"): light.described(unit) for light in lights}
        described = described or usual_light(view)
        x, y, z = map(metres, high - low)
        size = f"{x} x {y} wide and {z} high, at {self.scale:g} m to a unit and with axis {self.up} up"
        if view is not None:
            size += view.unit_question(self.file.path.stem, self.scale) + view.up_question(self.up)
        shining = f"no lights, so a {' and a '.join(usual_light(view))}"
        if lights:
            shining = f"{_counted(len(lights), 'light')}, {_unit_told(unit)}"
        file_name = self.file.path.name
        glossy = any(part.metal is not None for part in shapes.values())

        def source() -> SceneDictionary:
            textures = ImageTextures()
            return {
                "type": "scene",
                "integrator": GLOSSY_DIRECT if glossy else DIRECT,
                **described,
                **{name: mitsuba_shape(part, textures) for name, part in shapes.items()},
            }

        return Scene(
            name=self.file.path.stem,
            source=source,
            file=self.file.path,
            files=tuple(self.file.files),
            camera=camera,
            start=start,
            trajectory=trajectory,
            default_duration_s=default_duration_s,
            objects=objects,
            deformations=deformations,
            reflections=True,
            soft_light=True,
            lux_per_luma=WHITE_LUX if unit == LUMENS_PER_WATT else 1000.0,
            note=f"{file_name} is {size}; {shining}; {of_camera}; {_moving(objects, deformations)}{self._animations()}",
            one_sided=tuple(name for name, part in shapes.items() if part.one_sided),
            lost_looks=(*lost_looks(shapes), *(LostLook(what, tuple(of)) for what, of in self.lost.items())),
        )

    def _animations(self) -> str:
        """Say which animation is played, where others are not."""
        tree = self.tree
        if not tree.others:
            return ""
        count = len(tree.played) + len(tree.others)
        return f"; of {count} animations {', '.join(tree.played)} is played, not {shown(tree.others)} (--animation)"

    def _shapes(self) -> tuple[dict[str, MeshPart], dict[str, Trajectory], dict[str, Deformation]]:
        """Return all parts by their ids, the paths of those that move, which are in their own axes, and how meshes
        deform."""
        at_rest: dict[PrimitiveKind, list[Primitive]] = {}
        moving: list[tuple[Node, list[Primitive], Trajectory]] = []
        deforming: list[tuple[Node, _Deformer]] = []
        start = np.zeros(1)
        for node in self.tree.nodes.values():
            if node.item.mesh is None:
                continue
            deformer = self._deformer(node)
            if deformer.deforms and not deformer.moves:
                for primitive in self._formed(node, deformer):
                    at_rest.setdefault(primitive.kind, []).append(primitive)
                continue
            if deformer.deforms:
                deforming.append((node, deformer))
                continue
            copies = self.tree.instances(node.index)
            if not self.tree.moves(node.index):
                matrices = self.to_world @ self.tree.matrices(node.index, start)[0] @ copies
                for primitive in self.meshes.of(node.item, f"nodes[{node.index}]", len(copies)):
                    at_rest.setdefault(primitive.kind, []).append(primitive.placed(matrices))
                continue
            try:
                trajectory, stretch = self.tree.path(node.index, self.to_world, np.ones(3), self.tree.duration_s)
            except NotRigid:
                deforming.append((node, deformer))
                continue
            own = np.eye(4)
            own[:3, :3] = stretch
            primitives = self.meshes.of(node.item, f"nodes[{node.index}]", len(copies))
            moving.append((node, [primitive.placed(own @ copies) for primitive in primitives], trajectory))
        shapes: dict[str, MeshPart] = {}
        objects: dict[str, Trajectory] = {}
        deformations: dict[str, Deformation] = {}
        names = _UniqueNames()
        for primitives in at_rest.values():
            part = self._part(primitives)
            shapes[names.unused(f"mesh_{part.material}")] = part
        for node, primitives, trajectory in moving:
            for alike in _by_kind(primitives):
                part = self._part(alike)
                name = names.unused(f"{node.name}_{part.material}")
                shapes[name], objects[name] = part, trajectory
        for node, deformer in deforming:
            for part, deformation in self._deformed(node, deformer):
                name = names.unused(f"{node.name}_{part.material}")
                shapes[name], deformations[name] = part, deformation
        shapes = {name: part for name, part in shapes.items() if len(part.corners)}
        return (
            shapes,
            {name: path for name, path in objects.items() if name in shapes},
            {name: deformation for name, deformation in deformations.items() if name in shapes},
        )

    def _deformer(self, node: Node) -> _Deformer:
        """Return what may deform a node's mesh."""
        where, tree = f"nodes[{node.index}]", self.tree
        strengths = tree.strengths(node.index, self.meshes.morph_strengths(node.item, where))
        deforms = node.item.skin is not None or bool((np.abs(strengths.values) > ROUNDING).any())
        nodes, inverse = [node.index], np.eye(4)[None]
        if node.item.skin is not None:
            nodes, inverse = self._joints(node.item.skin, where)
        tracks = [strengths, *(placing for index in nodes for placing in tree.tracks_of(index))]
        return _Deformer(deforms, nodes, inverse, strengths, tracks)

    def _deforming_parts(self, node: Node, deformer: _Deformer) -> list[Primitive]:
        """Return the primitives of a node that deforms, with their vertices."""
        where = f"nodes[{node.index}]"
        if len(self.tree.instances(node.index)) > 1:
            raise self.file.error(where, "has copies, and deforms, which is not read: export the copies as nodes")
        joints = 0 if node.item.skin is None else len(deformer.nodes)
        return self.meshes.deforming(node.item, where, joints)

    def _deformed(self, node: Node, deformer: _Deformer) -> Iterator[tuple[MeshPart, Deformation]]:
        """Yield the parts of a node that deforms, as they are once they can be seen, and what deforms each."""
        for alike in _by_kind(self._deforming_parts(node, deformer)):
            skinned, mirrored = self._skinned(node, deformer, joined_vertices(alike))
            corners, normals = _when_seen(skinned)
            if not has_area(corners).any():
                self.repairs.add("meshes that always are scaled to nothing are left out", 1, f"nodes[{node.index}]")
                continue
            # Pieces of triangles would not follow a skin as the triangles do.
            part = self._part(alike, whole=True, mirrored=mirrored)
            if self.materials[alike[0].material].mask is not None:
                part = part._replace(lost=(*part.lost, TRANSPARENCY))
            yield part._replace(corners=corners, normals=normals), skinned

    def _formed(self, node: Node, deformer: _Deformer) -> Iterator[Primitive]:
        """Yield the primitives of a node whose skin and morph targets give it a form for good, in the world."""
        for primitive in self._deforming_parts(node, deformer):
            skinned, mirrored = self._skinned(node, deformer, joined_vertices([primitive]))
            corners, normals = _form(skinned, 0.0)
            turn = slice(None, None, -1 if mirrored else 1)
            yield primitive._replace(
                corners=corners,
                normals=normals,
                uv=None if primitive.uv is None else primitive.uv[:, turn],
                colours=None if primitive.colours is None else primitive.colours[:, turn],
                vertices=None,
            )

    def _skinned(self, node: Node, deformer: _Deformer, vertices: Vertices) -> tuple[SkinnedMesh, bool]:
        """Return what deforms vertices of a node, and whether it turns their triangles over."""
        tree, count = self.tree, len(vertices.targets)
        self.file.budget.take(_VERTEX_BYTES * len(vertices.positions), f"nodes[{node.index}]: vertices that deform")
        duration_s = tree.duration_s or 1.0

        def matrices(t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
            matrix, rate = tree.matrices_of(deformer.nodes, t_s)
            return self.to_world @ matrix @ deformer.inverse, self.to_world @ rate @ deformer.inverse

        def strengths(t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
            values, rates = deformer.strengths.at(t_s, tree.duration_s)
            return values[:, :count], rates[:, :count]

        skinned = SkinnedMesh(
            rest=DeformedMesh(vertices.positions, vertices.normals),
            vertices=vertices.faces.ravel(),
            joint_count=len(deformer.nodes),
            joints=vertices.joints,
            weights=vertices.weights,
            matrices=matrices,
            targets=vertices.targets,
            target_normals=vertices.target_normals,
            strengths=strengths,
            most=deformer.strengths.largest()[:count],
            duration_s=duration_s,
            breaks=breaks(deformer.tracks, duration_s),
            name=node.name,
        )
        mirrored = skinned.is_mirrored()
        return skinned.turned() if mirrored else skinned, mirrored

    def _joints(self, index: object, where: str) -> tuple[list[int], FloatArray]:
        """Return the nodes of a skin's joints, and the inverses (J, 4, 4) of where they were bound."""
        skin = self.file.item("skins", index, f"{where}.skin")
        joints = skin.joints if isinstance(skin.joints, list) else []
        if not 0 < len(joints) <= _MOST_JOINTS:
            raise self.file.error(f"skins[{index}]", f"must have 1 to {_MOST_JOINTS} joints, got {len(joints)}")
        for joint in joints:
            if joint not in self.tree.nodes:
                raise self.file.error(f"skins[{index}]", f"its joint {plain(joint)} is no node of the scene")
        inverse = np.tile(np.eye(4), (len(joints), 1, 1))
        if skin.inverseBindMatrices is not None:
            given = self.file.array(skin.inverseBindMatrices, f"skins[{index}].inverseBindMatrices", width=(16,))
            if len(given) != len(joints):
                raise self.file.error(f"skins[{index}]", f"has {len(given)} matrices for {len(joints)} joints")
            inverse = np.asarray(given, np.float64).reshape(-1, 4, 4).swapaxes(1, 2)
        self.file.budget.take(_JOINT_BYTES * len(joints), f"skins[{index}]: {len(joints)} joints")
        return joints, inverse

    def _part(self, primitives: list[Primitive], *, whole: bool = False, mirrored: bool = False) -> MeshPart:
        """Join primitives to a part: what the mask of their material shows of them, or the ``whole``. Where they are
        ``mirrored``, it is turned over.

        Colours of its vertices that would need too large a texture are left out.
        """
        index = primitives[0].material
        material = self.materials[index]
        if index in self.shown:
            self.materials.charge(material, f"one more shape of the material {material.name}")
        self.shown.add(index)
        part = masked(joined(primitives, material), None if whole else material.mask, self.file.budget)
        part = part.turned() if mirrored else part
        if not is_painted(part):
            return part
        patches = patches_of(part)
        if patches is None:
            return part._replace(colours=None, lost=(*part.lost, COLOURS_LOST))
        charge(part, patches, self.file.budget)
        return part._replace(patches=patches)

    def _corners(self, shapes: dict[str, MeshPart], objects: dict[str, Trajectory]) -> FloatArray:
        """Return all corners (n, 3) in the world at the start."""
        corners_of = [np.empty((0, 3))]
        for name, part in shapes.items():
            corners = part.corners.reshape(-1, 3)
            if name in objects:
                pose = objects[name].pose(0.0)
                corners = corners @ pose.rotation.T + pose.position
            corners_of.append(corners)
        return np.concatenate(corners_of)

    def _camera(self) -> tuple[Camera | None, Pose | None, Trajectory | None, str]:
        """Return lens, start, path and a note about them; an animated camera comes before others."""
        seen = [node for node in self.tree.nodes.values() if node.item.camera is not None]
        cameras = [(node, self.file.item("cameras", node.item.camera, f"nodes[{node.index}].camera")) for node in seen]
        usable = [(node, camera) for node, camera in cameras if camera.type == "perspective"]
        usable.sort(key=lambda pair: not self.tree.moves(pair[0].index))
        taken = usable[0][0] if usable else None
        others = tuple(node.name for node, _ in cameras if node is not taken)
        unused = f"; not taken: the camera{'s' if len(others) > 1 else ''} {shown(others)}" if others else ""
        if taken is None:
            which = "no camera that is perspective" if others else "no camera"
            return None, None, None, f"{which}, so {{}}{unused}"
        node, camera = usable[0]
        lens = self._lens(camera.perspective, f"cameras[{node.item.camera}]")
        duration_s = self.tree.duration_s
        trajectory, _ = self.tree.path(node.index, self.to_world, _FLIP, duration_s or 1.0)
        start = trajectory.pose(0.0)
        size = f"the camera {node.name}, {lens.width} x {lens.height} px"
        if duration_s == 0:
            return lens, start, None, f"{size}, at rest{unused}"
        if not self.tree.moves(node.index):
            trajectory = SegmentTrajectory(start, start, duration_s)
            return lens, start, trajectory, f"{size}, at rest for {duration_s:.4g} s{unused}"
        return lens, start, trajectory, f"{size}, moves for {duration_s:.4g} s{unused}"

    def _lens(self, perspective: Item | None, where: str) -> Camera:
        """Return a lens 240 pixels wide, and as high as the file's aspect ratio says, or 180 without one."""
        if perspective is None:
            raise self.file.error(where, "has no perspective")
        angle = self.file.numbers(perspective.yfov, f"{where}.yfov", 1, low=1e-3, high=np.pi - 1e-3)[0]
        given = perspective.aspectRatio
        aspect = 4 / 3 if given is None else self.file.numbers(given, f"{where}.aspectRatio", 1, low=0.1, high=10)[0]
        height = max(1, round(_WIDTH / aspect))
        focal = _WIDTH / (2 * aspect * np.tan(angle / 2))
        return Camera(_WIDTH, height, focal, focal, (_WIDTH - 1) / 2, (height - 1) / 2)

    def _lose(self, look: str, name: str) -> None:
        """Note that the look ``look`` of ``name`` is not shown."""
        self.lost.setdefault(look, {})[name] = None


def _form(deformation: Deformation, t_s: float) -> tuple[FloatArray, FloatArray | None]:
    """Return the corners (m, 3, 3) of the triangles of a mesh at a time, and the normals there."""
    (form,) = deformation.meshes(np.array([t_s]))
    normals = None if form.normals is None else form.normals.reshape(-1, 3, 3)
    return form.positions.reshape(-1, 3, 3), normals


def _when_seen(deformation: Deformation) -> tuple[FloatArray, FloatArray | None]:
    """Return the form of a mesh at time 0. If a scale of 0 hides it then, return that of the keyframe at which it is
    largest."""
    first = _form(deformation, 0.0)
    if has_area(first[0]).any():
        return first
    times = np.append(deformation.breaks_s(), deformation.duration_s)
    forms = [_form(deformation, t_s) for t_s in times[:: -(-len(times) // _MOST_FORMS)].tolist()]
    return max(forms, key=lambda form: float(np.ptp(form[0].reshape(-1, 3), axis=0).sum()))


def _by_kind(primitives: list[Primitive]) -> Iterable[list[Primitive]]:
    """Return the primitives by what those of one shape have in common."""
    by_kind: dict[PrimitiveKind, list[Primitive]] = {}
    for primitive in primitives:
        by_kind.setdefault(primitive.kind, []).append(primitive)
    return by_kind.values()


def _moving(objects: dict[str, Trajectory], deformations: dict[str, Deformation]) -> str:
    moving = _counted(len({*objects, *deformations}), "moving object")
    return f"{moving}, of which {len(deformations)} deform{'s' * (len(deformations) == 1)}" if deformations else moving


def _unit_told(unit: float) -> str:
    """Say what one unit of linear light is in the numbers of the file's lights."""
    if unit == LUMENS_PER_WATT:
        return f"{unit:g} lux or candela as one unit"
    return "too dim for lux and candela, so a white surface has luma 1 where it is lit best"


def _counted(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


class _UniqueNames:
    """Makes the ids of shapes, or of lights: letters, digits and _, and no two alike."""

    def __init__(self) -> None:
        self._next: dict[str, int] = {}

    def unused(self, name: str) -> str:
        """Return an id like ``name`` that is not in use."""
        plain_name = re.sub(r"\W", "_", name)[:80]
        candidate, number = plain_name, self._next.get(plain_name, 1)
        while candidate in self._next:
            number += 1
            candidate = f"{plain_name}_{number}"
        self._next[plain_name] = number
        self._next.setdefault(candidate, 1)
        return candidate
