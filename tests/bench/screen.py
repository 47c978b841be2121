"""Where a benchmark prints."""

from rich.console import Console


def screen() -> Console:
    """The terminal as wide as it is; a file or a pipe, whose width is not known, wide enough for every table."""
    return Console() if Console().is_terminal else Console(width=150)
