"""Distributions of the size of debris."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ValidationInfo

from thirdbody.scene.fields import Quantity
from thirdbody.scene.part import Part, Wrong, tagged
from thirdbody.scene.types import PositiveLength, PositiveNumber


class Constant(Part):
    """Every body has this size, m."""

    distribution: Literal["constant"] = "constant"
    value: PositiveLength


class _Cut(Part):
    def checks(self) -> list[Wrong]:
        """Faults between the limits."""
        low, high = getattr(self, "min"), getattr(self, "max")  # noqa: B009  (declared by the kinds below)
        return [(("min",), "min must be less than max")] if low and high and not low < high else []


class Lognormal(_Cut):
    """Size with this median (m), cut at min and max; `sigma` is the standard deviation of ln(size)."""

    distribution: Literal["lognormal"] = "lognormal"
    median: PositiveLength
    sigma: PositiveNumber
    min: PositiveLength | None = None
    max: PositiveLength | None = None


class Normal(_Cut):
    """Size with this mean and standard deviation (m); `min` is required, for a size must be positive."""

    distribution: Literal["normal"] = "normal"
    mean: PositiveLength
    sigma: PositiveLength
    min: PositiveLength
    max: PositiveLength | None = None


class Uniform(_Cut):
    """Size evenly spread from min to max, m."""

    distribution: Literal["uniform"] = "uniform"
    min: PositiveLength
    max: PositiveLength


_LENGTH = Quantity(dimension="length", gt=0)
_SIZES: dict[str, type[Part]] = {
    "constant": Constant, "lognormal": Lognormal, "normal": Normal, "uniform": Uniform,
}  # fmt: skip


def _constant_size(value: Any, info: ValidationInfo) -> Any:
    """A single length as the distribution that it stands for."""
    if not isinstance(value, str | int | float):
        return value
    return Constant(value=float(_LENGTH.read(value, info)))


Size = Annotated[
    Constant | Lognormal | Normal | Uniform, tagged("distribution", _SIZES), BeforeValidator(_constant_size)
]
