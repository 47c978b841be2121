"""The forecast of every body, made when the drag starts, against what the body then did."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .output.run import Run

WATCHED = 40.0
"""Way of the drag, in contact radii of a body, within which its forecast is held against what it does."""

ROLLING = "rolling"
CAN_SLIDE, UNTOLD = 2, 4
"""Bits of `forecast` (the labeller's)."""


def forecast_against_fact(run: Run) -> dict[str, Any]:
    """Forecast when the drag starts (can the body go on without rolling?) against whether it is labelled rolling within 40 a.

    Keys: `frame` of the forecast, `agree`, `rolls_as_told`, `slides_as_told`, `rolls_instead`, `slides_instead` (lists of
    bodies). Empty when the run has no forecast or no drag.
    """
    if not run.frames or "distance" not in run.series or "forecast" not in run.bodies(0) or ROLLING not in run.state_names:
        return {}
    distance = run.series["distance"]
    if not distance[-1] > 0.0:
        return {}
    # settling ends within a step of the drag: the first frame well beyond that is the one after the start
    start = max(int(np.argmax(distance > 1e-4 * distance[-1])) - 1, 0)
    told, contacts = run.forecast[start], run.contacts(start)
    radius = np.zeros(len(told))
    np.maximum.at(radius, contacts["body"], contacts["contact_radius"])
    watched = (distance[:, None] - distance[start] <= WATCHED * radius) & (np.arange(run.frames) > start)[:, None]
    rolled = ((run.states == run.state_names.index(ROLLING)) & watched).any(axis=0)
    known, slides = told != UNTOLD, (told & CAN_SLIDE) > 0
    groups = {
        "rolls_as_told": known & ~slides & rolled,
        "slides_as_told": known & slides & ~rolled,
        "rolls_instead": known & slides & rolled,
        "slides_instead": known & ~slides & ~rolled,
    }
    lists = {name: np.flatnonzero(members).tolist() for name, members in groups.items()}
    return {"frame": start, "agree": len(lists["rolls_as_told"]) + len(lists["slides_as_told"]), "told": int(known.sum())} | lists
