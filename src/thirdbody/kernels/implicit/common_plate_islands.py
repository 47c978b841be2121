"""Islands under one common plate: each is eliminated as one block of the arrow matrix (`common_plate`).

An island is solved for a given rise of the plate, as a body alone is. Its Schur complement takes one more right-hand side of its
band matrix: the column of the plate. Contacts between bodies do not feel the plate, so rows and columns of its rise are those of
the bodies.
"""

from numba import njit, types

from thirdbody.jit import options
from thirdbody.jit.arguments import PACKED
from thirdbody.jit.options import BARE, BARE_CHUNK, OPTIONS
from thirdbody.kernels.implicit.accept_pairs import accept_pairs
from thirdbody.kernels.implicit.accept_step import accept_step
from thirdbody.kernels.implicit.band_matrix import entry, factorise_band
from thirdbody.kernels.implicit.bundles import FREEDOMS, MOTION, context_of
from thirdbody.kernels.implicit.common_plate import begin_body, copy_start, end_step, plate_reaction, write_outcome
from thirdbody.kernels.implicit.island_bundles import active_at, space_at, tables_of
from thirdbody.kernels.implicit.island_newton import evaluate, newton_of_island, solve_correction
from thirdbody.kernels.implicit.island_step import errors_of, island_lands, island_of, label_bodies, pool_of_part
from thirdbody.kernels.implicit.newton import Outcome
from thirdbody.kernels.implicit.pair_contacts import save_pair_overlaps
from thirdbody.kernels.implicit.pair_jacobian import assemble_island
from thirdbody.kernels.implicit.tables import body_solution
from thirdbody.kernels.tables import patch


@njit(**BARE)
def separate_plate(a, spring, island, pool):
    """Write the column of the plate, for the body at position a, as a right-hand side, and take its rise out of the band.

    `spring`: stiffness of the spring of its patch [N/m]; 0: the plate itself touches the body.
    """
    J, column, first, band, w = pool.jacobian[a], pool.coordinates[a, 2], FREEDOMS * a, pool.band, island.half_width
    for k in range(FREEDOMS):
        column[k] = 0.0 if spring != 0.0 or k == 6 else J[k, 6]
    if spring != 0.0:
        column[6] = spring
        return
    for k in range(6):
        band[entry(first + k, first + 6, w)], band[entry(first + 6, first + k, w)] = 0.0, 0.0
    band[entry(first + 6, first + 6, w)] = -1.0


@njit(**BARE)
def body_stiffness(a, spring, pool):
    """Return d(plate_reaction)/d(rise of the plate) [N/m] of the body at position a, whose coordinates follow."""
    J, x = pool.jacobian[a], pool.coordinates[a, 3]
    if spring != 0.0:
        return spring * (x[6] - 1.0)
    own = J[6, 6]
    for k in range(6):
        own += J[6, k] * x[k]
    return own


@njit(**BARE_CHUNK)
def write_stiffness(context, island, m, dt, pool):
    """Write the changes of the forces on the plate with its rise, the island in equilibrium, to the solutions of its bodies."""
    bodies, P = island.bodies, context.P
    assemble_island(context, island, m, dt, True, pool)
    for a in range(bodies.shape[0]):
        separate_plate(a, P[context.patch[bodies[a]], patch.SPRING], island, pool)
    regular = factorise_band(pool.band, pool.pivots, FREEDOMS * bodies.shape[0], island.half_width)
    if regular:
        solve_correction(island, pool)
    for a in range(bodies.shape[0]):
        slope = body_stiffness(a, P[context.patch[bodies[a]], patch.SPRING], pool) if regular else 0.0
        context.solutions[bodies[a], body_solution.SLOPE] = slope


@njit(**BARE_CHUNK)
def solve_island(context, island, first_iteration, displacement, motion, pool):
    """Solve the step of an island for a given rise of the plate."""
    bodies, solutions = island.bodies, context.solutions
    for a in range(bodies.shape[0]):
        begin_body(context, active_at(a, context, island), first_iteration, displacement, motion, space_at(a, pool))
    if first_iteration:
        save_pair_overlaps(context, island)
    outcome, m, iterations = newton_of_island(context, island, motion, pool)
    landing = island_lands(context, island, m, pool)
    for a in range(bodies.shape[0]):
        write_outcome(context, active_at(a, context, island), outcome, iterations, landing, pool.coordinates[a, 0])
    if outcome != Outcome.SOLVED:
        return
    error, rotation = errors_of(context, island, m, True, motion, pool)
    for a in range(bodies.shape[0]):
        solution = solutions[bodies[a]]
        solution[body_solution.ERROR], solution[body_solution.ROTATION] = error, rotation
        push = plate_reaction(context, active_at(a, context, island), pool.counts[a], space_at(a, pool))
        solution[body_solution.PUSH] = push
    write_stiffness(context, island, m, motion.dt, pool)


@njit(**BARE_CHUNK)
def accept_island(context, tables, island, motion, ended, pool):
    """Accept the step of an island; `ended`: see `end_step`. Forces are evaluated again, as in `accept_body`."""
    bodies = island.bodies
    for a in range(bodies.shape[0]):
        copy_start(context, bodies[a], False, space_at(a, pool))
        for k in range(FREEDOMS):
            pool.coordinates[a, 3, k] = 0.0
    m = evaluate(context, island, 0.0, motion, pool)
    for a in range(bodies.shape[0]):
        accept_step(context, active_at(a, context, island), pool.counts[a], motion, True, space_at(a, pool))
    accept_pairs(context, island, m, motion, pool)
    for a in range(bodies.shape[0]):
        end_step(context, active_at(a, context, island), motion, ended, space_at(a, pool))
    if context.labels != 0:
        label_bodies(context, tables, island, pool)


_D, _B, _I = types.float64, types.boolean, types.int64


@options.entry(types.void(_I, _B, _D, MOTION, PACKED, PACKED), nogil=True, **OPTIONS)
def solve_islands(part, first_iteration, displacement, motion, packed, packed_tables):
    """Solve the step of the islands of a part, in sequence, for a given rise of the plate [m].

    Arguments as in `common_plate_driver.solve_bodies`; `packed_tables`: packed `IslandTables`. The parts do not change a bit of
    the result.
    """
    context, tables = context_of(packed), tables_of(packed_tables)
    pool = pool_of_part(part, context, tables)
    for p in range(tables.part_edges[part], tables.part_edges[part + 1]):
        solve_island(context, island_of(tables.order[p], context, tables), first_iteration, displacement, motion, pool)


@options.entry(types.void(_I, _D, _B, _I, MOTION, PACKED, PACKED), nogil=True, **OPTIONS)
def accept_islands(part, end, whole, cuts, motion, packed, packed_tables):
    """Accept the step of the islands of a part, solved by `solve_islands` (`common_plate_driver.accept_bodies`)."""
    context, tables = context_of(packed), tables_of(packed_tables)
    pool = pool_of_part(part, context, tables)
    for p in range(tables.part_edges[part], tables.part_edges[part + 1]):
        accept_island(context, tables, island_of(tables.order[p], context, tables), motion, (end, whole, cuts), pool)
