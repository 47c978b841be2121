"""Elastic interaction through a plate between the spots of one body (`laws.contract.SpotInteraction`).

A spot with the normal force N_j lowers the plate at the spot i, at the distance r along the plate, by g N_j, g = c/r. So of the
overlap d_i only d_i - sum_j g_ij N_j presses on the spot itself:

    N_i = K_i (d_i - sum_j g_ij N_j)^(3/2),      K_i = 4/3 E* R_i^(1/2) of Hertz

All spots of a body on a side are solved at once. The energy is the sum of the springs, U_i(d_i - relief_i), and of the pairs,
1/2 sum_i N_i relief_i, with the relief sum_j g_ij N_j. Its derivative by d_i is N_i, as without interaction, and by g_ij is
-N_i N_j: where the distance of two spots changes, as the body turns, a force N_i N_j g/r along the plate draws them together. It
acts on the centres of the spheres. Contacts, laws and history are those of the relieved overlap; arms are those of the whole one.

The equations are those of a minimum of a convex function of the forces (`spot_loads`). Spots nearer than `spot_loads.NEAR` of the
smaller radius count as at that distance: their contact areas touch, if not more, and are no points for each other.
"""

from collections import namedtuple

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.spot_loads import LANES, lane, spot
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output

FIELDS = 4
"""Numbers of `Spots` per contact."""

FLOOR = 1e-9
"""Overlap that laws see of a spot that is relieved wholly, over the whole one: tangents would be infinite at none at all."""


Spots = namedtuple("Spots", "relief force pull_x pull_y rows")
"""Of each spot: relief [m], normal force [N], force along the plate on the sphere [N]; and scratch (`scratch_of`)."""


def scratch_of(n):
    """Return the numbers of scratch for n contacts: their fields, their rows, and lanes."""
    return FIELDS * n + spot.WIDTH * n + lane.WIDTH * LANES


@njit(**BARE)
def interact(context):
    """Return whether spots interact: `interaction` has the compliances of the plates, c [m2/N], then K/R^(1/2) of each pair."""
    return context.interaction.shape[0] > 0


@njit(**BARE)
def place_spots(t, n, filled, spots, G):
    """Write the n spots from number t on into the fields of a tile, and pad up to `filled` with the last one."""
    for q in range(filled):
        e = t + min(q, n - 1)
        G[q + geometry.RELIEF * TILE], G[q + geometry.SPOT_FORCE * TILE] = spots.relief[e], spots.force[e]
        G[q + geometry.PULL * TILE], G[q + (geometry.PULL + 1) * TILE] = spots.pull_x[e], spots.pull_y[e]


@njit(**BARE)
def spots_of(tile):
    """Return the fields of a tile as spots, for the contacts of one body."""
    G, a, b = tile.geometry, geometry.RELIEF * TILE, geometry.SPOT_FORCE * TILE
    c, d = geometry.PULL * TILE, (geometry.PULL + 1) * TILE
    return Spots(G[a : a + TILE], G[b : b + TILE], G[c : c + TILE], G[d : d + TILE], tile.outputs)


@njit(**BARE)
def spots_in(gaps):
    """Return the scratch of a group, which its overlaps no longer need, as spots."""
    n = (gaps.shape[0] - lane.WIDTH * LANES) // (FIELDS + spot.WIDTH)
    return Spots(gaps[:n], gaps[n : 2 * n], gaps[2 * n : 3 * n], gaps[3 * n : 4 * n], gaps[FIELDS * n :])


@njit(**BARE)
def relieve(n, tile):
    """Relieve the overlaps of n contacts, for the laws."""
    I, G = tile.inputs, tile.geometry  # noqa: E741
    for q in range(n):
        overlap = I[q + law_input.OVERLAP * TILE]
        G[q + geometry.OVERLAP * TILE] = overlap
        I[q + law_input.OVERLAP * TILE] = max(overlap - G[q + geometry.RELIEF * TILE], FLOOR * overlap)


@njit(**BARE)
def restore(n, tile):
    for q in range(n):
        tile.inputs[q + law_input.OVERLAP * TILE] = tile.geometry[q + geometry.OVERLAP * TILE]


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
