"""Linear programmes over friction cones on any normals: can forces inside the cones of all spots balance a body?

A spot i presses with N_i >= 0 along its normal and rubs with two tangential parts t_i, |t_i| <= mu_i N_i. A polygon of `EDGES`
sides inside that circle, or around it, makes the condition linear: its corners lie at mu_i N_i, or at 1/cos(pi/EDGES) of that.
What the inner polygons allow is possible, what the outer ones forbid is impossible, and a body between the two, 0.12 % of the
friction wide, is undecided. Generalises E. Willert's Eqs. 1, 2, 16 and 19 to spots on slopes; cf. R. M. Murray, Z. Li and
S. S. Sastry 1994, chapter 5.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

IMPOSSIBLE, POSSIBLE, UNDECIDED = 0, 1, 2

EDGES = 64
RESIDUAL = 1e-6
"""Unbalanced force over the load, and unbalanced moment over load times size, that count as zero."""

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
    chosen = support.above == side
    n = support.normals
    if not chosen.any() or np.any(np.abs(n[:, 2]) < 1e-6):
        return IMPOSSIBLE if not chosen.any() else UNDECIDED
    inclines = -(n[:, :2] @ drag) / n[:, 2]
    steepest = inclines[chosen].max()
    sliding = chosen & (steepest - inclines <= reach)
    motion = np.array([*drag, steepest])
    tangents = motion - (n @ motion)[:, None] * n
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    # on the body: along the motion of the plate above, against its own motion over the plate below
    limits = n + support.friction[:, None] * (tangents if side else -tangents)
    stay = ~chosen | sliding
    loaded = support._replace(
        arms=support.arms[stay], normals=n[stay], friction=support.friction[stay], above=support.above[stay]
    )
    return _verdict(loaded, limits[sliding], sliding[stay], drag)


def _verdict(support: Support, limits: np.ndarray, sliding: np.ndarray, drag: np.ndarray) -> int:
    """Return what inner and outer polygons allow. `limits` (m, 3): forces per normal force of the m spots `sliding` (n,).

    Polygons have a corner along the drag: between parallel planes of equal friction both sides are at their limit there.
    """
    tangents = _tangents(support.normals, drag)
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


def _tangents(normals: np.ndarray, drag: np.ndarray) -> np.ndarray:
    """Return two unit vectors (n, 2, 3) across each normal, the first of them above or below the drag."""
    across = np.cross(normals, [*drag, 0.0])
    across /= np.linalg.norm(across, axis=1)[:, None]
    return np.stack([np.cross(across, normals), across], axis=1)
