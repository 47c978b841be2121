"""Command `thirdbody map`: regimes of a three-spot particle (sticking, sliding, rolling), by theory and by full solution."""

import json as js
import sys
from pathlib import Path
from typing import Annotated

import typer

from thirdbody.plugin import OutputError, UsageError

from .balance_command import check_format
from .regime_map import computed_points, draw_map, map_numbers

PICTURE = Path("map.png")
LARGEST = 1e6


def map_command(
    out: Annotated[Path | None, typer.Option("-o", "--out", help="picture to write: png, pdf or svg [map.png]")] = None,
    big_h: Annotated[float, typer.Option("--H", help="H = mu h/x_1 of Fig. 2")] = 1.0,
    half_width: Annotated[float, typer.Option("--half-width", help="lower spots at -+ this, over the height h")] = 0.5,
    computed: Annotated[bool, typer.Option("--computed", help="put particles on it that were solved with partial slip")] = False,
    json: Annotated[bool, typer.Option("--json", help="print the numbers as JSON; a picture only with -o")] = False,
) -> None:
    """Draw the map of regimes over friction and geometry, and the paper's second figure."""
    if not abs(big_h) <= LARGEST:
        raise UsageError(f"--H {big_h}: must lie between -{LARGEST:g} and {LARGEST:g}")
    if not 1.0 / LARGEST <= half_width <= LARGEST:
        raise UsageError(f"--half-width {half_width}: must lie between {1.0 / LARGEST:g} and {LARGEST:g}")
    picture = out if out is not None or json else PICTURE
    if picture is not None:
        check_format(picture)
        try:
            draw_map(picture, big_h, half_width, computed_points(half_width) if computed else ())
        except OSError as error:
            raise OutputError(f"{picture}: {error.strerror or error}") from error
    if json:
        print(js.dumps(map_numbers(big_h, half_width), indent=1))
    if picture is not None:
        print(picture, file=sys.stderr if json else sys.stdout)
