"""Helpers that know nothing of cameras: arguments and their errors, files that appear when they are whole, progress."""
