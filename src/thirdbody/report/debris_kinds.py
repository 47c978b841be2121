"""Report of `thirdbody shapes --list`: the kinds of debris, and the keys of one of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from thirdbody.errors import UsageError, nearest
from thirdbody.system.terminal import print_line


def kinds_report(kind: str | None, plugins: Sequence[Path], json: bool) -> None:
    """Print all kinds of debris and their sources, or the keys of one kind. Raises UsageError for an unknown kind."""
    from thirdbody.debris.registry import DebrisKinds
    from thirdbody.report.tables import print_json, table
    from thirdbody.scene.keys import table_keys

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
            print_line(f"kind of debris {why}")
        print("\nthe keys of one of them: thirdbody shapes --list KIND")
        return
    (entry,) = entries
    rows = [[key.path, key.value, key.default, key.meaning] for key in table_keys(entry["schema"])]
    table(f"{kind}: {entry['description']}", ("key", "value", "default", "meaning"), rows)


def _description(kind: type) -> str:
    """Return the first sentence of the docstring."""
    text = " ".join((kind.__doc__ or "").split())
    return text.split(". ")[0].rstrip(".")
