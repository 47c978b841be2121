"""Adhesion in the check of a scene: what its model is by pair of materials, and whether a scene without it would need it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from thirdbody.kernels.tables import sphere
from thirdbody.units import pretty

if TYPE_CHECKING:
    from thirdbody.assembly.simulation import Simulation

ESTIMATE, MATTERS = 0.05, 0.1
"""Work of adhesion of the estimate [J/m2]; pull-off force over the load on a body from which on it warns."""


def remarks(built: Simulation) -> list[tuple[str, str, bool]]:
    """Return names of both materials, what the laws say of the pair, and whether that is a warning."""
    choice, radius = built.choice, built.state.S[:, sphere.RADIUS]
    low, high = 0.5 * float(radius.min()), float(radius.max())  # two equal spheres; a sphere on a plate
    result = []
    for law in choice.chain.laws:
        for pair in choice.pairs if law.remark is not None else ():
            assert law.remark is not None
            text, warns = law.remark(pair, law.options_of(pair, choice.options[law.name]), low, high)
            result.append((f"{pair.a.name}/{pair.b.name}", text, warns))
    return result


def adhesion_warnings(built: Simulation, load: float) -> list[str]:
    """Return warnings of a model that hardly fits, or of missing adhesion; `load`: on a body [N], infinite without a plate.

    The estimate is 3/2 pi w R of the largest sphere on a plate, against the load, or the weight of the lightest body.
    """
    texts = remarks(built)
    if texts or any(law.stage == "adhesion" or law.reach for law in built.choice.chain.laws):
        return [f"adhesion of {pair}: {text}" for pair, text, warns in texts if warns]
    gravity = built.scene.effects.gravity
    if math.isinf(load) and gravity is not None:
        load = float(np.min(built.state.bodies.mass)) * float(np.linalg.norm(gravity))
    pull = 1.5 * math.pi * ESTIMATE * float(built.state.S[:, sphere.RADIUS].max())
    if not (0.0 < load < math.inf and pull > MATTERS * load):
        return []
    return [
        f"adhesion is off, but with a work of adhesion of {1e3 * ESTIMATE:.0f} mJ/m2 a contact would pull with up to "
        f"{pretty(pull, 'force')}, {pull / load:.2g} of the load on a body: effects.adhesion switches it on"
    ]
