"""Loads what ``MODULE:NAME`` or ``FILE.py:NAME`` stands for: code of a user's own, named on a command line."""

from __future__ import annotations

import importlib.util
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

from .close_names import did_you_mean


def load_entry(entry: str, kind: str) -> object:
    """Load the object that ``MODULE:NAME`` or ``FILE.py:NAME`` stands for.

    The working directory's modules are found as well.

    Args:
        entry: the text.
        kind: what the object is to be, for messages, such as ``custom effect``.

    Raises:
        ValueError: if there is no such module or name.
        OSError: if there is no such file.
    """
    where, colon, name = entry.rpartition(":")
    if not colon or not where or not name.isidentifier():
        article = "an" if kind[0] in "aeiou" else "a"
        raise ValueError(f"{article} {kind} must be MODULE:NAME or FILE.py:NAME, got {entry!r}")
    if where.endswith(".py"):
        file = Path(where).resolve(strict=True)
        spec = importlib.util.spec_from_file_location(f"{kind.replace(' ', '_')}s.{file.stem}", file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[module.__name__] = module  # where inspect and dataclasses look for the module of a class
        spec.loader.exec_module(module)
    else:
        module = _import(where, f"{kind} {entry!r}")
    if not hasattr(module, name):
        names = [one for one, value in vars(module).items() if callable(value) and not one.startswith("_")]
        raise ValueError(f"{kind} {entry!r}: {where} has no {name}{did_you_mean(name, names)}")
    return getattr(module, name)


def _import(name: str, wanted: str) -> ModuleType:
    folder = str(Path.cwd())
    added = folder not in sys.path
    if added:
        sys.path.append(folder)
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise
        raise ValueError(f"{wanted}: there is no module {error.name!r}") from None
    finally:
        if added:
            sys.path.remove(folder)
