"""Conditions of sticking and sliding between parallel plates, in 3-D, without weight: convex hulls.

With one friction mu (of two: the smaller one) and no weight the particle is a strut: the upper resultant acts in the convex hull
P of the upper spots, the lower one in Q below, both on one line of action. So the force leans by q - p over the height h, and
T/N = (q - p)/h for some point of the difference set {q - p}. Sticking needs a point within mu h of the origin; sliding along e
the point mu h e itself, since every spot pulls the particle along e with mu N. Hulls may be segments or points. Weight adds a
moment: `three_spot_theory` in the plane, `friction_cones` in space. Generalises E. Willert's Eqs. 16, 19 and 20; nothing of
thirdbody.

Positions are (n, 2) arrays [m]; a direction needs no unit length."""

import math

import numpy as np

TOLERANCE = 1e-12  # of the largest |q - p|: positions nearer to a line than this lie on it
NEVER = (math.inf, -math.inf)  # the empty interval (t_min, t_max)


def convex_hull(points):
    """Corners (k, 2) of the convex hull, counter-clockwise; k = 2 for a segment, 1 for a point (A. M. Andrew 1979)."""
    ordered = [(float(x), float(y)) for x, y in np.unique(np.asarray(points, float), axis=0)]
    if len(ordered) < 3:
        return np.array(ordered)
    return np.array(_half(ordered)[:-1] + _half(ordered[::-1])[:-1])


def _half(ordered):
    chain = []
    for x, y in ordered:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2], chain[-1]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                break
            chain.pop()
        chain.append((x, y))
    return chain


def difference_hull(upper, lower):
    above, below = convex_hull(upper), convex_hull(lower)
    return convex_hull((below[:, None, :] - above[None, :, :]).reshape(-1, 2))


def hull_distance(upper, lower):
    """Distance of the two hulls [m]; 0 where they meet."""
    corners = difference_hull(upper, lower)
    side = np.roll(corners, -1, axis=0) - corners
    left = corners[:, 0] * side[:, 1] - corners[:, 1] * side[:, 0] >= 0.0  # the origin lies left of a side
    # the box: of collinear spots up to round-off, the hull is a sliver, and its whole line may count as left of every side
    if len(corners) > 2 and np.all(left) and np.all((corners.min(axis=0) <= 0.0) & (corners.max(axis=0) >= 0.0)):
        return 0.0
    square = np.maximum(np.sum(side**2, axis=1), np.finfo(np.float64).tiny)
    along = np.clip(-np.sum(corners * side, axis=1) / square, 0.0, 1.0)
    return float(np.min(np.hypot(*(corners + along[:, None] * side).T)))


def required_friction(upper, lower, h):
    """Smallest mu for which the particle can stick: dist(P, Q)/h. Two spots: |tan alpha| of Eq. 16."""
    return hull_distance(upper, lower) / h


def sliding_interval(upper, lower, h, direction):
    """(t_min, t_max): the t for which t h e lies in {q - p}, e = drag of the upper body; `NEVER` = (inf, -inf) if none. The
    particle can slide along e iff t_min <= mu <= t_max; above t_max it tips, or rotates about the vertical. In the plane (e
    toward -x) it is `three_spot_theory.planar_interval`."""
    e, corners = np.asarray(direction, float) / math.hypot(*direction), difference_hull(upper, lower)
    along, across = corners @ e, corners[:, 1] * e[0] - corners[:, 0] * e[1]
    across[np.abs(across) <= TOLERANCE * np.max(np.hypot(*corners.T))] = 0.0
    crossings = list(along[across == 0.0])
    for a, c, b, d in zip(along, across, np.roll(along, -1), np.roll(across, -1), strict=True):
        if c * d < 0.0:
            crossings.append(a + (b - a) * (c / (c - d)))
    return (min(crossings) / h, max(crossings) / h) if crossings else NEVER


def can_stick(upper, lower, h, mu):
    return required_friction(upper, lower, h) <= mu + _slack(upper, lower, h)


def can_slide(upper, lower, h, mu, direction):
    low, high = sliding_interval(upper, lower, h, direction)
    slack = _slack(upper, lower, h)
    return low - slack <= mu <= high + slack


def _slack(upper, lower, h):
    """Friction equivalent to a round-off of the positions."""
    return TOLERANCE * float(np.max(np.hypot(*difference_hull(upper, lower).T))) / h
