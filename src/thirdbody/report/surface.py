"""Report of `thirdbody surface`: statistics, conversion and picture of a measured surface, or of that of a plate."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from thirdbody.atomic_files import write_output
from thirdbody.errors import UsageError
from thirdbody.plot.figures import FORMATS
from thirdbody.report.tables import print_json, table
from thirdbody.scene.model import Scene
from thirdbody.surfaces.reading import npz_bytes, read_any_scan
from thirdbody.surfaces.scan import HeightMap, fill_missing, levelled
from thirdbody.surfaces.statistics import Statistics, surface_statistics, with_spectrum
from thirdbody.system.terminal import print_line
from thirdbody.trajectory.run_file import RunFile
from thirdbody.units import pretty

SCAN = ".npz"


class Described(NamedTuple):
    """A surface with its statistics: what is drawn and printed. Heights (n_y, n_x) [m], spacing [m], notes."""

    name: str
    heights: np.ndarray
    spacing: tuple[float, float]
    statistics: Statistics
    notes: Sequence[str] = ()


def surface_report(
    path: Path, out: Sequence[Path], plate: str | None, grid: tuple[str | None, str | None], settings: Mapping[str, str],
    plugins: Sequence[Path], json: bool,
) -> None:  # fmt: skip
    """Print the statistics of a measured surface, or of that of a plate of a scene, or of a run at its end; write and draw it
    into the files `out`.

    `grid`: unit, and distance of points, of a file that names none. Raises UsageError for options that do not belong to the file.
    """
    of_plate = path.suffix.lower() in (".toml", ".vtkhdf") or path.is_dir()
    kinds = {target: target.suffix.lower() for target in out}
    for target, kind in kinds.items():
        if kind not in (*FORMATS, SCAN):
            raise UsageError(f"{target}: expected a picture ({', '.join(FORMATS)}) or a height map ({SCAN})")
    if plate is not None and not of_plate:
        raise UsageError("--plate: for a scene or a run; a file holds one surface")
    if grid != (None, None) and of_plate:
        raise UsageError("--unit, --spacing: for a file of a measured surface")
    scan, one = _plate(path, plate, settings, plugins) if of_plate else _measured(path, *grid)
    for target in (target for target, kind in kinds.items() if kind == SCAN):
        write_output(target, npz_bytes(scan))
    _print(one, json)
    for target in (target for target, kind in kinds.items() if kind in FORMATS):
        from thirdbody.plot.surface_plot import draw_surface

        draw_surface(target, one.name, one.heights, one.spacing, one.statistics)
    for target in out:
        print_line(target, err=json)


def _measured(path: Path, unit: str | None, spacing: str | None) -> tuple[HeightMap, Described]:
    scan = read_any_scan(path, unit, spacing)
    heights = levelled(fill_missing(scan.heights), "plane")
    notes = [*scan.notes, "after subtraction of the plane of least squares"]
    if scan.missing:
        notes.append(f"{100.0 * scan.missing:.2g} % of the points have no height; filled here from their surroundings")
    statistics = surface_statistics(heights, scan.spacing, periodic=False)
    whole = with_spectrum(statistics, heights, scan.spacing, periodic=False)
    return scan, Described(path.name, heights, scan.spacing, whole, notes)


def _plate(path: Path, plate: str | None, settings: Mapping[str, str], plugins: Sequence[Path]) -> tuple[HeightMap, Described]:
    from thirdbody.assembly.surfaces import plate_surfaces  # imports the engine, which a file needs not

    if path.suffix.lower() == ".toml":
        surfaces = plate_surfaces(Scene.load(path, plugins).with_settings(settings))
    else:
        with RunFile(path) as run:
            surfaces = run.surfaces_at()
    if not surfaces:
        raise UsageError(f"{path}: both plates are flat: add plates.lower.surface or plates.upper.surface")
    side = plate or next(iter(surfaces))
    if side not in surfaces:
        raise UsageError(f"--plate {side}: this plate is flat; {next(iter(surfaces))} has a surface")
    surface = surfaces[side]
    statistics = with_spectrum(surface.statistics, surface.one_copy, surface.spacing)
    one = Described(f"{path.name}, {side} plate", surface.heights, surface.spacing, statistics, surface.notes)
    return HeightMap(surface.heights, surface.spacing, side), one


def _print(one: Described, json: bool) -> None:
    n_y, n_x = one.heights.shape
    size = n_x * one.spacing[0], n_y * one.spacing[1]
    if json:
        grid = {"name": one.name, "points": [n_x, n_y], "spacing": list(one.spacing), "notes": list(one.notes)}
        print_json(grid | one.statistics.document())
        return
    s, radius = one.statistics, lambda curvature: pretty(1.0 / curvature, "length") if curvature > 0.0 else "infinite"
    rows = [
        ("size", f"{pretty(size[0], 'length')} by {pretty(size[1], 'length')}"),
        ("points", f"{n_x} by {n_y}, {pretty(one.spacing[0], 'length')} and {pretty(one.spacing[1], 'length')} apart"),
        ("rms height", pretty(s.rms_height, "length")),
        ("highest, lowest", f"{pretty(s.highest, 'length')}, {pretty(s.lowest, 'length')} over the mean"),
        ("skewness, kurtosis", f"{s.skewness:.3g}, {s.kurtosis:.3g} (Gaussian: 0, 3)"),
        ("rms slope, largest", f"{s.rms_slope:.3g}, {s.max_slope:.3g}"),
        ("rms mean curvature", f"1/{radius(s.rms_curvature)}"),
        ("sharpest crest, valley", f"radius {radius(s.crest_curvature)}, {radius(s.valley_curvature)}"),
        ("spectrum", law_text(s)),
    ]
    table(one.name, ("", ""), rows)
    for note in one.notes:
        print_line(note)


def law_text(statistics: Statistics) -> str:
    """Describe the power law of a spectrum."""
    law = statistics.law
    if law is None:
        return "follows no power law"
    above = f"flat above {pretty(law.long, 'length')}" if law.rolls_off else f"no roll-off up to {pretty(law.long, 'length')}"
    doubt = "" if law.is_certain else "; uncertain, as the band is narrow"
    return f"Hurst exponent {law.hurst:.2f} from {pretty(law.long, 'length')} to {pretty(law.short, 'length')}, {above}{doubt}"
