"""What is compiled for a scene can be read: `thirdbody laws --show-code SCENE`."""

from __future__ import annotations

import ast
import json
from pathlib import Path

SCENES = Path(__file__).parents[2] / "scenes"


def test_generated_code_of_a_scene_is_python_that_calls_its_laws(command):
    shown = command("laws", "--show-code", SCENES / "three_spot.toml", "--json")
    assert shown.code == 0, shown.err
    modules = json.loads(shown.out)
    assert list(modules) == ["law", "tangents", "labeller"]  # a scene without effects has no code for them
    functions = {name: {node.name for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)}
                 for name, text in modules.items()}  # fmt: skip
    assert functions["law"] >= {"law", "stiffness"} and "tangents" in functions["tangents"]
    assert "from thirdbody.laws.mindlin import mindlin as kernel_2" in modules["law"]


def test_effects_of_a_scene_are_shown_too(command):
    shown = command("laws", "--show-code", SCENES / "sheared_debris.toml")
    assert shown.code == 0, shown.err
    titles = [line.split()[-1] for line in shown.out.splitlines() if line.startswith("# ====")]
    assert titles == ["law", "tangents", "effects", "labeller"]
    ast.parse(shown.out)  # as it is printed, it is a module's text


def test_code_is_shown_or_laws_are_checked(command):
    refused = command("laws", "--show-code", SCENES / "three_spot.toml", "--check", "law.py")
    assert refused.code == 2 and "--check or --show-code" in refused.err
