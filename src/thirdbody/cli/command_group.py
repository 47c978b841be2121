"""Listing, lookup and description of commands: built-in ones, those of plug-ins, imported only when called, and those gone."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from thirdbody.errors import OutputError, UsageError, nearest

COMMAND_GROUP = "thirdbody.commands"

# Metavars in help for options that name none; all others have their own name in capitals.
METAVARS = {
    "TIME": ("budget", "every", "wall_limit"),
    "FILE": ("check", "plugin"),
    "PATH": ("out",),
    "N": ("body", "fps", "frame", "repeats", "samples", "seed", "spheres", "threads", "workers"),
    "NAME": ("camera", "color", "design", "keep", "level", "view"),
    "NUMBER": ("big_h", "half_width", "zoom"),
    "PIXELS": ("height", "width"),
}
_METAVAR = {name: metavar for metavar, names in METAVARS.items() for name in names}

SEEDS = (
    "a run is computed by one process; more bodies, or a cluster, take a sweep over seeds: "
    "thirdbody sweep SCENE --vary debris.0.seed=1,2,3 (guide: On a cluster)"
)
REMOVED_COMMANDS = {"hard": "the cases that break naive codes are run by `python tests/bench/hard_cases.py` of the source tree"}
# Commands and options that are gone, and what does their job now.
REMOVED_OPTIONS = {
    ("run", "--parts"): SEEDS,
    ("run", "--dask"): SEEDS,
    ("run", "--cluster"): SEEDS,
    ("resume", "--dask"): SEEDS,
    ("resume", "--cluster"): SEEDS,
    ("export", "--pack"): "`h5repack -f SHUF -f GZIP=4 RUN/run.vtkhdf FILE` (of the HDF5 tools) writes a compressed copy",
    ("cost", "--verify"): "closed forms and orders of convergence are checked by the project's own tests (tests/theory); what "
    "neighbouring spots do to each other is a line of `thirdbody cost SCENE --effects`, close_spots",
}


class Command(TyperCommand):
    """Command whose help lists arguments and options by their metavars, without Python types."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        for parameter in self.params:
            if parameter.param_type_name == "option" and not getattr(parameter, "is_flag", False) and parameter.metavar is None:
                name = str(parameter.name)
                parameter.metavar = _METAVAR.get(name, name.upper())

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the options. Raises UsageError for one that is gone."""
        for option in (word.partition("=")[0] for word in args):
            if (ctx.info_name, option) in REMOVED_OPTIONS:
                raise UsageError(f"{option}: {REMOVED_OPTIONS[ctx.info_name, option]}")
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options as two lists."""
        rows: dict[str, list[tuple[str, str]]] = {"argument": [], "option": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None:
                kind = parameter.param_type_name
                rows[kind].append((str(parameter.metavar or parameter.name), record[1]) if kind == "argument" else record)
        for title, entries in (("Arguments", rows["argument"]), ("Options", rows["option"])):
            if entries:
                with formatter.section(title):
                    formatter.write_dl(entries)


class CommandPoint(NamedTuple):
    """Where the command of an installed plug-in is."""

    name: str
    module: str
    attr: str

    def load(self) -> Any:
        """Import the function."""
        return getattr(import_module(self.module), self.attr)


def command_points() -> dict[str, CommandPoint]:
    """Return the commands of installed plug-ins by name: `entry_points` of importlib.metadata takes a third of `--help`."""
    points = {}
    for folder in reversed(sys.path):  # the first in the search path counts
        for file in Path(folder).glob("*-info/entry_points.txt"):
            text = "\n" + file.read_text(encoding="utf-8", errors="replace")
            for line in text.partition(f"\n[{COMMAND_GROUP}]\n")[2].partition("\n[")[0].splitlines():
                name, _, target = line.replace(" ", "").partition("=")
                if target:
                    module, _, attr = target.partition(":")  # without `attr` the command is broken, not the program
                    points[name] = CommandPoint(name, module, attr)
    return points


def documented(point: CommandPoint) -> str:
    """Return the docstring of a command, read from its source without an import; empty where it cannot be found."""
    import ast

    package, *inner = point.module.split(".")
    with suppress(OSError, SyntaxError, ValueError, ImportError):
        spec = find_spec(package)  # of the package only: that of a module would import the package
        if spec is None or spec.origin is None:
            return ""
        source = Path(spec.origin).parent.joinpath(*inner).with_suffix(".py") if inner else Path(spec.origin)
        for node in ast.parse(source.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and node.name == point.attr:
                return ast.get_docstring(node) or ""
    return ""


class PluginCommand(Command):
    """Command of a plug-in, listed by `--help` without import; replaced by the real one when called."""

    def __init__(self, point: CommandPoint) -> None:
        super().__init__(point.name, help=documented(point) or f"Command of the plug-in {point.module.split('.')[0]}.")
        self.point = point

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Load the real command and return its context. Raises UsageError."""
        try:
            function = self.point.load()
            plugged = typer.Typer(rich_markup_mode=None, add_completion=False)
            plugged.command(name=self.point.name, cls=Command)(function)
            real = typer.main.get_command(plugged)
        except Exception as problem:  # any exception on import is an error of the plug-in
            message = f"{self.point.name}: this command of {self.point.module} does not load: {type(problem).__name__}: {problem}"
            raise UsageError(message) from problem
        return real.make_context(*args, **kwargs)


class Group(TyperGroup):
    """Built-in commands and those of installed plug-ins."""

    @cached_property
    def plugged(self) -> dict[str, CommandPoint]:
        """Commands of plug-ins by name."""
        return command_points()

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names, those of plug-ins last."""
        return [*super().list_commands(ctx), *sorted(self.plugged)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by its name, None without."""
        own = super().get_command(ctx, cmd_name)
        return PluginCommand(self.plugged[cmd_name]) if own is None and cmd_name in self.plugged else own

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command of the first word. Raises UsageError, for one that is gone or with the existing commands."""
        name = args[0]
        if not name.startswith("-") and not ctx.resilient_parsing and self.get_command(ctx, name) is None:
            if name in REMOVED_COMMANDS:
                raise UsageError(f"{name}: {REMOVED_COMMANDS[name]}")
            raise UsageError(f"no command '{name}', {nearest(name, self.list_commands(ctx))}")
        return super().resolve_command(ctx, args)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the options before the command. Raises UsageError and OutputError for completion."""
        if ctx.resilient_parsing or not {"--install-completion", "--show-completion"} & set(args[:1]):
            return super().parse_args(ctx, args)
        with checked_completion():
            return super().parse_args(ctx, args)


SHELLS = ("bash", "zsh", "fish", "powershell", "pwsh")
ZSH_FUNCTION = ".zfunc/_thirdbody"
COMPLETE_NOW = '[[ $zsh_eval_context[-1] == loadautofunc ]] && _thirdbody_completion "$@"\n'


@contextmanager
def checked_completion() -> Iterator[None]:
    """Let typer show or install completion. Raises UsageError in an unknown shell, OutputError when writing fails."""
    from shellingham import ShellDetectionFailure, detect_shell

    shell, home = "unknown", None
    with suppress(ShellDetectionFailure):
        shell = detect_shell()[0]
    with suppress(RuntimeError):  # HOME is not set and the system does not know the user
        home = Path.home()
    if shell not in SHELLS:
        raise UsageError(f"completion exists for bash, zsh and fish; the shell here is {shell}: start one of them and repeat")
    try:
        yield
    except OSError as error:
        raise OutputError(f"{error.filename}: cannot be written ({error.strerror})") from error
    except RuntimeError as error:
        if home is None:
            raise OutputError("completion is installed in the home folder, and this user has none: set HOME") from error
        raise
    finally:
        if shell == "zsh" and home is not None:
            # zsh completes at the first tab of a session; otherwise that tab only loads typer's function
            path = home / ZSH_FUNCTION
            with suppress(OSError):  # completion is shown only, or the error message follows
                text = path.read_text()
                if "_thirdbody_completion" in text and "loadautofunc" not in text:
                    path.write_text(f"{text}\n{COMPLETE_NOW}")
