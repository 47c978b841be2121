"""Balance of a wrench by friction cones, by linear programming: any weight, normals, and friction per spot.

Reference of `hull_conditions`, and of `three_spot_theory` in the plane, which are exact where they hold. A cone is approximated
by an inscribed pyramid of K edges; the circumscribed one is that of a friction larger by 1/cos(pi/K), so one search gives both
ends of a bracket. Feasibility grows with friction, hence bisection. Imports nothing of thirdbody. Cf. static slip and sliding
in E. Willert's Eqs. 1 and 20, and force closure of grasps (R. M. Murray, Z. Li, S. S. Sastry 1994, chapter 5).

Arrays: `points` (n, 3) [m], from the reference point of `moment` (the centre of mass); `normals` (n, 3), unit, into the
particle; `mu` (n,); `pressed` (n,) bool, the spots (of one side) whose normal forces add up to `load` [N]: else zero forces are
a solution."""

import math
from types import SimpleNamespace as Grasp

import numpy as np
from scipy.optimize import linprog

EDGES = 32
LARGEST, ROUNDS = 1e3, 60  # scale of friction beyond which a wrench counts as out of reach; bisections
RESIDUAL = 1e-8  # unbalanced wrench that counts as zero, over the load (forces) and load times largest arm (moments)
PRECISE = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


def grasp(points, normals, mu, pressed, load=1.0, force=(0.0, 0.0, 0.0), moment=(0.0, 0.0, 0.0), axis=None):
    """Spots that hold a particle against an external force (3,) [N] and moment (3,) [N m]. With `axis` (3,) friction acts along
    it only and the plane's cones are exact: no pyramids."""
    force, moment, axis = (None if given is None else np.asarray(given, float) for given in (force, moment, axis))
    mu = np.broadcast_to(np.asarray(mu, float), (len(points),))
    return Grasp(points=points, normals=normals, mu=mu, pressed=pressed, load=load, force=force, moment=moment, axis=axis)


def between_plates(upper, lower, h, mu_upper, mu_lower, weight_ratio=0.0, axis=None):
    """`Grasp` of a particle between horizontal plates, spots at (n, 2) [m] from the centre of mass, at +-h/2. `weight_ratio` = m
    g/N_1, N_1 = 1 the load of the upper side."""
    above, below = (np.asarray(side, dtype=np.float64).reshape(-1, 2) for side in (upper, lower))
    signs = np.repeat([1.0, -1.0], [len(above), len(below)])
    points = np.column_stack([np.concatenate([above, below]), 0.5 * h * signs])
    normals = np.column_stack([np.zeros((len(signs), 2)), -signs])
    mu = np.where(signs > 0.0, mu_upper, mu_lower)
    return grasp(points, normals, mu, signs > 0.0, 1.0, (0.0, 0.0, -weight_ratio), axis=axis)


def required_scale(grasp, edges=EDGES, accuracy=1e-7):
    """(lower, upper) bracket of the smallest s for which cones of friction s mu_i balance the wrench. upper/lower = 1/cos(pi/K)
    up to `accuracy` of the bisection (relative; below it, absolute); without pyramids (`axis`) the bisection is the only error.
    (inf, inf) beyond `LARGEST`. Sticking is possible if upper <= 1 and impossible if lower > 1."""
    shrink = 1.0 if grasp.axis is not None else math.cos(math.pi / edges)
    if can_balance(grasp, 0.0, edges):
        return 0.0, 0.0
    low, high = 0.0, 1.0
    while not can_balance(grasp, high, edges):
        low, high = high, 4.0 * high
        if high > LARGEST:
            return math.inf, math.inf
    for _ in range(ROUNDS):
        if high - low <= accuracy * max(high, 1.0):
            break
        middle = 0.5 * (low + high)
        if can_balance(grasp, middle, edges):
            high = middle
        else:
            low = middle
    return low * shrink, high


def can_balance(grasp, scale=1.0, edges=EDGES):
    """Whether inscribed pyramids of friction `scale` mu_i balance the wrench; circumscribed ones with `scale`/cos(pi/K)."""
    return _feasible(grasp, _cone_rays(grasp, scale, edges))


def can_slide(grasp, friction_directions, sliding=True, edges=EDGES):
    """Return whether spot forces balance the wrench if those of the spots `sliding` (n,), all by default, are at their limit.
    These are N_i (n_i + mu_i pull_i); `friction_directions` (n, 3): unit direction of the friction on the particle at each spot:
    along the drag above, against it below. The others lie anywhere inside pyramids of `edges` edges."""
    limits = (grasp.normals + grasp.mu[:, None] * np.asarray(friction_directions, dtype=np.float64))[:, None, :]
    chosen = np.broadcast_to(np.asarray(sliding, dtype=bool), (len(grasp.points),))
    if chosen.all():
        return _feasible(grasp, limits)
    return _feasible(grasp, np.where(chosen[:, None, None], limits, _cone_rays(grasp, 1.0, edges)))


def _cone_rays(grasp, scale, edges):
    """Edges (n, k, 3) of the pyramids of friction `scale` mu_i, of normal part 1; in the plane the two edges of the cone."""
    if grasp.axis is not None:
        line = grasp.axis / np.linalg.norm(grasp.axis)
        directions = np.broadcast_to(np.stack([line, -line]), (len(grasp.points), 2, 3))
    else:
        angles = 2.0 * math.pi * np.arange(edges) / edges
        first = np.cross(grasp.normals, np.where(np.abs(grasp.normals[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]))
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second = np.cross(grasp.normals, first)
        directions = np.cos(angles)[:, None] * first[:, None, :] + np.sin(angles)[:, None] * second[:, None, :]
    return grasp.normals[:, None, :] + scale * grasp.mu[:, None, None] * directions


def _feasible(grasp, rays):
    """Return whether non-negative multiples of the rays (n, k, 3), each of normal part 1, balance wrench and load."""
    count, edges = rays.shape[:2]
    arms = grasp.points - grasp.points.mean(axis=0)
    size = max(float(np.max(np.abs(arms))), np.finfo(np.float64).tiny)  # lengths and forces of order 1 for the solver
    wrench = np.concatenate([rays, np.cross(arms[:, None, :] / size, rays)], axis=2).reshape(count * edges, 6).T
    pressed = np.repeat(grasp.pressed.astype(np.float64), edges)
    rotation = grasp.moment - np.cross(grasp.points.mean(axis=0), grasp.force)
    right = np.concatenate([-grasp.force / grasp.load, -rotation / (grasp.load * size), [1.0]])
    balance = np.vstack([wrench, pressed])
    # the residual is minimised, not forbidden: at the edge of feasibility, a plain feasibility search fails
    identity = np.eye(len(balance))
    costs = np.concatenate([np.zeros(count * edges), np.ones(2 * len(balance))])
    result = linprog(costs, A_eq=np.hstack([balance, identity, -identity]), b_eq=right, method="highs", options=PRECISE)
    if result.status != 0:
        raise ArithmeticError(f"the linear program gave no answer: {result.message}")
    return bool(result.fun <= RESIDUAL)
