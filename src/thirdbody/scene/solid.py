"""The elastic constants of a solid, as scenes and other input files give them."""

from typing import Annotated, Any

from thirdbody.schema.fields import PositivePressure, Quantity
from thirdbody.schema.parts import Part, Wrong, one_of


class Solid(Part):
    """An isotropic elastic solid; pressures [Pa]."""

    youngs_modulus: PositivePressure | None = None
    """Young's modulus; give it or `shear_modulus`. Example: "210 GPa"."""
    shear_modulus: PositivePressure | None = None
    """Shear modulus; give it or `youngs_modulus`. Example: "80 GPa"."""
    poisson_ratio: Annotated[float, Quantity(gt=-1, le=0.5)]
    """Poisson's ratio. Example: 0.3."""

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        return one_of(raw, ("youngs_modulus", "shear_modulus"))

    def young(self) -> float:
        """Return Young's modulus E = 2 G (1 + nu) [Pa]."""
        if self.youngs_modulus is not None:
            return self.youngs_modulus
        assert self.shear_modulus is not None  # `rules`: one of the two is given
        return 2.0 * self.shear_modulus * (1.0 + self.poisson_ratio)

    def shear(self) -> float:
        """Return the shear modulus G = E / (2 (1 + nu)) [Pa]."""
        if self.shear_modulus is not None:
            return self.shear_modulus
        return self.young() / (2.0 * (1.0 + self.poisson_ratio))
