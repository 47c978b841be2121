"""Errors and their exit codes on the command line. Imports nothing, so every package may use it."""

from collections.abc import Callable, Iterable
from typing import NamedTuple
from unicodedata import category

EXIT_CODES = {
    0: "Done.",
    1: "A bug of this program: please report it.",
    2: "Wrong command, option or argument.",
    3: "Wrong input: a scene, a file, or a refused resume.",
    4: "Stopped by a guard: the run left its valid range; what was computed is kept.",
    5: "Disk full, no permission, no memory, or a missing system library.",
    129: "Interrupted by a closed terminal (SIGHUP), after a checkpoint.",
    130: "Interrupted by Ctrl-C, after a checkpoint.",
    143: "Interrupted by SIGTERM, after a checkpoint.",
}
"""Meaning of each exit code of the command line."""


class ThirdbodyError(Exception):
    """Base of every error that is reported to the user in one message without a traceback."""

    exit_code = 1

    def __init__(self, message: str, *, python: str = "", command: str = "") -> None:
        """Store a message that ends with the remedy: `python`, or on the command line `command`."""
        super().__init__(printable(message + python))
        self.message, self.command = message, command

    def for_command_line(self) -> str:
        """Return the message with the remedy for the command line."""
        return printable(self.message + self.command)


class ThirdbodyWarning(UserWarning):
    """What a scene or a run is warned of, as the command line prints it; also in `Run.warnings` and the run's `run.log`."""


class UsageError(ThirdbodyError):
    """The arguments of a command or function cannot work."""

    exit_code = 2


SETTINGS = "with_settings"
"""Value of `Fault.file` for a fault in a value that was replaced, on the command line by --set."""


class Fault(NamedTuple):
    """One fault of the input: file, line and column, key, and what is wrong."""

    key: str
    message: str
    file: str | None = None
    line: int | None = None
    column: int | None = None
    python: str = ""  # remedy, at the end of the message
    command: str = ""  # the same for the command line

    def __str__(self) -> str:
        return self._text(self.file, self.python)

    def for_command_line(self) -> str:
        """Return the fault with the remedy for the command line."""
        return self._text("--set" if self.file == SETTINGS else self.file, self.command)

    def _text(self, file: str | None, remedy: str) -> str:
        position = ":".join(str(part) for part in (short(file), self.line, self.column) if part is not None)
        return printable(": ".join(part for part in (position, short(self.key), self.message + remedy) if part))


def printable(text: str) -> str:
    """Return the text with control characters escaped: the content of a file must not control the terminal, nor forge a line.

    Marks of direction, lone surrogates and line breaks are escaped too; blanks of other scripts are not.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or category(c) == "Zs" else c.encode("unicode_escape").decode("ascii") for c in text)


def short(name: str | None) -> str | None:
    """Return a name shortened to 250 characters: one in a malicious file may fill pages."""
    return name if name is None or len(name) <= 250 else f"{name[:247]}..."


PLUGIN_FILE = "one in a file needs --plugin FILE (in Python plugins=[FILE])"

MAX_REPORTED = 200
"""Largest number of faults in one message; `InputError.faults` has all of them."""


class InputError(ThirdbodyError):
    """The scene, a file that it names, or an option is wrong; carries all faults."""

    exit_code = 3

    def __init__(self, faults: Fault | str | Iterable[Fault]):
        if isinstance(faults, str):
            faults = Fault("", faults)
        self.faults: list[Fault] = [faults] if isinstance(faults, Fault) else list(faults)
        super().__init__("")
        self.message = self._lines(str)
        self.args = (self.message,)  # several lines, each printable already

    def for_command_line(self) -> str:
        """Return the faults with the remedies for the command line."""
        return self._lines(Fault.for_command_line)

    def _lines(self, text: Callable[[Fault], str]) -> str:
        lines = [text(fault) for fault in self.faults[:MAX_REPORTED]]
        if len(self.faults) > MAX_REPORTED:
            lines.append(f"and {len(self.faults) - MAX_REPORTED} more faults")
        return "\n".join(lines)


class GuardStop(ThirdbodyError):
    """A run left its valid range; the results up to that point are saved."""

    exit_code = 4


class Interrupted(ThirdbodyError):
    """The user or the system asked the run to end; the results up to that point are saved."""

    exit_code = 130
    advanced = True
    """False for a resumed run that was interrupted before its first step: its files are unchanged."""


class OutputError(ThirdbodyError):
    """The disk is full, the folder is read-only or exists already."""

    exit_code = 5


class MissingLibrary(ThirdbodyError):
    """A system library that this command needs is missing; the message says what to install."""

    exit_code = 5


def nearest(word: str, known: Iterable[str]) -> str:
    """Return a phrase that suggests the nearest known name, or lists all.

    Parameters
    ----------
    word : str
        The unknown name.
    known : iterable of str
        The known ones.

    Returns
    -------
    str
        Empty when nothing is known.

    Examples
    --------
    >>> plugin.nearest("mindlim", ["coulomb", "mindlin"])
    "did you mean 'mindlin'?"
    """
    import difflib

    names = sorted(str(name) for name in known)
    close = difflib.get_close_matches(word, names, 1, 0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    return f"known: {', '.join(names)}" if names else ""
