"""The command that looks up keys and names. Heavy modules are imported inside it, as in `main`."""

from pathlib import Path
from typing import Annotated

import typer


def keys(
    word: Annotated[str | None, typer.Argument(metavar="WORD", help="part of a name, or a word of its meaning [all]")] = None,
    plugin: Annotated[list[Path] | None, typer.Option("--plugin", help="Python file with a PLUGIN; may be repeated")] = None,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """Look up keys of a scene file, series and arrays of a run: units, limits, defaults, meanings, examples."""
    from thirdbody.report.key_reference import keys_report

    keys_report(word, plugin or (), json)
