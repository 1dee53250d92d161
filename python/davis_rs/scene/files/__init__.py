"""Scenes from files: OBJ, PLY, glTF and their materials, checked before Mitsuba sees them."""
