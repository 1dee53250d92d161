"""Irradiance on the surfaces of a diffuse scene, computed once and looked up afterwards; docs/light.md.

``baked_scene`` (from the cache or computed now) -> ``cache`` -> ``kept_arrays``, ``lights`` (what shines) -> ``bake``
-> ``irradiance`` (by the core's rays), ``light_maps`` (what it gives) -> ``surface_lattice`` (where); ``instants``
(when, where bodies move); ``partial`` (what a stopped bake leaves).

Light is baked on the meshes' own triangles, not in an atlas: points on common edges are common, so there are no
seams. Samples shift smoothly from place to place, so that errors are smooth and average out. Bounces are gathered
from maps of what surfaces reflect, which has far less noise than paths. Light of bodies that move is baked at
instants, each a light whose strength over time is a hat function: light adds, so the renderer has no other case
than lights that flicker.
"""
