"""While debris settles its friction work may be less exact (`engine.implicit.WORK_OF_SETTLING`): the drag does not show it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import thirdbody
from thirdbody.kernels.columns import run_totals, step_settings
from thirdbody.runner.simulate import prepare

SCENE = Path(__file__).parents[2] / "scenes" / "sheared_debris.toml"
SLOW = {
    "contact.debris_contact": "none",
    "solver.integrator": "implicit",
    "debris.0.count": "40",
    "plates.upper.motion.x.velocity": "1 mm/s",
}
PATH = 0.5e-6


def dragged(exact: bool, **settings: str) -> tuple[np.ndarray, float]:
    """Friction work of every body at the end of the drag, J, and the mean number of steps until it began."""
    built = prepare(thirdbody.Scene.load(SCENE).with_settings(SLOW | settings))
    integrator = built.integrator
    if exact:
        integrator.settings[step_settings.WORK_OF_SETTLING] = integrator.settings[step_settings.WORK]
    integrator.advance_to(time=built.settle)
    steps = float(integrator.totals[:, run_totals.STEPS].mean())
    integrator.advance_to(distance=PATH)
    return built.state.bodies.friction_work.copy(), steps


def test_half_the_steps_of_settling_and_the_same_friction_work():
    exact, many = dragged(exact=True)
    work, few = dragged(exact=False)
    assert few < 0.6 * many
    # two runs with steps as exact, of tolerances 5e-4 and 4e-4, differ by as much
    other, _ = dragged(exact=True, **{"solver.tolerance": "4e-4"})
    assert np.median(np.abs(work / exact - 1.0)) < 2.0 * np.median(np.abs(other / exact - 1.0))
    assert abs(work.sum() / exact.sum() - 1.0) < 2e-3
