"""What `thirdbody states RUN --slopes` prints: the forecast of bodies that rough plates hold on slopes, by linear programmes.

The labeller gives none there (`NO_FORECAST`). Each body between both plates that touches no other is examined on the normals of
its contacts: whether it can stick, and whether it can slide along the drag without turning. That holds for its contacts as they
are; a body that has moved on by a fraction of the shortest wavelength has other ones.

A spot i presses with N_i >= 0 along its normal and rubs with two tangential parts t_i, |t_i| <= mu_i N_i. A polygon of `EDGES`
sides inside that circle, or around it, makes the condition linear: its corners lie at mu_i N_i, or at 1/cos(pi/EDGES) of that.
What the inner polygons allow is possible, what the outer ones forbid is impossible, and a body between the two, 0.12 % of the
friction wide, is undecided. Generalises E. Willert's Eqs. 1, 2, 16 and 19 to spots on slopes; cf. R. M. Murray, Z. Li and
S. S. Sastry 1994, chapter 5.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from thirdbody.errors import InputError
from thirdbody.kernels.tables import DEBRIS, UPPER
from thirdbody.report.forecast import WATCHED, plate_friction, rolled_within, start_of_drag, watched_frames
from thirdbody.report.tables import print_json, table
from thirdbody.system.terminal import print_line
from thirdbody.trajectory.run_file import RunFile

IMPOSSIBLE, POSSIBLE, UNDECIDED = 0, 1, 2

WORDS = {POSSIBLE: "possible", IMPOSSIBLE: "impossible", UNDECIDED: "undecided"}

EDGES = 64
RESIDUAL = 1e-6
"""Unbalanced force over the load, and unbalanced moment over load times size, that count as zero."""

WINDOW = 4.0
"""Drag, in contact radii, over which a spot whose plate falls away stays loaded if its overlap lasts: a window of the labels."""

PRECISE = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
"""Tolerances of the solver: those of 1e-7 lost a body on two spots, which one line of action alone balances."""


class Support(NamedTuple):
    """Spots of a body: arms (n, 3) from its centre of mass [m], unit normals (n, 3) into it, frictions (n,), whether above (n,).

    `load`: vertical force by which the spots above push down [N]; `weight` (3,): force at the centre of mass [N].
    """

    arms: np.ndarray
    normals: np.ndarray
    friction: np.ndarray
    above: np.ndarray
    load: float
    weight: np.ndarray


def can_stick(support: Support) -> int:
    """Return whether all spots can stick: forces inside all cones balance load and weight."""
    return _verdict(support, np.zeros((0, 3)), np.zeros(len(support.friction), bool), np.array([1.0, 0.0]))


def can_slide(support: Support, drag: np.ndarray, side: bool, reach: np.ndarray) -> int:
    """Return whether the body can slide on one side without turning, while it sticks to the other.

    `drag` (2,): unit direction of the upper plate relative to the lower one; `side`: True slides on the upper plate, False on the
    lower one. What slides over it, the upper plate or the body, then rises by w per drag so that no spot is pressed in: (e, w)
    lies in the tangent plane of the steepest spot, w = max(-n.e/n_z). Spots whose plate falls away by more than `reach` (n,) per
    drag open; those that stay have their friction at its limit, against the slip.
    """
    chosen, n = support.above == side, support.normals
    if not chosen.any():
        return IMPOSSIBLE
    if np.any(np.abs(n[:, 2]) < 1e-6):
        return UNDECIDED
    inclines = -(n[:, :2] @ drag) / n[:, 2]
    steepest = inclines[chosen].max()
    sliding = chosen & (steepest - inclines <= reach)
    motion = np.array([*drag, steepest])
    tangents = motion - (n @ motion)[:, None] * n
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    # on the body: along the motion of the plate above, against its own motion over the plate below
    limits = n + support.friction[:, None] * (tangents if side else -tangents)
    stay = ~chosen | sliding
    arms, frictions, above = (values[stay] for values in (support.arms, support.friction, support.above))
    loaded = support._replace(arms=arms, normals=n[stay], friction=frictions, above=above)
    return _verdict(loaded, limits[sliding], sliding[stay], drag)


def _verdict(support: Support, limits: np.ndarray, sliding: np.ndarray, drag: np.ndarray) -> int:
    """Return what inner and outer polygons allow. `limits` (m, 3): forces per normal force of the m spots `sliding` (n,).

    Polygons have a corner along the drag: between parallel planes of equal friction both sides are at their limit there.
    """
    # two unit vectors (n, 2, 3) across each normal, the first of them above or below the drag
    across = np.cross(support.normals, [*drag, 0.0])
    across /= np.linalg.norm(across, axis=1)[:, None]
    tangents = np.stack([np.cross(across, support.normals), across], axis=1)
    if _balances(support, limits, sliding, tangents):
        return POSSIBLE
    return UNDECIDED if _balances(support, limits, sliding, tangents / math.cos(math.pi / EDGES)) else IMPOSSIBLE


def _balances(support: Support, limits: np.ndarray, sliding: np.ndarray, tangents: np.ndarray) -> bool:
    """Return whether forces balance with polygons whose corners lie at mu_i N_i times `tangents` (n, 2, 3), turned.

    Unknown are the multiples of the corners of each spot's polygon; the imbalance is minimised, since at the edge of what is
    possible a mere search for a solution fails.
    """
    from scipy.optimize import linprog

    size = max(float(np.abs(support.arms).max(initial=0.0)), 1e-300)
    angles = 2.0 * math.pi * np.arange(EDGES) / EDGES
    circle = np.column_stack([np.cos(angles), np.sin(angles)]) @ tangents
    corners = support.normals[:, None] + support.friction[:, None, None] * circle
    forces = np.concatenate([corners[~sliding].reshape(-1, 3), limits])
    sticking = np.repeat(np.flatnonzero(~sliding), EDGES)
    spot = np.concatenate([sticking, np.flatnonzero(sliding)])
    moments = np.cross(support.arms[spot] / size, forces)
    pushed = np.where(support.above[spot], forces[:, 2], 0.0)
    balance = np.column_stack([forces, moments, pushed]).T
    right = np.concatenate([-support.weight / support.load, np.zeros(3), [-1.0]])
    costs = np.concatenate([np.zeros(len(spot)), np.ones(14)])
    slack = np.concatenate([np.eye(7), -np.eye(7)], axis=1)
    result = linprog(costs, A_eq=np.concatenate([balance, slack], axis=1), b_eq=right, method="highs", options=PRECISE)
    return result.status == 0 and bool(result.fun <= RESIDUAL)


class SlopeForecast(NamedTuple):
    """Verdicts (B,) of `friction_cones` on sticking and sliding; both are UNDECIDED of bodies that are not `supported` (B,)."""

    stick: np.ndarray
    slide: np.ndarray
    supported: np.ndarray


def slope_forecast(run: RunFile, frame: int, drag: np.ndarray) -> SlopeForecast:
    """Return the forecast of all bodies in a frame; `drag` (2,): direction of the upper plate relative to the lower one."""
    bodies, contacts = run.bodies(frame), run.contacts(frame)
    count = len(bodies["position"])
    stick, slide = np.full(count, UNDECIDED), np.full(count, UNDECIDED)
    loaded = contacts["normal_force"] > 0.0
    meets = np.unique(np.concatenate([contacts[name][loaded & (contacts["side"] == DEBRIS)] for name in ("body", "partner")]))
    rows = np.flatnonzero(loaded & (contacts["side"] != DEBRIS))
    rows = rows[np.argsort(contacts["body"][rows], kind="stable")]
    friction, gravity = plate_friction(run), np.zeros(3)
    if "gravity" in run.scene_tables.get("effects", {}):
        from thirdbody.scene.model import Scene

        gravity = np.array(Scene.parse(run.scene_text).effects.gravity, np.float64)
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
            friction[above.astype(int), bodies["material"][b]], above, push, gravity * float(bodies["mass"][b]),
        )  # fmt: skip
        stick[b] = can_stick(support)
        reach = contacts["overlap"][own] / (WINDOW * contacts["contact_radius"][own])
        slide[b] = can_slide(support, drag, True, reach)
        if slide[b] != POSSIBLE:
            other = can_slide(support, drag, False, reach)
            slide[b] = other if other == POSSIBLE else max(slide[b], other)
    return SlopeForecast(stick, slide, supported)


def slopes_report(path: Path, frame: int | None, json: bool) -> None:
    """Print the forecast of one frame, by default that at which the drag starts. Raises InputError where there is none."""
    with RunFile(path) as run:
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


def direction(run: RunFile, frame: int) -> np.ndarray:
    """Return the unit direction (2,) of the upper plate relative to the lower one, from a frame to the next, or to the last."""
    first = min(frame, run.frames - 2)
    now, then = (run.plates(k)["position"] for k in (first, first + 1))
    moved = ((then[4:] - now[4:]) - (then[:4] - now[:4]))[:, :2].mean(axis=0)
    length = float(np.hypot(*moved))
    if not length > 0.0:
        raise InputError(f"{run.path}: frame {frame}: the plates do not move: there is no direction to slide in")
    return np.asarray(moved / length)


def verdicts(run: RunFile, frame: int, forecast: SlopeForecast) -> dict[str, Any]:
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


def outcome(run: RunFile, start: int, forecast: SlopeForecast) -> dict[str, list[int]]:
    """Return how many bodies of each verdict on sliding rolled within `WATCHED` contact radii of drag, and how many did not."""
    watched = watched_frames(run, start)
    rolled, visible = rolled_within(run, start, watched), watched.any(axis=0) & forecast.supported
    return {
        word: [int((visible & (forecast.slide == code) & moved).sum()) for moved in (rolled, ~rolled)]
        for code, word in WORDS.items()
    }


def _print(run: RunFile, result: dict[str, Any]) -> None:
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
