"""Simulation: settings, what is decided from them, packets of events, and the folder that they are written to."""
