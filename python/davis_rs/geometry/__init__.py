"""Where a camera is and how it sees: poses, paths, lenses, and the lattice of rays in a pixel."""
