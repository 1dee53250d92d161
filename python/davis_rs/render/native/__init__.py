"""Renders diffuse triangles in the Rust core, without noise; see docs/rendering.md.

The corners of a tile decide for all rays between them, exactly: rounding is monotonic, so a linear function computed
at a tile's corners bounds what its rays compute. Tiles and single rays never disagree.
"""
