"""Side walls: what a ball does at one is what it does at the plate; a sheared bed presses on both and leaves no momentum."""

import numpy as np
import pytest
from steel import STEEL
from trajectories import contents, whole_and_resumed
import thirdbody
from thirdbody.engine.guards import Ledger
from thirdbody.errors import InputError
from thirdbody.kernels.tables import run_totals
from thirdbody.runner.simulate import prepare
from thirdbody.scene import model

UM, SIZE = 1e-6, 20e-6


def between_walls(make, balls, restitution=1.0, friction=0.0, **keys):
    """Balls far above the lower plate, without weight, in a domain of 20 by 20 um."""
    tables = {"domain": model.Domain(size=(SIZE, SIZE), walls="y"), "friction": friction, "restitution": restitution}
    return make.build(make.scene(balls, {"ball": make.STEEL}, lower="ball", **(tables | keys)))


@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.4])
def test_a_ball_between_walls_loses_what_its_restitution_says(make, restitution):
    """It flies 16 um between two impacts, each of which leaves a part `restitution` of the speed."""
    simulation = between_walls(make, [make.ball(2 * UM, (5 * UM, 10 * UM, 10 * UM), (0.0, 1.0, 0.0))], restitution)
    state, ledger, speed, time = simulation.state, Ledger(simulation.state), 1.0, 8 * UM
    for impact in range(6):
        # half a flight after the impact; its own time, 2.9 (m^2/(E*^2 R v))^(1/5), is some 10 ns of the first 16 us
        speed *= restitution
        time += 8 * UM / speed
        simulation.integrator.advance_to(time=time, watch=lambda: ledger.watch(state))
        velocity = state.bodies.velocity[0]
        # of an impact in some 25 steps the restitution is off by up to 1.2 % (0.4); elastic ones keep the speed
        allowed = (1e-3 if restitution == 1.0 else 0.015) * (impact + 1)
        assert velocity[1] == pytest.approx(speed * (-1.0) ** (impact + 1), rel=allowed)
        assert velocity[0] == velocity[2] == 0.0
        assert state.bodies.position[0, 1] == pytest.approx(0.5 * SIZE, abs=0.1 * 0.5 * SIZE)
        time += 8 * UM / speed
    ledger.watch(state)
    assert ledger.relative_residual(state, ledger.lines(state)["residual"]) < 3e-3  # of these few steps


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize("spin", [(0.0, 0.0, 0.0), (3e5, -2e5, 1e5)])
def test_an_oblique_impact_is_that_on_the_plate(make, spin, far):
    """The wall at y = 0 is the plate, turned about x; the far one is it turned the other way."""
    velocity, keys, results = np.array([0.7, -0.2, -1.0]), {"friction": 0.3, "restitution": 0.7}, []
    sign = -1.0 if far else 1.0
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, sign], [0.0, -sign, 0.0]])  # z to y, or to -y
    plate = make.build(make.scene([make.ball(2 * UM, (5 * UM, 10 * UM, 2.1 * UM), velocity, spin)], {"ball": make.STEEL},
                                  lower="ball", size=SIZE, **keys))  # fmt: skip
    where = (5 * UM, SIZE - 2.1 * UM if far else 2.1 * UM, 10 * UM)
    wall = between_walls(make, [make.ball(2 * UM, where, tuple(turn @ velocity), tuple(turn @ spin))], **keys)
    for simulation in (plate, wall):
        simulation.integrator.advance_to(time=0.3 * UM)
        results.append((simulation.state.bodies.velocity[0], simulation.state.bodies.spin[0]))
    (v, w), (v_wall, w_wall) = results
    assert v[2] > 0.5  # it has left
    # the same numbers in another order: rounding of positions of 10 um, over overlaps of 10 nm
    assert v_wall == pytest.approx(turn @ v, rel=1e-9, abs=1e-9) and w_wall == pytest.approx(turn @ w, rel=1e-9, abs=1e-3)


def test_walls_end_the_period(make):
    """Balls near both walls are no images of each other; along x they are."""
    across = [make.ball(2 * UM, (5 * UM, y, 10 * UM)) for y in (2.0 * UM, SIZE - 2.0 * UM)]
    state = between_walls(make, across).state
    assert sorted(state.slots.partner) == [-3, -2]
    along = [make.ball(2 * UM, (x, 10 * UM, 10 * UM)) for x in (1.0 * UM, SIZE - 1.0 * UM)]
    with pytest.raises(InputError, match="bodies 0 and 1 overlap by 2 um"):
        between_walls(make, along)
    with pytest.raises(InputError, match=r"body 0 starts 500 nm deep in a side wall"):
        between_walls(make, [make.ball(2 * UM, (5 * UM, 1.5 * UM, 10 * UM))])


CELL = f"""{STEEL}[domain]
size = ["24 um", "18 um"]
walls = "y"
[[debris]]
material = "steel"
kind = "irregular"
count = 110
spheres = [4, 6]
aspect = [1.0, 0.8, 0.6]
size = {{distribution = "lognormal", median = "3 um", sigma = 0.15, min = "2.2 um", max = "4 um"}}
placement = "dense"
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
pressure = "100 MPa"
motion = {{x = {{velocity = "20 m/s"}}}}
[solver]
distance = "4 um"
settle = "0.3 us"
[output]
every = "0.5 um"
"""


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    return thirdbody.run(thirdbody.Scene.parse(CELL), out=folder / "run", threads=1, progress=False), folder


def test_a_sheared_bed_between_walls_balances(cell):
    """Momentum to rounding; the walls carry a part of the pressure, nearly the same on both sides, and all debris stays."""
    run, _ = cell
    series, mass = run.series, run.bodies(0)["mass"]
    momentum = np.array([mass @ run.bodies(k)["velocity"] for k in range(run.frames)])
    force = series["upper_force"] + series["lower_force"]  # means over the intervals
    change = np.diff(momentum, axis=0) / np.diff(run.times)[:, None]
    assert -force[1:] == pytest.approx(change, abs=1e-6 * np.abs(force).max() + 1e-9 * np.abs(series["upper_force"]).max())
    near, far = series["wall_force_near"][2:], series["wall_force_far"][2:]
    area, pressure = 24e-6 * series["gap"][2:], 100e6
    for wall in (-near[:, 1], far[:, 1]):
        assert np.all(wall > 0.0) and 0.2 < np.mean(wall / area) / pressure < 1.2  # of granular beds: 0.4 to 1
    # what walls carry less on one side, the friction of the plates along y does
    assert np.mean(-near[:, 1]) == pytest.approx(np.mean(far[:, 1]), rel=0.25)
    # friction on walls at rest is against the drag, on both; inside the cone
    assert np.all(near[:, 0] > 0.0) and np.all(far[:, 0] > 0.0)
    assert np.all(np.hypot(near[:, 0], near[:, 2]) <= 0.3 * -near[:, 1] * (1.0 + 1e-9))
    y, x = run.bodies(-1)["position"][:, 1], run.contacts(-1)
    assert y.min() > 0.0 and y.max() < 18e-6
    on_walls = x["side"] == 3
    assert on_walls.any() and np.all(x["normal"][on_walls, 2] == 0.0) and np.all(x["partner"][on_walls] == -1)
    assert np.sum(x["force"][on_walls & (x["normal"][:, 1] > 0.0)], axis=0) == pytest.approx(
        -series["wall_force_near"][-1], rel=1e-9
    )
    assert run.summary()["energy_residual"] < 1e-3


def test_walls_give_the_same_bits_on_any_threads_and_after_a_stop(cell, tmp_path):
    _, folder = cell
    scene = thirdbody.Scene.parse(CELL)
    thirdbody.run(scene, out=tmp_path / "two", threads=2, progress=False).close()
    assert contents(tmp_path / "two") == contents(folder / "run")
    whole_and_resumed(scene.with_settings({"solver.distance": "1 um", "solver.settle": "0.1 us"}), tmp_path)


@pytest.mark.parametrize(("changes", "message"), [
    ({"solver.integrator": "implicit"}, "solver.integrator: not with domain.walls: side walls need the"),
    ({"solver.initial_overlap": "relax"}, "solver.initial_overlap: 'relax' pushes bodies apart without side walls"),
    ({"measures.cell": "1 um"}, "measures.cell: not with domain.walls: maps are of the plates"),
    ({"domain.walls": "x"}, "domain.walls: 'x' is not one of 'y'"),
    ({"plates.lower.surface": '{rms = "0.1 um", long = "6 um", short = "2 um"}'},
     "plates.lower.surface: not with domain.walls: side walls stand between flat plates"),
])  # fmt: skip
def test_what_walls_refuse(changes, message):
    with pytest.raises(InputError) as caught:
        thirdbody.Scene.parse(CELL).with_settings(changes)
    assert message in str(caught.value)


def test_what_knows_plates_only_is_refused_and_the_check_knows_walls(command, tmp_path):
    with pytest.raises(InputError, match="does not tell side walls"):
        prepare(thirdbody.Scene.parse(CELL).with_settings({"effects.close_spots": "{}"}))
    (tmp_path / "cell.toml").write_text(CELL)
    said = command("check", "cell.toml")
    assert said.code == 0 and "it has no side walls" in said.out


def test_momentum_of_a_wall_is_booked(make):
    """An impact without losses turns the momentum of the ball over."""
    simulation = between_walls(make, [make.ball(2 * UM, (5 * UM, 2.1 * UM, 10 * UM), (0.0, -1.0, 0.0))])
    simulation.integrator.advance_to(time=0.3 * UM)
    mass = make.ball_mass(make.STEEL, 2 * UM)
    # a step of velocity Verlet keeps momentum; the speed after it is that before to 1e-4
    assert simulation.state.A[run_totals.LOWER_IMPULSE3] == pytest.approx([0.0, -2.0 * mass, 0.0], rel=1e-4)
