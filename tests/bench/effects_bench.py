"""What effects cost and change: the tables in `plugins/README.md`.

    PYTHONPATH=tests python tests/bench/effects_bench.py cost [explicit] [implicit]
    PYTHONPATH=tests python tests/bench/effects_bench.py labels [flow] [necks] [spots] [heavy]
    PYTHONPATH=tests python tests/bench/effects_bench.py relief [SCENE]

cost: processor time with an effect over without, per explicit step and implicit drag: 200 particles of
`scenes/yielding_debris.toml`, one thread. Both runs of a pair go on side by side, piece by piece, so that what disturbs the
machine falls on both.

labels: labels and friction of 2000 particles of that scene over 20 um, implicit, half a minute per row. All rows of a group, also
that of starts 1e-9 apart, are compared with its first.

relief: how far the spots of all bodies lower a plate under each other, against overlaps: a scene (`sheared_debris`) after 1 um of
drag, lower plate. Relief of a spot by Boussinesq's solution, c N/r, of the other spots of its body and of those of all other
bodies within half the domain around it (periodic). A uniform relief only lowers a plate, so its mean is told apart.
"""

import argparse
import statistics
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from stories import SCENE as SHEARED
from stories import Story, dragged
from thirdbody_three_spot import PLUGIN

import thirdbody
from thirdbody.assembly.simulation import Simulation
from thirdbody.jit.threads import allow_threads
from thirdbody.kernels.columns import record, run_totals
from thirdbody.kernels.columns.sides import LOWER
from thirdbody.runner.prepare import prepare
from thirdbody.studies.nudge import NUDGE

SCENE = Path(__file__).parents[2] / "scenes" / "yielding_debris.toml"
EFFECTS: dict[str, dict[str, Any]] = {
    "elastic_plastic": {}, "adhesion": {"work_of_adhesion": "50 mJ/m2", "model": "jkr"}, "pivoting": {}, "close_spots": {},
}  # fmt: skip
PIECES, PAIRS = {"explicit": 40e-9, "implicit": 1e-6}, 8  # drag of a piece [m], and number of pairs
Settings = Mapping[str, Any]
HEAVY = {"plates.upper.load": "1 mN"}


def necks(work: str, **more: str) -> Settings:
    return {"effects.adhesion": {"work_of_adhesion": work, "model": "jkr"} | more}


GROUPS: Mapping[str, Mapping[str, Settings]] = {
    "flow": {
        "none": {},
        **{f"yield strength {s}": {"effects.elastic_plastic": {}, "materials.steel.yield_strength": s}
           for s in ("1.5 GPa", "600 MPa", "300 MPa")},
    },
    "necks": {
        "none": {}, "5 mJ/m2": necks("5 mJ/m2"), "50 mJ/m2": necks("50 mJ/m2"),
        "50 mJ/m2, external": necks("50 mJ/m2", friction_load="external"),
        "200 mJ/m2": necks("200 mJ/m2"), "1 J/m2": necks("1 J/m2"),
    },
    "spots": {"none": {}, "pivoting": {"effects.pivoting": {}}, "close spots": {"effects.close_spots": {}}},
    "heavy": {
        "none, 1 mN": HEAVY, "pivoting, 1 mN": HEAVY | {"effects.pivoting": {}},
        "close spots, 1 mN": HEAVY | {"effects.close_spots": {}}, "50 mJ/m2, 1 mN": HEAVY | necks("50 mJ/m2"),
    },
}  # fmt: skip


def started(integrator: str, effects: dict[str, Any]) -> Simulation:
    settings = {"debris.0.count": 200, "solver.integrator": integrator, "effects.elastic_plastic": None}
    settings |= {f"effects.{name}": given for name, given in effects.items()}
    run = prepare(thirdbody.Scene.load(SCENE).with_settings(settings))
    run.integrator.advance_to(time=run.settle)
    run.integrator.advance_to(distance=PIECES[integrator])
    return run


def seconds(run: Simulation, distance: float) -> float:
    """Advance to a distance [m]; return processor time [s], in explicit runs per step."""
    begin, steps = time.process_time(), run.state.A[run_totals.STEPS]
    run.integrator.advance_to(distance=distance)
    spent = time.process_time() - begin
    return spent / (run.state.A[run_totals.STEPS] - steps) if run.plan.kind == "explicit" else spent


def cost(integrators: list[str]) -> None:
    allow_threads(1)
    for integrator in integrators or PIECES:
        for effect, options in EFFECTS.items():
            without, named = started(integrator, {}), started(integrator, {effect: options})
            ends = [PIECES[integrator] * (k + 2) for k in range(PAIRS)]
            ratios = sorted((1.0 / seconds(without, end)) * seconds(named, end) for end in ends)
            text = f"{statistics.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f})"
            print(f"{integrator} {effect:16s} {text}", flush=True)


def story(settings: Settings, nudge: float = 0.0) -> Story:
    """Return the story of the particles with these settings, without plastic flow where they do not name it."""
    implicit = {"effects.elastic_plastic": None, "solver.integrator": "implicit"}
    return dragged(thirdbody.Scene.load(SCENE).with_settings(implicit | dict(settings)), nudge)


def print_row(name: str, result: Story, base: Story) -> None:
    """Print labels that agree with those of the first row (mean, least of all stops), rolling at the end, mean friction."""
    labeller = PLUGIN.families[0].labeller
    assert labeller is not None
    agree = np.mean(result.labels == base.labels, axis=1)
    rolling = np.mean(result.labels[-1] == labeller.states.index("rolling"))
    mean = result.friction.mean()
    words = f"{name:26s} labels {100 * agree.mean():.2f} % (least {100 * agree.min():.1f} %), rolling {100 * rolling:.1f} %, "
    print(f"{words}friction {mean:.4f} ({mean / base.friction.mean() - 1.0:+.1e})", flush=True)


def labels(groups: list[str]) -> None:
    for group in groups or GROUPS:
        (first, settings), *others = GROUPS[group].items()
        print(group)
        base = story(settings)
        print_row(first, base, base)
        print_row(f"{first}, starts 1e-9 apart", story(settings, NUDGE), base)
        for name, changed in others:
            print_row(name, story(changed), base)


def relief(scenes: list[str]) -> None:
    scene = thirdbody.Scene.load(scenes[0] if scenes else SHEARED)
    run = prepare(scene)
    run.integrator.advance_to(time=run.settle)
    run.integrator.advance_to(distance=1e-6)
    state, slots = run.state, run.state.slots
    rows = (slots.histories.slip > 0.0) & (slots.sides == LOWER)
    force, overlap = slots.R[rows, record.NORMAL_FORCE], slots.R[rows, record.OVERLAP]
    owner = state.body[slots.own[rows]]
    place = (slots.R[rows, record.POINT3] + state.bodies.position[owner])[:, :2]
    assert scene.plates.lower is not None
    plate = scene.materials[scene.plates.lower.material]
    c = (1.0 - plate.poisson_ratio) / (2.0 * np.pi * plate.shear())
    size = np.array(scene.domain.size)
    apart = place[:, None] - place[None]
    distance = np.linalg.norm(apart - size * np.rint(apart / size), axis=2)
    np.fill_diagonal(distance, np.inf)
    same, near = owner[:, None] == owner[None], distance < 0.5 * size.min()
    own = np.where(same, c / distance, 0.0) @ force
    others = np.where(near & ~same, c / distance, 0.0) @ force
    # what turns a body: the part that is not equal at its spots
    mean = np.bincount(owner, others) / np.maximum(np.bincount(owner), 1)
    unequal = (others - mean[owner])[np.bincount(owner)[owner] > 1]
    print(f"{len(force)} spots of {len(np.unique(owner))} bodies, mean overlap {overlap.mean():.3g} m; over that:")
    print(f"relief by the body's own spots, mean {own.mean() / overlap.mean():.2%}")
    print(f"relief by all others, mean {others.mean() / overlap.mean():.1%}, scatter {others.std() / overlap.mean():.2%}")
    print(f"its differences between the spots of a body, root mean square {np.sqrt((unequal**2).mean()) / overlap.mean():.2%}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", choices=["cost", "labels", "relief"])
    parser.add_argument("what", nargs="*")
    given = parser.parse_args()
    {"cost": cost, "labels": labels, "relief": relief}[given.table](given.what)
