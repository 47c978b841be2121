"""The reference of all names: keys of a scene, options of laws and effects, series and arrays of a run, exit codes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from thirdbody.errors import EXIT_CODES, UsageError, nearest
from thirdbody.laws.contract import Labeller, Option
from thirdbody.laws.measures import layout_of
from thirdbody.laws.registry import Registry, discover
from thirdbody.scene.keys import Key, merged, scene_keys, toml
from thirdbody.scene.model import Scene
from thirdbody.trajectory.names import COUNT, FRACTION, SERIES, TABLES, Name
from thirdbody.units import DIMENSIONS

KEY_HEADINGS = ("key", "for", "value", "unit", "default", "meaning", "example")
NAME_HEADINGS = ("name", "unit", "meaning")


def all_keys(registry: Registry) -> list[Key]:
    """Return every key of a scene file, those of the installed laws and effects after the others of their table."""
    keys = scene_keys(Scene.model_json_schema())
    options = merged(_law_options(registry)) + merged(_effect_options(registry)) + merged(_measure_options(registry))
    last = {key.path.split(".")[0]: position for position, key in enumerate(keys)}
    return sorted([*keys, *options], key=lambda key: last[key.path.split(".")[0]])


def _law_options(registry: Registry) -> Iterator[Key]:
    for family in registry.families.values():
        for level, laws in family.levels.items():
            for option in (option for law in laws for option in law.options):
                yield _option_key(f"contact.{option.name}", option, (level,))


def _effect_options(registry: Registry) -> Iterator[Key]:
    for name, effect in registry.effects.items():
        if name not in Scene.model_fields["effects"].annotation.model_fields:  # type: ignore[union-attr]
            for option in effect.options:
                yield _option_key(f"effects.{name}.{option.name}", option, ())


def _measure_options(registry: Registry) -> Iterator[Key]:
    for name, measure in registry.measures.items():
        for option in measure.options:
            yield _option_key(f"measures.{name}.{option.name}", option, ())


def _option_key(path: str, option: Option, tables: tuple[str, ...]) -> Key:
    dimension = DIMENSIONS[option.dimension]
    limits = [f"{word} {limit:g}" for word, limit in (("at least", option.low), ("at most", option.high)) if math.isfinite(limit)]
    number = ", ".join(["a number" if option.dimension == "dimensionless" else dimension.phrase, *limits])
    words = [toml(word) for word in option.words] + ([number] if option.or_number or not option.words else [])
    value = " or ".join(words) if option.size == 1 else f"a list of {option.size} ({number})"
    default = "required" if option.default is None else toml(option.default)
    meaning, _, example = option.doc.partition(", such as ")
    return Key(path, tables, value, dimension.si_unit, default, _sentence(meaning), example or toml(option.default))


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


def all_names(registry: Registry) -> dict[str, dict[str, Name]]:
    """Return the series and arrays of a run by table, those of the installed labellers with them."""
    tables = {table: dict(names) for table, names in TABLES.items()}
    for labeller in {id(one): one for family in registry.families.values() if (one := family.labeller)}.values():
        tables["series"] |= {f"fraction_{state}": FRACTION for state in labeller.states}
        tables["series"] |= {f"count_{reason}": COUNT for reason in labeller.reasons}
        tables["bodies"] |= _labels(labeller)
    tables |= {"measures": {}, "maps": {}}
    for measure in registry.measures.values():
        layout = layout_of([measure])
        tables["measures"] |= {column.name: Name(column.unit, _sentence(column.doc)) for column in layout.bodies}
        tables["maps"] |= {entry.name: Name(entry.unit, f"{_sentence(entry.doc)} Per area of a cell.") for entry in layout.maps}
    return tables


def _labels(labeller: Labeller) -> dict[str, Name]:
    """Return the arrays of bodies that a labeller writes."""
    outputs = {column.name: column for column in labeller.outputs}
    result = {}
    for name in (*labeller.margins, *labeller.extras):
        column, margin = outputs.get(name), name in labeller.margins
        meaning = _sentence(column.meaning) if column else ""
        result[f"margin_{name}" if margin else name] = Name((column.unit if column else "") or "1", meaning)
    return result


def keys_report(word: str | None, plugins: Sequence[Path], json: bool) -> None:
    """Print the keys and names that a word finds, or all of them. Raises UsageError, with the nearest name, for none."""
    from thirdbody.report.tables import print_json, table

    registry = discover(plugins)
    keys, names = _matches(word, all_keys(registry), all_names(registry))
    if json:
        run = {kind: {name: entry._asdict() for name, entry in entries.items()} for kind, entries in names.items()}
        print_json({"scene": [asdict(key) for key in keys], "run": run})
        return
    if keys:
        table("keys of a scene file", KEY_HEADINGS, key_rows(keys))
        print()
    for kind, entries in names.items():
        if entries:
            title = "series of a run: run.series[name]" if entries.keys() <= SERIES.keys() else f"{kind} of a run"
            table(title, NAME_HEADINGS, name_rows(entries))
            print()


def _matches(
    word: str | None, keys: list[Key], names: dict[str, dict[str, Name]]
) -> tuple[list[Key], dict[str, dict[str, Name]]]:
    """Return what a word finds: parts of names, else words of meanings. Raises UsageError for nothing."""
    if word is None:
        return keys, names
    wanted = re.sub(r"\[\d+\]|\.\d+(?=\.|$)", "", word).lower()
    for text_of in (lambda name, meaning: name, lambda name, meaning: meaning):
        result = [key for key in keys if wanted in text_of(key.path, key.meaning).lower()]
        tables = {
            kind: {name: entry for name, entry in entries.items() if wanted in text_of(name, entry.meaning).lower()}
            for kind, entries in names.items()
        }
        if result or any(tables.values()):
            return result, tables
    parts = {part for key in keys for part in (key.path, key.path.rpartition(".")[2])}
    known = parts | {name for entries in names.values() for name in entries}
    raise UsageError(f"keys {word}: nothing has this name, {nearest(wanted, known)}")


def key_rows(keys: Iterable[Key]) -> list[tuple[str, ...]]:
    """Return the rows of a table of keys, as KEY_HEADINGS."""
    return [(key.path, ", ".join(key.tables), key.value, key.unit, key.default, key.meaning, key.example) for key in keys]


def name_rows(names: dict[str, Name]) -> list[tuple[str, ...]]:
    """Return the rows of a table of series or arrays, as NAME_HEADINGS."""
    return [(name, entry.unit, entry.meaning) for name, entry in names.items()]


def exit_code_rows() -> list[tuple[str, ...]]:
    """Return the rows of the table of exit codes."""
    return [(str(code), meaning) for code, meaning in EXIT_CODES.items()]
