"""Linear equations of an island: Jacobian of the residuals (`residual`), of each body with its plates, and of contacts between
bodies; Gaussian elimination with row pivots.

The entry in row i and column j is A[i step + j + offset]. Seven equations of one body are dense: step 7, offset 0. Those of
several bodies are a band: row i holds the columns from i - w to i + 2 w, side by side, of which exchanged rows need the last w;
step 3 w, offset w: 3 w + 1 columns. Not LAPACK, which would start threads of its own from each thread of a kernel.
"""

from numba import njit

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE
from thirdbody.kernels import plates
from thirdbody.kernels.arguments import LAW
from thirdbody.kernels.contact_geometry import padded
from thirdbody.kernels.implicit.contact import NOWHERE, ZERO_TENSOR, add_plane, plate_contact
from thirdbody.kernels.implicit.residual import inertia_of
from thirdbody.kernels.implicit.tables import step_start
from thirdbody.kernels.implicit.workspace import FREEDOMS, STAGE, body_at, call_part, space_at
from thirdbody.kernels.tables import body, patch
from thirdbody.kernels.tile import TILE, contact_tangent, law_output, rolling_output

tangents_at = function_at(LAW)


@njit(**BARE)
def give_springs(m, context, tile):
    """Give the tangents the spring that the law has answered: a law with a field is not evaluated twice."""
    if context.dashpots < 0:
        return
    O, K = tile.outputs, tile.tangents  # noqa: E741
    behind = (law_output.HISTORY + context.n_history) * TILE
    for q in range(m):
        total, damped = law_output.TANGENTIAL_X * TILE + q, behind + rolling_output.VISCOUS_X * TILE + q
        K[contact_tangent.SPRING_X * TILE + q] = O[total] - O[damped]
        K[contact_tangent.SPRING_Y * TILE + q] = O[total + TILE] - O[damped + TILE]
        K[contact_tangent.SPRING_LIMIT * TILE + q] = O[law_output.FRICTION_LIMIT * TILE + q]


@njit(**BARE)
def assemble_body(a, m, coupled, motion, context, island, scratch):
    """Write the Jacobian (49,) [N/m] of the residual of the body at position a, for its m contacts with plates.

    A patch of prescribed height has no equation, unless `coupled`: then the derivatives with respect to its height are included.
    """
    b, space, dt, poses = body_at(a, island), space_at(a, scratch), motion.dt, context.orientations
    p, Z, P, J = context.patch[b], space.start, context.P, space.jacobian
    give_springs(m, context, space)
    call_part(context.spots_part, STAGE.RELIEVE, a, m, motion, context, island, scratch)
    tangents_at(context.tangents)(space.inputs, space.tangents, padded(m, context.n_history), context.pairs)
    call_part(context.spots_part, STAGE.RESTORE, a, m, motion, context, island, scratch)
    for i in range(FREEDOMS * FREEDOMS):
        J[i] = 0.0
    if plates.is_rough(context):
        call_part(context.rough_part, STAGE.TANGENTS, a, m, motion, context, island, scratch)
    else:
        for q in range(m):
            add_plane(plate_contact(q, b, dt, (ZERO_TENSOR, NOWHERE, ZERO_TENSOR), context, space), context, J)
    call_part(context.spots_part, STAGE.TANGENTS, a, m, motion, context, island, scratch)
    per_arm, rate, (xx, yy, zz, xy, xz, yz) = 1.0 / Z[step_start.ARM], Z[step_start.NOW] / dt, inertia_of(b, context.E, poses)
    square, rows = Z[step_start.MASS_FRACTION] * rate * rate, ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    for i in range(3):
        J[8 * i] -= context.B[b, body.MASS] * square
        for k in range(3):
            J[FREEDOMS * (3 + i) + 3 + k] -= rows[i][k] * square
    # rotations and torques are scaled with the arm of the body
    for i in range(FREEDOMS):
        for k in range(3, 6):
            J[FREEDOMS * i + k] *= per_arm
    for k in range(3, 6):
        for i in range(FREEDOMS):
            J[FREEDOMS * k + i] *= per_arm
    for k in range(6):
        J[8 * k] -= Z[step_start.TETHER_STIFFNESS]
    if P[p, patch.FREE] == 0.0 and not coupled:
        for k in range(6):
            J[42 + k], J[FREEDOMS * k + 6] = 0.0, 0.0
        J[48] = -1.0
    elif P[p, patch.FREE] != 0.0:
        J[48] -= P[p, patch.DAMPING] * rate + P[p, patch.MASS] * square + P[p, patch.SPRING] + Z[step_start.TETHER_STIFFNESS]


@njit(**BARE)
def assemble(m, coupled, motion, context, island, scratch):
    """Write the Jacobian of the island, with m contacts between its bodies, to `band`; of one body alone only its own.

    `coupled`: see `assemble_body`; then also that of one body is a band.
    """
    n, w, J = island.n, island.half_width, scratch.band
    for a in range(n):
        assemble_body(a, scratch.counts[a], coupled, motion, context, island, scratch)
    if n == 1 and not coupled:
        return
    for e in range(FREEDOMS * n * (3 * w + 1)):
        J[e] = 0.0
    for a in range(n):
        first = FREEDOMS * a * (3 * w + 1) + w
        for i in range(FREEDOMS):
            for j in range(FREEDOMS):
                J[first + 3 * w * i + j] = scratch.jacobian[a, FREEDOMS * i + j]
    if m > 0:
        call_part(context.pairs_part, STAGE.TANGENTS, 0, m, motion, context, island, scratch)


@njit(**BARE)
def factorise(A, pivots, n, w, step, offset):
    """Overwrite A (n rows, half width w) with its triangular factors, the diagonal inverted; False if A is singular."""
    for c in range(n):
        top, end = c * step + c + offset, min(n, c + w + 1)
        best, p = abs(A[top]), c
        for i in range(c + 1, end):
            if abs(A[i * step + c + offset]) > best:
                best, p = abs(A[i * step + c + offset]), i
        if not best > 0.0 or not best < 1e300:
            return False
        pivots[c] = p
        many = min(n, c + 2 * w + 1) - c
        if p != c:
            other = p * step + c + offset
            for j in range(many):
                A[top + j], A[other + j] = A[other + j], A[top + j]
        inverse = 1.0 / A[top]
        A[top] = inverse
        for i in range(c + 1, end):
            below = i * step + c + offset
            factor = A[below] * inverse
            A[below] = factor
            if factor != 0.0:
                for j in range(1, many):
                    A[below + j] -= factor * A[top + j]
    return True


@njit(**BARE)
def substitute(A, pivots, r, n, w, step, offset):
    """Overwrite r with the solution x of A x = -r, where A and `pivots` are from `factorise`.

    Column by column, so that the sums of all rows advance side by side.
    """
    for c in range(n):
        p = pivots[c]
        r[c], r[p] = r[p], r[c]
        x = r[c]
        for i in range(c + 1, min(n, c + w + 1)):
            r[i] -= A[i * step + c + offset] * x
    for c in range(n - 1, -1, -1):
        x = -r[c] * A[c * step + c + offset]
        r[c] = x
        for i in range(max(0, c - 2 * w), c):
            r[i] += A[i * step + c + offset] * x


@njit(**BARE)
def factorise_jacobian(coupled, island, scratch):
    """Overwrite the Jacobian of the island with its factors; False if it is singular. `coupled`: see `assemble`."""
    n, w = island.n, island.half_width
    if n == 1 and not coupled:
        return factorise(scratch.jacobian[0], scratch.pivots, FREEDOMS, FREEDOMS - 1, FREEDOMS, 0)
    return factorise(scratch.band, scratch.pivots, FREEDOMS * n, w, 3 * w, w)


@njit(**BARE)
def solve_correction(coupled, island, scratch):
    """Solve for the corrections of all bodies at the residual with the factors of a Jacobian."""
    n, w, x = island.n, island.half_width, scratch.solution
    for a in range(n):
        for k in range(FREEDOMS):
            x[FREEDOMS * a + k] = space_at(a, scratch).residual[k]
    if n == 1 and not coupled:
        substitute(scratch.jacobian[0], scratch.pivots, x, FREEDOMS, FREEDOMS - 1, FREEDOMS, 0)
    else:
        substitute(scratch.band, scratch.pivots, x, FREEDOMS * n, w, 3 * w, w)
    for a in range(n):
        for k in range(FREEDOMS):
            space_at(a, scratch).correction[k] = x[FREEDOMS * a + k]
