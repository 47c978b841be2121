"""Static response of single contacts: force, stiffness and peak pressure at an overlap, overlap at a load or a pressure."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.state import Array, Ints, Physics
from thirdbody.kernels.tile import TILE, law_input, law_output, rolling_input, rolling_output


class Response(NamedTuple):
    """Virgin contacts (n,): normal force [N], stiffness [N/m] (NaN without tangents), peak pressure [Pa]."""

    force: Array
    stiffness: Array
    pressure: Array


def response(physics: Physics, overlap: Array, radius: Array, kind: Ints) -> Response:
    """Return the response of virgin contacts at an overlap (n,) [m]."""
    count = len(overlap)
    force, stiffness, pressure = np.empty(count), np.full(count, np.nan), np.empty(count)
    width = law_input.HISTORY + len(physics.history) + rolling_input.WIDTH
    answers = law_output.HISTORY + len(physics.history) + rolling_output.WIDTH
    for first in range(0, len(overlap), TILE):
        part = slice(first, min(first + TILE, len(overlap)))
        n = part.stop - part.start
        inputs, outputs = np.zeros((width, TILE)), np.zeros((answers, TILE))
        inputs[law_input.OVERLAP, :n], inputs[law_input.RADIUS, :n] = overlap[part], radius[part]
        inputs[law_input.MASS], inputs[law_input.PAIR_TYPE, :n] = 1.0, kind[part]
        physics.law(inputs.ravel(), outputs.ravel(), n, physics.pairs)
        force[part], pressure[part] = outputs[law_output.NORMAL_FORCE, :n], outputs[law_output.PEAK_PRESSURE, :n]
        if physics.stiffness is not None:
            physics.stiffness(inputs.ravel(), outputs.ravel(), n, physics.pairs)
            stiffness[part] = outputs[0, :n]
    return Response(force, stiffness, pressure)


def overlap_at(physics: Physics, load: Array, radius: Array, kind: Ints) -> Array:
    """Return the overlap (n,) [m], at most the radius, of virgin contacts under `load` (n,) [N]."""
    return _bisected(lambda overlap: response(physics, overlap, radius, kind).force < load, radius)


def load_at(physics: Physics, pressure: Array, radius: Array, kind: Ints) -> Array:
    """Return the load (n,) [N] under which virgin contacts have the peak pressure (n,) [Pa]; 0 if every load exceeds it."""
    overlap = _bisected(lambda overlap: response(physics, overlap, radius, kind).pressure < pressure, radius)
    return response(physics, overlap, radius, kind).force


def _bisected(is_below: Callable[[Array], NDArray[np.bool_]], radius: Array) -> Array:
    """Return the overlap (n,) [m], at most the radius, up to which `is_below` holds."""
    low, high = np.zeros_like(radius, float), radius.astype(float)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = is_below(middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high
