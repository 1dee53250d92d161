"""Makes flat tables of a scene, for the native renderer and the table kernel.

``scene_table`` has a record for each triangle (from ``mesh_triangles``), and all texels in one buffer for each light
colour (from ``scene_texture``). What shapes emit is one more such buffer (``emissive_textures``), which constant light
shows.
"""
