"""What can go wrong, and the exit code the command line gives it. Imports nothing, so every layer may use it."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from unicodedata import category


class ThirdbodyError(Exception):
    """Base of every error that is told to the user in one message and no traceback."""

    exit_code = 1

    def __init__(self, message: str, *, python: str = "", command: str = "") -> None:
        """Make an error whose message ends with `python`, or on the command line with `command`: what to do about it."""
        super().__init__(printable(message + python))
        self.message, self.command = message, command

    def for_command_line(self) -> str:
        """Return the message in the words of the command line."""
        return printable(self.message + self.command)


class UsageError(ThirdbodyError):
    """The command was called in a way that cannot work."""

    exit_code = 2


SETTINGS = "with_settings"
"""Stands for the file of a fault in a value that was replaced, which the command line does by --set."""


@dataclass(frozen=True)
class Fault:
    """One fault of the input: where it stands, under which key, and what is wrong."""

    key: str
    message: str
    file: str | None = None
    line: int | None = None
    column: int | None = None
    python: str = ""  # what to do about it, at the end of the message
    command: str = ""  # the same in the words of the command line

    def __str__(self) -> str:
        return self._text(self.file, self.python)

    def for_command_line(self) -> str:
        """Return the fault in the words of the command line."""
        return self._text("--set" if self.file == SETTINGS else self.file, self.command)

    def _text(self, file: str | None, remedy: str) -> str:
        place = ":".join(str(part) for part in (_short(file), self.line, self.column) if part is not None)
        return printable(": ".join(part for part in (place, _short(self.key), self.message + remedy) if part))


def printable(text: str) -> str:
    """The text with control characters written out: what a file holds must not steer the terminal, nor forge a line.

    So are marks of direction, lone surrogates and line breaks; blanks of other scripts are not.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or category(c) == "Zs" else c.encode("unicode_escape").decode("ascii") for c in text)


def _short(name: str | None) -> str | None:
    """A name of bearable length: a hostile one may fill pages."""
    return name if name is None or len(name) <= 250 else f"{name[:247]}..."


MOST_TOLD = 200
"""Faults that one message tells; `InputError.faults` has all of them."""


class InputError(ThirdbodyError):
    """The scene, a file that it names, or an option is wrong; carries every fault that was found."""

    exit_code = 3

    def __init__(self, faults: Fault | str | Iterable[Fault]):
        if isinstance(faults, str):
            faults = Fault("", faults)
        self.faults: list[Fault] = [faults] if isinstance(faults, Fault) else list(faults)
        super().__init__("")
        self.message = self._lines(str)
        self.args = (self.message,)  # of several lines, each printable already

    def for_command_line(self) -> str:
        """Return the faults in the words of the command line."""
        return self._lines(Fault.for_command_line)

    def _lines(self, text: Callable[[Fault], str]) -> str:
        lines = [text(fault) for fault in self.faults[:MOST_TOLD]]
        if len(self.faults) > MOST_TOLD:
            lines.append(f"and {len(self.faults) - MOST_TOLD} more faults")
        return "\n".join(lines)


class GuardStop(ThirdbodyError):
    """A run left its valid range; what it had computed is kept."""

    exit_code = 4


class Interrupted(ThirdbodyError):
    """The user or the system asked the run to end; what it had computed is kept."""

    exit_code = 130
    advanced = True
    """False for a run that was asked to end again before it was taken up: it is what it was."""


class OutputError(ThirdbodyError):
    """The disk is full, the folder is read-only or exists already."""

    exit_code = 5


class MissingLibrary(ThirdbodyError):
    """A system library that this command needs is not there; the message says what to install."""

    exit_code = 5


def nearest(word: str, known: Iterable[str]) -> str:
    """A phrase that offers the nearest known name, or lists them all; empty when nothing is known."""
    names = sorted(str(name) for name in known)
    close = difflib.get_close_matches(word, names, 1, 0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    return f"known: {', '.join(names)}" if names else ""
