"""Points of a sweep from a CSV file: keys of the scene in the header, with a unit or with units in the cells."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from thirdbody.errors import Fault, InputError
from thirdbody.scene.settings import toml_value
from thirdbody.schema.read import read_text

_HEADING = re.compile(r"(?P<key>[^\[]+?)\s*(?:\[(?P<unit>[^\]]*)\])?")
_INDEX = re.compile(r"\[(\d+)\]")


def read_points(path: Path) -> list[dict[str, Any]]:
    """Return the settings of each row, values as a file of a sweep gives them. Raises InputError with all faults."""
    rows = list(csv.reader(io.StringIO(read_text(path))))
    if not rows or len(rows) < 2:
        raise InputError(Fault("", "expected a header with keys of the scene, and a row for each point", str(path)))
    headings = [_heading(text) for text in rows[0]]
    faults = [Fault(f"column {k}", "has no key in the header", str(path), 1) for k, (key, _) in enumerate(headings, 1) if not key]
    twice = {key for key, _ in headings if [other for other, _ in headings].count(key) > 1 and key}
    faults += [Fault(key, "has two columns", str(path), 1) for key in sorted(twice)]
    points = []
    for line, row in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(headings):
            faults.append(Fault("", f"{len(row)} cells, the header has {len(headings)}", str(path), line))
            continue
        points.append(dict(_cells(headings, row, path, line, faults)))
    if faults:
        raise InputError(faults)
    return points


def _heading(text: str) -> tuple[str, str]:
    """Return key and unit of `plates.upper.load [mN]`; `pairs[0].friction` is a key as well."""
    text = _INDEX.sub(r".\1", text.strip())
    match = _HEADING.fullmatch(text)
    return (match["key"].strip(), (match["unit"] or "").strip()) if match else ("", "")


def _cells(
    headings: list[tuple[str, str]], row: list[str], path: Path, line: int, faults: list[Fault]
) -> Iterator[tuple[str, Any]]:
    """Yield key and value of the cells of a row."""
    for (key, unit), cell in zip(headings, row, strict=True):
        if not cell.strip():
            faults.append(Fault(key, "the cell is empty", str(path), line))
            continue
        yield key, f"{cell.strip()} {unit}" if unit else toml_value(cell.strip())
