"""Generated modules: written under a name that hashes all that they depend on, then imported.

numba's own cache watches only the file of the compiled function, so the name must change with the source of every law.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import ModuleType

import numba

from .. import cache
from ..kernels.options import HELPER
from ..modules import import_file, import_lock

ENGINE = "thirdbody"


def sources(functions: Iterable[Callable]) -> str:
    """A digest of every source file that these functions can depend on (`source_files`)."""
    digest = hashlib.sha256()
    for file in source_files(functions):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def plain(function: Callable) -> Callable:
    """The Python function behind a compiled one."""
    return function.py_func if hasattr(function, "py_func") else function


def taken(kernel: Callable) -> Callable:
    """The same kernel for kernels only: without what Python needs to call it, which takes as long to compile as most laws."""
    if plain(kernel) is kernel:
        return kernel
    options = {name: value for name, value in vars(kernel)["targetoptions"].items() if name != "nopython"}
    return numba.njit(**options | {name: HELPER[name] for name in HELPER if name != "error_model"})(plain(kernel))


def source_files(functions: Iterable[Callable]) -> list[Path]:
    """Every source file that a law's result can depend on.

    The whole package of the law, or the file of a one-file plug-in, and all modules that can be reached from there through
    names (functions, classes, constants of a module, modules), but for installed libraries, whose versions are fixed. Of this
    engine only what the law can reach counts, not the whole package.
    """
    files: set[Path] = set()
    waiting = [sys.modules[plain(function).__module__] for function in functions]
    own = {module.__name__.partition(".")[0] for module in waiting}
    seen: set[str] = set()
    while waiting:
        module = waiting.pop()
        file = getattr(module, "__file__", None)
        if module.__name__ in seen or file is None or not file.endswith(".py"):
            continue
        seen.add(module.__name__)
        files.add(Path(file))
        top = sys.modules.get(module.__name__.partition(".")[0])
        if top is not None and top.__name__ != ENGINE and getattr(top, "__path__", None) and top.__file__ is not None:
            files.update(Path(top.__file__).parent.rglob("*.py"))
        waiting += [found for found in _named_in(module) if not _installed(found, own)]
    return sorted(files)


def _named_in(module: ModuleType) -> list[ModuleType]:
    """Modules that a module's names come from."""
    values = list(vars(module).values())
    names = {getattr(value, "__module__", None) for value in values}
    names |= {getattr(plain(value), "__module__", None) for value in values if callable(value)}
    found = [value for value in values if isinstance(value, ModuleType)]
    return found + [sys.modules[name] for name in names if isinstance(name, str) and name in sys.modules]


def _installed(module: ModuleType, own: set[str]) -> bool:
    """Whether a module belongs to Python, to this engine (the cache folder's name hashes it), or to an installed library."""
    top = module.__name__.partition(".")[0]
    if top in own:
        return False
    parts = Path(getattr(module, "__file__", None) or "").parts
    return top in sys.stdlib_module_names or top == "thirdbody" or "site-packages" in parts or "dist-packages" in parts


def load(kind: str, text: str, functions: Sequence[Callable]) -> tuple[ModuleType, Path]:
    """Write the generated text under a name that hashes all it depends on, and import it; several threads may."""
    digest = hashlib.sha256(text.encode() + numba.__version__.encode())
    for file in source_files(functions):
        digest.update(file.read_bytes())
    name = f"thirdbody_{kind}_{digest.hexdigest()[:20]}"
    path = cache.folder() / f"{name}.py"
    with import_lock:
        if name not in sys.modules:
            if not path.exists():
                draft = path.with_suffix(f".{os.getpid()}")
                draft.write_text(text)
                os.replace(draft, path)  # atomic: several processes may race for the same name
            import_file(name, path)
        return sys.modules[name], path
