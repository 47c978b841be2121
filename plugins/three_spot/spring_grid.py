"""Cells of the springs of the level `mdr` in a growing contact area: the inner ones are two spacings wide, the others one.

When the contact area reaches the end of the grid, the innermost two narrow cells are merged, and a cell is added outside. When
these were the last two, all cells are wide, the added one too: the spacing doubles and all are narrow. So all cells are in use
whatever the size of a growing contact, merged cells lie wholly within it, and the grid depends on the number of merges only.
"""

import math

from thirdbody.plugin import helper

MAX_SPRINGS = 512
"""Largest number of springs of a contact."""
FIRST = 2.0**-20
"""Half width of the smallest grid over the radius of curvature: an overlap of 1e-12 of it."""
DOUBLINGS = 50
"""Maximum number of doublings of the spacing: half widths of 1e9 radii, which occur only in a run about to be stopped."""
ENDLESS = FIRST * 2.0**DOUBLINGS


@helper
def cells_of(merges, n, radius):
    """(spacing, number of wide cells) of a grid of n cells after this number of merges."""
    doublings = merges // (n - 1)
    return FIRST * radius / n * (1 << doublings), merges - doublings * (n - 1)


@helper
def end_of(n, wide, spacing, radius):
    """Largest overlap whose contact area fits the grid [m]."""
    half_width = (n + wide) * spacing
    return half_width * half_width / radius if spacing * n < ENDLESS * radius else math.inf


@helper
def merges_for(overlap, n, radius):
    """Smallest number of merges after which the contact area of an overlap fits the grid."""
    cells = math.sqrt(max(overlap, 0.0) / radius) / FIRST
    doublings = min(max(math.frexp(cells)[1] - 1, 0), DOUBLINGS)
    wide = int(math.ceil(n * math.ldexp(cells, -doublings))) - n
    return (n - 1) * doublings + min(max(wide, 0), n - 1)


@helper
def width_of(i, wide):
    """Width of cell i, in spacings."""
    return 2.0 if i < wide else 1.0


@helper
def mean_gap(i, wide, scale):
    """Mean gap over cell i [m], with `scale` = spacing^2/R."""
    position, scale = (i + 0.5, 4.0 * scale) if i < wide else (i + 0.5 + wide, scale)
    return scale * (position * position + 1.0 / 12.0)


@helper
def merge(rows, count, n, wide):
    """In each of `count` rows of n springs replace number `wide` and the next by their mean; add a spring at rest outside."""
    for row in range(count):
        first, last = row * n + wide, row * n + n - 1
        rows[first] = 0.5 * (rows[first] + rows[first + 1])
        for i in range(first + 1, last):
            rows[i] = rows[i + 1]
        rows[last] = 0.0


@helper
def squares_lost(merges, n, spacing):
    """Reduction of the sum of squares (`sums` in `mdr`) of a field w = R d - x^2 by this number of merges during its growth [m4].

    Two narrow cells at the distance x lose (2 spacing x)^2/2. The sum of that over all x is cubic in the number of cells, the sum
    over all doublings a geometric series.
    """
    doublings = merges // (n - 1)
    wide = float(merges - doublings * (n - 1))
    all_wide = n - 1.0
    before = all_wide * (4.0 * all_wide * all_wide - 1.0) * (1.0 - 0.03125**doublings) / 31.0
    return 2.0 / 3.0 * spacing**4 * (wide * (4.0 * wide * wide - 1.0) + before)
