"""A dense layer of clumps sheared between rough plates at a constant gap, against LAMMPS from the same configuration.

`data/dense_clumps.npz`: 300 clumps of 4 to 8 unequal spheres (um, pg, us), a state of the sheared layer. What LAMMPS did with it,
how, and why its own time step is 16 times smaller in the first comparison is told in `../theory/data/lammps_dense_clumps.json`.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slow import slow
from thirdbody.assembly.physics import compile_physics
from thirdbody.bodies.clump import Clump
from thirdbody.engine.explicit import Explicit
from thirdbody.engine.placed import Placed
from thirdbody.engine.state import World, assemble
from thirdbody.engine.upper_plate import PatchedPlate, Schedule, Segment
from thirdbody.kernels import schedule
from thirdbody.kernels.tables import body, run_totals
from thirdbody.laws.contract import LawFamily, Plugin
from thirdbody.laws.damping import HERTZ_DAMPING, TANGENTIAL_DAMPING
from thirdbody.laws.friction import MINDLIN
from thirdbody.laws.hertz import HERTZ
from thirdbody.laws.registry import Registry
from thirdbody.scene.model import Contact, Domain, Material, Output, PairTable, Plates, Scene, Solver, Spheres

HERE = Path(__file__).parent
LAMMPS = json.loads((HERE.parent / "theory" / "data" / "lammps_dense_clumps.json").read_text(encoding="utf-8"))
LENGTH, MASS, TIME = 1e-6, 1e-15, 1e-6  # um, pg and us in SI
MEASURED = ("upper_x", "upper_z", "lower_x", "lower_z", "pairs", "plate")
"""Forces on the plates, N, averaged over every step; contacts between clumps and with plates, at the ends of equal intervals."""
STEEL = LAMMPS["material"]
LAWS = {"bare": (HERTZ, HERTZ_DAMPING, MINDLIN), "full": (HERTZ, HERTZ_DAMPING, MINDLIN, TANGENTIAL_DAMPING)}


@pytest.fixture(scope="module")
def layer():
    with np.load(HERE / "data" / "dense_clumps.npz") as data:
        return {name: np.asarray(data[name], float) for name in data.files} | {"mol": data["mol"].astype(np.int64)}


def placed(layer):
    density = STEEL["density"]
    clumps, turns = [], []
    for b, (mass, inertia) in enumerate(zip(layer["bm"], layer["bI"], strict=True)):
        own = layer["mol"] == b
        moments, axes = np.linalg.eigh(inertia)
        axes[:, 2] *= np.linalg.det(axes)
        centers = (layer["x"][own] - layer["bx"][b]) @ axes * LENGTH
        per_density = MASS * LENGTH**2 / density
        clumps.append(Clump(centers, layer["rad"][own] * LENGTH, mass * MASS / density, moments * per_density, 0.0))
        turns.append(np.roll(Rotation.from_matrix(axes).as_quat(), 1))
    n = len(clumps)
    zeros = np.zeros(n, np.int64)
    velocity, spin = layer["bv"].copy(), layer["bw"] / TIME
    return Placed(clumps, np.full(n, density), zeros, zeros, layer["bx"] * LENGTH, np.array(turns), velocity, spin)


def scene(level):
    steel = Material(**STEEL)
    frictions = {("clump", "clump"): LAMMPS["friction"], ("clump", "plate"): LAMMPS["plate_friction"], ("plate", "plate"): 0.0}
    return Scene(
        materials={"clump": steel, "plate": steel},
        pairs=tuple(PairTable(between=names, friction=mu, restitution=LAMMPS["restitution"]) for names, mu in frictions.items()),
        debris=(Spheres(material="clump", radius=1e-6, positions=((0.0, 0.0, 0.0),)),),
        domain=Domain(size=(1.0, 1.0)),
        plates=Plates(),
        contact=Contact(law="peer", level=level, memory="rescaled"),  # LAMMPS remembers the force alone
        solver=Solver(duration=1.0),
        output=Output(every=1.0, every_kind="time"),
    )


def shear(layer, level, time_step):
    family = LawFamily(name="peer", levels=LAWS, default_level="full")
    choice = compile_physics(scene(level), Registry((Plugin(name="peer", families=(family,)),)))
    n, one = len(layer["bm"]), np.ones(1)
    x = (Segment(0.0, schedule.POLYNOMIAL, 0.0, LAMMPS["speed"]),)
    gap = (Segment(0.0, schedule.POLYNOMIAL, float(layer["H"]) * LENGTH),)
    heights = one * gap[0].a
    plate = PatchedPlate(1, heights, one, 0.0 * one, 0.0 * one, False, np.zeros(n, np.int64), Schedule(x=x, gap=gap))
    l_x, l_y = (float(length) * LENGTH for length in layer["L"])
    state = assemble(placed(layer), World((l_x, l_y), True, False, 1, plate, True), choice.physics, 0.9e-6)
    run = Explicit(state, list(choice.materials), time_step)
    run.start()
    return run


def measure(run, end, intervals):
    """(intervals, 7) the columns `MEASURED` and the solid fraction of the middle half, in equal intervals up to `end` (s)."""
    state, rows = run.state, []
    begin = state.time
    for k in range(1, intervals + 1):
        old, since = state.A.copy(), state.time
        run.advance_to(time=begin + (end - begin) * k / intervals)
        force = (state.A - old) / (state.time - since)
        up, low = force[run_totals.UPPER_IMPULSE3], force[run_totals.LOWER_IMPULSE3]
        closed = state.slots.histories.slip > 0.0
        n = state.slots.n_plates
        height = state.bodies.position[:, 2] / state.patches.height[0]
        middle = state.bodies.mass[np.abs(height - 0.5) < 0.25].sum() / STEEL["density"]
        share = middle / (0.5 * np.prod(state.world.size) * state.patches.height[0])
        rows.append((up[0], up[2], low[0], low[2], closed[n:].sum(), closed[:n].sum(), share))
    return np.array(rows)


# Without the tangential dashpot both engines walk the same path: 3200 steps, some 10 collision times: 7e-4 was measured, falling
# to 4e-4 at half our step. Later the paths part, as those of any two runs do that differ by rounding. A count is off by a few of
# the contacts that just open or close. In full both cut the sum of spring and dashpot at mu N; then our spring keeps mu N, that
# of LAMMPS only what the dashpot leaves of it: a few per cent
@pytest.mark.parametrize("level, forces, counts", [("bare", 1.5e-3, 4e-3), slow("full", 0.03, 0.03)])
def test_the_first_half_microsecond(layer, level, forces, counts):
    rows = measure(shear(layer, level, LAMMPS["trace_time_step"]), LAMMPS["trace_duration"], LAMMPS["trace_intervals"])
    for name, value in zip(MEASURED, rows.mean(axis=0), strict=False):
        tolerance = counts if name in ("pairs", "plate") else forces
        assert value == pytest.approx(LAMMPS[f"trace_{level}"][name], rel=tolerance), name


def steady_run(layer, nudge):
    """Means of one run over what the file calls `steady`; `nudge`: relative change of the place of one clump at the start."""
    run = shear(layer, "full", None)
    run.state.B[0, body.POSITION] *= 1.0 + nudge
    start, width, windows = (LAMMPS[f"steady_{name}"] for name in ("start", "window", "windows"))
    run.advance_to(time=start)
    rows = np.array([measure(run, start + (k + 1) * width, 20).mean(axis=0) for k in range(windows)])
    drag, load = rows[:, 2] - rows[:, 0], rows[:, 1] - rows[:, 3]
    return np.column_stack((drag / load, 0.5 * load, rows[:, 4:])).mean(axis=0)


@pytest.mark.full(kind="slow")
def test_the_sheared_layer_has_the_same_steady_state(layer):
    runs = np.array([steady_run(layer, nudge) for nudge in (0.0, 1e-9, 2e-9)])
    errors = runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    # three standard errors of the difference, but no finer than 2 %: the two rules for dashpot and friction limit differ, and
    # three runs tell their own scatter to a half only. Friction of six runs of ours: 0.5325 (0.0033), theirs 0.5385 (0.0035)
    for (name, theirs), ours, error in zip(LAMMPS["steady"].items(), runs.mean(axis=0), errors, strict=True):
        assert abs(ours - theirs["mean"]) < max(3.0 * np.hypot(error, theirs["error"]), 0.02 * theirs["mean"]), name
