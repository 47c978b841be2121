"""Bodies under one common plate: they share its height and therefore its time step. So do bodies with patches of their own that
share the lateral motion of a plate which springs drive (`engine.spring_drive`): their patches are solved with them.

The system matrix is an arrow matrix: one block per island, and one row and column for the plate. `solve_at` solves islands for a
given rise of the plate, with the derivative of their force on the plate at their equilibrium: the Schur complement of the arrow
matrix, by one more right-hand side of their band matrices, the column of the plate. One scalar equation for the plate remains
(`engine.common_plate`). Contacts between bodies do not feel the plate, so rows and columns of its rise are those of the
bodies.
"""

from numba import njit, types

from thirdbody.jit.arguments import PACKED
from thirdbody.jit.options import BARE, NO_COUNTS, OPTIONS, entry
from thirdbody.kernels.arguments import Motion
from thirdbody.kernels.contact_geometry import gradient_force
from thirdbody.kernels.contact_zone import has_zone
from thirdbody.kernels.drive import is_sprung
from thirdbody.kernels.implicit import control, workspace
from thirdbody.kernels.implicit.accept_step import reject_step
from thirdbody.kernels.implicit.contact import contact_force
from thirdbody.kernels.implicit.driver import accept_island, assess_island, begin_steps, predict_load
from thirdbody.kernels.implicit.jacobian import assemble, factorise_jacobian, solve_correction
from thirdbody.kernels.implicit.newton import NewtonOutcome, evaluate, solve_island
from thirdbody.kernels.implicit.residual import measure_arm, save_start
from thirdbody.kernels.implicit.workspace import FREEDOMS, STAGE, body_at, call_part, space_at
from thirdbody.kernels.plates import book_direct_contact, direct_force, is_rough, is_upper
from thirdbody.kernels.step_tables import body_solution, step_memory, step_settings, step_start
from thirdbody.kernels.tables import patch
from thirdbody.kernels.tile import TILE, law_output

_D, _B, _I, _ROW = types.float64, types.boolean, types.int64, types.Array(types.float64, 1, "C")
_ENDED = types.Tuple((_D, _B, _I))


@njit(**BARE)
def plate_reaction(context, b, m, space):
    p, P = context.patch[b], context.P
    if P[p, patch.SPRING] != 0.0:
        return P[p, patch.SPRING] * (P[p, patch.HEIGHT] - space.start[step_start.PLATE_HEIGHT])
    push = 0.0
    for q in range(m):
        k = space.slots[q]
        if is_upper(context.partner[k]):
            push -= contact_force(q, space)[2]
            if is_rough(context):
                push -= gradient_force(k, space.outputs[law_output.STORED_NORMAL * TILE + q], context)[2]
    return push


@njit(**BARE)
def lateral_reaction(context, m, space):
    """Return the force of a body on the plate along x and y [N]."""
    x, y = 0.0, 0.0
    for q in range(m):
        k = space.slots[q]
        if is_upper(context.partner[k]):
            force = contact_force(q, space)
            x, y = x - force[0], y - force[1]
            if is_rough(context):
                force = gradient_force(k, space.outputs[law_output.STORED_NORMAL * TILE + q], context)
                x, y = x - force[0], y - force[1]
    return x, y


@njit(**BARE)
def place_patch(context, b, motion, space):
    """Place the patch where another velocity of the plate leads."""
    p, P = context.patch[b], context.P
    P[p, patch.DISPLACEMENT] = space.start[step_start.PATCH_DISPLACEMENT] + motion.dt * motion.v_x
    P[p, patch.DISPLACEMENT + 1] = space.start[step_start.PATCH_DISPLACEMENT + 1] + motion.dt * motion.v_y


@njit(**BARE)
def load_body(context, b, space):
    for k in range(step_start.WIDTH):
        space.start[k] = context.starts[b, k]
    for k in range(FREEDOMS):
        space.y[k] = context.ends[b, k]


@njit(**BARE)
def write_stiffness(m, motion, context, island, scratch):
    """Write the changes of the forces on the plate with its rise, the island in equilibrium, to the solutions of its bodies. The
    column of the plate becomes the right-hand side; its rise is taken out of the band."""
    assemble(m, True, motion, context, island, scratch)
    band, w = scratch.band, island.half_width
    for a in range(island.n):
        J, column, spring = space_at(a, scratch).jacobian, space_at(a, scratch).residual, spring_of(a, context, island)
        for k in range(FREEDOMS):
            column[k] = 0.0 if spring != 0.0 or k == 6 else J[FREEDOMS * k + 6]
        if spring != 0.0:
            column[6] = spring
            continue
        first = FREEDOMS * a * (3 * w + 1) + w
        for k in range(6):
            band[first + 3 * w * k + 6], band[first + 18 * w + k] = 0.0, 0.0
        band[first + 18 * w + 6] = -1.0
    regular = factorise_jacobian(True, island, scratch)
    if regular:
        solve_correction(True, island, scratch)
    for a in range(island.n):
        J, x, spring, slope = space_at(a, scratch).jacobian, space_at(a, scratch).correction, spring_of(a, context, island), 0.0
        if regular and spring != 0.0:
            slope = spring * (x[6] - 1.0)
        elif regular:
            slope = J[48]
            for k in range(6):
                slope += J[42 + k] * x[k]
        context.solutions[body_at(a, island), body_solution.SLOPE] = slope


@njit(**BARE)
def spring_of(a, context, island):
    """Return the stiffness [N/m] of the spring of the patch of the body at position a; 0: the plate itself touches the body."""
    return context.P[context.patch[body_at(a, island)], patch.SPRING]


@entry(types.void(_I, _I, _B, _D, workspace.MOTION, PACKED, PACKED, PACKED), nogil=True, **OPTIONS, **NO_COUNTS)
def solve_at(first, last, first_iteration, displacement, motion, packed, tables, packed_scratch):
    """Solve the step of the islands `order[first:last]` for a given rise of the plate [m], into `solutions`; unless it begins in
    the `first_iteration`, from the `ends` of the previous call. Without a common plate patches rise as their loads let them."""
    context, islands, scratch = workspace.unpack(packed, tables, packed_scratch)
    common, sprung = context.settings[step_settings.COMMON] != 0.0, is_sprung(context)
    for p in range(first, last):
        island = workspace.island_at(islands.order[p], islands)
        for a in range(island.n):
            b, space = body_at(a, island), space_at(a, scratch)
            if first_iteration:
                measure_arm(context, b, space)
                save_start(a, context, island, scratch)
                if common:
                    control.begin_step(context, b, displacement, motion, space)
            else:
                load_body(context, b, space)
                if sprung:
                    place_patch(context, b, motion, space)
                    if has_zone(context):
                        predict_load(b, motion, context, space)
            if not common:
                continue
            if spring_of(a, context, island) == 0.0:
                space.y[6] = displacement
            space.start[step_start.PLATE_HEIGHT] = context.P[context.P.shape[0] - 1, patch.HEIGHT] + displacement
            space.start[step_start.PLATE_DISPLACEMENT] = displacement
        if first_iteration and not common:
            begin_steps(motion, context, island, scratch)
        if first_iteration and island.n_pairs > 0:
            call_part(context.pairs_part, STAGE.START, 0, 0, motion, context, island, scratch)
        outcome, m, iterations = solve_island(motion, context, island, scratch)
        # the friction work of a body that meets only plates is not estimated: it has no step of its own
        of_work = outcome == NewtonOutcome.SOLVED and island.n > 1
        error, rotation, landing = assess_island(m, of_work, motion, context, island, scratch)
        for a in range(island.n):
            b, space = body_at(a, island), space_at(a, scratch)
            T, solution = context.memory[b], context.solutions[b]
            T[step_memory.TRIES] += 1.0
            T[step_memory.ITERATIONS] += iterations
            solution[body_solution.SOLVED] = 1.0 if outcome == NewtonOutcome.SOLVED else 0.0
            solution[body_solution.CROWDED] = 1.0 if outcome == NewtonOutcome.CROWDED else 0.0
            solution[body_solution.LANDS], solution[body_solution.ITERATIONS] = 1.0 if landing else 0.0, iterations
            for k in range(FREEDOMS):
                context.ends[b, k] = space.y[k]
            for k in range(step_start.WIDTH):
                context.starts[b, k] = space.start[k]
            if outcome == NewtonOutcome.SOLVED:
                solution[body_solution.ERROR], solution[body_solution.ROTATION] = error, rotation
                solution[body_solution.PUSH] = plate_reaction(context, b, scratch.counts[a], space)
                if sprung:
                    x, y = lateral_reaction(context, scratch.counts[a], space)
                    solution[body_solution.PULL], solution[body_solution.PULL + 1] = x, y
        if outcome == NewtonOutcome.SOLVED and common:
            write_stiffness(m, motion, context, island, scratch)


@entry(types.void(_I, _I, _ENDED, workspace.MOTION, PACKED, PACKED, PACKED), nogil=True, **OPTIONS, **NO_COUNTS)
def accept_at(first, last, ended, motion, packed, tables, packed_scratch):
    """Accept the step solved by `solve_at`; `ended`: its end [s], whether exactly then, how often cut."""
    context, islands, scratch = workspace.unpack(packed, tables, packed_scratch)
    for p in range(first, last):
        island = workspace.island_at(islands.order[p], islands)
        for a in range(island.n):
            space = space_at(a, scratch)
            load_body(context, body_at(a, island), space)
            for k in range(FREEDOMS):
                space.correction[k] = 0.0
        m = evaluate(0.0, motion, context, island, scratch)  # again: cheaper than storing the tiles of all bodies
        accept_island(m, motion, context.settings[step_settings.COMMON] != 0.0, ended, context, island, scratch)


@entry(types.void(_I, _I, PACKED, PACKED, PACKED), **OPTIONS, **NO_COUNTS)
def restore_islands(first, last, packed, tables, packed_scratch):
    context, islands, scratch = workspace.unpack(packed, tables, packed_scratch)
    for p in range(first, last):
        island = workspace.island_at(islands.order[p], islands)
        for a in range(island.n):
            b, space = body_at(a, island), space_at(a, scratch)
            load_body(context, b, space)
            reject_step(context, b, space)


# -- control of the common step; T: memory of the plate, a row of `step_memory` like that of a body --


@entry(types.Tuple((_D, _I))(_ROW, _D, PACKED, _D), **OPTIONS)
def common_step_length(T, t, packed, end):
    return control.next_length(T, t, workspace.context_of(packed), end)


@entry(types.UniTuple(_D, 2)(_D, PACKED, _D), **OPTIONS)
def plate_velocity_of(t, packed, dt):
    return control.plate_velocity(t, workspace.context_of(packed), dt)


@entry(_D(_D, PACKED, _D), **OPTIONS)
def next_breakpoint_after(t, packed, until):
    return control.next_breakpoint(t, workspace.context_of(packed), until)


@entry(types.void(_ROW, types.Array(types.float64, 2, "C"), _D, _D, _D, _D), **OPTIONS)
def book_direct(totals, P, dt, v_x, v_y, old):
    """Add a step of direct contact to the totals of the plate, the last row of P (`plates.book_direct_contact`)."""
    plate = P.shape[0] - 1
    book_direct_contact(totals, (direct_force(P, plate), P[plate, patch.DIRECT_FRICTION]), Motion(dt, v_x, v_y), old)
