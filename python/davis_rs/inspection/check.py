"""Checks a dataset folder: its structure, and its events against the rendered log intensity."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from .._core import DecodeError, log_intensity, reconstruct
from .._util.array_types import AnyArray, JsonObject
from .._util.terminal_text import printable
from ..events.arrays import EventArray
from ..geometry.pose import GroundTruth
from ..io.dataset.files import META, SIGNAL
from ..io.dataset.reader import Dataset
from ..io.dataset.text_folder import StampedImage
from ..sensor.effects import EFFECTS
from ..simulation.noise_estimate import share_text
from .dataset_description import custom_effects, describe_dataset

TOLERANCE = 1e-9
"""What the check itself may add to an error, in units of C: its sums and differences are made in float64."""

_SHOWN = 20

_VOIDING = {name for name, effect in EFFECTS.items() if effect.acts_on not in ("luma", "frames")}
"""Effects that make the check void. Optics are not among them, because they act before log intensity. Neither are
effects on frames, because they do not change events."""
_T = TypeVar("_T")


class InstantError(NamedTuple):
    """Says how far log intensity lies from what the events say, at one instant.

    ``largest`` is the largest size of L - R over the pixels, at pixel (``x``, ``y``), and ``mean`` the mean, both in
    units of the threshold on the error's side: C_on where L > R, C_off where L < R.
    """

    t_us: int
    largest: float
    mean: float
    x: int
    y: int


@dataclass
class CheckReport:
    """Reports what :func:`check_dataset` found; ``str()`` of it is a few lines for people.

    Attributes:
        path: the dataset folder.
        problems: one sentence each; empty where the check holds.
        counts: how many ``events``, ``frames``, ``depth_maps`` and ``luma_maps`` were found.
        instants: the comparison at each instant whose luma is stored, after the first.
        void: effects of the sensor under which events need not explain log intensity, so that nothing was compared.
        converted: whether the folder was converted from another container: it has no luma to compare with.
        noise: ratio of events that Monte Carlo noise makes missing or spurious, as the run estimated it; None where it
            did not. Rendered luma has the same noise, so no check can see it.
        made_by: the version and the model that made it, where that is not today's model.
    """

    path: Path
    problems: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    instants: list[InstantError] = field(default_factory=list)
    void: list[str] = field(default_factory=list)
    converted: bool = False
    noise: float | None = None
    made_by: str | None = None

    @property
    def ok(self) -> bool:
        """Return whether no problem was found."""
        return not self.problems

    @property
    def worst(self) -> InstantError | None:
        """Return the instant with the largest error, None where nothing could be compared."""
        return max(self.instants, key=lambda instant: instant.largest, default=None)

    def __str__(self) -> str:
        lines = [f"{self.path}: " + ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in self.counts.items())]
        if self.worst is not None:
            worst, mean = self.worst, float(np.mean([instant.mean for instant in self.instants]))
            lines.append(
                f"log intensity minus reconstruction at {len(self.instants)} instants: largest {worst.largest:.9f} C "
                f"at {_seconds(worst.t_us)}, pixel ({worst.x}, {worst.y}); mean {mean:.4f} C"
            )
        if self.void:
            lines.append(
                f"log intensity is not compared with the events, which need not explain it under {_and(self.void)}"
            )
        if self.converted:
            lines.append("log intensity is not compared with the events: a folder that was converted has none")
        if self.made_by:
            lines.append(f"made by {self.made_by}")
        if self.noise:
            noise = share_text(self.noise, "the events are")
            lines.append(f"{noise}; rendered luma has it too, so that the check cannot see it")
        lines += [f"problem: {problem}" for problem in self.problems[:_SHOWN]]
        if len(self.problems) > _SHOWN:
            lines.append(f"... and {len(self.problems) - _SHOWN} more")
        if self.ok:
            holds = "the check of its structure holds" if self.void or self.converted else "the check holds"
            lines.append(f"{holds}, noise included" if self.noise else holds)
        else:
            lines.append(f"the check fails: {len(self.problems)} problem{'s' * (len(self.problems) > 1)}")
        return "\n".join(map(printable, lines))


def check_dataset(path: str | Path) -> CheckReport:
    """Check a dataset that :class:`~davis_rs.io.dataset.writer.DatasetWriter` wrote.

    Its events: log intensity is reconstructed from the first luma map, the start phases and the events, and compared
    with the rendered one wherever luma is stored; in every pixel the error L - R must lie inside (-C_off, C_on), give
    or take ``TOLERANCE``. This is the check of the paper, for ideal pixels: where an effect acts behind the luma, it is
    left out, and the report says so. Its structure: events sorted by (t, y, x), or by t where a bus has read
    them out or they were converted from a recording, inside the sensor and the duration; counts as in
    ``meta.json``; every listed image there, readable and of the sensor's size, at strictly increasing times that
    are multiples of its period to the nearest microsecond; ground truth at strictly increasing times with unit
    quaternions.

    Raises:
        OSError: if there is no dataset at ``path``. All else becomes a sentence in the report.

    Source: Mueggler et al., IJRR 2017, section 6 (the simulator).
    """
    dataset = Dataset(path)
    report = CheckReport(dataset.path)
    problems = report.problems

    def read(reading: Callable[[], _T]) -> _T | None:
        try:
            return reading()
        except (DecodeError, OSError) as error:
            problems.append(f"{error}.")
            return None

    meta = read(lambda: dataset.meta) or {}
    if not meta:
        problems.append(f"There is no {META} to be read, so the events cannot be compared with log intensity.")
    sensor = read(lambda: _sensor_size(dataset, meta))
    events, ground_truth = read(lambda: dataset.events), read(lambda: dataset.groundtruth)
    frames, depth_maps = read(lambda: dataset.frames) or [], read(lambda: dataset.depth_maps) or []
    luma = read(lambda: dataset.luma) or []

    if events is not None:
        report.counts = {"events": len(events), "on_events": int(np.count_nonzero(events["p"]))}
        signal = read(lambda: dataset.signal)
        if signal is not None and len(signal):
            report.counts["signal_events"] = int(np.count_nonzero(signal))
            if len(signal) != len(events):
                problems.append(f"{SIGNAL} labels {len(signal)} events, the folder holds {len(events)}.")
    report.counts |= {"frames": len(frames), "depth_maps": len(depth_maps), "luma_maps": len(luma)}
    if meta:
        poses = {} if ground_truth is None else {"poses": len(ground_truth.t_us)}
        problems += _meta_problems(meta, report.counts | poses)
    if sensor is None:
        return report
    size = (sensor[1], sensor[0])
    parameters = meta.get("parameters") or {}
    event_problems = (
        []
        if events is None
        else list(
            _event_problems(
                events,
                size,
                _duration(meta),
                recorded="converted_from" in meta,
                behind_bus="readout" in (meta.get("effects") or {}),
            )
        )
    )
    luma_problems = list(_image_problems("luma map", luma, dataset.read_luma, size, None))
    problems += event_problems
    problems += _image_problems("frame", frames, dataset.read_image, size, parameters.get("frame_rate_hz"))
    problems += _image_problems("depth map", depth_maps, dataset.read_depth, size, parameters.get("depth_rate_hz"))
    problems += luma_problems
    if ground_truth is not None:
        problems += _pose_problems(ground_truth)
    said = describe_dataset(dataset) if meta else None
    if said is not None:
        report.noise, report.made_by = said.noise, said.made_by if said.of_another_model else None
    report.void = [name for name in meta.get("effects") or {} if name in _VOIDING]
    report.void += _voiding_custom_effects(meta)
    report.converted = "converted_from" in meta and not luma
    if (
        meta
        and not report.void
        and not report.converted
        and events is not None
        and not event_problems
        and not luma_problems
    ):
        report.instants, comparison_problems = _compare(dataset, events, parameters)
        problems += comparison_problems
    return report


def _voiding_custom_effects(meta: JsonObject) -> list[str]:
    """Return the user's own effects that act behind luma."""
    return [str(one.get("class")) for one in custom_effects(meta) if one.get("acts_on") != ["luma"]]


def _sensor_size(dataset: Dataset, meta: JsonObject) -> tuple[int, int] | None:
    """Return (width, height); read the calibration, unless ``meta.json`` says that there is none."""
    if meta.get("calibrated") is False:
        return dataset.size
    camera = dataset.camera
    return camera.width, camera.height


def _and(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _duration(meta: JsonObject) -> int | None:
    """Return the duration in microseconds, None where the writer did not come to write the final one."""
    return meta.get("duration_us") if meta.get("complete") or meta.get("interrupted") else None


def _meta_problems(meta: JsonObject, counts: dict[str, int]) -> Iterator[str]:
    if _duration(meta) is None:
        yield f"The dataset was never finished ({META} says so): its writer was killed or failed."
        return
    stated = meta.get("counts") or {}
    for name, count in counts.items():
        label = name.replace("_", " ")
        if name not in stated:
            yield f"{META} does not say how many {label} there are, the folder holds {count}."
        elif stated[name] != count:
            yield f"{META} counts {stated[name]} {label}, the folder holds {count}."


def _event_problems(
    events: EventArray, size: tuple[int, int], duration_us: int | None, *, recorded: bool, behind_bus: bool
) -> Iterator[str]:
    """Yield what is wrong with events; ``recorded`` ones begin at 0, and within a time have a camera's order, as those
    behind a bus."""
    height, width = size
    outside = (events["x"] >= width) | (events["y"] >= height)
    if outside.any():
        t, x, y, _ = events[outside.argmax()]
        yield (
            f"{np.count_nonzero(outside)} of the events lie outside of the {width} x {height} sensor, "
            f"the first at ({x}, {y}), {_seconds(t)}."
        )
    t_us = events["t"]
    first_us = 0 if recorded else 1
    late = t_us < first_us if duration_us is None else (t_us < first_us) | (t_us > duration_us)
    if late.any():
        limit = "..." if duration_us is None else _seconds(duration_us)
        first = _seconds(t_us[late.argmax()])
        begin = "[0 s" if recorded else "(0 s"
        yield f"{np.count_nonzero(late)} of the events lie outside of {begin}, {limit}], the first at {first}."
    # One key a pixel keeps (y, x) order; times and keys of neighbours then decide.
    pixel = events["y"].astype(np.int64) * 65536 + events["x"]
    back = t_us[1:] < t_us[:-1]
    by_time_alone = recorded or behind_bus
    if not by_time_alone:
        back |= (t_us[1:] == t_us[:-1]) & (pixel[1:] < pixel[:-1])
    if back.any():
        at = int(back.argmax()) + 1
        yield (
            f"The events are not sorted by {'t' if by_time_alone else '(t, y, x)'}: event {at + 1} of events.txt, at "
            f"{_seconds(t_us[at])}, belongs before the one above it."
        )


def _image_problems(
    kind: str,
    series: list[StampedImage],
    read: Callable[[int], AnyArray],
    size: tuple[int, int],
    rate_hz: float | None,
) -> Iterator[str]:
    last_us = -1
    for number, (t_us, path) in enumerate(series):
        if t_us <= last_us:
            yield f"The times of the {kind}s do not increase: {_seconds(t_us)} follows {_seconds(last_us)}."
        last_us = t_us
        due_us = number * 1e6 / rate_hz if rate_hz else None
        if due_us is not None and abs(t_us - due_us) > 0.5 + 1e-6:
            yield f"{kind.capitalize()} {number} is at {_seconds(t_us)}, but fell due at {due_us / 1e6:.6f} s."
            return  # those after it are late as well
        try:
            shape = read(number).shape
        except FileNotFoundError:
            yield f"{kind.capitalize()} {number} is listed, but there is no file {path}."
            continue
        except (DecodeError, OSError) as error:
            yield f"{kind.capitalize()} {number} cannot be read: {error}."
            continue
        if shape != size:
            yield f"{kind.capitalize()} {number} has shape {shape}, the sensor {size}: {path}."


def _pose_problems(ground_truth: GroundTruth) -> Iterator[str]:
    t_us = ground_truth.t_us
    back = t_us[1:] <= t_us[:-1]
    if back.any():
        at = int(back.argmax())
        yield f"The times of the ground truth do not increase: {_seconds(t_us[at + 1])} follows {_seconds(t_us[at])}."
    norm = np.linalg.norm(ground_truth.quaternions, axis=1)
    wrong = np.abs(norm - 1) > 1e-6
    if wrong.any():
        at = int(wrong.argmax())
        yield f"The ground truth's quaternions must have norm 1: it is {norm[at]:.9g} at {_seconds(t_us[at])}."


def _compare(dataset: Dataset, events: EventArray, parameters: JsonObject) -> tuple[list[InstantError], list[str]]:
    """Return the paper's check: the error at each instant, and the problems."""
    try:
        c_on, log_eps = float(parameters["contrast_threshold"]), float(parameters["log_eps"])
        c_off = float(parameters["contrast_threshold_off"] or c_on)
    except (KeyError, TypeError, ValueError):
        names = "contrast_threshold, contrast_threshold_off and log_eps"
        return [], [f"{META} lacks the parameters {names}, so the events cannot be compared with log intensity."]
    if len(dataset.luma) < 2:
        return [], ["Fewer than two luma maps are stored, so the events cannot be compared with log intensity."]
    start_us = dataset.luma[0].t_us
    if len(events) and events["t"][0] <= start_us:
        return [], [f"There are events before the first luma map, which is at {_seconds(start_us)}."]
    start_phase, seed = parameters.get("start_phase") or "zero", parameters.get("seed")
    first = log_intensity(dataset.read_luma(0), log_eps)
    try:
        first = reconstruct(events[:0], first, start_us, c_on, c_off, start_phase=start_phase, seed=seed)
    except (TypeError, ValueError) as error:
        return [], [f"{META} does not say where references began, so the events cannot be compared: {error}."]
    instants = list(_instant_errors(dataset, events, first, c_on, c_off, log_eps))
    failed = [instant for instant in instants if not instant.largest < 1 + TOLERANCE]
    if not failed:
        return instants, []
    begin = failed[0]
    return instants, [
        f"At {len(failed)} of {len(instants)} instants the events do not give log intensity within (-C_off, C_on): "
        f"first at {_seconds(begin.t_us)}, where pixel ({begin.x}, {begin.y}) is {begin.largest:.6f} C away."
    ]


def _instant_errors(
    dataset: Dataset,
    events: EventArray,
    reconstruction: npt.NDArray[np.float64],
    c_on: float,
    c_off: float,
    log_eps: float,
) -> Iterator[InstantError]:
    """Compare at each instant but the first, where ``reconstruction`` holds."""
    done = 0
    for index, (t_us, _) in enumerate(dataset.luma[1:], 1):
        # From one instant to the next, so that every event is counted once however many instants there are.
        until = int(np.searchsorted(events["t"], t_us, side="right"))
        reconstruction = reconstruct(events[done:until], reconstruction, t_us, c_on, c_off)
        done = until
        error = log_intensity(dataset.read_luma(index), log_eps) - reconstruction
        in_c = np.where(error > 0, error / c_on, -error / c_off)
        y, x = np.unravel_index(in_c.argmax(), in_c.shape)
        yield InstantError(t_us, float(in_c[y, x]), float(in_c.mean()), int(x), int(y))


def _seconds(t_us: int) -> str:
    return f"{t_us / 1e6:.6f} s"
