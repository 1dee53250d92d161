"""The renderer in the Rust core: diffuse triangles, without noise."""
