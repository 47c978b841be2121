"""Starter files: the scenes and the plug-in template installed with the program, and copies of them."""

import os
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from thirdbody.atomic_files import write_whole
from thirdbody.errors import MissingLibrary, OutputError, UsageError, nearest

SCENES = "thirdbody_scenes"
TEMPLATE, TEMPLATE_FILE = "thirdbody_template", "dmt_adhesion.py"


def questions() -> dict[str, str]:
    """Return the shipped scenes by name, each with the question in its first line; those in folders come last."""
    folder = _folder(SCENES)
    files = sorted(folder.glob("**/*.toml"), key=lambda file: (len(file.relative_to(folder).parts), file))
    return {file.relative_to(folder).with_suffix("").as_posix(): _first_line(file) for file in files}


def copy_scene(name: str, path: Path) -> list[Path]:
    """Copy a shipped scene to `path`, and the files that it names into the same folder; return the written paths.

    Raises UsageError for an unknown name, and OutputError, with nothing written, where another file exists.
    """
    name = name.removesuffix(".toml")
    if name not in questions():
        raise UsageError(f"--from {name}: no such scene, {nearest(name, questions())}")
    source = _folder(SCENES) / f"{name}.toml"
    named = {path.parent / word: file.read_bytes() for word, file in _named(source).items()}
    return write_new({path: source.read_bytes()} | named)


def next_command(name: str) -> str:
    """Return the command to start with, for a shipped file of this name."""
    if name.startswith("balance/"):
        return "balance"
    document = tomllib.loads((_folder(SCENES) / f"{name}.toml").read_text(encoding="utf-8"))
    return "sweep --dry-run" if "sweep" in document else "check"


def copy_template(path: Path) -> list[Path]:
    """Copy the plug-in template to `path`. Raises OutputError."""
    return write_new({path: (_folder(TEMPLATE) / TEMPLATE_FILE).read_bytes()})


def write_new(files: dict[Path, bytes]) -> list[Path]:
    """Write files that must not exist yet, all or none; existing files with the same content may stay.

    Returns the written paths. Raises OutputError.
    """
    first = next(iter(files))
    missing = {path: content for path, content in files.items() if not _is_there(path, content) or path == first}
    for path in missing:
        if os.path.lexists(path):
            raise OutputError(f"{path}: exists already")
    written: list[Path] = []
    try:
        for path, content in missing.items():
            write_whole(path, content)
            written.append(path)
    except OSError as error:
        for done in written:
            done.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    return written


def _is_there(path: Path, content: bytes) -> bool:
    return os.path.isfile(path) and path.read_bytes() == content


def _folder(package: str) -> Path:
    """Return the folder of a package of data files. Raises MissingLibrary if it is not installed."""
    spec = find_spec(package)
    for location in (spec.submodule_search_locations if spec else None) or ():
        if Path(location).is_dir():  # an editable install also lists a folder that does not exist
            return Path(location)
    raise MissingLibrary(f"{package} is not installed with this copy of thirdbody; install it again, such as by pip install .")


def _first_line(file: Path) -> str:
    with open(file, encoding="utf-8") as lines:
        return lines.readline().lstrip("# ").rstrip()


def _named(source: Path) -> dict[str, Path]:
    """Return the files that a scene or a sweep names, and those that its scene names, by their names there."""
    files: dict[str, Path] = {}
    for word in _words(tomllib.loads(source.read_text(encoding="utf-8"))):
        if (file := source.parent / word).is_file():
            files |= {word: file} | (_named(file) if file.suffix == ".toml" else {})
    return files


def _words(value: Any) -> Iterator[str]:
    """Yield every text among the values of a document."""
    if isinstance(value, str):
        yield value
    for entry in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _words(entry)
