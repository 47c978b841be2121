"""Comparison of the forecast of every body, made when the drag starts, with its observed motion."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.errors import InputError
from thirdbody.kernels.tables import CAN_SLIDE, NO_FORECAST
from thirdbody.plot.forecast_plot import Forecasts, draw_forecasts
from thirdbody.report.forecast_conditions import conditions, touches_others
from thirdbody.trajectory.reader import Run

WATCHED = 40.0
"""Path of the drag, in contact radii of a body, over which its forecast is compared with its motion."""

ROLLING, SLIDING = "rolling", "sliding"


def compare_forecast(run: Run) -> dict[str, Any]:
    """Compare the forecast at the start of the drag (can the body go on without rolling?) with rolling labels within 40 a.

    Keys: `frame` of the forecast, `agree`, `forecast` (number of bodies forecast and watched), `unwatched` (bodies without any
    frame within 40 a), `rolls_as_forecast`, `slides_as_forecast`, `rolls_instead`, `slides_instead` (lists of bodies), and those
    of `_explanation`. Empty when the run has no forecast or no drag.
    """
    start = start_of_drag(run)
    if start is None:
        return {}
    watched = watched_frames(run, start)
    forecast, rolled, observed = run.forecast[start], rolled_within(run, start, watched), watched.any(axis=0)
    known, slides = (forecast != NO_FORECAST) & observed, (forecast & CAN_SLIDE) > 0
    groups = {
        "rolls_as_forecast": known & ~slides & rolled,
        "slides_as_forecast": known & slides & ~rolled,
        "rolls_instead": known & slides & rolled,
        "slides_instead": known & ~slides & ~rolled,
    }
    lists = {name: np.flatnonzero(members).tolist() for name, members in groups.items()}
    agree, unwatched = (
        len(lists["rolls_as_forecast"]) + len(lists["slides_as_forecast"]),
        int(((forecast != NO_FORECAST) & ~observed).sum()),
    )
    result = {"frame": start, "agree": agree, "forecast": int(known.sum()), "unwatched": unwatched} | lists
    return result | (_explanation(run, start, watched, known) if known.any() else {})


def _explanation(run: Run, start: int, watched: np.ndarray, known: np.ndarray) -> dict[str, Any]:
    """Return the explanation of an agreement: counts outside the band, with and without neighbours, and the run's conditions.

    Keys: `clear` and `alone`, (agree, forecast) of the bodies outside the 2 % band and of those that meanwhile touch no other;
    `rotated`, the first of these by the measured rotation of `_rotated` instead of the labels (None without orientations);
    `conditions`, a list of dictionaries.
    """
    drawn, bodies = forecasts(run), run.bodies(start)
    alone = ~touches_others(run, watched)[drawn.body]
    friction = _friction(run)[bodies["material"]]
    rotated = _rotated(run, start, watched)
    plain = None if rotated is None else (rotated[drawn.body] != drawn.slides) & drawn.clear
    return {
        "by_rotation": None if plain is None else [int(plain.sum()), int(drawn.clear.sum())],
        "clear": [int((drawn.correct & drawn.clear).sum()), int(drawn.clear.sum())],
        "alone": [int((drawn.correct & drawn.clear & alone).sum()), int((drawn.clear & alone).sum())],
        "conditions": [condition._asdict() for condition in conditions(run, start, watched, known, friction)],
    }


def forecasts(run: Run) -> Forecasts:
    """Return the bodies that have a forecast when the drag starts, for the picture; none without a forecast or a drag."""
    start = start_of_drag(run)
    known = np.zeros(0, int)
    if start is not None:
        known = np.flatnonzero((run.forecast[start] != NO_FORECAST) & watched_frames(run, start).any(axis=0))
    if start is None or not len(known):
        none = np.zeros(0)
        return Forecasts(known, none, none, none, none.astype(bool), none.astype(str))
    bodies = run.bodies(start)
    slid = _was(run, SLIDING, start) if SLIDING in run.state_names else np.zeros(run.states.shape[1], bool)
    fact = np.where(rolled_within(run, start, watched_frames(run, start)), ROLLING, np.where(slid, SLIDING, "sticking"))
    slides = (run.forecast[start][known] & CAN_SLIDE) > 0
    friction = _friction(run)[bodies["material"][known]]
    return Forecasts(known, friction, bodies["t_min"][known], bodies["t_max"][known], slides, fact[known])


def draw_forecast(path: Path, picture: Path) -> None:
    """Draw forecast against observation of the run at `path`. Raises like `draw_forecasts`, InputError without either."""
    from thirdbody.trajectory.reader import open_run

    with open_run(path) as run:
        result = forecasts(run)
        if not len(result.body):
            raise InputError(f"{run.path}: nothing to draw: no body has a forecast, or there is no drag")
        draw_forecasts(result, picture, run.header.get("title", ""))


def start_of_drag(run: Run) -> int | None:
    """Return the frame at which the drag starts; None when the run has no forecast, no contacts or no drag."""
    if not run.has_contacts:
        return None
    if not run.frames or "distance" not in run.series or "forecast" not in run.bodies(0) or ROLLING not in run.state_names:
        return None
    return run.drag.start if run.drag.dragged else None


def _was(run: Run, state: str, start: int) -> np.ndarray:
    """Return whether each body (B,) was in the state at some time of its first 40 a of drag."""
    return ((run.states == run.state_names.index(state)) & watched_frames(run, start)).any(axis=0)


def rolled_within(run: Run, start: int, watched: np.ndarray) -> np.ndarray:
    """Return whether each body (B,) rolled at some time of its first 40 a of drag, in a frame or between two.

    A positive rolled distance reveals rolling between frames: a body that tips onto a better seat does so within a micrometre.
    """
    rolled = _was(run, ROLLING, start)
    before = run.bodies(start).get("rolled_distance")
    if before is None:
        return rolled
    last = np.where(watched.any(axis=0), len(watched) - 1 - np.argmax(watched[::-1], axis=0), start)
    for frame in np.unique(last):
        members = last == frame
        rolled[members] |= (run.bodies(int(frame))["rolled_distance"] > before)[members]
    return rolled


def _rotated(run: Run, start: int, watched: np.ndarray) -> np.ndarray | None:
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


def watched_frames(run: Run, start: int) -> np.ndarray:
    """Return the frames (F, B) after the start of the drag within 40 a of each body, over which its forecast is checked."""
    distance, contacts = run.series["distance"], run.contacts(start)
    radius = np.zeros(run.states.shape[1])
    np.maximum.at(radius, contacts["body"], contacts["contact_radius"])
    return (distance[:, None] - distance[start] <= WATCHED * radius) & (np.arange(run.frames) > start)[:, None]


def _friction(run: Run) -> np.ndarray:
    """Return the lower of the two friction coefficients of each material against the plates: there a body slides first."""
    scene = tomllib.loads(run.scene_text)
    of_pair = {frozenset(pair["between"]): float(pair["friction"]) for pair in scene["pairs"]}
    plates = [scene["plates"][side]["material"] for side in ("lower", "upper")]
    materials = run.header["materials"]
    return np.array([min(of_pair.get(frozenset((name, plate)), np.nan) for plate in plates) for name in materials])
