"""One physical number of a scene changed: the result moves the way that theory says, and by as much."""

from pathlib import Path

import numpy as np
import pytest

from thirdbody import Scene, run

SCENE = Path(__file__).parents[2] / "scenes" / "three_spot.toml"


@pytest.fixture(scope="module")
def dragged(tmp_path_factory):

    def drag(**settings: str):
        scene = Scene.load(SCENE).with_settings(
            {"solver.distance": "20 nm", "solver.tolerance": "1e-5", **{key.replace("__", "."): x for key, x in settings.items()}}
        )
        with run(scene, tmp_path_factory.mktemp("run") / "out", threads=1, progress=False) as result:
            return dict(result.series)

    return drag


def test_friction_is_what_a_sliding_particle_resists_with(dragged):
    found = [dragged(pairs__0__friction=mu, pairs__1__friction=mu)["friction_coefficient"][-1] for mu in ("0.15", "0.30")]
    # it slides on all its spots by then; the upper one sets the coefficient exactly
    assert found == pytest.approx([0.15, 0.30], rel=1e-6)


def test_eight_times_the_load_presses_four_times_as_deep(dragged):
    light, more, most = (dragged(plates__upper__load=load)["gap"][1] for load in ("0.0125 mN", "0.1 mN", "0.8 mN"))
    # Hertz: overlaps go as load^(2/3), so do their differences; the spots turn the particle by 1e-2 of them as they give way
    assert (more - most) / (light - more) == pytest.approx(4.0, rel=2e-2)


@pytest.mark.full(
    kind="slow"
)  # compiles three laws with their tangents; tests/theory/test_curved_slip.py has the order of the law itself
def test_more_springs_come_nearer_to_the_exact_field(dragged):
    exact = dragged(contact__level="exact")["friction_coefficient"]
    wrong = []
    for springs in ("4", "16"):
        found = dragged(contact__level="mdr", contact__springs=springs)["friction_coefficient"]
        wrong.append(float(np.sqrt(np.nanmean((found - exact) ** 2))))
    # second order: a sixteenth for four times the springs; with 64 the steps, not the springs, would set the error
    assert wrong[1] < wrong[0] / 16.0
