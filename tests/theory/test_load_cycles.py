"""A spot that is sheared and held while its load swings, and loops of partial slip: `mdr` beside `exact`, at default settings."""

from __future__ import annotations

import math

import closed_forms
import numpy as np
import pytest
from numba import njit
from thirdbody_three_spot import theory
from thirdbody_three_spot.exact import EXACT, NODES, ExactParameters
from thirdbody_three_spot.mdr import MDR, SpringParameters

from thirdbody.laws.kernel_data import Contact, Load

E_STAR, G_STAR, RADIUS, MU = 1.0, 0.8, 1.0, 0.3
KAPPA = MU * E_STAR / G_STAR
FORCE = theory.hertz_force(E_STAR, RADIUS, 0.01)
CRITICAL, LIMIT = KAPPA * 0.01, MU * FORCE
CYCLES, PIECES = 40, 100


def compiled(law):
    """The kernel of a law, which has no wrapper for Python."""
    kernel = law.kernel

    @njit(error_model="numpy")
    def call(c, load, p, h, w, w_new):
        return kernel(c, load, p, h, w, w_new)

    return call


EXACT_STEP, MDR_STEP = compiled(EXACT), compiled(MDR)


class Spot:
    """One contact of a level at its default settings, driven by its load and its slip."""

    def __init__(self, level: str):
        if level == "mdr":
            self.law, self.p, width = MDR_STEP, SpringParameters(G_STAR, MU, KAPPA, 0.5), 2 * int(MDR.options[0].default)
        else:
            self.law, self.p, width = EXACT_STEP, ExactParameters(G_STAR, MU, KAPPA, 0.5), 3 * int(NODES.default)
        self.h, self.w = (0.0,) * len((MDR if level == "mdr" else EXACT).history), np.zeros(width)

    def move(self, force: float, slip: float):
        overlap = (0.75 * force / (E_STAR * math.sqrt(RADIUS))) ** (2.0 / 3.0)
        load = Load(force, force, math.sqrt(RADIUS * overlap), closed_forms.hertz_stiffness(E_STAR, RADIUS, overlap), 0.0)
        w_new = np.zeros_like(self.w)
        touch = Contact(overlap, RADIUS, 1.0, 0.0, slip, 0.0, 0.0, 0.0, 0.0, 0.0)
        answer, self.h = self.law(touch, load, self.p, self.h, self.w, w_new)
        self.w = w_new
        return answer


def displacement(tau: float) -> float:
    """Slip of a virgin spot that carries this share of the friction limit (Cattaneo, Mindlin)."""
    return CRITICAL * (1.0 - (1.0 - tau) ** (2.0 / 3.0))


def held(level: str, swing: float, tau: float) -> np.ndarray:
    """T over mu N at the mean load after each cycle of the load."""
    spot, forces = Spot(level), []
    spot.move(FORCE, 0.0)
    spot.move(FORCE, displacement(tau))
    for k in range(CYCLES * PIECES):
        answer = spot.move(FORCE * (1.0 + swing * math.sin(2.0 * math.pi * (k + 1) / PIECES)), 0.0)
        if (k + 1) % PIECES == 0:
            forces.append(-answer.x / LIMIT)
    return np.array(forces)


@pytest.mark.parametrize("tau", [0.38, 0.7])
@pytest.mark.parametrize("swing", [0.1, 0.5])
def test_load_cycles_take_their_share_of_a_shear_force_once(swing, tau):
    springs, field = held("mdr", swing, tau), held("exact", swing, tau)
    assert 0.25 * tau < field[0] < tau  # the first cycle releases the edge that leaves the patch
    for forces in (springs, field):
        assert np.abs(forces / forces[0] - 1.0).max() < 0.03
    assert np.abs(springs / field - 1.0).max() < 0.01  # what 32 springs miss at the edge


@pytest.mark.parametrize("tau", [0.38, 0.7, 0.93])
@pytest.mark.parametrize("level", ["mdr", "exact"])
def test_loops_of_partial_slip_have_the_work_of_mindlin_and_deresiewicz(level, tau):
    spot, turn, work = Spot(level), displacement(tau), 0.0
    spot.move(FORCE, 0.0)
    spot.move(FORCE, turn)
    for sign in (-1.0, 1.0):
        for _ in range(PIECES):
            work += spot.move(FORCE, sign * 2.0 * turn / PIECES).dissipated
    # few of the 32 springs slip where tau is small
    assert work == pytest.approx(closed_forms.mindlin_loop_work(tau) * LIMIT * CRITICAL, rel=1e-2 if level == "mdr" else 1e-9)
