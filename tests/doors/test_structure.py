"""The size limits of the source and the rules of its tables of numbers, read from the source.

The list of exceptions only shrinks: an entry that is no longer needed makes a test fail.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from each import each

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "thirdbody"
COLUMNS = SOURCE / "kernels" / "columns"
FILES = sorted([*SOURCE.rglob("*.py"), *(ROOT / "plugins").rglob("*.py")])

MOST_ARGUMENTS, MOST_LINES, LONGEST_FUNCTION = 8, 400, 60

COPIED_COLUMNS: dict[str, set[str]] = {
    "plugins/three_spot/forecast_output.py": {"POINT"},
    "plugins/three_spot/support_geometry.py": {"ARM", "NORMAL", "SURFACE"},
}
"""Columns that are named anew outside their table: module -> names. To be emptied."""

EMBEDDED = {"scratch": {"body", "body_extra"}}
"""Arrays that begin with the columns of other tables (`columns.drift_scratch`)."""


def name_of(path: Path) -> str:
    """`kernels/rotation.py`, `plugins/three_spot/exact.py`."""
    return path.relative_to(SOURCE if path.is_relative_to(SOURCE) else ROOT).as_posix()


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def functions(path: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """All functions and methods of a file, those inside others included."""
    yield from (node for node in ast.walk(tree(path)) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def argument_count(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Number of arguments, self and cls not counted."""
    given = [argument.arg for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    return len(given) - (given[:1] in (["self"], ["cls"]))


@cache
def table_modules() -> set[str]:
    """Names of the modules of `kernels.columns` that declare a table."""
    return {path.stem for path in COLUMNS.glob("*.py") if declared_tables(path)}


def declared_tables(path: Path) -> list[str]:
    """Names of the variables of a module that are a `Table`."""
    return [
        target.id
        for node in tree(path).body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)
        and isinstance(node.value.func, ast.Name) and node.value.func.id == "Table"
        for target in node.targets if isinstance(target, ast.Name)
    ]  # fmt: skip


def is_column(value: ast.expr) -> bool:
    """Whether an expression is a column of a table of ours, or a call with nothing but one, as `int(body.FORCE)`."""
    if isinstance(value, ast.Call) and len(value.args) == 1 and not value.keywords:
        value = value.args[0]
    return isinstance(value, ast.Attribute) and isinstance(value.value, ast.Name) and value.value.id in table_modules() \
        and value.attr.isupper() and value.attr != "WIDTH"  # fmt: skip


def copied_columns(path: Path) -> set[str]:
    """Names of a module that are set to a column of a table declared elsewhere."""
    copies = set()
    for node in tree(path).body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            target, value = node.targets[0], node.value
            both = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
            for name, one in zip(target.elts, value.elts, strict=True) if both else [(target, value)]:
                if is_column(one):
                    copies.add(ast.unparse(name))
    return copies


@each(FILES, name_of)
def test_no_function_takes_more_than_eight_arguments(path):
    found = {node.name for node in functions(path) if argument_count(node) > MOST_ARGUMENTS}
    assert not found, f"more than {MOST_ARGUMENTS} arguments: {sorted(found)}"


def test_exceptions_name_files_that_exist():
    names = {name_of(path) for path in FILES}
    assert set(COPIED_COLUMNS) <= names


@each(FILES, name_of)
def test_files_and_functions_stay_short(path):
    lines = len(path.read_text(encoding="utf-8").splitlines())
    assert lines <= MOST_LINES, f"{lines} lines"
    long = {node.name: (node.end_lineno or node.lineno) - node.lineno + 1 for node in functions(path)}
    assert not {name: size for name, size in long.items() if size > LONGEST_FUNCTION}


@cache
def symbols() -> dict[str, str]:
    """Name of the array of each table: module -> symbol."""
    found = {}
    for path in FILES:
        for node in tree(path).body:
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call) and declared_tables(path):
                function = node.value.func
                if isinstance(function, ast.Name) and function.id == "Table":
                    found[path.stem] = str(ast.literal_eval(node.value.args[0])).partition(",")[0]
    return found


def table_uses(node: ast.Subscript) -> set[str]:
    """Tables whose columns the index of a subscript names; those inside another subscript count for that one."""
    inner = {id(part) for sub in ast.walk(node.slice) if isinstance(sub, ast.Subscript) for part in ast.walk(sub)}
    return {
        part.value.id for part in ast.walk(node.slice)
        if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) and part.value.id in symbols()
        and part.attr.isupper() and id(part) not in inner
    }  # fmt: skip


@each(FILES, name_of)
def test_the_symbol_of_a_table_names_no_other_table(path):
    """`B` is the table of bodies everywhere, and every array of one letter that has columns is the table of that letter."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
            name = node.value.id
            for table in table_uses(node) - EMBEDDED.get(name, set()):
                taken = name in symbols().values() or len(name) == 1
                assert not taken or symbols()[table] == name, f"line {node.lineno}: {name} with a column of {table}"


def test_symbols_of_tables_differ():
    """Tables that lie in one array share its symbol: those of rolling follow the history in the tiles of the laws."""
    shared = {"rolling_input": "law_input", "rolling_output": "law_output", "contact_memory": "loaded_contact"}
    assert all(symbols()[one] == symbols()[other] for one, other in shared.items())
    alone = [symbol for table, symbol in symbols().items() if table not in shared]
    assert len(alone) > 25 and len(set(alone)) == len(alone)


@each(FILES, name_of)
def test_each_table_has_a_module_of_its_own(path):
    """So a family of constants (`body.FORCE`, `patch.FORCE`) belongs to one table."""
    assert len(declared_tables(path)) <= 1


def test_tables_of_the_engine_are_declared_in_one_place():
    outside = [
        name_of(path) for path in FILES if path.is_relative_to(SOURCE) and path.parent != COLUMNS and declared_tables(path)
    ]
    assert not outside
    assert len(table_modules()) > 20


@each([path for path in FILES if path.parent != COLUMNS], name_of)
def test_columns_are_read_from_the_module_of_their_table(path):
    """No bare `FORCE` imported, none named anew: every use says whose force it is."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("thirdbody.kernels.columns."):
            bare = [alias.name for alias in node.names if (node.module or "").rpartition(".")[2] in table_modules()]
            assert not bare, f"line {node.lineno}: {bare}"
    assert copied_columns(path) == COPIED_COLUMNS.get(name_of(path), set())


def test_a_copied_column_is_found(tmp_path):
    path = tmp_path / "copies.py"
    path.write_text("A, B = body.FORCE, 1\nC = int(patch.HEIGHT)\nD = body.FORCE + 1\nE = body.WIDTH\n")
    assert copied_columns(path) == {"A", "C"}


def test_arguments_are_counted():
    [function] = ast.parse("class A:\n def f(self, a, /, b, *c, d, **e): pass").body[0].body
    assert argument_count(function) == 3
