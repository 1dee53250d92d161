"""A scene as flat tables: what the native renderer and the table kernel take.

``scene_table`` -> ``scene_texture``, ``mesh_triangles``: a record for each triangle, and all texels in one buffer
for each light colour.
"""
