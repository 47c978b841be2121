"""Hard cases of rotation: contact history in a turning pair, a thin spinning body, very many steps."""

from __future__ import annotations

import closed_forms
import numpy as np
import pytest
from hard.free_bodies import turned_pair

from thirdbody.assembly.simulation import build
from thirdbody.engine.state import angular_momentum
from thirdbody.kernels.columns import body, body_extra, run_totals
from thirdbody.rotations import rotation_matrices


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 2.0, -2.0)])
def test_history_turns_with_a_rigidly_rotating_pair(axis):
    """Twist about the normal included: the stored force turns with the pair, and nothing does work."""
    axis = np.array(axis) / np.linalg.norm(axis)
    errors, works = [], []
    counts = (1000, 2000, 4000)
    for count in counts:
        before, after, turn, work = turned_pair(axis, count)
        errors.append(np.linalg.norm(after - turn @ before) / np.linalg.norm(before))
        works.append(work.max())
    # chords for arcs and tan x for x: second order in the turn of a step
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.05)
    # a pair of 2 mm turned by 5e-4 a step slips by D theta^3/6 a step, 2e-13 m in all, of 6e-7 m of shear; work likewise
    assert errors[-1] < 1e-4
    assert works[-1] < 2e-4


FLAKE, WOBBLE = (1.0, 1.1, 2.09), (0.2, -0.1, 1.0)


def spinning_flake(make, step):
    """A thin body, I_3 close to I_1 + I_2, spinning about its axis with a wobble."""
    simulation = build(make.scene([make.ball(1.0, (0.0, 0.0, 0.0))], {"ball": make.STEEL}, time_step=step), force=True)
    B, E = simulation.state.B, simulation.state.E
    E[:, body_extra.INERTIA3], B[:, body.SPHERE_INERTIA] = FLAKE, 0.0
    B[:, body.SPIN3] = WOBBLE
    E[:, body_extra.ANGULAR_MOMENTUM3] = angular_momentum(B, E, simulation.state.orientations)
    return simulation


@pytest.mark.parametrize("steps", [100_000, pytest.param(1_000_000, marks=pytest.mark.full(kind="slow"))])
def test_quaternion_and_momentum_over_many_steps(make, steps):
    simulation = spinning_flake(make, 0.05)
    E = simulation.state.E
    momentum, energy = E[0, body_extra.ANGULAR_MOMENTUM3].copy(), make.kinetic(simulation)
    simulation.integrator.advance_to(time=(steps - 0.5) * 0.05)
    assert simulation.state.A[run_totals.STEPS] == steps
    assert abs(np.linalg.norm(simulation.state.bodies.quaternion[0]) - 1.0) < 1e-12
    assert np.array_equal(E[0, body_extra.ANGULAR_MOMENTUM3], momentum)
    # no drift: the splitting's energy error stays (omega dt)^2/12, whatever the time
    assert make.kinetic(simulation) == pytest.approx(energy, rel=0.05**2 / 12.0)


def test_spinning_flake_keeps_its_period(make):
    period = closed_forms.top_period(FLAKE, WOBBLE)
    simulation = spinning_flake(make, 0.01)
    rows = []
    while simulation.state.time < 10.6 * period:
        make.advance(simulation)
        bodies = simulation.state.bodies
        turn = rotation_matrices(bodies.quaternion[:1])[0]
        rows.append((simulation.state.time, (turn.T @ bodies.spin[0])[0]))
    time, first = np.array(rows).T
    k = np.flatnonzero((first[:-1] < 0.0) & (first[1:] >= 0.0))
    zeros = time[k] - first[k] * (time[k + 1] - time[k]) / (first[k + 1] - first[k])
    # second order (test_motion): (.01 rad)^2 times a factor of order one
    assert np.diff(zeros) == pytest.approx(period, rel=1e-4)
