"""House rules that no linter knows, read from the source: `python tests/style.py` prints each break of one, in seconds."""

import ast
import gc
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCE, PLUGINS = ROOT / "src" / "thirdbody", ROOT / "plugins"
OURS, THEIRS = sorted(SOURCE.rglob("*.py")), sorted(PLUGINS.rglob("*.py"))
MOST_LINES, LONGEST_FUNCTION = 400, 60

# -- words --

BANNED = """told tell tells telling foretell foretold asked ask judge judged look looks looked remembered forget forgets
forgetting way ways rung rungs host guest guests shot reel course found made kept keeps taken took takes kicked gone fresh met
turned turns share shares most least deep turning rise pulls hold holds held sheet spread room walk climb march places see seen
felt stands"""
"""Words of the private vocabulary of earlier versions, that stand for several terms, or that name no result."""

WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")


def identifiers(tree: ast.Module) -> Iterator[tuple[str, int]]:
    for node in nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name, node.lineno
        elif isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, node.lineno
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr, node.lineno
        elif isinstance(node, ast.alias) and node.asname:
            yield node.asname, node.lineno
        elif isinstance(node, ast.ExceptHandler) and node.name:
            yield node.name, node.lineno


def private_words(tree: ast.Module) -> Iterator[str]:
    """Yield a line for each identifier with a banned word; `place` is the verb of the key `placement`, never a noun."""
    for name, line in sorted(set(identifiers(tree)), key=lambda entry: entry[1]):
        words = {word.lower() for word in WORD.findall(name)}
        for word in sorted(words & set(BANNED.split())):
            yield f"{line}: {name}: {word} is no term of the field"
        if "place" in words and not re.fullmatch(r"_?place_\w+", name):
            yield f"{line}: {name}: place: a position, a location, a folder"


# -- sizes --


def too_long(path: Path, tree: ast.Module) -> Iterator[str]:
    lines = len(path.read_text(encoding="utf-8").splitlines())
    if lines > MOST_LINES:
        yield f"1: {lines} lines, at most {MOST_LINES}"
    for node in nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if length > LONGEST_FUNCTION:
                yield f"{node.lineno}: {node.name} has {length} lines, at most {LONGEST_FUNCTION}"


# -- tables of numbers --

EMBEDDED = {"scratch": {"body", "body_extra"}}
"""Arrays that begin with the columns of other tables (`step_tables.drift_scratch`)."""


def declared_tables(tree: ast.Module) -> Iterator[tuple[str, ast.Call]]:
    for node in tree.body:
        call = node.value if isinstance(node, ast.Assign) else None
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "Table":
            yield node.targets[0].id, call  # type: ignore[union-attr,attr-defined]


@cache
def symbols() -> dict[str, str]:
    calls = [entry for path in (*OURS, *THEIRS) for entry in declared_tables(parsed(path))]
    return {name: str(ast.literal_eval(call.args[0])).partition(",")[0] for name, call in calls}


@cache
def constants() -> dict[str, set[str]]:
    result = {}
    for path in (*OURS, *THEIRS):
        for name, call in declared_tables(parsed(path)):
            columns = {str(word.arg).upper() for word in call.keywords}
            result[name] = columns | {f"{column}{n}" for column in columns for n in range(2, 25)} | {"WIDTH"}
        for node in nodes(parsed(path)):
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and isinstance(node.value, ast.Name):
                result.get(node.value.id, set()).add(node.attr)
    return result


def table_uses(node: ast.AST) -> set[tuple[str, str]]:
    """Return the tables and constants that an index names; those inside another subscript count for that one."""
    inner = {id(part) for sub in ast.walk(node) if isinstance(sub, ast.Subscript) for part in ast.walk(sub)}
    return {
        (part.value.id, part.attr) for part in ast.walk(node)
        if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) and part.value.id in symbols()
        and part.attr.isupper() and id(part) not in inner
    }  # fmt: skip


def tables_misused(path: Path, tree: ast.Module) -> Iterator[str]:
    """The symbol of a table names no other; every column that is named exists."""
    names = [name for node in nodes(tree) if isinstance(node, ast.ImportFrom) for name in node.names]
    imported = {name.asname or name.name: name.name for name in names if name.name in symbols()}
    for node in nodes(tree):
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and not isinstance(node.slice, ast.Constant):
            name = node.value.id
            for table in {table for table, _ in table_uses(node.slice)} - EMBEDDED.get(name, set()):
                if (name in symbols().values() or len(name) == 1) and symbols()[table] != name:
                    yield f"{node.lineno}: {name} with a column of {table}"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.attr.isupper():
            table = imported.get(node.value.id)
            if table is not None and node.attr not in constants()[table]:
                yield f"{node.lineno}: {table} has no column {node.attr}"


# -- imports --

FLOORS = """
errors palette rotations version
files atomic_files input_files units system
jit granular_flow
kernels schema
laws bodies kernels.explicit
kernels.implicit surfaces
engine statics debris
scene trajectory
assembly plot export plugin
render
runner
report
studies
api
sweeps
__init__
cli
__main__
""".strip().splitlines()
"""Modules and packages from the ground up: a file imports lower floors and files of its own package, no others, in functions and
for type checkers too. The last five are doors."""

FLOOR = {name: number for number, names in enumerate(FLOORS) for name in names.split()}

LIGHT = {"__init__", "errors", "units", "runner.progress"}
"""Modules that start with the command, with all of cli, schema, debris, scene and system; they import nothing heavy."""

COMPILED, DRAWING = {"jit", "kernels", "laws", "bodies", "engine"}, {"trajectory", "export", "plot", "render"}


@cache
def imports(tree: ast.Module) -> list[tuple[str, int]]:
    """Return the full dotted name of every import, names taken with `from` included, those for type checkers too."""
    found = []
    for node in nodes(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += [(f"{'.' * node.level}{node.module or ''}.{alias.name}", node.lineno) for alias in node.names]
    return found


def statements_at_start(body: list[ast.stmt]) -> Iterator[ast.Import | ast.ImportFrom]:
    """Yield the imports that are executed when a module is imported itself: not in functions, not for type checkers."""
    for node in body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif isinstance(node, ast.If) and "TYPE_CHECKING" not in ast.dump(node.test):
            yield from statements_at_start(node.body + node.orelse)
        elif isinstance(node, ast.Try):
            inner = [statement for handler in node.handlers for statement in handler.body]
            yield from statements_at_start(node.body + node.orelse + node.finalbody + inner)


def at_start(tree: ast.Module) -> set[str]:
    names: set[str] = set()
    for node in statements_at_start(tree.body):
        several = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
        names.update(name.partition(".")[0] for name in several)
    return names


def module_of(path: Path) -> str:
    """Return `engine.state`; the name of the package for an `__init__`, `__init__` for that of the root."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if len(parts) > 1 and parts[-1] == "__init__" else parts)


MODULES = {module_of(path) for path in OURS}


def imported(name: str) -> str:
    """Return the module of ours that an imported name comes from, such as `engine.state`; empty for others."""
    parts = name.split(".")
    if parts[0] != "thirdbody":
        return ""
    return next((module for k in range(len(parts), 1, -1) if (module := ".".join(parts[1:k])) in MODULES), "__init__")


def floor_of(module: str) -> str:
    """Return the name in FLOORS that a module belongs to: itself, or the longest package that is there."""
    parts = module.split(".")
    return next((name for k in range(len(parts), 0, -1) if (name := ".".join(parts[:k])) in FLOOR), "")


def upward_imports(path: Path, tree: ast.Module) -> Iterator[str]:
    """Imports of our own source point down, heavy libraries stay in their packages, no plug-in is imported."""
    own, package = module_of(path), path.relative_to(SOURCE).parts[0]
    plugged = {"plugins", *(p.stem for p in PLUGINS.glob("*.py")), *(f"thirdbody_{p.name}" for p in PLUGINS.iterdir())}
    for name, line in imports(tree):
        if name.partition(".")[0] in plugged:
            yield f"{line}: the source never imports a plug-in"
        if other := imported(name):
            here, there = floor_of(own), floor_of(other)
            if here != there and FLOOR.get(there, 99) >= FLOOR.get(here, 0):
                yield f"{line}: {own} must not import {other}"
    heavy = at_start(tree) & set("numba vtk vtkmodules pyvista matplotlib h5py scipy pint pandas".split())
    if (module_of(path) in LIGHT or package in ("cli", "schema", "debris", "scene", "system")) and heavy:
        yield f"1: starts with the command, must not import {sorted(heavy)}"
    if package not in COMPILED and "numba" in heavy:
        yield "1: numba stays in the compiled packages"
    if package not in DRAWING and heavy & {"vtk", "vtkmodules", "pyvista", "matplotlib", "h5py"}:
        yield "1: drawing stays in its own packages"


def circles() -> Iterator[str]:
    """Yield each group of files that import each other, lazily or for type checkers too."""
    edges = {module_of(path): {imported(name) for name, _ in imports(parsed(path))} - {"", module_of(path)} for path in OURS}
    below: dict[str, set[str]] = {}
    for start in edges:
        reached, left = set[str](), [start]
        while left:
            after = edges[left.pop()] - reached
            reached |= after
            left.extend(after)
        below[start] = reached
    groups = {frozenset(other for other in below[name] if name in below[other]) for name in edges if name in below[name]}
    yield from (f"src: imports in a circle: {' '.join(sorted(group))}" for group in groups)


def facade() -> Iterator[str]:
    """Plug-ins use `thirdbody.plugin` and nothing else; the conditions that judge the laws import nothing of ours."""
    offered = next(
        {entry.value for entry in node.value.elts} for node in parsed(SOURCE / "plugin.py").body
        if isinstance(node, ast.Assign) and node.targets[0].id == "__all__"  # type: ignore[attr-defined]
    )  # fmt: skip
    for path in THEIRS:
        for name, line in imports(parsed(path)):
            if name.startswith("thirdbody.") and name.removeprefix("thirdbody.plugin.") not in offered:
                yield f"{name_of(path)}:{line}: {name} is not offered by thirdbody.plugin"
            if path.name == "conditions.py" and name.startswith((".", "thirdbody", "plugins")):
                yield f"{name_of(path)}:{line}: the conditions import nothing of ours"
    drawing = [path for path in OURS if path != SOURCE / "export" / "vtk.py"]  # which writes files
    used = {name for path in drawing for name, _ in imports(parsed(path)) if name.split(".")[0] in ("vtk", "vtkmodules")}
    if used != {"vtkmodules.vtkRenderingOpenGL2.vtkOpenGLSphereMapper"}:  # spheres, which pyvista cannot cast without triangles
        yield f"src: pictures are drawn through pyvista, not {sorted(used)}"


@cache
def nodes(tree: ast.Module) -> list[ast.AST]:
    return list(ast.walk(tree))


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def breaks() -> Iterator[str]:
    for path in (*OURS, *THEIRS):
        tree = parsed(path)
        rules = [private_words(tree), too_long(path, tree), tables_misused(path, tree)]
        if path in OURS:
            rules.append(upward_imports(path, tree))
        yield from (f"{name_of(path)}:{line}" for rule in rules for line in rule)
    for path in sorted((ROOT / "tests").rglob("*.py")):
        yield from (f"{name_of(path)}:{line}" for line in too_long(path, parsed(path)))
    for rule in (circles, facade):
        yield from rule()


if __name__ == "__main__":
    gc.disable()  # trees have no garbage, and searching them takes two thirds of the time
    lines = list(breaks())
    print("\n".join(lines) or "all rules hold")
    sys.exit(bool(lines))
