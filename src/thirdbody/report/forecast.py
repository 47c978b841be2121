"""Comparison of the forecast of every body, made when the drag starts, with its observed motion, and the conditions for it.

The theory of the forecast treats one particle between two surfaces, pressed by a constant load, at rest but for the drag, on
point contacts. Each condition is a number of the run with the limit up to which forecast and motion agreed as in the table of a
thousand clumps (plugins/three_spot/README.md, "Forecast against fact").
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from thirdbody.errors import InputError
from thirdbody.kernels.tables import CAN_SLIDE, NO_FORECAST
from thirdbody.plot.forecast_plot import Forecasts, draw_forecasts
from thirdbody.trajectory.run_file import RunFile
from thirdbody.units import percent

WATCHED = 40.0
"""Path of the drag, in contact radii of a body, over which its forecast is compared with its motion."""

MAX_NEIGHBOURS = 0.2
"""Fraction of the bodies that touch another one in the watched drag."""
MAX_OVERLAP = 0.005
"""Overlap over radius of curvature, median of the contacts: tilt by unequal overlaps moves the contacts against each other."""
MAX_INERTIA = 0.5
"""m v^2/(mu N a), median of the bodies: inertia at the speed of the drag against the work of friction along a contact radius."""
ROUNDED = 0.01
"""Fraction of the drag that a start between two frames may contribute."""
MIN_FRAMES = 8
"""Frames in the watched drag, median of the bodies: events between two frames are seen only if they roll a window of 4 a."""

ROLLING, SLIDING = "rolling", "sliding"


def compare_forecast(run: RunFile) -> dict[str, Any]:
    """Compare the forecast at the start of the drag (can the body go on without rolling?) with rolling labels within 40 a.

    Keys: `frame` of the forecast, `agree`, `forecast` (number of bodies forecast and watched), `unwatched` (bodies without any
    frame within 40 a), `rolls_as_forecast`, `slides_as_forecast`, `rolls_instead`, `slides_instead` (lists of bodies), and those
    of `_explanation`. Empty when the run has no forecast or no drag.
    """
    start = start_of_drag(run)
    if start is None:
        return {}
    watched, drawn = watched_frames(run, start), forecasts(run)
    rolled = drawn.fact == ROLLING
    groups = {
        "rolls_as_forecast": ~drawn.slides & rolled,
        "slides_as_forecast": drawn.slides & ~rolled,
        "rolls_instead": drawn.slides & rolled,
        "slides_instead": ~drawn.slides & ~rolled,
    }
    unwatched = int(((run.forecast[start] != NO_FORECAST) & ~watched.any(axis=0)).sum())
    lists = {name: drawn.body[members].tolist() for name, members in groups.items()}
    result = {"frame": start, "agree": int(drawn.correct.sum()), "forecast": len(drawn.body), "unwatched": unwatched} | lists
    return result | (_explanation(run, start, watched, drawn) if len(drawn.body) else {})


def _explanation(run: RunFile, start: int, watched: np.ndarray, drawn: Forecasts) -> dict[str, Any]:
    """Return the explanation of an agreement: counts outside the band, with and without neighbours, and the run's conditions.

    Keys: `clear` and `alone`, (agree, forecast) of the bodies outside the 2 % band and of those that meanwhile touch no other;
    `rotated`, the first of these by the measured rotation of `_rotated` instead of the labels (None without orientations);
    `conditions`, a list of dictionaries.
    """
    alone = ~touches_others(run, watched)[drawn.body]
    rotated = _rotated(run, start, watched)
    plain = None if rotated is None else (rotated[drawn.body] != drawn.slides) & drawn.clear
    return {
        "by_rotation": None if plain is None else [int(plain.sum()), int(drawn.clear.sum())],
        "clear": [int((drawn.correct & drawn.clear).sum()), int(drawn.clear.sum())],
        "alone": [int((drawn.correct & drawn.clear & alone).sum()), int((drawn.clear & alone).sum())],
        "conditions": [condition._asdict() for condition in conditions(run, start, watched, drawn)],
    }


def forecasts(run: RunFile) -> Forecasts:
    """Return the bodies that have a forecast when the drag starts, for the picture; none without a forecast or a drag."""
    start, known = start_of_drag(run), np.zeros(0, int)
    if start is not None:
        watched = watched_frames(run, start)
        known = np.flatnonzero((run.forecast[start] != NO_FORECAST) & watched.any(axis=0))
    if start is None or not len(known):
        none = np.zeros(0)
        return Forecasts(known, none, none, none, none.astype(bool), none.astype(str))
    bodies, rolled = run.bodies(start), rolled_within(run, start, watched)
    slid = _was(run, SLIDING, watched) if SLIDING in run.state_names else np.zeros(len(rolled), bool)
    fact = np.where(rolled, ROLLING, np.where(slid, SLIDING, "sticking"))
    slides = (run.forecast[start][known] & CAN_SLIDE) > 0
    friction = plate_friction(run).min(axis=0)[bodies["material"][known]]
    return Forecasts(known, friction, bodies["t_min"][known], bodies["t_max"][known], slides, fact[known])


def draw_forecast(path: Path, picture: Path) -> None:
    """Draw forecast against observation of the run at `path`. Raises like `draw_forecasts`, InputError without either."""
    with RunFile(path) as run:
        result = forecasts(run)
        if not len(result.body):
            raise InputError(f"{run.path}: nothing to draw: no body has a forecast, or there is no drag")
        draw_forecasts(result, picture, run.header.get("title", ""))


def start_of_drag(run: RunFile) -> int | None:
    """Return the frame at which the drag starts; None when the run has no forecast, no contacts or no drag."""
    if not run.has_contacts:
        return None
    if not run.frames or "distance" not in run.series or "forecast" not in run.bodies(0) or ROLLING not in run.state_names:
        return None
    return run.drag.start if run.drag.dragged else None


def _was(run: RunFile, state: str, watched: np.ndarray) -> np.ndarray:
    """Return whether each body (B,) was in the state at some time of its first 40 a of drag."""
    return ((run.states == run.state_names.index(state)) & watched).any(axis=0)


def rolled_within(run: RunFile, start: int, watched: np.ndarray) -> np.ndarray:
    """Return whether each body (B,) rolled at some time of its first 40 a of drag, in a frame or between two.

    A positive rolled distance reveals rolling between frames: a body that tips onto a better seat does so within a micrometre.
    """
    rolled = _was(run, ROLLING, watched)
    before = run.bodies(start).get("rolled_distance")
    if before is None:
        return rolled
    last = np.where(watched.any(axis=0), len(watched) - 1 - np.argmax(watched[::-1], axis=0), start)
    for frame in np.unique(last):
        members = last == frame
        rolled[members] |= (run.bodies(int(frame))["rolled_distance"] > before)[members]
    return rolled


def _rotated(run: RunFile, start: int, watched: np.ndarray) -> np.ndarray | None:
    """Return whether each body (B,) turned by more than a/R, of its largest contact, at some time of its first 40 a of drag.

    None for a file without orientations.
    """
    contacts, first = run.contacts(start), run.bodies(start).get("quaternion")
    if first is None:
        return None
    ratio, largest = np.zeros(len(first)), np.zeros(len(first))
    np.maximum.at(largest, contacts["body"], contacts["contact_radius"])
    loaded = (contacts["contact_radius"] > 0.0) & (contacts["contact_radius"] == largest[contacts["body"]])
    ratio[contacts["body"][loaded]] = contacts["overlap"][loaded] / contacts["contact_radius"][loaded]  # a/R, as a^2 = R overlap
    rotated = np.zeros(len(first), bool)
    for frame in np.flatnonzero(watched.any(axis=1)):
        now = run.bodies(int(frame))["quaternion"]
        apart = np.minimum(np.linalg.norm(now - first, axis=1), np.linalg.norm(now + first, axis=1))  # q and -q are the same
        rotated |= watched[frame] & (4.0 * np.arcsin(np.minimum(0.5 * apart, 1.0)) > ratio)
    return rotated


def watched_frames(run: RunFile, start: int) -> np.ndarray:
    """Return the frames (F, B) after the start of the drag within 40 a of each body, over which its forecast is checked."""
    distance, contacts = run.series["distance"], run.contacts(start)
    radius = np.zeros(run.states.shape[1])
    np.maximum.at(radius, contacts["body"], contacts["contact_radius"])
    return (distance[:, None] - distance[start] <= WATCHED * radius) & (np.arange(run.frames) > start)[:, None]


def plate_friction(run: RunFile) -> np.ndarray:
    """Return the friction coefficients (2, M) of each material against the lower and the upper plate."""
    scene = run.scene_tables
    of_pair = {frozenset(pair["between"]): float(pair["friction"]) for pair in scene["pairs"]}
    plates = [scene["plates"][side]["material"] for side in ("lower", "upper")]
    return np.array([[of_pair.get(frozenset((name, plate)), np.nan) for name in run.header["materials"]] for plate in plates])


class Condition(NamedTuple):
    """Assumption of the forecast: name, measured quantity, number and limit in words, and whether it is met."""

    name: str
    what: str
    value: float
    shown: str
    limit: str
    satisfied: bool


def conditions(run: RunFile, start: int, watched: np.ndarray, drawn: Forecasts) -> list[Condition]:
    """Return the assumptions, each evaluated for the run.

    `start` is the frame of the forecast, `watched` (F, B) the frames in which each body was watched, `drawn` the bodies that have
    a forecast.
    """
    neighbours = float(touches_others(run, watched)[drawn.body].mean())
    contacts, upper = run.contacts(start), run.scene_tables.get("plates", {}).get("upper", {})
    loaded = contacts["contact_radius"] > 0.0
    ratio = contacts["overlap"][loaded] / contacts["contact_radius"][loaded]  # a/R, as a^2 = R overlap (Hertz)
    overlap, inertia = float(np.median(ratio**2)) if loaded.any() else 0.0, _inertia(run, start, drawn)
    frames, reversed_fraction = float(np.median(watched[:, drawn.body].sum(axis=0))), _reversed_fraction(run, start, watched)
    support, follows = str(upper.get("support", "rigid")).replace("_", " "), upper.get("support", "rigid") != "rigid"
    if upper.get("gap") is not None:  # it does not yield to a body: one that tips wedges
        support, follows = f"{support}, gap prescribed", False
    return [
        Condition("neighbours", "bodies that touch another one", neighbours, percent(neighbours),
                  f"at most {percent(MAX_NEIGHBOURS)}", neighbours <= MAX_NEIGHBOURS),
        Condition("overlap", "overlap over radius of a spot", overlap, f"{overlap:.2g}", f"at most {MAX_OVERLAP:g}",
                  overlap <= MAX_OVERLAP),
        Condition("inertia", "inertia, m v\N{SUPERSCRIPT TWO}/(mu N a)", inertia, f"{inertia:.2g}", f"at most {MAX_INERTIA:g}",
                  inertia <= MAX_INERTIA),
        Condition("frames", "frames in that drag", frames, f"{frames:g}", f"at least {MIN_FRAMES}", frames >= MIN_FRAMES),
        Condition("reversal", "fraction of that drag reversed", reversed_fraction, percent(reversed_fraction), "none",
        reversed_fraction == 0.0),
        Condition("support", "support of the upper plate", float(follows), support, "follows each body", follows),
    ]  # fmt: skip


def touches_others(run: RunFile, watched: np.ndarray) -> np.ndarray:
    """Return the bodies (B,) that touch another body in a frame in which they are watched."""
    result = np.zeros(watched.shape[1], bool)
    for frame in np.flatnonzero(watched.any(axis=1)):
        contacts = run.contacts(int(frame))
        between = contacts["partner"] >= 0
        members = np.unique(np.concatenate([contacts["body"][between], contacts["partner"][between]]))
        result[members] |= watched[frame, members]
    return result


def _inertia(run: RunFile, start: int, drawn: Forecasts) -> float:
    """Return the median of m v^2/(mu N a) of the bodies, with the mean speed of the drag; infinite without friction."""
    mass, contacts = np.asarray(run.bodies(start)["mass"], float), run.contacts(start)
    load, radius = np.zeros(len(mass)), np.zeros(len(mass))
    np.add.at(load, contacts["body"], 0.5 * np.abs(contacts["normal_force"]))  # each side carries the load once
    np.maximum.at(radius, contacts["body"], contacts["contact_radius"])
    distance = run.series["distance"]
    speed = float(distance[-1] - distance[start]) / float(run.times[-1] - run.times[start])
    resistance = drawn.friction * load[drawn.body] * radius[drawn.body]
    energy = mass[drawn.body] * speed**2
    return float(np.median(np.divide(energy, resistance, out=np.full(len(energy), np.inf), where=resistance > 0.0)))


def _reversed_fraction(run: RunFile, start: int, watched: np.ndarray) -> float:
    """Return the fraction of the watched drag that is reversed: 0 for one-way sliding."""
    last = int(np.flatnonzero(watched.any(axis=1))[-1])
    ends = [run.plates(frame)["position"] for frame in (start, last)]
    distance = float(run.series["distance"][last] - run.series["distance"][start])
    if len(ends[0]) < 8 or distance <= 0.0:
        return 0.0
    moved = (ends[1][4] - ends[1][0]) - (ends[0][4] - ends[0][0])
    reversed_fraction = 1.0 - float(np.hypot(moved[0], moved[1])) / distance
    return reversed_fraction if reversed_fraction > ROUNDED else 0.0
