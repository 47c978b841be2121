"""Effect of rolling on the springs of the level `mdr`: they are carried outward.

w(x) -> kept w(kept x) (`laws.renewal`). In a short step a cell gets its content from itself and the next one inward only.
"""

from thirdbody.plugin import kernel

from .numerical_tangent import helper
from .spring_grid import mean_gap, width_of


@helper
def from_next_cell(n, wide, lost):
    """Return whether every cell gets its content from itself and the next one inward."""
    return (n + wide) * lost <= 1.0


@kernel
def carry(w, rows, grid, overlap, retained):
    """Write the springs w (2 n,) carried outward by rolling into rows[: 2 n], as means over the cells; zero beyond `overlap`.

    `rows` (4 n + 1,) is scratch otherwise; `grid` = (springs, wide cells, spacing^2/R). A cell holds the content of the interval
    of `retained` times its ends, so force is lost across the edge only.
    """
    n, wide, scale = grid
    if retained == 1.0:
        for i in range(2 * n):
            rows[i] = w[i]
    elif from_next_cell(n, wide, 1.0 - retained):
        x, y = copied_behind_pad(w, rows, 2 * n)
        for i in range(n):
            near, far, _ = next_weights(i, wide, retained)
            inside = 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
            near, far = inside * near, inside * far
            rows[i] = near * rows[x + i] + far * rows[x - 1 + i]
            rows[n + i] = near * rows[y + i] + far * rows[y - 1 + i]
    else:
        for i in range(n):
            j, k, near, far = source_of(i, n, wide, retained)
            inside = 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
            near, far = inside * near, inside * far
            rows[i], rows[n + i] = near * w[j] + far * w[k], near * w[n + j] + far * w[n + k]


@kernel
def carry_with_rates(w, rows, grid, overlap, renewal):
    """Do it, and write the derivatives of the carried springs by the overlap behind them, rows[2 n : 4 n].

    `rows` (6 n + 1,) is scratch otherwise; `renewal` = fraction retained, and its derivative by the overlap [1/m].
    """
    (n, wide, scale), (retained, rate) = grid, renewal
    if retained == 1.0:
        for i in range(2 * n):
            rows[i], rows[2 * n + i] = w[i], 0.0
    elif from_next_cell(n, wide, 1.0 - retained):
        x, y = copied_behind_pad(w, rows, 4 * n)
        for i in range(n):
            near, far, inner = next_weights(i, wide, retained)
            inside = 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
            near, far, part = inside * near, inside * far, inside * rate
            x_near, x_far, y_near, y_far = rows[x + i], rows[x - 1 + i], rows[y + i], rows[y - 1 + i]
            rows[i], rows[n + i] = near * x_near + far * x_far, near * y_near + far * y_far
            rows[2 * n + i] = part * ((inner + 1.0) * x_near - inner * x_far)
            rows[3 * n + i] = part * ((inner + 1.0) * y_near - inner * y_far)
    else:
        for i in range(n):
            j, k, near, far = source_of(i, n, wide, retained)
            inner, inside = inner_end(i, wide), 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
            near, far, part, last = inside * near, inside * far, inside * rate, k if far > 0.0 else j
            rows[i], rows[n + i] = near * w[j] + far * w[k], near * w[n + j] + far * w[n + k]
            rows[2 * n + i] = part * ((inner + 1.0) * w[last] - inner * w[j])
            rows[3 * n + i] = part * ((inner + 1.0) * w[n + last] - inner * w[n + j])


@helper
def inner_end(i, wide):
    """Return the position of the inner end of cell i, in its widths."""
    position = float(i)
    return position if i < wide else position + wide


@helper
def next_weights(i, wide, retained):
    """Return the weights of cell i and the next one inward in the content of cell i, and the position of its inner end."""
    inner = inner_end(i, wide)
    far = inner * (1.0 - retained)
    return retained - far, far, inner


@kernel
def copied_behind_pad(w, rows, pad):
    """Copy the springs w (2 n,) behind `rows[pad]`, where every one has a neighbour; return where x and y begin.

    The neighbours of the innermost springs have no weight.
    """
    rows[pad] = 0.0
    for i in range(len(w)):
        rows[pad + 1 + i] = w[i]
    return pad + 1, pad + 1 + len(w) // 2


@helper
def source_of(i, n, wide, retained):
    """Return from which two cells cell i gets its content, the inner one first, and their weights."""
    width, inner = width_of(i, wide), float(i + min(i, wide))
    j = min(cell_at(retained * inner, wide), i)
    far = min(max(retained * (inner + width) - (j + 1 + min(j + 1, wide)), 0.0) / width, retained)
    return j, min(j + 1, n - 1), retained - far, far


@helper
def cell_at(y, wide):
    """Cell that contains the position y, in spacings."""
    return int(0.5 * y) if y < 2.0 * wide else wide + int(y - 2.0 * wide)
