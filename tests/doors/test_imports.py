"""The import rules of the house, read from the source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from each import each

ROOT = Path(__file__).parents[2]
SOURCE, PLUGINS = ROOT / "src" / "thirdbody", ROOT / "plugins"
OURS = sorted(SOURCE.rglob("*.py"))
THEIRS = sorted(PLUGINS.rglob("*.py"))

GROUND = {"errors", "dimensions", "units", "quantity", "granular_flow", "palette", "rotations", "atomic_files"}
"""Modules of the root that every package may import."""

# what each package may import besides itself and the ground, at the head of a module or in a function, for type checkers too
PACKAGES = {
    "system": set(),
    "jit": {"system"},
    "kernels": {"jit"},
    "bodies": {"kernels", "jit", "system"},
    "laws": {"kernels", "jit", "system"},
    "engine": {"bodies", "laws", "kernels", "jit", "system"},
    "surfaces": {"bodies", "kernels"},
    "scene": {"bodies", "laws", "surfaces"},
    "assembly": {"scene", "surfaces", "engine", "bodies", "laws", "kernels"},
    "trajectory": {"surfaces", "engine", "laws", "kernels", "jit"},
    "export": {"trajectory"},
    "plot": {"trajectory", "surfaces"},
    "render": {"trajectory", "bodies", "system"},
    "runner": {"export", "assembly", "trajectory", "scene", "engine", "bodies", "laws", "kernels", "jit", "system"},
    "report": {
        "runner", "render", "plot", "export", "assembly", "trajectory", "scene", "surfaces", "engine", "bodies", "laws",
        "kernels", "jit", "system",
    },
    "studies": {
        "report", "runner", "render", "plot", "export", "assembly", "trajectory", "scene", "engine", "bodies", "laws", "kernels",
        "jit", "system",
    },
}  # fmt: skip
PACKAGES["cli"] = set(PACKAGES)

# subpackages, by the same rule
INNER = {
    "kernels": {"explicit": {""}, "implicit": {"explicit", ""}, "": set()},
    "laws": {"codegen": {""}, "conformance": {"codegen", ""}, "": {"codegen"}},
    "studies": {"robustness": {""}, "sweep": {""}, "": set()},
}

# modules of the root that are no ground: what they may import
ROOT_MODULES = {
    "__init__": {"errors", "report", "runner", "scene", "studies", "trajectory"},
    "__main__": {"cli"},
    "plugin": {"bodies", "engine", "errors", "jit", "kernels", "laws", "scene", "units"},
    "errors": set(),
    "dimensions": set(),
    "palette": set(),
    "rotations": set(),
    "quantity": set(),
    "granular_flow": {"quantity"},
    "units": {"dimensions", "errors"},
    "atomic_files": {"errors"},
}

# the methods of a run that export and draw it (`Run.export`, `Run.plot`, `Run.render`), which import when they are called
FACADES = {"trajectory.reader": {"export", "plot", "render"}}

HEAVY = {"numba", "vtk", "vtkmodules", "pyvista", "matplotlib", "h5py", "scipy", "pint", "pandas"}
LIGHT = [
    "__init__.py", "errors.py", "dimensions.py", "units.py", "runner/progress.py",
    *(path.relative_to(SOURCE).as_posix() for package in ("cli", "scene", "system") for path in (SOURCE / package).rglob("*.py")),
]  # fmt: skip
COMPILED = {"jit", "kernels", "laws", "bodies", "engine"}
DRAWING = {"trajectory", "export", "plot", "render"}


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


def package_of(name: str) -> str:
    """`engine` for thirdbody.engine.state.State; empty for the package itself."""
    return (name.split(".") + [""])[1]


def subpackage_of(name: str, package: str) -> str:
    """`explicit` for thirdbody.kernels.explicit.drift; empty for a module that lies in the package itself."""
    parts = name.split(".")
    return parts[2] if len(parts) > 2 and parts[1] == package and parts[2] in INNER[package] else ""


def statements_at_start(body: list[ast.stmt]) -> Iterator[ast.Import | ast.ImportFrom]:
    """The imports that are executed when a module is imported itself: not in functions, not for type checkers."""
    for node in body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif isinstance(node, ast.If) and "TYPE_CHECKING" not in ast.dump(node.test):
            yield from statements_at_start(node.body + node.orelse)
        elif isinstance(node, ast.Try):
            inner = [statement for handler in node.handlers for statement in handler.body]
            yield from statements_at_start(node.body + node.orelse + node.finalbody + inner)


def at_start(path: Path) -> set[str]:
    """First words of what a module imports at its start."""
    names: set[str] = set()
    for node in statements_at_start(ast.parse(path.read_text(encoding="utf-8")).body):
        if isinstance(node, ast.Import):
            names.update(alias.name.split(".")[0] for alias in node.names)
        elif not node.level and node.module:
            names.add(node.module.split(".")[0])
    return names


def module_of(path: Path) -> str:
    """`engine.state`; the name of the package for an `__init__`."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def graph() -> dict[str, set[str]]:
    """Module -> modules of ours that it imports at its start."""
    known = {module_of(path) for path in OURS}
    edges: dict[str, set[str]] = {}
    for path in OURS:
        edges[module_of(path)] = own = set()
        for node in statements_at_start(ast.parse(path.read_text(encoding="utf-8")).body):
            names = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                whole = [f"{node.module}.{name}" for name in names]
                names = [name if name.partition(".")[2] in known else str(node.module) for name in whole]
            own.update(name.partition(".")[2] for name in names if name.split(".")[0] == "thirdbody")
    return edges


def circle(edges: dict[str, set[str]]) -> list[str]:
    """A path of modules that leads back to its first one; empty if there is none."""
    done: set[str] = set()

    def follow(name: str, trail: list[str]) -> list[str]:
        if name in trail:
            return [*trail[trail.index(name) :], name]
        if name not in done:
            for other in sorted(edges.get(name, ())):
                if found := follow(other, [*trail, name]):
                    return found
            done.add(name)
        return []

    return next((found for name in sorted(edges) if (found := follow(name, []))), [])


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_there_is_something_to_read():
    assert len(OURS) > 50 and len(THEIRS) >= 3


def test_every_package_and_every_module_of_the_root_has_its_rule():
    packages = {path.name for path in SOURCE.iterdir() if path.is_dir() and (path / "__init__.py").is_file()}
    assert packages == set(PACKAGES)
    assert {path.stem for path in SOURCE.glob("*.py")} == set(ROOT_MODULES)
    for package, inner in INNER.items():
        assert {path.name for path in (SOURCE / package).iterdir() if (path / "__init__.py").is_file()} >= set(inner) - {""}


@each(OURS, name_of)
def test_imports_point_down(path):
    parts = path.relative_to(SOURCE).with_suffix("").parts
    used = {package_of(name) for name, _ in imports(path) if name.split(".")[0] == "thirdbody"} - {parts[0], "", "__version__"}
    if len(parts) == 1:
        allowed = ROOT_MODULES[parts[0]]
    else:
        allowed = PACKAGES[parts[0]] | GROUND | FACADES.get(".".join(parts), set())
    assert used <= allowed, f"{'.'.join(parts)} must not import {sorted(used - allowed)}"


@each([path for path in OURS if path.relative_to(SOURCE).parts[0] in INNER], name_of)
def test_imports_point_down_inside_packages(path):
    own = path.relative_to(SOURCE).with_suffix("").parts
    package, inside = own[0], own[1] if len(own) > 2 and own[1] in INNER[own[0]] else ""
    used = {subpackage_of(name, package) for name, _ in imports(path) if name.startswith(f"thirdbody.{package}.")} - {inside}
    assert used <= INNER[package].get(inside, set()), f"{'.'.join(own)} must not import {sorted(used)}"


def test_no_imports_go_round_in_a_circle():
    assert not circle(graph()), " -> ".join(circle(graph()))


def test_a_circle_is_found():
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert circle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


@each(OURS, name_of)
def test_imports_are_absolute(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        assert not (isinstance(node, ast.ImportFrom) and node.level), f"line {node.lineno}"


@each(OURS, name_of)
def test_the_source_never_imports_a_plug_in(path):
    plugged = {"plugins", *(p.stem for p in PLUGINS.glob("*.py")), *(f"thirdbody_{p.name}" for p in PLUGINS.iterdir())}
    assert not {name.split(".")[0] for name, _ in imports(path)} & plugged


@each(THEIRS, name_of)
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


@each(OURS, name_of)
def test_numba_stays_in_compiled_packages_and_drawing_in_its_own(path):
    own, used = path.relative_to(SOURCE).parts[0], at_start(path)
    if own not in COMPILED:
        assert "numba" not in used
    if own not in DRAWING:
        assert not used & {"vtk", "vtkmodules", "pyvista", "matplotlib", "h5py"}


def test_pictures_are_drawn_through_pyvista():
    """VTK itself is used for spheres only, which pyvista cannot cast without triangles."""
    drawing = [path for path in OURS if path.name not in ("pvd.py", "map_files.py")]  # which write files
    used = {name for path in drawing for name, _ in imports(path) if name.split(".")[0] in ("vtk", "vtkmodules")}
    assert used == {"vtkmodules.vtkRenderingOpenGL2.vtkOpenGLSphereMapper"}
