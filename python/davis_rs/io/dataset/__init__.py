"""Writes and reads dataset folders in the layout of the public Event-Camera Dataset: written and read."""
