"""Helpers that know nothing of cameras: checks and errors of arguments, files that appear when they are whole, progress."""
