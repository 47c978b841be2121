"""The reference of keys and names is complete, its examples can be read, and `thirdbody keys` finds them."""

from __future__ import annotations

import json
import re

import pytest
from pydantic import TypeAdapter
from steel import STEEL
from thirdbody_three_spot.classify import REASONS

from thirdbody import errors
from thirdbody.engine.accuracy import Accuracy
from thirdbody.laws.registry import discover
from thirdbody.report.key_reference import all_keys, all_names
from thirdbody.runner.simulate import run
from thirdbody.scene.json_schema import key_docs
from thirdbody.scene.model import Scene
from thirdbody.scene.schema_base import Part
from thirdbody.studies.sweep.axes import IntervalTable

TABLES = {
    "materials",
    "pairs",
    "debris",
    "domain",
    "plates",
    "contact",
    "effects",
    "measures",
    "solver",
    "output",
    "lower",
    "upper",
    "motion",
}
"""Keys that hold nothing but tables, whose own keys are listed."""
PYTHON_ONLY = {"every_kind", "options", "named"}

ROLLERS = (
    STEEL
    + """\
[[debris]]
material = "steel"
kind = "spheres"
radius = "5 um"
count = 3
[domain]
size = ["50 um", "40 um"]
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "foundation"
stiffness = "200 N/m"
load = "1 mN"
motion = {x = {stroke = "50 nm", frequency = "2 MHz"}}
[effects]
gravity = ["0 m/s2", "0 m/s2", "-9.81 m/s2"]
rolling_resistance = {coefficient = 0.05}
[solver]
settle = "0.2 us"
duration = "0.6 us"
[output]
every = "0.05 us"
"""
)


SCALED = {"scene_time"}
"""Series of runs at a scaled speed only."""

DIRECT = {"direct_force", "load_share_debris", "energy_direct_elastic", "energy_direct_friction"}
"""Series of plates with direct contact only."""

CALLED_FOR = {
    "series": {"energy_plastic", "energy_adhesion"} | {f"count_{reason}" for reason in REASONS},
    "bodies": {"plastic_work", "adhesion_work", "agglomerate", "scene_id"},
    "contacts": {"twist_moment", "twist_utilisation"},
}  # fmt: skip
"""Names of effects, and of a sample of the bodies, that this scene does not call for."""


@pytest.fixture(scope="module")
def registry():
    return discover()


def parts(base: type[Part] = Part) -> set[type[Part]]:
    """All tables of keys but one: the keys of an interval stand in the meaning of `vary`."""
    kinds = [kind for kind in base.__subclasses__() if kind.__module__.startswith("thirdbody.") and kind is not IntervalTable]
    return {part for kind in kinds for part in {kind, *parts(kind)}}


@pytest.mark.parametrize("part", sorted(parts(), key=lambda part: f"{part.__module__}.{part.__name__}"), ids=str)
def test_every_key_has_a_meaning_and_an_example_that_can_be_read(part):
    docs = key_docs(part)
    for name, field in part.model_fields.items():
        if name in TABLES | PYTHON_ONLY and name not in docs:
            continue
        meaning, _, example = docs[name].partition(" Example: ")
        assert meaning[-1] in ".;" and example, f"{part.__name__}.{name}"
        if name == "kind":
            continue  # of another kind
        schema = part.model_json_schema()["properties"][name]
        value = schema["examples"][0]
        if name != "every" and "const" not in json.dumps(schema):  # a time or a length: read by the table
            TypeAdapter(field.rebuild_annotation()).validate_python(value, context={"file": True})


def test_options_have_a_meaning_and_an_example(registry):
    options = [key for key in all_keys(registry) if key.path.startswith(("contact.", "effects."))]
    assert {"contact.springs", "contact.nodes", "effects.local_damping.until", "effects.gravity"} <= {key.path for key in options}
    assert not [key.path for key in options if not (key.meaning and key.example and key.value)]


def test_a_key_of_several_tables_is_listed_once(registry):
    keys = {(key.path, key.tables): key for key in all_keys(registry)}
    assert keys["debris.material", ()].default == "required"
    assert '"mesh"' in keys["debris.kind", ()].value
    assert keys["debris.placement", ("irregular", "mesh", "spheroid")].default == '"layer"'
    assert keys["debris.size.median", ("lognormal",)].unit == "m"
    assert keys["contact.memory", ("coulomb", "mindlin")].value == '"two_number" or "rescaled"'
    assert len(keys) == len(all_keys(registry))


def test_defaults_that_meanings_state():
    report = next(key for key in all_keys(discover()) if key.path == "solver.tolerance").meaning
    assert float(re.search(r"[\d.e-]+(?= where it is not given)", report)[0]) == Accuracy().tolerance


def test_names_are_those_of_a_run(registry, tmp_path):
    names = {table: {name: entry for name, entry in entries.items() if name not in CALLED_FOR.get(table, ())}
             for table, entries in all_names(registry).items()}  # fmt: skip
    with run(Scene.parse(ROLLERS), tmp_path / "run", progress=False) as result:
        assert names["series"].keys() == result.series.keys() | SCALED | DIRECT
        units = {name: entry.unit for name, entry in names["series"].items() if name not in SCALED | DIRECT}
        assert units == {name: result.units[name] for name in result.series}
        assert names["bodies"].keys() == result.bodies(-1).keys()
        assert names["spheres"].keys() == result.spheres(-1).keys()
        assert names["contacts"].keys() == result.contacts(-1).keys()
        assert names["cycles"].keys() == result.cycles.keys() and len(result.cycles["energy"]) == 1
        assert names["transitions"].keys() == result.transitions().keys()
    assert not [name for entries in names.values() for name, entry in entries.items() if not entry.meaning or not entry.unit]


def test_every_exit_code_is_explained():
    kinds = [errors.ThirdbodyError, *errors.ThirdbodyError.__subclasses__()]
    assert {kind.exit_code for kind in kinds} <= errors.EXIT_CODES.keys()


@pytest.mark.parametrize("word", ["frequency", "debris[0].size", "debris.0.size.median", "SPRINGS", "virgin", "upper_force"])
def test_a_word_finds_names_else_meanings(word, command):
    report = command("keys", word, "--json")
    assert report.code == 0, report.err
    found = json.loads(report.out)
    names = [key["path"] for key in found["scene"]] + [name for entries in found["run"].values() for name in entries]
    assert names and len(names) < 20
    if word == "virgin":
        assert names == ["critical_slip"]
    else:
        assert any(re.sub(r"\[\d\]|\.\d", "", word).lower() in name for name in names)


def test_a_table_shows_unit_default_and_example(command):
    report = command("keys", "shape")
    assert "debris.shape.radius" in report.out and '"triangle"' in report.out and "required" in report.out
    assert "run.series[name]" in command("keys", "gap").out


def test_a_word_that_finds_nothing_names_the_nearest(command):
    report = command("keys", "freqency")
    assert report.code == 2 and report.err == "thirdbody: keys freqency: nothing has this name, did you mean 'frequency'?\n"
