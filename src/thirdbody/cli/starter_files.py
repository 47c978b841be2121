"""Starter files, and the command that writes them: the scenes and the plug-in template installed with the program."""

import os
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from thirdbody.atomic_files import write_output
from thirdbody.errors import MissingLibrary, OutputError, UsageError, nearest
from thirdbody.system.terminal import print_line

SCENES = "thirdbody_scenes"
TEMPLATES = "thirdbody_template"


def _completions(incomplete: str) -> list[str]:
    return [name for name in questions() if name.startswith(incomplete)]


def new(
    path: Annotated[Path | None, typer.Argument(metavar="FILE", help="file to write [scene.toml, NAME.toml, my_law.py]")] = None,
    source: Annotated[
        str | None,
        typer.Option("--from", metavar="NAME", help="copy this shipped scene and its files", autocompletion=_completions),
    ] = None,
    plugin: Annotated[bool, typer.Option("--plugin", help="write the template of a plug-in with a contact law")] = False,
    listed: Annotated[bool, typer.Option("--list", help="list the shipped scenes and the question that each answers")] = False,
    json: Annotated[bool, typer.Option("--json", help="print the list as JSON")] = False,
) -> None:
    """Write a small scene to start from, a copy of a shipped one, or a plug-in."""
    if listed:
        _list(json)
        return
    if json:
        raise UsageError("--json: only with --list")
    if source is not None and plugin:
        raise UsageError("--from copies a scene and --plugin writes a plug-in: give one of them")
    if source is not None:
        name = source.removesuffix(".toml")
        written = copy_scene(name, path or Path(f"{Path(name).name}.toml"))
        is_sweep = "sweep" in _document(written[0])
        then = "balance" if name.startswith("balance/") else "sweep --dry-run" if is_sweep else "check"
    else:
        scene, law = ("new_scene.toml", "scene.toml", "check"), ("dmt_adhesion.py", "my_law.py", "laws --check")
        template, name, then = law if plugin else scene
        written = write_new({path or Path(name): (_folder(TEMPLATES) / template).read_bytes()})
    print_line(f"{', '.join(map(str, written))} written; next: thirdbody {then} {written[0]}")


def _list(json: bool) -> None:
    result = questions()
    if json:
        from thirdbody.report.tables import print_json

        print_json([{"name": name, "question": question} for name, question in result.items()])
        return
    width = max(map(len, result))
    for name, question in result.items():
        print_line(f"{name:<{width}}  {question}")
    print("\nto start from one of them: thirdbody new my_scene.toml --from NAME")


def questions() -> dict[str, str]:
    """Return the shipped scenes by name, each with the question in its first line; those in folders come last."""
    folder = _folder(SCENES)
    files = sorted(folder.glob("**/*.toml"), key=lambda file: (len(file.relative_to(folder).parts), file))
    result = {}
    for file in files:
        with open(file, encoding="utf-8") as lines:
            result[file.relative_to(folder).with_suffix("").as_posix()] = lines.readline().lstrip("# ").rstrip()
    return result


def copy_scene(name: str, path: Path) -> list[Path]:
    """Copy a shipped scene to `path`, and the files that it names into the same folder; return the written paths.

    Raises UsageError for an unknown name, and OutputError, with nothing written, where another file exists.
    """
    if name not in questions():
        raise UsageError(f"--from {name}: no such scene, {nearest(name, questions())}")
    source = _folder(SCENES) / f"{name}.toml"
    # a sweep names a scene in the folder above it: the copy lies beside the sweep
    copy = source.read_bytes().replace(b'"../', b'"')
    return write_new({path: copy} | {path.parent / file.name: file.read_bytes() for file in _named(source)})


def write_new(files: dict[Path, bytes]) -> list[Path]:
    """Write files that must not exist yet, all or none; existing files with the same content may stay, but not the first.

    Returns the written paths. Raises OutputError.
    """
    first, *others = files
    missing = [first, *(path for path in others if not (os.path.isfile(path) and path.read_bytes() == files[path]))]
    for path in missing:
        if os.path.lexists(path):
            raise OutputError(f"{path}: exists already")
    written: list[Path] = []
    try:
        for path in missing:
            write_output(path, files[path])
            written.append(path)
    except OutputError:
        for done in written:
            done.unlink(missing_ok=True)
        raise
    return written


def _folder(package: str) -> Path:
    """Return the folder of a package of data files. Raises MissingLibrary if it is not installed."""
    spec = find_spec(package)
    for location in (spec.submodule_search_locations if spec else None) or ():
        if Path(location).is_dir():  # an editable install also lists a folder that does not exist
            return Path(location)
    raise MissingLibrary(f"{package} is not installed with this copy of thirdbody; install it again, such as by pip install .")


def _document(file: Path) -> dict[str, Any]:
    import tomllib  # not at the start of every command

    return tomllib.loads(file.read_text(encoding="utf-8"))


def _named(source: Path) -> list[Path]:
    """Return the files that a scene or a sweep names, and those that its scene names."""
    files: list[Path] = []
    for word in _words(_document(source)):
        if (file := source.parent / word).is_file():
            files += [file, *(_named(file) if file.suffix == ".toml" else [])]
    return files


def _words(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    for entry in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _words(entry)
