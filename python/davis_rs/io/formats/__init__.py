"""Reads and writes event files: one module a format behind one interface (``interface``), listed in ``registry``.

``parts`` says what may stand next to events, ``core_files`` are the formats of the Rust core, ``recorded`` those
that are only read; ``ros_*`` is what ROS 1 and 2 share, ``hdf5_*`` what layouts of HDF5 share; ``reading`` has the
rules of all readers, ``destination`` says where a writer writes, and makes the files.

A container is a format that holds parts: ``Format.holds`` names them, and conversion, its messages and the table of
docs/containers.md need no more. rosbag2 is written by rosbags and read by us, because its readers trust lengths,
refuse what a killed writer leaves, and unpack without a limit. There is no buffer across writes: a killed process
loses nothing that it has seen written.

Some bytes are read here although a library could read them, because libraries abort or trust lengths. Judged were our
own code, the library alone, and the library in a child process with limits, whose start takes 0.5 to 0.9 s (the import
of pyarrow, h5py or rosbags; two shared cores) and which hands every event over once more:

- MCAP, 209 lines: ours. The library ``mcap`` takes 5 times as long for 200,000 messages (5.1 s, ours 1.0 s), reads
  nothing past the error where a killed writer's file ends, and unpacks a chunk of 2.2 MB to 512 MiB without a limit.
- Thrift and Parquet's footer, 237 lines: ours, before Arrow. The check takes 0.01 s of the 0.2 s in which two million
  events are read (0.8 of 1.7 s in 2,000 row groups). A child would be slower, and must stay alive for random access.
- SQLite, 166 lines: Python's ``sqlite3`` parses. What is ours are the questions, and what keeps a file from answering
  with programs or in circles.
- HDF5's chunks, 252 lines: h5py finds them, and ours unpack them within limits, at 28 million events a second.
- ROS 1, 232 lines: rosbags reads an index, within bounds of ours; a bag without an index is ours alone.
"""

from .aedat2 import AEDAT2
from .aedat4 import Aedat4Format
from .bag import BagFormat
from .destination import Destination, Limits
from .dsec import DsecFormat
from .e2vid import E2vidFormat
from .ecf import EcfFormat
from .evt import EVT2, EVT3, EVT21
from .interface import EventReader, EventWriter, Format, TruncatedFileWarning, WriteReport
from .mvsec import MvsecFormat
from .npy import NpyFormat
from .npz import NpzFormat
from .parquet import ParquetFormat
from .recorded import AEDAT3, CAMERA_BYTES
from .registry import FORMATS, register
from .ros2 import Ros2Format
from .text import TextFormat

__all__ = [
    "FORMATS",
    "Destination",
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
    EVT21,
    Aedat4Format(),
    NpyFormat(),
    NpzFormat(),
    DsecFormat(),
    E2vidFormat(),
    MvsecFormat(),
    EcfFormat(),
    ParquetFormat(),
    BagFormat(),
    Ros2Format(),
    AEDAT2,
    AEDAT3,
    CAMERA_BYTES,
    TextFormat(),
)
