"""The base of every table of the scene model, and the transport of faults inside tables.

`Part` reports all faults of a table at once, and suggests the nearest known key. Faults are carried by pydantic errors with final
text, so that pydantic prefixes their place when tables are nested.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

from pydantic import (
    BaseModel,
    ConfigDict,
    ModelWrapValidatorHandler,
    SerializerFunctionWrapHandler,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_serializer,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from thirdbody.errors import Fault, InputError, nearest
from thirdbody.scene.field_types import choose, in_file, plain, show

Place = tuple[str | int, ...]
Wrong = tuple[Place, str]  # place relative to the table, and message

MISSING = "required key is missing"

MOST_STRANGE = 100
"""Largest number of unknown keys of one table with a suggestion each: the search for similar names is slow."""


def bundle(wrongs: Iterable[Wrong]) -> ValidationError:
    """Return the faults as one pydantic error, which pydantic merges into that of the enclosing table."""
    details = [
        InitErrorDetails(type=PydanticCustomError("scene", "{text}", {"text": text}), loc=place, input=None)
        for place, text in wrongs
    ]
    return ValidationError.from_exception_data("scene", details)


def wrongs_of(error: ValidationError) -> list[Wrong]:
    """Return place and plain text of every error."""
    result = []
    for entry in error.errors(include_url=False):
        text = MISSING if entry["type"] == "missing" else entry["msg"].removeprefix("Value error, ")
        if entry["type"] == "dict_type":
            text = f"expected a table, got {show(entry['input'])}"
        result.append((tuple(entry["loc"]), text))
    return result


def key_path(place: Iterable[str | int]) -> str:
    """Return the place as text: ("debris", 0, "size") is debris[0].size."""
    path = ""
    for part in place:
        if isinstance(part, int):
            path += f"[{part}]"
        else:
            word = part if part and all(c.isalnum() or c in "-_" for c in part) else f'"{part}"'
            path += f".{word}" if path else word
    return path


def entry(node: Any, key: str) -> Any:
    """Return the entry of an unchecked table or of a checked one; None when there is none."""
    return node.get(key) if isinstance(node, Mapping) else getattr(node, key, None)


def key_place(path: str) -> Place:
    """Return the place of a path: debris[0].size is ("debris", 0, "size")."""
    return tuple(int(number) if number else word for number, word in re.findall(r"\[(\d+)\]|([^.\[\]]+)", path))


def union_by_key(key: str, kinds: Mapping[str, type[Part]], later: tuple[str, ...] = ()) -> WrapValidator:
    """Return a validator that selects the class of a table by one of its keys, so only faults of that class are reported."""

    def read(value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        if isinstance(value, tuple(kinds.values())):
            return value
        return chosen_kind(key, kinds, value, later).model_validate(value, context=info.context)

    return WrapValidator(read)


def chosen_kind(key: str, kinds: Mapping[str, type[Part]], value: Any, later: tuple[str, ...] = ()) -> type[Part]:
    """Return the class of a table by the value of its key. Raises ValueError, or ValidationError with the fault at that key."""
    if not isinstance(value, Mapping):
        raise ValueError(f"expected a table, got {show(value)}")
    if value.get(key) is None:
        listed = ", ".join(f"'{name}'" for name in kinds)
        raise bundle([((key,), f"{MISSING}: one of {listed}")])
    try:
        return kinds[choose(value[key], kinds, later, key)]
    except ValueError as error:
        raise bundle([((key,), str(error))]) from None


def one_of(raw: Mapping[str, Any], keys: tuple[str, ...]) -> list[Wrong]:
    """Return a fault unless exactly one of the keys is given."""
    given = [key for key in keys if key in raw]
    if not given:
        return [((), f"give one of {', '.join(keys)}")]
    return [((key,), f"give only one of {', '.join(keys)}: {given[0]} is given too") for key in given[1:]]


class Part(BaseModel):
    """A table of the scene. Built in Python it raises InputError with all its faults."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    later: ClassVar[dict[str, str]] = {}  # keys of the file format that do not work yet: what works instead
    rest: ClassVar[str] = ""  # the field for all further keys, in tables that plug-ins extend

    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise InputError(Fault(key_path(place), text) for place, text in wrongs_of(error)) from None

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

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: Any, handler: Any) -> dict[str, Any]:
        schema = handler.resolve_ref_schema(handler(core_schema))
        if cls.rest:  # checked by a plug-in
            schema["properties"].pop(cls.rest, None)
            schema["additionalProperties"] = True
        return schema

    @model_validator(mode="wrap")
    @classmethod
    def _collect(cls, data: Any, handler: ModelWrapValidatorHandler[Any], info: ValidationInfo) -> Any:
        if isinstance(data, cls):
            return data
        if not isinstance(data, Mapping):
            raise ValueError(f"expected a table, got {show(data)}")
        raw = {key: value for key, value in data.items() if value is not None}
        if cls.rest:
            raw = cls._gather(raw, in_file(info))
        raw, renamed, wrongs = cls._known(raw)
        wrongs += cls.rules(raw, info.context)
        wrongs += [(place, "nan is not a number") for place in _lost(raw.get(cls.rest, {}))]
        try:
            part = handler(cls.arrange(raw))
            wrongs += part.checks()
        except ValidationError as error:
            report = {place for place, _ in wrongs}
            wrongs += [wrong for wrong in wrongs_of(error) if wrong[0] not in report]
        if cls.later.keys() & data.keys():  # what the postponed key would have given is not missing
            wrongs = [(place, text) for place, text in wrongs if place and text != MISSING]
        if wrongs:
            raise bundle((_rename(place, renamed), text) for place, text in wrongs)
        return part

    @classmethod
    def _gather(cls, raw: dict[str, Any], from_file: bool) -> dict[str, Any]:
        """Move further keys into the field `rest`, where a plug-in checks them."""
        own = {key: value for key, value in raw.items() if key in cls.model_fields and key != cls.rest}
        further = {key: plain(value) for key, value in raw.items() if key not in own}
        if not from_file:
            further |= plain(further.pop(cls.rest, {}))
        return own | {cls.rest: further}

    @classmethod
    def _known(cls, raw: dict[str, Any]) -> tuple[dict[str, Any], dict[str, str], list[Wrong]]:
        """Return the known keys, misspelt ones under the intended name, and the faults of the others.

        Reading under the intended name prevents that one misspelling is also reported as a missing key.
        """
        saved = {key: value for key, value in raw.items() if key in cls.model_fields}
        renamed: dict[str, str] = {}
        wrongs: list[Wrong] = []
        strange = [key for key in raw if key not in saved]
        for key in strange[:MOST_STRANGE]:
            if key in cls.later:
                text = f"{key} = {show(raw[key])} is known but not available in this version"
                wrongs.append(((key,), f"{text}; available: {cls.later[key]}"))
                continue
            wrongs.append(((key,), f"unknown key, {cls.suggestion(str(key))}"))
            for meant in difflib.get_close_matches(str(key), cls.model_fields.keys() - saved.keys(), 1, 0.7):
                saved[meant] = raw[key]
                renamed[meant] = key
        if len(strange) > MOST_STRANGE:
            more = len(strange) - MOST_STRANGE
            wrongs.append(((strange[MOST_STRANGE],), f"unknown key, and so are {more - 1} more after it"))
        return saved, renamed, wrongs

    @model_serializer(mode="wrap")
    def _spread(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        document = handler(self)
        if self.rest:
            document.update(document.pop(self.rest))
        return document


def _lost(value: Any, place: Place = ()) -> list[Place]:
    """Return the places of NaN among keys for a plug-in: NaN equals nothing, so the scene would not equal itself."""
    if isinstance(value, float):
        return [place] if math.isnan(value) else []
    entries = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    return [found for key, entry in entries for found in _lost(entry, (*place, key))]


def _rename(place: Place, renamed: dict[str, str]) -> Place:
    return (renamed.get(str(place[0]), place[0]), *place[1:]) if place else place
