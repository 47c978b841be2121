"""Name of a point: a hash of its resolved scene, the files that the scene names, and this version of the program."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from thirdbody.scene.model import Scene

PACKAGES = ("assembly", "bodies", "engine", "jit", "kernels", "laws", "runner", "scene", "statics", "trajectory")
"""Packages whose source decides on results."""

FILE_KEYS = ("file", "table")
"""Keys of a scene that name files."""


@cache
def code_version(plugins: tuple[Path, ...] = ()) -> str:
    """Return the hash of the source that decides on results: ours, that of installed plug-ins, and plug-in files."""
    root = Path(__file__).parents[2]
    files = [file for name in PACKAGES for file in sorted((root / name).rglob("*.py"))]
    for point in sorted(entry_points(group="thirdbody.plugins"), key=lambda point: point.name):
        spec = find_spec(point.module.partition(".")[0])
        if spec is not None and spec.origin:
            origin = Path(spec.origin)
            files += sorted(origin.parent.rglob("*.py")) if origin.name == "__init__.py" else [origin]
    digest = hashlib.sha256()
    for file in [*files, *plugins]:
        digest.update(file.read_bytes())
    return digest.hexdigest()


def point_name(text: str, document: Mapping[str, Any], scene: Scene, version: str) -> str:
    """Return the name of the folder of a point, whose scene is `document`, as TOML `text`: 16 hexadecimal digits."""
    digest = hashlib.sha256(f"{version}\n{text}".encode())
    for name in _named_files(document):
        path = scene.beside(name)
        if path.is_file():
            digest.update(_digest(path.absolute(), path.stat().st_mtime_ns))
    return digest.hexdigest()[:16]


@cache
def _digest(path: Path, _time: int) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


def _named_files(value: Any, key: str = "") -> Iterator[str]:
    """Yield the names of files in a document."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _named_files(inner, name)
    elif isinstance(value, list):
        for inner in value:
            yield from _named_files(inner, key)
    elif isinstance(value, str) and key in FILE_KEYS:
        yield value
