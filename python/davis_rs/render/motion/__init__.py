"""Handles what moves and changes in a scene besides the camera.

``scene_motion`` describes the motion, ``scene_updates`` puts a loaded Mitsuba scene into its state at an instant,
``scene_scale`` scales a scene that is too small or too large for Mitsuba's rays.
"""
