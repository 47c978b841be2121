"""A kind of debris of a third party, that of the page on plug-ins: in scenes, commands and Python, its faults and breaches."""

import json
import re
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from steel import scene_text
import thirdbody
from thirdbody.debris import registry as kinds_registry
from thirdbody.debris.registry import GROUP, built_in
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "plugins" / "README.md").read_text(encoding="utf-8")


@pytest.fixture
def dumbbell(tmp_path):
    (code,) = [block for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "DEBRIS_KINDS" in block]
    (tmp_path / "dumbbell.py").write_text(code, encoding="utf-8")
    return tmp_path / "dumbbell.py"


def scene(keys):
    debris = f'[[debris]]\nmaterial = "steel"\nkind = "dumbbell"\n{keys}'
    return scene_text(debris, '["100 um", "80 um"]', solver='duration = "10 ns"', every="5 ns")


GOOD = 'count = 5\nradius = "4 um"'


def test_a_kind_of_a_file_runs_and_goes_on(tmp_path, dumbbell, command):
    (tmp_path / "scene.toml").write_text(scene(GOOD))
    report = command("run", "scene.toml", "--plugin", dumbbell, "-q", "-o", "out")
    assert report.code == 0, report.err
    report = command("resume", "out", "--plugin", dumbbell, "-q", "--set", "solver.duration=20 ns")
    assert report.code == 0, report.err
    with thirdbody.open("out") as run:
        # a count of 5 bodies of 2 spheres, 1.5 radii apart; radii differ from body to body
        radii, centers = run.spheres(-1)["radius"].reshape(5, 2), run.spheres(-1)["position"].reshape(5, 2, 3)
        assert run.times[-1] >= 20e-9 and run.times[0] == 0.0
    assert np.linalg.norm(centers[:, 0] - centers[:, 1], axis=1) == pytest.approx(1.5 * radii[:, 0], rel=1e-6)
    assert len(set(radii[:, 0])) == 5 and np.all(np.abs(radii / 4e-6 - 1.0) < 0.1)
    assert command("shapes", "scene.toml", "--plugin", dumbbell).code == 0
    unknown = command("run", "scene.toml", "-q", "-o", "other")
    assert unknown.code == 3 and "debris[0].kind: 'dumbbell' is not one of 'irregular', 'spheres', " in unknown.err


def test_its_faults_are_reported_as_those_of_built_in_kinds_and_it_is_listed_with_them(tmp_path, dumbbell, command):
    (tmp_path / "scene.toml").write_text(scene('count = 0\nradius = "4 kg"\nspacing = 3\nheigth = "5 um"\nplacement = "pile"'))
    report = command("check", "scene.toml", "--plugin", dumbbell)
    lines = [line.split(": ", 1) for line in report.err.splitlines()]
    assert report.code == 3 and all(place.startswith("scene.toml:") for place, _ in lines) and "4 kg" in lines.pop(1)[1]
    assert [fault for _, fault in lines] == [
        "debris[0].count: 0 must be at least 1", "debris[0].spacing: 3 must be greater than 0 and at most 2",
        "debris[0].heigth: unknown key, did you mean 'height'?",
        "debris[0].placement: 'pile' is not one of 'layer', 'dilute', 'dense'",
    ]  # fmt: skip
    (tmp_path / "scene.toml").write_text(scene('count = 20000000\nradius = "4 um"'))
    report = command("check", "scene.toml", "--plugin", dumbbell)
    assert "debris[0].count: the debris would have up to 4e+07 spheres" in report.err
    report = command("shapes", "--list", "--plugin", dumbbell)
    assert report.code == 0 and re.search(r"^dumbbell .* Two equal spheres", report.out, re.MULTILINE)
    kinds = json.loads(command("shapes", "--list", "--plugin", dumbbell, "--json").out)["kinds"]
    sources = {entry["kind"]: entry["from"] for entry in kinds}
    assert sources["dumbbell"] == str(dumbbell) and sources["spheroid"] == "thirdbody" and len(sources) == len(built_in()) + 1
    keys = {line.split()[0]: line for line in command("shapes", "--list", "dumbbell", "--plugin", dumbbell).out.splitlines()}
    assert "number >0, <=2" in keys["spacing"] and keys["radius"].split()[-1] == "required"
    wrong = command("shapes", "--list", "dumbell", "--plugin", dumbbell)
    assert wrong.code == 2 and "did you mean 'dumbbell'?" in wrong.err
    found = json.loads(command("shapes", "--list", "spheroid", "--json").out)["kinds"]
    assert found[0]["schema"]["properties"]["axial_ratio"]["maximum"] == 1.0


def test_python_takes_tables_and_objects_of_the_kind(dumbbell, tmp_path):
    loaded = Scene.parse(scene(GOOD), str(tmp_path / "scene.toml"), plugins=[dumbbell])
    changed = loaded.with_settings({"debris.0.spacing": 1.0})
    assert changed.debris[0].spacing == 1.0 and type(changed.debris[0]) is type(loaded.debris[0])
    tables = {name: getattr(loaded, name) for name in Scene.model_fields if name != "debris"}
    one = Scene(debris=[loaded.debris[0]], **tables)
    assert one == loaded and one.with_settings({"debris.0.count": 2}).debris[0].count == 2
    assert Scene.of(loaded.document() | {"debris": [{"kind": "dumbbell", "material": "steel", "count": 3, "radius": 4e-6}]},
                    [dumbbell]).debris[0].count == 3  # fmt: skip
    assert Scene.parse(loaded.to_toml(), plugins=[dumbbell]) == loaded


def test_a_kind_that_breaks_the_contract_is_refused(tmp_path, dumbbell, command):
    (tmp_path / "scene.toml").write_text(scene(GOOD))
    text = dumbbell.read_text().replace("PlacedDebris,", "PlacedDebris, DebrisKind,")
    for k, (old, new, message) in enumerate(
        [
            ("KINDS = (Dumbbell,)", "KINDS = Dumbbell", "DEBRIS_KINDS must be a tuple of classes derived from DebrisKind"),
            ("DEBRIS_KINDS = (Dumbbell,)", "DEBRIS_KINDS = (dict,)", "dict is no class derived from DebrisKind"),
            ('kind: Literal["dumbbell"] = "dumbbell"', "pass", 'Dumbbell has no name: declare kind: Literal["name"] = "name"'),
            ('Literal["dumbbell"] = "dumbbell"', 'Literal["mesh"] = "mesh"', "both bring the kind of debris 'mesh'"),
            ("(PlacedDebris)", "(DebrisKind)", ""),
            ("range(self.count)", "range(3)", "the kind of debris 'dumbbell' gave 3 bodies for the count 5"),
            ("return 2", "return 1 + 0 * self.count", ""),
            ("return bodies", "return [1.0]", "the kind of debris 'dumbbell' gave no list of Clump for debris[0]"),
        ]
    ):
        assert old in text
        (tmp_path / f"kind{k}.py").write_text(text.replace(old, new))
        said = command("shapes", "scene.toml", "--plugin", f"kind{k}.py")
        assert said.code == (2 if message else 0) and message in said.err, (message, said.err)


@pytest.fixture
def installed(monkeypatch, dumbbell):
    """An installed package with the dumbbell, and another whose module is missing."""
    monkeypatch.syspath_prepend(dumbbell.parent)
    points = [EntryPoint("dumbbell", "dumbbell:Dumbbell", GROUP), EntryPoint("broken", "nowhere:Broken", GROUP)]
    monkeypatch.setattr(kinds_registry, "entry_points", lambda group: points)
    yield
    sys.modules.pop("dumbbell", None)


def test_installed_kinds_are_found_and_broken_ones_reported(installed, command):
    assert Scene.parse(scene(GOOD)).debris[0].max_spheres() == 2
    with pytest.raises(InputError, match=r"debris\[0\].kind: 'broken' \(nowhere:Broken\) did not load: ModuleNotFoundError"):
        Scene.parse(scene(GOOD).replace('kind = "dumbbell"', 'kind = "broken"'))
    report = command("shapes", "--list")
    assert report.code == 0 and "'broken' (nowhere:Broken) did not load" in report.out and "dumbbell:Dumbbell" in report.out
    validator = jsonschema.Draft202012Validator(Scene.model_json_schema())
    assert not list(validator.iter_errors(tomllib.loads(scene(GOOD))))
    assert list(validator.iter_errors(tomllib.loads(scene(GOOD + "\nspacing = 3.0"))))


def test_built_in_kinds_do_not_read_what_is_installed(monkeypatch):
    monkeypatch.setattr(kinds_registry, "entry_points", lambda group: pytest.fail("asked"))
    assert Scene.parse(scene(GOOD).replace('"dumbbell"', '"spheres"')).debris[0].count == 5
