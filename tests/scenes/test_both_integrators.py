"""The same layers by both integrators, at a speed at which both can run them: minutes, so not in CI.

The main scene as an ensemble; layers of it whose debris meets, at several area fractions; effects over 20 um: plastic flow and
adhesion with 500 particles of `yielding_debris`, close spots and pivoting with 300 of the main scene. A third run is explicit
again, from starts that differ by 1e-9: how far two runs can agree at all where particles tip or meet.
`PYTHONPATH=tests python tests/scenes/test_both_integrators.py [NAME ...]` prints the table."""

import functools
import sys
from pathlib import Path

import numpy as np
import pytest
from stories import SCENE, agreement, dragged, layer
import thirdbody
from thirdbody.studies.timing import NUDGE

pytestmark = pytest.mark.full(kind="slow")
YIELDING = Path(__file__).parents[2] / "scenes" / "yielding_debris.toml"
ALONE = {"contact.debris_contact": "none"}
SOME = {"debris.0.count": "500", "domain.size": ["500 um", "375 um"]}
NECKS = {"effects.elastic_plastic": None, "effects.adhesion": {"work_of_adhesion": "50 mJ/m2", "model": "jkr"}}
SCENES = {
    # settings -> scene; least labels, differences of friction and of the mean place over the drag; the same of the nudged run.
    # A particle that tips elsewhere is 0.2 % of 500, 0.3 % of 300. Labels that differ in layers are on the turn from rolling to
    # sliding or back, half of them of bodies that never meet another
    "ensemble": (lambda **keys: thirdbody.Scene.load(SCENE).with_settings(ALONE | keys), (0.99, 0.01, 0.01), (0.99, 1e-3, 1e-3)),
    "fraction 0.15": (lambda **keys: layer(0.15, 300, **keys), (0.98, 0.005, 0.01), (0.98, 0.005, 0.01)),
    "fraction 0.3": (lambda **keys: layer(0.3, 300, **keys), (0.98, 0.005, 0.01), (0.98, 0.005, 0.01)),
    "fraction 0.45": (lambda **keys: layer(0.45, 300, **keys), (0.98, 0.005, 0.01), (0.98, 0.005, 0.01)),
    "flow": (lambda **keys: thirdbody.Scene.load(YIELDING).with_settings(SOME | {"effects.elastic_plastic": {}} | keys),
             (0.98, 0.005, 0.01), (0.99, 0.005, 0.01)),
    "necks": (lambda **keys: thirdbody.Scene.load(YIELDING).with_settings(SOME | NECKS | keys),
              (0.98, 0.005, 0.01), (0.99, 0.005, 0.01)),
    "spots": (lambda **keys: layer(0.05, 300, **(ALONE | {"effects.close_spots": {}} | keys)),
              (0.98, 0.005, 0.01), (0.99, 0.005, 0.01)),
    "pivots": (lambda **keys: layer(0.05, 300, **(ALONE | {"effects.pivoting": {}} | keys)),
               (0.98, 0.005, 0.01), (0.99, 0.005, 0.01)),
}  # fmt: skip


@functools.cache
def story(name, integrator, nudge=0.0):
    return dragged(SCENES[name][0](**{"solver.integrator": integrator}), nudge)


def check(name, found, bounds):
    assert found.labels >= bounds[0]
    assert found.friction <= bounds[1]
    if name in ("flow", "necks", "spots", "pivots"):
        assert found.all_labels >= bounds[0]
    else:
        assert found.place <= bounds[2]


@pytest.mark.parametrize("name", SCENES)
def test_labels_friction_and_places_agree(name):
    check(name, agreement(story(name, "explicit"), story(name, "implicit")), SCENES[name][1])


@pytest.mark.parametrize("name", SCENES)
def test_the_explicit_run_is_not_chaotic(name):
    """Starts that differ by 1e-9 end alike, although bodies meet: so a comparison with another integrator means something."""
    if name.startswith("fraction"):
        assert story(name, "explicit").met.mean() > 0.02
    check(name, agreement(story(name, "explicit"), story(name, "explicit", NUDGE)), SCENES[name][2])


if __name__ == "__main__":
    for name in sys.argv[1:] or SCENES:
        base = story(name, "explicit")
        met = f"{base.met.mean():.2f} have met another"
        print(f"{name}: explicit {base.seconds:.1f} s, friction {base.friction.mean():.4f}, {met}")
        for words, other in (("1e-9 apart", story(name, "explicit", NUDGE)), ("implicit", story(name, "implicit"))):
            least = 100.0 * np.min(np.mean(base.labels == other.labels, axis=1))
            print(f"    {words}: {agreement(base, other)}; least at a stop {least:.1f} %; {other.seconds:.1f} s", flush=True)
