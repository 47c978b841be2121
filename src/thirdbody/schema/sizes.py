"""Distributions of sizes."""

import math
import numbers
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import ValidationInfo, ValidatorFunctionWrapHandler, WrapValidator

from thirdbody import units
from thirdbody.schema.fields import PositiveLength, PositiveNumber, Quantity, ShortForm, quantity_schema
from thirdbody.schema.parts import Part, Wrong, table_by_kind


class SizeDistribution(Part):
    """Base of the distributions of sizes."""

    if TYPE_CHECKING:  # declared by each of them
        distribution: str
        """Shape of the distribution, which decides on the other keys. Example: "lognormal"."""

    def parameters(self) -> dict[str, Any]:
        """Return the distribution as the keywords of `bodies.irregular_clumps.diameters`."""
        given = {name: getattr(self, name) for name in type(self).model_fields}
        return {name: value for name, value in given.items() if value is not None}

    def typical(self) -> tuple[float, float]:
        """Return a size [m], and the fraction of bodies that are certainly not smaller."""
        raise NotImplementedError(f"{type(self).__name__}.typical")


class Constant(SizeDistribution):
    """The same size [m] for all bodies."""

    distribution: Literal["constant"] = "constant"
    value: PositiveLength
    """Size of all bodies, the same as a bare length. Example: "10 um"."""

    def typical(self) -> tuple[float, float]:
        return self.value, 1.0


class _Cut(SizeDistribution):
    def checks(self) -> list[Wrong]:
        low, high = getattr(self, "min"), getattr(self, "max")  # noqa: B009  (declared by the kinds below)
        if low and high and not low < high:
            return [(("min",), "min must be less than max")]
        limits = [f"{word} {units.pretty(x, 'length')}" for word, x in (("min", low), ("max", high)) if x]
        outside = "the {} {} is outside the limits, {}: only the tail would be left"
        return [
            ((key,), outside.format(key, units.pretty(middle, "length"), " and ".join(limits)))
            for key in ("median", "mean")
            if (middle := getattr(self, key, None)) is not None and not (low or 0.0) <= middle <= (high or math.inf)
        ]


class Lognormal(_Cut):
    """Lognormal size with this median [m], truncated at min and max; `sigma` is the standard deviation of ln(size)."""

    distribution: Literal["lognormal"] = "lognormal"
    median: PositiveLength
    """Median size. Example: "10 um"."""
    sigma: PositiveNumber
    """Standard deviation of ln(size). Example: 0.2."""
    min: PositiveLength | None = None
    """Lower limit: smaller sizes are drawn again. Example: "5 um"."""
    max: PositiveLength | None = None
    """Upper limit: larger sizes are drawn again. Example: "20 um"."""

    def typical(self) -> tuple[float, float]:
        return max(self.median, self.min or 0.0), 0.5


class Normal(_Cut):
    """Normal size with this mean and standard deviation [m]; `min` is required, because a size must be positive."""

    distribution: Literal["normal"] = "normal"
    mean: PositiveLength
    """Mean size. Example: "10 um"."""
    sigma: PositiveLength
    """Standard deviation of the size. Example: "1 um"."""
    min: PositiveLength
    """Lower limit: smaller sizes are drawn again. Example: "5 um"."""
    max: PositiveLength | None = None
    """Upper limit: larger sizes are drawn again. Example: "20 um"."""

    def typical(self) -> tuple[float, float]:
        return max(self.mean, self.min), 0.5


class Uniform(_Cut):
    """Size distributed uniformly from min to max [m]."""

    distribution: Literal["uniform"] = "uniform"
    min: PositiveLength
    """Smallest size. Example: "5 um"."""
    max: PositiveLength
    """Largest size. Example: "20 um"."""

    def typical(self) -> tuple[float, float]:
        return 0.5 * (self.min + self.max), 0.5


_LENGTH = Quantity(dimension="length", gt=0)
_KINDS: dict[str, type[Part]] = {"constant": Constant, "lognormal": Lognormal, "normal": Normal, "uniform": Uniform}


def _read(value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
    if isinstance(value, str | numbers.Real):
        return Constant(value=float(_LENGTH.read(value, info)))
    return value if isinstance(value, SizeDistribution) else table_by_kind(value, info, "distribution", _KINDS)


Size = Annotated[
    Constant | Lognormal | Normal | Uniform, WrapValidator(_read), ShortForm(quantity_schema("length", _LENGTH.limits()))
]
