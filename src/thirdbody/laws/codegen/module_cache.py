"""Generated modules: written under a name that hashes all dependencies, then imported.

numba's own cache watches only the file of the compiled function, so the name must change with the source of every law.
"""

import hashlib
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from types import ModuleType

import numba

from thirdbody.jit import cache
from thirdbody.jit.options import HELPER
from thirdbody.laws.codegen.dependencies import plain, sources
from thirdbody.system.module_import import import_lock, import_text


def as_kernel(kernel: Callable) -> Callable:
    """Return the kernel without its Python wrapper, which takes as long to compile as most laws; callable from kernels only."""
    if plain(kernel) is kernel:
        return kernel
    options = {name: value for name, value in vars(kernel)["targetoptions"].items() if name != "nopython"}
    return numba.njit(**options | {name: HELPER[name] for name in HELPER if name != "error_model"})(plain(kernel))


def load_module(kind: str, text: str, functions: Sequence[Callable]) -> tuple[ModuleType, Path]:
    """Write the generated text under a name that hashes all its dependencies, and import it. Thread-safe.

    Raises OutputError if it cannot be written.
    """
    digest = hashlib.sha256(f"{text}{numba.__version__}{sources(functions)}".encode())
    name = f"thirdbody_{kind}_{digest.hexdigest()[:20]}"
    path = cache.folder() / f"{name}.py"
    with import_lock:
        if name not in sys.modules:
            try:
                _write(path, text.encode())
            except OSError as error:
                raise cache.cannot_write(path, error) from error
            import_text(name, path, text)
        return sys.modules[name], path


def _write(path: Path, content: bytes) -> None:
    """Write a file if it is missing or damaged: from its content numba decides whether its compiled code is still valid."""
    with suppress(OSError):
        if path.read_bytes() == content:
            return
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    draft = path.with_suffix(f".{os.getpid()}")
    draft.write_bytes(content)
    os.replace(draft, path)  # atomic: several processes may write the same name
