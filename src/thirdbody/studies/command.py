"""The command `thirdbody cost`: climbs, prints, and leaves JSON, picture and runs in a folder."""

from __future__ import annotations

import json as json_module
import os
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from thirdbody.errors import OutputError
from thirdbody.report import as_plain, print_json

from .budget import BUDGET
from .cost import JSON_FILE, PICTURE, as_json, study


def cost_command(
    scene: Path, folder: Path, settings: dict[str, str], plugins: Sequence[Path], repeats: int, effects: bool, verify: bool,
    overwrite: bool, json: bool, tell: Callable[[str], None], budget: float = BUDGET,
) -> None:  # fmt: skip
    """Do what `thirdbody cost` was asked for. Raises ThirdbodyError; nothing is left half-written but the runs of rungs."""
    _make_room(folder, overwrite)
    if effects:
        _effects(scene, folder, settings, plugins, repeats, json, tell)
        return
    from .convergence import convergence, print_convergence, print_reference, reference_error
    from .cost_plot import draw_study
    from .cost_table import print_study
    from .interaction import above, print_interaction

    began = time.perf_counter()
    made = study(scene, folder, settings, plugins, repeats, tell, verify, budget)
    tell("the elastic interaction of spots")
    told: dict[str, Any] = {"convergence": convergence(made), "reference_error": reference_error(made)}
    told["interaction"] = above(made, folder)
    if verify:
        from .impact import impact_table

        tell("an oblique impact")
        told["impact"] = impact_table(made, plugins)
    draw_study(made, folder / PICTURE, (folder / PICTURE).with_suffix(".pdf"))
    made.took = time.perf_counter() - began
    told = as_json(made) | told
    _write(folder / JSON_FILE, told)
    if json:
        print_json(told)
        return
    print_study(made)
    print_convergence(told["convergence"])
    print_reference(made)
    print_interaction(told["interaction"])
    if verify:
        from .impact import print_impact

        print_impact(told["impact"])
    print(f"{folder / PICTURE} (and .pdf), {folder / JSON_FILE}, runs of the rungs beside them")


def _effects(
    scene: Path, folder: Path, settings: dict[str, str], plugins: Sequence[Path], repeats: int, json: bool,
    tell: Callable[[str], None],
) -> None:  # fmt: skip
    from .effects import effects_study, print_effects

    told = effects_study(scene, folder, settings, plugins, repeats, tell)
    _write(folder / "effects.json", told)
    if json:
        print_json(told)
    else:
        print_effects(told)
        print(f"{folder / 'effects.json'}")


def _make_room(folder: Path, overwrite: bool) -> None:
    """Raise OutputError for a folder that exists; with `overwrite` one that holds a study is emptied."""
    if not os.path.lexists(folder):  # False also for a name that the system refuses: making the folder tells why
        return
    if not overwrite:
        raise OutputError(f"{folder}: exists already; --overwrite replaces it, -o names another folder")
    if not folder.is_dir() or (any(folder.iterdir()) and not (folder / "scene.toml").exists()):
        raise OutputError(f"{folder}: is not the folder of a study and will not be overwritten")
    shutil.rmtree(folder)


def _write(path: Path, told: dict[str, Any]) -> None:
    from thirdbody.output.target import write_whole

    try:
        write_whole(path, json_module.dumps(as_plain(told), indent=1).encode())
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
