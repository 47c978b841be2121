"""Replacement of single values of a scene: `--set solver.distance="1 um"`."""

import re
import tomllib
from collections.abc import Mapping
from typing import Any

from thirdbody.errors import SETTINGS, Fault, InputError
from thirdbody.schema.fields import in_si, show
from thirdbody.schema.parts import Location, key_path

_EXCLUSIVE = (
    {"distance", "duration"}, {"load", "pressure", "gap", "load_per_length"}, {"youngs_modulus", "shear_modulus"},
    {"radius", "shape"}, {"height", "solid_fraction"},
)  # fmt: skip
_REPLACES = {key: keys - {key} for keys in _EXCLUSIVE for key in keys}
_REPLACES["positions"] = {"count", "placement", "height", "solid_fraction"}
"""Keys that a key replaces, when set, in the same table."""


def apply_settings(document: dict[str, Any], settings: Mapping[str, Any]) -> tuple[dict[str, Any], list[Location]]:
    """Return the changed document and the places that were set. Raises InputError for invalid paths."""
    faults: list[Fault] = []
    locations = []
    for path, value in settings.items():
        try:
            locations.append(_set(document, path, toml_value(value) if isinstance(value, str) else in_si(value), settings))
        except ValueError as error:
            faults.append(Fault(path, str(error), file=SETTINGS))
    if faults:
        raise InputError(faults)
    return document, locations


def toml_value(value: str) -> Any:
    """Return the value of a text in TOML; the text itself when it is no TOML value, such as 1 um without quotes."""
    try:
        table = tomllib.loads(f"value = {value}")
    except (ValueError, RecursionError):
        return value
    return table["value"] if table.keys() == {"value"} else value


def words_of(path: str) -> tuple[str, ...]:
    """Return the parts of a key: `pairs[0].friction` and `pairs.0.friction` have the same."""
    return tuple(word for word in re.split(r"[.\[\]]+", path) if word)


def _set(document: dict[str, Any], path: str, value: Any, settings: Mapping[str, Any]) -> Location:
    words = words_of(path)
    if not words:
        raise ValueError("expected a path such as solver.distance")
    node: Any = document
    location: Location = ()
    for word in words[:-1]:
        key = _key(node, word, location)
        location += (key,)
        if isinstance(node, dict):
            node.setdefault(key, {})
        node = node[key]
    key = _key(node, words[-1], location)
    if isinstance(node, dict):
        siblings = {other.rpartition(".")[2] for other in settings}
        for excluded in _REPLACES.get(str(key), set()) - siblings:
            node.pop(excluded, None)
    if value is None:
        node.pop(key, None)
    else:
        node[key] = value
    return (*location, key)


def _key(node: Any, word: str, location: Location) -> str | int:
    if isinstance(node, dict):
        return word
    if not isinstance(node, list):
        raise ValueError(f"{key_path(location)} = {show(node)} is not a table")
    if not word.isdecimal() or int(word) >= len(node):
        known = f"its entries are 0 to {len(node) - 1}" if node else "it is empty"
        raise ValueError(f"{key_path(location)} has no entry '{word}': {known}")
    return int(word)
