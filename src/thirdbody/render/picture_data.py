"""Data of a picture, read from a run: wrapped spheres, colours, plates, force tubes, title and legend, and those of a close-up.

No drawing here.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from thirdbody.errors import InputError
from thirdbody.palette import SOFT_INK, STATE_COLORS, pale
from thirdbody.render.coloring import Arrays, Legend, compute_coloring
from thirdbody.render.surfaces import SMALLEST_CONTACT, PlateSurface, Touching, read_plate_surfaces, read_touching
from thirdbody.trajectory.read_blocks import rows_of
from thirdbody.trajectory.run_file import RunFile
from thirdbody.trajectory.sampling import ELSEWHERE
from thirdbody.trajectory.states import code_name
from thirdbody.units import with_unit

Window = tuple[np.ndarray, np.ndarray]  # lowest and highest corner (2,) of a part of the domain [m]
MAX_COORDINATE = 1e6  # largest coordinate, or radius, of any drawn object [m]
FREE_SCALE = Legend()  # scale of a single picture: its colour scale follows from its frame
COMMON = 99.0  # percentage of forces that are thinner than the thickest tube


@dataclass(frozen=True)
class Tubes:
    """Segments `start`, `end` (T, 3) [m] with `force` (T,) [N]; `body` (T,) is the row of its body.

    `colors` (T, 3), or None: by the force. `full_scale` is that of the thickest tube; few larger ones are drawn no thicker.
    """

    start: np.ndarray
    end: np.ndarray
    force: np.ndarray
    colors: np.ndarray | None
    body: np.ndarray
    full_scale: float


@dataclass(frozen=True)
class PictureData:
    """Data of one frame for drawing, lengths in m: spheres `centers` (S, 3), `radii` (S,), `colors` (S, 3) uint8.

    `body` (S,) is the row of each sphere's body in `bodies` (B, 3), the wrapped centres; `codes` (B,) are the states, `ids` (B,)
    and `labels` (B, or none) name the bodies. `low`, `high` (3,) bound the space between the plates, `plate` [m] is the height of
    the upper one, `drag` (2,) its direction or zero. `surfaces`: those of rough plates; `touching`: contacts with
    the lower one. `quaternions` (B, 4), where the run has them.
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
    quaternions: np.ndarray | None = None
    outline: np.ndarray | None = None  # (n, 2) of the contact of the first bodies

    def bodies_inside(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return the bodies (B,), bool, with centres in the window from `low` to `high` (x, y)."""
        return np.all((self.bodies[:, :2] >= low[:2]) & (self.bodies[:, :2] <= high[:2]), axis=1)

    def inside(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return the spheres (S,), bool, of these bodies."""
        return self.bodies_inside(low, high)[self.body]

    def plate_height_over(self, low: np.ndarray, high: np.ndarray) -> float:
        """Return the height at which the upper plate is drawn over a window [m].

        Where each body carries a separate patch the plate's height is their mean: it is drawn over the highest body, but for a
        contact with an edge, which bodies outside may exceed.
        """
        if self.outline is not None:
            return self.plate
        chosen = self.inside(low, high)
        tops = self.centers[chosen] + self.radii[chosen, None] * [0.0, 0.0, 1.0]
        return max(self.plate, float(self.plate_height_at(tops).max(initial=-np.inf)))

    def plate_height_at(self, points: np.ndarray) -> np.ndarray:
        """Return the heights of the upper plate's plane (n,) [m] at which its surface passes through points (n, 3)."""
        upper = self.surfaces.get("upper")
        return np.asarray(points[:, 2] + (upper.heights(points[:, 0], points[:, 1]) if upper else 0.0))


FAR = 1e30
"""Period of an open axis [m]: no image of a body is near."""


def read_picture_data(run: RunFile, frame: int, color: str, forces: bool = False, scale: Legend = FREE_SCALE) -> PictureData:
    """Return the data of the picture of one frame, optionally with contact forces; `scale` is that of its film.

    Raises IndexError for the frame, InputError for an unknown array.
    """
    bodies, spheres = run.bodies(frame), run.spheres(frame)
    plates = run.plates(frame)["position"]
    refuse_lost(run, frame, bodies, spheres)
    row = rows_of(bodies, spheres["clump"])
    low, high = _bounds(run, bodies, spheres, plates)
    period = _period(run)
    shift = np.zeros_like(bodies["position"])  # wraps each body's centre into a periodic domain; bodies stay whole
    if period is not None:
        shift[:, :2] = np.where(period < FAR, np.floor(bodies["position"][:, :2] / period) * period, 0.0)
    colors, legend, tube_colors = compute_coloring(run, frame, color, bodies, spheres, row, scale)
    surfaces, touching = read_plate_surfaces(run, frame), None
    ends = (f"{side} plate {with_unit(one.low, 'm')} to {with_unit(one.high, 'm')}" for side, one in surfaces.items())
    heights = f"heights, dark to light: {', '.join(ends)}" if surfaces else ""
    outline = "red outline: contact of the first bodies" if "contact_outline" in run.header else ""
    legend = replace(legend, caption="; ".join(filter(None, (legend.caption, heights, outline))))
    if "lower" in surfaces:
        smallest = SMALLEST_CONTACT * float(np.mean(spheres["radius"])) if len(row) else 0.0
        touching = read_touching(run, frame, bodies, shift, surfaces["lower"], smallest)
    return PictureData(
        centers=spheres["position"] - shift[row],
        radii=np.asarray(spheres["radius"], np.float64),
        colors=colors,
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
        legend=legend,
        ids=bodies["id"] if "id" in bodies else np.arange(len(shift)),
        labels=_labels(run, bodies),
        tubes=force_tubes(run.contacts(frame), bodies, shift, period, tube_colors) if forces else None,
        surfaces=surfaces,
        touching=touching,
        quaternions=bodies.get("quaternion"),
        outline=_contact_outline(run, plates),
    )


def _contact_outline(run: RunFile, plates: np.ndarray) -> np.ndarray | None:
    given = run.header.get("contact_outline")
    if given is None or len(plates) < 8:
        return None
    angle = np.linspace(0.0, 2.0 * np.pi, 73) if given["circle"] else np.arange(0.25, 2.5, 0.5) * np.pi
    corner = np.column_stack((np.cos(angle), np.sin(angle))) * (1.0 if given["circle"] else np.sqrt(2.0))
    return np.array(given["centre"]) + (plates[4] - plates[0])[:2] + corner * np.array(given["half_widths"])


def refuse_lost(run: RunFile, frame: int, bodies: Arrays, spheres: Arrays) -> None:
    """Raise InputError for a frame with a body without a valid position, as a damaged file may hold it."""
    for what, values in (("body", bodies["position"]), ("sphere", spheres["position"]), ("sphere", spheres["radius"][:, None])):
        lost = np.flatnonzero(~np.all(np.abs(values) <= MAX_COORDINATE, axis=1))  # includes NaN
        if len(lost):
            position = ", ".join(f"{x:.3g}" for x in values[lost[0]])
            raise InputError(f"{run.path}: frame {frame} cannot be drawn: {what} {lost[0]} is at {position}")
    if len(spheres["radius"]) and not spheres["radius"].min() > 0.0:
        raise InputError(f"{run.path}: frame {frame} cannot be drawn: sphere {int(np.argmin(spheres['radius']))} has no radius")


def _labels(run: RunFile, bodies: Arrays) -> tuple[str, ...]:
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


def _domain(run: RunFile) -> np.ndarray | None:
    # size (2,) [m], None without
    size = run.header.get("domain", {}).get("size")
    return None if size is None else np.asarray(size, np.float64)


def _period(run: RunFile) -> np.ndarray | None:
    # size (2,) of a periodic domain [m], FAR along an open axis, None without
    size, periodic = _domain(run), np.broadcast_to(run.header.get("domain", {}).get("periodic", True), 2)
    return None if size is None or not periodic.any() else np.where(periodic, size, FAR)


def _bounds(run: RunFile, bodies: Arrays, spheres: Arrays, plates: np.ndarray) -> Window:
    size, radius = _domain(run), spheres["radius"][:, None]
    if len(radius):
        low, high = (spheres["position"] - radius).min(axis=0), (spheres["position"] + radius).max(axis=0)
    else:
        low, high = np.zeros(3), np.ones(3)
    if size is not None:
        low[:2], high[:2] = 0.0, size
    elif len(plates):
        low[:2], high[:2] = plates[:4, :2].min(axis=0), plates[:4, :2].max(axis=0)
    if _period(run) is None and len(radius) and "contact_outline" not in run.header:
        # Bodies that left the plates are shown too.
        low[:2] = np.minimum(low[:2], bodies["position"][:, :2].min(axis=0))
        high[:2] = np.maximum(high[:2], bodies["position"][:, :2].max(axis=0))
    if len(plates):
        low[2], high[2] = plates[:4, 2].mean(), max(high[2], plates[4:, 2].mean() if len(plates) > 4 else high[2])
    return low, high


def _drag(run: RunFile, frame: int, plates: np.ndarray) -> np.ndarray:
    number = run.frame_number(frame)
    if len(plates) < 8 or run.frames < 2:
        return np.zeros(2)
    first, last = (number - 1, number) if number else (0, 1)
    step = (run.plates(last)["position"] - run.plates(first)["position"])[4:, :2].mean(axis=0)
    length = float(np.hypot(*step))
    extent = float(np.ptp(plates[4:, :2], axis=0).max())
    # Below the rounding of the corners' coordinates there is no direction.
    return step / length if length > 1e-12 * extent else np.zeros(2)


def _facts(run: RunFile, frame: int, count: int) -> str:
    number = run.frame_number(frame)
    facts = [f"time {with_unit(run.times[number], 's')}"]
    if "distance" in run.series:
        facts.append(f"sliding distance {with_unit(run.series['distance'][number], 'm')}")
    if math.isfinite(run.friction.value):  # of the run, not of this frame
        facts.append(f"friction coefficient {run.friction.short_text}")
    of = f" of {run.scene_bodies}" if count < run.scene_bodies else ""
    facts.append(f"{count}{of} particle{'s' if count != 1 else ''}")
    return "   ·   ".join(facts)


def force_tubes(
    contacts: Arrays, bodies: Arrays, shift: np.ndarray, period: np.ndarray | None, colors: np.ndarray | None = None
) -> Tubes:
    """Return the tubes of one frame: centre of a body, contact point and, for two bodies, the other centre.

    `shift` (B, 3) is subtracted to wrap bodies, `period` (2,) the periodic domain or None; `colors` (C, 3) are those of
    the contacts. Raises InputError without forces.
    """
    if "force" not in contacts or "body" not in contacts:
        raise InputError("forces: this run recorded no forces of its contacts")
    force = np.linalg.norm(contacts["force"], axis=1)
    own = rows_of(bodies, contacts["body"])
    middle = bodies["position"] - shift
    point = nearest_image(contacts["position"] - shift[own] - middle[own], period) + middle[own]
    pair = contacts["partner"] >= 0
    other = rows_of(bodies, contacts["partner"][pair])
    end = nearest_image(middle[other] - point[pair], period) + point[pair]
    return Tubes(
        start=np.concatenate([middle[own], point[pair]]),
        end=np.concatenate([point, end]),
        force=np.concatenate([force, force[pair]]),
        colors=None if colors is None else np.concatenate([colors, colors[pair]]),
        body=np.concatenate([own, own[pair]]),
        full_scale=float(np.percentile(force, COMMON)) if len(force) else 0.0,
    )


def nearest_image(vectors: np.ndarray, period: np.ndarray | None) -> np.ndarray:
    """Return the shortest periodic images of vectors (n, 3); unchanged without a periodic domain."""
    if period is None:
        return vectors
    short = vectors.copy()
    short[:, :2] -= np.rint(vectors[:, :2] / period) * period
    return short


@dataclass(frozen=True)
class Spots:
    """Contacts of one body, (K, ...).

    `position` [m], inward `normal`, `force` on the body [N], the largest friction `limit` [N], utilisation, radius [m], and the
    name of each partner.
    """

    position: np.ndarray
    normal: np.ndarray
    force: np.ndarray
    limit: np.ndarray
    utilisation: np.ndarray
    radius: np.ndarray
    against: list[str]


@dataclass(frozen=True)
class CloseUpData:
    """Data of one particle for drawing: the picture around it, its centre (3,) and size [m], its contacts and texts."""

    picture: PictureData
    center: np.ndarray
    extent: float
    spots: Spots
    name: str
    label: str
    color: str


def read_close_up(run: RunFile, frame: int, body: int, color: str, scale: Legend = FREE_SCALE) -> CloseUpData:
    """Return the close-up of the body with this id. Raises InputError when it, or recorded contacts, are missing."""
    bodies = run.bodies(frame)
    ids = bodies.get("id", np.arange(len(bodies["position"])))
    if body not in ids:
        raise InputError(f"body: this run has no body {body}; ids are {ids.min()} to {ids.max()}")
    picture = read_picture_data(run, frame, color, scale=scale)
    row, period = int(rows_of(bodies, np.array([body]))[0]), _period(run)
    center = picture.bodies[row]
    # Neighbours across the edge of the domain are drawn on the particle's side.
    moved = nearest_image(picture.bodies - center, period) + center
    own = picture.body == row
    # Contacts in the colour of the state must be visible on it; a number keeps its colour.
    own_colors = pale(picture.colors, 0.30) if picture.legend.limits is None else picture.colors
    colors = np.where(own[:, None], own_colors, pale(picture.colors, 0.75))
    picture = replace(picture, centers=picture.centers + (moved - picture.bodies)[picture.body], bodies=moved, colors=colors)
    reach = np.linalg.norm(picture.centers[own] - center, axis=1) + picture.radii[own]
    spots = read_spots(run, frame, body, bodies["position"][row], period)
    spots = replace(spots, position=spots.position + center)
    state = run.state_names[bodies["state"][row]] if "state" in bodies else ""
    label = picture.labels[row] if picture.labels else ""
    state_color = STATE_COLORS.get(state, SOFT_INK)
    return CloseUpData(picture, center, 2.0 * float(reach.max()), spots, f"particle {body}", label, state_color)


def read_spots(run: RunFile, frame: int, body: int, center: np.ndarray, period: np.ndarray | None) -> Spots:
    """Return the contacts of a body with positions relative to its centre (3,). Raises InputError where one is not recorded."""
    contacts = run.contacts(frame)
    missing = {"body", "partner", "force", "normal", "normal_force", "utilisation", "contact_radius"} - set(contacts)
    if missing:
        raise InputError(f"body: this run recorded no '{sorted(missing)[0]}' of its contacts")
    first, second = contacts["body"] == body, contacts["partner"] == body
    chosen = np.flatnonzero((first | second) & (contacts["normal_force"] > 0.0))
    chosen = chosen[np.argsort(-contacts["normal_force"][chosen], kind="stable")]
    sign = np.where(first[chosen], 1.0, -1.0)[:, None]
    partner = np.where(first[chosen], contacts["partner"][chosen], contacts["body"][chosen])
    names = {-1: "lower plate", -2: "upper plate", ELSEWHERE: "particle not in the file"}
    load, eta = contacts["normal_force"][chosen], contacts["utilisation"][chosen]
    force, normal = contacts["force"][chosen], contacts["normal"][chosen]
    tangential = np.linalg.norm(force - load[:, None] * normal, axis=1)
    # Without tangential force the limit does not follow from the utilisation: the ratio of the other contacts is used.
    known = eta > 1e-6
    ratio = np.divide(tangential, eta * load, out=np.zeros_like(load), where=known)
    ratio[~known] = ratio.max(initial=0.0)
    return Spots(
        position=nearest_image(contacts["position"][chosen] - center, period),
        normal=sign * normal,
        force=sign * force,
        limit=ratio * load,
        utilisation=eta,
        radius=contacts["contact_radius"][chosen],
        against=[names.get(int(number), f"particle {number}") for number in partner],
    )
