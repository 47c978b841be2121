"""What every tangential law with Coulomb's limit shares: the derivative of a trial force that is scaled back onto the limit."""

from __future__ import annotations

import math

from .contract import kernel


@kernel
def friction_tangent(x, y, limit, limit_rate, stiffness, x_rate, y_rate):
    """dTx/dsx, dTx/dsy, dTy/dsx, dTy/dsy (N/m), dTx/dd, dTy/dd (N/m) of the trial force (x, y) cut at `limit`.

    The trial force falls by `stiffness` per slip along either axis and changes by (x_rate, y_rate) per overlap, the limit by
    `limit_rate`. Beyond the limit T = L t/|t|, so dT = dL t/|t| + (L/|t|)(1 - t t^T/|t|^2) dt (radial return).
    """
    size = math.sqrt(x * x + y * y)
    if size <= limit:
        return -stiffness, 0.0, 0.0, -stiffness, x_rate, y_rate
    e_x, e_y = x / size, y / size
    share = limit / size
    xx, xy, yy = share * (1.0 - e_x * e_x), -share * e_x * e_y, share * (1.0 - e_y * e_y)
    x_total = limit_rate * e_x + xx * x_rate + xy * y_rate
    y_total = limit_rate * e_y + xy * x_rate + yy * y_rate
    return -stiffness * xx, -stiffness * xy, -stiffness * xy, -stiffness * yy, x_total, y_total
