"""Makes windows of events as PyTorch data sets (extra ``torch``); imported only when it is asked for."""

from ..._util.extras import from_extra

with from_extra("torch"):
    import torch as _torch  # noqa: F401

from .collate import collate
from .event_dataset import EventDataset

__all__ = ["EventDataset", "collate"]
