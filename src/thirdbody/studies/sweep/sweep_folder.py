"""Folder of a sweep: `points.csv`, `scene.toml`, `sweep.json` with all points, and a folder per point."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from thirdbody.atomic_files import write_whole
from thirdbody.errors import Fault, InputError, OutputError
from thirdbody.scene.model import Scene
from thirdbody.schema.read import read_text
from thirdbody.studies.sweep.plan import AxisColumn, Plan
from thirdbody.studies.sweep.table import FILE as TABLE

SWEEP_FILE, SCENE_FILE = "sweep.json", "scene.toml"
FORMAT = 1


def is_sweep_folder(path: Path) -> bool:
    """Return whether a path is the folder of a sweep, or its table."""
    return os.path.isfile(sweep_folder(path) / SWEEP_FILE)


def sweep_folder(path: Path) -> Path:
    """Return the folder of a sweep, which its table names as well."""
    return path.parent if path.name == TABLE else path


def refuse_existing_sweep(folder: Path) -> None:
    """Raise OutputError for a folder that exists and is not empty."""
    if not os.path.lexists(folder) or (folder.is_dir() and not os.listdir(folder)):
        return
    known = is_sweep_folder(folder)
    raise OutputError(
        f"{folder}: exists already",
        python="; resume=True goes on, out=... names another folder" if known else "; out=... names another folder",
        command="; --resume goes on, -o names another folder" if known else "; -o names another folder",
    )


def save_plan(plan: Plan, folder: Path) -> None:
    """Write the plan into the folder of a sweep, which is made. Raises OutputError."""
    point = plan.points[0]
    document = {
        "format": FORMAT,
        "title": plan.title,
        "design": plan.design,
        "lengths": plan.lengths,
        "columns": [{"key": column.key, "unit": column.unit, "axis": column.axis} for column in plan.columns],
        "results": plan.results,
        "keep": point.keep,
        "plugins": [str(file) for file in point.plugins],
        "scene_folder": str(point.scene_folder),
        "points": [
            {"folder": one.folder.name, "settings": settings, "values": [column.values[one.number] for column in plan.columns]}
            for one, settings in zip(plan.points, plan.settings, strict=True)
        ],
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / SCENE_FILE, plan.scene.encode())
        write_whole(folder / SWEEP_FILE, json.dumps(document).encode())
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror or error})") from error


def read_document(path: Path) -> dict[str, Any]:
    """Return what `save_plan` wrote. Raises InputError."""
    file = sweep_folder(path) / SWEEP_FILE
    if not os.path.isfile(file):
        raise InputError(f"{path}: no sweep is there (it has no {SWEEP_FILE})")
    try:
        document = json.loads(file.read_bytes())
        if document["format"] != FORMAT:
            raise InputError(Fault("", f"format {document['format']}, this version reads {FORMAT}", str(file)))
    except OSError as error:
        raise InputError(Fault("", f"cannot be read ({error.strerror or error})", str(file))) from error
    except (ValueError, KeyError, TypeError):
        raise InputError(Fault("", "is damaged", str(file))) from None
    return dict(document)


def columns_of(document: dict[str, Any]) -> tuple[AxisColumn, ...]:
    """Return the axes of a saved plan with their values."""
    return tuple(
        AxisColumn(entry["key"], entry["unit"], tuple(point["values"][k] for point in document["points"]), entry["axis"])
        for k, entry in enumerate(document["columns"])
    )


def saved_scene(folder: Path, document: dict[str, Any]) -> Scene:
    """Return the scene of a sweep in its folder. Raises InputError."""
    path = folder / SCENE_FILE
    return Scene.parse(read_text(path), str(path), document["scene_folder"], [Path(file) for file in document["plugins"]])
