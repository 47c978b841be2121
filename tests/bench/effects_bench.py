"""What effects change: the tables in `plugins/README.md`. What they cost tells `thirdbody cost SCENE --effects`.

    PYTHONPATH=tests python tests/bench/effects_bench.py [flow] [necks] [spots] [heavy]

Labels and friction of 2000 particles of `scenes/yielding_debris.toml` over 20 um, implicit, half a minute per row. All rows of a
group, also that of starts 1e-9 apart, are compared with its first."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from stories import Story, dragged
from thirdbody_three_spot import PLUGIN
import thirdbody
from thirdbody.studies.timing import NUDGE

SCENE = Path(__file__).parents[2] / "scenes" / "yielding_debris.toml"
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


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("groups", nargs="*", metavar="GROUP")
    labels(parser.parse_args().groups)
