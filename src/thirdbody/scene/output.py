"""The table `output` of a scene: when frames are written, and what of them."""

import numbers
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, model_serializer

from thirdbody import units
from thirdbody.schema.fields import Flag, Quantity, ShortForm, Text, Whole, in_file, listing, quantity_schema, show
from thirdbody.schema.parts import Part, Wrong, bundle, described

_EVERY = {"distance": "length", "time": "time"}
_BINS = Whole(ge=1, le=1000)


class Profiles(Part):
    """Profiles of the debris: means in slabs of equal thickness between the plates."""

    bins: Annotated[int, _BINS]
    """Number of slabs. Example: 20."""
    axis: Literal["x", "y", "z"] = "z"
    """Axis across the slabs. Example: "y"."""


_BINS_ALONE = BeforeValidator(lambda value: value if isinstance(value, Mapping | Profiles) else {"bins": _BINS.read(value)})

_Block = Literal["spheres", "clumps", "contacts"]

STORED = ("sample", "blocks", "arrays", "precision", "compress")
"""Keys of `output` about the run file."""


class Output(Part):
    """The interval between outputs: of sliding [m] or of time [s], according to `every_kind`.

    In Python: Output(every="0.5 um"), or Output(every=5e-7, every_kind="distance").
    """

    every: Annotated[float, Quantity(gt=0)]
    """Interval between frames: a distance or a time. Example: "0.5 um"."""
    every_kind: Literal["distance", "time"] = "time"  # `rules`: the default is never used
    profiles: Annotated[Profiles, _BINS_ALONE, ShortForm({"type": "integer"} | _BINS.limits())] | None = None
    """Slabs between the plates for profiles of velocity, stress and more: their number, or a table. Example: 20."""
    sample: Annotated[int, Whole(ge=1)] | None = None
    """Number of bodies in the run file, spread over the populations; by default all. Series, and counts of the reasons of states,
    include the others. Example: 10000."""
    blocks: Annotated[list[_Block], listing("a list of blocks")] | None = None
    """Blocks of the run file; by default all. Spheres that are left out follow from their bodies on reading; contacts are lost.
    Example: ["clumps"]."""
    arrays: Annotated[list[Text], listing("a list of names")] | None = None
    """Arrays of bodies to write besides position, state and reason; by default all. `thirdbody keys bodies` lists them.
    Example: ["quaternion", "friction_work"]."""
    precision: Literal["float64", "float32"] = "float64"
    """Precision of arrays in the run file; state of the run, series and checkpoints are float64. Example: "float32"."""
    compress: Flag = False
    """Whether arrays of bodies and spheres are compressed; contacts never are. Example: true."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: Any, handler: Any) -> dict[str, Any]:
        schema = super().__get_pydantic_json_schema__(core_schema, handler)
        every = {"anyOf": [quantity_schema(dimension, {"exclusiveMinimum": 0}) for dimension in _EVERY.values()]}
        properties = {key: value for key, value in schema["properties"].items() if key != "every_kind"}  # not in files
        return schema | {"properties": properties | described({"every": every}, cls)}

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        if isinstance(raw.get("blocks"), list | tuple) and "clumps" not in raw["blocks"]:
            return [(("blocks",), "the bodies are always written: add 'clumps'")]
        every, from_file = raw.get("every"), in_file(context)
        if from_file and "every_kind" in raw:
            return [(("every_kind",), "unknown key: the unit of every says whether it is a length or a time")]
        if isinstance(every, numbers.Real) and not isinstance(every, bool) and (from_file or "every_kind" not in raw):
            or_kind = "" if from_file else ", or give every_kind"
            return [(("every",), units.without_unit(show(every), ("length", "time")) + or_kind)]
        return []

    @classmethod
    def arrange(cls, raw: dict[str, Any]) -> dict[str, Any]:
        if not isinstance(raw.get("every"), str):
            return raw
        try:
            value, dimension = units.parse_any(raw["every"], ("length", "time"))
            kind = "time" if dimension == "time" else "distance"
            if raw.get("every_kind", kind) != kind:
                raise ValueError(f"{show(raw['every'])} is not a {raw['every_kind']}")
            if value <= 0.0:
                raise ValueError(f"{show(raw['every'])} must be greater than 0")
            units.refuse_absurd(value, dimension, show(raw["every"]))
        except ValueError as error:
            raise bundle([(("every",), str(error))]) from None
        return raw | {"every": value, "every_kind": kind}

    @model_serializer(mode="wrap")
    def _flatten(self, handler: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        document: dict[str, Any] = {"every": units.format_si(self.every, _EVERY[self.every_kind])}
        if self.profiles is not None:
            document["profiles"] = self.profiles.bins if self.profiles.axis == "z" else self.profiles.model_dump()
        # a scene that names none of the others is written as before they were there
        return document | {
            key: getattr(self, key) for key in STORED if getattr(self, key) != type(self).model_fields[key].default
        }
