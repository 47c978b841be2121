"""Data of a picture, read from a run: wrapped spheres, colours, plates, title and legend. No drawing here."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from thirdbody.errors import InputError
from thirdbody.render.coloring import Arrays, Legend, LegendScale, compute_coloring
from thirdbody.render.force_tubes import Tubes, force_tubes
from thirdbody.render.surface_mesh import PlateSurface, Touching, read_plate_surfaces
from thirdbody.trajectory.names import LOWER_PLATE
from thirdbody.trajectory.reader import Run
from thirdbody.trajectory.rebuilt_spheres import rows_of
from thirdbody.trajectory.state_groups import code_name
from thirdbody.units import quantity_text, with_unit

Window = tuple[np.ndarray, np.ndarray]
"""Lowest and highest corner (2,) of a part of the domain [m]."""

MAX_COORDINATE = 1e6
"""Largest coordinate, or radius, of any drawn object [m]."""

VIEWS = ("iso", "side", "front", "top")
"""Names of the camera's positions."""

FREE_SCALE = LegendScale()
"""Scale of a single picture: its colour scale follows from its frame."""

_CLOSE_UP_BODIES = 60
"""Number of bodies, about, that can be distinguished in a close-up."""
_WITHOUT_CLOSE_UP = 150
"""Up to this number of bodies the view of the whole is close enough."""
_WIDEST_SLICE = 0.8
"""A slice wider than this fraction of the domain, as one of a deep bed, would show the whole again."""


@dataclass(frozen=True)
class PictureData:
    """Data of one frame for drawing, lengths in m: spheres `centers` (S, 3), `radii` (S,), `colors` (S, 3) uint8.

    `body` (S,) is the row of each sphere's body in `bodies` (B, 3), the wrapped centres; `codes` (B,) are the states, `ids` (B,)
    and `labels` (B, or none) name the bodies. `low`, `high` (3,) bound the space between the plates, `plate` [m] is the height of
    the upper one, `drag` (2,) its direction or zero. `surfaces`: those of rough plates; `touching`: contacts with
    the lower one.
    """

    centers: np.ndarray
    radii: np.ndarray
    colors: np.ndarray
    body: np.ndarray
    bodies: np.ndarray
    codes: np.ndarray
    low: np.ndarray
    high: np.ndarray
    has_plates: bool
    has_upper: bool
    plate: float
    drag: np.ndarray
    title: str
    facts: str
    legend: Legend
    ids: np.ndarray
    labels: tuple[str, ...] = ()
    tubes: Tubes | None = None
    surfaces: Mapping[str, PlateSurface] = field(default_factory=dict)
    touching: Touching | None = None

    def inside(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return the spheres (S,), bool, of bodies with centres in the window from `low` to `high` (x, y)."""
        return self.bodies_inside(low, high)[self.body]

    def bodies_inside(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return the bodies (B,), bool, with centres in the window from `low` to `high` (x, y)."""
        return np.all((self.bodies[:, :2] >= low[:2]) & (self.bodies[:, :2] <= high[:2]), axis=1)

    def plate_height_over(self, low: np.ndarray, high: np.ndarray) -> float:
        """Return the height at which the upper plate is drawn over a window [m].

        Where each body carries a separate patch the plate's height is their mean: it is drawn over the highest body.
        """
        chosen = self.inside(low, high)
        tops = self.centers[chosen] + self.radii[chosen, None] * [0.0, 0.0, 1.0]
        return max(self.plate, float(self.plate_height_at(tops).max(initial=-np.inf)))

    def plate_height_at(self, points: np.ndarray) -> np.ndarray:
        """Return the heights of the upper plate's plane (n,) [m] at which its surface passes through points (n, 3)."""
        upper = self.surfaces.get("upper")
        return np.asarray(points[:, 2] + (upper.heights(points[:, 0], points[:, 1]) if upper else 0.0))


def read_picture_data(run: Run, frame: int, color: str, forces: bool = False, scale: LegendScale = FREE_SCALE) -> PictureData:
    """Return the data of the picture of one frame, optionally with contact forces; `scale` is that of its film.

    Raises IndexError for the frame, InputError for an unknown array.
    """
    bodies, spheres = run.bodies(frame), run.spheres(frame)
    plates = run.plates(frame)["position"]
    refuse_lost(run, frame, bodies, spheres)
    row = rows_of(bodies, spheres["clump"])
    low, high = _bounds(run, bodies, spheres, plates)
    shift = _wrap_shift(run, bodies["position"])
    coloring = compute_coloring(run, frame, color, bodies, spheres, row, scale)
    size, periodic = domain_of(run)
    return PictureData(
        centers=spheres["position"] - shift[row],
        radii=np.asarray(spheres["radius"], np.float64),
        colors=coloring.colors(coloring.values),
        body=row,
        bodies=bodies["position"] - shift,
        codes=bodies["state"] if "state" in bodies else np.zeros(len(shift), np.uint8),
        low=low,
        high=high,
        has_plates=len(plates) > 0,
        has_upper=len(plates) > 4,
        plate=float(plates[4:, 2].mean()) if len(plates) > 4 else float(high[2]),
        drag=_drag(run, frame, plates),
        title=str(run.header.get("title", "")),
        facts=_facts(run, frame, len(shift)),
        legend=coloring.legend,
        ids=bodies["id"] if "id" in bodies else np.arange(len(shift)),
        labels=_labels(run, bodies),
        tubes=force_tubes(run.contacts(frame), bodies, shift, size if periodic else None, coloring) if forces else None,
        surfaces=read_plate_surfaces(run, frame),
        touching=_touching(run, frame, bodies, shift) if "lower" in run.surfaces else None,
    )


def _touching(run: Run, frame: int, bodies: Arrays, shift: np.ndarray) -> Touching:
    """Return the loaded contacts with the lower plate."""
    contacts = run.block("contacts", frame)
    chosen = (contacts["partner"] == LOWER_PLATE) & (contacts["normal_force"] > 0.0)
    row = rows_of(bodies, contacts["body"][chosen])
    return Touching(contacts["position"][chosen] - shift[row], contacts["contact_radius"][chosen], row)


def refuse_lost(run: Run, frame: int, bodies: Arrays, spheres: Arrays) -> None:
    """Raise InputError for a frame with a body without a valid position, as a damaged file may hold it."""
    for what, values in (("body", bodies["position"]), ("sphere", spheres["position"]), ("sphere", spheres["radius"][:, None])):
        lost = np.flatnonzero(~np.all(np.abs(values) <= MAX_COORDINATE, axis=1))  # includes NaN
        if len(lost):
            position = ", ".join(f"{x:.3g}" for x in values[lost[0]])
            raise InputError(f"{run.path}: frame {frame} cannot be drawn: {what} {lost[0]} is at {position}")
    if len(spheres["radius"]) and not spheres["radius"].min() > 0.0:
        raise InputError(f"{run.path}: frame {frame} cannot be drawn: sphere {int(np.argmin(spheres['radius']))} has no radius")


def _labels(run: Run, bodies: Arrays) -> tuple[str, ...]:
    """Return state, reason and, if there are several, population of each body in words; none without a labeller."""
    if "state" not in bodies:
        return ()
    words = [run.state_names[code] for code in bodies["state"]]
    if "state_reason" in bodies:
        reasons = [run.reason_names[code].replace("_", " ") for code in bodies["state_reason"]]
        words = [state if reason == "none" else f"{state} ({reason})" for state, reason in zip(words, reasons, strict=True)]
    if "population" in bodies and len(run.population_names) > 1:
        names = [code_name(run.population_names, int(code)) for code in bodies["population"]]
        words = [f"{word}, {name}" for word, name in zip(words, names, strict=True)]
    return tuple(words)


def domain_of(run: Run) -> tuple[np.ndarray | None, bool]:
    """Return the size (2,) of the domain [m], None without, and whether it is periodic."""
    domain = run.header.get("domain")
    if not domain:
        return None, False
    try:
        return np.asarray(domain["size"], np.float64), bool(domain.get("periodic", True))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{run.path}: damaged: its scene names no size of the domain ({error!r})") from error


def _wrap_shift(run: Run, position: np.ndarray) -> np.ndarray:
    """Return the vectors (B, 3) to subtract so that each body's centre lies in the periodic domain; bodies stay whole."""
    size, periodic = domain_of(run)
    shift = np.zeros_like(position)
    if periodic and size is not None:
        shift[:, :2] = np.floor(position[:, :2] / size) * size
    return shift


def _bounds(run: Run, bodies: Arrays, spheres: Arrays, plates: np.ndarray) -> Window:
    """Return the lowest and highest corner of the space between the plates."""
    size, periodic = domain_of(run)
    radius = spheres["radius"][:, None]
    if len(radius):
        low, high = (spheres["position"] - radius).min(axis=0), (spheres["position"] + radius).max(axis=0)
    else:
        low, high = np.zeros(3), np.ones(3)
    if size is not None:
        low[:2], high[:2] = 0.0, size
    elif len(plates):
        low[:2], high[:2] = plates[:4, :2].min(axis=0), plates[:4, :2].max(axis=0)
    if not periodic and len(radius):
        # Bodies that left the plates are shown too.
        low[:2] = np.minimum(low[:2], bodies["position"][:, :2].min(axis=0))
        high[:2] = np.maximum(high[:2], bodies["position"][:, :2].max(axis=0))
    if len(plates):
        low[2], high[2] = plates[:4, 2].mean(), max(high[2], plates[4:, 2].mean() if len(plates) > 4 else high[2])
    return low, high


def _drag(run: Run, frame: int, plates: np.ndarray) -> np.ndarray:
    """Return the unit direction (x, y) of the upper plate's motion since the previous frame, or zero."""
    number = run.frame_number(frame)
    if len(plates) < 8 or run.frames < 2:
        return np.zeros(2)
    first, last = (number - 1, number) if number else (0, 1)
    step = (run.plates(last)["position"] - run.plates(first)["position"])[4:, :2].mean(axis=0)
    length = float(np.hypot(*step))
    extent = float(np.ptp(plates[4:, :2], axis=0).max())
    # Below the rounding of the corners' coordinates there is no direction.
    return step / length if length > 1e-12 * extent else np.zeros(2)


def _facts(run: Run, frame: int, count: int) -> str:
    number = run.frame_number(frame)
    facts = [f"time {with_unit(run.times[number], 's')}"]
    if "distance" in run.series:
        facts.append(f"sliding distance {with_unit(run.series['distance'][number], 'm')}")
    if math.isfinite(run.friction.value):  # of the run, not of this frame
        facts.append(f"friction coefficient {run.friction.short_text}")
    of = f" of {run.scene_bodies}" if count < run.scene_bodies else ""
    facts.append(f"{count}{of} particle{'s' if count != 1 else ''}")
    if surface := run.surface("lower"):
        low, high = (quantity_text(float(z), "m") for z in (surface.heights.min(), surface.heights.max()))
        facts.append(f"lower plate {low} to {high}, dark to light")
    return "   ·   ".join(facts)


def close_up_window(data: PictureData) -> Window | None:
    """Return the part to enlarge: about 60 bodies, where states mix most; None for few bodies."""
    count = len(data.bodies)
    if count <= _WITHOUT_CLOSE_UP:
        return None
    extent = data.high[:2] - data.low[:2]
    side = math.sqrt(_CLOSE_UP_BODIES / count * extent[0] * extent[1])
    # Deeper than wide: seen at an angle it then fills a square panel.
    return _best_mixed(data, np.minimum(0.5 * side * np.array([0.85, 1.0 / 0.85]), 0.5 * extent), (9, 7))


def slice_window(data: PictureData, along: int) -> Window | None:
    """Return the part to enlarge from the side: a dozen bodies along an axis (0 or 1), few deep.

    None for few bodies, and for a bed so deep that the part would be nearly the whole.
    """
    if len(data.bodies) <= _WITHOUT_CLOSE_UP:
        return None
    extent = data.high - data.low
    half = np.empty(2)
    half[along] = min(5.0 * extent[2], 0.5 * extent[along])
    if 2.0 * half[along] > _WIDEST_SLICE * extent[along]:
        return None
    half[1 - along] = min(1.2 * extent[2], 0.5 * extent[1 - along])
    return _best_mixed(data, half, (12, 12))


def _best_mixed(data: PictureData, half: np.ndarray, counts: tuple[int, int]) -> Window:
    """Return the window of half size (2,), in a grid over the whole domain, in which states mix most."""
    low, high = data.low[:2] + half, data.high[:2] - half
    axes = (np.linspace(a, b, count) for a, b, count in zip(low, high, counts, strict=True))
    middle = max((np.array(point) for point in product(*axes)), key=lambda point: _mixture(data, point - half, point + half))
    return middle - half, middle + half


def _mixture(data: PictureData, low: np.ndarray, high: np.ndarray) -> float:
    """Return the entropy of the states in a window, Shannon (1948); of equal windows the one with more bodies ranks higher."""
    counts = np.bincount(data.codes[data.bodies_inside(low, high)]).astype(np.float64)
    if not counts.sum():
        return -1.0
    fractions = counts[counts > 0] / counts.sum()
    return float(-(fractions * np.log(fractions)).sum()) + 1e-3 * min(1.0, counts.sum() / _CLOSE_UP_BODIES)
