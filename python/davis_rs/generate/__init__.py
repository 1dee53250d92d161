"""Many sequences with randomised parameters, from a plan, by processes of this machine or of a cluster."""

from .generate import Generated, generate_sequences
from .sequence_plan import SequencePlan, load_sequence_plan
from .verify import verify_sequences

__all__ = ["Generated", "SequencePlan", "generate_sequences", "load_sequence_plan", "verify_sequences"]
