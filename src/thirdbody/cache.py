"""Where compiled code lives between processes: one folder per version of all our sources and of numba.

numba's cache notices a change only in the file of the compiled function itself, not in the functions it inlines; a folder
named by a hash of everything can never serve stale machine code. Must be called before any compiled module is imported.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

from .collector import resting

KEPT = 4
"""Folders of earlier versions that stay, so that switching between two checkouts does not recompile each time."""

_place: Path | None = None
_folder: Path | None = None


def place() -> Path:
    """The cache folder, made if needed; `THIRDBODY_CACHE` overrides its parent. Imports nothing heavy."""
    global _place
    if _place is None:
        base = _parent()
        _place = base / _fingerprint(version("numba"))
        _place.mkdir(parents=True, exist_ok=True)
        os.utime(_place)
        _prune(base)
    return _place


def folder() -> Path:
    """The cache folder, set as numba's."""
    global _folder
    if _folder is None:
        # OpenMP's threads otherwise spin while they wait: with a busy neighbour a step took 12 ms instead of 0.5
        os.environ.setdefault("OMP_WAIT_POLICY", "passive")
        with resting("numba"):
            import numba

        found = place()
        numba.config.CACHE_DIR = str(found)  # type: ignore[attr-defined]
        _folder = found  # last: another thread that sees it takes numba's to be set
    return _folder


def _parent() -> Path:
    named = os.environ.get("THIRDBODY_CACHE")
    home = Path(named) if named else Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "thirdbody"
    try:
        home.mkdir(parents=True, exist_ok=True)
        probe = home / f".{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError:
        # a read-only home: compile into a folder of this user that the system clears
        home = Path(tempfile.gettempdir()) / f"thirdbody-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
        home.mkdir(parents=True, exist_ok=True)
    return home


def _fingerprint(numba_version: str) -> str:
    digest = hashlib.sha256(f"{numba_version} {sys.version}".encode())
    root = Path(__file__).parent
    for layer in ("kernels", "laws", "bodies", "engine"):
        for file in sorted((root / layer).glob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _prune(base: Path) -> None:
    """Drop all of our folders but those used last; that another process has dropped one already is no fault."""
    ours = (p for p in base.iterdir() if p.is_dir() and re.fullmatch("[0-9a-f]{16}", p.name))
    old = sorted(ours, key=lambda p: p.stat().st_mtime, reverse=True)
    for path in old[KEPT:]:
        shutil.rmtree(path, ignore_errors=True)
