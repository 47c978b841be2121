"""Static response of single contacts: force and stiffness at an overlap, overlap at a load."""

import numpy as np

from thirdbody.engine.state import Array, Ints, Physics
from thirdbody.kernels.columns import law_input, law_output, rolling_input, rolling_output
from thirdbody.kernels.columns.tile import TILE


def response(physics: Physics, overlap: Array, radius: Array, kind: Ints) -> tuple[Array, Array]:
    """Return normal force (n,) [N] and stiffness (n,) [N/m] of virgin contacts; NaN without tangents."""
    force, stiffness = np.empty(len(overlap)), np.full(len(overlap), np.nan)
    width = law_input.HISTORY + len(physics.history)
    answers = law_output.HISTORY + len(physics.history) + rolling_output.WIDTH
    if physics.rolling:
        width += rolling_input.WIDTH
    for first in range(0, len(overlap), TILE):
        part = slice(first, min(first + TILE, len(overlap)))
        n = part.stop - part.start
        inputs, outputs = np.zeros((width, TILE)), np.zeros((answers, TILE))
        inputs[law_input.OVERLAP, :n], inputs[law_input.RADIUS, :n] = overlap[part], radius[part]
        inputs[law_input.MASS], inputs[law_input.PAIR_TYPE, :n] = 1.0, kind[part]
        physics.law(inputs.ravel(), outputs.ravel(), n, physics.pairs)
        force[part] = outputs[law_output.NORMAL_FORCE, :n]
        if physics.stiffness is not None:
            physics.stiffness(inputs.ravel(), outputs.ravel(), n, physics.pairs)
            stiffness[part] = outputs[0, :n]
    return force, stiffness


def overlap_at(physics: Physics, load: Array, radius: Array, kind: Ints) -> Array:
    """Return the overlap (n,) [m], at most the radius, of virgin contacts under `load` (n,) [N]."""
    low, high = np.zeros_like(load), radius.astype(float)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = response(physics, middle, radius, kind)[0] < load
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high
