"""Makes synthetic counterparts of the 27 sequences of the public Event-Camera Dataset.

>>> from davis_rs.scene.sequences import SEQUENCES
>>> scene = SEQUENCES["poster_6dof"].scene()  # with lens, contrast threshold and trajectory

Source: Mueggler et al., "The Event-Camera Dataset and Simulator", IJRR 2017.
"""

from .sequence import PaperRow, Sequence
from .table import SEQUENCES, sequence_named

__all__ = ["SEQUENCES", "PaperRow", "Sequence", "sequence_named"]
