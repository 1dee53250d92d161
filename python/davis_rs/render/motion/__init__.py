"""What moves and changes in a scene besides the camera.

``scene_motion`` describes it, ``scene_updates`` puts a loaded Mitsuba scene into the state of an instant,
``scene_scale`` scales one that is too small or too large for Mitsuba's rays.
"""
