"""The main scene by both integrators, at the speed at which both can run it: minutes, so not in CI.

`python tests/scenes/test_both_integrators.py` prints the table. The scene's particles are an ensemble here, since the implicit
integrator has no contact between debris. A third run is explicit again, from starts that differ by 1e-9: how far two runs can
agree at all where particles tip.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import thirdbody
from thirdbody.engine.state import refresh_spheres
from thirdbody.kernels.columns import body, run_totals
from thirdbody.runner.simulate import prepare

SCENE = Path(__file__).parents[2] / "scenes" / "sheared_debris.toml"
PATH, STOPS = 20e-6, 20
NUDGE = 1e-9
"""Of the particle's size, and of a radian."""

pytestmark = pytest.mark.slow


@dataclass
class Story:
    """What a run tells at equal distances: labels (F, n), friction, centres (F, n, 3); seconds of sliding."""

    labels: np.ndarray
    friction: np.ndarray
    centres: np.ndarray
    seconds: float


def story(integrator: str, nudge: float = 0.0) -> Story:
    """The ensemble slides by WAY."""
    scene = thirdbody.Scene.load(SCENE).with_settings({"contact.debris_contact": "none", "solver.integrator": integrator})
    built = prepare(scene)
    state = built.state
    if nudge:
        rng = np.random.default_rng(1)
        state.B[:, body.POSITION : body.POSITION + 2] += (
            nudge * state.rayleigh_radius[:, None] * rng.standard_normal((state.n_bodies, 2))
        )
        q = state.bodies.quaternion
        q += nudge * rng.standard_normal(q.shape)
        q /= np.linalg.norm(q, axis=1)[:, None]
        refresh_spheres(state)
    built.integrator.advance_to(time=built.settle)
    started, labels, friction, centres = time.perf_counter(), [], [], []
    for stop in np.arange(1, STOPS + 1) * PATH / STOPS:
        before = state.A.copy()
        built.integrator.advance_to(distance=float(stop))
        push = (state.A - before)[run_totals.UPPER_IMPULSE3]
        labels.append(built.integrator.label()[:, 0])
        friction.append(-push[0] / abs(push[2]))
        centres.append(state.bodies.position.copy())
    return Story(np.array(labels), np.array(friction), np.array(centres), time.perf_counter() - started)


@pytest.fixture(scope="module")
def stories() -> dict[str, Story]:
    return {"explicit": story("explicit"), "nudged": story("explicit", NUDGE), "implicit": story("implicit")}


def agreement(a: Story, b: Story) -> tuple[float, float, float]:
    """Share of equal labels at the end; difference of the mean friction over its value; of the mean place over the way."""
    labels = float(np.mean(a.labels[-1] == b.labels[-1]))
    friction = abs(b.friction.mean() / a.friction.mean() - 1.0)
    place = float(np.linalg.norm((b.centres[-1] - a.centres[-1]).mean(axis=0))) / PATH
    return labels, friction, place


def test_labels_friction_and_places_agree(stories):
    """99 % of the labels, 1 % of friction and of the mean place: what users of either should not have to think about."""
    labels, friction, place = agreement(stories["explicit"], stories["implicit"])
    assert labels >= 0.99
    assert friction < 0.01
    assert place < 0.01


def test_the_explicit_run_is_not_chaotic(stories):
    """Starts that differ by 1e-9 end alike: so the comparison means something."""
    labels, friction, place = agreement(stories["explicit"], stories["nudged"])
    assert labels >= 0.99
    assert friction < 1e-3
    assert place < 1e-3


def main() -> None:
    """Print the table."""
    report = {"explicit": story("explicit"), "nudged": story("explicit", NUDGE), "implicit": story("implicit")}
    for name in ("nudged", "implicit"):
        labels, friction, place = agreement(report["explicit"], report[name])
        line = f"{name}: labels {100 * labels:.2f} %, friction {100 * friction:.3f} %, mean place {100 * place:.3f} % of the way"
        print(f"{line}; {report['explicit'].seconds:.1f} s against {report[name].seconds:.1f} s")


if __name__ == "__main__":
    main()
