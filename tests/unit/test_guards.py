"""Every guard trips, and its message names the time, the body and the limit."""

from __future__ import annotations

import math

import pytest

from thirdbody.assembly.simulation import build
from thirdbody.engine.energy import Ledger
from thirdbody.engine.guards import EnergyGuard
from thirdbody.errors import GuardStop
from thirdbody.kernels.columns import body, run_totals
from thirdbody.runner.run_folder import RunFolder
from thirdbody.runner.run_loop import RunLoop
from thirdbody.runner.simulate import execute
from thirdbody.scene.model import Domain
from thirdbody.studies.robustness import scenes as make
from thirdbody.studies.robustness.case import Setting, Trial
from thirdbody.trajectory.reader import open_run


def pressed(integrator="explicit", **keys):
    trial = Trial(Setting(integrator, "mindlin"))
    return build(make.pressed(trial, make.clump(make.TRIPOD), 0.3, **keys))


def balls(velocity=(1.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), size=10.0, radius=1e-3):
    """Two balls in the open, a tenth of a radius apart, the first of them moving."""
    trial = Trial(Setting("explicit", "mindlin"))
    pair = [make.ball(radius, (0.0, 0.0, 0.0), velocity, spin), make.ball(radius, (2.1 * radius, 0.0, 0.0))]
    return build(make.scene(trial, pair, {"ball": make.STEEL}, 0.3, domain=Domain(size=(size, size), periodic=False)))


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_overlap(integrator):
    simulation = pressed(integrator)
    simulation.state.patches.load[:] *= 1e4  # behind the back of the scene, which would warn
    simulation.state.patches.nominal_load[:] *= 1e4
    with pytest.raises(GuardStop, match=r"stopped at t = .*body 0 at \(.*(overlap|sinks).* of the .*radius \(guard: 0\.3\)"):
        simulation.integrator.advance_to(time=1e-5)


def test_travel():
    simulation = balls(velocity=(2e4, 0.0, 0.0))
    with pytest.raises(GuardStop, match=r"stopped at t = .*body 0 at \(.*moves more than 0\.25 of a radius in one step"):
        simulation.integrator.advance_to(time=1e-5)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_place_that_is_not_a_number(value):
    simulation = balls()
    simulation.state.bodies.position[1, 2] = value
    with pytest.raises(GuardStop, match="stopped at t = .*the position of body 1 is not a number"):
        simulation.integrator.advance_to(time=1e-5)


def test_left_the_domain():
    trial = Trial(Setting("explicit", "mindlin"))
    falling = [make.ball(1e-3, (0.05, 0.05, 1.5e-3), (10.0, 0.0, 0.0))]
    domain = Domain(size=(0.1, 0.1), periodic=False)
    simulation = build(make.scene(trial, falling, {"ball": make.STEEL}, 0.3, lower="ball", domain=domain))
    with pytest.raises(GuardStop, match=r"stopped at t = .*body 0 at \(0\.10*\d*, .*left the domain"):
        simulation.integrator.advance_to(time=1e-2)


def test_energy_that_comes_from_nowhere():
    """A guard of the energy balance judges twice where forces may jump, once where they cannot."""
    simulation = balls()
    ledger = Ledger(simulation.state)
    simulation.state.bodies.velocity[0, 0] *= 1.04  # 8 % of the energy
    EnergyGuard(ledger).check(simulation.state)
    simulation.state.bodies.velocity[0, 0] *= 1.04
    with pytest.raises(GuardStop, match=r"stopped at t = 0 s .*residual is 0\.1\d of the .*\(guard: 0\.1\); a smaller"):
        EnergyGuard(ledger).check(simulation.state)
    patient = EnergyGuard(ledger, 2)
    patient.check(simulation.state)
    with pytest.raises(GuardStop, match="does not close"):
        patient.check(simulation.state)


def test_a_single_check_above_the_limit_is_forgiven():
    simulation = balls()
    ledger = Ledger(simulation.state)
    guard, row = EnergyGuard(ledger, 2), simulation.state.B[0]
    for factor in (1.2, 1.0 / 1.2) * 3:
        row[body.VELOCITY] *= factor
        guard.check(simulation.state)


def test_energy_that_is_not_a_number():
    simulation = balls()
    ledger = Ledger(simulation.state)
    simulation.state.A[run_totals.FRICTION_WORK] = math.nan
    with pytest.raises(GuardStop, match="residual is nan"):
        EnergyGuard(ledger).check(simulation.state)


@pytest.mark.parametrize("factor", [1.0 + 2e-6, 1.0 - 2e-6, math.nan])
def test_a_quaternion_that_is_no_rotation(factor):
    simulation = balls()
    simulation.state.bodies.quaternion[1] *= factor
    with pytest.raises(GuardStop, match="stopped at t = .*orientation of body 1 is no rotation any more.*guard: 1 within 1e-06"):
        EnergyGuard(Ledger(simulation.state)).check(simulation.state)
    simulation.state.bodies.quaternion[1] = (1.0 - 0.9e-6, 0.0, 0.0, 0.0)
    EnergyGuard(Ledger(simulation.state)).check(simulation.state)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_a_run_is_stopped_by_its_energy_and_keeps_its_frames(tmp_path, monkeypatch, integrator):
    trial = Trial(Setting(integrator, "mindlin"))
    scene = make.pressed(trial, make.clump(make.TRIPOD), 0.3).with_settings({"solver.duration": "1 us", "output.every": "200 ns"})
    simulation = build(scene)
    advance = simulation.integrator.advance_to

    def leaky(*arguments, **keys):
        advance(*arguments, **keys)
        simulation.state.A[run_totals.FRICTION_WORK] += 0.3 * max(simulation.state.A[run_totals.PLATE_WORK_SIZE], 1e-12)
        if hasattr(simulation.integrator, "ledgers"):
            simulation.integrator.ledgers[:1, run_totals.FRICTION_WORK] = simulation.state.A[run_totals.FRICTION_WORK]
        if hasattr(simulation.integrator, "totals"):
            simulation.integrator.totals[0, run_totals.FRICTION_WORK] = simulation.state.A[run_totals.FRICTION_WORK]

    monkeypatch.setattr(simulation.integrator, "advance_to", leaky)
    with pytest.raises(GuardStop, match="the energy balance does not close") as stop:
        execute(simulation, tmp_path / "run")
    assert stop.value.exit_code == 4
    with open_run(tmp_path / "run") as kept:
        assert kept.summary()["finished"] is False and "does not close" in kept.summary()["stopped"]
        assert kept.frames >= 1


def test_a_sound_run_is_checked_and_goes_on(tmp_path):
    trial = Trial(Setting("explicit", "mindlin"))
    scene = make.pressed(trial, make.clump(make.TRIPOD), 0.3)
    scene = scene.with_settings({"solver.duration": "200 ns", "output.every": "100 ns"})
    conduct = RunLoop(build(scene), RunFolder(tmp_path))
    assert conduct.energy_guard.patience == 2
    execute(conduct.simulation, tmp_path / "run")


def test_a_force_that_is_not_a_number():
    simulation = pressed()
    simulation.integrator.advance_to(time=5e-7)
    assert simulation.state.slots.histories.slip.any()
    simulation.state.physics.pairs[:] = math.nan
    with pytest.raises(GuardStop, match=r"stopped at t = .*the force between body 0 at \(.*plate is not a number"):
        simulation.integrator.advance_to(time=6e-7)
