"""The command that looks up keys and names. Heavy modules are imported inside it, as in `main`."""

from typing import Annotated

import typer

from thirdbody.cli.option_groups import Json, Plugins


def keys(
    word: Annotated[str | None, typer.Argument(metavar="WORD", help="part of a name, or a word of its meaning [all]")] = None,
    plugin: Plugins = None,
    json: Json = False,
) -> None:
    """Look up keys of a scene file, series and arrays of a run: units, limits, defaults, meanings, examples."""
    from thirdbody.report.reference import keys_report

    keys_report(word, plugin or (), json)
