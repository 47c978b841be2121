"""Generated parts of the reference: keys of a scene, series and arrays of a run, exit codes."""

from collections.abc import Iterable, Sequence
from functools import cache
from itertools import groupby

from thirdbody.errors import EXIT_CODES
from thirdbody.laws.registry import Registry, discover
from thirdbody.report.key_reference import KEY_HEADINGS, NAME_HEADINGS, all_keys, all_names, key_rows, name_rows

HEADINGS = {"materials": "materials.NAME", "pairs": "[pairs]", "debris": "[debris]"}
"""Tables that are written otherwise than their keys' paths begin."""


@cache
def registry() -> Registry:
    return discover()


def scene_keys() -> str:
    parts = []
    for name, keys in groupby(all_keys(registry()), key=lambda key: key.path.rpartition(".")[0] and key.path.split(".")[0]):
        rows = [(f"`{path}`", *cells, f"`{example}`") for path, *cells, example in key_rows(keys)]
        title = f"[{HEADINGS.get(name, name)}]" if name else "Top of the file"
        parts.append(f"### {title}\n\n{markdown(KEY_HEADINGS, rows)}")
    return "\n\n".join(parts)


def run_names() -> str:
    parts = []
    for name, entries in all_names(registry()).items():
        rows = [(f"`{first}`", *rest) for first, *rest in name_rows(entries)]
        parts.append(f"### {name}\n\n{markdown(NAME_HEADINGS, rows)}")
    return "\n\n".join(parts)


def exit_codes() -> str:
    return markdown(("code", "meaning"), [(str(code), meaning) for code, meaning in EXIT_CODES.items()])


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |" for line in lines)


PARTS = {"scene-keys": scene_keys, "run-names": run_names, "exit-codes": exit_codes}
