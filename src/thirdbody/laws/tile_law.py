"""The contact laws of a scene on a tile of contacts: forces and memory, what bounds a time step, tangents.

As it stands: Hertz' law alone. A generated module (`laws.compose`) is this text with another head: constants of the chain, and
for each law a function that takes its parameters from U. What constants decide is decided there: after
`if HAS_DAMPING:` a stage without a law leaves no code. Nothing is compiled on import.

I, O and K hold the columns of the tile, with stride TILE; U the parameters of each contact q. Names: c contact (overlap not below
zero), far contact (overlap down to minus the reach of the laws), n result of the normal law, t of the tangential law, r of the
rolling law, w of the twisting law, h memory of a law.
"""

# ruff: noqa: E741
import math
from typing import Any

from numba import njit

from thirdbody.jit.arguments import array_part, stack_array
from thirdbody.jit.options import BARE, INNER, OPTIONS
from thirdbody.kernels.memory import broadcast_parameters
from thirdbody.kernels.tile import TILE, contact_tangent, law_input, law_output, rolling_input, rolling_output
from thirdbody.laws.data import EXPLICIT, IMPLICIT, Contact, Load, Tangential, Turn, Twist
from thirdbody.laws.generated import as_kernel

# -- head
from thirdbody.laws.hertz import HertzParameters, hertz, hertz_tangent

kernel_0, tangent_0 = as_kernel(hertz), as_kernel(hertz_tangent)

WIDTH = 1  # parameters of a pair of materials; the last one of a chain that `JUMPS` is the integrator
MEMORY, FIELD, FIELD_FIRST = 0, 0, 0  # floats stored per contact; those of a field, and where they begin
HAS_DAMPING = HAS_ADHESION = HAS_ADDED_LOAD = HAS_TANGENTIAL = HAS_TANGENTIAL_DAMPING = HAS_ROLLING = HAS_TWISTING = False
HAS_REACH = ATTRACTS = False  # laws that act before touch; a normal law that does, whose force may be negative
JUMPS = False  # whether a force jumps as bodies touch or part
ROLLS = False  # whether laws see the travel of the contact area
REMEMBERS = False  # whether the normal law has a memory
ADDS_ENERGY = False  # whether the energy of the springs is stored in a column of its own
VIRGIN: tuple = ((), (), (), ())  # memories of the normal, tangential, rolling and twisting law


@njit(**BARE)
def memory(I, q):
    return (), (), (), ()


@njit(**BARE)
def store(O, q, normal, tangential, rolling, twisting):
    pass


@njit(**INNER)
def normal(c, h, U, q):
    return kernel_0(c, HertzParameters(U[q])), h


@njit(**INNER)
def normal_tangent(c, h, U, q):
    return tangent_0(c, HertzParameters(U[q]))


absent: Any = None
damping = added_load = adhesion = adhesion_stiffness = adhesion_tangent = absent
tangential = tangential_tangent = tangential_damping = rolling = rolling_tangent = twisting = twisting_tangent = absent

# -- body
HAS_MOMENTS = HAS_ROLLING or HAS_TWISTING
HAS_DASHPOTS = HAS_DAMPING or HAS_TANGENTIAL_DAMPING or HAS_MOMENTS
PARAMETERS, INTEGRATOR = WIDTH * TILE, (WIDTH - 1) * TILE
BEHIND, AFTER = (law_input.HISTORY + MEMORY) * TILE, (law_output.HISTORY + MEMORY) * TILE
FIELD_IN, FIELD_OUT = (law_input.HISTORY + FIELD_FIRST) * TILE, (law_output.HISTORY + FIELD_FIRST) * TILE
STORED = AFTER - (1 + HAS_DASHPOTS + HAS_MOMENTS) * TILE
ROTATION, TURN_RATE = BEHIND + rolling_input.ROTATION_X * TILE, BEHIND + rolling_input.RATE_X * TILE
TRAVEL, MOVED = BEHIND + rolling_input.TRAVEL_X * TILE, BEHIND + rolling_input.MOVED * TILE
TWIST, RATE = BEHIND + rolling_input.TWIST * TILE, BEHIND + rolling_input.INVERSE_DT * TILE
STILL, STILL_TWIST = Turn(0.0, 0.0, 0.0, 0.0), Twist(0.0, 0.0)


@njit(**BARE)
def contacts_of(I, q, roll_x, roll_y, moved):
    """Return contact q of the tile, and the same as laws see it that act from touch on."""
    overlap, radius, mass = I[q + law_input.OVERLAP * TILE], I[q + law_input.RADIUS * TILE], I[q + law_input.MASS * TILE]
    v_n, slip_x, slip_y = I[q + law_input.NORMAL_VELOCITY * TILE], I[q + law_input.SLIP_X * TILE], I[q + law_input.SLIP_Y * TILE]
    v_x, v_y = I[q + law_input.VELOCITY_X * TILE], I[q + law_input.VELOCITY_Y * TILE]
    far = Contact(overlap, radius, mass, v_n, slip_x, slip_y, v_x, v_y, roll_x, roll_y, moved)
    if HAS_REACH:
        return far, Contact(max(overlap, 0.0), radius, mass, v_n, slip_x, slip_y, v_x, v_y, roll_x, roll_y, moved)
    return far, far


@njit(**BARE)
def touch_fraction(c, ahead, U, q):
    """Fraction that a step applies of a force that jumps at touch; `ahead`: overlap gained in the next step, if known [m]. Else
    its work is off by the force times up to half the path of the step: a ball that leaves with 1.01 of its energy. Velocity
    Verlet applies a force on half of the step before it and on half of the one after. Where bodies came into touch within the
    step before, it is the part overlap/moved of that one instead; where they will leave within the next one, overlap/-ahead of
    that. An implicit step applies its last force to all of it, and cannot look ahead."""
    overlap, moved, integrator = c.overlap, c.moved, U[q + INTEGRATOR]
    before, after = overlap / max(moved, 1e-300), overlap / max(-ahead, 1e-300)
    explicit = (before if overlap < moved else 0.5) + (after if overlap < -ahead else 0.5)
    implicit = before if overlap < moved else 1.0
    fraction = explicit if integrator == EXPLICIT else (implicit if integrator == IMPLICIT else 1.0)
    return fraction if overlap > 0.0 else 1.0


@njit(**BARE)
def step_fraction(c, I, U, q):
    return touch_fraction(c, -c.moved - 2.0 * c.v_n / max(I[q + RATE], 1e-300), U, q)


@njit(**BARE)
def touch_growth(c, U, q):
    """Derivative of the fraction of an implicit step by the overlap at its end [1/m]; 0 in a contact that was there before."""
    lands = U[q + INTEGRATOR] == IMPLICIT and 0.0 < c.overlap < c.moved
    return (1.0 - c.overlap / c.moved) / c.moved if lands else 0.0


@njit(**BARE)
def limited(x, y, limit, viscosity, rate_x, rate_y):
    """Return the sum of spring and dashpot returned to the limit, and the dashpot's part, which dissipates: nothing jumps."""
    d_x, d_y = -viscosity * rate_x, -viscosity * rate_y
    sum_x, sum_y = x + d_x, y + d_y
    largest = max(limit * limit, x * x + y * y)  # a spring beyond its limit stays where it is, and is found
    back = math.sqrt(largest / max(sum_x * sum_x + sum_y * sum_y, max(largest, 1e-300)))
    return back * sum_x, back * sum_y, back * d_x - (1.0 - back) * x, back * d_y - (1.0 - back) * y


@njit(**BARE)
def limited_tangent(t, spring, viscosity, rate, rate_x, rate_y, load):
    """Return the tangent of that sum from the one of the spring (x, y, limit); `rate`: one over the step."""
    x, y, limit = spring
    back = viscosity * rate
    xs, ys = (t[0] - back, t[1], t[4]), (t[2], t[3] - back, t[5])
    x, y = x - viscosity * rate_x, y - viscosity * rate_y
    size = math.sqrt(x * x + y * y)
    e_x, e_y, fraction = x / max(size, 1e-300), y / max(size, 1e-300), limit / max(size, max(limit, 1e-300))
    beyond = 1.0 if size > limit else 0.0
    xx, xy, yy = fraction * (1.0 - beyond * e_x * e_x), -fraction * beyond * e_x * e_y, fraction * (1.0 - beyond * e_y * e_y)
    grows = beyond * limit * load.stiffness / max(load.force, 1e-300)
    return (
        xx * xs[0] + xy * ys[0], xx * xs[1] + xy * ys[1], xy * xs[0] + yy * ys[0], xy * xs[1] + yy * ys[1],
        xx * xs[2] + xy * ys[2] + grows * e_x, xy * xs[2] + yy * ys[2] + grows * e_y,
    )  # fmt: skip


@njit(**BARE)
def turn_of(I, q):
    return Turn(I[q + ROTATION], I[q + ROTATION + TILE], I[q + TURN_RATE], I[q + TURN_RATE + TILE])


@njit(**BARE)
def moments(c, load, sums, memories, I, O, U, q):
    """Compute moments, and add their energies and powers; returns the sums, and the memories of both laws."""
    stored, work, lost, power = sums
    of_rolling, of_twisting = memories
    m_x, m_y, limit, viscous_x, viscous_y = 0.0, 0.0, 0.0, 0.0, 0.0
    if HAS_ROLLING:
        turn = turn_of(I, q)
        r, of_rolling = rolling(c, turn, load, of_rolling, U, q)
        limit = r.limit
        m_x, m_y, viscous_x, viscous_y = limited(r.x, r.y, limit, r.viscosity, turn.w_x, turn.w_y)
        power -= viscous_x * turn.w_x + viscous_y * turn.w_y
        stored += r.stored
        work, lost = work + r.dissipated, lost + r.dissipated
    at, behind = q + AFTER + rolling_output.MOMENT_X * TILE, q + AFTER + rolling_output.VISCOUS_MOMENT_X * TILE
    O[at], O[at + TILE], O[q + AFTER + rolling_output.MOMENT_LIMIT * TILE] = m_x, m_y, limit
    O[behind], O[behind + TILE] = viscous_x, viscous_y
    if HAS_TWISTING:
        twist = Twist(I[q + TWIST], I[q + TWIST + TILE])
        w, of_twisting = twisting(c, twist, load, of_twisting, U, q)
        # a dashpot adds what the limit leaves
        viscous = min(max(w.moment - w.viscosity * twist.rate, -w.limit), w.limit) - w.moment
        power -= viscous * twist.rate
        stored += w.stored
        work, lost = work + w.dissipated, lost + w.dissipated
        O[q + AFTER + rolling_output.TWIST_MOMENT * TILE] = w.moment + viscous
        O[q + AFTER + rolling_output.TWIST_LIMIT * TILE] = w.limit
        O[q + AFTER + rolling_output.VISCOUS_TWIST * TILE] = viscous
    return (stored, work, lost, power), of_rolling, of_twisting


@njit(**BARE)
def write(O, q, forces, load, t, n, stored, sums):
    O[q + law_output.NORMAL_FORCE * TILE] = forces[0]
    O[q + law_output.TANGENTIAL_X * TILE], O[q + law_output.TANGENTIAL_Y * TILE] = forces[1], forces[2]
    O[q + law_output.LOAD * TILE], O[q + law_output.FRICTION_LIMIT * TILE] = load.force, t.limit
    O[q + law_output.CRITICAL_SLIP * TILE], O[q + law_output.SLIP * TILE] = t.critical, t.slip
    O[q + law_output.CONTACT_RADIUS * TILE], O[q + law_output.PEAK_PRESSURE * TILE] = n.contact_radius, n.peak_pressure
    O[q + law_output.STORED_NORMAL * TILE], O[q + law_output.STORED_TANGENTIAL * TILE] = stored, sums[0]
    O[q + law_output.DISSIPATED * TILE], O[q + law_output.FRICTION_LOSS * TILE] = sums[1], sums[2]
    O[q + law_output.DASHPOT_POWER * TILE] = sums[3]


@njit(**OPTIONS)
def law(I, O, n_contacts, pairs):
    """Compute forces, memory and energies at the end of a step."""
    U = stack_array(PARAMETERS)
    broadcast_parameters(I, n_contacts, pairs, WIDTH, U)
    for q in range(n_contacts):
        roll_x, roll_y = (I[q + TRAVEL], I[q + TRAVEL + TILE]) if ROLLS else (0.0, 0.0)
        far, c = contacts_of(I, q, roll_x, roll_y, I[q + MOVED] if JUMPS else 0.0)
        of_normal, of_tangential, of_rolling, of_twisting = memory(I, q)
        n, of_normal = normal(far if ATTRACTS else c, of_normal, U, q)
        force, power = n.force, 0.0
        if HAS_DAMPING:
            viscous = damping(c, n, U, q)
            if JUMPS and ATTRACTS:
                viscous *= touch_fraction(c, 0.0, U, q)
            # a dashpot may unload the contact but never pull
            force = max(n.force + viscous, min(n.force, 0.0) if ATTRACTS else 0.0)
            power = -(force - n.force) * c.v_n
        viscous_n, viscous_x, viscous_y = force - n.force, 0.0, 0.0
        gripped = added_load(force, c, far, n, U, q) if HAS_ADDED_LOAD else force
        gripped = max(gripped, 0.0) if HAS_ADDED_LOAD or ATTRACTS else gripped
        load = Load(gripped, n.force, n.contact_radius, 0.0, 0.0)
        stored, work, lost = n.stored, n.dissipated, 0.0
        if HAS_ADHESION:
            force, stored = adhesion(c, far, n, (force, stored), I, O, U, q)
        if HAS_TANGENTIAL:
            w = array_part(FIELD, I, q * FIELD + FIELD_IN) if FIELD else U
            w_new = array_part(FIELD, O, q * FIELD + FIELD_OUT) if FIELD else U
            t, of_tangential = tangential(c, load, of_tangential, w, w_new, U, q)
            work, lost = work + t.dissipated, t.dissipated
        else:
            slip = math.sqrt(c.slip_x * c.slip_x + c.slip_y * c.slip_y)
            t = Tangential(0.0, 0.0, 0.0, 0.0, slip, 0.0, 0.0)
        t_x, t_y = t.x, t.y
        if HAS_TANGENTIAL and HAS_TANGENTIAL_DAMPING:
            viscosity = tangential_damping(c, load, U, q)
            t_x, t_y, viscous_x, viscous_y = limited(t_x, t_y, t.limit, viscosity, c.v_x, c.v_y)
            power -= viscous_x * c.v_x + viscous_y * c.v_y
        sums = (t.stored, work, lost, power)
        if HAS_MOMENTS:
            sums, of_rolling, of_twisting = moments(c, load, sums, (of_rolling, of_twisting), I, O, U, q)
        store(O, q, of_normal, of_tangential, of_rolling, of_twisting)
        if ADDS_ENERGY:
            O[q + STORED] = sums[0]
        if HAS_DASHPOTS:  # the caller stores the dashpots' forces
            O[q + AFTER - TILE] = 0.0
            if HAS_MOMENTS:
                O[q + AFTER - 2 * TILE] = 0.0
            O[q + AFTER + rolling_output.VISCOUS_NORMAL * TILE] = viscous_n
            at = q + AFTER + rolling_output.VISCOUS_X * TILE
            O[at], O[at + TILE] = viscous_x, viscous_y
        write(O, q, (force, t_x, t_y), load, t, n, stored, sums)


@njit(**OPTIONS)
def stiffness(I, O, n_contacts, pairs):
    """Compute what bounds the time step, of virgin contacts that close without slip: k_n, k_t, k_r, c_n, c_t, c_r, and with a
    twisting law its k and c. The tile holds an approach at 1 m/s."""
    U = stack_array(PARAMETERS)
    broadcast_parameters(I, n_contacts, pairs, WIDTH, U)
    for q in range(n_contacts):
        far, c = contacts_of(I, q, 0.0, 0.0, 0.0)
        if ATTRACTS:
            # apart, bodies may be held by what formed as they touched: that counts as it was then
            c = Contact(max(far.overlap, 1e-300), far.radius, far.mass, far.v_n, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        of_normal, of_tangential, of_rolling, of_twisting = VIRGIN
        k_n = normal_tangent(c, of_normal, U, q)
        n, pressed = normal(c, of_normal, U, q)
        if REMEMBERS:
            k_n = max(k_n, normal_tangent(c, pressed, U, q))  # a contact that flows is stiffer on the way out
        if ATTRACTS:
            k_n = max(abs(k_n), abs(normal_tangent(far, of_normal, U, q)))
        if HAS_ADHESION:
            k_n = adhesion_stiffness(far, n, k_n, U, q)
        gripped = max(added_load(n.force, c, far, n, U, q), 0.0) if HAS_ADDED_LOAD else n.force
        load = Load(gripped, n.force, n.contact_radius, k_n, n.squared_radius_rate)
        k_t, k_r, c_r = 0.0, 0.0, 0.0
        if HAS_TANGENTIAL:
            w, w_new = U, U
            if FIELD:
                w, w_new = stack_array(FIELD), stack_array(FIELD)
                w[:], w_new[:] = 0.0, 0.0
            _, slipped = tangential(c, load, of_tangential, w, w_new, U, q)
            t = tangential_tangent(c, load, slipped, w_new, U, q)
            k_t = max(-t[0], -t[3])
        if HAS_ROLLING:
            r, rolled = rolling(c, STILL, load, of_rolling, U, q)
            t = rolling_tangent(c, STILL, load, rolled, U, q)
            k_r, c_r = max(-t[0], -t[3]), r.viscosity
        if HAS_TWISTING:
            s, _ = twisting(c, STILL_TWIST, load, of_twisting, U, q)
            O[q + 6 * TILE] = max(-twisting_tangent(c, STILL_TWIST, load, of_twisting, U, q)[0], 0.0)
            O[q + 7 * TILE] = s.viscosity
        O[q], O[q + TILE], O[q + 2 * TILE] = k_n, k_t, k_r
        O[q + 3 * TILE] = damping(c, n, U, q) if HAS_DAMPING else 0.0
        O[q + 4 * TILE] = tangential_damping(c, load, U, q) if HAS_TANGENTIAL_DAMPING else 0.0
        O[q + 5 * TILE] = c_r


@njit(**BARE)
def pressing(c, far, n, k_n, rate, U, q):
    """Return the load of friction with its tangent, and that of the normal force, dashpot included."""
    force = n.force
    if HAS_DAMPING:
        viscous = damping(c, n, U, q)
        c_n = damping(Contact(c.overlap, c.radius, c.mass, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), n, U, q)
        if JUMPS and ATTRACTS:
            fraction = touch_fraction(c, 0.0, U, q)
            c_n = fraction * c_n + touch_growth(c, U, q) * viscous / max(rate, 1e-300)
            viscous *= fraction
        if ATTRACTS:
            # a dashpot that would pull adds nothing to a force that pulls, and leaves none of one that pushes
            force = max(n.force + viscous, min(n.force, 0.0))
            k_n = k_n + c_n * rate if force == n.force + viscous else (k_n if n.force < 0.0 else 0.0)
        else:
            force = max(n.force + viscous, 0.0)
            k_n = k_n + c_n * rate if force > 0.0 else 0.0  # where the dashpot would pull, the whole force is zero
    if HAS_ADDED_LOAD or ATTRACTS:
        gripped = added_load(force, c, far, n, U, q) if HAS_ADDED_LOAD else force
        k_load = k_n if gripped > 0.0 else 0.0
        return Load(max(gripped, 0.0), n.force, n.contact_radius, k_load, n.squared_radius_rate), k_n
    return Load(force, n.force, n.contact_radius, k_n, n.squared_radius_rate), k_n


@njit(**OPTIONS)
def tangents(I, K, n_contacts, pairs):
    """Compute the tangents with memory (`contact_tangent`). Dashpots count with one over the step, since a step that closes a
    contact by dd changes its speed by dd/dt."""
    U = stack_array(PARAMETERS)
    broadcast_parameters(I, n_contacts, pairs, WIDTH, U)
    for q in range(n_contacts):
        roll_x, roll_y = (I[q + TRAVEL], I[q + TRAVEL + TILE]) if ROLLS else (0.0, 0.0)
        far, c = contacts_of(I, q, roll_x, roll_y, I[q + MOVED] if JUMPS else 0.0)
        of_normal, of_tangential, of_rolling, of_twisting = memory(I, q)
        rate = I[q + RATE]
        n, _ = normal(far if ATTRACTS else c, of_normal, U, q)
        k_n = normal_tangent(far if ATTRACTS else c, of_normal, U, q)
        load, k_n = pressing(c, far, n, k_n, rate, U, q)
        if HAS_ADHESION:
            k_n = adhesion_tangent(c, far, n, k_n, I, U, q)
        K[q + contact_tangent.NORMAL * TILE] = k_n
        t = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if HAS_TANGENTIAL:
            w = array_part(FIELD, I, q * FIELD + FIELD_IN) if FIELD else U
            t = tangential_tangent(c, load, of_tangential, w, U, q)
            if HAS_TANGENTIAL_DAMPING:
                if FIELD:
                    at = q + contact_tangent.SPRING_X * TILE
                    spring = K[at], K[at + TILE], K[q + contact_tangent.SPRING_LIMIT * TILE]
                else:
                    s, _ = tangential(c, load, of_tangential, U, U, U, q)
                    spring = s.x, s.y, s.limit
                viscosity = tangential_damping(c, load, U, q)
                t = limited_tangent(t, spring, viscosity, rate, c.v_x, c.v_y, load)
        write_six(K, q + contact_tangent.XX * TILE, t)
        if HAS_MOMENTS:
            m = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            if HAS_ROLLING:
                turn = turn_of(I, q)
                r, _ = rolling(c, turn, load, of_rolling, U, q)
                m = rolling_tangent(c, turn, load, of_rolling, U, q)
                m = limited_tangent(m, (r.x, r.y, r.limit), r.viscosity, rate, turn.w_x, turn.w_y, load)
            write_six(K, q + contact_tangent.ROLLING * TILE, m)
        if HAS_TWISTING:
            twist = Twist(I[q + TWIST], I[q + TWIST + TILE])
            m_w = twisting_tangent(c, twist, load, of_twisting, U, q)
            s_w, _ = twisting(c, twist, load, of_twisting, U, q)
            moment = s_w.moment - s_w.viscosity * twist.rate
            within = abs(moment) < s_w.limit
            grows = math.copysign(s_w.limit, moment) * load.stiffness / max(load.force, 1e-300)
            K[q + contact_tangent.TWIST * TILE] = m_w[0] - s_w.viscosity * rate if within else 0.0
            K[q + contact_tangent.TWIST_OVERLAP * TILE] = m_w[1] if within else grows


@njit(**BARE)
def write_six(K, at, t):
    K[at], K[at + TILE], K[at + 2 * TILE], K[at + 3 * TILE], K[at + 4 * TILE], K[at + 5 * TILE] = t
