"""The command line: davis-rs.

``main`` has the list of commands and what becomes of errors. When a command is called, its module adds its options,
those of declared settings by ``settings_options``.
"""

from .main import main

__all__ = ["main"]
