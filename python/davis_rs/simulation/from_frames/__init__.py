"""Frames to events: video, image folders and arrays, seen by the pixels of an event camera."""
