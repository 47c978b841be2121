"""The import rule and the size limits of the house, read from the source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE, PLUGINS = ROOT / "src" / "thirdbody", ROOT / "plugins"
OURS = sorted(SOURCE.rglob("*.py"))
THEIRS = sorted(PLUGINS.rglob("*.py"))

# each layer may import itself and those named; those of OPEN are for all
BELOW = {
    "kernels": set(),
    "laws": {"kernels"},
    "bodies": {"kernels"},
    "engine": {"kernels", "laws", "bodies"},
    "scene": {"kernels", "laws", "bodies", "engine"},
    "output": {"kernels", "laws", "bodies", "engine"},
    # studies run whole scenes, so they stand on what runs, checks and prints one
    "studies": {
        "kernels", "laws", "bodies", "engine", "scene", "output",
        "course", "lock", "report", "run_folder", "scene_check", "simulate",
    },  # fmt: skip
}
OPEN = {"address_space", "errors", "cache", "child_process", "collector", "cores", "dimensions", "modules", "terminal"}
# `plugin` is the facade of the contract: it may show what plug-ins need and nothing above it
FACADE = {"bodies", "engine", "errors", "kernels", "laws", "scene"}

HEAVY = {"numba", "vtk", "vtkmodules", "pyvista", "matplotlib", "h5py", "scipy", "pint", "pandas"}
LIGHT = ["__init__.py", "errors.py", "progress.py", "signals.py", "starters.py", "terminal.py", *(
    f"cli{name}.py" for name in ("", "_completion", "_group", "_new", "_studies")
), *(
    f"scene/{name}.py" for name in (
        "__init__", "crosscheck", "fields", "locate", "model", "part", "read", "settings", "tables", "template",
        "types", "units", "write",
    )
), *(path.relative_to(SOURCE).as_posix() for path in (SOURCE / "scene" / "debris").rglob("*.py"))]  # fmt: skip
COMPILED = {"kernels", "laws", "bodies", "engine"}


def imports(path: Path, root: Path = SOURCE, package: str = "thirdbody") -> Iterator[tuple[str, ast.stmt]]:
    """Full dotted name of every import of a file, names taken with `from` included, those for type checkers too."""
    parts = [package, *path.relative_to(root).with_suffix("").parts]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(parts[: -node.level]) if node.level else ""
            origin = ".".join(part for part in (base, node.module) if part)
            yield from ((f"{origin}.{alias.name}", node) for alias in node.names)


def layer(name: str) -> str:
    """`engine` for thirdbody.engine.state.State; empty for the package itself."""
    return (name.split(".") + [""])[1]


def at_start(path: Path) -> set[str]:
    """First words of what a module imports when it is imported itself: not in functions, not for type checkers."""
    found: set[str] = set()

    def look(body: list[ast.stmt]) -> None:
        for node in body:
            if isinstance(node, ast.Import):
                found.update(alias.name.split(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
                found.add(node.module.split(".")[0])
            elif isinstance(node, ast.If) and "TYPE_CHECKING" not in ast.dump(node.test):
                look(node.body + node.orelse)
            elif isinstance(node, ast.Try):
                look(node.body + node.orelse + node.finalbody + [s for h in node.handlers for s in h.body])

    look(ast.parse(path.read_text(encoding="utf-8")).body)
    return found


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_there_is_something_to_read():
    assert len(OURS) > 50 and len(THEIRS) >= 3


@pytest.mark.parametrize("path", OURS, ids=name_of)
def test_imports_point_down(path):
    own = path.relative_to(SOURCE).parts[0]
    found = {layer(name) for name, _ in imports(path) if name.split(".")[0] == "thirdbody"} - OPEN - {own, ""}
    if own in BELOW:
        assert found <= BELOW[own], f"{own} must not import {sorted(found - BELOW[own])}"
    elif path.stem == "plugin":
        assert found <= FACADE
    elif path.stem in OPEN:
        assert not found


@pytest.mark.parametrize("path", OURS, ids=name_of)
def test_the_source_never_imports_a_plug_in(path):
    plugged = {"plugins", *(p.stem for p in PLUGINS.glob("*.py")), *(f"thirdbody_{p.name}" for p in PLUGINS.iterdir())}
    assert not {name.split(".")[0] for name, _ in imports(path)} & plugged


@pytest.mark.parametrize("path", THEIRS, ids=name_of)
def test_plug_ins_use_the_facade_and_nothing_else(path):
    for name, node in imports(path, PLUGINS, "plugins"):
        if name.split(".")[0] == "thirdbody":
            assert name.startswith("thirdbody.plugin."), f"line {node.lineno}: {name}"


def test_what_plug_ins_take_is_what_the_facade_offers():
    facade = ast.parse((SOURCE / "plugin.py").read_text(encoding="utf-8"))
    offered = next(
        {entry.value for entry in node.value.elts}
        for node in facade.body
        if isinstance(node, ast.Assign) and node.targets[0].id == "__all__"
    )
    taken = {name.removeprefix("thirdbody.plugin.") for path in THEIRS for name, _ in imports(path, PLUGINS, "plugins")
             if name.startswith("thirdbody.plugin.")}  # fmt: skip
    assert taken <= offered, sorted(taken - offered)


def test_the_theory_imports_nothing_of_ours():
    names = [name for name, _ in imports(PLUGINS / "three_spot" / "theory.py", PLUGINS, "plugins")]
    assert not [name for name in names if name.split(".")[0] in ("thirdbody", "plugins", "thirdbody_three_spot")]


@pytest.mark.parametrize("name", LIGHT)
def test_what_starts_with_the_command_is_light(name):
    assert not at_start(SOURCE / name) & HEAVY


@pytest.mark.parametrize("path", OURS, ids=name_of)
def test_numba_stays_in_compiled_layers_and_drawing_in_output(path):
    own, found = path.relative_to(SOURCE).parts[0], at_start(path)
    if own not in COMPILED:
        assert "numba" not in found
    if own != "output":
        assert not found & {"vtk", "vtkmodules", "pyvista", "matplotlib", "h5py"}


def test_pictures_are_drawn_through_pyvista():
    """VTK itself is used for spheres only, which pyvista cannot cast without triangles."""
    drawing = [path for path in OURS if path.name != "pvd.py"]  # which writes files
    used = {name for path in drawing for name, _ in imports(path) if name.split(".")[0] in ("vtk", "vtkmodules")}
    assert used == {"vtkmodules.vtkRenderingOpenGL2.vtkOpenGLSphereMapper"}


@pytest.mark.parametrize("path", sorted((SOURCE / "output").glob("*.py")), ids=name_of)
def test_no_function_of_output_takes_more_than_eight_arguments(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            assert len([name for name in given if name.arg != "self"]) <= 8, node.name


@pytest.mark.parametrize("path", OURS + THEIRS, ids=name_of)
def test_files_and_functions_stay_short(path):
    text = path.read_text(encoding="utf-8")
    long = [f"the file has {len(text.splitlines())} lines"] if len(text.splitlines()) > 400 else []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            lines = (node.end_lineno or node.lineno) - node.lineno + 1
            if lines > 60:
                long.append(f"{node.name} has {lines} lines")
    assert not long, "; ".join(long)
