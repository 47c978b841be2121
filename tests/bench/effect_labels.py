"""What effects change in the labels and the friction of 2000 particles over 20 um, implicit: the tables in `plugins/README.md`.

`PYTHONPATH=tests python tests/bench/effect_labels.py [GROUP ...]`, half a minute per row; groups: those of `GROUPS`, or all. The
particles are those of `scenes/yielding_debris.toml`. All rows of a group, also that of starts 1e-9 apart, are compared with its
first.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from stories import Story, dragged
from thirdbody_three_spot import PLUGIN

import thirdbody
from thirdbody.studies.nudge import NUDGE

SCENE = Path(__file__).parents[2] / "scenes" / "yielding_debris.toml"
Settings = Mapping[str, Any]
HEAVY = {"plates.upper.load": "1 mN"}


def necks(work: str, **more: str) -> Settings:
    """Settings of adhesion with necks."""
    return {"effects.adhesion": {"work_of_adhesion": work, "model": "jkr"} | more}


GROUPS: Mapping[str, Mapping[str, Settings]] = {
    "flow": {
        "none": {},
        **{f"yield strength {s}": {"effects.elastic_plastic": {}, "materials.steel.yield_strength": s}
           for s in ("1.5 GPa", "600 MPa", "300 MPa")},
    },
    "necks": {
        "none": {},
        "5 mJ/m2": necks("5 mJ/m2"),
        "50 mJ/m2": necks("50 mJ/m2"),
        "50 mJ/m2, external": necks("50 mJ/m2", friction_load="external"),
        "200 mJ/m2": necks("200 mJ/m2"),
        "1 J/m2": necks("1 J/m2"),
    },
    "spots": {"none": {}, "pivoting": {"effects.pivoting": {}}, "close spots": {"effects.close_spots": {}}},
    "heavy": {
        "none, 1 mN": HEAVY,
        "pivoting, 1 mN": HEAVY | {"effects.pivoting": {}},
        "close spots, 1 mN": HEAVY | {"effects.close_spots": {}},
        "50 mJ/m2, 1 mN": HEAVY | necks("50 mJ/m2"),
    },
}  # fmt: skip


def story(settings: Settings, nudge: float = 0.0) -> Story:
    """Return the story of the particles with these settings, without plastic flow where they do not name it."""
    implicit = {"effects.elastic_plastic": None, "solver.integrator": "implicit"}
    return dragged(thirdbody.Scene.load(SCENE).with_settings(implicit | dict(settings)), nudge)


def row(name: str, result: Story, base: Story) -> str:
    """Return labels that agree with those of the first row (mean, least of all stops), rolling at the end, mean friction."""
    labeller = PLUGIN.families[0].labeller
    assert labeller is not None
    agree = np.mean(result.labels == base.labels, axis=1)
    rolling = np.mean(result.labels[-1] == labeller.states.index("rolling"))
    return (
        f"{name:26s} labels {100 * agree.mean():.2f} % (least {100 * agree.min():.1f} %), rolling {100 * rolling:.1f} %, "
        f"friction {result.friction.mean():.4f} ({result.friction.mean() / base.friction.mean() - 1.0:+.1e})"
    )


def main() -> None:
    """Print the table of each group."""
    for group in sys.argv[1:] or GROUPS:
        (first, settings), *others = GROUPS[group].items()
        base = story(settings)
        print(f"{group}\n{row(first, base, base)}", flush=True)
        print(row(f"{first}, starts 1e-9 apart", story(settings, NUDGE), base), flush=True)
        for name, changed in others:
            print(row(name, story(changed), base), flush=True)


if __name__ == "__main__":
    main()
