"""The command that writes starter files. Heavy modules are imported inside it, as in `main`."""

from pathlib import Path
from typing import Annotated

import typer

from thirdbody.errors import UsageError
from thirdbody.system.terminal import print_line


def _names(incomplete: str) -> list[str]:
    """Return the names of shipped scenes, for shell completion."""
    from thirdbody.cli.starter_files import questions

    return [name for name in questions() if name.startswith(incomplete)]


def new(
    path: Annotated[Path | None, typer.Argument(metavar="FILE", help="file to write [scene.toml, NAME.toml, my_law.py]")] = None,
    source: Annotated[
        str | None, typer.Option("--from", metavar="NAME", help="copy this shipped scene and its files", autocompletion=_names)
    ] = None,
    plugin: Annotated[bool, typer.Option("--plugin", help="write the template of a plug-in with a contact law")] = False,
    listed: Annotated[bool, typer.Option("--list", help="list the shipped scenes and the question that each answers")] = False,
    json: Annotated[bool, typer.Option("--json", help="print the list as JSON")] = False,
) -> None:
    """Write a small scene to start from, a copy of a shipped one, or a plug-in."""
    from thirdbody.cli.starter_files import copy_scene, copy_template, next_command, write_new
    from thirdbody.scene.keys import TEMPLATE

    if listed:
        _list(json)
        return
    if json:
        raise UsageError("--json: only with --list")
    if source is not None and plugin:
        raise UsageError("--from copies a scene and --plugin writes a plug-in: give one of them")
    if plugin:
        written, then = copy_template(path or Path("my_law.py")), "laws --check"
    elif source is not None:
        name = source.removesuffix(".toml")
        written = copy_scene(name, path or Path(f"{Path(name).name}.toml"))
        then = next_command(name)
    else:
        written, then = write_new({path or Path("scene.toml"): TEMPLATE.encode()}), "check"
    print_line(f"{', '.join(map(str, written))} written; next: thirdbody {then} {written[0]}")


def _list(json: bool) -> None:
    from thirdbody.cli.starter_files import questions

    result = questions()
    if json:
        from thirdbody.report.tables import print_json

        print_json([{"name": name, "question": question} for name, question in result.items()])
        return
    width = max(map(len, result))
    for name, question in result.items():
        print_line(f"{name:<{width}}  {question}")
    print("\nto start from one of them: thirdbody new my_scene.toml --from NAME")
