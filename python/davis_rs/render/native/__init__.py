"""The renderer in the Rust core: diffuse triangles, without noise; docs/rendering.md.

Corners of a tile decide for all rays between them, exactly: roundings are monotonic, so a linear function that is
computed at a tile's corners bounds what its rays compute. Tiles and single rays never disagree.
"""
