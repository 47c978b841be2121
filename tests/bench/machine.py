"""What a measurement was made on, and where it is printed."""

from rich.console import Console
from thirdbody.studies import timing


def screen() -> Console:
    """The terminal as wide as it is; a file or a pipe, whose width is not known, wide enough for every table."""
    return Console() if Console().is_terminal else Console(width=150)


def head(console: Console) -> None:
    report = timing.machine()
    console.print(f"{timing.described(report)}, {report['cores']} cores, load {report['load']}")
