"""Hands out events for training: windows over a stream, and datasets for PyTorch."""
