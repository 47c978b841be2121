"""Options of several commands; those that belong together are one parameter of a command: a named tuple, a field per option."""

from collections.abc import Callable
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from thirdbody.errors import UsageError


def grouped(function: Callable[..., None]) -> Callable[..., None]:
    """Return the function as a command for typer: each parameter that is a named tuple becomes one option per field."""
    groups: dict[str, Any] = {name: kind for name, kind in function.__annotations__.items() if hasattr(kind, "_fields")}
    options: list[Parameter] = []
    for name, parameter in signature(function).parameters.items():
        if name in groups:
            defaults = groups[name]._field_defaults
            for field, annotation in groups[name].__annotations__.items():
                default = defaults.get(field, Parameter.empty)
                options.append(Parameter(field, Parameter.KEYWORD_ONLY, default=default, annotation=annotation))
        else:
            options.append(parameter.replace(kind=Parameter.KEYWORD_ONLY))

    @wraps(function)
    def command(**given: Any) -> None:
        for name, kind in groups.items():
            given[name] = kind(**{field: given.pop(field) for field in kind._fields})
        function(**given)

    setattr(command, "__signature__", Signature(options))  # noqa: B010
    command.__annotations__ = {option.name: option.annotation for option in options}
    return command


Settings = Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="replace a value of the scene")]
Plugins = Annotated[list[Path] | None, typer.Option("--plugin", help="Python file with a PLUGIN; may be repeated")]
Json = Annotated[bool, typer.Option("--json", help="print JSON")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="no progress")]


def override_pairs(settings: list[str] | None) -> dict[str, str]:
    """Return the values of --set by their keys."""
    pairs = {}
    for text in settings or ():
        key, sign, value = text.partition("=")
        if not sign or not key.strip():
            raise UsageError(f"--set {text}: write KEY=VALUE, such as solver.distance='1 um'")
        pairs[key.strip()] = value.strip()
    return pairs


def seconds_of(option: str, text: str) -> float:
    """Return the time that an option gives [s]. Raises UsageError."""
    from thirdbody import units

    try:
        seconds = units.parse(text, "time")
    except ValueError as error:
        raise UsageError(f"{option}: {error}") from None
    if seconds < 0.0:
        raise UsageError(f"{option}: {text} must be at least 0 s")
    return seconds


class Execution(NamedTuple):
    """How a run is carried out and reported."""

    threads: Annotated[int | None, typer.Option("--threads", min=1, help="cores to use (same bits for any number)")] = None
    every: Annotated[str | None, typer.Option("--checkpoint-every", help="wall time between checkpoints [30 s]")] = None
    wall_limit: Annotated[str | None, typer.Option("--wall-limit", help="wall time after which to stop with a checkpoint")] = None
    quiet: Quiet = False
    json: Json = False


class Cluster(NamedTuple):
    """Workers of Dask that compute the points of a sweep."""

    dask: Annotated[str | None, typer.Option("--dask", metavar="ADDRESS", help="Dask scheduler, such as tcp://host:8786")] = None
    cluster: Annotated[
        Path | None, typer.Option("--cluster", metavar="FILE", help="TOML file of a queue whose jobs are the workers, as [slurm]")
    ] = None


class MeshFit(NamedTuple):
    """How a surface mesh becomes a clump."""

    unit: Annotated[str | None, typer.Option("--unit", help="mesh: unit of length of the file, such as um")] = None
    spheres: Annotated[
        int | None, typer.Option("--spheres", help="mesh: spheres that represent it [12, more where these miss]")
    ] = None
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="mesh: seed of the fit [1]")] = None


class Image(NamedTuple):
    """What a picture or a film shows, and its size in pixels."""

    color: Annotated[
        str, typer.Option("--color", help="state, reason, population, material, speed, or an array (velocity_x)")
    ] = "state"
    view: Annotated[str, typer.Option("--view", help="iso, side, front or top")] = "iso"
    forces: Annotated[bool, typer.Option("--forces", help="contact forces as tubes")] = False
    body: Annotated[int | None, typer.Option("--body", min=0, help="one body close up: spots, forces, friction cones")] = None
    plate: Annotated[str | None, typer.Option("--plate", help="map of a measure, named by --color: lower or upper")] = None
    cycles: Annotated[float | None, typer.Option("--cycles", help="with --plate: map of so many cycles, by rate")] = None
    zoom: Annotated[float | None, typer.Option("--zoom", help="fraction of the domain that is shown, 0.0001 to 1")] = None
    width: Annotated[int, typer.Option("--width", min=200, max=8192)] = 1600
    height: Annotated[int, typer.Option("--height", min=200, max=8192)] = 900
    frames: Annotated[str | None, typer.Option("--frames", metavar="A:B:C", help="film, page: from A, before B, by C")] = None
    fps: Annotated[int, typer.Option("--fps", help="film, page: frames a second")] = 12
    camera: Annotated[str | None, typer.Option("--camera", help="film of a body: fixed or follow [follow]")] = None


class Study(NamedTuple):
    """What a study computes."""

    repeats: Annotated[int, typer.Option("--repeats", min=2, max=1000, help="runs of each variant that are timed")] = 3
    budget: Annotated[str, typer.Option("--budget", help="wall time for all variants, to which the scene is reduced")] = "7 min"
    effects: Annotated[bool, typer.Option("--effects", help="cost and influence of each effect instead of accuracy")] = False
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="EFFECT", help="with --effects: no other; may be repeated")
    ] = None
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace an existing study")] = False
    resume: Annotated[bool, typer.Option("--resume", help="go on with the runs of a study that was interrupted")] = False
