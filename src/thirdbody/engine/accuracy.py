"""Settings of the step control of the implicit integrator."""

import math
from dataclasses import dataclass


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
