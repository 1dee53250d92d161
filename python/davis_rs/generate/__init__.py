"""Generates many sequences with randomised parameters from a plan, by processes of this machine or of a cluster.

``sequence_plan`` -> ``parse`` -> ``distributions``, ``motion``, ``random_scene`` -> ``kinds``; ``shards`` ->
``shard_formats`` -> ``sequence_arrays``; ``sequence`` (what is drawn) -> ``job`` -> ``folder``
(whole or not at all); ``generate`` -> ``local`` (processes), ``cluster`` (Dask), ``manifest``, ``verify``.

A worker is killed, never asked: a sequence's folder gets its name when it is whole, so SIGKILL, Ctrl-C and a lost
machine are one case.
"""

from .generate import Generated, generate_sequences
from .sequence_plan import SequencePlan, load_sequence_plan
from .verify import verify_sequences

__all__ = ["Generated", "SequencePlan", "generate_sequences", "load_sequence_plan", "verify_sequences"]
