"""Renders the scenes of the native renderer on Dr.Jit, with derivatives.

The native renderer is compared with it, and gradients by the scene are computed with it.
"""
