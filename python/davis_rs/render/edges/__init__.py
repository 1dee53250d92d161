"""Finds pixels that an occlusion edge may pass between two instants.

``edge_tracks`` knows at which instant an edge passes each ray of the native renderer. ``swept`` and
``swept_objects`` bound from the geometry which pixels an edge may touch, for renderers that do not know their rays.
``neighbours`` finds the pixels that a blur or a lens needs.
"""
