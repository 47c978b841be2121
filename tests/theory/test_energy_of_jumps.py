"""The ledger closes where friction jumps within a step: strokes turned round, landings and bounces while the plate slides.

Small scenes after random ones that ended with a residual of 4e-3 to 4e-2 and no word: the step of velocity Verlet is far longer
than the contact needs to slip, so friction booked with the force at the end of a step is off by half its jump times the slip.
"""

import math
from collections import namedtuple

import numpy as np
import pytest
from numba import njit
from steel import STEEL

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

TEXT = (
    STEEL
    + """
[[debris]]
material = "steel"
kind = "spheres"
count = {count}
seed = 1
shape = [{shape}]
[domain]
size = ["120 um", "90 um"]
[plates]
lower = {{material = "steel"}}
upper.material = "steel"
upper.support = "{support}"
upper.load = "{load}"
upper.motion = {{x = {{stroke = "{stroke}", frequency = "{frequency}", shape = "triangle"}}}}
[contact]
law = "three_spot"
level = "{level}"
debris_contact = "none"
{effects}
[solver]
integrator = "explicit"
settle = "{settle}"
duration = "{duration}"
[output]
every = "{duration}"
"""
)
TRIPLE = (
    '{center = ["0 um", "0 um", "0 um"], radius = "5 um"}, {center = ["8 um", "0 um", "0 um"], radius = "5 um"},'
    '{center = ["4 um", "7 um", "0 um"], radius = "5 um"}'
)
LOPSIDED = '{center = ["0 um", "0 um", "0 um"], radius = "5 um"}, {center = ["4 um", "0 um", "1 um"], radius = "2 um"}'
STROKES = {
    "friction": "0.6", "restitution": "0.1", "count": 2, "shape": TRIPLE, "support": "load_per_particle", "load": "6 nN",
    "stroke": "110 nm", "frequency": "4.5 MHz", "settle": "1.5 us", "duration": "1 us", "effects": "",
}  # fmt: skip
"""Forty times the slip that the spots need, in some hundred steps of a stroke, under next to no load."""
BOUNCES = STROKES | {
    "friction": "10.0", "restitution": "0.999", "count": 1, "shape": LOPSIDED, "support": "rigid", "load": "100 nN",
    "settle": "0.5 us", "duration": "3 us",
}  # fmt: skip
ROLLS = {"effects": "[effects.rolling_resistance]\ncoefficient = 0.05\n"}


def residual(values):
    """Residual of a scene over its largest energy."""
    pair = {f"pairs.0.{name}": values[name] for name in ("friction", "restitution")}
    simulation = build(Scene.parse(TEXT.format(**values)).with_settings(pair))
    ledger, state = Ledger(simulation.state), simulation.state
    for time in (0.0, float(values["duration"].split()[0]) * 1e-6):
        simulation.integrator.advance_to(simulation.settle + time, math.inf, lambda: ledger.watch(state))
    lines = ledger.lines(state, ledger.watch(state))
    assert lines["friction"] > 0.05 * max(state.A[run_totals.PLATE_WORK_SIZE], ledger.peak)  # the case is about friction
    return ledger.relative_residual(state, lines["residual"])


LEVELS = ("mindlin", "mdr", "coulomb", "exact")
QUICK = [(level, STROKES) for level in LEVELS[:3]] + [("mindlin", BOUNCES)]
HARD = [(level, base) for level in LEVELS for base in (STROKES, STROKES | ROLLS, BOUNCES, BOUNCES | {"friction": "1000.0"})]
HARD = [case for case in HARD if case not in [*QUICK, ("coulomb", STROKES | ROLLS)]]


@pytest.mark.parametrize("level, base", QUICK + [pytest.param(*case, marks=pytest.mark.full(kind="hard")) for case in HARD])
def test_friction_that_jumps_is_booked_as_it_acts(level, base):
    assert residual(base | {"level": level}) < CLOSED


Memory = namedtuple("Memory", "force moment twist stored n_history")
"""Columns of the history, and their number."""


@njit(error_model="numpy")
def booked(I, O):  # noqa: E741
    """Two contacts whose history is a force and an energy, without moments."""
    contact_dissipation.book(2, Memory(0, -1, -1, 2, 3), Tile(I, O, I[:0], I[:0]))


def test_a_law_that_makes_energy_stays_visible():
    """Friction never takes less than nothing: what a spring holds more than was done to it is left for the residual."""
    I, O = np.zeros((law_input.HISTORY + 3) * TILE), np.zeros((law_output.HISTORY + 3) * TILE)  # noqa: E741
    table = I.reshape(-1, TILE), O.reshape(-1, TILE)
    table[0][law_input.SLIP_X] = -2.0
    table[1][law_output.HISTORY] = 3.0  # the mean force 1.5 over the way 2: a work of 3
    table[0][law_input.HISTORY + 2] = 1.0
    table[1][law_output.STORED_TANGENTIAL, :2] = 1.5, 9.0
    table[1][law_output.FRICTION_LOSS], table[1][law_output.DISSIPATED] = 0.25, 0.75  # half of a joule is not of friction
    booked(I, O)
    assert table[1][law_output.DISSIPATED, 0] == pytest.approx(0.5 + 1.0 + 3.0 - 1.5, rel=1e-15)
    assert table[1][law_output.DISSIPATED, 1] == pytest.approx(0.5, rel=1e-15)
