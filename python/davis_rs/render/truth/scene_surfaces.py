"""Computes depth, shape, surface normal and optical flow of what pixels see, of frames and of single pixels."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._core import PixelRays, SceneRenderer
from ..._mitsuba.variants import SCALAR, load_scene_contents, variant
from ...events.packet import Displacement
from ...geometry.camera import Camera
from ...geometry.pose import FloatArray
from ...geometry.trajectory.views import Views
from ...scene.image_textures import stand_ins
from ...scene.scene import Scene
from ..baked.lights import hidden_shapes
from ..flow import OpticalFlow
from ..mesh_buffers import MeshBuffers
from ..motion.scene_motion import pose_arrays, seen_from
from ..primitives import triangulated
from ..rays.camera_rays import pixel_centres, pixel_rays, ray_table
from ..rays.shadow_rays import END, STEP, scene_centre
from ..scene_tables.deforming_meshes import DeformingMesh, DeformingMeshes
from ..scene_tables.mesh_triangles import MeshTriangles, triangles_of_shapes

_MOST_SHAPES = 65_535

_VISIBLE = 1e-3
"""Fraction of a point's depth by which, because of rounding, the point's own surface may seem to lie before it."""

Indices = npt.NDArray[np.int64]


class Surfaces(NamedTuple):
    """Holds the surfaces that rays hit, each array with one row per ray; the rays of a frame are its pixels' centres.

    Attributes:
        depth: float32 (m,), z along the optical axis, metres; inf where nothing is hit.
        shape: uint16 (m,), 1 for the first of :attr:`SceneSurfaces.names`; 0 where nothing is hit.
        normal: float32 (m, 3), unit, in camera axes (x right, y down, z ahead), on the side that is seen; interpolated
            where a mesh is smooth. NaN where nothing is hit.
        flow: float32 (m, 2), pixels per second (x right, y down): the motion in the image, through the lens, of the
            point that is hit, by the camera's motion and by its own. NaN where nothing is hit.
        back: bool (m,), whether the side is hit on which a triangle's corners run clockwise.
    """

    depth: npt.NDArray[np.float32]
    shape: npt.NDArray[np.uint16]
    normal: npt.NDArray[np.float32]
    flow: npt.NDArray[np.float32]
    back: npt.NDArray[np.bool_]


class SceneSurfaces:
    """Finds the surfaces of a scene as a camera's pixels see them, whatever their material and light.

    Args:
        scene: made of triangles alone.
        camera: its lens and size.
        culled: backs of :attr:`Scene.one_sided` are culled, as the native renderer does.
        threads: number of threads; None for all processors.

    Attributes:
        names: the ids of the scene's shapes; shape number 1 is the first.
        motion: what moves in the scene.

    Raises:
        ValueError: for a shape that is not made of triangles, more than 65,535 shapes, or a scene that cannot be
            loaded.
        OSError: if a scene file cannot be read.
    """

    def __init__(self, scene: Scene, camera: Camera, *, culled: bool = True, threads: int | None = None) -> None:
        self.camera = camera
        with variant(SCALAR) as (mi, _):
            with stand_ins():  # of the looks nothing counts here
                loaded = load_scene_contents(scene.source(), mi)
            loaded, self.motion, _, made = triangulated(scene, camera, loaded, mi)
            shapes = list(loaded.shapes())
            if len(shapes) > _MOST_SHAPES:
                raise ValueError(f"a map of shapes has {_MOST_SHAPES} at most, scene {scene.name!r} has {len(shapes)}")
            for shape in shapes:
                if not shape.is_mesh():
                    raise ValueError(
                        f"flow, masks, normals and truth at events need shapes made of triangles, but shape "
                        f"{shape.id()!r} of scene {scene.name!r} is a {shape.class_name()}"
                    )
            meshes = [MeshTriangles(MeshBuffers.of(shape)) for shape in shapes]
            # Which side a lamp shines from decides, not the order of its corners.
            turned = {number for number in made.null_lamps if meshes[number].is_turned(shapes[number], mi)}
            self.names = tuple(str(shape.id()) for shape in shapes)
            hidden = hidden_shapes(loaded)
        moving = list(self.motion.objects)
        numbers = [moving.index(name) + 1 if name in moving else 0 for name in self.names]
        counts = [mesh.count for mesh in meshes]
        # One more for rays that hit nothing.
        self._frame_of = np.append(np.repeat(np.array(numbers, np.uint32), counts), np.uint32(0))
        deforming = []
        for name, number, first, mesh in zip(self.names, numbers, np.cumsum([0, *counts]), meshes, strict=False):
            if name in self.motion.deformations:
                mesh.replace_flat()
                deforming.append(DeformingMesh(name, number, int(first), mesh.faces, None, 1.0))
        self._shape_of = np.append(np.repeat(np.arange(1, len(meshes) + 1), counts), 0).astype(np.uint16)
        self._normal_maps = np.concatenate([mesh.normal_maps()[0] for mesh in meshes])
        sides = [-1.0 if number in turned else 1.0 for number in range(len(meshes))]
        self._planes = np.concatenate([side * mesh.planes() for side, mesh in zip(sides, meshes, strict=True)])
        corners = np.concatenate([mesh.corners for mesh in meshes])
        count, frames = len(corners), self._frame_of[:-1]
        flat = np.zeros((count, 4))
        self._core = SceneRenderer(
            corners=corners.ravel(),
            planes=self._planes.ravel(),
            # Luma is not asked for: there is no light, and one texture of one texel.
            u_maps=flat.ravel(),
            v_maps=flat.ravel(),
            normal_maps=None,
            textures=np.zeros(count, np.uint32),
            two_sided=np.ones(count, np.uint32),
            culled=triangles_of_shapes(counts, made.one_sided(scene.one_sided if culled else ())),
            hidden=triangles_of_shapes(counts, hidden),
            frames=frames,
            frame_count=1 + len(moving),
            layouts=np.array([0, 1, 1, 0], np.int64),
            texels=[],
            lights=[],
            shadows=False,
            centre=scene_centre(corners[frames == 0].reshape(-1, 3)).tolist(),
            step=STEP,
            end=END,
            threads=threads,
        )
        self._deforming = DeformingMeshes(self._core, deforming, self.motion.deformations, self._planes)

    def frame(self, views: Views, number: int = 0) -> Surfaces:
        """Return what all pixels of one of the views see; arrays of H W rows."""
        view = views[number : number + 1]
        self._deforming.deform(view.t_s)
        cameras = self._cameras(view)
        depth, triangle = self._core.depth(self._pixel_rays, _arrays(cameras))
        pixel = np.arange(len(depth))
        return self._surfaces(cameras, np.zeros_like(pixel), pixel, depth, triangle)

    def of_pixels(self, views: Views, view: Indices, pixel: Indices) -> Surfaces:
        """Return what single pixels see.

        Args:
            view: (m,) which of the views.
            pixel: (m,) which pixel, y W + x.
        """
        parts, rows = zip(
            *(
                (self._hits(some, number, pixel[rows]), rows)
                for some, number, rows in self._deforming.batches(views, view)
            ),
            strict=True,
        )
        order = np.argsort(np.concatenate(rows))
        return Surfaces(*(np.concatenate(columns)[order] for columns in zip(*parts, strict=True)))

    def _hits(self, views: Views, view: Indices, pixel: Indices) -> Surfaces:
        """Return what single pixels see, the meshes being as they are."""
        cameras = self._cameras(views)
        depth, triangle = self._core.hits(
            self._pixel_rays, _arrays(cameras), view.astype(np.uint32), pixel.astype(np.uint32)
        )
        return self._surfaces(cameras, view, pixel, depth, triangle)

    def displacement(self, views: Views) -> Displacement:
        """Return how far the points seen by the first of two views move in the image until the second.

        Each point is followed with its surface: on a body that moves, with the body; on a mesh that deforms, with its
        triangle.
        """
        cameras = self._cameras(views)
        self._deforming.deform(views.t_s[:1])
        first = [camera[:1] for camera in cameras]
        depth, triangle = self._core.depth(self._pixel_rays, _arrays(first))
        triangle = np.minimum(triangle, len(self._frame_of) - 1)
        seen = np.isfinite(depth)
        points = self._rays * np.where(seen, depth, 1.0)[:, None]
        later = np.full((len(depth), 3), np.nan)
        for number, camera in enumerate(cameras):
            mine = seen & (self._frame_of[triangle] == number)
            point = points[mine] @ camera.rotations[0].T + camera.positions[0]
            point = self._deforming.followed(number, triangle[mine].astype(np.int64), point, views.t_s[1:])
            later[mine] = (point - camera.positions[1]) @ camera.rotations[1]
        ahead = seen & (later[:, 2] > 0)
        later[~ahead] = self._rays[~ahead]  # these rays are traced too, but not used
        ends = PixelRays(
            self.camera.width, self.camera.height, 1, (later[:, :2] / later[:, 2:]).astype(np.float32).ravel()
        )
        self._deforming.deform(views.t_s[1:])
        nearest, _ = self._core.depth(ends, _arrays([camera[1:] for camera in cameras]))
        pixels = np.full((len(depth), 2), np.nan, np.float32)
        pixels[ahead] = self.camera.project(later[ahead]) - self._centres[ahead]
        occluded = seen & (~ahead | (nearest < (1 - _VISIBLE) * later[:, 2]))
        shape = self.camera.height, self.camera.width
        return Displacement(pixels.reshape(*shape, 2), occluded.reshape(shape))

    def _surfaces(
        self,
        cameras: list[Views],
        view: Indices,
        pixel: Indices,
        depth: npt.NDArray[np.float32],
        triangle: npt.NDArray[np.uint32],
    ) -> Surfaces:
        triangle = np.minimum(triangle, len(self._frame_of) - 1)
        normal = np.full((len(depth), 3), np.nan, np.float32)
        flow = np.full((len(depth), 2), np.nan, np.float32)
        back = np.zeros(len(depth), bool)
        frame = self._frame_of[triangle]
        for number, camera in enumerate(cameras):
            rows = np.flatnonzero((frame == number) & np.isfinite(depth))
            if not len(rows):
                continue
            rays = self._rays[pixel[rows]]
            rotation = camera.rotations[view[rows]]
            point = np.einsum("mij,mj->mi", rotation, rays * depth[rows, None]) + camera.positions[view[rows]]
            of_mesh = self._deforming.normal_maps(number, triangle[rows].astype(np.int64))
            maps = self._normal_maps[triangle[rows]] if of_mesh is None else of_mesh
            own = np.einsum("mij,mj->mi", maps[..., :3], point) + maps[..., 3]
            # The plane decides which side is seen: at the rim of a smooth mesh the shading normal may point away.
            plane = self._deforming.planes[triangle[rows], :3]
            back[rows] = np.einsum("mi,mij,mj->m", plane, rotation, rays) > 0
            against = np.einsum("mi,mi->m", own, plane) < 0
            own *= np.where(back[rows] != against, -1, 1)[:, None] / np.linalg.norm(own, axis=1, keepdims=True)
            normal[rows] = np.einsum("mji,mj->mi", rotation, own)
            flow[rows] = self._flow.of_pixels(camera, view[rows], pixel[rows], depth[rows])
            if of_mesh is not None:
                own = self._deforming.velocities(number, triangle[rows].astype(np.int64), point)
                moving = np.einsum("mji,mj->mi", rotation, own)
                flow[rows] += self._flow.of_motion(pixel[rows], moving, depth[rows])
        return Surfaces(depth, self._shape_of[triangle], normal, flow, back)

    def _cameras(self, views: Views) -> list[Views]:
        """Return the cameras in the world, and in the frame of each moving object."""
        return [views, *(seen_from(views, poses) for poses in self.motion.at(views.t_s).objects)]

    @cached_property
    def _centres(self) -> FloatArray:
        return pixel_centres(self.camera)

    @cached_property
    def _rays(self) -> FloatArray:
        """Return the rays (H W, 3) in camera axes, with z = 1."""
        xy = ray_table(self.camera, 1)[0]
        return np.concatenate([xy, np.ones((len(xy), 1))], 1)

    @property
    def _pixel_rays(self) -> PixelRays:
        return pixel_rays(self.camera, 1)

    @cached_property
    def _flow(self) -> OpticalFlow:
        return OpticalFlow(self.camera, self._centres)


def _arrays(cameras: list[Views]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return views as the core takes them, without lights."""
    none = np.empty(0)
    return *pose_arrays(cameras), none, none
