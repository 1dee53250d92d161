"""The command line: davis-rs."""

from .main import main

__all__ = ["main"]
