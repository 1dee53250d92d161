"""Event files: one module a format behind one interface (``interface``), listed in one place (``registry``).

``parts`` says what may stand next to events, ``core_files`` are the formats of the Rust core, ``recorded`` those
that are only read; ``ros_*`` is what ROS 1 and 2 share, ``hdf5_*`` what layouts of HDF5 share; ``reading`` has the
rules of all readers, ``files`` makes files.

A container is a format that holds parts: ``Format.holds`` names them, and conversion, its messages and the table of
docs/containers.md need no more. rosbag2 is written by rosbags and read by us, because its readers trust lengths,
refuse what a killed writer leaves, and unpack without a limit. There is no buffer across writes: a killed process
loses nothing that it has seen written.
"""

from .aedat4 import Aedat4Format
from .bag import BagFormat
from .destination import Limits
from .dsec import DsecFormat
from .e2vid import E2vidFormat
from .evt import EVT2, EVT3
from .interface import EventReader, EventWriter, Format, TruncatedFileWarning, WriteReport
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
