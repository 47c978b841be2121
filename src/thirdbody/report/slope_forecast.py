"""Forecast of bodies that rough plates hold on slopes, by linear programmes; the labeller gives none there (`NO_FORECAST`).

For one frame of a run, and only where it is asked for: `thirdbody states RUN --slopes`. Each body between both plates that
touches no other gets the verdicts of `friction_cones` on the normals of its contacts: whether it can stick, and whether it can
slide along the drag without turning. They hold for its contacts as they are; a body that has moved on by a fraction of the
shortest wavelength has other ones.
"""

from __future__ import annotations

import tomllib
from typing import NamedTuple

import numpy as np

from thirdbody.kernels.tables import DEBRIS, UPPER
from thirdbody.report.friction_cones import IMPOSSIBLE, POSSIBLE, UNDECIDED, Support, can_slide, can_stick
from thirdbody.trajectory.reader import Run

WINDOW = 4.0
"""Drag, in contact radii, over which a spot whose plate falls away stays loaded if its overlap lasts: a window of the labels."""


class SlopeForecast(NamedTuple):
    """Verdicts (B,) of `friction_cones` on sticking and sliding; both are UNDECIDED of bodies that are not `supported` (B,)."""

    stick: np.ndarray
    slide: np.ndarray
    supported: np.ndarray


def slope_forecast(run: Run, frame: int, drag: np.ndarray) -> SlopeForecast:
    """Return the forecast of all bodies in a frame; `drag` (2,): direction of the upper plate relative to the lower one."""
    bodies, contacts = run.bodies(frame), run.contacts(frame)
    count = len(bodies["position"])
    stick, slide = np.full(count, UNDECIDED), np.full(count, UNDECIDED)
    loaded = contacts["normal_force"] > 0.0
    meets = np.unique(np.concatenate([contacts[name][loaded & (contacts["side"] == DEBRIS)] for name in ("body", "partner")]))
    rows = np.flatnonzero(loaded & (contacts["side"] != DEBRIS))
    rows = rows[np.argsort(contacts["body"][rows], kind="stable")]
    friction, weight = _friction(run), _acceleration(run)
    supported = np.zeros(count, bool)
    for own in np.split(rows, np.flatnonzero(np.diff(contacts["body"][rows])) + 1) if len(rows) else []:
        b = int(contacts["body"][own[0]])
        above = contacts["side"][own] == UPPER
        push = -float(contacts["force"][own][above, 2].sum())
        if above.all() or not above.any() or b in meets or not push > 0.0:
            continue
        supported[b] = True
        support = Support(
            contacts["position"][own] - bodies["position"][b], contacts["normal"][own],
            friction[above.astype(int), bodies["material"][b]], above, push, weight * float(bodies["mass"][b]),
        )  # fmt: skip
        stick[b] = can_stick(support)
        slide[b] = _either_side(support, drag, contacts["overlap"][own] / (WINDOW * contacts["contact_radius"][own]))
    return SlopeForecast(stick, slide, supported)


def _either_side(support: Support, drag: np.ndarray, reach: np.ndarray) -> int:
    """Return whether a body can slide on one of its sides."""
    verdicts = []
    for side in (True, False):
        verdicts.append(can_slide(support, drag, side, reach))
        if verdicts[-1] == POSSIBLE:
            return POSSIBLE
    return UNDECIDED if UNDECIDED in verdicts else IMPOSSIBLE


def _friction(run: Run) -> np.ndarray:
    """Return the friction coefficients (2, M) of each material against the lower and the upper plate."""
    scene = tomllib.loads(run.scene_text)
    of_pair = {frozenset(pair["between"]): float(pair["friction"]) for pair in scene["pairs"]}
    plates = [scene["plates"][side]["material"] for side in ("lower", "upper")]
    return np.array([[of_pair.get(frozenset((name, plate)), np.nan) for name in run.header["materials"]] for plate in plates])


def _acceleration(run: Run) -> np.ndarray:
    """Return the acceleration of gravity (3,) [m/s2] of a run's scene."""
    if "gravity" not in tomllib.loads(run.scene_text).get("effects", {}):
        return np.zeros(3)
    from thirdbody.scene.model import Scene

    return np.array(Scene.parse(run.scene_text).effects.gravity, np.float64)
