"""The table kernel on Dr.Jit: the same scenes as the native renderer, with derivatives."""
