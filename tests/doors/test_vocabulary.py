"""Identifiers consist of standard terms: no words that a reader of the field would have to learn first."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from each import each

ROOT = Path(__file__).parents[2]
CODE = sorted([*(ROOT / "src").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")])
TESTS = sorted((ROOT / "tests").rglob("*.py"))

PRIVATE = {
    "an array or a function is no person that speaks": "told tell tells telling foretell foretold asked ask",
    "nor one that sees, judges or remembers": "judge judged look looks looked remembered forget forgets forgetting",
    "path, distance or method": "way ways",
    "variant of a study": "rung rungs",
    "owner and partner": "host guest guests",
    "picture, film or run": "shot reel course",
}
"""Words of the private vocabulary of earlier versions, by what replaces them; nowhere in identifiers, tests included."""

LOOSE = {
    "found or computed by what: name the result": "found made",
    "a participle says what was done, not what the value is": "kept keeps taken took takes kicked gone fresh met turned turns",
    "fraction, or the count of those who share": "share shares",
    "max and min": "most least",
    "overlap": "deep",
    "rotation": "turning",
    "displacement or velocity": "rise",
    "force, or a stiffness": "pulls",
    "supported, stored, or a check": "hold holds held",
    "table, or data": "sheet",
    "broadcast, scatter or deviation": "spread",
    "scratch memory, or a margin": "room",
    "solver or driver": "walk climb march",
    "position, location or folder": "places",
    "visited, observed or visible": "see seen felt",
    "exists, or applies": "stands",
}
"""Words that stand for several terms, by the terms meant; in the identifiers of src and plugins."""

ALLOWED = {"touch_and_go": "the name of a robustness case, part of the command line"}
"""Identifiers with such a word, and why."""

PLACING = re.compile(r"_?place_\w+")
"""`place` is the verb of the key `placement`, never a noun."""

WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")


def words(name: str) -> set[str]:
    """Return the words of an identifier in snake case, camel case or capitals."""
    return {word.lower() for word in WORD.findall(name)}


def identifiers(text: str) -> Iterator[tuple[str, int]]:
    """Yield the identifiers that a module defines, with their lines."""
    for node in ast.walk(ast.parse(text)):
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


def wrongs(text: str, banned: dict[str, str]) -> list[str]:
    """Return a line for each identifier of a module that contains a banned word."""
    meant = {word: instead for instead, row in banned.items() for word in row.split()}
    found = []
    for name, line in sorted(set(identifiers(text)), key=lambda entry: entry[1]):
        for word in sorted(words(name) & meant.keys()):
            if name not in ALLOWED:
                found.append(f"line {line}: {name}: {word}: {meant[word]}")
        if banned is not PRIVATE and "place" in words(name) and not PLACING.fullmatch(name):
            found.append(f"line {line}: {name}: place: a position, a location, a folder")
    return found


@each(CODE, lambda path: str(path.relative_to(ROOT)))
def test_code_speaks_the_language_of_the_field(path):
    assert not wrongs(path.stem, PRIVATE | LOOSE) and not wrongs(path.read_text(encoding="utf-8"), PRIVATE | LOOSE)


def test_tests_use_no_private_words():
    bad = {str(path.relative_to(ROOT)): wrongs(path.read_text(encoding="utf-8"), PRIVATE) for path in TESTS}
    assert not {path: lines for path, lines in bad.items() if lines}


@pytest.mark.parametrize(
    "text",
    [
        "def told(): ...", "def f(share): ...", "x_kept = 1", "class Looks: ...", "MOST_BYTES = 1", "class A:\n    way: float",
        "import numpy as place", "f = lambda room: room", "try: ...\nexcept ValueError as made: ...", "self.place = 1",
    ],
)  # fmt: skip
def test_a_private_word_is_noticed(text):
    assert len(wrongs(text, PRIVATE | LOOSE)) == 1


def test_other_words_are_free():
    assert not wrongs("def place_spheres(radius, lookup, shared_plate): kickoff, Wayne = 1, 2", PRIVATE | LOOSE)
