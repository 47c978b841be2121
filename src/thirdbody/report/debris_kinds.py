"""Report of `thirdbody shapes --list`: the kinds of debris, and the keys of one of them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from thirdbody.errors import UsageError, nearest
from thirdbody.system.terminal import say


def kinds_report(kind: str | None, plugins: Sequence[Path], json: bool) -> None:
    """Print all kinds of debris and their sources, or the keys of one kind. Raises UsageError for an unknown kind."""
    from thirdbody.report.tables import print_json, table
    from thirdbody.scene.debris.registry import DebrisKinds

    result = DebrisKinds(plugins)
    failures = result.failures()
    usable = result.usable()
    if kind is not None and kind not in usable:
        raise UsageError(failures.get(kind) or f"--list {kind}: no such kind of debris, {nearest(kind, usable)}")
    entries: list[dict[str, Any]] = [
        {"kind": name, "from": result.source(name), "description": _description(one), "schema": one.model_json_schema()}
        for name, one in usable.items()
        if kind in (None, name)
    ]
    if json:
        print_json({"kinds": entries, "failures": failures})
        return
    if kind is None:
        rows = [[str(entry[key]) for key in ("kind", "from", "description")] for entry in entries]
        table("kinds of debris (debris.kind)", ("kind", "from", "bodies"), rows)
        for why in failures.values():
            say(f"kind of debris {why}")
        print("\nthe keys of one of them: thirdbody shapes --list KIND")
        return
    (entry,) = entries
    table(f"{kind}: {entry['description']}", ("key", "value", "default"), _key_rows(entry["schema"]))


def _description(kind: type) -> str:
    """Return the first sentence of the docstring."""
    text = " ".join((kind.__doc__ or "").split())
    return text.split(". ")[0].rstrip(".")


def _key_rows(schema: Mapping[str, Any]) -> list[list[str]]:
    """Return a row for each key: name, allowed values, default."""
    required = schema.get("required", ())
    return [
        [key, _allowed(value), "required" if key in required else _default(value.get("default"))]
        for key, value in schema["properties"].items()
    ]


def _default(value: Any) -> str:
    return "none" if value is None else f'"{value}"' if isinstance(value, str) else str(value)


def _allowed(value: Mapping[str, Any]) -> str:
    """Return the allowed values of a JSON schema in words."""
    if choices := value.get("anyOf"):
        words = dict.fromkeys(_allowed(choice) for choice in choices if choice.get("type") != "null")
        return " or ".join(words)
    if "$ref" in value:
        return f"a table {{{value['$ref'].rpartition('/')[2]}}}"
    if "const" in value or "enum" in value:
        return " or ".join(f'"{word}"' for word in value.get("enum", [value.get("const")]))
    if value.get("type") == "array":
        entries, number = value.get("prefixItems"), value.get("minItems", 0)
        each = _allowed(entries[0] if entries else value.get("items", {}))
        return f"a list of {number} ({each})" if entries else f"a list ({each})"
    words = {"integer": "a whole number", "number": "a number", "string": "a text", "boolean": "true or false"}
    quantity = str(value.get("description") or "").partition(":")[0]
    return f"{quantity or words.get(str(value.get('type')), 'a value')}{_range(value)}"


def _range(value: Mapping[str, Any]) -> str:
    """Return the limits of a number: ", at least 0.1, at most 1"."""
    words = {"exclusiveMinimum": "above", "minimum": "at least", "exclusiveMaximum": "below", "maximum": "at most"}
    return "".join(f", {word} {value[key]:g}" for key, word in words.items() if key in value)
