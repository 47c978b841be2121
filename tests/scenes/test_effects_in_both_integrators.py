"""Effects in both integrators over 20 um: plastic flow and adhesion with 500 particles of `yielding_debris`; close spots and
pivoting with 300 of the main scene. Two minutes, so not in CI.

`PYTHONPATH=tests python tests/scenes/test_effects_in_both_integrators.py` prints the table. A third run is explicit again, from
starts that differ by 1e-9: how far two runs can agree at all.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from stories import agreement, dragged, layer

import thirdbody
from thirdbody.studies.nudge import NUDGE

pytestmark = pytest.mark.full(kind="slow")

SCENE = Path(__file__).parents[2] / "scenes" / "yielding_debris.toml"

EFFECTS = {
    "flow": {"effects.elastic_plastic": {}},
    "necks": {"effects.elastic_plastic": None, "effects.adhesion": {"work_of_adhesion": "50 mJ/m2", "model": "jkr"}},
}


ELASTIC = {"spots": {"effects.close_spots": {}}, "pivots": {"effects.pivoting": {}}}
"""Effects that need no load at which steel yields."""


def story(effect: str, integrator: str, nudge: float = 0.0):
    """The story of particles with one effect."""
    if effect in ELASTIC:
        alone = {"solver.integrator": integrator, "contact.debris_contact": "none"}
        return dragged(layer(0.05, 300, **alone | ELASTIC[effect]), nudge)
    settings = {"debris.0.count": "500", "domain.size": ["500 um", "375 um"], "solver.integrator": integrator}
    return dragged(thirdbody.Scene.load(SCENE).with_settings(settings | EFFECTS[effect]), nudge)


@pytest.mark.parametrize("effect", [*EFFECTS, *ELASTIC])
def test_labels_agree(effect):
    """98 % of the labels; the mean friction within 0.5 %: a particle that tips elsewhere is 0.2 % of 500, 0.3 % of 300."""
    explicit = story(effect, "explicit")
    found = agreement(explicit, story(effect, "implicit"))
    assert found.labels >= 0.98 and found.all_labels >= 0.98
    assert found.friction < 5e-3
    assert agreement(explicit, story(effect, "explicit", NUDGE)).all_labels >= 0.99  # so the comparison means something


def main() -> None:
    """Print the table."""
    for effect in [*EFFECTS, *ELASTIC]:
        explicit = story(effect, "explicit")
        for name, other in (("nudged", story(effect, "explicit", NUDGE)), ("implicit", story(effect, "implicit"))):
            least = 100.0 * np.min(np.mean(explicit.labels == other.labels, axis=1))
            print(f"{effect}, {name}: {agreement(explicit, other)}; least at a stop {least:.1f} %")


if __name__ == "__main__":
    main()
