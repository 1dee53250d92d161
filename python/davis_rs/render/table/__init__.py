"""The table kernel on Dr.Jit: the same scenes as the native renderer, with derivatives.

It stays as what the native renderer is compared with, and for derivatives.
"""
