"""The scene file: what is read and from where, scenes built in Python, settings, and that saving loses nothing."""

import copy
import tomllib
from itertools import permutations
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from each import each
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from thirdbody.errors import InputError, OutputError
from thirdbody.scene import model
from thirdbody.scene.model import Contact, Irregular, Lognormal, Material, Output, Scene
from thirdbody.schema.read import locate

GOOD = (Path(__file__).parent / "good_scene.toml").read_text(encoding="utf-8")


def test_the_good_scene_is_read_saved_and_loaded(tmp_path):
    scene = Scene.parse(GOOD)
    (debris,) = scene.debris
    assert isinstance(debris, Irregular)
    assert debris.size == Lognormal(median=10e-6, sigma=0.2, min=5e-6, max=20e-6)
    assert (debris.count, debris.spheres, debris.velocity) == (2000, (4, 8), (0.0, 0.0, 0.0))
    assert scene.domain == model.Domain(size=(600e-6, 400e-6))
    assert scene.plates.upper is not None
    assert scene.plates.upper.load == 0.1e-3
    assert scene.plates.upper.motion.x == (model.ConstantVelocity(velocity=1.0),)
    assert scene.contact.options == {"springs": 32}
    assert scene.effects.gravity == (0.0, 0.0, -9.81)
    assert (scene.solver.distance, scene.solver.settle) == (20e-6, "auto")
    assert (scene.output.every, scene.output.every_kind) == (0.5e-6, "distance")
    assert scene.pair("steel", "steel").friction == 0.3
    # either modulus gives both and the level belongs to the default law
    by_young = Material(youngs_modulus=210e9, poisson_ratio=0.25, density=7850)
    by_shear = Material(shear_modulus="84 GPa", poisson_ratio=0.25, density=7850)  # 210 / (2 * 1.25)
    assert by_young.shear() == by_shear.shear() == 84e9
    assert by_young.young() == by_shear.young() == 210e9
    assert Contact().level == "mindlin" and Contact(law="other").level is None
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())  # as some editors write
    scene = Scene.load(path)
    scene.save(tmp_path / "b.toml")
    assert Scene.load(tmp_path / "b.toml") == scene == Scene.parse(GOOD)
    with pytest.raises(OutputError, match="cannot be written"):
        scene.save(tmp_path / "nowhere" / "c.toml")
    # values that TOML cannot hold
    odd = scene.model_copy(update={"contact": Contact(springs=object)})
    with pytest.raises(InputError, match="contact.springs: .* cannot be written to a scene file"):
        odd.to_toml()


STEEL = Material(youngs_modulus=210e9, poisson_ratio=0.3, density=7850)


def test_a_scene_built_in_python_is_the_one_of_the_file_and_its_faults_are_input_errors():
    size = {"distribution": "lognormal", "median": 1e-5, "sigma": 0.2, "min": "5 um", "max": 20e-6}
    upper = {"material": "steel", "support": "load_per_particle", "load": 1e-4, "motion": {"x": {"velocity": 1}}}
    scene = Scene(
        title="what it shows", materials={"steel": STEEL}, domain=model.Domain(size=("600 um", 400e-6)),
        pairs=[model.PairTable(between=("steel", "steel"), friction=0.3, restitution=0.6)],
        debris=[Irregular(material="steel", count=2000, size=size, spheres=(4, 8), aspect=np.array([1.0, 0.8, 0.6]))],
        plates=model.Plates(lower=model.LowerPlate(material="steel"), upper=upper), contact=Contact(level="mdr", springs=32),
        effects=model.Effects(gravity=(0, 0, -9.81)), solver=model.Solver(distance=20e-6),
        output=Output(every=0.5e-6, every_kind="distance"),
    )  # fmt: skip
    assert scene == Scene.parse(GOOD)
    with pytest.raises(InputError) as caught:
        model.UpperPlate(material="steel", load="1 mN", gap=-1.0, colour="red")
    report = [str(fault) for fault in caught.value.faults]
    assert report == [
        "colour: unknown key, known: closing, damping, gap, load, loading, mass, material, motion, preload, pressure, stiffness, "
        "support, surface",
        "gap: give only one of load, pressure, gap: load is given too",
    ]
    with pytest.raises(InputError, match="every: .* no unit.* or give every_kind"):
        Output(every=1e-6)
    with pytest.raises(InputError, match="every: '1 s' is not a distance"):
        Output(every="1 s", every_kind="distance")
    with pytest.raises(InputError, match=r"materials\.a\.density: -1 must be greater than 0"):
        Scene(materials={"a": {"density": -1}})


def test_settings_replace_values_and_their_alternatives():
    scene = Scene.parse(GOOD, "x.toml").with_settings({"solver.duration": "1 us", "debris.0.count": "20",
        "debris[0].size": "12 um", "plates.upper.support": "rigid", "plates.upper.gap": "3 um", "domain.size.1": "1 mm",
        "contact.springs": "64"})  # fmt: skip
    assert (scene.solver.duration, scene.solver.distance) == (1e-6, None)
    assert scene.debris[0].count == 20
    assert isinstance(scene.debris[0], Irregular) and scene.debris[0].size == model.Constant(value=12e-6)
    assert scene.plates.upper is not None
    assert (scene.plates.upper.gap, scene.plates.upper.load) == (3e-6, None)
    assert scene.domain.size == (600e-6, 1e-3)
    assert scene.contact.options == {"springs": 64}
    assert str(scene.fault(("contact", "springs"), "too many")) == "with_settings: contact.springs: too many"
    # a key takes the place of those that exclude it
    for table, *rivals in (
        ("plates.upper", ("load", "1 mN"), ("pressure", "1 kPa"), ("gap", "9 um")),
        ("solver", ("distance", "1 um"), ("duration", "1 s")),
        ("materials.steel", ("youngs_modulus", "200 GPa"), ("shear_modulus", "80 GPa")),
        ("debris.0", ("height", "99 um"), ("solid_fraction", 0.1)),
    ):
        for (one, value), (other, instead) in permutations(rivals, 2):
            given = {"plates.upper.support": "rigid", "debris.0.placement": "dilute", f"{table}.{one}": value}
            now = Scene.parse(GOOD).with_settings(given).with_settings({f"{table}.{other}": instead}).document()
            for part in table.split("."):
                now = now[int(part) if part == "0" else part]
            assert other in now and one not in now
    assert str(scene.fault(("contact", "law"), "odd")) == "x.toml:30:1: contact.law: odd"


FAULTS_OF_SETTINGS = [
    ({"solvr.distance": "1 um"}, "solvr: unknown key, did you mean 'solver'?"),
    ({"distance": "1 um"}, "distance: unknown key, did you mean 'solver.distance'?"),
    ({"solver.distnce": "1 um"}, "solver.distnce: unknown key, did you mean 'distance'?"),
    ({"solver.distance": "1 MPa"}, "solver.distance: '1 MPa' is a pressure, expected a length"),
    ({"solver.distance": "1"}, "solver.distance: 1 has no unit, expected a unit of length (pm, nm, um, mm, m, angstrom)"),
    ({"debris.0.count": "0"}, "debris[0].count: 0 must be at least 1"),
    ({"debris.3.count": "2"}, "debris.3.count: debris has no entry '3': its entries are 0 to 0"),
    ({"solver.distance": "1 um", "solver.duration": "1 s"},
     "solver.duration: give only one of distance, duration: distance is given too"),
    ({"": "1"}, "expected a path such as solver.distance"),
]  # fmt: skip


@each(FAULTS_OF_SETTINGS, name_of=lambda row: row[1])
def test_faults_of_settings(row):
    with pytest.raises(InputError) as caught:
        Scene.parse(GOOD).with_settings(row[0])
    (fault,) = caught.value.faults
    assert str(fault) == "with_settings: " + row[1]
    assert caught.value.for_command_line() == "--set: " + row[1]


positive = st.floats(1e-30, 1e30)  # what any quantity may be: `units.refuse_absurd`
finite = st.one_of(st.just(0.0), positive, positive.map(lambda x: -x))
fraction = st.floats(min_value=0, max_value=1, exclude_min=True)
name = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
three = st.tuples(finite, finite, finite)
toml_value = st.recursive(st.booleans() | st.integers() | finite | name, max_leaves=6,
    extend=lambda inner: st.lists(inner, max_size=3) | st.dictionaries(name, inner, max_size=3))  # fmt: skip
free_key = name.filter(lambda key: key not in {"law", "level", "debris_contact", "gravity", "options", "named"})
sizes = st.one_of(st.builds(model.Constant, value=positive), st.builds(Lognormal, median=positive, sigma=positive),
    st.builds(Lognormal, median=st.floats(1e-9, 1e-8), sigma=positive, min=st.just(1e-9), max=st.floats(1e-8, 1)))  # fmt: skip
irregular = st.builds(
    lambda low, more, **rest: Irregular(spheres=(low, low + more), **rest), low=st.integers(1, 32), more=st.integers(0, 32),
    material=st.just("m"), count=st.integers(1, 30_000), seed=st.integers(0, 2**128 - 1), size=sizes,
    aspect=st.tuples(fraction, fraction, fraction), velocity=three, angular_velocity=three,
)  # fmt: skip
spheres = st.builds(
    lambda **fields: model.Spheres(material="m", **fields), radius=positive, positions=st.lists(three, min_size=1, max_size=3),
    velocity=three, orientation=st.none() | st.tuples(finite, finite, finite, finite).filter(any),
)  # fmt: skip
uppers = st.builds(
    lambda support, key, value,
    **rest: model.UpperPlate(material="m", **{"support": support, ("load" if support != "rigid" else key): value}, **rest),
    support=st.sampled_from(["rigid", "load_per_particle"]), key=st.sampled_from(["load", "pressure", "gap"]), value=positive,
    motion=st.builds(lambda v: {"y": {"velocity": v}}, finite.filter(bool)), mass=st.none() | positive,
)  # fmt: skip
scenes = st.builds(
    lambda key, title, debris, upper, young, contact, effects, every: Scene(
        title=title, materials={"m": Material(**{key: young}, poisson_ratio=0.5, density=1.0), title: STEEL},
        pairs=[{"between": ["m", "m"], "friction": 0, "restitution": 1}], debris=debris,
        domain={"size": [young, 1.0], "periodic": False}, plates={"lower": {"material": "m"}, "upper": upper},
        contact=Contact(options=contact), effects=model.Effects(named=effects),
        solver={"distance": max(young, every), "settle": 0}, output={"every": every, "every_kind": "distance"},
    ),
    key=st.sampled_from(["youngs_modulus", "shear_modulus"]), title=name.filter(lambda text: text != "m"),
    debris=st.lists(irregular | spheres, min_size=1, max_size=3), upper=uppers, young=positive,
    contact=st.dictionaries(free_key, toml_value, max_size=3),
    effects=st.dictionaries(free_key, toml_value, max_size=2), every=positive,
)  # fmt: skip


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(scenes)
def test_saving_loses_nothing(scene):
    text = scene.to_toml()
    again = Scene.parse(text)
    assert again == scene
    assert again.to_toml() == text
    # every key that tomllib sees is located, so that any fault has its place
    assert places_of(tomllib.loads(text)) <= set(locate(text))


def places_of(node, place=()):
    inner = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    found = {place} if place else set()
    for key, value in inner:
        found |= places_of(value, (*place, key))
    return found


def test_positions_inside_every_form_of_toml():
    text = """\
# [comment]
top = 'lit # no comment'
"quoted key" = 1
a . b = {k1 = [1, {k2 = "}", k3 = 2}], "k\\u0034" = 3} # {k9 = 1}
multi = [
  "x]", # ]
  [ 'y', "z\\"" ],
]
long = \"\"\"
fake = 1
"" \\\"\"\" \"\"\"\"
raw = '''
[fake]
'''''
[t.u]
v = 1979-05-27 07:32:00
[[arr]]
w = 1
[arr.sub]
q = 1
[[arr]]
w = 2
[[arr.deep]]
e = +1.5e3
"""
    tomllib.loads(text)  # or the test itself is wrong
    at, places = locate(text), {
        ("top",): (2, 1), ("quoted key",): (3, 1), ("a", "b"): (4, 1), ("a", "b", "k1"): (4, 10), ("a", "b", "k1", 1): (4, 19),
        ("a", "b", "k1", 1, "k2"): (4, 20), ("a", "b", "k1", 1, "k3"): (4, 30), ("a", "b", "k4"): (4, 40), ("multi", 0): (6, 3),
        ("multi", 1, 1): (7, 10), ("t", "u", "v"): (16, 1), ("arr", 0, "sub", "q"): (20, 1), ("arr", 1): (21, 1),
        ("arr", 1, "w"): (22, 1), ("arr", 1, "deep", 0, "e"): (24, 1),
    }  # fmt: skip
    assert {place: at[place] for place in places} == places
    assert not any("fake" in place or "k9" in place for place in at)
    assert locate(text.replace("\n", "\r\n")) == at


def test_files_that_cannot_be_read(tmp_path, monkeypatch):
    (tmp_path / "latin.toml").write_bytes("scene = 1\ntitle = 'r\N{LATIN SMALL LETTER O WITH DIAERESIS}'\n".encode("latin-1"))
    with pytest.raises(InputError, match="latin.toml:2:11: is not UTF-8 text: save it as UTF-8$"):
        Scene.load(tmp_path / "latin.toml")

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", refuse)
    with pytest.raises(InputError, match="latin.toml: cannot be read: Permission denied$"):
        Scene.load(tmp_path / "latin.toml")


def test_the_json_schema_accepts_what_is_shipped_and_refuses_faults():
    schema = Scene.model_json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    for path in sorted((Path(__file__).parents[2] / "scenes").glob("*.toml")):
        assert list(validator.iter_errors(tomllib.loads(path.read_text(encoding="utf-8")))) == [], path.stem
    good = tomllib.loads(GOOD)
    assert list(validator.iter_errors(good)) == []
    for table, key, value in (
        ("solver", "distance", 2e-5),  # a bare number has no unit
        ("solver", "distnce", "20 um"),
        ("contact", "debris_contact", "some"),
        ("domain", "size", ["600 um"]),
        ("output", "every_kind", "time"),
    ):
        document = copy.deepcopy(good)
        document[table][key] = value
        assert list(validator.iter_errors(document)), key
    # options of laws and effects are left to them
    document = copy.deepcopy(good)
    document["contact"]["some_option"] = 1
    document.setdefault("effects", {})["some_effect"] = {"strength": "1 Pa"}
    assert list(validator.iter_errors(document)) == []
    # quantities report their units
    solver = schema["$defs"]["Solver"]["properties"]
    length = solver["distance"]["anyOf"][0]
    assert length["type"] == "string"
    assert length["description"].startswith("a length with its unit: ") and " um," in length["description"]
    assert solver["tolerance"]["anyOf"][0] == {"type": "number", "exclusiveMinimum": 0, "maximum": 1}
