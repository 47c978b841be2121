"""Bodies that leave a contact with an edge: when they are out, and where they left; geometry against both integrators."""

import itertools

import numpy as np
import pytest
from edge_rig import SIZE, rig
from steel import STEEL
from trajectories import whole_and_resumed
import thirdbody
from thirdbody.engine.guards import Ledger
from thirdbody.engine.measures import ejected, exits
from thirdbody.kernels.step_tables import step_memory
from thirdbody.kernels.tables import patch, run_totals
from thirdbody.scene import model
from thirdbody.scene.pressure import Punch

UM = 1e-6
integrators = pytest.mark.parametrize("integrator", ["explicit", "implicit"])
DOMAIN = 100 * UM
CREEP = 0.1 * UM
"""A flake that sticks to one plate yields by its contacts, some nm at each reversal."""


def out(simulation):
    return ejected(simulation.state, simulation.state.world.zone)


def flakes(make, integrator, friction, motion, width, x=(0.0,), along="x", **keys):
    """Flakes at positions along an axis [m] from the middle of a punch; `friction` with the lower and with the upper plate."""
    middle = 0.5 * DOMAIN
    debris = [make.clump(make.HEXAGON, *((middle + a, middle) if along == "x" else (middle, middle + a))) for a in x]
    names = ("ball", "low", "up")
    mu = {("ball", "low"): friction[0], ("ball", "up"): friction[1]}
    pairs = tuple(model.PairTable(between=pair, friction=mu.get(pair, 0.1), restitution=0.5)
                  for pair in itertools.combinations_with_replacement(names, 2))  # fmt: skip
    widths = (width, DOMAIN) if along == "x" else (DOMAIN, width)
    profile = Punch(profile="punch", width=widths, edge=2.0 * UM, load=1e-4 * len(x), **keys)
    upper = model.UpperPlate(material="up", support="load_per_particle", pressure=profile, motion=model.Motion(**{along: motion}))
    tables = {
        "plates": model.Plates(lower=model.LowerPlate(material="low"), upper=upper, contact={"friction": 0.1}),
        "contact": model.Contact(level="mindlin", debris_contact="none"),
        "solver": model.Solver(duration=1.0, integrator=integrator, settle=1e-6),
        "domain": model.Domain(size=(DOMAIN, DOMAIN), periodic=False, ends="open"),
    }
    return make.build(make.scene(debris, dict.fromkeys(names, make.STEEL), pairs=pairs, **tables))


def run_to(simulation, path):
    """Advance to a path of the upper plate [m] at 1 m/s."""
    simulation.integrator.advance_to(time=1e-6 + path)


@integrators
@pytest.mark.parametrize("along", ["x", "y"])
def test_a_flake_goes_with_the_plate_that_holds_it(make, integrator, along):
    """Held below, it moves under the upper body by the displacement of that. Held above, it travels with it by twice the width of
    the contact, out of the domain, and stays inside."""
    axis, stages = "xy".index(along), [model.ConstantVelocity(velocity=1.0)]
    held = flakes(make, integrator, (0.5, 0.1), stages, 60 * UM, along=along)
    taken = flakes(make, integrator, (0.1, 0.5), stages, 30 * UM, along=along)
    for path in (10 * UM, 25 * UM):
        run_to(held, path)
        assert held.state.bodies.position[0, axis] == pytest.approx(0.5 * DOMAIN, abs=CREEP)
        assert held.state.P[0, patch.EDGE + axis] == pytest.approx(-path, abs=CREEP)
    run_to(taken, 60 * UM)
    assert taken.state.P[0, patch.EDGE + axis] == pytest.approx(0.0, abs=CREEP)
    assert taken.state.bodies.position[0, axis] > DOMAIN
    for simulation in (held, taken):
        assert simulation.state.P[0, patch.INSIDE] == 1.0 and not out(simulation).any()


def test_a_flake_is_out_after_the_cycles_of_geometry(make):
    """10 um forth and 6 um back: the upper body goes on by 4 um per cycle. Its edge, at 31 um, passes the flake for the last time
    3 um after the 7th cycle. From there to the end of the 8th cycle the path outside is 13 um, so after 5 um more it is 18 um. In
    the 7th cycle the flake was outside on 6 um, and came back."""
    forth, back = (model.ConstantVelocity(velocity=v, duration=t) for v, t in ((1.0, 10 * UM), (-1.0, 6 * UM)))
    stages = [forth, back] * 9 + [model.ConstantVelocity(velocity=1.0)]
    simulation = flakes(make, "implicit", (0.5, 0.1), stages, 60 * UM, out_after=18 * UM)
    run_to(simulation, (6 * 16 + 10) * UM)
    assert simulation.state.P[0, patch.OUTSIDE_PATH] == pytest.approx(3 * UM, abs=2 * CREEP)
    run_to(simulation, 7 * 16 * UM)
    assert simulation.state.P[0, patch.INSIDE] == 1.0
    run_to(simulation, (8 * 16 + 5) * UM - 5 * CREEP)
    assert not out(simulation).any() and np.isnan(exits(simulation.state, simulation.state.world.zone)).all()
    run_to(simulation, (8 * 16 + 5) * UM + 5 * CREEP)
    assert out(simulation).all()
    # the position is that of the edge; the path is known to a step of the plate
    x, y, path = exits(simulation.state, simulation.state.world.zone)[0]
    assert x == pytest.approx(-31 * UM, rel=1e-6) and y == pytest.approx(0.0, abs=CREEP)
    assert path == pytest.approx((7 * 16 + 3) * UM, abs=2 * CREEP)


def test_a_body_outside_for_a_part_of_each_stroke_is_never_out(make):
    """Frictionless, so at rest: under a stroke of 20 um the first is outside on 28 of 40 um per cycle, 84 um in all; the second,
    always outside, is out after one cycle, and did not leave."""
    motion = model.Motion(x=[model.Stroke(stroke=20 * UM, frequency=16e3)])
    profile = Punch(profile="punch", width=(60 * UM, SIZE), edge=2 * UM, load=2e-4)
    positions = [(0.0, 0.0), (-25 * UM, 0.0), (-35 * UM, 0.0)]
    simulation = rig(make, positions, profile, motion, friction=0.0, integrator="implicit", settle=1e-6)
    seen = []
    for quarter in range(1, 13):
        simulation.integrator.advance_to(time=1e-6 + quarter / 64e3)
        seen.append([*simulation.state.P[:, patch.INSIDE], *out(simulation)])
    inside, gone = np.array(seen)[:, :3], np.array(seen)[:, 3:]
    assert inside[:, 1].tolist() == [0.0, 0.0, 0.0, 1.0] * 3 and inside[:, 0].all()
    assert not gone[:, :2].any() and gone[:, 2].tolist() == [False] * 3 + [True] * 9
    assert np.isnan(exits(simulation.state, simulation.state.world.zone)).all()


def test_a_body_that_lies_outside_is_loaded_again(make):
    """Frictionless, so at rest. The second lies outside on half of each stroke; inside it carries the pressure of its position,
    and the energy balance closes."""
    motion = model.Motion(x=[model.Stroke(stroke=40 * UM, frequency=5.0)])
    profile = Punch(profile="punch", width=(60 * UM, SIZE), edge=4 * UM, load=2e-4)
    simulation = rig(make, [(0.0, 0.0), (50 * UM, 0.0)], profile, motion, friction=0.0, gravity=9.81, integrator="implicit")
    state, ledger = simulation.state, Ledger(simulation.state)
    body, tried = int(np.argmax(state.bodies.position[:, 0])), []
    for quarter in (1, 2, 3, 4, 5, 6, 7, 8, 8.4):
        simulation.integrator.advance_to(time=simulation.settle + quarter / 20.0)
        ledger.watch(state)
        tried.append(simulation.integrator.memory[body, step_memory.TRIES])
        loaded = quarter % 4 == 2  # the edge, at 32 um, is at 72 um; at 52 um in between, where the body is on its ramp
        carried = simulation.integrator.totals[body, run_totals.UPPER_FORCE + 2]
        if quarter % 2 == 0:
            assert carried == pytest.approx(state.P[body, patch.NOMINAL_LOAD] * loaded, rel=1e-6, abs=1e-12)
    assert state.bodies.position[body, 0] == pytest.approx(0.5 * SIZE + 50 * UM)
    assert tried[8] == tried[7] > 1000  # what leaves is solved, what lies still is not
    assert ledger.relative_residual(state, ledger.lines(state)["residual"]) < 1e-6


@integrators
@pytest.mark.parametrize("axis", [0, 1])
def test_where_a_body_left_is_the_edge(make, integrator, axis):
    """Frictionless balls stay where they are, so each leaves at the edge, 32 um behind the middle, when that reaches it."""
    motion = model.Motion(**{"xy"[axis]: [model.ConstantVelocity(velocity=20.0)]})
    widths = (60 * UM, SIZE)[:: 1 if axis == 0 else -1]
    profile = Punch(profile="punch", width=widths, edge=4 * UM, load=4e-4, out_after=5 * UM)
    starts = np.array([-28.0, 0.0, 10.0, 28.0]) * UM
    positions = np.zeros((4, 2))
    positions[:, axis], positions[:, 1 - axis] = starts, np.array([0.0, 20.0, -20.0, 0.0]) * UM
    simulation = rig(make, positions, profile, motion, friction=0.0, integrator=integrator, settle=1e-6)
    simulation.integrator.advance_to(time=1e-6 + 61 * UM / 20.0)
    rows = exits(simulation.state, simulation.state.world.zone)[np.argsort(simulation.state.order)]
    assert np.isnan(rows[3]).all()  # outside for 1 um
    assert rows[:3, axis] == pytest.approx(-32 * UM, rel=1e-6)
    assert rows[:3, 1 - axis] == pytest.approx(positions[:3, 1 - axis], abs=1e-9 * UM)
    # a step of the plate, at most a micrometre in the implicit one
    assert rows[:3, 2] == pytest.approx(starts[:3] + 32 * UM, abs=0.01 * UM if integrator == "explicit" else 1.0 * UM)


SCENE = f"""{STEEL}[domain]
size = ["60 um", "40 um"]
periodic = false
ends = "open"
[[debris]]
material = "steel"
kind = "irregular"
count = 12
spheres = [4, 6]
aspect = [1.0, 0.8, 0.6]
size = {{distribution = "constant", value = "2 um"}}
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
pressure = {{profile = "punch", width = ["30 um", "40 um"], edge = "4 um", load = "0.4 mN", out_after = "4 um"}}
motion = {{x = {{velocity = "1 m/s"}}}}
[plates.contact]
friction = 0.1
[contact]
debris_contact = "none"
[solver]
integrator = "implicit"
distance = "24 um"
[output]
every = "2 um"
"""


def test_the_run_file_holds_where_bodies_left(tmp_path, command):
    """The same bits after a stop; NaN but for bodies that are out and were inside."""
    whole_and_resumed(thirdbody.Scene.parse(SCENE), tmp_path)
    with thirdbody.open(tmp_path / "whole") as run:
        bodies, gone = run.bodies(-1), run.states[-1] == run.state_names.index("out")
        position, path = bodies["exit_position"], bodies["exit_distance"]
        left = np.isfinite(path)
        assert left.any() and not left[~gone].any() and np.array_equal(np.isfinite(position).all(axis=1), left)
        assert np.isnan(run.bodies(0)["exit_distance"]).all()
        # the ends along x, 17 um from the middle
        assert np.abs(position[left, 0]) == pytest.approx(17 * UM, rel=1e-6)
        assert np.all((path[left] > 0.0) & (path[left] < 20 * UM))
        frame = run.to_pandas("bodies", -1)
        assert np.array_equal(frame["exit_position_x"], position[:, 0], equal_nan=True)
    said = command("states", tmp_path / "whole", "--frame", "-1").out
    assert "exit_x" in said and "left_contact" in said
