"""Memory of tangential laws with one spring and Coulomb's limit, and the derivative of the radial return onto the limit.

A contact stores the tangential force T and the elastic energy U of its displacement field. With the stiffness 2 G* a of a uniform
displacement they give the radius a_c = T^2/(4 G* U) that carries the force: slip over an area that has grown since is added at
equal force and equal energy. A shrinking contact area loses force only once it is smaller than a_c, so load cycles release their
fraction once, not in every cycle. With a uniform field, U = T^2/(4 G* a), this is the rescaled force of Thornton and Randall
(1988), which assumes a uniform field after every step.

Where load and shear swing together, two numbers lose a static force: a merge of new slip takes from the core. So the area may
have up to two closed rings, each with one displacement, and the open one around them, which merges new slip at equal force and
energy. Closed rings take slip as it is. Where the area turns from shrinking to growing, the open ring is closed, and a new one
begins outside; a ring too many merges the two neighbours whose merging loses least energy. Area lost is cut from outside.

Widths of rings are measured in stiffness: of the ring between the radii b and a, 2 G* (a - b). So the sum of force = width
displacement is the force, that of width displacement^2/2 the energy, and a spring of another stiffness has rings of its own. Slip
moves all rings alike and the limit scales them alike, so neither changes the excess energy of `limited`, and its balance holds.
"""

import math
from collections import namedtuple

from thirdbody.laws.contract import Option, Options, kernel

MEMORY = Option(
    "memory", "dimensionless", "auto", words=("auto", "two_number", "one_ring", "two_rings", "rescaled"),
    doc="what a contact keeps of its past. 'rescaled': its force, as in LAMMPS, which falls in every cycle of load; 'two_number':"
    " also its elastic energy; 'one_ring', 'two_rings': also the force of one or two outer rings of the area, needed where"
    " load and shear oscillate together; 'auto': 'two_rings' where they can oscillate, else 'two_number'",
)  # fmt: skip


def retained_energy(options: Options) -> float:
    """Fraction of the energy of a non-uniform field that a contact remembers: 1, or 0 for the rescaled force."""
    return 0.0 if options.get("memory", MEMORY.default) == "rescaled" else 1.0


Spring = namedtuple("Spring", "x y slip stored dissipated")
"""A spring after a step: force on the owner [N]; slip at the limit [m]; elastic and dissipated energy [J]."""

Retained = namedtuple("Retained", "x y x_rate y_rate")
"""Force [N] that a contact area keeps as it shrinks, and its derivative by the overlap [N/m]."""


@kernel
def limited(x_try, y_try, compliance, beyond, lost, limit):
    """Spring returned to `limit` [N] from a trial force, and the fraction that is left of all its displacements. `beyond` is X =
    U - T^2/(2 k), the energy of the field in excess of a uniform one of the same force: slip leaves it unchanged, sliding at the
    limit reduces it. `lost`: the energy before the step less the uniform one of what the area keeps. So the balance is exact: U +
    (T'^2 - T^2)/(2 k) + L slip = U' + dissipated."""
    size = math.sqrt(x_try * x_try + y_try * y_try)
    back = limit / max(size, max(limit, 1e-300))
    x, y = back * x_try, back * y_try
    slip = (1.0 - back) * size * compliance
    left = back * back * beyond
    stored = 0.5 * (x * x + y * y) * compliance + left
    return Spring(x, y, slip, stored, lost - left + back * size * slip), back


@kernel
def stretched(slip_x, slip_y, memory, stiffness, limit, retained):
    """Spring of this stiffness [N/m] after a slip [m], limited to `limit` [N], and its memory (T_x, T_y, U) before and after. The
    contact area carries the fraction min(1, 2 k U/T^2) of force and energy."""
    x_old, y_old, energy = memory
    square = max(x_old * x_old + y_old * y_old, 1e-150)
    firm = max(stiffness, 1e-150)
    inverse = 1.0 / (firm * square)  # one division for two
    compliance = inverse * square
    saved = min(2.0 * stiffness * energy * inverse * firm, 1.0)
    x_scaled, y_scaled = saved * x_old, saved * y_old
    uniform = 0.5 * (x_scaled * x_scaled + y_scaled * y_scaled) * compliance
    beyond = retained * max(saved * energy - uniform, 0.0)
    x_try, y_try = x_scaled - stiffness * slip_x, y_scaled - stiffness * slip_y
    t, _ = limited(x_try, y_try, compliance, beyond, energy - uniform, limit)
    return t, (t.x, t.y, t.stored)


@kernel
def remaining(memory, stiffness, stiffness_rate):
    """What `stretched` keeps of its memory (`Retained`)."""
    x_old, y_old, energy = memory
    square = max(x_old * x_old + y_old * y_old, 1e-150)
    fraction = 2.0 * energy / square
    whole = stiffness * fraction >= 1.0
    saved, rate = (1.0, 0.0) if whole else (stiffness * fraction, stiffness_rate * fraction)
    return Retained(saved * x_old, saved * y_old, rate * x_old, rate * y_old)


@kernel
def scaled(memory, f):
    return f * memory[0], f * memory[1], f * f * memory[2]


@kernel
def renewed_spring(t, retained, energy, slip_x, slip_y, renewal, stiffness):
    """The spring `t` of a step in which rolling renews a fraction of the field, with its heat: int (renewal rate) 2 U over the
    step, exact in a spring that sticks and in one that slides in one direction throughout. `retained`: what the area keeps
    without it."""
    x, y, firm = retained.x, retained.y, max(stiffness, 1e-150)
    left = 1.0 - renewal.retained * renewal.retained
    if t.slip > 0.0:
        lost_x = (1.0 - renewal.retained) * x - (1.0 - renewal.fill) * stiffness * slip_x
        lost_y = (1.0 - renewal.retained) * y - (1.0 - renewal.fill) * stiffness * slip_y
        heat = max(0.5 * (lost_x * (x + t.x) + lost_y * (y + t.y)) / firm, 0.0)
        heat += left * max(energy - 0.5 * (x * x + y * y) / firm, 0.0)
    else:
        work, distance = x * slip_x + y * slip_y, slip_x * slip_x + slip_y * slip_y
        heat = max(left * energy - renewal.mixed * work + renewal.own * stiffness * distance, 0.0)
    return Spring(t.x, t.y, t.slip, t.stored, t.dissipated + heat)


@kernel
def friction_tangent(x, y, limit, limit_rate, stiffness, x_rate, y_rate):
    """dTx/dsx, dTx/dsy, dTy/dsx, dTy/dsy [N/m], dTx/dd, dTy/dd [N/m] of the trial force (x, y) limited to `limit`, which falls by
    `stiffness` per slip and changes by (x_rate, y_rate) per overlap. Beyond the limit T = L t/|t|, so dT = dL t/|t| + (L/|t|)(1 -
    t t^T/|t|^2) dt (radial return)."""
    size = math.sqrt(x * x + y * y)
    if size <= limit:
        return -stiffness, 0.0, 0.0, -stiffness, x_rate, y_rate
    e_x, e_y = x / size, y / size
    fraction = limit / size
    xx, xy, yy = fraction * (1.0 - e_x * e_x), -fraction * e_x * e_y, fraction * (1.0 - e_y * e_y)
    x_total = limit_rate * e_x + xx * x_rate + xy * y_rate
    y_total = limit_rate * e_y + xy * x_rate + yy * y_rate
    return -stiffness * xx, -stiffness * xy, -stiffness * xy, -stiffness * yy, x_total, y_total


Ring = namedtuple("Ring", "width x y")
"""Part of the contact area: width in stiffness [N/m], displacement [m] with the sign of its force on the owner."""

Rings = namedtuple("Rings", "inner outer open x y energy edge_x edge_y")
"""Rings of a contact area, from inside; force [N] and energy [J] of all; the ring that is cut at the edge of the area."""

HISTORY = ("force_x", "force_y", "energy", "stiffness", "open", "outer", "outer_x", "outer_y", "inner", "inner_x", "inner_y")
"""With one closed ring the first eight. `stiffness`: of the last step, negative after a fall; `open` and so on: widths."""


@kernel
def cut(memory, stiffness):
    """Rings of a memory (HISTORY) that are left of an area of this stiffness [N/m]."""
    x, y, energy, _, width, outer, outer_x, outer_y, inner, inner_x, inner_y = memory
    inverse = 1.0 / max(width, 1e-300) if width > 1e-15 * (outer + inner) else 0.0  # a narrower one's displacement is rounding
    open_x, open_y = inverse * (x - outer * outer_x - inner * inner_x), inverse * (y - outer * outer_y - inner * inner_y)
    one = min(inner, stiffness)
    two = min(outer, stiffness - one)
    three = min(width, stiffness - one - two)
    a, b, c = inner - one, outer - two, width - three
    left_x, left_y = x - (a * inner_x + b * outer_x + c * open_x), y - (a * inner_y + b * outer_y + c * open_y)
    square = a * (inner_x * inner_x + inner_y * inner_y) + b * (outer_x * outer_x + outer_y * outer_y)
    left = max(energy - 0.5 * (square + c * (open_x * open_x + open_y * open_y)), 0.0)
    edge_x, edge_y = (open_x, open_y) if c > 0.0 else (0.0, 0.0)
    edge_x, edge_y = (outer_x, outer_y) if b > 0.0 else (edge_x, edge_y)
    edge_x, edge_y = (inner_x, inner_y) if a > 0.0 else (edge_x, edge_y)
    rings = Ring(one, inner_x, inner_y), Ring(two, outer_x, outer_y), Ring(three, open_x, open_y)
    return Rings(*rings, left_x, left_y, left, edge_x, edge_y)


@kernel
def merged(a, b):
    """One ring in place of two, at equal force, and the energy that this loses [J]."""
    width = a.width + b.width
    inverse = 1.0 / max(width, 1e-300)
    x, y = b.x - a.x, b.y - a.y
    ring = Ring(width, inverse * (a.width * a.x + b.width * b.x), inverse * (a.width * a.y + b.width * b.y))
    return ring, 0.5 * a.width * b.width * inverse * (x * x + y * y)


@kernel
def swung(slip_x, slip_y, memory, stiffness, limit, single):
    """`stretched` with rings, `single`: at most one closed ring. The spring after a slip, and its memory."""
    energy, last = memory[2], memory[3]
    rings = cut(memory, stiffness)
    inner, outer, ring, left = rings.inner, rings.outer, rings.open, rings.energy
    if last < 0.0 and stiffness > -last and ring.width > 0.0:  # the open ring is closed; empty rings merge without loss
        whole, cost = merged(inner, outer)
        around, loss = merged(outer, ring)
        if single or loss < cost:
            outer = around
        else:
            inner, outer, loss = whole, ring, cost
        ring, left = Ring(0.0, 0.0, 0.0), max(left - loss, 0.0)
    compliance = 1.0 / max(stiffness, 1e-150)
    uniform = 0.5 * (rings.x * rings.x + rings.y * rings.y) * compliance
    beyond = max(left - uniform, 0.0)
    t, back = limited(rings.x - stiffness * slip_x, rings.y - stiffness * slip_y, compliance, beyond, energy - uniform, limit)
    # what is not in a closed ring, old displacement and virgin area, becomes the open ring: equal force, equal energy
    area = max(stiffness - inner.width - outer.width, 0.0)
    virgin = max(area - ring.width, 0.0)
    o_x, o_y = ring.x - slip_x, ring.y - slip_y
    f_x, f_y = ring.width * o_x - virgin * slip_x, ring.width * o_y - virgin * slip_y
    square = ring.width * (o_x * o_x + o_y * o_y) + virgin * (slip_x * slip_x + slip_y * slip_y)
    width = min((f_x * f_x + f_y * f_y) / max(square, 1e-300), area)
    falls = stiffness < abs(last) or (stiffness == abs(last) and last < 0.0)
    outer_x, outer_y = back * (outer.x - slip_x), back * (outer.y - slip_y)
    inner_x, inner_y = back * (inner.x - slip_x), back * (inner.y - slip_y)
    now = -stiffness if falls else stiffness
    return t, (t.x, t.y, t.stored, now, width, outer.width, outer_x, outer_y, inner.width, inner_x, inner_y)


Memory = namedtuple("Memory", "history step remaining scaled")
"""A kind of memory: names of its floats; a step of the spring; what the area keeps; all displacements scaled."""


def of_rings(size: int) -> Memory:
    """Return the memory with one closed ring at most, the first eight floats of `HISTORY`, or with two."""
    single = size < len(HISTORY)

    @kernel
    def step(slip_x, slip_y, memory, stiffness, limit, _retained):
        t, new = swung(slip_x, slip_y, (*memory, 0.0, 0.0, 0.0)[:11], stiffness, limit, single)
        return t, new[:size]

    @kernel
    def remaining_rings(memory, stiffness, stiffness_rate):
        rings = cut((*memory, 0.0, 0.0, 0.0)[:11], stiffness)
        return Retained(rings.x, rings.y, stiffness_rate * rings.edge_x, stiffness_rate * rings.edge_y)

    @kernel
    def scaled_rings(memory, f):
        x, y, energy, last, width, outer, outer_x, outer_y, inner, inner_x, inner_y = (*memory, 0.0, 0.0, 0.0)[:11]
        closed_rings = outer, f * outer_x, f * outer_y, inner, f * inner_x, f * inner_y
        return (f * x, f * y, f * f * energy, last, width, *closed_rings)[:size]

    return Memory(HISTORY[:size], step, remaining_rings, scaled_rings)


MEMORIES = Memory(HISTORY[:3], stretched, remaining, scaled), of_rings(8), of_rings(11)  # by the number of closed rings
