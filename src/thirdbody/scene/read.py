"""Reading of a scene file: its raw document, and the position of each key."""

from __future__ import annotations

import os
import re
import stat
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from thirdbody.errors import SETTINGS, Fault, InputError
from thirdbody.scene.schema_base import Location, Wrong, key_path
from thirdbody.scene.toml_positions import locate

MAX_BYTES = 4_000_000
"""Bytes of the largest scene file: larger tables of bodies belong in files of their own."""


@dataclass(frozen=True)
class Source:
    """Origin of a scene. All sources are equal: two scenes with the same content are the same scene."""

    file: str | None = field(default=None, compare=False)
    positions: dict[Location, tuple[int, int]] = field(default_factory=dict, compare=False)
    settings: tuple[Location, ...] = field(default=(), compare=False)
    folder: str | None = field(default=None, compare=False)  # of the files it names, if not that of `file`

    def overridden(self, locations: Iterable[Location]) -> Source:
        """Return the source with these places set by settings."""
        return replace(self, settings=(*self.settings, *locations))

    def position(self, location: Location) -> tuple[int, int] | None:
        """Return line and column of the key, or of the nearest enclosing table."""
        for length in range(len(location), 0, -1):
            if location[:length] in self.positions:
                return self.positions[location[:length]]
        return (1, 1) if self.file is not None else None

    def fault(self, location: Location, message: str) -> Fault:
        """Return the fault with file, line and column as far as they are known."""
        key = key_path(location)
        if any(location[: len(setting)] == setting for setting in self.settings):
            return Fault(key, message, file=SETTINGS)
        line, column = self.position(location) or (None, None)
        return Fault(key, message, self.file, line, column)

    def in_order(self, faults: Iterable[Wrong]) -> list[Fault]:
        """Return the faults in the order of the file."""
        ordered = sorted(faults, key=lambda wrong: self.position(wrong[0]) or (0, 0))
        return [self.fault(location, text) for location, text in ordered]


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    str

    Raises
    ------
    InputError
        With the reason why it cannot be read.
    """
    name = os.fspath(path)
    try:
        info = os.stat(path)
        if stat.S_ISDIR(info.st_mode):
            raise InputError(Fault("", "is a folder, expected a scene file", name))
        if not stat.S_ISREG(info.st_mode):  # a pipe without a writer would block forever
            raise InputError(Fault("", "is a device, expected a scene file", name))
        if info.st_size > MAX_BYTES:
            raise InputError(Fault("", f"has {info.st_size / 1e6:.1f} MB; a scene has at most {MAX_BYTES / 1e6:.0f} MB", name))
        with open(path, "rb") as file:
            data = file.read()
    except FileNotFoundError:
        raise InputError(Fault("", "no such file", name)) from None
    except OSError as error:
        raise InputError(Fault("", f"cannot be read: {error.strerror}", name)) from None
    except ValueError as error:  # a null byte in the name
        raise InputError(Fault("", f"cannot be read: {error}", name)) from None
    try:
        return data.decode("utf-8-sig")  # some editors write a byte order mark
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = len(data[: error.start].rpartition(b"\n")[2].decode("utf-8", "replace")) + 1
        raise InputError(Fault("", "is not UTF-8 text: save it as UTF-8", name, line, column)) from None


_WHERE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")


def read_toml(text: str, name: str) -> tuple[dict[str, Any], Source]:
    """Return the raw tables of a TOML text, and where each key is.

    Parameters
    ----------
    text : str
        The content of a file.
    name : str
        Its name in messages.

    Returns
    -------
    tables : dict
    source : Source
        Gives faults their line and column.

    Raises
    ------
    InputError
        The text is not TOML.
    """
    try:
        return tomllib.loads(text), Source(name, locate(text))
    except RecursionError:
        raise InputError(Fault("", "is nested too deeply", name)) from None
    except ValueError as error:
        raise InputError(_syntax_fault(str(error), text, name)) from None


def _syntax_fault(message: str, text: str, name: str) -> Fault:
    match = _WHERE.search(message)
    if match and match[1]:
        line, column = int(match[1]), int(match[2])
    else:
        lines = text.rstrip().split("\n")
        line, column = len(lines), len(lines[-1]) + 1
    return Fault("", f"not valid TOML: {_WHERE.sub('', message)}", name, line, column)
