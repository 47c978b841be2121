"""A scene file as a raw document, and where each of its keys stands."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from thirdbody.errors import Fault, InputError
from thirdbody.scene.locate import locate
from thirdbody.scene.part import Place, Wrong, key_path
from thirdbody.scene.settings import WHERE


@dataclass(frozen=True)
class Source:
    """Where a scene came from. All sources are equal: two scenes that say the same are the same scene."""

    file: str | None = field(default=None, compare=False)
    positions: dict[Place, tuple[int, int]] = field(default_factory=dict, compare=False)
    settings: tuple[Place, ...] = field(default=(), compare=False)

    def overridden(self, places: Iterable[Place]) -> Source:
        """The source with these places taken from the command line."""
        return replace(self, settings=(*self.settings, *places))

    def position(self, place: Place) -> tuple[int, int] | None:
        """Line and column of the key, or of the nearest table around it."""
        for length in range(len(place), 0, -1):
            if place[:length] in self.positions:
                return self.positions[place[:length]]
        return (1, 1) if self.file is not None else None

    def fault(self, place: Place, message: str) -> Fault:
        """The fault with file, line and column as far as they are known."""
        key = key_path(place)
        if any(place[: len(setting)] == setting for setting in self.settings):
            return Fault(key, message, file=WHERE)
        line, column = self.position(place) or (None, None)
        return Fault(key, message, self.file, line, column)

    def in_order(self, wrongs: Iterable[Wrong]) -> list[Fault]:
        """The faults in the order of the file."""
        placed = sorted(wrongs, key=lambda wrong: self.position(wrong[0]) or (0, 0))
        return [self.fault(place, text) for place, text in placed]


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a file. Raises InputError with the one reason why it cannot be read."""
    name = os.fspath(path)
    try:
        with open(path, "rb") as file:
            data = file.read()
    except FileNotFoundError:
        raise InputError(Fault("", "no such file", name)) from None
    except IsADirectoryError:
        raise InputError(Fault("", "is a folder, expected a scene file", name)) from None
    except OSError as error:
        raise InputError(Fault("", f"cannot be read: {error.strerror}", name)) from None
    try:
        return data.decode("utf-8-sig")  # some editors put a mark in front
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = len(data[: error.start].rpartition(b"\n")[2].decode("utf-8", "replace")) + 1
        raise InputError(Fault("", "is not UTF-8 text: save it as UTF-8", name, line, column)) from None


_WHERE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")


def read_toml(text: str, name: str) -> tuple[dict[str, Any], Source]:
    """The raw tables and their source. Raises InputError with one fault when the text is not TOML."""
    try:
        document = tomllib.loads(text)
    except RecursionError:
        raise InputError(Fault("", "not valid TOML: nested too deeply", name)) from None
    except ValueError as error:
        raise InputError(_syntax_fault(str(error), text, name)) from None
    return document, Source(name, locate(text))


def _syntax_fault(message: str, text: str, name: str) -> Fault:
    match = _WHERE.search(message)
    if match and match[1]:
        line, column = int(match[1]), int(match[2])
    else:
        lines = text.rstrip().split("\n")
        line, column = len(lines), len(lines[-1]) + 1
    return Fault("", f"not valid TOML: {_WHERE.sub('', message)}", name, line, column)
