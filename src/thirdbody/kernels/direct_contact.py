"""Direct contact of the plates through their own asperities: a normal force that falls exponentially with the gap, and friction.

F(u) = F_0 exp(-u/u_0) with the mean gap u (Persson, PRL 99:125502, 2007); friction opposes the motion of the upper plate with
mu F and has no elastic part, so a plate at rest feels none.
"""

import math

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.tables import patch, run_totals


@njit(**BARE)
def direct_force(P, p):
    """Return the upward force of direct contact on patch p, or on the common plate [N]; 0 where there is none."""
    if P[p, patch.DIRECT_PREFACTOR] == 0.0:
        return 0.0
    return P[p, patch.DIRECT_PREFACTOR] * math.exp(-P[p, patch.HEIGHT] / P[p, patch.DIRECT_LENGTH])


@njit(**BARE)
def max_stiffness(P, p, time):
    """Return the largest stiffness [N/m] that direct contact can have within a time [s], from the present speed and forces.

    The energy of the approach limits the depth, and the force that stops it grows with the depth.
    """
    v, a = P[p, patch.VELOCITY], (P[p, patch.FORCE] - P[p, patch.LOAD]) / P[p, patch.MASS]
    t = min(time, -v / a) if a > 0.0 and v < 0.0 else time
    deeper, now, length = max(-v * t - 0.5 * a * t * t, 0.0), direct_force(P, p), P[p, patch.DIRECT_LENGTH]
    energy = 0.5 * P[p, patch.MASS] * v * v + P[p, patch.LOAD] * deeper
    return min(now * math.exp(min(deeper / length, 700.0)), now + energy / length) / length


@njit(**BARE)
def book_direct_contact(A, P, p, motion, old):
    """Add a step to the totals A: impulses, and the work of friction, which the drive of the plate supplies.

    P: patches at the end of the step; `old`: weight of the force at its start.
    """
    normal, mu = direct_force(P, p), P[p, patch.DIRECT_FRICTION]
    speed = math.sqrt(motion.v_x * motion.v_x + motion.v_y * motion.v_y)
    drag = mu * normal / speed if speed > 0.0 else 0.0
    work = mu * speed * motion.dt * (old * A[run_totals.DIRECT_FORCE + 2] + (1.0 - old) * normal)
    A[run_totals.DIRECT_WORK] += work
    A[run_totals.DRAG_WORK] += work
    A[run_totals.PLATE_WORK] += work
    A[run_totals.PLATE_WORK_SIZE] += work
    now = (-drag * motion.v_x, -drag * motion.v_y, normal)
    for k in range(3):
        A[run_totals.DIRECT_IMPULSE + k] += motion.dt * (old * A[run_totals.DIRECT_FORCE + k] + (1.0 - old) * now[k])
        A[run_totals.DIRECT_FORCE + k] = now[k]
