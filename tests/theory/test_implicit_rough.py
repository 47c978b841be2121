"""Bodies between rough plates by the implicit integrator: a field of zeros is the flat plate, the ledger closes, and what the
explicit integrator finds at 1 m/s."""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from rough import field
from stories import SCENE, agreement, dragged

import thirdbody
from thirdbody.assembly import simulation
from thirdbody.assembly.surfaces import with_surfaces
from thirdbody.engine.numerical_energy_guard import body_energies
from thirdbody.kernels.columns import run_totals, step_memory
from thirdbody.runner.prepare import prepare

SIZE = 160e-6, 120e-6
SURFACES = {
    f"plates.{side}.surface": {"rms": "0.1 um", "long": "40 um", "short": "4 um", "seed": seed}
    for side, seed in (("lower", 1), ("upper", 2))
}


def scene(count: int, **settings: Any) -> thirdbody.Scene:
    """Particles of the main scene, each under a load of its own."""
    chosen = {"domain.size": ["160 um", "120 um"], "contact.debris_contact": "none", "solver.integrator": "implicit"}
    return thirdbody.Scene.load(SCENE).with_settings(chosen | {"debris.0.count": count} | settings)


def advanced(given: thirdbody.Scene, distance: float = 0.5e-6) -> Any:
    """The simulation of a scene after pressing and a drag [m]."""
    built = prepare(given)
    built.integrator.advance_to(time=built.settle)
    built.integrator.advance_to(distance=distance)
    return built


def test_a_field_of_zeros_is_the_flat_plate_bit_for_bit():
    flat = advanced(scene(8)).state
    zeros = field(lambda x, y: 0.0 * x, SIZE, (16, 12))
    # the same start: bodies on rough plates are placed by another search, to 1e-12 m
    with patch.object(simulation, "with_surfaces", lambda world, _: with_surfaces(world, {"lower": zeros, "upper": zeros})):
        built = prepare(scene(8))
    built.integrator.advance_to(time=built.settle)
    built.integrator.advance_to(distance=0.5e-6)
    assert len(built.state.slots.Q)
    assert np.array_equal(built.state.B, flat.B) and np.array_equal(built.state.P, flat.P)
    assert np.array_equal(built.state.A, flat.A)


def test_the_ledger_closes_on_rough_plates():
    integrator = advanced(scene(8, **SURFACES)).integrator
    totals = integrator.totals
    stored = body_energies(integrator.state, integrator.memory[:, step_memory.STORED])
    spent = totals[:, run_totals.FRICTION_WORK] + totals[:, run_totals.DAMPING_WORK] + totals[:, run_totals.NUMERICAL_LOSS]
    gained = totals[:, run_totals.PLATE_WORK] + totals[:, run_totals.EFFECT_WORK]
    # every line is computed on its own; the numerical loss makes them close, and is small
    assert stored + spent == pytest.approx(gained, rel=1e-9)
    assert np.abs(totals[:, run_totals.NUMERICAL_LOSS]).sum() < 1e-2 * totals[:, run_totals.PLATE_WORK_SIZE].sum()


@pytest.mark.slow
def test_both_integrators_agree_on_rough_plates_at_1_m_per_s():
    """97 % of the labels and 1 % of friction."""
    stories = [dragged(scene(60, **SURFACES | {"solver.integrator": kind}), path=4e-6) for kind in ("explicit", "implicit")]
    found = agreement(*stories)
    assert found.labels >= 0.97 and found.friction < 0.01, found
