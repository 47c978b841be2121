"""Effect of rolling on the springs of the level `mdr`: they are carried outward.

w(x) -> kept w(kept x) (`laws.patch_renewal`).
"""

from .numerical_tangent import helper
from .spring_grid import mean_gap, width_of


@helper
def cell_at(y, wide):
    """Cell that contains the position y, in spacings."""
    return int(0.5 * y) if y < 2.0 * wide else wide + int(y - 2.0 * wide)


@helper
def carry_outward(w, rows, grid, overlap, kept):
    """Write the springs carried outward by rolling into `rows`, as means over the cells; zero beyond `overlap`.

    `grid` = (springs, wide cells, spacing^2/R). A cell holds the content of the interval of `kept` times its ends, so force is
    lost across the edge only.
    """
    n, wide, scale = grid
    lost = 1.0 - kept
    if (n + wide) * lost <= 1.0:  # from the next cell alone, without branches
        for i in range(n):
            width, inner, k = width_of(i, wide), float(i + min(i, wide)), max(i - 1, 0)
            inside = 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
            near, far = inside * (width - (inner + width) * lost) / width, inside * inner * lost / width
            rows[i] = near * w[i] + far * w[k]
            rows[n + i] = near * w[n + i] + far * w[n + k]
        return
    for i in range(n):
        width, inner = width_of(i, wide), float(i + min(i, wide))
        inside = 1.0 if mean_gap(i, wide, scale) < overlap else 0.0
        j = min(cell_at(kept * inner, wide), i)
        k = min(j + 1, n - 1)
        far = min(max(kept * (inner + width) - (j + 1 + min(j + 1, wide)), 0.0) / width, kept)
        near, far = inside * (kept - far), inside * far
        rows[i] = near * w[j] + far * w[k]
        rows[n + i] = near * w[n + j] + far * w[n + k]


@helper
def carried_rate(w, i, grid, overlap, kept):
    """Derivative of spring i of `carry_outward` by `kept`, along x and y."""
    n, wide, scale = grid
    if mean_gap(i, wide, scale) >= overlap:
        return 0.0, 0.0
    width, inner = width_of(i, wide), float(i + min(i, wide))
    outer = inner + width
    j, k = min(cell_at(kept * inner, wide), n - 1), min(cell_at(kept * outer, wide), n - 1)
    return (outer * w[k] - inner * w[j]) / width, (outer * w[n + k] - inner * w[n + j]) / width


@helper
def renewal_heat(w, rolled, w_new, grid, back, step, share):
    """Energy released from the springs by rolling in the step [m2]: times the stiffness of a spring it is energy.

    `rolled` are the old springs carried outward, `back` the factor by which each was returned onto its limit; `grid` = (springs,
    wide cells, spacing^2/R), `step` = (overlap before, slip x, y); `share` is the `Renewal` of the step. Exact for uniform
    springs that stick and for springs that slide in one direction throughout, of first order in the renewal of a step in between.
    """
    (n, wide, scale), (before, slip_x, slip_y) = grid, step
    mean = 1.0 - share.fill
    mixed = share.fill - mean / (1.0 - share.kept)
    total = 0.0
    for i in range(n):
        s_x, s_y = (slip_x, slip_y) if before > mean_gap(i, wide, scale) else (0.0, 0.0)
        x, y, far_x, far_y = w[i], w[n + i], rolled[i], rolled[n + i]
        if back[i] < 1.0:
            lost_x = x - far_x - mean * s_x
            lost_y = y - far_y - mean * s_y
            heat = 0.5 * (lost_x * (x + w_new[i]) + lost_y * (y + w_new[n + i]))
        else:
            # mean over the step minus the fraction `fill` of the end, where the springs decay from one to the other
            heat = 0.5 * (x * x + y * y - far_x * far_x - far_y * far_y) + share.own * (s_x * s_x + s_y * s_y)
            heat -= s_x * (mean * x + mixed * (x - far_x)) + s_y * (mean * y + mixed * (y - far_y))
        total += width_of(i, wide) * heat
    return max(total, 0.0)
