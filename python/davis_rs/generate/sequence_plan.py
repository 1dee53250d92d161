"""Reads a plan: how many sequences, and for each setting a value or the distribution that it is drawn from."""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from .._util.array_types import JsonObject, JsonValue
from .._util.close_names import without_unit
from .._util.former_names import is_now
from .._util.random_words import Words
from .._util.yaml_file import read_yaml
from ..geometry.camera import PRESETS
from ..scene.files.mesh_scene import READERS as MESH_READERS
from ..scene.load import BUILTIN_SCENES, GLTF, load_scene
from ..scene.sequences import SEQUENCES
from ..sensor.effects import EFFECTS
from ..sensor.presets import SENSOR_SUFFIXES, SENSORS
from ..sensor.rig import RIGS, load_rig, rig_yaml
from ..simulation.settings import FolderSettings, Setting, former_names_of, settings_of
from .distributions import Choice, Distribution, draw
from .parse import Parser, Where, effects, imu_effects, motion, scene, start_pose, value_of
from .random_scene import FOLDERS
from .shards import MOST_IN_A_SHARD, WRITERS, Shards

_RULES: Mapping[type | None, str] = {float: "a number", int: "an integer", str: "a text", bool: "true or false"}
_NAMES: Mapping[str, Collection[str]] = {"scene": {*BUILTIN_SCENES, *SEQUENCES}, "camera": PRESETS, "sensor": SENSORS}
_NOT_KEYS = {"seed", "threads", "custom_effects", "accept_noise"}
"""The seed is the plan's, and drawn for each sequence; threads are those of the workers; a plan runs nobody's code; and
noise is accepted of all sequences or of none."""

SETTINGS: dict[str, Setting] = {
    setting.key: setting
    for setting in settings_of(FolderSettings).values()
    if setting.kind is not None and setting.name not in _NOT_KEYS
}
"""The settings of a simulation that a plan may give or draw, by key."""

FORMER_KEYS = {without_unit(former): without_unit(name) for former, name in former_names_of(FolderSettings).items()}
"""Present keys by former ones. A former key stays in what is drawn, because draws depend on it."""

_OF_PLAN = ("seed", "sequences", "shards", "accept_noise")
"""Keys of the plan, not of a sequence: they take no distributions."""

_MAY_CHANGE = ("sequences", "accept_noise")
"""Of these, those that change nothing of a sequence: there may be more later, and more may be accepted."""

MOST_SEQUENCES = 1_000_000
"""Of a plan: a manifest of more is no longer handled by any program."""

KEYS: dict[str, Parser] = {
    "scene": scene,
    "up": value_of("a text"),
    "scale": value_of("a number"),
    "animation": value_of("a text"),
    "grey_unknown": value_of("true or false"),
    "motion": motion,
    "start_pose": start_pose,
    "rig": value_of("a text", none=True),
    "start": value_of("a number"),
    "duration": value_of("a number"),
    "effects": effects,
    "imu_effects": imu_effects,
    **{
        key: value_of(_RULES[setting.kind], none=setting.declared.default is None, words=setting.declared.words)
        for key, setting in SETTINGS.items()
        if setting.kind is not list
    },
}
"""The keys of a sequence, and what reads them: those of the settings, and the camera path's."""


@dataclass(frozen=True)
class SequencePlan:
    """Holds a plan of sequences, as read from its file.

    Attributes:
        file: where it came from; scenes, calibrations, sensors and trajectories that are files are relative to its
            folder.
        seed: of all draws, >= 0.
        sequences: how many.
        tree: for each key a value or a distribution.
        identity: the plan in JSON's types, without what may change: the number of sequences, and ``accept_noise``.
        digests: SHA-256 of each file that the plan names, by the name that it has there, of materials and textures of
            meshes, and of the list of names and sizes of a folder's files.
        shards: how sequences are put together into files; None: each is a folder.
        accept_noise: make sequences however many of their events are Monte Carlo noise.
    """

    file: Path
    seed: int
    sequences: int
    tree: Mapping[str, JsonValue]
    identity: Mapping[str, JsonValue]
    digests: Mapping[str, str]
    shards: Shards | None = None
    accept_noise: bool = False

    @property
    def sha256(self) -> str:
        """Return a hash of identity and files. Two plans with the same hash draw and make the same sequences."""
        text = json.dumps([self.identity, self.digests], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def parameters(self, index: int) -> JsonObject:
        """Draw the parameters of a sequence, in JSON's types, in the order of the keys' names.

        A value is a function of (the plan's seed, ``index``, its key path), so that another key, another order of keys
        or more sequences change none. The seeds that are not given are drawn as well: ``seed`` of the simulation, a
        motion's own, and that of a scene that is drawn.
        """
        drawn: JsonObject = draw(self.tree, self.seed, index)
        drawn["seed"] = self._drawn_seed(index, "seed")
        path = drawn.get("motion")
        if path is not None and path["kind"] in _SEEDED_MOTIONS and "seed" not in path:
            path["seed"] = self._drawn_seed(index, "motion.seed")
        if isinstance(drawn["scene"], dict) and "seed" not in drawn["scene"]:
            drawn["scene"]["seed"] = self._drawn_seed(index, "scene.seed")
        in_order: JsonObject = json.loads(json.dumps(drawn, sort_keys=True))
        return in_order

    def _drawn_seed(self, index: int, path: str) -> int:
        return Words(self.seed, index, path).word() >> 33  # 31 bits: Mitsuba's samplers count on from it in 32


_SEEDED_MOTIONS = ("hand_held", "walking", "running")


def sequence_name(index: int) -> str:
    """Name the folder of a sequence; it does not depend on how many there are."""
    return f"sequence_{index:05d}"


def load_sequence_plan(path: str | Path) -> SequencePlan:
    """Read a plan. Its keys and distributions are those of ``docs/generate.md``.

    Raises:
        OSError: if it, or a file that it names, cannot be read.
        ValueError: where it breaks a rule, naming file, key path, rule and value.

    Warns:
        FutureWarning: for a key by its former name.
    """
    file = Path(path)
    where = Where(file)
    given = where.mapping(read_yaml(file), "a mapping of keys to values")
    tree: dict[str, object] = {}
    for key, value in given.items():
        if key in _OF_PLAN:
            continue
        present = FORMER_KEYS.get(key, key)
        if key != present:
            if present in given:
                where.at(key).refuse(f"the only one, but {present} is given as well", value)
            warnings.warn(f"{file}: {is_now(key, present)}", FutureWarning, stacklevel=2)
        if present not in KEYS:
            where.unknown(key, (*_OF_PLAN, *KEYS), {name: f"effects: {{{name}: ...}}" for name in EFFECTS})
        tree[key] = KEYS[present](value, where.at(key))
    if "scene" not in tree:
        raise ValueError(f"{file}: a plan needs a scene")
    seed = _integer(given.get("seed", 0), 0, where.at("seed"))
    sequences = _integer(given.get("sequences", 1), 1, where.at("sequences"))
    if sequences > MOST_SEQUENCES:
        where.at("sequences").refuse(f"at most {MOST_SEQUENCES}", sequences)
    accept_noise = given.get("accept_noise", False)
    if not isinstance(accept_noise, bool):
        where.at("accept_noise").refuse("true or false", accept_noise)
    shards = _shards(given.get("shards"), where.at("shards"))
    if shards is not None and any(isinstance(rig, str) for rig in _options(tree.get("rig"))):
        where.at("shards").refuse("left out with a rig, because a shard's sequences have one camera", given["shards"])
    identity = {key: value for key, value in given.items() if key not in _MAY_CHANGE} | {"seed": seed}
    return SequencePlan(file, seed, sequences, tree, identity, _digests(tree, file.parent), shards, accept_noise)


def _integer(value: object, least: int, where: Where) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        where.refuse(f"an integer >= {least}", value)
    return value


def _shards(value: object, where: Where) -> Shards | None:
    if value is None:
        return None
    given = where.mapping(value, "a mapping with format and sequences")
    for key in given:
        if key not in ("format", "sequences"):
            where.unknown(key, ("format", "sequences"))
    kind, count = given.get("format"), given.get("sequences")
    if not isinstance(kind, str) or kind not in WRITERS:
        where.at("format").refuse(f"one of {', '.join(WRITERS)}", kind)
    if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= MOST_IN_A_SHARD:
        where.at("sequences").refuse(f"an integer in 1..{MOST_IN_A_SHARD}", count)
    return Shards(kind, count)


def resolve(key: str, text: str, base: Path) -> str:
    """Resolve ``scene``, ``camera``, ``sensor`` or ``rig``: a known name, or where the file lies under ``base``.

    A known name is never a file's, as in :func:`~davis_rs.load_scene`, :func:`~davis_rs.load_camera` and
    :func:`~davis_rs.load_sensor`.
    """
    if key == "rig":
        return text if text in RIGS else str(base / text)
    no_file = key == "sensor" and not text.lower().endswith(SENSOR_SUFFIXES)
    return text if no_file or text in _NAMES[key] else str(base / text)


def _digests(tree: Mapping[str, JsonValue], base: Path) -> dict[str, str]:
    named = {text for key, names in _NAMES.items() for text in _texts(tree.get(key)) if text not in names}
    named |= {text for path in _mappings(tree.get("motion")) for text in _texts(path.get("file"))}
    files = {text: base / text for text in sorted(named) if (base / text).is_file()}
    for text in _texts(tree.get("scene")):
        if text in files and files[text].suffix.lower() in (*MESH_READERS, *GLTF):
            files |= {os.path.relpath(file, base): file for file in _mesh_files(files[text])}
    digests = {text: hashlib.sha256(path.read_bytes()).hexdigest() for text, path in files.items()}
    rigs = {text: base / text for text in _texts(tree.get("rig")) if text not in RIGS}
    # As it was read, with the sensors that are files of their own.
    digests |= {
        text: hashlib.sha256(rig_yaml(load_rig(path)).encode()).hexdigest()
        for text, path in sorted(rigs.items())
        if path.is_file()
    }
    drawn = _mappings(tree.get("scene"))
    folders = {(key, text) for kind in drawn for key in FOLDERS for text in _texts(kind.get(key))}
    return digests | {
        text: _listing_sha256(key, base / text) for key, text in sorted(folders) if (base / text).is_dir()
    }


def _listing_sha256(key: str, folder: Path) -> str:
    """Return a hash of the names and sizes of a folder's files; reading all of a large one would take too long."""
    try:
        files = FOLDERS[key](folder)
    except ValueError:  # it has none: refused where it is needed
        files = ()
    lines = (f"{path.relative_to(folder).as_posix()} {path.stat().st_size}" for path in files)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _mesh_files(mesh: Path) -> tuple[Path, ...]:
    """List the files that a mesh is read with; none of one that cannot be read, which is refused where it is needed."""
    with warnings.catch_warnings(), suppress(ValueError, OSError):
        warnings.simplefilter("ignore")  # what is to be said of it is said when it is simulated
        return load_scene(mesh, grey_unknown=True).files
    return ()


def _texts(node: object) -> list[str]:
    return [option for option in _options(node) if isinstance(option, str)]


def _mappings(node: object) -> list[dict[str, object]]:
    return [option for option in _options(node) if isinstance(option, dict)]


def _options(node: object) -> Iterator[object]:
    """Yield all that a node may come to."""
    if isinstance(node, Choice):
        for option in node.options:
            yield from _options(option)
    elif not isinstance(node, Distribution):
        yield node
