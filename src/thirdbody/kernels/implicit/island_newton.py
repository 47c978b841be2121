"""Damped Newton's method for one step of an island; writes no history.

As `newton` for one body: corrections are limited for all bodies by the same fraction, and the residual that has to fall is the
root of the sum of squares over all bodies, each over the forces that act on it at the first iteration.
"""

import math

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels.implicit.band_matrix import factorise_band, substitute_band
from thirdbody.kernels.implicit.bundles import FREEDOMS
from thirdbody.kernels.implicit.island_bundles import active_at, space_at
from thirdbody.kernels.implicit.newton import (
    ACCEPTED,
    CONVERGED,
    Outcome,
    euclidean_norm,
    force_scale,
    is_balanced,
    is_settled,
    limit_correction,
    rounding_at,
)
from thirdbody.kernels.implicit.pair_contacts import add_pair_forces, gather_pairs, limit_pair_overlaps, limit_pair_reversal
from thirdbody.kernels.implicit.pair_jacobian import assemble_island
from thirdbody.kernels.implicit.residual import active_contacts, residual, set_configuration
from thirdbody.kernels.implicit.tables import step_start
from thirdbody.kernels.tables import body, patch

ITERATIONS = 16
"""Maximum iterations: more than for one body (`newton.ITERATIONS`), since a shorter step is one of all bodies of the island."""

HALVINGS, LEAPS = 1, 2
"""Halvings of one correction, and corrections accepted although the residual grows, as `newton.LEAPS`."""


@njit(**BARE_CHUNK)
def evaluate(context, island, part, motion, pool):
    """Evaluate the residuals with `part` of the correction; return the number of contacts between bodies, -1 if crowded."""
    bodies = island.bodies.shape[0]
    for a in range(bodies):
        space = space_at(a, pool)
        for k in range(FREEDOMS):
            space.trial[k] = space.y[k] + part * space.correction[k]
        set_configuration(context, active_at(a, context, island), space.trial, motion.dt)
    for a in range(bodies):
        active, space = active_at(a, context, island), space_at(a, pool)
        pool.counts[a] = active_contacts(context, active, space.trial, motion, space)
        if pool.counts[a] < 0:
            return np.int64(-1)
        residual(context, active, pool.counts[a], space.trial, motion, space)
    m = gather_pairs(context, island, motion, pool)
    add_pair_forces(context, island, m, pool)
    return m


@njit(**BARE)
def rounding_force_of(context, active, diagnostics):
    """Return the residual [N] caused by rounding (`newton.rounding_force`): contacts between bodies feel all coordinates."""
    b, B, far = active.number, context.B, abs(context.P[active.patch, patch.HEIGHT])
    for k in range(3):
        far = max(far, abs(B[b, body.POSITION + k]) + active.start[step_start.ARM])
    return rounding_at(far, diagnostics)


@njit(**BARE_CHUNK)
def measure(context, island, first, dt, pool):
    """Return the relative norm of the residuals, the norm that is sufficient, and whether all bodies are solved, or nearly.

    `first`: these are the first ones of the step, whose forces are the scale.
    """
    square, smallest, solved, nearly = 0.0, 1e300, True, True
    for a in range(island.bodies.shape[0]):
        active, space = active_at(a, context, island), space_at(a, pool)
        now, scale = euclidean_norm(space.residual), force_scale(context, active, space.trial, dt, space.diagnostics)
        minimum = rounding_force_of(context, active, space.diagnostics)
        enough = max(CONVERGED * scale, minimum)
        pool.scales[a, 0] = scale
        if first:
            pool.scales[a, 1] = 1.0 / max(scale, 1e-300)
        if not (now <= enough and is_balanced(context, active, dt, CONVERGED, minimum, space)):
            solved = False
        if not (now <= max(ACCEPTED * scale, minimum) and is_balanced(context, active, dt, ACCEPTED, minimum, space)):
            nearly = False
        square += (now * pool.scales[a, 1]) ** 2
        smallest = min(smallest, enough * pool.scales[a, 1])
    return math.sqrt(square), smallest, solved, nearly


@njit(**BARE_CHUNK)
def solve_correction(island, pool):
    """Solve for the corrections of all bodies with the factors in `pool.band`."""
    bodies = island.bodies.shape[0]
    for a in range(bodies):
        for k in range(FREEDOMS):
            pool.solution[FREEDOMS * a + k] = pool.coordinates[a, 2, k]
    substitute_band(pool.band, pool.pivots, pool.solution, FREEDOMS * bodies, island.half_width)
    for a in range(bodies):
        for k in range(FREEDOMS):
            pool.coordinates[a, 3, k] = pool.solution[FREEDOMS * a + k]


@njit(**BARE_CHUNK)
def all_settled(context, island, pool):
    """Return whether the corrections of all bodies are negligible."""
    for a in range(island.bodies.shape[0]):
        space = space_at(a, pool)
        if not is_settled(context, euclidean_norm(space.residual), pool.scales[a, 0], space):
            return False
    return True


@njit(**BARE_CHUNK)
def limited_part(context, island, m, pool):
    """Return the fraction of the corrections that is tried first."""
    fraction = 1.0
    for a in range(island.bodies.shape[0]):
        part = limit_correction(context, active_at(a, context, island), pool.counts[a], space_at(a, pool))
        fraction = min(fraction, part)
    fraction = limit_pair_overlaps(context, island, fraction, pool)
    return limit_pair_reversal(context, island, m, fraction, pool)


@njit(**BARE)
def take_trial(island, pool):
    """Take the coordinates that were tried."""
    for a in range(island.bodies.shape[0]):
        for k in range(FREEDOMS):
            pool.coordinates[a, 0, k] = pool.coordinates[a, 1, k]


@njit(**BARE_CHUNK)
def newton_of_island(context, island, motion, pool):
    """Solve for the coordinates of all bodies, from a guess; return outcome, contacts between bodies, iterations (`newton`)."""
    dt, unknowns = motion.dt, FREEDOMS * island.bodies.shape[0]
    size, part, whole, halvings, leaps, iterations, first = 1e300, 0.0, 0.0, 0, 0, 0, True
    pool.coordinates[: island.bodies.shape[0], 3] = 0.0
    while True:
        m = evaluate(context, island, part, motion, pool)
        if m < 0:
            return Outcome.CROWDED, m, iterations
        now, enough, solved, nearly = measure(context, island, first, dt, pool)
        first = False
        if not now < 1e300:
            return Outcome.UNSOLVED, m, iterations
        better = now < (1.0 - 1e-4 * part) * size
        if not better and halvings < HALVINGS:
            halvings, part = halvings + 1, 0.5 * part
            continue
        if not better and halvings == HALVINGS and leaps < LEAPS and not solved:
            halvings, leaps, part = halvings + 1, leaps + 1, whole
            continue
        better = better or halvings > HALVINGS
        take_trial(island, pool)
        if solved:
            return Outcome.SOLVED, m, iterations
        if not better or iterations == ITERATIONS:
            return (Outcome.SOLVED if nearly else Outcome.UNSOLVED), m, iterations
        last = iterations > 0 and part == 1.0 and now * now <= enough * size
        size, halvings = now, 0
        if not last:
            assemble_island(context, island, m, dt, False, pool)
            if not factorise_band(pool.band, pool.pivots, unknowns, island.half_width):
                return Outcome.UNSOLVED, m, iterations
        solve_correction(island, pool)
        if last and context.has_effects == 0 and all_settled(context, island, pool):
            return Outcome.SOLVED, m, iterations
        iterations += 1
        part = whole = 1.0 if last else limited_part(context, island, m, pool)
