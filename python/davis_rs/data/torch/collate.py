"""Joins samples to a batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch


def collate(samples: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Make a batch of samples of :class:`davis_rs.data.torch.EventDataset`, for ``DataLoader(collate_fn=...)``.

    Tensors of one shape are stacked along a new first axis; those of different shapes, such as the frames of windows
    with more or fewer of them, stay a list. Numbers become a tensor. Raw events are joined: the fields t, x, y, p of
    all samples one after the other, and ``"offsets"``, int64 (samples + 1,): sample k has events offsets[k] to
    offsets[k + 1] - 1.

    Raises:
        ValueError: if the samples do not have the same entries.
    """
    names = samples[0].keys()
    if any(sample.keys() != names for sample in samples):
        raise ValueError(f"samples of one batch must have the same entries: {[sorted(one) for one in samples]}")
    return {name: _joined([sample[name] for sample in samples]) for name in names}


def _joined(values: list[Any]) -> Any:
    first = values[0]
    if isinstance(first, dict):
        counts = torch.tensor([0, *(len(value["t"]) for value in values)], dtype=torch.int64)
        fields = {name: torch.cat([value[name] for value in values]) for name in first}
        return {**fields, "offsets": counts.cumsum(0)}
    if isinstance(first, torch.Tensor):
        alike = all(value.shape == first.shape for value in values)
        return torch.stack(values) if alike else values
    if isinstance(first, bool | int | float):
        return torch.tensor(values)
    return values
