"""Line and column of every key and list entry in a TOML text, which tomllib does not report.

Only for text that tomllib has accepted: the scanner assumes valid syntax and does not check it.
"""

import re
import tomllib
from bisect import bisect_right

from thirdbody.scene.schema_base import Place

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


def locate(text: str) -> dict[Place, tuple[int, int]]:
    """Return the position (line, column; both from 1) by place: keys at the key, list entries at the value."""
    scanner = _Scanner(text.replace("\r\n", "\n"))
    scanner.document()
    return scanner.positions


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.line_starts = [0, *(match.end() for match in re.finditer("\n", text))]
        self.positions: dict[Place, tuple[int, int]] = {}
        self.lengths: dict[Place, int] = {}  # of arrays of tables

    def document(self) -> None:
        table: Place = ()
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

    def _mark(self, place: Place, start: int) -> None:
        line = bisect_right(self.line_starts, start)
        self.positions.setdefault(place, (line, start - self.line_starts[line - 1] + 1))

    def _header(self) -> Place:
        """Read [a.b] or [[a.b]]: return the place of the following keys."""
        start, double = self.at, self._peek("[[")
        self.at += 2 if double else 1
        parts = self._key()
        self.at += 2 if double else 1
        place: Place = ()
        for i, part in enumerate(parts):
            place += (part,)
            if double and i == len(parts) - 1:
                self.lengths[place] = self.lengths.get(place, 0) + 1
            self._mark(place, start)
            if place in self.lengths:
                place += (self.lengths[place] - 1,)
                self._mark(place, start)
        return place

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

    def _assignment(self, table: Place) -> None:
        start, place = self.at, table
        for part in self._key():
            place += (part,)
            self._mark(place, start)
        self.at += 1  # the equals sign
        self._skip(_BLANK)
        self._value(place)

    def _value(self, place: Place) -> None:
        if self._peek("["):
            self._list(place)
        elif self._peek("{"):
            self._inline(place)
        elif self._peek('"') or self._peek("'"):
            self._skip(_STRING)
        else:
            self._skip(_BARE_VALUE)

    def _list(self, place: Place) -> None:
        self.at += 1
        self._skip(_VOID)
        index = 0
        while not self._peek("]"):
            self._mark((*place, index), self.at)
            self._value((*place, index))
            index += 1
            self._separator()
        self.at += 1

    def _inline(self, place: Place) -> None:
        self.at += 1
        self._skip(_VOID)
        while not self._peek("}"):
            self._assignment(place)
            self._separator()
        self.at += 1

    def _separator(self) -> None:
        self._skip(_VOID)
        if self._peek(","):
            self.at += 1
            self._skip(_VOID)
