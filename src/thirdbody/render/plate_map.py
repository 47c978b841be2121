"""Picture of a map of a plate: what a measure has left on its surface, seen along the plate's normal.

Coordinates are the plate's own; the upper plate is seen from above, through it. With `cycles` the map is that of so many cycles
at the rate of the whole cycles of the run, without the first one: an extrapolation, and the title says so.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.atomic_files import write_whole
from thirdbody.errors import InputError, OutputError, nearest
from thirdbody.trajectory.map_statistics import NO_MAPS, maps_of_cycles
from thirdbody.trajectory.plate_maps import PLATES
from thirdbody.trajectory.reader import Run
from thirdbody.units import GLUE, quantity_text

DOTS = 100.0
"""Pixels per inch."""

DARK = 0.15
"""Part of the colour scale that is cut off where nothing lies, so that a faint trace stands out."""


def draw_plate_map(run: Run, file: Path, plate: str, options: dict[str, Any]) -> Path:
    """Write the picture of a map. Raises InputError for a plate or a map that the run does not have, OutputError.

    `options`: `color` (name of the map), `frame`, `size` in pixels, `cycles` (None: the map of the frame).
    """
    from matplotlib.figure import Figure

    if options["color"] == "state" and run.map_units:  # the default, which is no map
        options["color"] = next(iter(run.map_units))
    values, words = plate_map(run, plate, options["color"], options["frame"], options["cycles"])
    size, (wide, tall) = run.header["domain"]["size"], options["size"]
    figure = Figure(figsize=(wide / DOTS, tall / DOTS), dpi=DOTS, layout="constrained")
    axes = figure.add_subplot()
    scale, unit = _readable(values.max(initial=0.0), run.map_units[options["color"]])
    extent = (0.0, 1e6 * size[0], 0.0, 1e6 * size[1])
    image = axes.imshow(values * scale, origin="lower", extent=extent, cmap=_colors(), vmin=0.0, interpolation="nearest")
    figure.colorbar(image, ax=axes, label=f"{options['color'].replace('_', ' ')} [{unit}]", shrink=0.9)
    axes.set(xlabel="x of the plate [µm]", ylabel="y of the plate [µm]", title=f"{plate} plate, {words}")
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=DOTS)
    try:
        write_whole(file, content.getvalue())
    except OSError as problem:
        raise OutputError(f"{file}: cannot be written ({problem.strerror})") from problem
    return file


def plate_map(run: Run, plate: str, name: str, frame: int | None, cycles: float | None) -> tuple[np.ndarray, str]:
    """Return a map (n_y, n_x) and what it shows. Raises InputError for a plate, map or cycles that the run does not have."""
    if plate not in PLATES:
        raise InputError(f"plate: no plate '{plate}'; {nearest(plate, PLATES)}")
    if not run.map_units:
        raise InputError(f"{run.path}: {NO_MAPS}")
    if name not in run.map_units:
        raise InputError(f"color: no map '{name}'; {nearest(name, run.map_units)}")
    if cycles is None:
        number = run.frame_number(-1 if frame is None else frame)
        return run.maps(plate, number)[name], f"after {quantity_text(run.times[number], 's').replace(GLUE, ' ')}"
    values = maps_of_cycles(run, plate, cycles)[name]
    return values, f"{cycles:g} cycles by the rate of cycles 2 to {len(run.cycles['end_time'])}"


def _readable(largest: float, unit: str) -> tuple[float, str]:
    """Return a factor, and the unit that it gives, for values up to the largest one: a power of 1000."""
    if unit not in ("m", "J/m2") or largest <= 0.0:
        return 1.0, unit
    prefixes = {0: "", 1: "m", 2: "µ", 3: "n", 4: "p", 5: "f", -1: "k", -2: "M"}
    power = int(np.clip(-np.floor(np.log10(largest) / 3.0), -2, 5))
    return 1000.0**power, f"{prefixes[power]}{unit}"


def _colors() -> Any:
    """Return the colours: white where nothing lies, then from light to dark."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    scale = colormaps["inferno_r"](np.linspace(DARK, 1.0, 256))
    scale[0] = (1.0, 1.0, 1.0, 1.0)
    return ListedColormap(scale)
