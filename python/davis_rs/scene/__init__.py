"""Describes what to render: scenes, what they are made of, and those that are built in.

``load`` finds a scene by its name or file. ``scene`` is the class, ``light_profile``, ``steered_profile`` and
``textures`` are parts of it, ``meshes`` makes shapes under the variant that loads the scene, ``texture_file`` reads
images of textures, ``image_textures`` makes Mitsuba's textures of them. ``deformation`` says how meshes deform: by
joints and morph targets (``skinned_mesh``), or by ``vertex_keyframes``. ``principled`` knows how rough that material of
Mitsuba's is. ``files`` reads scenes, ``builtin`` and ``sequences`` make them. ``default_paths`` are camera paths for
files without one, ``default_motion`` moves a camera that is at rest in its file. ``lost_looks`` notes which looks of a
file are not shown, ``repairs`` what was repaired or left out.

A scene owns its camera path: ``with_trajectory`` and ``crop`` give the scene with another one, and what moves and
flickers in it keeps step. A built-in scene moves a file's trajectory to its own start, because the two share no
world.
"""
