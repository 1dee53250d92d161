"""Renders scenes: renderers behind one interface, and the choice between them.

``base`` is the interface (:class:`~davis_rs.render.base.Renderer`), ``choice`` takes the first renderer that can
render a scene. A renderer refuses a scene with all ``obstacles``, each with its remedy. ``diffuse_materials`` knows
which materials are diffuse, or may be taken so. A ``finish`` says how a glossy one reflects, and ``finishes`` reads it.
``texels`` looks bitmaps up as Mitsuba does, ``number_textures`` reads those of one number. ``beam_lights`` reads spots
and projectors. ``scene_cache`` keeps what was made of a scene.

- ``native`` (the Rust core) and ``table`` (Dr.Jit, with derivatives) take the same ``scene_tables``: diffuse
  triangles under direct light, without noise; the native one also glossy ones. ``auto`` prefers it, because it is
  faster and needs no LLVM.
- ``baked`` computes light beforehand, which the native renderer looks up.
- ``integrator``: Mitsuba's own, for every scene, with noise.
- What they share: ``rays``, ``motion`` (what moves and flickers), ``edges`` (pixels that an occlusion edge passes),
  ``flow``. ``truth`` says which surfaces pixels see; its tables are of its own, so that they do not depend on the
  renderer.

A pose has the same bits in any batch: pixels are padded to whole ray packets, and rays are added in a fixed order.
"""
