"""Mitsuba's own integrators, for every scene, with noise."""
