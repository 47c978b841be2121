"""Commands that compute many runs of one scene. Heavy modules are imported inside them, as in `main`."""

from pathlib import Path
from typing import Annotated

import typer

from thirdbody.system.terminal import say

LONGEST = 30 * 86400.0
"""Longest wall time of a study [s]."""


def cost(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="scene file (TOML)")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder of the study [runs/<scene>_cost]")] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="replace a value of the scene")] = None,
    repeats: Annotated[int, typer.Option("--repeats", min=2, max=1000, help="runs of each rung that are timed")] = 3,
    budget: Annotated[str, typer.Option("--budget", help="wall time for the ladder, to which the scene is reduced")] = "7 min",
    effects: Annotated[bool, typer.Option("--effects", help="what each effect costs and changes, instead of the ladder")] = False,
    verify: Annotated[bool, typer.Option("--verify", help="add an oblique impact: errors and orders of convergence")] = False,
    plugin: Annotated[list[Path] | None, typer.Option("--plugin", help="Python file with a PLUGIN; may be repeated")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace an existing study")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="no progress")] = False,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """Tell what accuracy costs in time: laws, springs, steps and integrators of a scene against the finest of them."""
    from thirdbody import units
    from thirdbody.cli.overrides import override_pairs
    from thirdbody.errors import UsageError
    from thirdbody.studies.cost_command import cost_command

    def tell(text: str) -> None:
        if not quiet:
            say(text, err=True)

    try:
        seconds = units.parse(budget, "time")
    except ValueError as error:
        raise UsageError(f"--budget: {error}") from None
    if not 0.0 < seconds <= LONGEST:
        raise UsageError(f"--budget {budget}: must be above 0 s and at most {LONGEST / 86400.0:g} days")
    folder = out or Path("runs") / f"{scene.stem}_{'effects' if effects else 'cost'}"
    cost_command(scene, folder, override_pairs(settings), plugin or [], repeats, effects, verify, overwrite, json, tell, seconds)


def hard(
    cases: Annotated[list[str] | None, typer.Argument(metavar="CASE", help="cases [all]", show_default=False)] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="picture of the table: .png, .pdf or .svg")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="one law level, automatic time steps only")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="no progress")] = False,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """Run the hard cases: what breaks naive codes, what must hold, and how far the time step may be stretched."""
    from thirdbody.studies.robustness.report import hard_command

    def tell(text: str) -> None:
        if not quiet:
            say(text, err=True)

    hard_command(cases or (), out, json, quick, tell)
