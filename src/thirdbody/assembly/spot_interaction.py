"""Parameters of the interaction of spots on a plate (`kernels.close_spots`), and the scenes that it does not hold for."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thirdbody.errors import InputError
from thirdbody.laws.compose import Chain
from thirdbody.laws.contract import Material, Pair, SpotInteraction
from thirdbody.scene.model import Scene


def interaction_table(
    scene: Scene, interactions: Sequence[SpotInteraction], chain: Chain, materials: Sequence[Material], pairs: Sequence[Pair],
    values: Mapping[str, Mapping[str, Any]],
) -> NDArray[np.float64]:  # fmt: skip
    """Return the compliances of the lower and the upper plate [m2/N], then the stiffness of each pair [Pa]; empty without any.

    Raises InputError for two interactions, rough plates, another normal law than Hertz' and adhesion.
    """
    if not interactions:
        return np.zeros(0)
    effect, options = interactions[0], values[interactions[0].name]
    reason = _refusal(scene, interactions, chain)
    if reason:
        raise InputError(scene.fault(("effects", effect.name), reason))
    by_name = {material.name: material for material in materials}
    plates = [None if plate is None else by_name[plate.material] for plate in (scene.plates.lower, scene.plates.upper)]
    compliances = [0.0 if plate is None else effect.compliance(plate, options) for plate in plates]
    return np.array([*compliances, *(effect.stiffness(pair, options) for pair in pairs)], float)


def _refusal(scene: Scene, interactions: Sequence[SpotInteraction], chain: Chain) -> str:
    """Return why the interaction does not hold for this scene; empty if it does."""
    if len(interactions) > 1:
        return f"two interactions of spots: {', '.join(effect.name for effect in interactions)}"
    if any(plate is not None and plate.surface is not None for plate in (scene.plates.lower, scene.plates.upper)):
        return "the interaction of spots on rough plates is not built: the plates must be flat"
    other = [law.name for law in chain.laws if law.stage == "adhesion" or (law.stage == "normal" and law.name != "hertz")]
    if other:
        return f"the interaction of spots is that of Hertz' contacts, not of {', '.join(other)}"
    return ""
