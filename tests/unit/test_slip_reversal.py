"""Which contacts shorten a correction of Newton's method so that it reverses no slip, without a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from thirdbody.kernels.columns import geometry, law_input, law_output, sphere, step_start
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.implicit import newton

OVERLAP, SLIP, BACK = 1e-9, 2e-10, 1e-9
"""Overlap of the spot, its slip in the step so far, and how far the correction moves it back [m]."""


FIELDS = 80
"""Of a tile, more than any of its tables has."""


class Context(NamedTuple):
    """What is asked of a context."""

    interaction: np.ndarray
    own: np.ndarray
    partner: np.ndarray
    S: np.ndarray


class Scratch(NamedTuple):
    """What is asked of a tile."""

    inputs: np.ndarray
    outputs: np.ndarray
    geometry: np.ndarray


class Space(NamedTuple):
    """What is asked of the scratch of a body."""

    tile: Scratch
    slots: np.ndarray
    correction: np.ndarray


class Active(NamedTuple):
    """What is asked of a body."""

    start: np.ndarray


@njit
def limited(context, active, space):
    return newton.limit_slip_reversal(context, active, 1, 1.0, space)


def fraction(relief: float, limit: float = 0.0, interaction: int = 3) -> float:
    """Fraction of a correction that is left by one spot at the limit of friction (N), at which it slips along x."""
    tile = Scratch(*np.zeros((3, FIELDS * TILE)))
    tile.inputs[law_input.OVERLAP * TILE], tile.inputs[law_input.SLIP_X * TILE] = OVERLAP, SLIP
    tile.outputs[law_output.FRICTION_LIMIT * TILE] = tile.outputs[law_output.TANGENTIAL_X * TILE] = limit
    tile.geometry[geometry.RELIEF * TILE] = relief
    for column in (geometry.NORMAL + 2, geometry.AXIS, geometry.CROSS_AXIS + 1):
        tile.geometry[column * TILE] = 1.0
    start = np.zeros(step_start.WIDTH)
    start[step_start.ARM] = 1e-6
    context = Context(np.zeros(interaction), np.zeros(1, int), np.full(1, -1), np.zeros((1, sphere.WIDTH)))
    return limited(context, Active(start), Space(tile, np.zeros(1, int), np.array([-BACK, *(0.0,) * 6])))


def test_a_spot_at_the_limit_shortens_a_correction_that_reverses_its_slip():
    """To its slip so far: with no displacement that friction holds, nothing more."""
    assert fraction(0.0, limit=1e-6) == pytest.approx(SLIP / BACK, rel=1e-12)
    assert fraction(0.5 * OVERLAP, limit=1e-6) == pytest.approx(SLIP / BACK, rel=1e-12)


def test_a_spot_that_is_relieved_wholly_shortens_none():
    """Its limit is none at all: it would shorten every correction, to a stop. Where spots do not interact it counts."""
    assert fraction(OVERLAP) == 1.0
    assert fraction(1.5 * OVERLAP) == 1.0
    assert fraction(OVERLAP, interaction=0) < 1.0
