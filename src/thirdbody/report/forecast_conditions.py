"""Conditions under which the forecast can be expected to hold: its assumptions, evaluated for one run.

The theory of the forecast treats one particle between two surfaces, pressed by a constant load, at rest but for the drag, on
point contacts. Each condition is a number of the run with the limit up to which forecast and motion agreed as in the table of a
thousand clumps (plugins/three_spot/README.md, "Forecast against fact").
"""

import tomllib
from typing import NamedTuple

import numpy as np

from thirdbody.trajectory.reader import Run
from thirdbody.units import percent

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


class Condition(NamedTuple):
    """Assumption of the forecast: name, measured quantity, number and limit in words, and whether it is met."""

    name: str
    what: str
    value: float
    shown: str
    limit: str
    satisfied: bool


def conditions(run: Run, start: int, watched: np.ndarray, report: np.ndarray, friction: np.ndarray) -> list[Condition]:
    """Return the assumptions, each evaluated for the run.

    `start` is the frame of the forecast, `watched` (F, B) the frames in which each body was watched, `report` (B,) the bodies
    that have a forecast, `friction` (B,) their coefficients against the plates.
    """
    neighbours = float(touches_others(run, watched)[report].mean())
    overlap, inertia = _overlap(run, start), _inertia(run, start, report, friction)
    frames, reversed_fraction = float(np.median(watched[:, report].sum(axis=0))), _reversed_fraction(run, start, watched)
    support, follows = _support(run)
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


def touches_others(run: Run, watched: np.ndarray) -> np.ndarray:
    """Return the bodies (B,) that touch another body in a frame in which they are watched."""
    result = np.zeros(watched.shape[1], bool)
    for frame in np.flatnonzero(watched.any(axis=1)):
        contacts = run.contacts(int(frame))
        between = contacts["partner"] >= 0
        members = np.unique(np.concatenate([contacts["body"][between], contacts["partner"][between]]))
        result[members] |= watched[frame, members]
    return result


def _overlap(run: Run, start: int) -> float:
    """Return the median of overlap over radius of curvature of the loaded contacts: a^2 = R overlap, Hertz."""
    contacts = run.contacts(start)
    loaded = contacts["contact_radius"] > 0.0
    return float(np.median((contacts["overlap"][loaded] / contacts["contact_radius"][loaded]) ** 2)) if loaded.any() else 0.0


def _inertia(run: Run, start: int, report: np.ndarray, friction: np.ndarray) -> float:
    """Return the median of m v^2/(mu N a) of the bodies, with the mean speed of the drag; infinite without friction."""
    bodies, contacts, count = run.bodies(start), run.contacts(start), len(report)
    load, radius = np.zeros(count), np.zeros(count)
    np.add.at(load, contacts["body"], 0.5 * np.abs(contacts["normal_force"]))  # each side carries the load once
    np.maximum.at(radius, contacts["body"], contacts["contact_radius"])
    distance = run.series["distance"]
    speed = float(distance[-1] - distance[start]) / float(run.times[-1] - run.times[start])
    resistance = (friction * load * radius)[report]
    energy = np.asarray(bodies["mass"], float)[report] * speed**2
    ratio = np.divide(energy, resistance, out=np.full(len(energy), np.inf), where=resistance > 0.0)
    return float(np.median(ratio))


def _reversed_fraction(run: Run, start: int, watched: np.ndarray) -> float:
    """Return the fraction of the watched drag that is reversed: 0 for one-way sliding."""
    last = int(np.flatnonzero(watched.any(axis=1))[-1])
    ends = [run.plates(frame)["position"] for frame in (start, last)]
    distance = float(run.series["distance"][last] - run.series["distance"][start])
    if len(ends[0]) < 8 or distance <= 0.0:
        return 0.0
    moved = (ends[1][4] - ends[1][0]) - (ends[0][4] - ends[0][0])
    reversed_fraction = 1.0 - float(np.hypot(moved[0], moved[1])) / distance
    return reversed_fraction if reversed_fraction > ROUNDED else 0.0


def _support(run: Run) -> tuple[str, bool]:
    """Return the support of the upper plate in words, and whether it yields to each body: else a tipping body wedges."""
    upper = tomllib.loads(run.scene_text).get("plates", {}).get("upper", {})
    support = str(upper.get("support", "rigid")).replace("_", " ")
    if upper.get("gap") is not None:
        return f"{support}, gap prescribed", False
    return support, support != "rigid"
