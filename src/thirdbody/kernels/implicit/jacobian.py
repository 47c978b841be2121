"""Linear equations of an island: Jacobian of the residuals (`residual`), of each body with its plates, and of contacts between
bodies; Gaussian elimination with row pivots. Contacts with rough surfaces and between bodies are added by `add_general`
(`contact` has the theory): responses along three axes give all coordinates.

The entry in row i and column j is A[i step + j + offset]. Seven equations of one body are dense: step 7, offset 0. Those of
several bodies are a band: row i holds the columns from i - w to i + 2 w, side by side, of which exchanged rows need the last w;
step 3 w, offset w: 3 w + 1 columns. Not LAPACK, which would start threads of its own from each thread of a kernel.
"""

from collections import namedtuple

from numba import njit

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE
from thirdbody.kernels import plates
from thirdbody.kernels.arguments import LAW
from thirdbody.kernels.contact_geometry import padded
from thirdbody.kernels.implicit.contact import PLANE, add_plane, cross, dot, plate_contact, product, scaled_sum
from thirdbody.kernels.implicit.residual import inertia_of
from thirdbody.kernels.implicit.workspace import FREEDOMS, STAGE, body_at, call_part, space_at
from thirdbody.kernels.step_tables import step_start
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
    """Write the Jacobian (49,) [N/m] of the residual of the body at position a, for its m contacts with plates. A patch of
    prescribed height has no equation, unless `coupled`."""
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
            add_plane(plate_contact(q, dt, PLANE, context, space), context, J)
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
    """Write the Jacobian of the island, with m contacts between its bodies, to `band`; of one not `coupled` body its own only."""
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
    """Overwrite r with the solution x of A x = -r, A from `factorise`; by columns: the sums of all rows advance side by side."""
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
    n, w = island.n, island.half_width
    if n == 1 and not coupled:
        return factorise(scratch.jacobian[0], scratch.pivots, FREEDOMS, FREEDOMS - 1, FREEDOMS, 0)
    return factorise(scratch.band, scratch.pivots, FREEDOMS * n, w, 3 * w, w)


@njit(**BARE)
def solve_correction(coupled, island, scratch):
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


Response = namedtuple("Response", "force torque back")
"""How a contact answers a small motion: changes of the force on the owner, opposite to that on a partner that is a body, and of
the torques on owner and partner, each about its own centre of mass."""


@njit(**BARE)
def axis_of(k):
    return 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0


@njit(**BARE)
def surface_response(s, contact):
    """Return the response to a displacement s of the surface, in which the frame stays."""
    (n, e, g), (k_n, xx, xy, yx, yy, xd, yd) = contact.frame, contact.tangent
    d, s_1, s_2 = -dot(n, s), dot(e, s), dot(g, s)
    df = scaled_sum(k_n * d, n, xx * s_1 + xy * s_2 + xd * d, e, yx * s_1 + yy * s_2 + yd * d, g)
    dm = scaled_sum(contact.rolling_tangent[4] * d, e, contact.rolling_tangent[5] * d, g, contact.twist_tangent[1] * d, n)
    arm = scaled_sum(0.5 * d, cross(n, contact.force), 0.0, n, 0.0, n)
    torque = scaled_sum(1.0, cross(contact.owner.point, df), 1.0, arm, 1.0, dm)
    return Response(df, torque, scaled_sum(-1.0, cross(contact.partner.point, df), 1.0, arm, -1.0, dm))


@njit(**BARE)
def bend_response(c, contact):
    """Return the response to a displacement c of the centre beyond that of the surface: normal and effective radius change."""
    (n, e, g), (k_n, xx, xy, yx, yy, xd, yd) = contact.frame, contact.tangent
    dn, bent = product(contact.bend, c), dot(contact.gradient, c)
    turn, depth = cross(n, dn), 0.5 * contact.normal_force / k_n * bent if k_n > 0.0 else 0.0
    slip = scaled_sum(contact.displacement[0], n, contact.displacement[1], e, contact.displacement[2], g)
    s_1, s_2 = dot(slip, cross(turn, e)), dot(slip, cross(turn, g))
    df = scaled_sum(k_n * depth, n, xx * s_1 + xy * s_2 + xd * depth, e, yx * s_1 + yy * s_2 + yd * depth, g)
    df = scaled_sum(1.0, df, 1.0, cross(turn, contact.force), 0.0, n)
    arm, dm = cross(dn, contact.force), cross(turn, contact.moment)
    # the gradient force, which acts on the owner's centre; only rough plates have one
    size, changed = -0.5 * contact.energy, product(contact.gradient_change, c)
    dp = scaled_sum(0.5 * (contact.normal_force * dot(n, c) + size * bent), contact.gradient, size, changed, 0.0, n)
    torque = scaled_sum(1.0, cross(contact.owner.point, df), -contact.owner.arm, arm, 1.0, dm)
    torque = scaled_sum(1.0, torque, 1.0, cross(contact.owner.centre, dp), 0.0, n)
    back = scaled_sum(-1.0, cross(contact.partner.point, df), -contact.partner.arm, arm, -1.0, dm)
    return Response(scaled_sum(1.0, df, 1.0, dp, 0.0, n), torque, back)


@njit(**BARE)
def spin_response(contact):
    """Return the response to a turn of a body about the normal, as it turns the frame."""
    (n, e, g), (_, xx, xy, yx, yy, _, _) = contact.frame, contact.tangent
    _, s_1, s_2 = contact.displacement
    df = scaled_sum(0.5 * (xx * s_2 - xy * s_1), e, 0.5 * (yx * s_2 - yy * s_1), g, 0.5, cross(n, contact.force))
    dm = cross(n, contact.moment)
    torque = scaled_sum(1.0, cross(contact.owner.point, df), 0.5, dm, 0.0, n)
    return Response(df, torque, scaled_sum(-1.0, cross(contact.partner.point, df), -0.5, dm, 0.0, n))


@njit(**BARE)
def combined(x, a, y, b, z, c):
    force, torque = scaled_sum(x, a.force, y, b.force, z, c.force), scaled_sum(x, a.torque, y, b.torque, z, c.torque)
    return Response(force, torque, scaled_sum(x, a.back, y, b.back, z, c.back))


@njit(**BARE)
def response_to(s, c, turn, responses):
    """Return the response to displacements s and c of surface and centre, and a turn about the normal."""
    (x, y, z), (u, v, w), spin = responses
    surface, bend = combined(s[0], x, s[1], y, s[2], z), combined(c[0], u, c[1], v, c[2], w)
    return combined(1.0, surface, 1.0, bend, turn, spin)


@njit(**BARE)
def add_general(contact, J, step, offset):
    """Add any contact to the Jacobian J (`jacobian`), coordinate by coordinate."""
    x, y, z = axis_of(0), axis_of(1), axis_of(2)
    surface = surface_response(x, contact), surface_response(y, contact), surface_response(z, contact)
    responses = surface, (bend_response(x, contact), bend_response(y, contact), bend_response(z, contact)), spin_response(contact)
    add_side(contact.owner, 1.0, responses, contact, J, step, offset)
    if contact.partner.row >= 0:
        add_side(contact.partner, -1.0, responses, contact, J, step, offset)
    elif contact.partner.lift >= 0:
        down = 0.0, 0.0, -1.0
        add_response(response_to(down, down, 0.0, responses), contact.partner.lift, 1.0, contact, J, step, offset)


@njit(**BARE)
def add_side(side, sign, responses, contact, J, step, offset):
    """Add the responses to the coordinates of the body of a side; `sign`: 1 owner, -1 partner. A displacement moves surface and
    centre alike, a rotation w by w x r and w x a; it turns the frame, and the arm."""
    (n, e, g), (xx, xy, yx, yy, _, _) = contact.frame, contact.rolling_tangent
    of_owner, of_partner = max(sign, 0.0), max(-sign, 0.0)
    pull = scaled_sum(1.0, contact.force, -0.5 * contact.energy, contact.gradient, 0.0, n)
    for k in range(3):
        w = axis_of(k)
        # moment that answers a rotation of the owner relative to the partner
        about_e, about_g = dot(w, e), dot(w, g)
        by_e, by_g = xx * about_e + xy * about_g, yx * about_e + yy * about_g
        moment = scaled_sum(by_e, e, by_g, g, contact.twist_tangent[0] * dot(w, n), n)
        u, swing = scaled_sum(sign, w, 0.0, n, 0.0, n), cross(w, side.centre)
        add_response(response_to(u, u, 0.0, responses), side.row + k, 1.0, contact, J, step, offset)
        rotated = response_to(cross(u, side.point), cross(u, side.centre), dot(w, n), responses)
        torque = scaled_sum(1.0, rotated.torque, of_owner, cross(swing, pull), sign, moment)
        back = scaled_sum(1.0, rotated.back, -of_partner, cross(swing, contact.force), -sign, moment)
        add_response(Response(rotated.force, torque, back), side.row + 3 + k, side.scale, contact, J, step, offset)


@njit(**BARE)
def add_response(response, at, scale, contact, J, step, offset):
    """Add the response to one coordinate, column `at` of J, times `scale`."""
    owner, partner, (force, torque, back) = contact.owner, contact.partner, response
    for k in range(3):
        J[(owner.row + k) * step + at + offset] += scale * force[k]
        J[(owner.row + 3 + k) * step + at + offset] += scale * owner.scale * torque[k]
    if partner.row >= 0:
        for k in range(3):
            J[(partner.row + k) * step + at + offset] -= scale * force[k]
            J[(partner.row + 3 + k) * step + at + offset] += scale * partner.scale * back[k]
    elif partner.lift >= 0:
        J[partner.lift * step + at + offset] -= scale * force[2]
