"""A load that falls to nothing, comes back and grows ten thousandfold at once, under every support and in both integrators."""

from typing import Any

import numpy as np
import pytest
from theory import builders as make

from thirdbody.engine.guards import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.tables import run_totals
from thirdbody.scene.model import ConstantVelocity, Motion, Pause
from thirdbody.scene.motion import Load

FIRST, LAST, MU = 1e-5, 1e-1, 0.3
LOADING = [Pause(pause=3e-7), Load(load=0.0), Pause(pause=2e-7), Load(load=FIRST), Pause(pause=5e-7), Load(load=LAST)]
"""Dragged at 1 m/s; without load for 2e-7 s, then the first load again, at 1e-6 s ten thousand times as much."""
END = 3e-6
SUPPORTS: dict[str, dict[str, Any]] = {
    "load_per_particle": {}, "rigid": {"support": "rigid"}, "foundation": {"support": "foundation", "stiffness": 1e5},
}  # fmt: skip


def start(support, integrator, **keys):
    balls = [(-1.9, -1.1, 0.0, 2.0), (1.9, -1.1, 0.0, 2.0), (0.0, 2.2, 0.0, 2.0)]
    shape = [{"center": (1e-6 * x, 1e-6 * y, 1e-6 * z), "radius": 1e-6 * r} for x, y, z, r in balls]
    bodies = [make.clump(shape, x, 1e-4, gap=1e-8) for x in (0.4e-4, 1e-4, 1.6e-4)]
    load = {"loading": LOADING, "damping": 1e-4} | SUPPORTS[support]
    drag = Motion(x=[ConstantVelocity(velocity=1.0)])
    return make.under_patches(
        bodies, {"ball": make.STEEL}, FIRST, drag, patch=load, friction=MU, restitution=0.5, size=2e-4, settle=2e-6, duration=END,
        integrator=integrator, **keys,
    )  # fmt: skip


@pytest.mark.parametrize("support", SUPPORTS)
@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_load_that_vanishes_comes_back_and_jumps(integrator, support):
    simulation = start(support, integrator)
    ledger, state = Ledger(simulation.state), simulation.state
    pushes = []
    for t in (2.5e-7, 4.8e-7, 9.8e-7, END):
        simulation.integrator.advance_to(time=simulation.settle + t, watch=lambda: ledger.watch(state))
        pushes.append(float(state.A[run_totals.UPPER_FORCE + 2]))
        for table in (state.S, state.B, state.P, state.A, state.slots.H):
            assert np.all(np.isfinite(table))
    # a rigid plate and a foundation share what load_per_particle gives to each
    total = 3.0 if support == "load_per_particle" else 1.0
    # the bodies rise at 1 m/s or less: the dashpot of the patches, 1e-4 kg/s, carries no more than the first load for long
    assert pushes[1] < 1.0 * total * FIRST
    # settled after the jump but for what the bodies' sinking leaves: inertia and dashpot are below 1 % by then
    assert pushes[3] == pytest.approx(total * LAST, rel=0.02)
    assert set(make.label(simulation, body) for body in range(3)) == {"sliding"}
    lines = ledger.lines(state)
    # explicit steps leave their truncation: when the load jumps, half the work of a step; the implicit ones rounding of Newton
    assert ledger.relative_residual(state, lines["residual"]) < (5e-3 if integrator == "explicit" else 1e-6)
    assert make.numerical_share(simulation) > -1e-3


def test_the_same_load_at_once_or_as_a_schedule_that_does_not_change():
    found = []
    for loading in (None, [Load(load=FIRST)], [Pause(pause=1e-7), Load(load=FIRST, duration=1e-7)]):
        simulation = make.under_patches(
            [make.clump(make.LUMP)], {"ball": make.STEEL}, FIRST, Motion(x=[ConstantVelocity(velocity=1.0)]),
            patch={"loading": loading}, friction=MU, settle=1e-6, duration=1e-6, integrator="explicit",
        )  # fmt: skip
        simulation.integrator.advance_to(time=1.5e-6)
        found.append(simulation.state.B.copy())
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])


def test_without_load_and_inertia_nothing_reports_where_a_body_is():
    with pytest.raises(InputError, match="inertia: false needs a load at all times"):
        start("load_per_particle", "implicit", inertia=False)
