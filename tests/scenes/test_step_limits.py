"""What limits the steps of the implicit integrator is counted, told, and is not rounding."""

from __future__ import annotations

import pytest
from steel import STEEL

import thirdbody
from thirdbody.kernels.implicit.step_limits import CAUSES, WORDS

# two balls that roll between two plates
SCENE = (
    STEEL
    + """\
[[debris]]
material = "steel"
kind = "spheres"
radius = "5 um"
count = 2
[domain]
size = ["80 um", "60 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
motion = {x = {velocity = "1 mm/s"}}
[contact]
law = "three_spot"
level = "mindlin"
debris_contact = "none"
[solver]
integrator = "implicit"
distance = "0.5 um"
settle = "1 us"
[output]
every = "0.1 um"
"""
)


def summary_of(tmp_path, changes, report=False):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    scene = thirdbody.Scene.load(path).with_settings(changes)
    with thirdbody.run(scene, out=tmp_path / "run", threads=1, progress=report) as run:
        return run.summary()


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"output.every": "0.5 nm"}, "output"),
        ({"solver.largest_step": "5 nm"}, "largest_step"),
        ({"solver.tolerance": "1e-7"}, "error"),
        ({"plates.upper.support": "rigid"}, None),
    ],
)
def test_every_step_is_counted_under_what_limits_it(changes, cause, tmp_path):
    said = []
    report = summary_of(tmp_path, changes, lambda progress: said.append(progress.limit))
    counts = report["steps_limited_by"]
    together = 2 if "plates.upper.support" in changes else 1  # both bodies take the same steps, counted once
    assert sum(counts.values()) == report["steps"] / together
    assert set(counts) <= set(CAUSES) and list(counts.values()) == sorted(counts.values(), reverse=True)
    if cause is not None:
        assert next(iter(counts)) == cause and counts[cause] > 0.5 * report["steps"]
        assert any(WORDS[CAUSES.index(cause)] in words for words in said)


def test_steps_limited_by_strokes(tmp_path):
    stroke = {"stroke": "0.2 nm", "frequency": "5 kHz", "shape": "triangle"}  # spots stick all the way: nothing to resolve
    changes = {"plates.upper.motion.x": stroke, "solver.distance": "10 nm", "output.every": "5 nm"}
    assert next(iter(summary_of(tmp_path, changes)["steps_limited_by"])) == "reversal"


def test_rounding_of_heights_costs_no_iterations(tmp_path):
    """Under 1e-12 N the ball sinks in by 2e-14 m, 4e-9 of its height: rounding of heights alone changes the force by 5e-8 of it,
    and Newton's method, which asked for 1e-9, went on to its last iteration in every step of a ball at rest."""
    changes = {"plates.upper.load": "1e-12 N", "solver.settle": "0.2 s", "solver.duration": "1 us", "output.every": "10 ms"}
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.replace('distance = "0.5 um"', 'duration = "1 us"'))
    scene = thirdbody.Scene.load(path).with_settings(changes)
    with thirdbody.run(scene, out=tmp_path / "run", threads=1, progress=False) as run:
        assert run.summary()["iterations_per_step"] < 6.0  # 2 to 5 of a good step
