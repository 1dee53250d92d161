"""Finds pixels that an occlusion edge may pass between two instants, where luma is a mean over rays.

``swept`` and ``swept_objects`` bound from the geometry which pixels an edge may touch. ``neighbours`` finds the pixels
that a blur or a lens needs.
"""
