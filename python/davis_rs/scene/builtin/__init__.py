"""Scenes that are made in code: planes, walls, a fence, a checkerboard, images that move."""
