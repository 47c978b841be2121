"""Layers of the main scene whose debris meets, by both integrators, at several area fractions: minutes, so not in CI.

`PYTHONPATH=tests python tests/scenes/test_layers_that_meet.py` prints the table; `--bodies`, `--fractions` and `--integrators`
choose. Where bodies meet, runs that start 1e-9 apart part: two such explicit runs set how many labels can agree.
"""

from __future__ import annotations

import argparse
import functools

import pytest
from stories import Agreement, Story, agreement, dragged, layer

from thirdbody.studies.nudge import NUDGE

FRACTIONS = (0.15, 0.3, 0.45)
"""Of the lower plate, covered seen from above."""

BODIES = 300
"""Of a layer in the tests: one label is a third of a per cent."""

LABELS, FRICTION, PLACE = 0.98, 0.005, 0.01
"""Labels that agree at least; differences of friction and of the mean place at most."""

pytestmark = pytest.mark.full(kind="slow")


@functools.cache
def story(integrator: str, fraction: float, bodies: int = BODIES, nudge: float = 0.0) -> Story:
    """The story of a layer; each once."""
    return dragged(layer(fraction, bodies, **{"solver.integrator": integrator}), nudge)


def spread(fraction: float, bodies: int = BODIES) -> Agreement:
    """How far two explicit runs agree whose starts differ by `NUDGE`."""
    return agreement(story("explicit", fraction, bodies), story("explicit", fraction, bodies, NUDGE))


@pytest.mark.parametrize("fraction", FRACTIONS)
def test_the_explicit_run_is_not_chaotic(fraction):
    """Starts that differ by 1e-9 end alike, although bodies meet: so a comparison with another integrator means something."""
    found = spread(fraction)
    assert story("explicit", fraction).met.mean() > 0.02
    assert found.labels >= LABELS
    assert found.friction <= FRICTION
    assert found.place <= PLACE


@pytest.mark.parametrize("fraction", FRACTIONS)
def test_labels_friction_and_places_agree(fraction):
    """Labels that differ are on the turn from rolling to sliding or back, half of them of bodies that never meet another."""
    found, bound = agreement(story("explicit", fraction), story("implicit", fraction)), spread(fraction)
    assert found.labels >= min(LABELS, bound.labels)
    assert found.friction <= FRICTION
    assert found.place <= PLACE


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", type=int, default=BODIES)
    parser.add_argument("--fractions", type=float, nargs="+", default=FRACTIONS)
    parser.add_argument("--integrators", nargs="+", default=["implicit"])
    chosen = parser.parse_args()
    for fraction in chosen.fractions:
        base = story("explicit", fraction, chosen.bodies)
        first = f"explicit {base.seconds:.1f} s, friction {base.friction.mean():.4f}"
        print(f"{fraction}: {first}, {100.0 * base.met.mean():.0f} % have met another", flush=True)
        print(f"    explicit, {NUDGE:g} apart: {spread(fraction, chosen.bodies)}", flush=True)
        for integrator in chosen.integrators:
            other = story(integrator, fraction, chosen.bodies)
            print(f"    {integrator}: {agreement(base, other)}; {other.seconds:.1f} s", flush=True)


if __name__ == "__main__":
    main()
