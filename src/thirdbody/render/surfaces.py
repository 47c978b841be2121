"""Plates in pictures: surfaces of rough ones as meshes, and maps of what a measure has left on them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thirdbody.errors import InputError, nearest
from thirdbody.palette import mixed
from thirdbody.plot.figures import save
from thirdbody.trajectory.names import LOWER_PLATE, PLATES
from thirdbody.trajectory.read_blocks import rows_of
from thirdbody.trajectory.run_file import RunFile
from thirdbody.trajectory.summary import NO_MAPS, maps_of_cycles
from thirdbody.units import prefix_for, quantity_text, with_unit

if TYPE_CHECKING:
    import pyvista

# Colours of the lowest and highest points: greys, so that the colours of states stand out.
HEIGHTS = ("#47536A", "#FFFDF7")
FINEST = 700  # largest number of points along the longer side of a mesh
SHADE = 0.30  # fraction of black under a sphere
# Colour of contacts on a rough plate, and the smallest radius at which they are drawn, over the mean radius of spheres.
CONTACT, SMALLEST_CONTACT = "#1D1F23", 0.05
DOTS = 100  # pixels per inch
DARK = 0.15  # part of the colour scale that is cut off where nothing lies, so that a faint trace stands out


class Touching(NamedTuple):
    """Contacts with a plate: points (C, 3), wrapped with their bodies, drawn radii (C,) [m], slopes of the plate (C, 2).

    `body` (C,): rows of their bodies.
    """

    points: np.ndarray
    radius: np.ndarray
    slopes: np.ndarray
    body: np.ndarray


@dataclass(frozen=True, eq=False)
class PlateSurface:
    """Spline coefficients (n_y, n_x) [m] of a plate's surface, its period along x and y, its place in a frame (3,) [m].

    `sign` is 1 for the lower plate and -1 for the upper one, whose heights point down. `low`, `high`: its extreme heights [m].
    """

    coefficients: np.ndarray
    size: tuple[float, float]
    position: np.ndarray
    sign: float
    low: float
    high: float

    def heights(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return heights over the mean plane [m] at points of the frame."""
        from scipy.ndimage import map_coordinates

        n_y, n_x = self.coefficients.shape
        at = [(y - self.position[1]) * n_y / self.size[1], (x - self.position[0]) * n_x / self.size[0]]
        return np.asarray(map_coordinates(self.coefficients, at, order=3, mode="grid-wrap", prefilter=False))

    def slopes(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the slopes of the heights along x and y, by differences over a grid cell."""
        a, b = (0.5 * length / n for length, n in zip(self.size, self.coefficients.shape[::-1], strict=True))
        along = (self.heights(x + a, y) - self.heights(x - a, y)) / (2.0 * a)
        return along, (self.heights(x, y + b) - self.heights(x, y - b)) / (2.0 * b)

    def colors(self, heights: np.ndarray) -> np.ndarray:
        """Return colours (..., 3) uint8 of heights."""
        return mixed(HEIGHTS, (heights - self.low) / max(self.high - self.low, 1e-300))


def read_plate_surfaces(run: RunFile, frame: int) -> dict[str, PlateSurface]:
    """Return the surfaces of the rough plates at their places in a frame."""
    return {
        side: PlateSurface(
            surface.coefficients, surface.size, run.surface_position(side, frame), 1.0 if side == "lower" else -1.0,
            float(surface.heights.min()), float(surface.heights.max()),
        )
        for side, surface in run.surfaces_at(frame).items()
    }  # fmt: skip


def read_touching(
    run: RunFile, frame: int, bodies: dict[str, np.ndarray], shift: np.ndarray, surface: PlateSurface, smallest: float
) -> Touching:
    """Return the loaded contacts with the lower plate; `shift` (B, 3) is subtracted to wrap bodies, `smallest`: radius [m]."""
    contacts = run.block("contacts", frame)
    chosen = (contacts["partner"] == LOWER_PLATE) & (contacts["normal_force"] > 0.0)
    row = rows_of(bodies, contacts["body"][chosen])
    points = contacts["position"][chosen] - shift[row]
    slopes = np.column_stack(surface.slopes(points[:, 0], points[:, 1]))
    return Touching(points, np.maximum(contacts["contact_radius"][chosen], smallest), slopes, row)


def window_mesh(
    surface: PlateSurface, low: np.ndarray, high: np.ndarray, centers: np.ndarray, radii: np.ndarray
) -> pyvista.StructuredGrid:
    """Return the surface over a window from `low` to `high` (x, y), with the array `color`; lengths in m.

    `centers` (n, 3), `radii` (n,): spheres under which it is darker.
    """
    import pyvista

    extent = high[:2] - low[:2]
    counts = np.maximum(2, np.rint(FINEST * extent / extent.max()).astype(int))
    x, y = (np.linspace(a, b, n) for a, b, n in zip(low[:2], high[:2], counts, strict=True))
    grid_x, grid_y = np.meshgrid(x, y)
    heights = surface.heights(grid_x, grid_y)
    covered = np.zeros(heights.shape)  # 1 below a sphere
    for (a, b, _), radius in zip(centers, radii, strict=True):
        columns, rows = (slice(*np.searchsorted(axis, [at - radius, at + radius])) for axis, at in ((x, a), (y, b)))
        covered[rows, columns] += (x[None, columns] - a) ** 2 + (y[rows, None] - b) ** 2 < radius**2
    colors = surface.colors(heights) * (1.0 - SHADE * np.minimum(covered, 1.0))[..., None]
    z = surface.position[2] + surface.sign * heights
    mesh = pyvista.StructuredGrid(grid_x, grid_y, z)
    mesh.point_data["color"] = np.rint(colors).astype(np.uint8).swapaxes(0, 1).reshape(-1, 3)
    return mesh


def skirt(mesh: pyvista.StructuredGrid, z: float) -> pyvista.PolyData:
    """Return the walls from the edge of a mesh to a plane."""
    import pyvista

    n_x, n_y, _ = mesh.dimensions
    number = np.arange(n_x * n_y).reshape(n_y, n_x)
    edge = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])
    top = np.asarray(mesh.points)[edge]
    bottom = np.insert(top[:, :2], 2, z, axis=1)
    k, n = np.arange(len(edge)), len(edge)
    after = np.roll(k, -1)
    faces: Any = np.column_stack([k, after, after + n, k + n])
    return pyvista.PolyData.from_regular_faces(np.concatenate([top, bottom]), faces)


def draw_plate_map(run: RunFile, file: Path, options: Any) -> Path:
    """Write the picture of a map along the plate's normal; the upper plate is seen from above, through it.

    Coordinates are the plate's own. With `cycles` the map is that of so many cycles at the rate of the whole cycles of the run,
    without the first one: an extrapolation, and the title says so. Raises InputError for a plate or a map that the run does not
    have, OutputError.

    Of the options (`render.PictureOptions`): `plate`, `color` (name of the map), `frame`, `size` in pixels, `cycles` (None: the
    map of the frame).
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure

    # `state`, the default, is no map
    name = next(iter(run.map_units)) if options.color == "state" and run.map_units else options.color
    values, title = plate_map(run, options.plate, name, options.frame, options.cycles)
    size, (wide, tall) = run.header["domain"]["size"], options.size
    figure = Figure(figsize=(wide / DOTS, tall / DOTS), dpi=DOTS, layout="constrained")
    axes = figure.add_subplot()
    unit = run.map_units[name]
    scale, unit = prefix_for(float(values.max(initial=0.0)), unit) if unit in ("m", "J/m2") else (1.0, unit)
    extent = (0.0, 1e6 * size[0], 0.0, 1e6 * size[1])
    colors = colormaps["inferno_r"](np.linspace(DARK, 1.0, 256))
    colors[0] = (1.0, 1.0, 1.0, 1.0)  # white where nothing lies, then from light to dark
    image = axes.imshow(
        values * scale, origin="lower", extent=extent, cmap=ListedColormap(colors), vmin=0.0, interpolation="nearest"
    )
    figure.colorbar(image, ax=axes, label=f"{name.replace('_', ' ')} [{unit}]", shrink=0.9)
    axes.set(xlabel="x of the plate [µm]", ylabel="y of the plate [µm]", title=title)
    save(figure, file, DOTS)
    return file


def plate_map(run: RunFile, plate: str, name: str, frame: int | None, cycles: float | None) -> tuple[np.ndarray, str]:
    """Return a map (n_y, n_x) and what it shows, with its mean and largest value.

    Raises InputError for a plate, map or cycles that the run does not have.
    """
    if plate not in PLATES:
        raise InputError(f"plate: no plate '{plate}'; {nearest(plate, PLATES)}")
    if not run.map_units:
        raise InputError(f"{run.path}: {NO_MAPS}")
    if name not in run.map_units:
        raise InputError(f"color: no map '{name}'; {nearest(name, run.map_units)}")
    if cycles is None:
        number = run.frame_number(-1 if frame is None else frame)
        values, words = run.maps(plate, number)[name], f"after {with_unit(run.times[number], 's')}"
    else:
        values = maps_of_cycles(run.drag, plate, cycles)[name]
        words = f"{cycles:g} cycles by the rate of cycles 2 to {len(run.cycles['end_time'])}"
    covered = values[values > 0.0] if values.any() else values
    mean, largest = (quantity_text(float(of(covered)), run.map_units[name]) for of in (np.mean, np.max))
    return values, f"{plate} plate, {words}\nmean {mean} where there is any, largest {largest}"
