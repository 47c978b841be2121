"""Types of fields: each checks one value, says in plain English what is wrong, and gives its JSON schema."""

from __future__ import annotations

import math
import numbers
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator, StrictBool, ValidationInfo
from pydantic_core import core_schema

from thirdbody import units

Schema = dict[str, Any]


def show(value: Any) -> str:
    """Return a value as the user wrote it, shortened for a message."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, int) and abs(value) >= 10**40:  # `str` of it may raise
        return f"a number of {int(value.bit_length() * math.log10(2.0)) + 1} digits"
    text = f"'{value}'" if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def plain(value: Any) -> Any:
    """Return tables, lists, numpy arrays and numbers as plain dicts, lists and Python numbers."""
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def in_file(context: Any) -> bool:
    """Return whether a file is read, where a bare number for a quantity with a unit is a fault."""
    return bool(isinstance(context, dict) and context.get("file"))


class FloatInSI(float):
    """A number from Python code for a value of a scene: in SI, whereas one in a file would lack its unit."""


class IntInSI(int):
    """`FloatInSI` for integers."""


def in_si(value: Any) -> Any:
    """Mark the numbers of a value from Python code as numbers in SI, also in arrays, lists and tables."""
    value = plain(value)
    if isinstance(value, dict):
        return {key: in_si(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [in_si(entry) for entry in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return IntInSI(value) if isinstance(value, int) else FloatInSI(value)


def as_float(value: numbers.Real | float) -> float:
    """Return the number as a float. Raises ValueError for an integer outside the range of floats."""
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{show(value)} is outside the range of numbers") from None


def is_unicode(text: str) -> bool:
    """Return False for a text with lone surrogates, which represent non-UTF-8 bytes of the command line; no file holds them."""
    return not any("\ud800" <= letter <= "\udfff" for letter in text)


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


_LIMITS: dict[str, tuple[str, Callable[[Any, Any], bool]]] = {
    "exclusiveMinimum": ("greater than", operator.gt), "minimum": ("at least", operator.ge),
    "exclusiveMaximum": ("less than", operator.lt), "maximum": ("at most", operator.le),
}  # fmt: skip


@dataclass(frozen=True)
class Range:
    """Limits of a number."""

    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None

    def limits(self) -> Schema:
        """Return the limits as keywords of JSON schema."""
        limits = zip(_LIMITS, (self.gt, self.ge, self.lt, self.le), strict=True)
        return {word: limit for word, limit in limits if limit is not None}

    def check(self, value: float, shown: str) -> None:
        """Raise ValueError outside the limits."""
        limits = self.limits()
        if not all(_LIMITS[word][1](value, limit) for word, limit in limits.items()):
            if self.ge is not None and self.ge == self.le:
                raise ValueError(f"{shown} must be {self.ge:g}")
            raise ValueError(f"{shown} must be {' and '.join(f'{_LIMITS[word][0]} {limit:g}' for word, limit in limits.items())}")


@dataclass(frozen=True)
class Quantity(Range):
    """A float in SI of one dimension; text with a unit is converted, and written back with a unit.

    `words` are accepted texts without conversion, such as "auto". With `is_unit` a unit of length may be given by its name.
    """

    dimension: str = "dimensionless"
    words: tuple[str, ...] = ()
    is_unit: bool = False

    def read(self, value: Any, info: ValidationInfo | None = None) -> float | str:
        """Return the SI float. Raises ValueError."""
        if isinstance(value, str):
            if value in self.words:
                return value
            try:
                number = units.parse_unit(value) if self.is_unit else units.parse(value, self.dimension)
            except ValueError as error:
                also = "".join(f" or '{word}'" for word in self.words)
                raise ValueError(f"{error}{also}") from None
        else:
            if isinstance(value, bool) or not isinstance(value, numbers.Real):
                raise ValueError(f"expected {units.DIMENSIONS[self.dimension].phrase}, got {show(value)}")
            number = as_float(value)
            in_si = isinstance(value, FloatInSI | IntInSI) or self.dimension == "dimensionless"
            if info and in_file(info.context) and not in_si and math.isfinite(number):
                units.parse(str(value), self.dimension)  # raises: a bare number has no unit
            if not math.isfinite(number):
                raise ValueError(f"{value} is not a finite number")
        self.check(number, show(value))
        units.refuse_absurd(number, self.dimension, show(value))
        return number

    def write(self, value: float | str) -> float | str:
        """Return the value as written to a file."""
        if isinstance(value, str) or self.dimension == "dimensionless":
            return value
        return units.format_si(value, self.dimension)

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        written = core_schema.plain_serializer_function_ser_schema(self.write)
        return core_schema.with_info_plain_validator_function(self.read, serialization=written)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> Schema:
        return quantity_schema(self.dimension, self.limits(), self.words)


@dataclass(frozen=True)
class Whole(Range):
    """An integer, never converted from a text, a truth value or 20.0."""

    def read(self, value: Any, info: ValidationInfo | None = None) -> int:
        """Return the int. Raises ValueError."""
        if isinstance(value, bool) or not isinstance(value, numbers.Integral):
            raise ValueError(f"expected a whole number, got {show(value)}")
        whole = int(value)
        if abs(whole) >= 2**128:  # seeds may have as many bits
            raise ValueError(f"{show(whole)} is not a whole number of 128 bits")
        self.check(whole, show(whole))
        return whole

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> Schema:
        return {"type": "integer"} | self.limits()


@dataclass(frozen=True, eq=False)
class Read:
    """A value that a function reads and nothing converts: the function, and the JSON schema."""

    read: Callable[[Any], Any]
    schema: Schema

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> Schema:
        return dict(self.schema)  # it is changed further on


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"expected a text, got {show(value)}")
    if not is_unicode(value):
        raise ValueError(f"{show(value)} holds bytes that are no letters of UTF-8")
    return value


def listing(what: str, length: int | None = None) -> BeforeValidator:
    """Return a check that a value is a list; it accepts numpy arrays too.

    Parameters
    ----------
    what : str
        The list in words, for messages.
    length : int, optional
        Its length; None: any.

    Returns
    -------
    pydantic.BeforeValidator
        For `Annotated[...]` of a key.
    """

    def check(value: Any) -> list[Any]:
        value = value.tolist() if hasattr(value, "tolist") else value
        if not isinstance(value, list | tuple):
            raise ValueError(f"expected {what}, got {show(value)}")
        if length not in (None, len(value)):
            raise ValueError(f"expected {what}, got {len(value)} of them")
        return list(value)

    return BeforeValidator(check)


Text = Annotated[str, Read(_text, {"type": "string"})]
Flag = StrictBool
Count = Annotated[int, Whole(ge=1)]
Seed = Annotated[int, Whole(ge=0)]

PositiveNumber = Annotated[float, Quantity(gt=0)]
Fraction = Annotated[float, Quantity(gt=0, le=1)]
Length = Annotated[float, Quantity(dimension="length")]
PositiveLength = Annotated[float, Quantity(dimension="length", gt=0)]
Unit = Annotated[float, Quantity(dimension="length", gt=0, is_unit=True)]
TwoLengths = Annotated[tuple[Length, Length], listing("a list of 2 lengths", 2)]
TwoPositiveLengths = Annotated[tuple[PositiveLength, PositiveLength], listing("a list of 2 lengths", 2)]
PositiveTime = Annotated[float, Quantity(dimension="time", gt=0)]
PositivePressure = Annotated[float, Quantity(dimension="pressure", gt=0)]
PositiveMass = Annotated[float, Quantity(dimension="mass", gt=0)]
Force = Annotated[float, Quantity(dimension="force", ge=0)]
Speed = Annotated[float, Quantity(dimension="velocity")]
_Spin = Annotated[float, Quantity(dimension="angular_velocity")]
Angle = Annotated[float, Quantity(dimension="angle")]

THREE = listing("a list of 3 values", 3)
Point = Annotated[tuple[Length, Length, Length], THREE]
Velocity = Annotated[tuple[Speed, Speed, Speed], THREE]
AngularVelocity = Annotated[tuple[_Spin, _Spin, _Spin], THREE]
AT_REST = (0.0, 0.0, 0.0)
