"""Report of `thirdbody laws --show-code`: the modules that are generated and compiled for a scene."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from thirdbody.laws.registry import Registry
    from thirdbody.scene.model import Scene


def generated_code(scene: Scene, registry: Registry) -> dict[str, str]:
    """Return the text of each generated module of a scene by its content.

    `law`: the contact laws, with the stiffness that bounds an explicit step and the tangents of an implicit one. `effects` and
    `labeller`: absent from a scene without any. Raises InputError.
    """
    from thirdbody.assembly.physics import compile_physics

    choice = compile_physics(scene, registry)
    compiled: dict[str, Callable | None] = {
        "law": choice.chain.law,
        "effects": choice.physics.effects if choice.effects else None,
        "labeller": choice.physics.observe if choice.labeller else None,
    }
    return {name: _text_of(function) for name, function in compiled.items() if function is not None}


def _text_of(function: Callable) -> str:
    """Return the text of the module that holds a compiled function."""
    return Path(str(sys.modules[function.__module__].__file__)).read_text(encoding="utf-8")


def print_code(scene: Scene, registry: Registry, json: bool) -> None:
    """Print the generated modules of a scene in sequence, or as one JSON object."""
    from thirdbody.report.tables import print_json

    modules = generated_code(scene, registry)
    if json:
        print_json(modules)
        return
    for name, text in modules.items():
        print(f"# {'=' * 60} {name}\n{text.rstrip()}\n")
