"""The rules of `tests/style.py` notice what they forbid."""

import ast

import pytest
import style

BANNED = f"{style.PRIVATE} {style.LOOSE}"


@pytest.mark.parametrize(
    "text",
    [
        "def told(): ...", "def f(share): ...", "x_kept = 1", "class Looks: ...", "MOST_BYTES = 1", "class A:\n    way: float",
        "import numpy as place", "f = lambda room: room", "try: ...\nexcept ValueError as made: ...", "self.place = 1",
    ],
)  # fmt: skip
def test_a_private_word_is_noticed(text):
    assert len(list(style.private_words(ast.parse(text), BANNED))) == 1


def test_other_words_are_free():
    text = "def place_spheres(radius, lookup, shared_plate): kickoff, Wayne = 1, 2"
    assert not list(style.private_words(ast.parse(text), BANNED))


def test_a_copied_column_is_found():
    text = "A, B = body.FORCE, 1\nC = int(patch.HEIGHT)\nD = body.FORCE + 1\nE = body.WIDTH\n"
    assert style.copied_columns(ast.parse(text), {"body", "patch"}) == {"A", "C"}


def test_a_circle_is_found():
    assert style.circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert style.circle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_upward_imports_are_found():
    text = "import numba\nfrom thirdbody.engine import state\nfrom thirdbody_three_spot import PLUGIN\n"
    lines = list(style.upward_imports(style.SOURCE / "scene" / "tables.py", ast.parse(text)))
    assert len(lines) == 4 and "must not import engine" in lines[0]
