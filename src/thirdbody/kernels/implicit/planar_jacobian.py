"""Contribution of a contact with a plane to the Jacobian of a body (`jacobian`), by blocks of three columns.

The force on the body changes with the displacement s of its surface by the tensor A, and s = u + w x r:

    df/du = A                        df/dw: rows r x A_i
    dt/du = r x A - p n              dt/dw = r x df/dw - p (r x n) + a f - (a.f) 1        with p = n x f/2

from dt = r x df + dr x f and dr = w x a + dd n/2, where the overlap changes by dd = -n.s. Column by column
(`jacobian.add_column`) it takes three times the products.
"""

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.implicit.vector_algebra import cross, dot, scaled_sum


@njit(**BARE)
def force_tensor(contact):
    """Return the rows of A [N/m]: change of the force with the displacement of the surface."""
    (n, e, g), (k_n, xx, xy, yx, yy, xd, yd) = contact.frame, contact.tangent
    t_1, t_2 = scaled_sum(xx, e, xy, g, -xd, n), scaled_sum(yx, e, yy, g, -yd, n)
    return (
        scaled_sum(e[0], t_1, g[0], t_2, -k_n * n[0], n),
        scaled_sum(e[1], t_1, g[1], t_2, -k_n * n[1], n),
        scaled_sum(e[2], t_1, g[2], t_2, -k_n * n[2], n),
    )


@njit(**BARE)
def moment_rows(r, rows, p, arm):
    """Return the rows of r x A - p arm, where `rows` are those of A."""
    x, y, z = r
    return (
        scaled_sum(y, rows[2], -z, rows[1], -p[0], arm),
        scaled_sum(z, rows[0], -x, rows[2], -p[1], arm),
        scaled_sum(x, rows[1], -y, rows[0], -p[2], arm),
    )


@njit(**BARE)
def add_block(row, column, rows, J):
    """Add three rows of three to J."""
    for k in range(3):
        J[row, column + k] += rows[0][k]
        J[row + 1, column + k] += rows[1][k]
        J[row + 2, column + k] += rows[2][k]


@njit(**BARE)
def add_planar_contact(contact, J):
    """Add a contact without moments, whose normal does not turn, to J (rotations in rad)."""
    n, r, f, a = contact.frame[0], contact.point, contact.force, contact.centre
    A = force_tensor(contact)
    force_by_rotation = cross(r, A[0]), cross(r, A[1]), cross(r, A[2])
    x, y, z = cross(n, f)
    p, along_arm = (0.5 * x, 0.5 * y, 0.5 * z), dot(a, f)
    torque_by_displacement, torque_by_rotation = moment_rows(r, A, p, n), moment_rows(r, force_by_rotation, p, cross(r, n))
    add_block(0, 0, A, J)
    add_block(0, 3, force_by_rotation, J)
    add_block(3, 0, torque_by_displacement, J)
    add_block(3, 3, torque_by_rotation, J)
    for i in range(3):
        for k in range(3):
            J[3 + i, 3 + k] += a[i] * f[k]
        J[3 + i, 3 + i] -= along_arm
    if contact.upper:
        # the patch rises: the body moves down relative to it, and the opposite force acts on it
        for i in range(3):
            J[i, 6] -= A[i][2]
            J[3 + i, 6] -= torque_by_displacement[i][2]
            J[6, i] -= A[2][i]
            J[6, 3 + i] -= force_by_rotation[2][i]
        J[6, 6] += A[2][2]
