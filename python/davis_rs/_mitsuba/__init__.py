"""Wraps Mitsuba 3: chooses its variant and LLVM, and checks files before it opens them.

``variants`` imports Mitsuba late and sets a variant for a block; ``llvm`` finds the library (named by the user, the
system's, or that of the Rust toolchain which built the package); ``types`` names Mitsuba's objects for signatures;
``scene_contents`` is a scene in which Mitsuba traces no rays.

An XML file becomes ``elements``; ``files`` puts included ones in their places, and refuses what would end the process
(of meshes, ``ply_mesh``).
Then the elements are written as Mitsuba 3 reads them: ``former_notation``, ``animated_transforms`` (which takes out
what moves), ``null_surfaces``, ``former_textures``, ``former_materials``, ``former_lights``, ``bright_reflectances``,
``grey_materials``.
``foreign_meshes`` writes meshes anew that Mitsuba 3 does not show, by ``ply_arrays``; ``lost_normals`` makes some flat.
``foreign_plugins`` has Mitsuba load the result; ``plugins`` says what it has.

Dr.Jit needs a libLLVM that wheels cannot bring. The toolchain of rustup has one that exports what Dr.Jit needs,
and ``rust/build.rs`` notes its path. The system's own library comes first.
"""
