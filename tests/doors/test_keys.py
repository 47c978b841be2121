"""References are complete: keys and names with examples that can be read, docstrings of the public interface, generated code."""

import ast
import doctest
import inspect
import json
import re

import pytest
from each import each
from pages import ROOT
from pydantic import TypeAdapter
from thirdbody_three_spot.classify import REASONS
import thirdbody
from thirdbody import errors, plugin
from thirdbody.engine.accuracy import Accuracy
from thirdbody.laws.registry import discover
from thirdbody.report.reference import all_keys, all_names
from thirdbody.schema.parts import Part, key_docs
from thirdbody.studies.axes import IntervalTable

TABLES = {
    "materials", "pairs", "debris", "domain", "plates", "contact", "effects", "measures", "solver", "output", "lower", "upper",
    "motion", "wear",
}  # fmt: skip
"""Keys that hold nothing but tables, whose own keys are listed."""
OF_EFFECTS = {
    "series": {"energy_plastic", "energy_adhesion", "energy_body_effects", "scene_time", "inside", "ejected"}
    | {"wall_force_near", "wall_force_far", "base_displacement", "energy_drive_spring", "energy_wear", "contact_half_width"}
    | {f"{name}_{plate}" for name in ("worn_volume", "rms_height", "rms_slope") for plate in ("lower", "upper")}
    | {f"count_{reason}" for reason in REASONS},
    "bodies": {"plastic_work", "adhesion_work", "agglomerate", "scene_id", "exit_position", "exit_distance"},
    "contacts": {"twist_moment", "twist_utilisation", "moment", "rolling_utilisation"},
}  # fmt: skip
"""Names that ask for effects, a sample of the bodies, a scaled speed, side walls, a contact with an edge, a spring, or wear."""


@pytest.fixture(scope="module")
def registry():
    return discover()


def parts(base=Part):
    """All tables of keys but one: the keys of an interval stand in the meaning of `vary`."""
    kinds = [kind for kind in base.__subclasses__() if kind.__module__.startswith("thirdbody.") and kind is not IntervalTable]
    return {part for kind in kinds for part in {kind, *parts(kind)}}


@each(sorted(parts(), key=lambda part: f"{part.__module__}.{part.__name__}"))
def test_every_key_has_a_meaning_and_an_example_that_can_be_read(part):
    docs, schemas = key_docs(part), part.model_json_schema()["properties"]
    for name, field in part.model_fields.items():
        if name in TABLES | {"every_kind", "options", "named"} and name not in docs:
            continue
        meaning, _, example = docs[name].partition(" Example: ")
        assert meaning[-1] in ".;" and example, name
        if name == "kind":
            continue  # of another kind
        schema = schemas[name]
        if name != "every" and "const" not in json.dumps(schema):  # a time or a length: read by the table
            TypeAdapter(field.rebuild_annotation()).validate_python(schema["examples"][0], context={"file": True})


def test_options_have_a_meaning_and_a_key_of_several_tables_is_listed_once(registry):
    options = [key for key in all_keys(registry) if key.path.startswith(("contact.", "effects."))]
    assert {"contact.springs", "contact.nodes", "effects.local_damping.until", "effects.gravity"} <= {key.path for key in options}
    assert not [key.path for key in options if not (key.meaning and key.example and key.value)]
    keys = {(key.path, key.tables): key for key in all_keys(registry)}
    assert keys["debris.material", ()].default == "required"
    assert '"mesh"' in keys["debris.kind", ()].value
    assert keys["debris.placement", ("irregular", "mesh", "spheroid")].default == '"layer"'
    assert keys["debris.size.median", ("lognormal",)].unit == "m"
    assert keys["contact.memory", ("coulomb", "mindlin")].value.startswith('"auto" or "two_number" or')
    assert len(keys) == len(all_keys(registry))
    report = next(key for key in all_keys(registry) if key.path == "solver.tolerance").meaning
    assert float(re.search(r"by default ([\d.e-]+)\.", report)[1]) == Accuracy().tolerance


def test_names_are_those_of_runs(registry, shared_run):
    """Of two cycles of a stroke, and of plates that meet each other under springs."""
    names, seen = all_names(registry), {}
    for name in ("stroke", "plate"):
        with thirdbody.open(shared_run(name)) as run:
            assert all(names["series"][name].unit == run.units[name] for name in run.series)
            if name == "plate":  # plates that rub on each other drag too
                debris, direct = run.series["upper_force"], run.series["direct_force"]
                mu, both = run.series["friction_coefficient"][-1], (debris + direct)[-1]
                assert direct[-1, 0] != 0.0 and abs(mu) == pytest.approx(abs(both[0] / both[2]), rel=1e-12)
            found = {"series": run.series, "cycles": run.cycles or (), "transitions": run.transitions()}
            for table, there in (found | {block: getattr(run, block)(-1) for block in ("bodies", "spheres", "contacts")}).items():
                seen[table] = seen.get(table, set()) | set(there)
            assert name == "plate" or len(run.cycles["energy"]) == 2
    assert {table: set(names[table]) - OF_EFFECTS.get(table, set()) for table in seen} == seen
    assert not [name for entries in names.values() for name, entry in entries.items() if not entry.meaning or not entry.unit]


def test_every_exit_code_is_explained():
    kinds = [errors.ThirdbodyError, *errors.ThirdbodyError.__subclasses__()]
    assert {kind.exit_code for kind in kinds} <= errors.EXIT_CODES.keys()


def test_a_word_finds_names_else_meanings_else_the_nearest(command):
    for word in ("frequency", "debris[0].size", "debris.0.size.median", "SPRINGS", "virgin", "upper_force"):
        report = command("keys", word, "--json")
        assert report.code == 0, report.err
        found = json.loads(report.out)
        names = [key["path"] for key in found["scene"]] + [name for entries in found["run"].values() for name in entries]
        wanted = re.sub(r"\[\d\]|\.\d", "", word).lower()
        assert names == ["critical_slip"] if word == "virgin" else any(wanted in name for name in names) and len(names) < 20
    report = command("keys", "freqency")
    assert report.code == 2 and report.err == "thirdbody: keys freqency: nothing has this name, did you mean 'frequency'?\n"
    report = command("keys", "shape")
    assert "debris.shape.radius" in report.out and '"triangle"' in report.out and "required" in report.out
    assert "run.series[name]" in command("keys", "gap").out


def functions_of(cls):
    names = [name for base in cls.__mro__ if base.__module__.startswith("thirdbody.") for name in vars(base)]
    return {f"{cls.__name__}.{name}": getattr(cls, name) for name in names if not name.startswith(("_", "model_"))}


PUBLIC = {name: getattr(thirdbody, name) for name in (*thirdbody.__all__, "balance") if name != "errors"}
PUBLIC |= functions_of(thirdbody.Run) | functions_of(thirdbody.Scene)
PUBLIC |= {f"plugin.{name}": getattr(getattr(plugin, name), "py_func", getattr(plugin, name)) for name in plugin.__all__}
INTERNAL = {
    "Run.steady", "Run.rows", "Run.frame_number", "Run.surface_position", "Scene.suggestion", "Scene.rules", "Scene.checks",
    "Scene.arrange", "Scene.beside", "Scene.fault",
}  # fmt: skip
"""Public by name, for other parts of thirdbody only."""
DECORATORS = {"plugin.kernel", "plugin.helper"}  # made by numba; what they do stands where they are set
LEFT = {name: thing for name, thing in PUBLIC.items() if name not in INTERNAL | DECORATORS}


def sections(docstring):
    pieces = re.split(r"(?m)^([A-Z][a-z ]+)\n-+$", inspect.cleandoc(docstring))
    return dict(zip(pieces[1::2], pieces[2::2], strict=True))


@each(sorted(LEFT))
def test_everything_public_has_a_docstring_of_its_own(name):
    if name != "plugin.Options" and not isinstance(LEFT[name], int | float | str | dict):  # a type, numbers, a table of names
        first = (inspect.getdoc(LEFT[name]) or "").partition("\n")[0]
        assert first and first.endswith((".", ":")) and len(first) <= 130, first


@each(sorted(name for name, thing in LEFT.items() if inspect.isfunction(thing) or inspect.ismethod(thing)))
def test_every_parameter_is_named_and_what_is_returned_described(name):
    signature, described = inspect.signature(LEFT[name]), sections(LEFT[name].__doc__)
    names = [parameter for parameter in signature.parameters if parameter not in ("self", "cls")]
    lines = described.get("Parameters", "").splitlines()
    listed = re.findall(r"[*\w]+", " ".join(line.partition(" : ")[0] for line in lines if line[:1].strip()))
    assert [listed_name.lstrip("*") for listed_name in listed] == names
    assert signature.return_annotation in (None, "None", inspect.Signature.empty) or "Returns" in described


@each(sorted(name for name, thing in PUBLIC.items() if inspect.isclass(thing)))
def test_listed_attributes_are_the_fields(name):
    fields = getattr(PUBLIC[name], "_fields", None) or tuple(getattr(PUBLIC[name], "__dataclass_fields__", ()))
    text = sections(PUBLIC[name].__doc__).get("Attributes", "")
    names = [line.partition(" : ")[0] for line in text.splitlines() if line[:1].strip()]
    assert not text or tuple(", ".join(names).split(", ")) == fields


@pytest.mark.full(kind="slow")
def test_examples_run(tmp_path, monkeypatch):
    """One after the other in a folder with a scene of four flakes that slide a little, its run, and a file for `balance`."""
    shorter = {"debris.0.count": "4", "solver.settle": "2 us", "solver.distance": "0.1 um", "output.every": "0.05 um"}
    scene = thirdbody.Scene.load(ROOT / "scenes" / "sliding_flakes.toml").with_settings(shorter)
    monkeypatch.chdir(tmp_path)
    scene.save("example.toml")
    particle = (ROOT / "scenes" / "balance" / "three_spot.toml").read_text(encoding="utf-8")
    (tmp_path / "particle.toml").write_text(particle.replace("steps = 480", "steps = 24"), encoding="utf-8")
    names = {"thirdbody": thirdbody, "plugin": plugin, "run": thirdbody.run("example.toml", "runs/example", progress=False)}
    finder, runner = doctest.DocTestFinder(recurse=False), doctest.DocTestRunner()
    count = 0
    for name, thing in sorted(PUBLIC.items()):
        for example in finder.find(thing, name, globs=dict(names)):
            count += len(example.examples)
            assert not runner.run(example).failed, name
    assert count > 20


def test_generated_code_of_a_scene_is_python_that_calls_its_laws(command):
    shown = command("laws", "--show-code", ROOT / "scenes" / "three_spot.toml", "--json")
    assert shown.code == 0, shown.err
    modules = json.loads(shown.out)
    assert list(modules) == ["law", "labeller"]  # a scene without effects has no code for them
    functions = {name: {node.name for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)}
                 for name, text in modules.items()}  # fmt: skip
    assert functions["law"] >= {"law", "stiffness", "tangents"}
    assert "from thirdbody.laws.friction import mindlin as kernel_2" in modules["law"] and "hertz_tangent" in modules["law"]
    shown = command("laws", "--show-code", ROOT / "scenes" / "sheared_debris.toml")
    titles = [line.split()[-1] for line in shown.out.splitlines() if line.startswith("# ====")]
    assert shown.code == 0 and titles == ["law", "effects", "labeller"]
    ast.parse(shown.out)  # as it is printed, it is a module's text
    refused = command("laws", "--show-code", ROOT / "scenes" / "three_spot.toml", "--check", "law.py")
    assert refused.code == 2 and "--check or --show-code" in refused.err
