"""Scenes that are made in code."""
