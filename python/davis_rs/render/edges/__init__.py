"""Pixels that an occlusion edge may pass between two instants."""
