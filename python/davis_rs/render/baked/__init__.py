"""Irradiance on the surfaces of a diffuse scene, computed once by Mitsuba's path tracer and looked up afterwards."""
