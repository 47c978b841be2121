"""The main scene by both integrators, at the speed at which both can run it: minutes, so not in CI.

`PYTHONPATH=tests python tests/scenes/test_both_integrators.py` prints the table. The particles are an ensemble here, since the
implicit integrator has no contact between debris. A third run is explicit again, from starts that differ by 1e-9: how far two
runs can agree at all where particles tip.
"""

from __future__ import annotations

import pytest
from stories import SCENE, Story, agreement, dragged

import thirdbody
from thirdbody.studies.nudge import NUDGE

pytestmark = pytest.mark.full(kind="slow")


def story(integrator: str, nudge: float = 0.0) -> Story:
    """The story of the ensemble."""
    settings = {"contact.debris_contact": "none", "solver.integrator": integrator}
    return dragged(thirdbody.Scene.load(SCENE).with_settings(settings), nudge)


@pytest.fixture(scope="module")
def stories() -> dict[str, Story]:
    return {"explicit": story("explicit"), "nudged": story("explicit", NUDGE), "implicit": story("implicit")}


def test_labels_friction_and_places_agree(stories):
    """99 % of the labels, 1 % of friction and of the mean place: what users of either should not have to think about."""
    found = agreement(stories["explicit"], stories["implicit"])
    assert found.labels >= 0.99
    assert found.friction < 0.01
    assert found.place < 0.01


def test_the_explicit_run_is_not_chaotic(stories):
    """Starts that differ by 1e-9 end alike: so the comparison means something."""
    found = agreement(stories["explicit"], stories["nudged"])
    assert found.labels >= 0.99
    assert found.friction < 1e-3
    assert found.place < 1e-3


def main() -> None:
    """Print the table."""
    report = {"explicit": story("explicit"), "nudged": story("explicit", NUDGE), "implicit": story("implicit")}
    for name in ("nudged", "implicit"):
        found = agreement(report["explicit"], report[name])
        print(f"{name}: {found}; {report['explicit'].seconds:.1f} s against {report[name].seconds:.1f} s")


if __name__ == "__main__":
    main()
