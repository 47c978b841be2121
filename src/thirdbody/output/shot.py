"""What a picture shows, taken from a run: wrapped spheres, colours, plates, words. No drawing here."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thirdbody.errors import InputError, nearest
from thirdbody.output.palette import field_colors, rgb, state_colors
from thirdbody.output.run import Run

# About as many bodies can be told apart in a close-up.
CLOSE_UP_BODIES = 60
# Up to so many bodies the view of the whole is close enough.
ENOUGH_WITHOUT_CLOSE_UP = 150

_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


@dataclass(frozen=True)
class Legend:
    """States with their colours and counts, or (when `limits` is set) the ends of a colour scale."""

    title: str
    entries: tuple[tuple[str, str], ...] = ()
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Shot:
    """One frame ready to be drawn, lengths in m: spheres `centers` (S, 3), `radii` (S,), `colors` (S, 3)
    uint8.

    `body` (S,) tells the row of `bodies` (B, 3), the wrapped centres of the bodies; `codes` (B,) their
    states. `low`, `high` (3,) bound the room between the plates, `drag` (2,) is the direction of the upper
    plate or zero.
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
    drag: np.ndarray
    title: str
    facts: str
    legend: Legend

    def inside(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Which spheres (S,) belong to bodies with centres in the window from `low` to `high` (x, y)."""
        chosen = np.all((self.bodies[:, :2] >= low[:2]) & (self.bodies[:, :2] <= high[:2]), axis=1)
        return chosen[self.body]


def take_shot(run: Run, frame: int, color: str) -> Shot:
    """The shot of one frame. Raises IndexError for a frame, InputError for an array that the run has not."""
    bodies, spheres = run.bodies(frame), run.spheres(frame)
    plates = run.plates(frame)["position"]
    row = _rows_of(bodies, spheres["clump"])
    low, high = _room(run, bodies, spheres, plates)
    shift = _wrap(run, bodies["position"])
    rgb_body, legend = _colors(run, frame, color, bodies, spheres, row)
    return Shot(
        centers=spheres["position"] - shift[row],
        radii=np.asarray(spheres["radius"], np.float64),
        colors=rgb_body,
        body=row,
        bodies=bodies["position"] - shift,
        codes=bodies["state"] if "state" in bodies else np.zeros(len(shift), np.uint8),
        low=low,
        high=high,
        has_plates=len(plates) > 0,
        drag=_drag(run, frame, plates),
        title=str(run.header.get("title", "")),
        facts=_facts(run, frame, len(shift)),
        legend=legend,
    )


def _rows_of(bodies: dict[str, np.ndarray], clump: np.ndarray) -> np.ndarray:
    """The row of each sphere's body: spheres name their body by its id, and rows may be in any order."""
    if "id" not in bodies:
        return clump.astype(np.int64)
    order = np.argsort(bodies["id"])
    return order[np.searchsorted(bodies["id"][order], clump)]


def _domain(run: Run) -> tuple[np.ndarray | None, bool]:
    domain = run.header.get("domain")
    if not domain:
        return None, False
    return np.asarray(domain["size"], np.float64), bool(domain.get("periodic", True))


def _wrap(run: Run, position: np.ndarray) -> np.ndarray:
    """What to subtract (B, 3) so that each body's centre lies in the periodic domain; bodies stay whole."""
    size, periodic = _domain(run)
    shift = np.zeros_like(position)
    if periodic and size is not None:
        shift[:, :2] = np.floor(position[:, :2] / size) * size
    return shift


def _room(
    run: Run, bodies: dict[str, np.ndarray], spheres: dict[str, np.ndarray], plates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner of what lies between the plates."""
    size, periodic = _domain(run)
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
        low[2], high[2] = plates[:4, 2].mean(), plates[4:, 2].mean()
    return low, high


def _drag(run: Run, frame: int, plates: np.ndarray) -> np.ndarray:
    """Unit direction (x, y) in which the upper plate went since the frame before, or zero."""
    number = run.frame_number(frame)
    if not len(plates) or run.frames < 2:
        return np.zeros(2)
    first, last = (number - 1, number) if number else (0, 1)
    step = (run.plates(last)["position"] - run.plates(first)["position"])[4:, :2].mean(axis=0)
    length = float(np.hypot(*step))
    extent = float(np.ptp(plates[4:, :2], axis=0).max())
    # Below the rounding of the corners' coordinates there is no direction.
    return step / length if length > 1e-12 * extent else np.zeros(2)


def _colors(
    run: Run,
    frame: int,
    color: str,
    bodies: dict[str, np.ndarray],
    spheres: dict[str, np.ndarray],
    row: np.ndarray,
) -> tuple[np.ndarray, Legend]:
    if color == "state" and "state" in bodies:
        names = run.state_names
        palette = np.array([rgb(c) for c in state_colors(names)], np.uint8)
        counts = np.bincount(bodies["state"], minlength=len(names))
        total = max(1, int(counts.sum()))
        entries = [
            (f"{name}  {count}  ({100.0 * count / total:.0f} %)", tone)
            for name, count, tone in zip(names, counts, state_colors(names), strict=False)
        ]
        return palette[bodies["state"]][row], Legend("state", tuple(entries))
    values = _field(run, frame, color, bodies, spheres, row)
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    # A field of one value takes the middle colour.
    shares = (values - low) / (high - low) if high > low else values - low + 0.5
    unit = run.header["units"].get(color)
    title = color.replace("_", " ") + (f", {unit}" if unit and unit != "1" else "")
    return field_colors(shares), Legend(title, limits=(low, high))


def _field(
    run: Run,
    frame: int,
    name: str,
    bodies: dict[str, np.ndarray],
    spheres: dict[str, np.ndarray],
    row: np.ndarray,
) -> np.ndarray:
    """One value per sphere: its body's, its own, or the largest of its body's contacts. Vectors by length."""
    source = "velocity" if name == "speed" else name
    contacts = run.contacts(frame)
    if source in bodies:
        values = bodies[source][row]
    elif source in spheres:
        values = spheres[source]
    elif source in contacts and "body" in contacts:
        values = _largest_of_contacts(contacts, _length(contacts[source]), bodies)[row]
    else:
        known = (set(bodies) | set(spheres) | set(contacts) | {"speed"}) - {"position"}
        raise InputError(f"color: this run has no array '{name}'; {nearest(name, known)}")
    return _length(values)


def _length(values: np.ndarray) -> np.ndarray:
    return np.linalg.norm(values, axis=1) if values.ndim == 2 else values.astype(np.float64)


def _largest_of_contacts(
    contacts: dict[str, np.ndarray], values: np.ndarray, bodies: dict[str, np.ndarray]
) -> np.ndarray:
    """The largest value (B,) among each body's contacts, NaN without; a plate is a partner below 0."""
    largest = np.full(len(bodies["position"]), -np.inf)
    for side in ("body", "partner"):
        if side in contacts:
            real = contacts[side] >= 0
            np.maximum.at(largest, _rows_of(bodies, contacts[side][real]), values[real])
    return np.where(np.isneginf(largest), np.nan, largest)


def _facts(run: Run, frame: int, count: int) -> str:
    number = run.frame_number(frame)
    facts = [f"time {with_unit(run.times[number], 's')}"]
    if "distance" in run.series:
        facts.append(f"sliding distance {with_unit(run.series['distance'][number], 'm')}")
    friction = run.series.get("friction_coefficient")
    if friction is not None and np.isfinite(friction[number]):
        facts.append(f"friction coefficient {friction[number]:.2f}")
    facts.append(f"{count} particle{'s' if count != 1 else ''}")
    return "   ·   ".join(facts)


def with_unit(value: float, unit: str) -> str:
    """A number with three figures and an SI prefix: 1.25e-05, "m" -> "12.5 µm"."""
    value = float(value)
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g} {unit}"
    rounded = float(f"{value:.2e}")
    power = min(9, max(-12, 3 * math.floor(math.log10(abs(rounded)) / 3)))
    return f"{rounded / 10.0**power:.3g} {_PREFIXES[power]}{unit}"


def round_length(longest: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `longest`."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * (1.0 + 1e-9))


def close_up_window(shot: Shot) -> tuple[np.ndarray, np.ndarray] | None:
    """Corners (x, y) of the part to enlarge: about 60 bodies, where states mix most; None for few bodies."""
    count = len(shot.bodies)
    if count <= ENOUGH_WITHOUT_CLOSE_UP:
        return None
    extent = shot.high[:2] - shot.low[:2]
    side = math.sqrt(CLOSE_UP_BODIES / count * extent[0] * extent[1])
    # Deeper than wide: seen at an angle it then fills a square panel.
    half = np.minimum(0.5 * side * np.array([0.85, 1.0 / 0.85]), 0.5 * extent)
    places = [
        np.array([x, y])
        for x in np.linspace(shot.low[0] + half[0], shot.high[0] - half[0], 9)
        for y in np.linspace(shot.low[1] + half[1], shot.high[1] - half[1], 7)
    ]
    middle = max(places, key=lambda place: _mixture(shot, place - half, place + half))
    return middle - half, middle + half


def _mixture(shot: Shot, low: np.ndarray, high: np.ndarray) -> float:
    """Entropy of the states in a window, times the share of its bodies; Shannon (1948)."""
    chosen = np.all((shot.bodies[:, :2] >= low) & (shot.bodies[:, :2] <= high), axis=1)
    counts = np.bincount(shot.codes[chosen]).astype(np.float64)
    if not counts.sum():
        return -1.0
    shares = counts[counts > 0] / counts.sum()
    return float(-(shares * np.log(shares)).sum()) + 1e-3 * min(1.0, counts.sum() / CLOSE_UP_BODIES)
