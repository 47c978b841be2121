"""Kinds of debris: only its own file knows a kind; the others ask the class that the scene names."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from thirdbody.scene.debris.registry import built_in

SOURCE = Path(__file__).parents[2] / "src" / "thirdbody"
KINDS = SOURCE / "scene" / "debris" / "kinds"
OTHERS = sorted(path for path in SOURCE.rglob("*.py") if KINDS not in path.parents)
CLASSES = {kind.__name__ for kind in built_in().values()}


def names(node: ast.AST) -> set[str]:
    """Last words of all names within a piece of code."""
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)} | {
        part.attr for part in ast.walk(node) if isinstance(part, ast.Attribute)
    }


def kind_is_compared(node: ast.Compare) -> bool:
    """Whether `debris.kind` or an entry "kind" is compared with the name of a kind."""
    words = {part.value for part in ast.walk(node) if isinstance(part, ast.Constant)}
    return bool(words & built_in().keys()) and ("kind" in names(node) or "kind" in words)


def questions(text: str) -> list[str]:
    """Lines that ask which kind of debris they have: `isinstance`, `match`, or a comparison of its name."""
    found = []
    for node in ast.walk(ast.parse(text)):
        asks = isinstance(node, ast.Call) and names(node.func) & {"isinstance", "issubclass"} and names(node) & CLASSES
        if asks or (isinstance(node, ast.MatchClass) and names(node.cls) & CLASSES):
            found.append(f"line {node.lineno}: {ast.unparse(node)}")
        elif isinstance(node, ast.Compare) and kind_is_compared(node):
            found.append(f"line {node.lineno}: {ast.unparse(node)}")
    return found


@pytest.mark.parametrize("path", OTHERS, ids=lambda path: path.relative_to(SOURCE).as_posix())
def test_nothing_asks_for_the_kind_of_a_population(path):
    text = path.read_text(encoding="utf-8")
    # a clump's surface mesh and an open HDF5 file have the names of kinds
    elsewhere = "h5py.File" in text or path.parent.name == "bodies"
    assert elsewhere or not questions(text)


def test_such_questions_are_found():
    ladder = "if isinstance(debris, model.Spots): pass\nif d.kind == 'file': pass\nif get(d, 'kind') != 'mesh': pass\n"
    assert [line.split(":")[0] for line in questions(ladder)] == ["line 1", "line 2", "line 3"]
    assert not questions("isinstance(debris, DebrisKind) and plan.kind == 'implicit'")


def test_every_module_of_the_folder_is_a_kind():
    assert {path.stem for path in KINDS.glob("*.py")} - {"__init__"} == built_in().keys()
