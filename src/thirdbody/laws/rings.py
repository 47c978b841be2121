"""Memory of a spring whose load and shear swing together: closed rings of the contact area inside an open one.

One displacement cannot hold both what lies deep inside the contact area and what the last half swing has laid around it: the
merge of new slip (`thirdbody.laws.radial_return`) takes a inverse from the core in every swing, and a static force ratchets away.
Here the area has up to two closed rings, each with one displacement, and the open one around them, which merges new slip at equal
force and energy. Closed rings take slip as it is. Where the area turns from shrinking to growing, the open ring is closed, and a
new one begins outside; a ring too many merges the two neighbours whose merging loses least energy. Area lost is cut from outside.

Widths are measured in stiffness: of the ring between the radii b and a, 2 G* (a - b). So the sum of force = width displacement is
the force, that of width displacement^2/2 the energy, and a spring of another stiffness has rings of its own. Slip moves all rings
alike and the limit scales them alike, so neither changes the excess energy of `radial_return.limited`, and its balance holds.
"""

from typing import NamedTuple

from thirdbody.laws.contract import kernel
from thirdbody.laws.radial_return import Retained, limited


class Ring(NamedTuple):
    """Part of the contact area: width in stiffness [N/m], displacement [m] with the sign of its force on the owner."""

    width: float
    x: float
    y: float


class Rings(NamedTuple):
    """Rings of a contact area, from inside; force [N] and energy [J] of all; the ring that is cut at the edge of the area."""

    inner: Ring
    outer: Ring
    open: Ring
    x: float
    y: float
    energy: float
    edge_x: float
    edge_y: float


HISTORY = ("force_x", "force_y", "energy", "stiffness", "open", "outer", "outer_x", "outer_y", "inner", "inner_x", "inner_y")
"""With one closed ring the first eight. `stiffness`: of the last step, negative after a fall; `open` and so on: widths."""


@kernel
def cut(memory, stiffness):
    """Rings of a memory (HISTORY) that are left of an area of this stiffness [N/m]."""
    x, y, energy, _, width, outer, outer_x, outer_y, inner, inner_x, inner_y = memory
    inverse = 1.0 / max(width, 1e-300) if width > 0.0 else 0.0  # a ring of no width has no displacement
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
def closed(rings, single):
    """Rings once the open one is closed; `single`: at most one closed ring. Empty rings merge without loss."""
    whole, cost = merged(rings.inner, rings.outer)
    around, loss = merged(rings.outer, rings.open)
    if single or loss < cost:
        inner, outer = rings.inner, around
    else:
        inner, outer, loss = whole, rings.open, cost
    left = max(rings.energy - loss, 0.0)
    return Rings(inner, outer, Ring(0.0, 0.0, 0.0), rings.x, rings.y, left, rings.edge_x, rings.edge_y)


@kernel
def swung(slip_x, slip_y, memory, stiffness, limit, single):
    """`radial_return.stretched` with rings: the spring after a slip, and its memory."""
    energy, last = memory[2], memory[3]
    rings = cut(memory, stiffness)
    if last < 0.0 and stiffness > -last and rings.open.width > 0.0:
        rings = closed(rings, single)
    inner, outer, ring = rings.inner, rings.outer, rings.open
    compliance = 1.0 / max(stiffness, 1e-150)
    uniform = 0.5 * (rings.x * rings.x + rings.y * rings.y) * compliance
    beyond = max(rings.energy - uniform, 0.0)
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


@kernel
def swung_once(slip_x, slip_y, memory, stiffness, limit, _retained):
    """`swung` with one closed ring at most."""
    t, new = swung(slip_x, slip_y, (*memory, 0.0, 0.0, 0.0), stiffness, limit, True)
    return t, new[:8]


@kernel
def swung_twice(slip_x, slip_y, memory, stiffness, limit, _retained):
    """`swung` with two closed rings at most."""
    return swung(slip_x, slip_y, memory, stiffness, limit, False)


@kernel
def remaining_two(memory, stiffness, stiffness_rate):
    """`radial_return.remaining` of a memory with two closed rings."""
    rings = cut(memory, stiffness)
    return Retained(rings.x, rings.y, stiffness_rate * rings.edge_x, stiffness_rate * rings.edge_y)


@kernel
def remaining_one(memory, stiffness, stiffness_rate):
    """`radial_return.remaining` of a memory with one closed ring."""
    return remaining_two((*memory, 0.0, 0.0, 0.0), stiffness, stiffness_rate)


@kernel
def scaled_one(memory, f):
    """A memory with one closed ring, all displacements scaled."""
    x, y, energy, last, width, outer, outer_x, outer_y = memory
    return f * x, f * y, f * f * energy, last, width, outer, f * outer_x, f * outer_y


@kernel
def scaled_two(memory, f):
    """A memory with two closed rings, all displacements scaled."""
    return (*scaled_one(memory[:8], f), memory[8], f * memory[9], f * memory[10])
