"""Reads and writes files: event formats, dataset folders and recordings of cameras.

``files`` (read, write, convert any of them) -> ``dataset`` (folders) -> ``formats`` (one module a format) ->
``recordings`` (of cameras, only read).
"""
