"""Effect of rolling on the springs of the level `mdr`: they are carried outward.

w(x) -> kept w(kept x) (`laws.patch_renewal`). In a short step a cell gets its content from itself and the next one inward only.
Then the loops over the springs carry them (`mdr.segment`) with the weights of `carried_weights`: a pass of its own takes longer.
"""

from .numerical_tangent import helper
from .spring_grid import mean_gap, width_of


@helper
def from_next_cell(n, wide, lost):
    """Return whether every cell gets its content from itself and the next one inward."""
    return (n + wide) * lost <= 1.0


@helper
def carried_weights(i, wide, lost):
    """Return the weights of cell i and the next one inward in the content of cell i, and the position of its inner end.

    The position is in widths of the cell. The weights hold where `from_next_cell`; their derivatives by 1 - lost are place + 1
    and -place.
    """
    position = i if i < wide else i + wide
    far_weight = position * lost
    return 1.0 - lost - far_weight, far_weight, position


@helper
def cell_at(y, wide):
    """Cell that contains the position y, in spacings."""
    return int(0.5 * y) if y < 2.0 * wide else wide + int(y - 2.0 * wide)


@helper
def carry_outward(w, rows, first, grid, overlap, retained):
    """Write the springs carried outward by rolling into `rows`, as means over the cells; zero beyond `overlap`.

    `first`: position of the pad of the rows x and y (`copy_rows`); `grid` = (springs, wide cells, spacing^2/R). A cell holds the
    content of the interval of `retained` times its ends, so force is lost across the edge only.
    """
    n, wide, scale = grid
    x, y = first + 1, first + n + 2
    rows[x - 1] = rows[y - 1] = 0.0
    for i in range(n):
        width, inner = width_of(i, wide), float(i + min(i, wide))
        inside = 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
        j = min(cell_at(retained * inner, wide), i)
        k = min(j + 1, n - 1)
        far_weight = min(max(retained * (inner + width) - (j + 1 + min(j + 1, wide)), 0.0) / width, retained)
        near_weight, far_weight = inside * (retained - far_weight), inside * far_weight
        rows[x + i] = near_weight * w[j] + far_weight * w[k]
        rows[y + i] = near_weight * w[n + j] + far_weight * w[n + k]


@helper
def carried_rate(w, i, grid, overlap, retained):
    """Derivative of spring i of `carry_outward` by `retained`, along x and y."""
    n, wide, scale = grid
    if mean_gap(i, wide, scale) >= overlap:
        return 0.0, 0.0
    width, inner = width_of(i, wide), float(i + min(i, wide))
    outer = inner + width
    j, k = min(cell_at(retained * inner, wide), n - 1), min(cell_at(retained * outer, wide), n - 1)
    return (outer * w[k] - inner * w[j]) / width, (outer * w[n + k] - inner * w[n + j]) / width


@helper
def copy_rows(w, n, rows, first):
    """Copy the springs w into `rows` from `first` on: a row for x and one for y, each behind a pad of one element, zero."""
    x, y = first + 1, first + n + 2
    rows[x - 1] = rows[y - 1] = 0.0
    for i in range(n):
        rows[x + i], rows[y + i] = w[i], w[n + i]
