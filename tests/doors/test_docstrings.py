"""Docstrings of the public interface: they name every parameter and what is returned, and their examples run."""

from __future__ import annotations

import doctest
import inspect
import re

import pytest
from pages import ROOT

import thirdbody
from thirdbody import plugin

EXAMPLE = {
    "debris.0.count": "4", "solver.settle": "2 us", "solver.distance": "0.1 um", "output.every": "0.05 um",
}  # fmt: skip
"""Four flakes that slide a little: the scene of the examples."""


def functions_of(cls: type) -> dict[str, object]:
    """Public methods of a class and of those below it that are ours."""
    names = [name for base in cls.__mro__ if base.__module__.startswith("thirdbody.") for name in vars(base)]
    return {f"{cls.__name__}.{name}": getattr(cls, name) for name in names if not name.startswith(("_", "model_"))}


def plain(thing: object) -> object:
    """A compiled function as it was written."""
    return getattr(thing, "py_func", thing)


PYTHON = {name: getattr(thirdbody, name) for name in (*thirdbody.__all__, "balance") if name != "errors"}
PYTHON |= functions_of(thirdbody.Run) | functions_of(thirdbody.Scene)
PLUGIN = {f"plugin.{name}": plain(getattr(plugin, name)) for name in plugin.__all__}
INTERNAL = {"Run.steady", "Scene.suggestion", "Scene.rules", "Scene.checks", "Scene.arrange", "Scene.beside", "Scene.fault"}
"""Public by name, for other parts of thirdbody only."""
DECORATORS = {"plugin.kernel", "plugin.helper"}
"""Made by numba; what they do stands where they are set."""

FUNCTIONS = {
    name: thing
    for name, thing in (PYTHON | PLUGIN).items()
    if (inspect.isfunction(thing) or inspect.ismethod(thing)) and name not in INTERNAL | DECORATORS
}
every_function = pytest.mark.parametrize("name", sorted(FUNCTIONS))


def sections(docstring: str) -> dict[str, str]:
    """The text of each section of a numpydoc docstring."""
    pieces = re.split(r"(?m)^([A-Z][a-z ]+)\n-+$", inspect.cleandoc(docstring))
    return dict(zip(pieces[1::2], pieces[2::2], strict=True))


@pytest.mark.parametrize("name", sorted(PYTHON | PLUGIN))
def test_everything_public_has_a_docstring_of_its_own(name):
    thing = (PYTHON | PLUGIN)[name]
    if isinstance(thing, int | float | str) or name in INTERNAL | DECORATORS:
        return
    if name == "plugin.Options" or isinstance(thing, dict):  # a type, a table of names
        return
    first = (inspect.getdoc(thing) or "").partition("\n")[0]
    assert first and first.endswith((".", ":")) and len(first) <= 130, first


@every_function
def test_every_parameter_is_named(name):
    function = FUNCTIONS[name]
    names = [parameter for parameter in inspect.signature(function).parameters if parameter not in ("self", "cls")]
    text = sections(function.__doc__).get("Parameters", "")
    listed = re.findall(r"[*\w]+", " ".join(line.partition(" : ")[0] for line in text.splitlines() if line[:1].strip()))
    assert [listed_name.lstrip("*") for listed_name in listed] == names


@every_function
def test_what_is_returned_is_described(name):
    function = FUNCTIONS[name]
    returns = inspect.signature(function).return_annotation
    if returns not in (None, "None", inspect.Signature.empty):
        assert "Returns" in sections(function.__doc__)


@pytest.mark.parametrize("name", sorted(name for name, thing in (PYTHON | PLUGIN).items() if inspect.isclass(thing)))
def test_listed_attributes_are_the_fields(name):
    """Of classes that list their fields, named tuples and data classes, all are listed."""
    cls = (PYTHON | PLUGIN)[name]
    fields = getattr(cls, "_fields", None) or tuple(getattr(cls, "__dataclass_fields__", ()))
    text = sections(cls.__doc__).get("Attributes", "")
    if text:
        names = [line.partition(" : ")[0] for line in text.splitlines() if line[:1].strip()]
        assert tuple(", ".join(names).split(", ")) == fields


def test_examples_run(tmp_path, monkeypatch):
    """One after the other in a folder with a scene, its run, and a file for `balance`."""
    scene = thirdbody.Scene.load(ROOT / "scenes" / "sliding_flakes.toml").with_settings(EXAMPLE)
    monkeypatch.chdir(tmp_path)
    scene.save("example.toml")
    particle = (ROOT / "scenes" / "balance" / "three_spot.toml").read_text(encoding="utf-8")
    (tmp_path / "particle.toml").write_text(particle.replace("steps = 480", "steps = 24"), encoding="utf-8")
    names = {"thirdbody": thirdbody, "plugin": plugin, "run": thirdbody.run("example.toml", "runs/example", progress=False)}
    finder, runner = doctest.DocTestFinder(recurse=False), doctest.DocTestRunner()
    count = 0
    for name, thing in sorted((PYTHON | PLUGIN).items()):
        for example in finder.find(thing, name, globs=dict(names)):
            count += len(example.examples)
            assert not runner.run(example).failed, name
    assert count > 20
