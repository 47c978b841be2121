"""Line and column of every key and list entry in a TOML text, which tomllib does not report.

Only for text that tomllib has accepted: the scanner assumes valid syntax and does not check it.
"""

import re
import tomllib
from bisect import bisect_right

from thirdbody.scene.schema_base import Location

_BLANK = re.compile(r"[ \t]*")
_VOID = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_KEY_PART = re.compile(r"""[A-Za-z0-9_-]+|"(?:[^"\\\n]|\\.)*"|'[^'\n]*'""")
_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}(?!")|'
    r"'''.*?'{3,5}(?!')|"
    r'"(?:[^"\\\n]|\\.)*"|'
    r"'[^'\n]*'",
    re.DOTALL,
)
_BARE_VALUE = re.compile(r"[^,\]}#\n]*")


def locate(text: str) -> dict[Location, tuple[int, int]]:
    """Return the position (line, column; both from 1) by place: keys at the key, list entries at the value."""
    scanner = _Scanner(text.replace("\r\n", "\n"))
    scanner.document()
    return scanner.positions


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.line_starts = [0, *(match.end() for match in re.finditer("\n", text))]
        self.positions: dict[Location, tuple[int, int]] = {}
        self.lengths: dict[Location, int] = {}  # of arrays of tables

    def document(self) -> None:
        table: Location = ()
        self._skip(_VOID)
        while self.at < len(self.text):
            if self._peek("["):
                table = self._header()
            else:
                self._assignment(table)
            self._skip(_VOID)

    def _peek(self, text: str) -> bool:
        return self.text.startswith(text, self.at)

    def _skip(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.at)
        assert match is not None, "the scanner met text that tomllib cannot have accepted"
        self.at = match.end()
        return match[0]

    def _mark(self, location: Location, start: int) -> None:
        line = bisect_right(self.line_starts, start)
        self.positions.setdefault(location, (line, start - self.line_starts[line - 1] + 1))

    def _header(self) -> Location:
        """Read [a.b] or [[a.b]]: return the place of the following keys."""
        start, double = self.at, self._peek("[[")
        self.at += 2 if double else 1
        parts = self._key()
        self.at += 2 if double else 1
        location: Location = ()
        for i, part in enumerate(parts):
            location += (part,)
            if double and i == len(parts) - 1:
                self.lengths[location] = self.lengths.get(location, 0) + 1
            self._mark(location, start)
            if location in self.lengths:
                location += (self.lengths[location] - 1,)
                self._mark(location, start)
        return location

    def _key(self) -> list[str]:
        parts = []
        while True:
            self._skip(_BLANK)
            token = self._skip(_KEY_PART)
            parts.append(next(iter(tomllib.loads(f"{token} = 0"))) if token[0] in "\"'" else token)
            self._skip(_BLANK)
            if not self._peek("."):
                return parts
            self.at += 1

    def _assignment(self, table: Location) -> None:
        start, location = self.at, table
        for part in self._key():
            location += (part,)
            self._mark(location, start)
        self.at += 1  # the equals sign
        self._skip(_BLANK)
        self._value(location)

    def _value(self, location: Location) -> None:
        if self._peek("["):
            self._list(location)
        elif self._peek("{"):
            self._inline(location)
        elif self._peek('"') or self._peek("'"):
            self._skip(_STRING)
        else:
            self._skip(_BARE_VALUE)

    def _list(self, location: Location) -> None:
        self.at += 1
        self._skip(_VOID)
        index = 0
        while not self._peek("]"):
            self._mark((*location, index), self.at)
            self._value((*location, index))
            index += 1
            self._separator()
        self.at += 1

    def _inline(self, location: Location) -> None:
        self.at += 1
        self._skip(_VOID)
        while not self._peek("}"):
            self._assignment(location)
            self._separator()
        self.at += 1

    def _separator(self) -> None:
        self._skip(_VOID)
        if self._peek(","):
            self.at += 1
            self._skip(_VOID)
