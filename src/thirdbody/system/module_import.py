"""Import of Python modules from files outside packages: generated code and one-file plug-ins."""

import importlib.util
import sys
import threading
from pathlib import Path
from types import ModuleType

# Held from the test for a module until its import is complete: `sys.modules` lists a module before it has been executed.
import_lock = threading.RLock()


def import_file(name: str, path: Path) -> ModuleType:
    """Import the file as the module `name`; a failed one is removed. Raises ImportError, and what the file raises."""
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path}: not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def import_text(name: str, path: Path, text: str) -> ModuleType:
    """Import a text as the module `name` of the file that holds it, without Python's own file cache, which may be damaged."""
    module = ModuleType(name)
    module.__file__ = str(path)
    code = compile(text, str(path), "exec")
    sys.modules[name] = module
    try:
        exec(code, vars(module))
    except BaseException:
        del sys.modules[name]
        raise
    return module
