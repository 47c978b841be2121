"""Every guard trips, and its message names the time, the body and the limit; a copy of an integrator has its own tables."""

import copy
import math
import re
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from hard import trial as make
from hard.trial import Setting, Trial
from thirdbody.api import open_run
from thirdbody.assembly.simulation import build
from thirdbody.engine.accuracy import causes, in_words, limited_by, limiting_body
from thirdbody.engine.explicit import Explicit
from thirdbody.engine.guards import EnergyGuard, Ledger
from thirdbody.errors import GuardStop
from thirdbody.kernels.step_tables import step_memory
from thirdbody.kernels.tables import body, run_totals
from thirdbody.kernels.tables import domain as limits
from thirdbody.runner.run_folder import RunFolder
from thirdbody.runner.run_loop import RunLoop
from thirdbody.runner.simulate import execute, prepare
from thirdbody.scene.model import Domain, Scene

BOTH = pytest.mark.parametrize("integrator", ["explicit", "implicit"])


def pressed_scene(integrator="explicit", **changes):
    scene = make.pressed(Trial(Setting(integrator, "mindlin")), make.clump(make.TRIPOD), 0.3)
    return scene.with_settings({name.replace("__", "."): value for name, value in changes.items()})


def balls(velocity=(1.0, 0.0, 0.0)):
    pair = [make.ball(1e-3, (0.0, 0.0, 0.0), velocity, (0.0, 0.0, 0.0)), make.ball(1e-3, (2.1e-3, 0.0, 0.0))]
    domain = Domain(size=(10.0, 10.0), periodic=False)
    return build(make.scene(Trial(Setting("explicit", "mindlin")), pair, {"ball": make.STEEL}, 0.3, domain=domain))


@BOTH
def test_overlap(integrator):
    simulation = build(pressed_scene(integrator))
    for loads in (simulation.state.patches.load, simulation.state.patches.nominal_load):
        loads[:] *= 1e4  # behind the back of the scene, which would warn
    with pytest.raises(GuardStop, match=r"stopped at t = .*body 0 at \(.*(overlap|sinks).* of the .*radius \(guard: 0\.3\)"):
        simulation.integrator.advance_to(time=1e-5)


def test_travel_a_place_that_is_not_a_number_and_leaving_the_domain():
    with pytest.raises(GuardStop, match=r"stopped at t = .*body 0 at \(.*moves more than 0\.25 of a radius in one step"):
        balls(velocity=(2e4, 0.0, 0.0)).integrator.advance_to(time=1e-5)
    for value in (math.nan, math.inf):
        simulation = balls()
        simulation.state.bodies.position[1, 2] = value
        with pytest.raises(GuardStop, match="stopped at t = .*the position of body 1 is not a number"):
            simulation.integrator.advance_to(time=1e-5)
    falling = [make.ball(1e-3, (0.05, 0.05, 1.5e-3), (10.0, 0.0, 0.0))]
    domain = Domain(size=(0.1, 0.1), periodic=False)
    trial = Trial(Setting("explicit", "mindlin"))
    simulation = build(make.scene(trial, falling, {"ball": make.STEEL}, 0.3, lower="ball", domain=domain))
    with pytest.raises(GuardStop, match=r"stopped at t = .*body 0 at \(0\.10*\d*, .*left the domain"):
        simulation.integrator.advance_to(time=1e-2)
    assert simulation.state.D[limits.FLOOR] == -1e-3  # one radius below the plate


def test_energy_that_comes_from_nowhere_and_a_quaternion_that_is_no_rotation():
    # a guard of the energy balance judges twice where forces may jump, once where they cannot
    state = balls().state
    ledger = Ledger(state)
    state.bodies.velocity[0, 0] *= 1.04  # 8 % of the energy
    EnergyGuard(ledger).check(state)
    state.bodies.velocity[0, 0] *= 1.04
    with pytest.raises(GuardStop, match=r"stopped at t = 0 s .*residual is 0\.1\d of the .*\(guard: 0\.1\); a smaller"):
        EnergyGuard(ledger).check(state)
    patient = EnergyGuard(ledger, 2)
    patient.check(state)
    with pytest.raises(GuardStop, match="does not close"):
        patient.check(state)
    state.A[run_totals.FRICTION_WORK] = math.nan
    with pytest.raises(GuardStop, match="residual is nan"):
        EnergyGuard(ledger).check(state)
    simulation = balls()
    guard, row = EnergyGuard(Ledger(simulation.state), 2), simulation.state.B[0]
    for factor in (1.2, 1.0 / 1.2) * 3:
        row[body.VELOCITY] *= factor
        guard.check(simulation.state)
    state = balls().state
    for factor in (1.0 + 2e-6, 1.0 - 2e-6, math.nan):
        state.bodies.quaternion[1] = (factor, 0.0, 0.0, 0.0)
        words = "stopped at t = .*orientation of body 1 is no rotation any more.*guard: 1 within 1e-06"
        with pytest.raises(GuardStop, match=words):
            EnergyGuard(Ledger(state)).check(state)
    state.bodies.quaternion[1] = (1.0 - 0.9e-6, 0.0, 0.0, 0.0)
    EnergyGuard(Ledger(state)).check(state)


@BOTH
def test_a_run_is_stopped_by_its_energy_and_keeps_its_frames(tmp_path, monkeypatch, integrator):
    simulation = build(pressed_scene(integrator, solver__duration="1 us", output__every="200 ns"))
    advance, totals, driver = simulation.integrator.advance_to, simulation.state.A, simulation.integrator

    def leaky(*arguments, **keys):
        advance(*arguments, **keys)
        totals[run_totals.FRICTION_WORK] += 0.3 * max(totals[run_totals.PLATE_WORK_SIZE], 1e-12)
        for name in ("ledgers", "totals"):
            if hasattr(driver, name):
                getattr(driver, name)[:1, run_totals.FRICTION_WORK] = totals[run_totals.FRICTION_WORK]

    monkeypatch.setattr(driver, "advance_to", leaky)
    with pytest.raises(GuardStop, match="the energy balance does not close") as stop:
        execute(simulation, tmp_path / "run")
    assert stop.value.exit_code == 4
    with open_run(tmp_path / "run") as kept:
        assert kept.summary()["finished"] is False and "does not close" in kept.summary()["stopped"] and kept.frames >= 1


def test_a_sound_run_is_checked_and_goes_on(tmp_path):
    conduct = RunLoop(build(pressed_scene(solver__duration="200 ns", output__every="100 ns")), RunFolder(tmp_path))
    assert conduct.energy_guard.patience == 2
    for every, cost, saved in ((math.inf, 0.0, 0), (0.0, 1e6, 0), (0.0, 0.0, 1)):  # the longer interval counts
        conduct.export_state, conduct.every, conduct.cost = Mock(), every, cost
        conduct._stop_or_save()
        assert conduct.export_state.call_count == saved
    execute(conduct.simulation, tmp_path / "run")


def test_a_force_that_is_not_a_number():
    simulation = build(pressed_scene())
    simulation.integrator.advance_to(time=5e-7)
    assert simulation.state.slots.histories.slip.any()
    simulation.state.physics.pairs[:] = math.nan
    with pytest.raises(GuardStop, match=r"stopped at t = .*the force between body 0 at \(.*plate is not a number"):
        simulation.integrator.advance_to(time=6e-7)


def test_how_steps_change_and_what_is_said_to_limit_them():
    one = SimpleNamespace(waiting=[])  # down at once, up at once by a quarter, else to the smallest of 16 that allow more
    assert [Explicit._next_step(one, x, 1.0) for x in (0.9, 1.26, 1.2, 0.99)] == [0.9, 1.26, 1.0, 0.99]
    assert [Explicit._next_step(one, 1.2 - 0.01 * k, 1.0) for k in range(16)] == [1.0] * 15 + [1.05]
    memory, order = np.zeros((2, step_memory.WIDTH)), np.array([7, 4])
    causes(memory)[:, :6] = [[0, 1, 0, 0, 2, 0], [5, 0, 0, 0, 2, 0]]
    assert list(limited_by(memory).items()) == [("error", 5), ("largest_step", 4), ("landing", 1)]
    assert limiting_body(memory, order) == {"body": 4, "steps": 5}
    assert re.match("50 % of steps .* of body 4$", in_words(causes(memory), order))


@BOTH
def test_a_copy_of_an_integrator_does_not_move_the_original(integrator):
    """The kernels get addresses of tables: those of the original would move its bodies, and the copy would never arrive."""
    scene = Scene.load(Path(__file__).parents[2] / "scenes" / "three_spot.toml")
    original = prepare(scene.with_settings({"solver.integrator": integrator})).integrator
    original.advance_to(time=1e-9)
    before = original.state.B.copy()
    double = copy.deepcopy(original)
    double.advance_to(time=2e-9)
    assert np.array_equal(original.state.B, before)
    original.advance_to(time=2e-9)
    assert np.array_equal(original.state.B, double.state.B) and not np.array_equal(original.state.B, before)
