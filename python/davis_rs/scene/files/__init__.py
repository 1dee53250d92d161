"""Reads scenes from files: OBJ, PLY, glTF and their materials, checked before Mitsuba sees them.

``mesh_scene`` (meshes) -> ``obj_file`` -> ``mtl_file``, ``ply_file`` -> ``triangulation``, ``rounding``;
``gltf_scene`` -> ``gltf_mesh`` -> ``gltf_materials``, ``gltf_nodes`` (transforms, animation), ``gltf_lights`` ->
``gltf_file`` (numbers and images); ``texture_folder``; ``alpha_mask`` -> ``outlines``; ``colour_alpha``.
``default_view`` looks for a room to stand in, or goes around: by ``subject`` (what decides), ``rooms`` (places) and
``sight`` (how much is seen).

Mitsuba's own plug-ins ignore OBJ's materials and trust PLY's indices, so meshes are read here. Colours of vertices
become a texture of 2 x 2 texels a triangle, which is linear between them. glTF is read here, too: trimesh knows neither
animations nor lights, and pygltflib takes 0.2 ms for each object of the JSON and checks nothing. Every index, size and
offset is checked. A scene's file, its buffers, images, materials, accessors and keyframes charge one budget before
they take memory. Texels stay as encoded; ``image_textures`` makes Mitsuba's textures of them, or stand-ins.
"""
