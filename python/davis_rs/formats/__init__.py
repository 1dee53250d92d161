"""Event files: one module a format behind one interface (`interface`), listed in one place (`registry`)."""

from .interface import EventReader, EventWriter, Format, Limits, TruncatedFileWarning, WriteReport
from .registry import FORMATS, register
from .text import TextFormat

__all__ = [
    "FORMATS",
    "EventReader",
    "EventWriter",
    "Format",
    "Limits",
    "TruncatedFileWarning",
    "WriteReport",
]

# Text last: whatever begins with a number is one.
register(TextFormat())
