"""The generated parts of the pages: `python tests/generated_parts.py` writes them anew.

A page marks a part by `<!-- generated: NAME -->` and `<!-- end -->`; `PARTS[NAME]()` gives the text between them."""

import ast
import inspect
import re
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby

from gallery import gallery
from pages import ROOT, pages
from thirdbody.errors import EXIT_CODES
from thirdbody.laws.registry import discover
from thirdbody.report.reference import KEY_HEADINGS, NAME_HEADINGS, all_keys, all_names, key_rows, name_rows

SOURCE = ROOT / "src" / "thirdbody"
PART = re.compile(r"(<!-- generated: ([\w-]+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


def _table(head: str, rows: list[str]) -> str:
    return "\n".join([f"| {head} |", "|---" * (head.count("|") + 1) + "|", *rows])


def packages() -> str:
    rows = []
    for path in sorted(SOURCE.rglob("__init__.py")):
        name = ".".join(path.parent.relative_to(SOURCE).parts)
        docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        rows.append(f"| `{name or 'thirdbody'}` | {docstring.splitlines()[0] if docstring else ''} |")
    return _table("package | what it holds", rows)


def tables() -> str:
    from thirdbody.kernels import close_spots, step_tables, tables, tile
    from thirdbody.kernels.table import Table

    modules = (tables, tile, step_tables, close_spots)
    found = {name: value for module in modules for name, value in vars(module).items() if isinstance(value, Table)}
    return "\n\n".join(f"### {name}\n\n{table.markdown()}" for name, table in sorted(found.items()))


def laws() -> str:
    from thirdbody.laws.contract import STAGES, STIFF

    rows = []
    for law in sorted(_registry().laws.values(), key=lambda law: (STAGES.index(law.stage), law.name)):
        integrators = "explicit" if law.tangent is None and (law.stage in STIFF or law.reach) else "both"
        rows.append(f"| `{law.name}` | {law.stage} | {_options(law)} | {integrators} | {law.source} |")
    return _table("law | stage | options | integrators | source", rows)


def levels() -> str:
    rows = []
    for family in _registry().families.values():
        for level, chain in family.levels.items():
            default = ", the default" if level == family.default_level else ""
            rows.append(f"| `{family.name}` | `{level}`{default} | {', '.join(f'`{law.name}`' for law in chain)} |")
    return _table("family | level | laws", rows)


def effects() -> str:
    rows = [f"| `{e.name}` | {_options(e)} | {e.source} |" for e in _registry().effects.values()]
    return _table("effect | options | source", rows)


def measures() -> str:
    from thirdbody.laws.measures import layout_of

    rows = []
    for measure in _registry().measures.values():
        layout = layout_of([measure])
        names, maps = (", ".join(f"`{entry.name}`" for entry in entries) for entries in (layout.bodies, layout.maps))
        rows.append(f"| `{measure.name}` | {_options(measure)} | {names} | {maps or '-'} | {measure.source} |")
    return _table("measure | options | arrays of bodies | maps | source", rows)


def kinds() -> str:
    from thirdbody.debris.registry import DebrisKinds

    rows = [f"| `{name}` | {_first_sentence(kind.__doc__)} |" for name, kind in DebrisKinds().usable().items()]
    return _table("kind | what it makes", rows)


def law_data() -> str:
    """What kernels receive and return: the fields of the contract's named tuples, from their docstrings."""
    from thirdbody import plugin

    rows = []
    for name in "Contact Normal Adhesion Load Tangential Turn Rolling Twist Twisting Body Wrench ContactStep".split():
        docstring = inspect.cleandoc(getattr(plugin, name).__doc__)
        fields = re.findall(r"^(\w+(?:, \w+)*) : (?:float\n    )?(.+)$", docstring, re.MULTILINE)
        for k, (names, meaning) in enumerate(fields):
            first = f"`{name}`: {_first_sentence(docstring).rstrip('.').lower()}" if k == 0 else ""
            rows.append(f"| {first} | {', '.join(f'`{one}`' for one in names.split(', '))} | {meaning} |")
    return _table("tuple | field | meaning", rows)


def _registry():
    return discover([ROOT / "plugins" / "dmt_adhesion.py"])


def _options(thing) -> str:
    return ", ".join(map(_option, thing.options)) or "-"


def _option(option) -> str:
    if option.default is None:
        return f"`{option.name}` ({option.dimension.replace('_', ' ')}, required)"
    default = f'"{option.default}"' if isinstance(option.default, str) else f"{option.default:g}"
    words = f", or {', '.join(repr(word) for word in option.words if word != option.default)}" if len(option.words) > 1 else ""
    return f"`{option.name} = {default}`{words}".replace("'", '"')


def _first_sentence(docstring):
    return re.split(r"(?<=\.)\s", " ".join((docstring or "").split()))[0]


def sweep_keys() -> str:
    from thirdbody.scene.keys import table_keys
    from thirdbody.studies.sweep_file import SweepFile

    rows = []
    for key in table_keys(SweepFile.model_json_schema()):
        default = f"`{key.default}`" if key.default not in ("", "required") and len(key.default) < 40 else key.default
        shown = default if len(default) < 40 else "below"
        rows.append(f"| `{key.path}` | {key.value} | {shown} | {key.meaning} | `{key.example}` |")
    return _table("key | value | default | meaning | example", rows)


def sweep_results() -> str:
    from thirdbody.studies.results import DEFAULT, RESULTS, result

    states = {f"{name}STATE": result(f"{name}STATE") for name in ("fraction_", "fraction_ever_")}
    rows = []
    for name, entry in sorted((RESULTS | states).items()):
        usual = name in DEFAULT or name == "fraction_STATE"
        usual_word = "rolling" if name == "fraction_ever_STATE" else "yes" if usual else ""
        rows.append(f"| `{name}` | {'' if entry.unit == '1' else entry.unit} | {usual_word} | {entry.meaning} |")
    return _table("result | unit | default | meaning", rows)


# tables that are written otherwise than their keys' paths begin
HEADINGS = {"materials": "materials.NAME", "pairs": "[pairs]", "debris": "[debris]"}


def scene_keys() -> str:
    parts = []
    for name, keys in groupby(all_keys(discover()), key=lambda key: key.path.rpartition(".")[0] and key.path.split(".")[0]):
        rows = [(f"`{path}`", *cells, f"`{example}`") for path, *cells, example in key_rows(keys)]
        title = f"[{HEADINGS.get(name, name)}]" if name else "Top of the file"
        parts.append(f"### {title}\n\n{markdown(KEY_HEADINGS, rows)}")
    return "\n\n".join(parts)


def run_names() -> str:
    tables = {name: [(f"`{first}`", *rest) for first, *rest in name_rows(found)] for name, found in all_names(discover()).items()}
    return "\n\n".join(f"### {name}\n\n{markdown(NAME_HEADINGS, rows)}" for name, rows in tables.items())


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |" for line in lines)


PARTS: dict[str, Callable[[], str]] = {
    "packages": packages, "tables": tables, "laws": laws, "levels": levels, "effects": effects, "measures": measures,
    "kinds": kinds, "sweep_keys": sweep_keys, "sweep_results": sweep_results,
    "law-data": law_data, "scene-keys": scene_keys, "run-names": run_names,
    "exit-codes": lambda: markdown(("code", "meaning"), [(str(code), words) for code, words in EXIT_CODES.items()]),
    "gallery": gallery,
}  # fmt: skip


def regenerated(text: str) -> str:
    return PART.sub(lambda found: f"{found[1]}{PARTS[found[2]]()}\n{found[4]}", text)


if __name__ == "__main__":
    for page in pages():
        page.write_text(regenerated(page.read_text(encoding="utf-8")), encoding="utf-8")
