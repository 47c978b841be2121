"""Reading of a TOML file: its raw document, and line and column of every key, which tomllib does not report."""

from __future__ import annotations

import os
import re
import tomllib
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from pydantic import ValidationError

from thirdbody.errors import SETTINGS, Fault, InputError
from thirdbody.input_files import read_bytes
from thirdbody.schema.parts import MISSING, Location, Part, Wrong, key_path, wrongs_of

Checked = TypeVar("Checked", bound=Part)

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
    """Return the text of a file. Raises InputError with the reason why it cannot be read."""
    data = read_bytes(path, what="scene file", largest=MAX_BYTES)
    try:
        return data.decode("utf-8-sig")  # some editors write a byte order mark
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = len(data[: error.start].rpartition(b"\n")[2].decode("utf-8", "replace")) + 1
        raise InputError(Fault("", "is not UTF-8 text: save it as UTF-8", os.fspath(path), line, column)) from None


_WHERE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")


def read_toml(text: str, name: str) -> tuple[dict[str, Any], Source]:
    """Return the raw tables of a TOML text, and where each key is. Raises InputError. `name` is that of the file in messages."""
    try:
        return tomllib.loads(text), Source(name, locate(text))
    except RecursionError:
        raise InputError(Fault("", "is nested too deeply", name)) from None
    except ValueError as error:
        match = _WHERE.search(str(error))
        lines = text.rstrip().split("\n")
        line, column = (int(match[1]), int(match[2])) if match and match[1] else (len(lines), len(lines[-1]) + 1)
        raise InputError(Fault("", f"not valid TOML: {_WHERE.sub('', str(error))}", name, line, column)) from None


def with_version(document: dict[str, Any], key: str, version: int) -> list[Wrong]:
    """Return a fault for a document without its version, which it gets, so that its other faults are reported too."""
    if key in document:
        return []
    document[key] = version
    return [((key,), f"{MISSING}: write {key} = {version}")]


def checked(part: type[Checked], document: dict[str, Any], source: Source, faults: list[Wrong], context: Any) -> Checked:
    """Return the checked table. Raises InputError with the faults given and those of the document, in its order."""
    try:
        result = part.model_validate(document, context=context)
    except ValidationError as error:
        faults = faults + wrongs_of(error)
    if faults:
        raise InputError(source.in_order(faults))
    return result


def read_part(part: type[Checked], path: str | os.PathLike[str], key: str, version: int) -> Checked:
    """Return the table that a TOML file is.

    Parameters
    ----------
    part : type
        A class derived from `Part`.
    path : str or Path
        The file.
    key : str
        Key of its version.
    version : int
        The version to write where it is missing.

    Returns
    -------
    Part

    Raises
    ------
    InputError
        With every fault, each with file, line and column.
    """
    document, source = read_toml(read_text(path), os.fspath(path))
    return checked(part, document, source, with_version(document, key, version), {"file": True})


_VOID = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_KEY_PART = re.compile(r"""[ \t]*([A-Za-z0-9_-]+|"(?:[^"\\\n]|\\.)*"|'[^'\n]*')[ \t]*(\.?)""")
_VALUE = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}(?!")|'
    r"'''.*?'{3,5}(?!')|"
    r'"(?:[^"\\\n]|\\.)*"|'
    r"'[^'\n]*'|"
    r"[^,\]}#\n]*",
    re.DOTALL,
)


def locate(text: str) -> dict[Location, tuple[int, int]]:
    """Return the position (line, column; both from 1) by place: keys at the key, list entries at the value.

    Only for text that tomllib has accepted: the scanner assumes valid syntax and does not check it.
    """
    return _Scanner(text.replace("\r\n", "\n")).positions


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text, self.at = text, 0
        self.line_starts = [0, *(match.end() for match in re.finditer("\n", text))]
        self.positions: dict[Location, tuple[int, int]] = {}
        self.lengths: dict[Location, int] = {}  # of arrays of tables
        table: Location = ()
        self._next(_VOID)
        while self.at < len(text):
            if text[self.at] == "[":
                table = self._header()
            else:
                self._assignment(table)
            self._next(_VOID)

    def _next(self, pattern: re.Pattern[str]) -> re.Match[str]:
        match = pattern.match(self.text, self.at)
        assert match is not None, "the scanner met text that tomllib cannot have accepted"
        self.at = match.end()
        return match

    def _mark(self, location: Location, start: int) -> None:
        line = bisect_right(self.line_starts, start)
        self.positions.setdefault(location, (line, start - self.line_starts[line - 1] + 1))

    def _header(self) -> Location:
        """Read [a.b] or [[a.b]]: return the place of the following keys."""
        start, brackets = self.at, 2 if self.text.startswith("[[", self.at) else 1
        self.at += brackets
        parts = self._key()
        self.at += brackets
        location: Location = ()
        for i, part in enumerate(parts, 1):
            location += (part,)
            if brackets == 2 and i == len(parts):
                self.lengths[location] = self.lengths.get(location, 0) + 1
            self._mark(location, start)
            if location in self.lengths:
                location += (self.lengths[location] - 1,)
                self._mark(location, start)
        return location

    def _key(self) -> list[str]:
        parts, dot = [], "."
        while dot:
            word, dot = self._next(_KEY_PART).groups()
            parts.append(next(iter(tomllib.loads(f"{word} = 0"))) if word[0] in "\"'" else word)
        return parts

    def _assignment(self, location: Location) -> None:
        start = self.at
        for part in self._key():
            location += (part,)
            self._mark(location, start)
        self.at += 1  # the equals sign
        self._next(_VOID)
        self._value(location)

    def _value(self, location: Location) -> None:
        end = {"[": "]", "{": "}"}.get(self.text[self.at])
        if end is None:
            self._next(_VALUE)
            return
        self.at += 1
        self._next(_VOID)
        index = 0
        while self.text[self.at] != end:
            if end == "}":
                self._assignment(location)
            else:
                self._mark((*location, index), self.at)
                self._value((*location, index))
            index += 1
            self._next(_VOID)
            if self.text[self.at] == ",":
                self.at += 1
                self._next(_VOID)
        self.at += 1
