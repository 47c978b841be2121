"""Accuracy of the implicit integrator: settings of its step control, causes that limit steps, and the energy that it creates."""

import math
from dataclasses import dataclass

import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.kernels.implicit.control import CAUSES, OF_A_BODY, WORDS
from thirdbody.kernels.step_tables import step_memory, step_settings
from thirdbody.kernels.tables import body, body_extra, patch, run_totals

SHORTEST = 1e-6  # length of the shortest trial step, in Rayleigh times

WORK = 4.0
"""Tolerance of the friction work of a body in a step over `tolerance`, relative to its scale of energy (`books`). Of 20
rolling bodies the friction work is then right to 1.2 % in the median and 9.4 % at worst, with 5 to 1.3 and 10.6 %
(`tests/theory/test_friction_work_of_rolling.py`)."""

WORK_OF_SPRINGS = 80.0
"""WORK for laws that keep a field of springs (`mdr`, `exact`): the dissipation of each spring is exact in a step, so the
difference between the work of the mean force and of the force at the end overestimates the error. Of 20 rolling bodies the
friction work is then right to 0.5 % in the median and 6 % at worst; with WORK to 0.2 and 2 %, in 45 % more steps."""

MEETING_RADII = 2.0
"""Longest drag of a step in radii of the largest contact where bodies meet, less than that of a body alone: in longer ones a
contact between bodies that begins to slide is labelled late."""


@dataclass(frozen=True)
class Accuracy:
    """Settings of the step control."""

    tolerance: float = 5e-4  # error of a step over the radius of the largest contact
    radii: float = 20.0  # largest drag in one step over the same radius
    largest_step: float = math.inf  # largest drag in one step [m]
    growth: float = 2.0  # largest ratio of consecutive steps
    inertia: bool = True  # whether bodies keep their momentum
    skip_unsolved: bool = False  # whether a run continues without bodies that cannot be solved

    def settings(self, state: State, overlap: float, rayleigh: float) -> Array:
        """Return the settings as kernels read them; `overlap`: to expect [m]; `rayleigh`: time [s]."""
        V = np.zeros(step_settings.WIDTH)
        V[step_settings.TOLERANCE], V[step_settings.LONGEST] = self.tolerance, self.largest_step
        V[step_settings.RADII] = min(self.radii, MEETING_RADII) if state.world.debris_meets else self.radii
        V[step_settings.SHORTEST], V[step_settings.INERTIAL] = SHORTEST * rayleigh, float(self.inertia)
        V[step_settings.EXPECTED_OVERLAP], V[step_settings.GROWTH] = overlap, self.growth
        springs = any(name.endswith(".field[0]") for name in state.physics.history)
        V[step_settings.WORK] = (WORK_OF_SPRINGS if springs else WORK) * self.tolerance
        return V


CREATED_ENERGY_GUARD = 0.1
"""Largest created energy over the exchanged energy, for each body and for all. Valid runs stay below 0.05 for a single body at
the very start, and below 0.005 later."""

NEGLIGIBLE = 0.01
"""Exchanged energy below which that of a body is no scale, as a fraction of the mean of all bodies: a step does not resolve the
weak impacts of bodies without load between rough plates, which may create a tenth of the little that they exchange."""


def causes(memory: Array) -> Array:
    return memory[:, step_memory.LIMITED : step_memory.LIMITED + len(CAUSES)]


def limited_by(memory: Array) -> dict[str, int]:
    counts = causes(memory).sum(axis=0)
    return {CAUSES[k]: int(counts[k]) for k in np.argsort(-counts, kind="stable") if counts[k] > 0.0}


def limiting_body(memory: Array, order: np.ndarray) -> dict[str, int]:
    """Return the body (number in the scene) that has limited most steps, and how many."""
    steps = memory[:, step_memory.LIMITED : step_memory.LIMITED + OF_A_BODY].sum(axis=1)
    body = int(np.argmax(steps))
    return {"body": int(order[body]), "steps": int(steps[body])}


def in_words(steps: Array, order: np.ndarray) -> str:
    """Return as text the most frequent cause in `steps` (`causes`), its fraction, the body most affected; "" without steps."""
    counts = steps.sum(axis=0)
    if not counts.sum() > 0.0:
        return ""
    k = int(np.argmax(counts))
    fraction = f"{100.0 * counts[k] / counts.sum():.0f} % of steps limited by {WORDS[k]}"
    if len(steps) == 1 or k >= OF_A_BODY:
        return fraction
    return f"{fraction}, most of them of body {order[int(np.argmax(steps[:, k]))]}"


def created_fractions(totals: Array, stored: Array, whole: Array) -> tuple[Array, float]:
    """Return the energy created by the integrator (negative: lost) over the exchanged energy: of each body (n,), and of all.
    `totals`: (n, run_totals.WIDTH); `stored`: kinetic and elastic energy (n,) [J]; `whole`: totals of the run. A body exchanges
    the largest of: sum of |plate work increments|; |work of effects|; dissipated plus stored energy; at least NEGLIGIBLE times
    the mean."""

    def exchanged(totals: Array, stored: Array) -> Array:
        spent = totals[:, run_totals.FRICTION_WORK] + totals[:, run_totals.DAMPING_WORK] + stored
        return np.maximum(np.maximum(totals[:, run_totals.PLATE_WORK_SIZE], np.abs(totals[:, run_totals.EFFECT_WORK])), spent)

    scales, all_scale = exchanged(totals, stored), float(exchanged(whole[None], stored.sum())[0])
    if not all_scale > 0.0:
        return np.zeros(len(totals)), 0.0
    scales = np.maximum(scales, NEGLIGIBLE * all_scale / len(totals))
    return -totals[:, run_totals.NUMERICAL_LOSS] / scales, -float(whole[run_totals.NUMERICAL_LOSS]) / all_scale


def body_energies(state: State, stored: Array) -> Array:
    B, E, P = state.B, state.E, state.P[state.patch]
    kinetic = B[:, body.MASS] * np.sum(B[:, body.VELOCITY3] ** 2, axis=1)
    kinetic += np.sum(E[:, body_extra.ANGULAR_MOMENTUM3] * B[:, body.SPIN3], axis=1)
    kinetic += P[:, patch.FREE] * P[:, patch.MASS] * P[:, patch.VELOCITY] ** 2
    return 0.5 * float(state.inertial) * kinetic + stored
