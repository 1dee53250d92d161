"""Event files: one module a format behind one interface (`interface`), listed in one place (`registry`)."""

from .aedat4 import Aedat4Format
from .bag import BagFormat
from .dsec import DsecFormat
from .e2vid import E2vidFormat
from .evt import EVT2, EVT3
from .interface import EventReader, EventWriter, Format, Limits, TruncatedFileWarning, WriteReport
from .mvsec import MvsecFormat
from .npy import NpyFormat
from .npz import NpzFormat
from .parquet import ParquetFormat
from .recorded import AEDAT2, AEDAT3, CAMERA_BYTES
from .registry import FORMATS, register
from .ros2 import Ros2Format
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
register(
    EVT3,
    EVT2,
    Aedat4Format(),
    NpyFormat(),
    NpzFormat(),
    DsecFormat(),
    E2vidFormat(),
    MvsecFormat(),
    ParquetFormat(),
    BagFormat(),
    Ros2Format(),
    AEDAT2,
    AEDAT3,
    CAMERA_BYTES,
    TextFormat(),
)
