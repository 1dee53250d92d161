"""Reads strict YAML: rejects duplicate keys and values that are easily mistaken, and limits aliases."""

from __future__ import annotations

import re
from pathlib import Path

from .untrusted import read_text

MOST_BYTES = 1 << 17
MOST_NODES = 20_000
DEEPEST = 50


def read_yaml(path: Path) -> object:
    """Read a YAML file: a key that stands twice is refused, and ``1e-3`` is a number, as in YAML 1.2 and JSON.

    Raises:
        OSError: if it cannot be read, or is no regular file.
        ValueError: if it is no YAML, naming file, line and column; or if it holds more than 131,072 bytes, 20,000
            values, aliases counted wherever they stand, or 50 levels.
    """
    import yaml

    class Loader(yaml.SafeLoader):
        # The scanner looks at all open brackets for each new one: seconds for some thousands of them.
        def fetch_flow_collection_start(self, token: object) -> None:
            if self.flow_level >= DEEPEST:
                raise RecursionError
            super().fetch_flow_collection_start(token)

    def mapping(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[object, object]:
        seen: set[str] = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key.value!r} stands here a second time", key.start_mark
                )
            seen.add(key.value)
        return loader.construct_mapping(node, deep=True)

    Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, mapping)
    # YAML 1.1 wants a dot and a sign in such a number, and takes it for a text without them.
    number = re.compile(r"^[-+]?\d+(\.\d*)?[eE][-+]?\d+$")
    Loader.add_implicit_resolver("tag:yaml.org,2002:float", number, [*"-+0123456789"])
    try:
        content = yaml.load(read_text(path, MOST_BYTES), Loader)  # a SafeLoader
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = "" if mark is None else f", line {mark.line + 1}, column {mark.column + 1}"
        raise ValueError(f"{path}{where}: {error.problem}") from None
    # PyYAML lets through what int() and datetime say of 5000 digits and of the 13th month.
    except (yaml.YAMLError, ValueError, TypeError, AttributeError, OverflowError) as error:
        if str(error).startswith(f"{path}"):
            raise
        raise ValueError(f"{path}: not a YAML file: {error}") from None
    except RecursionError:
        raise ValueError(f"{path}: it may be nested {DEEPEST} levels deep") from None
    _check_extent(path, content)
    return content


def _check_extent(path: Path, content: object) -> None:
    """Refuse what aliases make large, or endless: each place where one stands counts."""
    count, level = 0, [content]
    for _ in range(DEEPEST):
        count += len(level)
        if count > MOST_NODES:
            raise ValueError(f"{path}: it may hold {MOST_NODES} values, its aliases counted wherever they stand")
        below: list[object] = []
        for node in level:
            below.extend(node.values() if isinstance(node, dict) else node if isinstance(node, list) else ())
            if len(below) > MOST_NODES:
                break
        level = below
        if not level:
            return
    raise ValueError(f"{path}: it may be nested {DEEPEST} levels deep")
