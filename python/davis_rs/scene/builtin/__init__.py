"""Makes scenes in code: planes, walls, a fence, a checkerboard, images that move."""
