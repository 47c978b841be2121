"""Warnings of values of a scene that are possible but unusual, most often because of a wrong unit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from thirdbody.units import pretty

if TYPE_CHECKING:
    from thirdbody.scene.model import Scene

SOFT, STIFF = 5e8, 1.3e12
"""Range of Young's modulus [Pa]: elastomers, foams and the softest polymers are below; diamond has 1.2e12."""

LIGHT, HEAVY = 100.0, 2.3e4
"""Range of density [kg/m3]: only foams are below; osmium, the densest element, has 22590."""

ROUGH = 2.0
"""Friction coefficient that clean solids in air rarely exceed."""


def unusual_values(scene: Scene) -> Iterator[str]:
    """Yield a warning for each unusual modulus, density and friction coefficient, with the unit probably intended."""
    for name, material in scene.materials.items():
        key = "youngs_modulus" if material.youngs_modulus is not None else "shear_modulus"
        young = material.young()
        shown = pretty(young, "pressure")
        if not SOFT <= young <= STIFF:
            where = f"materials.{name}.{key}: a Young's modulus of {shown}"
            yield (f"{where} is that of an elastomer or a foam (other solids: above {pretty(SOFT, 'pressure')}); was GPa meant?"
                   if young < SOFT else f"{where} is above that of diamond, 1.2 TPa; is the unit right?")  # fmt: skip
        if not LIGHT <= material.density <= HEAVY:
            where = f"materials.{name}.density: {material.density:g} kg/m3"
            meant = 1e3 * material.density
            yield (f"{where} is that of a foam; was g/cm3 meant, which is {meant:g} kg/m3?" if material.density < LIGHT else
                   f"{where} is above that of every element (osmium: 22590 kg/m3); was it kg/m3?")  # fmt: skip
    for k, pair in enumerate(scene.pairs):
        if pair.friction > ROUGH:
            yield (
                f"pairs[{k}].friction: {pair.friction:g} is far above the 0.05 to {ROUGH:g} of solids; it is a coefficient, "
                "not per cent and not an angle"
            )
