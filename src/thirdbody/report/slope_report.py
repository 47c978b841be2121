"""What `thirdbody states RUN --slopes` prints: the forecast on slopes, beside the labels and what bodies then did."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from thirdbody.errors import InputError
from thirdbody.report.forecast_check import WATCHED, rolled_within, start_of_drag, watched_frames
from thirdbody.report.friction_cones import IMPOSSIBLE, POSSIBLE, UNDECIDED
from thirdbody.report.slope_forecast import SlopeForecast, slope_forecast
from thirdbody.report.tables import print_json, table
from thirdbody.system.terminal import print_line
from thirdbody.trajectory.reader import Run, open_run

WORDS = {POSSIBLE: "possible", IMPOSSIBLE: "impossible", UNDECIDED: "undecided"}


def slopes_report(path: Path, frame: int | None, json: bool) -> None:
    """Print the forecast of one frame, by default that at which the drag starts. Raises InputError where there is none."""
    with open_run(path) as run:
        start = start_of_drag(run)
        if start is None:
            raise InputError(f"{run.path}: no forecast: it needs labels, contacts and a drag between two plates")
        try:
            number = run.frame_number(start if frame is None else frame)
        except IndexError as error:
            raise InputError(f"--frame {frame}: {error}") from None
        forecast = slope_forecast(run, number, direction(run, number))
        result = {"frame": number, "supported": int(forecast.supported.sum())} | verdicts(run, number, forecast)
        if number == start:
            result["outcome"] = outcome(run, start, forecast)
        if json:
            bodies = [
                {"body": int(b), "stick": WORDS[int(forecast.stick[b])], "slide": WORDS[int(forecast.slide[b])]}
                for b in np.flatnonzero(forecast.supported)
            ]
            print_json(result | {"bodies": bodies})
        else:
            _print(run, result)


def direction(run: Run, frame: int) -> np.ndarray:
    """Return the unit direction (2,) of the upper plate relative to the lower one, from a frame to the next, or to the last."""
    first = min(frame, run.frames - 2)
    now, then = (run.plates(k)["position"] for k in (first, first + 1))
    moved = ((then[4:] - now[4:]) - (then[:4] - now[:4]))[:, :2].mean(axis=0)
    length = float(np.hypot(*moved))
    if not length > 0.0:
        raise InputError(f"{run.path}: frame {frame}: the plates do not move: there is no direction to slide in")
    return np.asarray(moved / length)


def verdicts(run: Run, frame: int, forecast: SlopeForecast) -> dict[str, Any]:
    """Return, by state at the frame, the numbers of bodies that can, cannot, or are not known to stick and to slide."""
    states = run.states[frame]
    return {
        name: {
            state: [int(np.count_nonzero(forecast.supported & (states == code) & (verdict == word))) for word in WORDS]
            for code, state in enumerate(run.state_names)
            if np.any(forecast.supported & (states == code))
        }
        for name, verdict in (("stick", forecast.stick), ("slide", forecast.slide))
    }


def outcome(run: Run, start: int, forecast: SlopeForecast) -> dict[str, list[int]]:
    """Return how many bodies of each verdict on sliding rolled within `WATCHED` contact radii of drag, and how many did not."""
    watched = watched_frames(run, start)
    rolled, visible = rolled_within(run, start, watched), watched.any(axis=0) & forecast.supported
    return {
        word: [int((visible & (forecast.slide == code) & moved).sum()) for moved in (rolled, ~rolled)]
        for code, word in WORDS.items()
    }


def _print(run: Run, result: dict[str, Any]) -> None:
    print_line(
        f"frame {result['frame']}: {result['supported']} of {run.states.shape[1]} bodies are held by both plates and touch no "
        "other; forecast on the slopes of their contacts, by linear programmes"
    )
    for name, heading in (("stick", "can stick"), ("slide", "can slide along the drag without turning")):
        rows = [[state, *map(str, counts)] for state, counts in result[name].items()]
        table(heading, ["labelled", *WORDS.values()], rows)
    if "outcome" in result:
        table(
            f"to slide, at the start, against the first {WATCHED:g} contact radii of drag",
            ["", "was rolling", "never rolled"],
            [[word, *map(str, counts)] for word, counts in result["outcome"].items()],
        )
