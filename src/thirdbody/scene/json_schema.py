"""JSON schema of a scene file (`Scene.model_json_schema()`), for editors that complete and check TOML, and for `keys`.

What a key means stands below its declaration, as a docstring that may end with `Example: ...`, a TOML value.
"""

import ast
import inspect
import textwrap
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from thirdbody import units

Schema = dict[str, Any]


def quantity_schema(dimension: str, limits: Schema, words: tuple[str, ...] = ()) -> Schema:
    """Return the schema of a pure number, or of a text with a unit of the dimension."""
    if dimension == "dimensionless":
        schema: Schema = {"type": "number"} | limits
    else:
        accepted = units.accepted_units(dimension)
        report = f"{units.DIMENSIONS[dimension].phrase} with its unit: {', '.join(accepted)}"
        schema = {"type": "string", "description": report, "examples": [f"1 {accepted[len(accepted) // 2]}"]}
        schema |= {"x-dimension": dimension, "x-limits": limits}
    return {"anyOf": [{"enum": list(words)}, schema]} if words else schema


@dataclass(frozen=True, eq=False)  # compared by identity: annotations must have a hash
class ShortForm:
    """Annotation of a field with a shorter form: the schema of that form, or None for a single entry of the list."""

    schema: Schema | None = None

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> Schema:
        full = handler(core_schema)
        return {"anyOf": [full["items"] if self.schema is None else self.schema, full]}


def described(properties: Schema, table: type) -> Schema:
    """Return the properties of a table with the meaning and the example of each key."""
    return {key: _described(value, key_docs(table).get(key, "")) for key, value in properties.items()}


def _described(schema: Schema, doc: str) -> Schema:
    meaning, _, example = doc.partition(" Example: ")
    if not meaning:
        return schema
    inner = {key: value for key, value in schema.items() if key != "default"}
    result: Schema = {"allOf": [inner]} if "description" in inner or "$ref" in inner else inner
    result |= {"description": meaning}
    if example:
        text = example.removesuffix(".")
        result |= {"examples": [tomllib.loads(f"value = {text}")["value"]], "x-example": text}
    return result | {key: value for key, value in schema.items() if key == "default"}


@cache
def key_docs(table: type) -> dict[str, str]:
    """Return the docstrings of the keys of a table by name, those of its base classes included, each in one line."""
    docs: dict[str, str] = {}
    for part in reversed(table.__mro__[:-1]):
        try:
            source = textwrap.dedent(inspect.getsource(part))
        except (OSError, TypeError):  # a class from no file
            continue
        docs |= dict(_docstrings(ast.parse(source).body[0].body))  # type: ignore[attr-defined]
    return docs


def _docstrings(body: list[ast.stmt]) -> Iterator[tuple[str, str]]:
    """Yield name and docstring of the attributes declared in a class body, those for type checkers included."""
    for here, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(here, ast.If):
            yield from _docstrings(here.body)
        if isinstance(here, ast.AnnAssign) and isinstance(here.target, ast.Name) and isinstance(after, ast.Expr):
            if isinstance(after.value, ast.Constant) and isinstance(after.value.value, str):
                yield here.target.id, " ".join(after.value.value.split())
