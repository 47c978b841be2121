"""The ledger closes where friction jumps within a step: strokes turned round, landings and bounces while the plate slides.

Small scenes after random ones that ended with a residual of 4e-3 to 4e-2 and no word: the step of velocity Verlet is far longer
than the contact needs to slip, so friction booked with the force at the end of a step is off by half its jump times the slip.
"""

import itertools
import math
from collections import namedtuple

import numpy as np
import pytest
from numba import njit
from steel import scene_text

from thirdbody.assembly.simulation import build
from thirdbody.engine.energy import Ledger
from thirdbody.kernels.bundles import Tile
from thirdbody.kernels.columns import law_input, law_output, run_totals
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.explicit import contact_dissipation
from thirdbody.scene.model import Scene

CLOSED = 1e-3
"""Largest residual, over the largest energy: the limit above which a run says so. Measured 1e-8 to 2e-4: friction alone closes to
rounding, the rest is truncation of springs and dashpots of the normal direction."""


def shape(*spheres):
    return [{"center": [f"{u} um" for u in place], "radius": f"{radius} um"} for *place, radius in spheres]


STROKES = {
    "pairs.0.friction": "0.6", "pairs.0.restitution": "0.1", "debris.0.count": 2,
    "debris.0.shape": shape((0, 0, 0, 5), (8, 0, 0, 5), (4, 7, 0, 5)),
    "plates.upper.support": "load_per_particle", "plates.upper.load": "6 nN",
    "plates.upper.motion.x": {"stroke": "110 nm", "frequency": "4.5 MHz", "shape": "triangle"}, "solver.settle": "1.5 us",
}  # fmt: skip
"""Forty times the slip that the spots need, in some hundred steps of a stroke, under next to no load."""
BOUNCES = STROKES | {
    "pairs.0.friction": "10.0", "pairs.0.restitution": "0.999", "debris.0.count": 1,
    "debris.0.shape": shape((0, 0, 0, 5), (4, 0, 1, 2)), "plates.upper.support": "rigid", "plates.upper.load": "100 nN",
    "solver.settle": "0.5 us", "solver.duration": "3 us",
}  # fmt: skip
ROLLS = {"effects.rolling_resistance.coefficient": 0.05}
SCENE = scene_text(
    '[[debris]]\nmaterial = "steel"\nkind = "spheres"\nseed = 1\ncount = 1\nradius = "5 um"', '["120 um", "90 um"]',
    'load = "1 nN"', solver='integrator = "explicit"\nduration = "1 us"',
)  # fmt: skip


def residual(level, base):
    """Residual of a scene over its largest energy."""
    keys = base | {"contact.law": "three_spot", "contact.level": level, "contact.debris_contact": "none"}
    simulation = build(Scene.parse(SCENE).with_settings(keys | {"debris.0.radius": None}))
    ledger, state = Ledger(simulation.state), simulation.state
    for time in (0.0, simulation.scene.solver.duration):
        simulation.integrator.advance_to(simulation.settle + time, math.inf, lambda: ledger.watch(state))
    lines = ledger.lines(state, ledger.watch(state))
    assert lines["friction"] > 0.05 * max(state.A[run_totals.PLATE_WORK_SIZE], ledger.peak)  # the case is about friction
    return ledger.relative_residual(state, lines["residual"])


LEVELS = ("mindlin", "mdr", "coulomb", "exact")
QUICK = [(level, STROKES) for level in LEVELS[:3]] + [("mindlin", BOUNCES)]
BASES = (STROKES, STROKES | ROLLS, BOUNCES, BOUNCES | {"pairs.0.friction": "1000.0"})
HARD = [case for case in itertools.product(LEVELS, BASES) if case not in [*QUICK, ("coulomb", STROKES | ROLLS)]]


@pytest.mark.parametrize("level, base", QUICK + [pytest.param(*case, marks=pytest.mark.full(kind="hard")) for case in HARD])
def test_friction_that_jumps_is_booked_as_it_acts(level, base):
    assert residual(level, base) < CLOSED


def test_a_law_that_makes_energy_stays_visible():
    """Friction never takes less than nothing: what a spring holds more than was done to it is left for the residual."""
    I, O = np.zeros((law_input.HISTORY + 3) * TILE), np.zeros((law_output.HISTORY + 3) * TILE)  # noqa: E741
    table = I.reshape(-1, TILE), O.reshape(-1, TILE)
    table[0][law_input.SLIP_X] = -2.0
    table[1][law_output.HISTORY] = 3.0  # the mean force 1.5 over the way 2: a work of 3
    table[0][law_input.HISTORY + 2] = 1.0
    table[1][law_output.STORED_TANGENTIAL, :2] = 1.5, 9.0
    table[1][law_output.FRICTION_LOSS], table[1][law_output.DISSIPATED] = 0.25, 0.75  # half of a joule is not of friction
    memory = namedtuple("Memory", "force moment twist stored n_history")(0, -1, -1, 2, 3)  # columns of the history, their number
    njit(lambda I, O: contact_dissipation.book(2, memory, Tile(I, O, I[:0], I[:0])))(I, O)  # noqa: E741
    assert table[1][law_output.DISSIPATED, 0] == pytest.approx(0.5 + 1.0 + 3.0 - 1.5, rel=1e-15)
    assert table[1][law_output.DISSIPATED, 1] == pytest.approx(0.5, rel=1e-15)
