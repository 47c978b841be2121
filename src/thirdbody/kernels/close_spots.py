"""Elastic interaction through a plate between the spots of one body (`laws.contract.SpotInteraction`).

A spot with the normal force N_j lowers the plate at the spot i, at the distance r along the plate, by g N_j, g = c/r. So of the
overlap d_i only d_i - sum_j g_ij N_j presses on the spot itself:

    N_i = K_i (d_i - sum_j g_ij N_j)^(3/2),      K_i = 4/3 E* R_i^(1/2) of Hertz

The energy is the sum of the springs, U_i(d_i - relief_i), and of the pairs, 1/2 sum_i N_i relief_i, with the relief
sum_j g_ij N_j. Its derivative by d_i is N_i, as without interaction, and by g_ij is -N_i N_j: as the distance of two spots
changes, a force N_i N_j g/r along the plate draws them together, at the centres of the spheres. Contacts, laws and history are
those of the relieved overlap; arms are those of the whole one. Spots nearer than NEAR of the smaller radius count as at that
distance. With the contact radius a = (R (d - relief))^(1/2) of each spot, N = Q a^3, Q = K/R:

    a_i^2 + R_i sum_j g_ij Q_j a_j^3 = R_i d_i

Two and three spots are solved by Newton's method from a start that is right to the second order in relief over overlap. They wait
in lanes until there are enough for the processor's vectors: an explicit step of clumps takes 1.2 to 1.3 times as long as without
the effect, 1.5 one by one, 2.5 by sweeps. More spots, and those of which one is relieved wholly, are solved by sweeps that
minimise the convex energy by one force after the other. Nothing is kept from step to step.
"""

import math
from collections import namedtuple

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.jit.simd import extract
from thirdbody.kernels import plates
from thirdbody.kernels.bodies import arm_to_sphere
from thirdbody.kernels.plates import is_lower, kind_of
from thirdbody.kernels.table import Table, number, vector
from thirdbody.kernels.tables import sphere
from thirdbody.kernels.tile import TILE, geometry, law_input, law_output

NEAR = 0.05
"""Least distance of two spots over the smaller radius. A contact area has this radius at an overlap of 0.0025 radii."""

STEP = 2e-8  # largest last step of a contact radius over the radius: what is left is of the order of its square
LANES = 8  # groups of spots that are solved together
FAR = 1.0  # place of a spot that carries nothing [m]
SWEEPS = 60  # most sweeps. Spots at 10, 3 and 2 contact radii take 6, 9 and 12 to rounding
ACCURACY = 1e-15  # change of the relief over the overlap that ends the sweeps

spot = Table(
    "W",
    "a spot of a body",
    number=number("", "its contact, in the list of the group"),
    x=number("m", "centre of its sphere from that of its body, along x"),
    y=number("m", "the same along y"),
    radius=number("m", "effective radius"),
    overlap=number("m", "overlap with the undeformed plate"),
    factor=number("N/m3", "force over the cube of the contact radius"),
    sphere_radius=number("m", "radius of its sphere"),
)

lane = Table(
    "L",
    "two or three spots of a body on one plate, a lane of LANES",
    row=number("", "where its rows of W begin"),
    count=number("", "number of its spots"),
    compliance=number("m2/N", "displacement of the plate times distance over force"),
    x=vector(3, "m", "centres of the spheres from that of the body, along x"),
    y=vector(3, "m", "the same along y"),
    radius=vector(3, "m", "effective radii"),
    sphere_radius=vector(3, "m", "radii of the spheres"),
    factor=vector(3, "N/m3", "forces over the cubes of the contact radii"),
    square=vector(3, "m2", "squares of the contact radii that they would have alone"),
    converged=number("", "1: Newton's method converged"),
    force=vector(3, "N", "normal forces"),
    relief=vector(3, "m", "what the others lower the plate"),
    pull_x=vector(3, "N", "forces along the plate, along x"),
    pull_y=vector(3, "N", "the same along y"),
)


@njit(**BARE)
def gather_spot(e, k, at, context, W):
    i, S = context.own[k], context.S
    radius, arm = plates.effective_radius(k, context), arm_to_sphere(i, S)
    W[at + spot.NUMBER], W[at + spot.X], W[at + spot.Y] = e, extract(arm, 0), extract(arm, 1)
    W[at + spot.RADIUS], W[at + spot.OVERLAP] = radius, plates.overlap(k, context)
    W[at + spot.FACTOR] = context.interaction[2 + kind_of(k, context)] / radius
    W[at + spot.SPHERE_RADIUS] = S[i, sphere.RADIUS]


@njit(**BARE)
def compliance(a, b, c, W):
    """Return g of the spots in rows a and b [m/N], and minus its gradient with the place of a [1/N]."""
    x, y = W[a + spot.X] - W[b + spot.X], W[a + spot.Y] - W[b + spot.Y]
    square, near = x * x + y * y, NEAR * min(W[a + spot.SPHERE_RADIUS], W[b + spot.SPHERE_RADIUS])
    if square > near * near:
        inverse = 1.0 / math.sqrt(square)
        slope = c * inverse * inverse * inverse
        return c * inverse, slope * x, slope * y
    return c / near, 0.0, 0.0


@njit(**BARE)
def finish(a, force, relief, pull, W, spots):
    e = np.uint64(W[a + spot.NUMBER])
    spots.relief[e], spots.force[e], (spots.pull_x[e], spots.pull_y[e]) = relief, force, pull


@njit(**BARE)
def lone_square(a, W):
    """Return the square of the contact radius [m2] that a spot would have alone."""
    return W[a + spot.RADIUS] * W[a + spot.OVERLAP]


@njit(**BARE)
def lone_force(a, W):
    square = max(lone_square(a, W), 0.0)
    return W[a + spot.FACTOR] * math.sqrt(square) * square


@njit(**BARE_CHUNK)
def sweep(first, n, c, W, G, spots):
    """Solve n spots in the rows from `first` on by sweeps. G: scratch for g; where it is too small, g is computed anew."""
    end, stored = first + n * spot.WIDTH, n * n <= G.shape[0]
    for p in range(n if stored else 0):
        for q in range(n):
            G[p * n + q] = compliance(first + p * spot.WIDTH, first + q * spot.WIDTH, c, W)[0] if p != q else 0.0
    for a in range(first, end, spot.WIDTH):
        finish(a, lone_force(a, W), 0.0, (0.0, 0.0), W, spots)
    for _ in range(SWEEPS):
        change = 0.0
        for p in range(n):
            a, total = first + p * spot.WIDTH, 0.0
            for q in range(n):
                b = first + q * spot.WIDTH
                g = G[p * n + q] if stored else compliance(a, b, c, W)[0] if p != q else 0.0
                total += g * spots.force[int(W[b + spot.NUMBER])]
            change = max(change, abs(total - spots.relief[int(W[a + spot.NUMBER])]) / W[a + spot.OVERLAP])
            square = max(lone_square(a, W) - W[a + spot.RADIUS] * total, 0.0)
            finish(a, W[a + spot.FACTOR] * math.sqrt(square) * square, total, (0.0, 0.0), W, spots)
        if change < ACCURACY:
            break
    for a in range(first, end, spot.WIDTH):
        e = int(W[a + spot.NUMBER])
        for b in range(first, end, spot.WIDTH):
            if a != b:
                _, x, y = compliance(a, b, c, W)
                both = spots.force[e] * spots.force[int(W[b + spot.NUMBER])]
                spots.pull_x[e] -= both * x
                spots.pull_y[e] -= both * y


@njit(**BARE)
def read_lane(at, L):
    return L[at], L[at + LANES], L[at + 2 * LANES]


@njit(**BARE)
def write_lane(at, L, v):
    L[at], L[at + LANES], L[at + 2 * LANES] = v


@njit(**BARE)
def lane_compliance(t, p, q, L):
    """Return g of spots p and q in lane t [m/N], and minus its gradient with the place of p [1/N]."""
    x = L[t + (lane.X + p) * LANES] - L[t + (lane.X + q) * LANES]
    y = L[t + (lane.Y + p) * LANES] - L[t + (lane.Y + q) * LANES]
    near = NEAR * min(L[t + (lane.SPHERE_RADIUS + p) * LANES], L[t + (lane.SPHERE_RADIUS + q) * LANES])
    square = x * x + y * y
    inverse = 1.0 / math.sqrt(max(square, near * near))
    g = L[t + lane.COMPLIANCE * LANES] * inverse
    slope = g * inverse * inverse if square > near * near else 0.0
    return g, slope * x, slope * y


@njit(**BARE)
def newton_step(radii, compliances, one, two, three):
    """Return contact radii of three spots after a step of Newton's method, and the steps; g of the pairs 1 2, 1 3 and 2 3."""
    (u1, u2, u3), (g, h, k), (r1, q1, y1), (r2, q2, y2), (r3, q3, y3) = radii, compliances, one, two, three
    n1, n2, n3 = q1 * u1 * u1, q2 * u2 * u2, q3 * u3 * u3
    e1 = u1 * u1 + r1 * (g * n2 * u2 + h * n3 * u3) - y1
    e2 = u2 * u2 + r2 * (g * n1 * u1 + k * n3 * u3) - y2
    e3 = u3 * u3 + r3 * (h * n1 * u1 + k * n2 * u2) - y3
    m11, m12, m13 = 2.0 * u1, 3.0 * r1 * g * n2, 3.0 * r1 * h * n3
    m21, m22, m23 = 3.0 * r2 * g * n1, 2.0 * u2, 3.0 * r2 * k * n3
    m31, m32, m33 = 3.0 * r3 * h * n1, 3.0 * r3 * k * n2, 2.0 * u3
    c11, c12, c13 = m22 * m33 - m23 * m32, m13 * m32 - m12 * m33, m12 * m23 - m13 * m22
    c21, c22, c23 = m23 * m31 - m21 * m33, m11 * m33 - m13 * m31, m13 * m21 - m11 * m23
    c31, c32, c33 = m21 * m32 - m22 * m31, m12 * m31 - m11 * m32, m11 * m22 - m12 * m21
    inverse = 1.0 / (m11 * c11 + m12 * c21 + m13 * c31)
    d1 = (c11 * e1 + c12 * e2 + c13 * e3) * inverse
    d2 = (c21 * e1 + c22 * e2 + c23 * e3) * inverse
    d3 = (c31 * e1 + c32 * e2 + c33 * e3) * inverse
    return (u1 - d1, u2 - d2, u3 - d3), (d1, d2, d3)


@njit(**BARE_CHUNK)
def solve_lanes(L):
    """Solve the groups in all lanes, unused ones too, in equally many steps: the bits of one do not depend on the others."""
    for t in range(LANES):
        g, g_x, g_y = lane_compliance(t, 0, 1, L)
        h, h_x, h_y = lane_compliance(t, 0, 2, L)
        k, k_x, k_y = lane_compliance(t, 1, 2, L)
        r1, r2, r3 = read_lane(t + lane.RADIUS * LANES, L)
        q1, q2, q3 = read_lane(t + lane.FACTOR * LANES, L)
        y1, y2, y3 = read_lane(t + lane.SQUARE * LANES, L)
        f1, f2, f3 = q1 * y1 * math.sqrt(y1), q2 * y2 * math.sqrt(y2), q3 * y3 * math.sqrt(y3)
        t1 = f1 * y1 / (y1 + 1.5 * r1 * (g * f2 + h * f3))
        t2 = f2 * y2 / (y2 + 1.5 * r2 * (g * f1 + k * f3))
        t3 = f3 * y3 / (y3 + 1.5 * r3 * (h * f1 + k * f2))
        u1 = math.sqrt(y1 - r1 * (g * t2 + h * t3))
        u2 = math.sqrt(y2 - r2 * (g * t1 + k * t3))
        u3 = math.sqrt(y3 - r3 * (h * t1 + k * t2))
        c1, c2, c3 = (r1, q1, y1), (r2, q2, y2), (r3, q3, y3)
        (u1, u2, u3), _ = newton_step((u1, u2, u3), (g, h, k), c1, c2, c3)
        (u1, u2, u3), _ = newton_step((u1, u2, u3), (g, h, k), c1, c2, c3)
        (u1, u2, u3), (d1, d2, d3) = newton_step((u1, u2, u3), (g, h, k), c1, c2, c3)
        worst = max(abs(d1) - STEP * u1, abs(d2) - STEP * u2, abs(d3) - STEP * u3)
        L[t + lane.CONVERGED * LANES] = 1.0 if worst < 0.0 else 0.0  # a NaN compares as false
        f1, f2, f3 = q1 * u1 * u1 * u1, q2 * u2 * u2 * u2, q3 * u3 * u3 * u3
        write_lane(t + lane.FORCE * LANES, L, (f1, f2, f3))
        write_lane(t + lane.RELIEF * LANES, L, (g * f2 + h * f3, g * f1 + k * f3, h * f1 + k * f2))
        x = -f1 * (f2 * g_x + f3 * h_x), f2 * (f1 * g_x - f3 * k_x), f3 * (f1 * h_x + f2 * k_x)
        y = -f1 * (f2 * g_y + f3 * h_y), f2 * (f1 * g_y - f3 * k_y), f3 * (f1 * h_y + f2 * k_y)
        write_lane(t + lane.PULL_X * LANES, L, x)
        write_lane(t + lane.PULL_Y * LANES, L, y)


@njit(**BARE_CHUNK)
def finish_lanes(count, L, W, G, spots):
    """Solve the groups in lanes 0 to `count`; by sweeps where Newton's method did not converge."""
    solve_lanes(L)
    for t in range(count):
        first, n = int(L[t + lane.ROW * LANES]), int(L[t + lane.COUNT * LANES])
        if L[t + lane.CONVERGED * LANES] > 0.0:
            for p in range(n):
                at = t + p * LANES
                pull = L[at + lane.PULL_X * LANES], L[at + lane.PULL_Y * LANES]
                finish(first + p * spot.WIDTH, L[at + lane.FORCE * LANES], L[at + lane.RELIEF * LANES], pull, W, spots)
        else:
            sweep(first, n, L[t + lane.COMPLIANCE * LANES], W, G, spots)


@njit(**BARE)
def solve_side(count, first, n, c, L, W, G, spots):
    """Solve n spots in the rows from `first` on, or put two or three into lane `count`; return the number of lanes in use."""
    if n == 1:
        finish(first, lone_force(first, W), 0.0, (0.0, 0.0), W, spots)
    elif n > 3:
        sweep(first, n, c, W, G, spots)
    elif n > 1:
        L[count + lane.ROW * LANES], L[count + lane.COUNT * LANES], L[count + lane.COMPLIANCE * LANES] = first, n, c
        for p in range(3):
            a, at = first + p * spot.WIDTH, count + p * LANES
            on = p < n
            L[at + lane.X * LANES] = W[a + spot.X] if on else FAR
            L[at + lane.Y * LANES] = W[a + spot.Y] if on else FAR
            L[at + lane.RADIUS * LANES] = W[a + spot.RADIUS] if on else 1.0
            L[at + lane.SPHERE_RADIUS * LANES] = W[a + spot.SPHERE_RADIUS] if on else 0.0
            L[at + lane.FACTOR * LANES] = W[a + spot.FACTOR] if on else 0.0
            L[at + lane.SQUARE * LANES] = lone_square(a, W) if on else 1.0
        count += 1
    return count


@njit(**BARE)
def tables(rows):
    return rows[: lane.WIDTH * LANES], rows[lane.WIDTH * LANES :]


@njit(**BARE)
def solve_spots(count, first, last, slots, context, spots):
    """Solve the spots slots[first:last] of a body, or put them into at most two more lanes; return how many lanes are in use."""
    L, W = tables(spots.rows)
    low, high = first, last
    for e in range(first, last):
        k = slots[e]
        if is_lower(context.partner[k]):
            gather_spot(e, k, low * spot.WIDTH, context, W)
            low += 1
        else:
            high -= 1
            gather_spot(e, k, high * spot.WIDTH, context, W)
    G = W[last * spot.WIDTH :]
    count = solve_side(count, first * spot.WIDTH, low - first, context.interaction[0], L, W, G, spots)
    return solve_side(count, high * spot.WIDTH, last - high, context.interaction[1], L, W, G, spots)


@njit(**BARE_CHUNK)
def solve_bodies(m, slots, context, spots):
    L, W = tables(spots.rows)
    first, count = np.int64(0), np.int64(0)
    while first < m:
        b, last = context.body[context.own[slots[first]]], first + 1
        while last < m and context.body[context.own[slots[last]]] == b:
            last += 1
        count = solve_spots(count, first, last, slots, context, spots)
        if count > LANES - 2 or last == m:
            finish_lanes(count, L, W, W[m * spot.WIDTH :], spots)
            count = np.int64(0)
        first = last


FIELDS = 4  # numbers of `Spots` per contact

FLOOR = 1e-9
"""Overlap that laws see of a spot that is relieved wholly, over the whole one: tangents would be infinite at none at all."""

Spots = namedtuple("Spots", "relief force pull_x pull_y rows")
"""Of each spot: relief [m], normal force [N], force along the plate on the sphere [N]; and scratch (`scratch_of`)."""


def scratch_of(n):
    return FIELDS * n + spot.WIDTH * n + lane.WIDTH * LANES


@njit(**BARE)
def interact(context):
    """Return whether spots interact: `interaction` has the compliances of the plates, c [m2/N], then K/R^(1/2) of each pair."""
    return context.interaction.shape[0] > 0


@njit(**BARE)
def relieve(n, tile):
    I, G = tile.inputs, tile.geometry  # noqa: E741
    for q in range(n):
        overlap = I[q + law_input.OVERLAP * TILE]
        I[q + law_input.OVERLAP * TILE] = max(overlap - G[q + geometry.RELIEF * TILE], FLOOR * overlap)


@njit(**BARE)
def restore(n, slots, context, tile):
    for q in range(n):
        tile.inputs[q + law_input.OVERLAP * TILE] = plates.overlap(slots[q], context)


@njit(**BARE)
def add_interaction_energy(n, tile):
    """Add the energy of the pairs to that of the normal springs, half of it to either spot."""
    O, G = tile.outputs, tile.geometry  # noqa: E741
    for q in range(n):
        O[q + law_output.STORED_NORMAL * TILE] += 0.5 * G[q + geometry.RELIEF * TILE] * G[q + geometry.SPOT_FORCE * TILE]
