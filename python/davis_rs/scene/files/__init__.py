"""Scenes from files: OBJ, PLY, glTF and their materials, checked before Mitsuba sees them.

``mesh_scene`` (meshes) -> ``obj_file`` -> ``mtl_file``, ``ply_file`` -> ``triangulation``, ``rounding``;
``gltf_scene`` -> ``gltf_mesh`` -> ``gltf_materials``, ``gltf_nodes`` (transforms, animation) -> ``gltf_file``
(numbers and images); ``texture_file``, ``texture_folder``.

Mitsuba's own plug-ins ignore OBJ's materials and trust PLY's indices, so meshes are read here. Colours of vertices
become a texture of 2 x 2 texels a triangle, which is linear between them. glTF's JSON is typed by pygltflib, which
checks nothing: every index, size and offset is checked here.
"""
