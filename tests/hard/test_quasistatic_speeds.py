"""Twenty runs without inertia from 1 mm/s to 10 m/s: as with inertia within 1 %, refused, warned of, or reported."""

import math

import numpy as np
import pytest
from steel import SCENES
import thirdbody
from thirdbody.errors import GuardStop, InputError
from thirdbody.runner.simulate import prepare

pytestmark = pytest.mark.full(kind="hard")
SAME = 0.01  # difference of the friction that needs no word: that of two states in which 1 % of the load is carried otherwise
IMPLICIT = {"solver.integrator": "implicit", "contact.debris_contact": "none"}
STROKE = 10e-6


def steady(scene, speed, **settings):
    drag = {"plates.upper.motion.x.velocity": f"{speed} m/s"}
    return thirdbody.Scene.load(SCENES / scene).with_settings(IMPLICIT | drag | settings)


def strokes(scene, speed, **settings):
    frequency = speed / (math.pi * STROKE)
    drag = {
        "plates.upper.motion.x.stroke": f"{STROKE} m", "plates.upper.motion.x.frequency": f"{frequency} Hz",
        "solver.duration": f"{2.0 / frequency} s", "output.every": "1 um", "debris.0.count": "12",
    }  # fmt: skip
    return thirdbody.Scene.load(SCENES / scene).with_settings(IMPLICIT | drag | settings)


CASES = {  # irregular particles, some of which roll; flakes, all of which slide
    "rolling": (steady, "sheared_debris.toml", {"debris.0.count": "24", "solver.distance": "4 um", "output.every": "0.5 um"}),
    "flakes": (steady, "sliding_flakes.toml", {"debris.0.count": "12", "solver.distance": "2 um", "output.every": "0.2 um"}),
    "three spots": (steady, "three_spot.toml", {}), "strokes": (strokes, "fretting_rig.toml", {}),
}  # fmt: skip


def friction(run):
    """Work of friction of the second half per way, N: the coefficient times the load, and for strokes the loop."""
    distance, force, along = run.series["distance"], run.series["upper_force"], run.series["displacement"]
    later = np.flatnonzero(distance >= 0.5 * distance[-1])
    work = -np.sum(force[later[1:], 0] * np.diff(along[later]))
    return work / (distance[later[-1]] - distance[later[0]])


@pytest.mark.parametrize("speed", (1e-3, 1e-2, 0.1, 1.0, 10.0))
@pytest.mark.parametrize("case", CASES)
def test_no_speed_is_wrong_in_silence(case, speed, tmp_path):
    make, scene, short = CASES[case]
    try:
        quiet = make(scene, speed, **short, **{"solver.inertia": "false"})
        if any("inertial number" in text for text in prepare(quiet).warnings):
            print(f"{case} {speed:g} m/s: warned of before it starts")  # such a run may take a long time, too
            return
        without = thirdbody.run(quiet, out=tmp_path / "without", threads=1, progress=False)
    except InputError as refused:
        assert "inertial number" in str(refused)
        return
    except GuardStop as stopped:
        assert "stopped at t" in str(stopped)
        return
    with without, thirdbody.run(make(scene, speed, **short), out=tmp_path / "with", threads=1, progress=False) as full:
        off = friction(without) / friction(full) - 1.0
        report = without.summary()
        said, share = bool(report["warnings"] != without.header["warnings"]), report["energy_numerical_share"]
        print(f"{case} {speed:g} m/s: {100.0 * off:+.2f} %, {'reported' if said else 'silent'}, lost {100.0 * share:.1f} %")
        assert abs(off) < SAME or said
        # nothing is made, said or not
        assert share > -SAME
