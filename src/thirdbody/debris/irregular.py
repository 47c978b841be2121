"""Debris of the kind `irregular`: random clumps in an envelope, with angularity and asperities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator

from thirdbody import units
from thirdbody.debris.contract import PlacedDebris, RandomStreams
from thirdbody.errors import Fault, InputError
from thirdbody.schema.fields import THREE, Fraction, Quantity, Read, ShortForm, Whole, listing, quantity_schema
from thirdbody.schema.parts import Part, Wrong
from thirdbody.schema.sizes import Size

if TYPE_CHECKING:
    from thirdbody.bodies.clump import Clump

_WHOLE = Whole(ge=1, le=64)

THINNEST = 1e-6
"""Smallest axis ratio: far thinner bodies lose their size to rounding."""


_RELATIVE = Quantity(gt=0, le=0.5)
_ABSOLUTE = Quantity(dimension="length", gt=0)


def _length_or_fraction(value: Any) -> float | str:
    """Return a length as the text with its unit, or a bare fraction; only the unit distinguishes them. Raises ValueError."""
    if isinstance(value, str):
        _ABSOLUTE.read(value)
        return value
    try:
        return _RELATIVE.read(value)
    except ValueError as error:
        raise ValueError(f"{error}: a length ('0.5 um'), or a fraction of the body's equivalent radius") from None


_RADIUS = Read(
    _length_or_fraction, {"anyOf": [quantity_schema("dimensionless", _RELATIVE.limits()), quantity_schema("length", {})]}
)


class Asperities(Part):
    """Small spheres on each body: `count` of one `radius`, a length ("0.5 um") or a fraction of the body's equivalent radius."""

    count: Annotated[int, Whole(ge=1, le=32)] = 3
    """Number of asperities on each body. Example: 3."""
    radius: Annotated[float | str, _RADIUS]
    """Radius: a length, or a fraction of the equivalent radius of the body. Example: "0.5 um"."""

    def fraction(self, diameter: float) -> float:
        """Return the radius over the equivalent radius of a body of this diameter [m]. Raises InputError for too large a one."""
        value = 2.0 * units.parse(self.radius, "length") / diameter if isinstance(self.radius, str) else self.radius
        if value > 0.5:
            report = f"{value:.3g} of the equivalent radius of a body of diameter {diameter:.3g} m"
            raise InputError(Fault("asperities.radius", f"{report} must be more than 0 and at most 0.5"))
        return value


class Irregular(PlacedDebris):
    """Random clumps. `size` is the volume-equivalent diameter (m), `spheres` the least and most per clump.

    `angularity` (0 to 1) shrinks the spheres towards the corners of the hull; `asperities` sit on the surface.
    """

    kind: Literal["irregular"] = "irregular"
    size: Size
    """Volume-equivalent diameter. Example: {distribution = "lognormal", median = "10 um", sigma = 0.2}."""
    spheres: Annotated[
        tuple[Annotated[int, _WHOLE], Annotated[int, _WHOLE]],
        listing("[min, max] or one whole number", 2),
        BeforeValidator(lambda value: value if hasattr(value, "__len__") else [_WHOLE.read(value)] * 2),
        ShortForm({"type": "integer"} | _WHOLE.limits()),
    ]
    """Least and most spheres of a body, or one number. Example: [4, 8]."""
    aspect: Annotated[tuple[Fraction, Fraction, Fraction], THREE]
    """Relative extents of the envelope along three axes. Example: [1.0, 0.8, 0.6]."""
    angularity: Annotated[float, Quantity(ge=0, le=1)] | None = None
    """How far spheres shrink towards the corners of the hull; by default 0. Example: 0.5."""
    asperities: Asperities | None = None
    """Small spheres where planes can touch the body. Example: {count = 3, radius = "0.5 um"}."""
    shapes: Annotated[int, Whole(ge=1)] | None = None
    """Number of different shapes, which further bodies copy in other sizes; by default all differ. Example: 200."""

    def checks(self) -> list[Wrong]:
        minimum, maximum = self.spheres
        wrong: list[Wrong] = []
        if minimum > maximum:
            wrong.append((("spheres",), f"the least, {minimum}, is more than the most, {maximum}"))
        if self.shapes is not None and self.asperities is not None and isinstance(self.asperities.radius, str):
            message = f"with shapes = {self.shapes}, whose copies have other sizes, it must be a fraction of the body's radius"
            wrong.append((("asperities", "radius"), message))
        return wrong

    def max_spheres(self) -> int:
        return self.spheres[1] + (self.asperities.count if self.asperities else 0)

    def clumps(self, random: RandomStreams) -> list[Clump]:
        from thirdbody.bodies import irregular_clumps

        thin = min(range(3), key=lambda axis: self.aspect[axis])
        if self.aspect[thin] < THINNEST:
            message = f"{self.aspect[thin]:g} is less than the {THINNEST:g} that spheres can fill"
            raise InputError(Fault(f"aspect[{thin}]", message))
        asperities = None if self.asperities is None else (self.asperities.count, self.asperities.fraction)
        shape = (self.spheres, self.aspect, self.angularity or 0.0, asperities, self.shapes)
        return irregular_clumps.population(random.seed, random.population, self.count, *shape, **self.size.parameters())


KIND = Irregular
