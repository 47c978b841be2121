"""The generated parts of the pages: `python tests/generated_parts.py` writes them anew.

A page marks a part by `<!-- generated: NAME -->` and `<!-- end -->`; `PARTS[NAME]()` gives the text between them."""

import ast
import re
from collections.abc import Callable, Iterable
from dataclasses import replace

from gallery import gallery
from pages import ROOT, pages
from thirdbody.errors import EXIT_CODES
from thirdbody.laws.registry import discover
from thirdbody.report.reference import all_keys, all_names
from thirdbody.scene.keys import SELECTORS, Key, table_keys
from thirdbody.trajectory.names import SERIES
from thirdbody.units import DIMENSIONS

SOURCE = ROOT / "src" / "thirdbody"
PART = re.compile(r"(<!-- generated: ([\w-]+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
NOUNS = {dimension.phrase.partition(" ")[2]: dimension.si_unit for dimension in DIMENSIONS.values()}
LONG = 40
"""Letters of a default from which it is left to the text below the list."""


def packages() -> str:
    rows = ["| package | what it holds |", "|---|---|"]
    for path in sorted(SOURCE.rglob("__init__.py")):
        name = ".".join(path.parent.relative_to(SOURCE).parts)
        docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        rows.append(f"| `{name or 'thirdbody'}` | {docstring.splitlines()[0] if docstring else ''} |")
    return "\n".join(rows)


def laws() -> str:
    from thirdbody.laws.contract import STAGES, STIFF

    items = []
    registry = discover([ROOT / "plugins" / "dmt_adhesion.py"])
    for law in sorted(registry.laws.values(), key=lambda law: (STAGES.index(law.stage), law.name)):
        explicit = "explicit integrator only" if law.tangent is None and (law.stage in STIFF or law.reach) else ""
        options = f"options {_codes(option.name for option in law.options)}" if law.options else ""
        items.append(_item([law.name], [law.stage, options, explicit], law.source))
    return "\n".join(items)


def scene_keys() -> str:
    """A heading for each table, or for several of the same keys; below it one for each kind, level or first key."""
    tables: dict[str, list[Key]] = {}
    for key in all_keys(discover()):
        tables.setdefault(key.path.rpartition(".")[0], []).append(key)
    headings: dict[str, list[str]] = {}
    for path, keys in tables.items():
        heading = f"[[{path}]]" if path in ("pairs", "debris") else f"[{path}]" if path else "Top of the file"
        headings.setdefault(_table_of_keys(keys), []).append(heading)
    return "\n\n".join(f"### {', '.join(same)}\n\n{text}" for text, same in headings.items())


def _table_of_keys(keys: list[Key]) -> str:
    names = [key.path.rpartition(".")[2] for key in keys if not key.tables]
    selector = next((name for name in (*SELECTORS, "level") if name in names), "")
    kinds = list(dict.fromkeys(kind for key in keys for kind in key.tables))
    parts = [_keys([key for key in keys if len(key.tables) != 1], kinds)]
    for kind in kinds:
        if text := _keys([replace(key, tables=()) for key in keys if key.tables == (kind,)]):
            parts.append(f'#### `{selector} = "{kind}"`\n\n{text}' if selector else f"#### With `{kind}`\n\n{text}")
    return "\n\n".join(filter(None, parts))


def _keys(keys: Iterable[Key], kinds: Iterable[str] = ()) -> str:
    """An item for each key, or for several that differ by their names only; with an example where a table or list is one."""
    same: dict[Key, list[str]] = {}
    for key in keys:
        same.setdefault(replace(key, path=""), []).append(key.path.rpartition(".")[2])
    return "\n".join(
        _item(names, _facts(key, kinds), key.meaning, f"`{key.example}`" if re.search("table|list", key.value) else "")
        for key, names in same.items()
    )


def _facts(key: Key, kinds: Iterable[str]) -> list[str]:
    """The tables that have a key, its unit with the allowed values, and its default."""
    others = [kind for kind in kinds if key.tables and kind not in key.tables]
    tables = f"all but {others[0]}" if len(others) == 1 else ", ".join(key.tables) if others else ""
    value = key.value
    for noun, unit in NOUNS.items():
        if unit and unit in key.unit.split(" or "):
            value = value.replace(f"{noun} >", f"{unit}, >").replace(noun, unit)
    default = key.default if len(key.default) < LONG else "below"
    return [tables, re.sub(r"\bnumber (?=[<>])", "", value), f"default {default}" if default not in ("", "required") else default]


def sweep_keys() -> str:
    from thirdbody.studies.sweep_file import SweepFile

    return _keys(table_keys(SweepFile.model_json_schema()))


def sweep_results() -> str:
    from thirdbody.studies.results import DEFAULT, RESULTS, result

    states = {f"{name}STATE": result(f"{name}STATE") for name in ("fraction_", "fraction_ever_")}
    means: list[str] = []
    items = []
    for name, entry in sorted((RESULTS | states).items()):
        if name in SERIES and entry.meaning.endswith(SERIES[name].meaning):
            means += [] if entry.meaning.startswith("Last frame") else [name]
            continue
        usual = {"fraction_STATE": "default", "fraction_ever_STATE": "default of rolling"}
        default = usual.get(name, "default" if name in DEFAULT else "")
        items.append(_item([name], ["" if entry.unit == "1" else entry.unit, default], entry.meaning))
    means_of = _item(means, [], "Mean over the steady part of the [series](scene/README.md#series)")
    return "\n".join([*items, means_of, "- any other series of a single value: Its last frame."])


def run_names() -> str:
    texts = []
    for table, names in all_names(discover()).items():
        same: dict[tuple[str, str], list[str]] = {}
        for name, entry in names.items():
            same.setdefault(tuple(entry), []).append(name)
        items = [_item(words, ["" if unit == "1" else unit], meaning) for (unit, meaning), words in same.items()]
        texts.append("\n".join([f"### {table}\n", *items]))
    return "\n\n".join(texts)


def exit_codes() -> str:
    return "\n".join(_item([str(code)], [], words) for code, words in EXIT_CODES.items())


def _item(names: Iterable[str], facts: Iterable[str], *texts: str) -> str:
    """Return an item of a list: names in code, facts in brackets, and sentences."""
    known = "; ".join(filter(None, facts))
    return f"- {_codes(names)}{f' ({known})' if known else ''}: {'. '.join(text.rstrip('.') for text in texts if text)}."


def _codes(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


PARTS: dict[str, Callable[[], str]] = {
    "packages": packages, "laws": laws, "sweep_keys": sweep_keys, "sweep_results": sweep_results, "scene-keys": scene_keys,
    "run-names": run_names, "exit-codes": exit_codes, "gallery": gallery,
}  # fmt: skip


def regenerated(text: str) -> str:
    return PART.sub(lambda found: f"{found[1]}{PARTS[found[2]]()}\n{found[4]}", text)


if __name__ == "__main__":
    for page in pages():
        page.write_text(regenerated(page.read_text(encoding="utf-8")), encoding="utf-8")
