"""Rules of sampling in time: when to render, and how to interpolate between two renders."""
