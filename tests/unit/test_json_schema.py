"""The JSON schema of a scene file agrees with the reader: what is shipped is valid, common faults are not."""

import copy
import tomllib
from pathlib import Path

import jsonschema

from thirdbody.scene.model import Scene

SCENES = sorted((Path(__file__).parents[2] / "scenes").glob("*.toml"))
GOOD = tomllib.loads((Path(__file__).parent / "good_scene.toml").read_text(encoding="utf-8"))


def test_shipped_scenes_are_valid_and_faults_are_not():
    schema = Scene.model_json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    for path in SCENES:
        assert list(validator.iter_errors(tomllib.loads(path.read_text(encoding="utf-8")))) == [], path.stem
    assert list(validator.iter_errors(GOOD)) == []
    for table, key, value in (
        ("solver", "distance", 2e-5),  # a bare number has no unit
        ("solver", "distnce", "20 um"),
        ("contact", "debris_contact", "some"),
        ("domain", "size", ["600 um"]),
        ("output", "every_kind", "time"),
    ):
        document = copy.deepcopy(GOOD)
        document[table][key] = value
        assert list(validator.iter_errors(document)), key
    # options of laws and effects are left to them
    document = copy.deepcopy(GOOD)
    document["contact"]["some_option"] = 1
    document.setdefault("effects", {})["some_effect"] = {"strength": "1 Pa"}
    assert list(validator.iter_errors(document)) == []


def test_quantities_report_their_units():
    solver = Scene.model_json_schema()["$defs"]["Solver"]["properties"]
    length = solver["distance"]["anyOf"][0]
    assert length["type"] == "string"
    assert length["description"].startswith("a length with its unit: ") and " um," in length["description"]
    assert solver["tolerance"]["anyOf"][0] == {"type": "number", "exclusiveMinimum": 0, "maximum": 1}
