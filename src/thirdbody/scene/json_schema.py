"""JSON schema of a scene file (`Scene.model_json_schema()`), for editors that complete and check TOML."""

from dataclasses import dataclass
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
    return {"anyOf": [{"enum": list(words)}, schema]} if words else schema


@dataclass(frozen=True, eq=False)  # compared by identity: annotations must have a hash
class ShortForm:
    """Annotation of a field with a shorter form: the schema of that form, or None for a single entry of the list."""

    schema: Schema | None = None

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> Schema:
        full = handler(core_schema)
        return {"anyOf": [full["items"] if self.schema is None else self.schema, full]}
