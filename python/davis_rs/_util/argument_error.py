"""Gives errors the names of the arguments that they are about, so that each way in calls them as its users do."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Mapping, Sequence
from string import Formatter
from typing import NamedTuple


class Argument(NamedTuple):
    """Names an argument in a message.

    Attributes:
        name: in Python.
        value: that it has or should have, as text; "" where the message gives none.
    """

    name: str
    value: str = ""


Spelling = Callable[[Argument], str]
"""How an argument is written: in Python, as an option of the command line, or as a key of a plan."""


def in_python(argument: Argument) -> str:
    """Write an argument as Python has it: ``fps``, or with a value ``overwrite=True`` and ``effects='auto'``."""
    value = argument.value if argument.value in ("True", "False") else repr(argument.value)
    return f"{argument.name}={value}" if argument.value else argument.name


class NamesArguments:
    """Holds what errors have in common that carry the names of arguments.

    Attributes:
        parts: the message, in pieces of text and arguments.
    """

    parts: tuple[str | Argument, ...]

    @property
    def argument(self) -> str:
        """Return the name of the argument that is at fault: the first one in the message."""
        return self.arguments[0]

    @property
    def arguments(self) -> tuple[str, ...]:
        """Return the names of all arguments in the message, in their order."""
        return tuple(dict.fromkeys(part.name for part in self.parts if isinstance(part, Argument)))

    def told(self, spelling: Spelling = in_python) -> str:
        """Return the message with its arguments written in a way of the caller's."""
        return "".join(spelling(part) if isinstance(part, Argument) else part for part in self.parts)


class ArgumentError(NamesArguments, ValueError):
    """Refuses an argument that is missing or has a wrong value; the message says the rule and the value.

    >>> raise ArgumentError("{fps} must be positive and finite, got {}", fps)

    A name in braces is an argument's, ``{overwrite:True}`` with a value that it should have. Empty braces are filled
    with the values, as in ``str.format``.

    Args:
        rule: the message.
        values: what fills the empty braces.
        names: arguments whose names are not known beforehand: the name, or several, for a name in braces.

    Attributes:
        argument: the name of the argument at fault.
        arguments: the names of all arguments that the message has.
        parts: the message, in pieces of text and ``Argument``.
    """

    def __init__(self, rule: str, *values: object, **names: str | Sequence[str]) -> None:
        self.parts = _parts(rule, values, names)
        super().__init__(self.told())

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (_rule(self.parts),)


class OverwriteError(NamesArguments, FileExistsError):
    """Refuses to replace a file or folder that is there already, unless an argument asks for it.

    Args:
        path: of the file or the folder.
        rule, values: as of :class:`ArgumentError`.
    """

    def __init__(self, path: str | os.PathLike[str], rule: str, *values: object) -> None:
        self.parts = _parts(rule, values, {})
        super().__init__(errno.EEXIST, self.told(), os.fspath(path))

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.filename, _rule(self.parts))


def told(error: BaseException, spelling: Spelling) -> str:
    """Say what an error says, with the arguments that it names written in a way of the caller's."""
    return error.told(spelling) if isinstance(error, NamesArguments) else str(error)


def _parts(rule: str, values: Sequence[object], names: Mapping[str, str | Sequence[str]]) -> tuple[str | Argument, ...]:
    parts: list[str | Argument] = []
    left, formatter = iter(values), Formatter()
    for text, name, spec, conversion in formatter.parse(rule):
        parts.append(text)
        if name == "":
            parts.append(format(formatter.convert_field(next(left), conversion), spec or ""))
        elif name is not None:
            # The value may hold empty braces itself.
            pieces = formatter.parse(spec or "")
            value = "".join(piece[0] if piece[1] is None else f"{piece[0]}{next(left)}" for piece in pieces)
            given = names.get(name, name)
            for index, argument in enumerate([given] if isinstance(given, str) else given):
                parts += [", "] if index else []
                parts.append(Argument(argument, value))
    return tuple(part for part in parts if part)


def _rule(parts: Sequence[str | Argument]) -> str:
    """Return a rule without values that gives these parts."""
    return "".join(
        f"{{{part.name}:{_plain(part.value)}}}" if isinstance(part, Argument) else _plain(part) for part in parts
    )


def _plain(text: str) -> str:
    return text.replace("{", "{{").replace("}", "}}")
