"""The command that describes, converts and draws a surface. Heavy modules are imported inside it, as in `main`."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from thirdbody.cli.option_groups import Json, Plugins, Settings
from thirdbody.system.terminal import print_line


def surface(
    path: Annotated[Path, typer.Argument(metavar="FILE|SCENE", help="measured surface, or scene (TOML) with a rough plate")],
    out: Annotated[
        list[Path] | None,
        typer.Option("--out", "-o", metavar="FILE", help="height map (.npz) or picture (.png, .pdf, .svg); may be repeated"),
    ] = None,
    plate: Annotated[Literal["lower", "upper"] | None, typer.Option("--plate", help="plate of a scene [the rough one]")] = None,
    unit: Annotated[str | None, typer.Option("--unit", help="unit of a file that names none, such as um")] = None,
    spacing: Annotated[
        str | None, typer.Option("--spacing", metavar="LENGTH", help="text: distance of points, or 'x, y'")
    ] = None,
    settings: Settings = None,
    plugin: Plugins = None,
    json: Json = False,
) -> None:
    """Describe a measured surface or that of a scene's plate, convert it to NPZ, draw it."""
    from thirdbody.cli.overrides import override_pairs
    from thirdbody.report.surface import SCENES, check_targets, describe_plate, describe_scan, draw_described, surface_report

    targets = out or []
    check_targets(path, targets, plate, unit or spacing)
    if path.suffix.lower() in SCENES:
        one = describe_plate(path, plate, override_pairs(settings), plugin or (), targets)
    else:
        one = describe_scan(path, unit, spacing, targets)
    surface_report(one, json)
    draw_described(one, targets)
    for target in targets:
        print_line(target, err=json)
