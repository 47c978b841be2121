"""Elastic interaction through a plate between the spots of one body (`laws.contract.SpotInteraction`).

A spot with the normal force N_j lowers the plate at the spot i, at the distance r along the plate, by g N_j, g = c/r. So of the
overlap d_i only d_i - sum_j g_ij N_j presses on the spot itself:

    N_i = K_i (d_i - sum_j g_ij N_j)^(3/2),      K_i = 4/3 E* R_i^(1/2) of Hertz

All spots of a body on a side are solved at once. The energy is the sum of the springs, U_i(d_i - relief_i), and of the pairs,
1/2 sum_i N_i relief_i, with the relief sum_j g_ij N_j. Its derivative by d_i is N_i, as without interaction, and by g_ij is
-N_i N_j: where the distance of two spots changes, as the body turns, a force N_i N_j g/r along the plate draws them together. It
acts on the centres of the spheres. Contacts, laws and history are those of the relieved overlap; arms are those of the whole one.

The equations are those of a minimum of a convex function of the forces, in which each sweep minimises by one force after the
other: that converges from any start. Spots nearer than NEAR of the smaller radius count as at that distance: their contact areas
touch, if not more, and are no points for each other.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels import first_body
from thirdbody.kernels.columns import geometry, law_input, law_output, sphere
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.predicates import is_lower

Array = np.ndarray

NEAR = 0.05
"""Least distance of two spots over the smaller radius. A contact area has this radius at an overlap of 0.0025 radii."""

SWEEPS = 60
"""Most sweeps. Spots at 10, 3 and 2 contact radii take 6, 9 and 12 to rounding."""

ACCURACY = 1e-15
"""Change of the relief over the overlap that ends the sweeps."""


class Spots(NamedTuple):
    """Of each spot: relief [m], normal force [N], force along the plate on the sphere [N]; and scratch."""

    relief: Array
    force: Array
    pull_x: Array
    pull_y: Array
    scratch: Array


@njit(**BARE)
def interact(context):
    """Return whether spots interact: `interaction` has the compliances of the plates, c [m2/N], then K/R^(1/2) of each pair."""
    return context.interaction.shape[0] > 0


@njit(**BARE)
def compliance(k, m, context):
    """Return g of two candidates with plates [m/N], and its gradient with the place of the first one [1/N]; 0 on two sides."""
    i, j, S = context.own[k], context.own[m], context.S
    low = is_lower(context.partner[k])
    if low != is_lower(context.partner[m]):
        return 0.0, 0.0, 0.0
    x, y = S[i, sphere.ARM] - S[j, sphere.ARM], S[i, sphere.ARM + 1] - S[j, sphere.ARM + 1]
    r, near = math.sqrt(x * x + y * y), NEAR * min(S[i, sphere.RADIUS], S[j, sphere.RADIUS])
    g = context.interaction[0 if low else 1] / max(r, near)
    slope = -g / (r * r) if r > near else 0.0
    return g, slope * x, slope * y


@njit(**BARE)
def spot_force(k, overlap, context):
    """Return Hertz' force of candidate k at its relieved overlap [N]."""
    depth = max(overlap, 0.0)
    return context.interaction[2 + context.kind[k]] * math.sqrt(first_body.effective_radius(k, context) * depth) * depth


@njit(**BARE_CHUNK)
def solve_spots(first, last, slots, context, spots):
    """Solve the spots slots[first:last], all of one body; the scratch holds g if it is large enough."""
    n, relief, force, g = last - first, spots.relief, spots.force, spots.scratch
    fits = n * n <= g.shape[0]
    for e in range(first, last):
        relief[e], spots.pull_x[e], spots.pull_y[e] = 0.0, 0.0, 0.0
        force[e] = spot_force(slots[e], first_body.overlap(slots[e], context), context)
        for f in range(first, last if fits else first):
            g[(e - first) * n + f - first] = compliance(slots[e], slots[f], context)[0] if e != f else 0.0
    for _ in range(SWEEPS if n > 1 else 0):
        change = 0.0
        for e in range(first, last):
            total, overlap = 0.0, first_body.overlap(slots[e], context)
            for f in range(first, last):
                if e != f:
                    total += (g[(e - first) * n + f - first] if fits else compliance(slots[e], slots[f], context)[0]) * force[f]
            change = max(change, abs(total - relief[e]) / overlap)
            relief[e], force[e] = total, spot_force(slots[e], overlap - total, context)
        if change < ACCURACY:
            break
    for e in range(first, last):
        for f in range(first, last):
            if e != f:
                _, x, y = compliance(slots[e], slots[f], context)
                spots.pull_x[e] += force[e] * force[f] * x
                spots.pull_y[e] += force[e] * force[f] * y


@njit(**BARE_CHUNK)
def solve_bodies(m, slots, context, spots):
    """Solve the m contacts with plates slots[:m], in order of their bodies, body by body."""
    first = np.int64(0)
    while first < m:
        b, last = context.body[context.own[slots[first]]], first + 1
        while last < m and context.body[context.own[slots[last]]] == b:
            last += 1
        solve_spots(first, last, slots, context, spots)
        first = last


@njit(**BARE)
def place_spots(t, m, spots, G):
    """Write the spots from number t on, of m, into the fields of a tile."""
    for q in range(TILE):
        e = min(t + q, m - 1)
        G[q + geometry.RELIEF * TILE], G[q + geometry.SPOT_FORCE * TILE] = spots.relief[e], spots.force[e]
        G[q + geometry.PULL * TILE], G[q + (geometry.PULL + 1) * TILE] = spots.pull_x[e], spots.pull_y[e]


@njit(**BARE)
def spots_of(tile):
    """Return the fields of a tile as spots, for the contacts of one body."""
    G, a, b = tile.geometry, geometry.RELIEF * TILE, geometry.SPOT_FORCE * TILE
    c, d = geometry.PULL * TILE, (geometry.PULL + 1) * TILE
    return Spots(G[a : a + TILE], G[b : b + TILE], G[c : c + TILE], G[d : d + TILE], tile.outputs)


@njit(**BARE)
def spots_in(gaps, tile):
    """Return the scratch of a group, which its overlaps no longer need, as spots."""
    n = gaps.shape[0] // 4
    return Spots(gaps[:n], gaps[n : 2 * n], gaps[2 * n : 3 * n], gaps[3 * n :], tile.outputs)


@njit(**BARE)
def relieve(n, tile):
    """Relieve the overlaps of n contacts, for the laws."""
    I, G = tile.inputs, tile.geometry  # noqa: E741
    for q in range(n):
        I[q + law_input.OVERLAP * TILE] = max(I[q + law_input.OVERLAP * TILE] - G[q + geometry.RELIEF * TILE], 0.0)


@njit(**BARE)
def restore(n, slots, context, tile):
    """Restore the overlaps of the contacts slots[:n]."""
    for q in range(n):
        tile.inputs[q + law_input.OVERLAP * TILE] = first_body.overlap(slots[q], context)


@njit(**BARE)
def add_interaction_energy(n, tile):
    """Add the energy of the pairs to that of the normal springs, half of it to either spot."""
    O, G = tile.outputs, tile.geometry  # noqa: E741
    for q in range(n):
        O[q + law_output.STORED_NORMAL * TILE] += 0.5 * G[q + geometry.RELIEF * TILE] * G[q + geometry.SPOT_FORCE * TILE]


@njit(**BARE)
def add_pull(n, tile):
    """Add the forces along the plate to the forces of n contacts."""
    G = tile.geometry
    for q in range(n):
        G[q + geometry.FORCE * TILE] += G[q + geometry.PULL * TILE]
        G[q + (geometry.FORCE + 1) * TILE] += G[q + (geometry.PULL + 1) * TILE]
