"""Field types of the scene model: each checks one value and says in plain English what is wrong."""

import ast
import inspect
import math
import numbers
import textwrap
import tomllib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, get_args

from pydantic import BeforeValidator, ValidationInfo
from pydantic_core import core_schema

from thirdbody import units

LONG_NUMBER = 10**40
"""Integers from here on are reported by their number of digits."""


def show(value: Any) -> str:
    """Return a value as the user wrote it, shortened for a message."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, int) and abs(value) >= LONG_NUMBER:
        return f"a number of {int(value.bit_length() * math.log10(2.0)) + 1} digits"  # `str` of it may raise
    text = f"'{value}'" if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def plain(value: Any) -> Any:
    """Return tables, lists, numpy arrays and numbers as plain dicts, lists and Python numbers."""
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def in_file(info: ValidationInfo) -> bool:
    """Return whether a file is read, where a bare number for a quantity with a unit is a fault."""
    return bool(isinstance(info.context, dict) and info.context.get("file"))


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


@dataclass(frozen=True)
class Range:
    """Limits of a number; `word` describes them."""

    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None

    def check(self, value: float, shown: str) -> None:
        """Raise ValueError outside the limits."""
        limits = [
            ("greater than", self.gt, self.gt is None or value > self.gt),
            ("at least", self.ge, self.ge is None or value >= self.ge),
            ("less than", self.lt, self.lt is None or value < self.lt),
            ("at most", self.le, self.le is None or value <= self.le),
        ]
        if not all(satisfied for _, _, satisfied in limits):
            if self.ge is not None and self.ge == self.le:
                raise ValueError(f"{shown} must be {self.ge:g}")
            report = " and ".join(f"{word} {limit:g}" for word, limit, _ in limits if limit is not None)
            raise ValueError(f"{shown} must be {report}")

    def limits(self) -> dict[str, float]:
        """Return the limits as keywords of JSON schema."""
        words = {"exclusiveMinimum": self.gt, "minimum": self.ge, "exclusiveMaximum": self.lt, "maximum": self.le}
        return {word: limit for word, limit in words.items() if limit is not None}


@dataclass(frozen=True)
class Quantity(Range):
    """A float in SI of one dimension; text with a unit is converted, and written back with a unit.

    `words` are accepted texts without conversion, such as "auto".
    """

    dimension: str = "dimensionless"
    words: tuple[str, ...] = ()

    def read(self, value: Any, info: ValidationInfo) -> float | str:
        """Return the SI float. Raises ValueError."""
        if isinstance(value, str):
            return value if value in self.words else self._text(value)
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise ValueError(f"expected {units.DIMENSIONS[self.dimension].phrase}, got {show(value)}")
        number = as_float(value)
        bare = in_file(info) and not isinstance(value, FloatInSI | IntInSI)
        if bare and self.dimension != "dimensionless" and math.isfinite(number):
            units.parse(str(value), self.dimension)  # raises: a bare number has no unit
        if not math.isfinite(number):
            raise ValueError(f"{value} is not a finite number")
        self.check(number, show(value))
        units.refuse_absurd(number, self.dimension, show(value))
        return number

    def _text(self, text: str) -> float:
        try:
            value = units.parse(text, self.dimension)
        except ValueError as error:
            also = " or ".join(f"'{word}'" for word in self.words)
            raise ValueError(f"{error} or {also}" if also else str(error)) from None
        self.check(value, show(text))
        units.refuse_absurd(value, self.dimension, show(text))
        return value

    def write(self, value: float | str) -> float | str:
        """Return the value as written to a file."""
        if isinstance(value, str) or self.dimension == "dimensionless":
            return value
        return units.format_si(value, self.dimension)

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return _function_schema(self.read, self.write)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return quantity_schema(self.dimension, self.limits(), self.words)


@dataclass(frozen=True)
class Whole(Range):
    """An integer, never converted from a text, a truth value or 20.0."""

    def read(self, value: Any, info: ValidationInfo) -> int:
        """Return the int. Raises ValueError."""
        if isinstance(value, bool) or not isinstance(value, numbers.Integral):
            raise ValueError(f"expected a whole number, got {show(value)}")
        whole = int(value)
        if abs(whole) >= 2**128:  # seeds may have as many bits
            raise ValueError(f"{show(whole)} is not a whole number of 128 bits")
        self.check(whole, show(whole))
        return whole

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return _function_schema(self.read)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {"type": "integer"} | self.limits()


@dataclass(frozen=True)
class Choice:
    """One of the names in the field's Literal."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        names = get_args(source)

        return core_schema.no_info_before_validator_function(
            lambda value: choose(value, names), core_schema.literal_schema(list(names))
        )


def choose(value: Any, names: Collection[str]) -> str:
    """Return the value when it is one of the names. Raises ValueError that lists them."""
    if isinstance(value, str) and value in names:
        return value
    listed = ", ".join(f"'{name}'" for name in names)
    raise ValueError(f"{show(value)} is not one of {listed}")


def is_unicode(text: str) -> bool:
    """Return False for a text with lone surrogates, which represent non-UTF-8 bytes of the command line; no file holds them."""
    return not any("\ud800" <= letter <= "\udfff" for letter in text)


@dataclass(frozen=True)
class _Typed:
    """A value that must have its type already: no conversion, so a misplaced value is detected."""

    kind: type
    name: str
    json: str

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        def read(value: Any, info: ValidationInfo) -> Any:
            if not isinstance(value, self.kind):
                raise ValueError(f"expected {self.name}, got {show(value)}")
            if isinstance(value, str) and not is_unicode(value):
                raise ValueError(f"{show(value)} holds bytes that are no letters of UTF-8")
            return value

        return _function_schema(read)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {"type": self.json}


TEXT = _Typed(str, "a text", "string")
FLAG = _Typed(bool, "true or false", "boolean")


def _function_schema(read: Any, write: Any = None) -> core_schema.CoreSchema:
    serial = core_schema.plain_serializer_function_ser_schema(write) if write else None
    return core_schema.with_info_plain_validator_function(read, serialization=serial)


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
        if len(value) != (len(value) if length is None else length):
            raise ValueError(f"expected {what}, got {len(value)} of them")
        return list(value)

    return BeforeValidator(check)


Text = Annotated[str, TEXT]
Flag = Annotated[bool, FLAG]
MAX_SPHERES = 10_000_000
"""Largest number of spheres of a scene: about 10 GB of state and contacts. More is refused before anything is allocated."""

Count = Annotated[int, Whole(ge=1)]
Seed = Annotated[int, Whole(ge=0)]

Number = Annotated[float, Quantity()]
PositiveNumber = Annotated[float, Quantity(gt=0)]
Fraction = Annotated[float, Quantity(gt=0, le=1)]

Length = Annotated[float, Quantity(dimension="length")]
PositiveLength = Annotated[float, Quantity(dimension="length", gt=0)]
PositiveTime = Annotated[float, Quantity(dimension="time", gt=0)]
PositivePressure = Annotated[float, Quantity(dimension="pressure", gt=0)]
PositiveMass = Annotated[float, Quantity(dimension="mass", gt=0)]
PositiveForce = Annotated[float, Quantity(dimension="force", gt=0)]
Force = Annotated[float, Quantity(dimension="force", ge=0)]
PositiveStiffness = Annotated[float, Quantity(dimension="stiffness", gt=0)]
PositiveFrequency = Annotated[float, Quantity(dimension="frequency", gt=0)]
PositiveDensity = Annotated[float, Quantity(dimension="density", gt=0)]
Conductivity = Annotated[float, Quantity(dimension="thermal_conductivity", gt=0)]
HeatCapacity = Annotated[float, Quantity(dimension="heat_capacity", gt=0)]
Damping = Annotated[float, Quantity(dimension="damping", ge=0)]
Speed = Annotated[float, Quantity(dimension="velocity")]
Spin = Annotated[float, Quantity(dimension="angular_velocity")]
Acceleration = Annotated[float, Quantity(dimension="acceleration")]

THREE = listing("a list of 3 values", 3)
Point = Annotated[tuple[Length, Length, Length], THREE]
Velocity = Annotated[tuple[Speed, Speed, Speed], THREE]
AngularVelocity = Annotated[tuple[Spin, Spin, Spin], THREE]
AccelerationVector = Annotated[tuple[Acceleration, Acceleration, Acceleration], THREE]
AT_REST = (0.0, 0.0, 0.0)


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
