"""The forecast of every body, made when the drag starts, against what the body then did."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import InputError
from .output.foretold_plot import Forecasts, draw_forecasts

if TYPE_CHECKING:
    from .output.run import Run

WATCHED = 40.0
"""Way of the drag, in contact radii of a body, within which its forecast is held against what it does."""

ROLLING, SLIDING = "rolling", "sliding"
CAN_SLIDE, UNTOLD = 2, 4
"""Bits of `forecast` (the labeller's)."""


def forecast_against_fact(run: Run) -> dict[str, Any]:
    """Forecast when the drag starts (can the body go on without rolling?) against whether it is labelled rolling within 40 a.

    Keys: `frame` of the forecast, `agree`, `told` (how many were told and watched), `unwatched` (bodies without any frame within
    40 a), `rolls_as_told`, `slides_as_told`, `rolls_instead`, `slides_instead` (lists of bodies). Empty when the run has no
    forecast or no drag.
    """
    start = start_of_drag(run)
    if start is None:
        return {}
    told, rolled, seen = run.forecast[start], _was(run, ROLLING, start), _watched(run, start).any(axis=0)
    known, slides = (told != UNTOLD) & seen, (told & CAN_SLIDE) > 0
    groups = {
        "rolls_as_told": known & ~slides & rolled,
        "slides_as_told": known & slides & ~rolled,
        "rolls_instead": known & slides & rolled,
        "slides_instead": known & ~slides & ~rolled,
    }
    lists = {name: np.flatnonzero(members).tolist() for name, members in groups.items()}
    agree, unwatched = len(lists["rolls_as_told"]) + len(lists["slides_as_told"]), int(((told != UNTOLD) & ~seen).sum())
    return {"frame": start, "agree": agree, "told": int(known.sum()), "unwatched": unwatched} | lists


def forecasts(run: Run) -> Forecasts:
    """The bodies that have a forecast when the drag starts, as the picture takes them; none without a forecast or a drag."""
    start = start_of_drag(run)
    known = np.zeros(0, int)
    if start is not None:
        known = np.flatnonzero((run.forecast[start] != UNTOLD) & _watched(run, start).any(axis=0))
    if start is None or not len(known):
        none = np.zeros(0)
        return Forecasts(known, none, none, none, none.astype(bool), none.astype(str))
    bodies = run.bodies(start)
    slid = _was(run, SLIDING, start) if SLIDING in run.state_names else np.zeros(run.states.shape[1], bool)
    fact = np.where(_was(run, ROLLING, start), ROLLING, np.where(slid, SLIDING, "sticking"))
    slides = (run.forecast[start][known] & CAN_SLIDE) > 0
    friction = _friction(run)[bodies["material"][known]]
    return Forecasts(known, friction, bodies["t_min"][known], bodies["t_max"][known], slides, fact[known])


def draw_forecast(path: Path, picture: Path) -> None:
    """Draw forecast against fact of the run at `path`. Raises like `draw_forecasts`, InputError without a forecast or a drag."""
    from .output.run import open_run

    with open_run(path) as run:
        found = forecasts(run)
        if not len(found.body):
            raise InputError(f"{run.path}: nothing to draw: no body has a forecast, or there is no drag")
        draw_forecasts(found, picture, run.header.get("title", ""))


def start_of_drag(run: Run) -> int | None:
    """The frame at which the drag starts; None when the run has no forecast or no drag."""
    if not run.frames or "distance" not in run.series or "forecast" not in run.bodies(0) or ROLLING not in run.state_names:
        return None
    distance = run.series["distance"]
    if not distance[-1] > 0.0:
        return None
    # settling ends within a step of the drag: the first frame well beyond that is the one after the start
    return max(int(np.argmax(distance > 1e-4 * distance[-1])) - 1, 0)


def _was(run: Run, state: str, start: int) -> np.ndarray:
    """Whether each body (B,) was in the state at some time of its first 40 a of drag."""
    return ((run.states == run.state_names.index(state)) & _watched(run, start)).any(axis=0)


def _watched(run: Run, start: int) -> np.ndarray:
    """(F, B) frames after the start of the drag within 40 a of each body: what its forecast is held against."""
    distance, contacts = run.series["distance"], run.contacts(start)
    radius = np.zeros(run.states.shape[1])
    np.maximum.at(radius, contacts["body"], contacts["contact_radius"])
    return (distance[:, None] - distance[start] <= WATCHED * radius) & (np.arange(run.frames) > start)[:, None]


def _friction(run: Run) -> np.ndarray:
    """Friction coefficient of each material against the plates, the lesser of the two: there a body of it slides first."""
    scene = tomllib.loads(run.scene_text)
    of_pair = {frozenset(pair["between"]): float(pair["friction"]) for pair in scene["pairs"]}
    plates = [scene["plates"][side]["material"] for side in ("lower", "upper")]
    materials = run.header["materials"]
    return np.array([min(of_pair.get(frozenset((name, plate)), np.nan) for plate in plates) for name in materials])
