"""Says in words what the ``meta.json`` of a dataset folder holds."""

from __future__ import annotations

from dataclasses import dataclass

from .._util.array_types import JsonObject
from ..io.dataset.reader import Dataset
from ..simulation.model_version import MODEL

_PARTING = {"leak_rate_hz", "shot_noise_rms", "refractory_period_us"}
"""Effects after which pixels do not come back to their first references together."""


@dataclass(frozen=True)
class DatasetDescription:
    """Each is None where ``meta.json`` does not say it.

    Attributes:
        scene: the scene's name.
        threshold: C, or C of ON and of OFF events, such as ``C = 0.15``.
        effects: names of the effects, and of the classes of the user's own; empty for ideal pixels.
        noise: share of events that Monte Carlo noise makes missing or spurious, as estimated before the run; None also
            where nothing was drawn at random.
        version: of davis_rs that made it.
        aligned_start: the pixels' references all lie at the first frame's log intensity, without noise that would part
            them.
        model: by which its events were made, see :data:`~davis_rs.simulation.model_version.MODEL`.
    """

    scene: str | None
    threshold: str | None
    effects: tuple[str, ...] | None
    noise: float | None = None
    version: str | None = None
    aligned_start: bool = False
    model: int | None = None

    @property
    def of_another_model(self) -> bool:
        """Whether today's model would make other events."""
        return self.model not in (None, MODEL)

    @property
    def made_by(self) -> str | None:
        """Version and model, and what another model than today's means."""
        if self.model is None:
            return None
        made = f"davis_rs {self.version}, model {self.model}"
        if not self.of_another_model:
            return made
        return f"{made}; today's is {MODEL}: counts of events may differ, see CHANGELOG.md"


def describe_dataset(dataset: Dataset) -> DatasetDescription:
    """Read what the ``meta.json`` of a dataset says of its scene, its sensor, its noise, and of what made it.

    Raises:
        OSError, DecodeError: if ``meta.json`` cannot be read.
    """
    meta = dataset.meta
    scene, parameters, effects = meta.get("scene"), meta.get("parameters"), meta.get("effects")
    threshold = None
    if isinstance(parameters, dict) and "contrast_threshold" in parameters:
        on, off = parameters["contrast_threshold"], parameters.get("contrast_threshold_off")
        if on is not None:  # a dataset's are numbers or null
            threshold = f"C = {on:.4g}" if off in (None, on) else f"C = {on:.4g} ON, {off:.4g} OFF"
    own = (str(one.get("class")).rpartition(":")[2] for one in custom_effects(meta))
    version = meta.get("davis_rs")
    return DatasetDescription(
        scene=str(scene["name"]) if isinstance(scene, dict) and "name" in scene else None,
        threshold=threshold,
        effects=(*effects, *own) if isinstance(effects, dict) else None,
        noise=(meta.get("monte_carlo_noise") or {}).get("share"),
        version=version,
        aligned_start=isinstance(parameters, dict)
        and parameters.get("start_phase") == "zero"
        and isinstance(effects, dict)
        and _PARTING.isdisjoint(effects),
        model=None if version is None else (meta.get("model") or 1),
    )


def custom_effects(meta: JsonObject) -> list[JsonObject]:
    """Return what ``meta.json`` says of each effect of the user's own."""
    listed = meta.get("custom_effects")
    return [one for one in listed if isinstance(one, dict)] if isinstance(listed, list) else []
