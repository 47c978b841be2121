"""Runs between ribbed plates (`ribbed_surface`) for `theory/test_several_contacts.py`; prints their results as JSON.

`python ribbed_runs.py FOLDER`, with a copy of the package that has this surface first in PYTHONPATH.
"""

from __future__ import annotations

import itertools
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from ribbed_surface import AXIS, BASINS, PITCH
from ribbed_surface import RADIUS as RIB
from trajectories import contents

import thirdbody
from thirdbody.assembly.simulation import Simulation, build
from thirdbody.engine.energy import Ledger
from thirdbody.engine.neighbours import search
from thirdbody.errors import Interrupted
from thirdbody.kernels import neighbour_search, surface
from thirdbody.kernels.columns import patch, run_totals, sphere
from thirdbody.kernels.columns.sides import LOWER
from thirdbody.runner.resume import prepare_resume
from thirdbody.runner.simulate import execute
from thirdbody.scene.model import Scene

MU, LOAD, R = 0.2, 1e-3, 5e-6
SIN = 0.5 * PITCH / (R + RIB)
COS = math.sqrt(1.0 - SIN * SIN)
"""Angle of the contacts of a sphere that rests in a groove, from the vertical."""

SPACING, SPEED, PATH = 8e-6, 0.5, 1e-6


def scene(debris: list[dict[str, Any]], **tables: Any) -> Scene:
    """Debris of steel on a base with ribs, under a tool that sticks to it better than the base does."""
    steel = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7850.0}
    friction = {("steel", "base"): MU, ("steel", "tool"): 0.8, ("steel", "steel"): 0.2}
    return Scene.of({
        "materials": {name: steel for name in ("steel", "base", "tool")},
        "pairs": [{"between": names, "friction": mu, "restitution": 0.5} for names, mu in friction.items()],
        "debris": [{"material": "steel", "kind": "spheres", **table} for table in debris],
        "domain": {"size": (4 * PITCH, 60e-6)},
        "plates": {"lower": {"material": "base"}},
        "contact": {"law": "three_spot", "level": "mindlin", "debris_contact": "none"},
        "output": {"every": "10 us"},
    } | tables)  # fmt: skip


def pairs_in_grooves(integrator: str) -> Scene:
    """Bodies of two spheres one behind the other, in neighbouring grooves, each under its load and pulled along its groove."""
    shape = [{"center": (0.0, sign * 0.5 * SPACING, 0.0), "radius": R} for sign in (-1, 1)]
    height = AXIS + (R + RIB) * COS + 1e-10
    where = [((groove + 0.5) * PITCH, 30e-6, height) for groove in range(2)]
    upper = {"material": "tool", "support": "load_per_particle", "load": LOAD, "motion": {"y": {"velocity": SPEED}}}
    return scene(
        [{"shape": shape, "positions": where}], plates={"lower": {"material": "base"}, "upper": upper},
        solver={"integrator": integrator, "distance": PATH, "settle": 2e-6}, output={"every": "0.25 um"},
    )  # fmt: skip


def contacts(simulation: Simulation) -> list[dict[str, Any]]:
    """The closed contacts with the lower plate: body, sphere, partner code, normal, forces, slip."""
    state, slots, seen = simulation.state, simulation.state.slots, []
    for k in np.flatnonzero((slots.histories.slip > 0.0) & (slots.sides == LOWER)):
        i = int(slots.own[k])
        b = int(state.body[i])
        seen.append({
            "body": int(state.order[b]), "sphere": int(i - state.start[b]), "partner": int(slots.partner[k]),
            "normal": slots.records.normal[k].tolist(), "normal_force": float(slots.records.normal_force[k]),
            "tangential_force": slots.records.tangential_force[k].tolist(), "slip": float(slots.histories.slip[k]),
        })  # fmt: skip
    return seen


def pulled(integrator: str) -> dict[str, Any]:
    """Settle, then pull: contacts and labels at both ends, friction of the last part, energies."""
    built = build(pairs_in_grooves(integrator))
    state, names, ledger = built.state, built.labeller.states, Ledger(built.state)
    built.integrator.advance_to(time=built.settle)
    rest = {"contacts": contacts(built), "labels": [names[int(code)] for code in built.integrator.label()[:, 0]]}
    built.integrator.advance_to(distance=0.75 * PATH)
    before = state.A.copy()
    built.integrator.advance_to(distance=PATH)
    push = (state.A - before)[run_totals.UPPER_IMPULSE3]
    carried = histories(built)
    search(state)
    return {
        "rest": rest, "contacts": contacts(built), "labels": [names[int(code)] for code in built.integrator.label()[:, 0]],
        "friction": -push[1] / abs(push[2]), "residual": ledger.relative_residual(state, ledger.lines(state)["residual"]),
        "carried": all(np.array_equal(row, histories(built)[key]) for key, row in carried.items()), "keys": len(carried),
    }  # fmt: skip


def histories(simulation: Simulation) -> dict[tuple[int, int], np.ndarray]:
    """Rows of the table of histories by sphere and partner code."""
    slots = simulation.state.slots
    return {(int(i), int(j)): row.copy() for i, j, row in zip(slots.own, slots.partner, slots.H, strict=True)}


def in_pieces(integrator: str, folder: Path) -> list[str]:
    """Datasets of a run that was stopped and resumed again and again that differ from those of the whole run."""
    execute(build(pairs_in_grooves(integrator)), folder / "whole")
    counter, simulation, saved, pieces = itertools.count(), build(pairs_in_grooves(integrator)), None, 0
    while True:
        last = next(counter)
        try:
            execute(simulation, folder / "cut", checkpoint=saved, stop=after(3 * 2**last))
            break
        except Interrupted:
            simulation, saved = prepare_resume(folder / "cut")
            pieces += 1
    assert pieces > 0
    whole, joined = contents(folder / "whole"), contents(folder / "cut")
    return [name for name in whole.keys() | joined.keys() if whole.get(name) != joined.get(name)]


def in_file(folder: Path) -> dict[str, Any]:
    """Partners of the contacts in the last frame of a run, and the number of contacts of each body."""
    run = thirdbody.open(folder)
    return {"partner": run.contacts(-1)["partner"].tolist(), "contacts": run.bodies(-1)["contacts"].tolist()}


def after(watches: int):
    """Says stop from the so-manieth question on."""
    counter = itertools.count(1)
    return lambda: next(counter) >= watches


def gaps(x: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Gaps of spheres (n,) to all ribs near the domain (n, ribs), rib by rib."""
    axes = PITCH * RIBS
    return np.hypot(x[:, [0]] - axes, x[:, [2]] - AXIS) - RIB - radius[:, None]


RIBS = np.arange(-8, 13)
CODES = -1 - RIBS % BASINS
"""Ribs of which some may be near, and their partner codes."""


def listed() -> dict[str, Any]:
    """Candidates of random spheres against every rib: those missed, and those listed in vain."""
    rng, n, skin = np.random.default_rng(1), 10000, 0.5e-6
    S, P = np.zeros((n, sphere.WIDTH)), np.zeros((1, patch.WIDTH))
    S[:, sphere.X], S[:, sphere.Z] = rng.uniform(0.0, 4 * PITCH, n), rng.uniform(0.0, 10e-6, n)
    S[:, sphere.RADIUS], P[0, patch.HEIGHT] = rng.uniform(0.5e-6, 5.5e-6, n), 14e-6
    own, partner = np.empty(4 * n, np.int32), np.empty(4 * n, np.int32)
    bodies = np.arange(n)
    count = neighbour_search.plate_candidates(S, P, bodies, np.zeros(n, np.int64), (True, True), skin, own, partner)
    found = set(zip(own[:count].tolist(), partner[:count].tolist(), strict=True))
    near = gaps(S, S[:, sphere.RADIUS]) < skin
    wanted = {(int(i), int(CODES[rib])) for i, rib in np.argwhere(near)}
    under = np.flatnonzero(P[0, patch.HEIGHT] - S[:, sphere.Z] - S[:, sphere.RADIUS] < skin)
    wanted |= {(i, -1 - BASINS) for i in under.tolist()}
    double = int(np.count_nonzero(np.bincount(own[:count][partner[:count] >= -BASINS], minlength=n) == 2))
    return {"missed": len(wanted - found), "vain": len(found - wanted), "found": len(found), "double": double}


def thrown() -> dict[str, Any]:
    """Balls that hop over the ribs: instants at which the closed contacts are not those that touch; largest numbers seen."""
    rng, n = np.random.default_rng(2), 40
    radius = rng.uniform(3e-6, 5e-6, n)
    debris = [
        {"radius": r, "positions": [(x, 30e-6, 2.5 * r)], "velocity": (v, 0.0, -1.0)}
        for r, x, v in zip(radius, rng.uniform(0.0, 4 * PITCH, n), rng.uniform(-4.0, 4.0, n), strict=True)
    ]  # fmt: skip
    built = build(scene(debris, effects={"gravity": (0.0, 0.0, -4e5)}, solver={"integrator": "explicit", "duration": 1.0}))
    state, wrong, double, codes = built.state, 0, 0, set()
    for stop in np.arange(1, 201) * 1e-7:
        built.integrator.advance_to(time=float(stop))
        slots = state.slots
        on = np.flatnonzero(slots.histories.slip > 0.0)
        seen = sorted(zip(slots.own[on].tolist(), slots.partner[on].tolist(), strict=True))
        touching = np.argwhere(gaps(state.S, state.S[:, sphere.RADIUS]) < 0.0)
        wrong += seen != sorted((int(i), int(CODES[rib])) for i, rib in touching)
        double, codes = max(double, len(on) - len(set(slots.own[on].tolist()))), codes | {j for _, j in seen}
    return {"wrong": wrong, "double": double, "codes": sorted(codes), "searches": state.searches,
            "path": float(np.abs(state.S[:, sphere.X] - [d["positions"][0][0] for d in debris]).max())}  # fmt: skip


def main(folder: Path) -> None:
    """Print all results."""
    assert surface.BASINS == BASINS, "the package with flat plates was imported"
    report: dict[str, Any] = {"listed": listed(), "thrown": thrown()}
    for integrator in ("explicit", "implicit"):
        report[integrator] = pulled(integrator) | {"differ": in_pieces(integrator, folder / integrator)}
        report[integrator]["file"] = in_file(folder / integrator / "whole")
    print(json.dumps(report))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
