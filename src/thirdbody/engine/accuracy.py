"""Settings of the step control of the implicit integrator."""

import math
from dataclasses import dataclass

import numpy as np

from thirdbody.engine.state import Array, State
from thirdbody.kernels.implicit.tables import step_settings

SHORTEST = 1e-6
"""Length of the shortest trial step, in Rayleigh times."""

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
    """Settings of the step control.

    `tolerance`: error of a step over the radius of the largest contact; `radii`: largest drag in one step over the same radius;
    `largest_step`: largest drag in one step [m]; `growth`: largest ratio of consecutive steps; `inertia`: whether bodies keep
    their momentum; `skip_unsolved`: whether a run continues without bodies that cannot be solved.
    """

    tolerance: float = 5e-4
    radii: float = 20.0
    largest_step: float = math.inf
    growth: float = 2.0
    inertia: bool = True
    skip_unsolved: bool = False

    def settings(self, state: State, overlap: float, rayleigh: float) -> Array:
        """Return the settings as kernels read them (`step_settings`); `overlap`: to expect [m]; `rayleigh`: time [s]."""
        V = np.zeros(step_settings.WIDTH)
        V[step_settings.TOLERANCE], V[step_settings.LONGEST] = self.tolerance, self.largest_step
        V[step_settings.RADII] = min(self.radii, MEETING_RADII) if state.world.debris_meets else self.radii
        V[step_settings.SHORTEST], V[step_settings.INERTIAL] = SHORTEST * rayleigh, float(self.inertia)
        V[step_settings.EXPECTED_OVERLAP], V[step_settings.GROWTH] = overlap, self.growth
        springs = any(name.endswith(".field[0]") for name in state.physics.history)
        V[step_settings.WORK] = (WORK_OF_SPRINGS if springs else WORK) * self.tolerance
        return V
