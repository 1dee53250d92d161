"""Reading YAML so that nothing is lost or mistaken without a word."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any


def read_yaml(path: Path) -> Any:
    """What a YAML file holds: a key that stands twice is refused, and ``1e-3`` is a number, as in YAML 1.2 and JSON.

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is no YAML, naming file, line and column.
    """
    import yaml

    class Loader(yaml.SafeLoader):
        pass

    def mapping(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[Any, Any]:
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
        return yaml.load(path.read_text("utf-8"), Loader)  # a SafeLoader
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = "" if mark is None else f", line {mark.line + 1}, column {mark.column + 1}"
        raise ValueError(f"{path}{where}: {error.problem}") from None
    # PyYAML lets through what int() and datetime say of 5000 digits and of the 13th month.
    except (yaml.YAMLError, ValueError) as error:
        raise ValueError(f"{path}: not a YAML file: {error}") from None
