"""What the ``meta.json`` of a dataset folder says of it, in words."""

from __future__ import annotations

from dataclasses import dataclass

from ..dataset.reader import Dataset


@dataclass(frozen=True)
class DatasetDescription:
    """Each is None where ``meta.json`` does not say it.

    Attributes:
        scene: the scene's name.
        threshold: C, or C of ON and of OFF events, such as ``C = 0.15``.
        effects: names of the effects; empty for ideal pixels.
    """

    scene: str | None
    threshold: str | None
    effects: tuple[str, ...] | None


def describe_dataset(dataset: Dataset) -> DatasetDescription:
    """Read the scene, the contrast threshold and the effects of a dataset.

    Raises:
        OSError, DecodeError: if ``meta.json`` cannot be read.
    """
    meta = dataset.meta
    scene, parameters, effects = meta.get("scene"), meta.get("parameters"), meta.get("effects")
    threshold = None
    if isinstance(parameters, dict) and "contrast_threshold" in parameters:
        on, off = parameters["contrast_threshold"], parameters.get("contrast_threshold_off")
        threshold = f"C = {on:g}" if off in (None, on) else f"C = {on:g} ON, {off:g} OFF"
    return DatasetDescription(
        scene=str(scene["name"]) if isinstance(scene, dict) and "name" in scene else None,
        threshold=threshold,
        effects=tuple(effects) if isinstance(effects, dict) else None,
    )
