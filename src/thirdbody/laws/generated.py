"""Generated modules: written under a name that hashes all that they depend on, then imported.

numba's own cache watches only the file of the compiled function, and compiles the value of a global name into the machine code: a
number, a table that was read from a file, a function of another package. So the name must change with all of them.
"""

import ast
import hashlib
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from enum import Enum
from pathlib import Path
from traceback import walk_tb
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher

from thirdbody.errors import ThirdbodyError
from thirdbody.jit import cache
from thirdbody.jit.options import HELPER
from thirdbody.system.processes import import_file, import_lock

ENGINE = "thirdbody"
LIBRARIES = frozenset({ENGINE, "llvmlite", "numba", "numpy", "scipy"}) | sys.stdlib_module_names
"""Packages that are not searched: the name of the cache folder covers the engine, Python and numba."""

SIMPLE = (type(None), type(Ellipsis), bool, int, float, complex, str, bytes)


def plain(function: Any) -> Any:
    return function.py_func if hasattr(function, "py_func") else function


def sources(functions: Iterable[Callable]) -> str:
    """Return a digest of everything that these functions can depend on: source files, code and values. The files: the whole
    package of the law, or the file of a one-file plug-in, and all modules that can be reached from there through names
    (functions, classes, constants of a module, modules); of installed packages those with functions that the law reaches. Of this
    engine only the modules that the law can reach count, not the whole package."""
    functions = list(functions)
    reached = Reached(functions)
    defining = [getattr(sys.modules.get(name), "__file__", None) for name in reached.modules]
    files = {Path(name) for name in defining if name and name.endswith(".py")}
    waiting = [sys.modules[plain(function).__module__] for function in functions]
    own = {module.__name__.partition(".")[0] for module in waiting}
    visited: set[str] = set()
    while waiting:
        module = waiting.pop()
        file = getattr(module, "__file__", None)
        if module.__name__ in visited or file is None or not file.endswith(".py"):
            continue
        visited.add(module.__name__)
        files.add(Path(file))
        top = sys.modules.get(module.__name__.partition(".")[0])
        if top is not None and top.__name__ != ENGINE and getattr(top, "__path__", None) and top.__file__ is not None:
            files.update(Path(top.__file__).parent.rglob("*.py"))
        values = list(vars(module).values())
        names = {getattr(value, "__module__", None) for value in (*values, *map(plain, filter(callable, values)))}
        named = [value for value in values if isinstance(value, ModuleType)]
        named += [sys.modules[name] for name in names if isinstance(name, str) and name in sys.modules]
        for other in named:
            package = other.__name__.partition(".")[0]
            installed = {"site-packages", "dist-packages"} & {*Path(getattr(other, "__file__", None) or "").parts}
            if package in own or not (installed or package == ENGINE or package in sys.stdlib_module_names):
                waiting.append(other)
    for path in sorted(files):
        reached.digest.update(path.read_bytes())
    return reached.digest.hexdigest()[:16]


class Reached:
    """Code and values that functions reach, wherever they are installed, and the modules that define functions and classes."""

    def __init__(self, functions: Iterable[Callable]) -> None:
        self.digest = hashlib.sha256()
        self.modules: set[str] = set()
        self._visited: dict[tuple[int, frozenset[str]], tuple[int, Any]] = {}
        for function in functions:
            self._value(function, frozenset())

    def _add(self, *words: object) -> None:
        self.digest.update("\0".join([*map(str, words), "\n"]).encode("utf-8", "surrogatepass"))

    def _value(self, value: Any, names: frozenset[str]) -> None:
        """Add a value; `names` are those used by the code that reaches it, including attributes."""
        value = plain(value)
        key = id(value), names if isinstance(value, ModuleType | type) else frozenset()
        if isinstance(value, SIMPLE):
            self._add(type(value).__name__, repr(value))
        elif isinstance(value, np.ndarray | np.generic):
            self._add("array", value.shape, value.dtype)
            if value.dtype.hasobject:
                self._value(value.tolist(), frozenset())
            else:
                self.digest.update(np.ascontiguousarray(value).tobytes())
        elif isinstance(value, set | frozenset):
            self._add(type(value).__name__, *sorted(map(repr, value)))
        elif key in self._visited:
            self._add("visited", self._visited[key][0])
        else:
            self._visited[key] = len(self._visited), value  # reference held, or another object could get its id
            if isinstance(value, CodeType):
                self._code(value)
            elif isinstance(value, list | tuple | dict):
                self._add(type(value).__name__, len(value))
                for part in value if not isinstance(value, dict) else [part for entry in value.items() for part in entry]:
                    self._value(part, names)
            else:
                self._object(value, names)

    def _object(self, value: Any, names: frozenset[str]) -> None:
        owner = value if hasattr(value, "__name__") else type(value)
        self._add(type(value).__name__, getattr(owner, "__module__", ""), getattr(owner, "__qualname__", owner.__name__))
        if isinstance(value, ModuleType):
            if not _of_library(value.__name__):
                self.modules.add(value.__name__)
                self._attributes(vars(value), names)
        elif _of_library(getattr(value, "__module__", None)):
            if owner is not value and " at 0x" not in repr(value):
                self._add(repr(value))  # a numba type, a number type
        elif isinstance(value, FunctionType):
            self.modules.add(value.__module__)
            self._code(value.__code__)
            self._value([value.__defaults__, value.__kwdefaults__], frozenset())
            names = _names_in(value.__code__)
            for cell in value.__closure__ or ():
                self._value(cell.cell_contents, names)
            self._attributes(value.__globals__, names)
        elif isinstance(value, type):
            self.modules.add(value.__module__)
            self._attributes(vars(value), names | {"_fields", "_field_defaults"})
        else:  # a member of an enumeration, numba's wrapper of a function, or any other
            self.modules.add(type(value).__module__)
            self._value(value.value if isinstance(value, Enum) else dict(getattr(value, "__dict__", {})), frozenset())

    def _code(self, code: CodeType) -> None:
        self._add(code.co_name, code.co_argcount, code.co_varnames, code.co_names, code.co_freevars, code.co_cellvars)
        self.digest.update(code.co_code)
        for constant in code.co_consts:
            self._value(constant, frozenset())

    def _attributes(self, space: Mapping[str, Any], names: frozenset[str]) -> None:
        """Add the values of these names in a module or a class; other names are builtins or attributes of other objects."""
        for name in sorted(names & space.keys()):
            self._add(name)
            self._value(space[name], names)


def _names_in(code: CodeType) -> frozenset[str]:
    inner = [_names_in(constant) for constant in code.co_consts if isinstance(constant, CodeType)]
    return frozenset(code.co_names).union(*inner)


def _of_library(module: str | None) -> bool:
    return str(module or "builtins").partition(".")[0] in LIBRARIES


_bare: dict[Any, Any] = {}


def as_kernel(kernel: Any) -> Any:
    """Return the kernel, and with it all that it calls, without wrappers for Python, which take as long to compile as most
    laws."""
    function = plain(kernel)
    if kernel in _bare or function is kernel or not kernel._can_compile:  # the compiler is off, or types are declared
        return _bare.get(kernel, kernel)
    _bare[kernel] = kernel  # what it calls may call it
    copy = calling_kernels(function)
    options = {name: value for name, value in vars(kernel)["targetoptions"].items() if name != "nopython"}
    _bare[kernel] = numba.njit(**options | {name: HELPER[name] for name in HELPER if name != "error_model"})(copy)
    return _bare[kernel]


def calling_kernels(function: FunctionType) -> FunctionType:
    def inner(value: Any) -> Any:
        return as_kernel(value) if isinstance(value, Dispatcher) else value

    called = {name: inner(function.__globals__[name]) for name in function.__code__.co_names if name in function.__globals__}
    cells = tuple(CellType(inner(cell.cell_contents)) for cell in function.__closure__ or ())
    copy = FunctionType(function.__code__, function.__globals__ | called, function.__name__, function.__defaults__, cells)
    copy.__qualname__ = function.__qualname__
    return copy


def as_own(kernel: Any, name: str, space: Mapping[str, Any]) -> FunctionType:
    """Return the function as one of the module with this namespace to numba's cache, which goes by file and name."""
    copy = calling_kernels(plain(kernel))
    copy.__code__ = copy.__code__.replace(co_filename=space["__file__"])
    copy.__module__, copy.__qualname__, copy.__name__ = space["__name__"], name, name
    return copy


class _Folding(ast.NodeTransformer):
    """Branches and numbers that constants decide; those that a module computes from them at its top are added."""

    def __init__(self, known: dict[str, Any]) -> None:
        self._known = known

    def _value(self, node: ast.AST) -> Any:
        if not isinstance(node, ast.expr):
            return None
        names = [part.id for part in ast.walk(node) if isinstance(part, ast.Name)]
        if not names or not all(name in self._known for name in names):
            return None
        return eval(compile(ast.Expression(node), "<constants>", "eval"), dict(self._known))

    def visit_Module(self, module: ast.Module) -> ast.AST:
        for node in module.body:
            if isinstance(node, ast.Assign) and (value := self._value(node.value)) is not None:
                target = node.targets[0]
                named = zip(target.elts, value, strict=True) if isinstance(target, ast.Tuple) else [(target, value)]
                self._known |= {name.id: one for name, one in named if isinstance(name, ast.Name)}
        return self.generic_visit(module)

    def visit(self, node: ast.AST) -> Any:
        if isinstance(node, ast.If | ast.IfExp) and (choice := self._value(node.test)) is not None:
            branch: Any = node.body if choice else node.orelse
            if isinstance(node, ast.IfExp):
                return self.visit(branch)
            self.generic_visit(part := ast.Module(branch, []))
            return part.body
        value = None if isinstance(getattr(node, "ctx", None), ast.Store) else self._value(node)
        return ast.Constant(value) if isinstance(value, int) else super().visit(node)


def folded(text: str, known: Mapping[str, Any]) -> str:
    """Return the text of a module with branches and numbers that these constants decide: numba would read all branches first, for
    a third of the compile time of small laws."""
    return ast.unparse(_Folding(dict(known)).visit(ast.parse(text))) + "\n"


def load_module(kind: str, text: str, functions: Sequence[Callable]) -> tuple[ModuleType, Path]:
    """Write the generated text under a name that hashes all its dependencies, and import it. Thread-safe. Raises OutputError."""
    digest = hashlib.sha256(f"{text}{numba.__version__}{sources(functions)}".encode())
    name = f"thirdbody_{kind}_{digest.hexdigest()[:20]}"
    path = cache.folder() / f"{name}.py"
    with import_lock:
        if name not in sys.modules:
            content, missing = text.encode(), True
            with suppress(OSError):
                missing = path.read_bytes() != content  # or damaged: from it numba decides whether its code is still valid
            try:
                if missing:
                    if path.is_dir() and not path.is_symlink():
                        shutil.rmtree(path)
                    draft = path.with_suffix(f".{os.getpid()}")
                    draft.write_bytes(content)
                    os.replace(draft, path)  # atomic: several processes may write the same name
            except OSError as error:
                raise cache.cannot_write(path, error) from error
            import_file(name, path, text)
        return sys.modules[name], path


GENERATED = re.compile(r"thirdbody_[a-z]+_[0-9a-f]{20}\.py")  # files of generated code (`load_module`)


def compile_error(problem: Exception) -> str | None:
    """Return numba's reason, and the line if it names one, without colours and advice; None if numba did not raise it."""
    if isinstance(problem, OSError | MemoryError | ThirdbodyError):
        return None
    # numba was running, as for a name that a module does not have
    running = any(frame.f_globals.get("__name__", "").startswith("numba.") for frame, _ in walk_tb(problem.__traceback__))
    if not (running or isinstance(problem, ImportError) or type(problem).__module__.startswith("numba.")):
        return None
    text = re.sub(r"\x1b\[[0-9;]*m", "", str(problem))
    lines = [line.strip() for line in text.splitlines() if line.strip()] or [""]
    informative = [line for line in lines if "Error" in line or "Unknown" in line or "Invalid" in line]
    reason = informative[-1] if informative else lines[0]
    if "Error" not in reason and not type(problem).__module__.startswith("numba."):
        reason = f"{type(problem).__name__}: {reason}"
    # file and line of the kernel: generated code, into which kernels are inlined, is not informative
    where = next((line for line in lines if line.startswith("File ") and not GENERATED.search(line)), "")
    return f"cannot be compiled: {reason} {where.rstrip(':').replace('File ', 'in file ', 1)}".rstrip()
