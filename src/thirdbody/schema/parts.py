"""The base of every checked table, and the transport of faults inside tables.

`Part` reports all faults of a table at once, and suggests the nearest known key. Faults are carried by pydantic errors with final
text, so that pydantic prefixes their place when tables are nested. What a key means stands below its declaration, as a docstring
that may end with `Example: ...`, a TOML value; it becomes part of the JSON schema.
"""

from __future__ import annotations

import ast
import difflib
import inspect
import math
import re
import textwrap
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, WrapValidator, model_serializer, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from thirdbody.errors import Fault, InputError, nearest
from thirdbody.schema.fields import Schema, in_file, plain, show

Location = tuple[str | int, ...]
Wrong = tuple[Location, str]  # place relative to the table, and message

MISSING = "required key is missing"

MAX_UNKNOWN = 100
"""Largest number of unknown keys of one table with a suggestion each: the search for similar names is slow."""


def bundle(faults: Iterable[Wrong]) -> ValidationError:
    """Return the faults as one pydantic error, which pydantic merges into that of the enclosing table."""
    details = [
        InitErrorDetails(type=PydanticCustomError("scene", "{text}", {"text": text}), loc=location, input=None)
        for location, text in faults
    ]
    return ValidationError.from_exception_data("scene", details)


def wrongs_of(error: ValidationError) -> list[Wrong]:
    """Return place and plain text of every error."""
    result = []
    for entry in error.errors(include_url=False):
        text = MISSING if entry["type"] == "missing" else entry["msg"].removeprefix("Value error, ")
        if expected := {"dict_type": "a table", "bool_type": "true or false"}.get(entry["type"]):
            text = f"expected {expected}, got {show(entry['input'])}"
        if entry["type"] == "literal_error":
            text = f"{show(entry['input'])} is not one of {entry['ctx']['expected'].replace(' or ', ', ')}"
        result.append((tuple(entry["loc"]), text))
    return result


def key_path(location: Iterable[str | int]) -> str:
    """Return the place as text: ("debris", 0, "size") is debris[0].size."""
    path = ""
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        else:
            word = part if part and all(c.isalnum() or c in "-_" for c in part) else f'"{part}"'
            path += f".{word}" if path else word
    return path


def differences(*documents: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return the values of every key that is not the same in all documents, by `key_path`; "absent" where one lacks it."""
    tables = [_leaves(document) if document else {} for document in documents]
    keys = dict.fromkeys(key for table in tables for key in table)
    rows = {key: [table.get(key, "absent") for table in tables] for key in keys}
    return {key: values for key, values in rows.items() if any(value != values[0] for value in values)}


def _leaves(value: Any, location: Location = ()) -> dict[str, Any]:
    """Return the values of nested tables, and of lists of tables, by `key_path`; another list is one value."""
    inner: Iterable[tuple[str | int, Any]] = ()
    if isinstance(value, Mapping):
        inner = value.items()
    elif isinstance(value, list) and any(isinstance(part, Mapping) for part in value):
        inner = enumerate(value)
    parts = {key: leaf for name, part in inner for key, leaf in _leaves(part, (*location, name)).items()}
    return parts or {key_path(location): value}


def key_location(path: str) -> Location:
    """Return the place of a path: debris[0].size is ("debris", 0, "size")."""
    return tuple(int(number) if number else word for number, word in re.findall(r"\[(\d+)\]|([^.\[\]]+)", path))


def entry(node: Any, key: str) -> Any:
    """Return the entry of an unchecked table or of a checked one; None when there is none."""
    return node.get(key) if isinstance(node, Mapping) else getattr(node, key, None)


def one_of(raw: Mapping[str, Any], keys: tuple[str, ...]) -> list[Wrong]:
    """Return a fault unless exactly one of the keys is given.

    Parameters
    ----------
    raw : mapping
        The unchecked table.
    keys : tuple of str
        Keys that exclude each other.

    Returns
    -------
    list of Wrong
        Empty, or one fault: place and text.
    """
    given = [key for key in keys if key in raw]
    if not given:
        return [((), f"give one of {', '.join(keys)}")]
    return [((key,), f"give only one of {', '.join(keys)}: {given[0]} is given too") for key in given[1:]]


class Part(BaseModel):
    """A checked, frozen table. Built in Python it raises InputError with all its faults."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    extra_keys: ClassVar[str] = ""  # the field for all further keys, in tables that plug-ins extend

    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise InputError(Fault(key_path(location), text) for location, text in wrongs_of(error)) from None

    # Makes pydantic validate nested tables itself, so that faults are merged, as RootModel does.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        """Return faults that follow from which keys are given; runs even when single values are wrong."""
        return []

    @classmethod
    def suggestion(cls, key: str) -> str:
        """Return a phrase that suggests the known key nearest to an unknown one."""
        return nearest(key, cls.model_fields)

    @classmethod
    def arrange(cls, raw: dict[str, Any]) -> dict[str, Any]:
        """Return the table with short forms written out. Raises ValidationError."""
        return raw

    def checks(self) -> list[Wrong]:
        """Return faults between values that are each valid."""
        return []

    @model_validator(mode="wrap")
    @classmethod
    def _collect(cls, data: Any, handler: Callable[[Any], Any], info: ValidationInfo) -> Any:
        if isinstance(data, cls):
            return data
        if not isinstance(data, Mapping):
            raise ValueError(f"expected a table, got {show(data)}")
        raw = {key: value for key, value in data.items() if value is not None}
        if cls.extra_keys:  # further keys go into this field, where a plug-in checks them
            own = {key: raw.pop(key) for key in list(raw) if key in cls.model_fields and key != cls.extra_keys}
            further = {key: plain(value) for key, value in raw.items()}
            if not in_file(info.context):
                further |= plain(further.pop(cls.extra_keys, {}))
            raw = own | {cls.extra_keys: further}
        raw, renamed, faults = cls._known(raw)
        faults += cls.rules(raw, info.context)
        faults += [(location, "nan is not a number") for location in _nan_locations(raw.get(cls.extra_keys, {}))]
        try:
            part = handler(cls.arrange(raw))
            faults += part.checks()
        except ValidationError as error:
            report = {location for location, _ in faults}
            faults += [wrong for wrong in wrongs_of(error) if wrong[0] not in report]
        if faults:
            raise bundle((tuple(renamed.get(str(key), key) for key in where[:1]) + where[1:], text) for where, text in faults)
        return part

    @classmethod
    def _known(cls, raw: dict[str, Any]) -> tuple[dict[str, Any], dict[str, str], list[Wrong]]:
        """Return the known keys, misspelt ones under the intended name, and the faults of the others.

        Reading under the intended name prevents that one misspelling is also reported as a missing key.
        """
        known = {key: value for key, value in raw.items() if key in cls.model_fields}
        renamed: dict[str, str] = {}
        faults: list[Wrong] = []
        strange = [key for key in raw if key not in known]
        for key in strange[:MAX_UNKNOWN]:
            faults.append(((key,), f"unknown key, {cls.suggestion(str(key))}"))
            for meant in difflib.get_close_matches(str(key), cls.model_fields.keys() - known.keys(), 1, 0.7):
                known[meant] = raw[key]
                renamed[meant] = key
        if len(strange) > MAX_UNKNOWN:
            more = len(strange) - MAX_UNKNOWN - 1
            faults.append(((strange[MAX_UNKNOWN],), f"unknown key, and so are {more} more after it"))
        return known, renamed, faults

    @model_serializer(mode="wrap")
    def _flatten(self, handler: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        document = handler(self)
        return document | document.pop(self.extra_keys) if self.extra_keys else document

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: Any, handler: Any) -> Schema:
        schema = handler.resolve_ref_schema(handler(core_schema))
        if cls.extra_keys:  # checked by a plug-in
            schema["properties"].pop(cls.extra_keys, None)
            schema["additionalProperties"] = True
        schema["properties"] = described(schema.get("properties", {}), cls)
        return schema


def _nan_locations(value: Any, location: Location = ()) -> list[Location]:
    """Return the places of NaN among keys for a plug-in: NaN equals nothing, so the scene would not equal itself."""
    if isinstance(value, float):
        return [location] if math.isnan(value) else []
    entries = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    return [inner for key, entry in entries for inner in _nan_locations(entry, (*location, key))]


# -- tables of several kinds at one place --

Kinds = Mapping[str, type[Part]]


def table_by_kind(value: Any, info: ValidationInfo, key: str, kinds: Kinds, hint: str = "") -> Part:
    """Return one table, of the class that its key names. Raises ValueError, or ValidationError with the faults of that class.

    `hint`: what else may be wrong where no class has the name.
    """
    if not isinstance(value, Mapping):
        raise ValueError(f"expected a table, got {show(value)}")
    name = value.get(key)
    if not isinstance(name, str) or name not in kinds:
        listed = ", ".join(f"'{known}'" for known in kinds)
        what = f"{MISSING}: one of {listed}" if name is None else f"{show(name)} is not one of {listed}{hint}"
        raise bundle([((key,), what)])
    try:
        kind = kinds[name]
    except ValueError as error:
        raise bundle([((key,), f"{error}{hint}")]) from None
    return kind.model_validate(value, context=info.context)


def table_by_leading_key(value: Any, info: ValidationInfo, kinds: Kinds, example: str) -> Any:
    """Return one table, of the class whose leading key it has. Raises ValueError, or ValidationError with its faults."""
    if isinstance(value, tuple(kinds.values())):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f"expected a table such as {example}, got {show(value)}")
    leading = [key for key in kinds if key in value]
    leading = leading or [near for key in value for near in difflib.get_close_matches(key, kinds, 1, 0.6)]
    if len(leading) != 1:
        raise ValueError(f"give one of {', '.join(kinds)}" + (f", not {' and '.join(leading)}" if leading else ""))
    return kinds[leading[0]].model_validate(value, context=info.context)


def one_or_more(what: str, kinds: Kinds, example: str, endless: Callable[[Any], str | None] = lambda _: None) -> WrapValidator:
    """Return a validator of one table, or of a list of them, each with one leading key.

    `what` names the tables in messages; `kinds`: leading key to table; `endless` names the key that a table before the last needs
    to have an end, None if it has one.
    """

    def read(value: Any, handler: Any, info: ValidationInfo) -> tuple[Part, ...]:
        several = isinstance(value, list | tuple)
        entries = list(value) if several else [value]
        if not entries:
            raise ValueError(f"the list of {what} is empty")
        result, faults = [], list[Wrong]()
        for k, entry in enumerate(entries):
            location: Location = (k,) if several else ()
            try:
                result.append(table_by_leading_key(entry, info, kinds, example))
            except ValidationError as error:
                faults += [((*location, *where), text) for where, text in wrongs_of(error)]
            except ValueError as error:
                faults.append((location, str(error)))
        lacking = [(k, endless(table)) for k, table in enumerate(result[:-1])]
        faults += [((k, key), f"{MISSING}: only the last stage may go on for ever") for k, key in lacking if key is not None]
        if faults:
            raise bundle(faults)
        return tuple(result)

    return WrapValidator(read)


# -- meanings of keys --


def described(properties: Schema, table: type) -> Schema:
    """Return the properties of a table with the meaning and the example of each key."""
    result = {}
    for key, schema in properties.items():
        meaning, _, example = key_docs(table).get(key, "").partition(" Example: ")
        inner = {word: value for word, value in schema.items() if word != "default"}
        if meaning and ("description" in inner or "$ref" in inner):
            inner = {"allOf": [inner]}
        if meaning:
            inner |= {"description": meaning}
        if example:
            text = example.removesuffix(".")
            inner |= {"examples": [tomllib.loads(f"value = {text}")["value"]], "x-example": text}
        result[key] = inner | {word: value for word, value in schema.items() if word == "default"}
    return result


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
