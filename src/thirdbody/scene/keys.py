"""All keys of a scene file as rows of a table, read from its JSON schema."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from thirdbody.units import DIMENSIONS

Schema = Mapping[str, Any]

SELECTORS = ("kind", "distribution")
"""Keys whose value decides which of several tables they stand in."""

_TYPES = {"integer": "integer", "number": "number", "string": "text", "boolean": "true or false", "object": "table"}
_LIMITS = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}


@dataclass(frozen=True)
class Key:
    """One key: its path, the tables that have it, allowed values, SI unit, default, meaning and example (as in a file).

    `tables` names what tells these tables from others of the same path: kinds of debris, distributions, levels of a law, or the
    first key (`ramp`); it is empty for a key that all of them have.
    """

    path: str
    tables: tuple[str, ...]
    value: str
    unit: str
    default: str
    meaning: str
    example: str


def scene_keys(schema: Schema) -> list[Key]:
    """Return the keys of the JSON schema of a scene, in the order of the file; the same key of several tables stands once."""
    kinds, keys = len(schema["properties"]["debris"]["items"]["anyOf"]), merged(_keys(schema, schema["$defs"], "", ()))
    return [replace(key, tables=()) if len(key.tables) == kinds else key for key in keys]


def merged(keys: Iterable[Key]) -> list[Key]:
    """Return the keys, those that differ by their tables only as one; those that select a table with all their words."""
    rows: dict[Key, list[str]] = {}
    for key in keys:
        selects = key.path.rpartition(".")[2] in SELECTORS
        rows.setdefault(replace(key, tables=(), value="" if selects else key.value), []).extend(key.tables)
    texts = {key: dict.fromkeys(tables) for key, tables in rows.items()}
    return [
        replace(key, tables=tuple(tables)) if key.value else replace(key, value=" or ".join(toml(name) for name in tables))
        for key, tables in texts.items()
    ]


def table_keys(schema: Schema) -> list[Key]:
    """Return the keys of one table, without those of the tables inside it."""
    required = schema.get("required", ())
    return [_key(name, value, name in required, ()) for name, value in schema["properties"].items()]


def _keys(table: Schema, tables: Schema, path: str, names: tuple[str, ...]) -> Iterator[Key]:
    required = table.get("required", ())
    for name, value in table["properties"].items():
        key = _key(f"{path}{name}", value, name in required, names)
        if key.meaning:
            yield key
        inner = list(dict.fromkeys(re.findall(r'"\$ref": "#/\$defs/([^"]+)"', json.dumps(value))))
        for reference in inner:
            entry = tables[reference]
            below = f"{path}{name}.NAME." if "additionalProperties" in value else f"{path}{name}."
            yield from _keys(entry, tables, below, (_name(entry),) if len(inner) > 1 else ())


def _name(table: Schema) -> str:
    """Return what tells a table from the others at its place: its kind, or its first key."""
    constants = [_plain(value)["const"] for value in table["properties"].values() if "const" in _plain(value)]
    return str(constants[0] if constants else next(iter(table["properties"])))


def _key(path: str, schema: Schema, required: bool, names: tuple[str, ...]) -> Key:
    name = path.rpartition(".")[2]
    words, unit = allowed(schema)
    default = "required" if required or name in SELECTORS else toml(schema.get("default"))
    meaning = str(schema.get("description", "")) if "x-example" in schema else ""
    return Key(path, names, words, unit, default, meaning, schema.get("x-example", ""))


def _plain(schema: Schema) -> Schema:
    """Return the schema without its description: a described one is the only entry of `allOf`."""
    return schema["allOf"][0] if "allOf" in schema else schema


def allowed(schema: Schema) -> tuple[str, str]:
    """Return the allowed values of a key in words, and its SI unit; both empty texts where there is none."""
    schema = _plain(schema)
    if choices := schema.get("anyOf"):
        parts = [allowed(choice) for choice in choices if choice.get("type") != "null"]
        return tuple(" or ".join(dict.fromkeys(filter(None, texts))) for texts in zip(*parts, strict=True))  # type: ignore[return-value]
    if "$ref" in schema:
        return "table", ""
    if "const" in schema or "enum" in schema:
        return " or ".join(f'"{word}"' for word in schema.get("enum", [schema.get("const")])), ""
    if schema.get("type") == "array":
        entries = schema.get("prefixItems")
        words, unit = allowed(entries[0] if entries else schema.get("items", {}))
        return f"list of {len(entries)} ({words})" if entries else f"list ({words})", unit
    if "x-dimension" in schema:
        dimension = DIMENSIONS[schema["x-dimension"]]
        return f"{dimension.phrase.partition(' ')[2]}{_range(schema['x-limits'])}", dimension.si_unit
    return f"{_TYPES.get(str(schema.get('type')), 'value')}{_range(schema)}", ""


def _range(schema: Schema) -> str:
    """Return the limits of a number: " >=0.1, <=1"; ", only 1" for a single one."""
    if schema.get("minimum", "none") == schema.get("maximum"):
        return f", only {schema['minimum']:g}"
    return ",".join(f" {sign}{schema[key]:g}" for key, sign in _LIMITS.items() if key in schema)


def toml(value: Any) -> str:
    """Return a number, text, flag or list as TOML; an empty text for None and for tables."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if value is None or isinstance(value, Mapping):
        return ""
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"
