"""Products of vectors and symmetric tensors that are tuples of numbers."""

from numba import njit

from thirdbody.jit.options import BARE


@njit(**BARE)
def cross(a, b):
    """Return the cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**BARE)
def dot(a, b):
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**BARE)
def scaled_sum(x, a, y, b, z, c):
    """Return x a + y b + z c of three vectors."""
    return x * a[0] + y * b[0] + z * c[0], x * a[1] + y * b[1] + z * c[1], x * a[2] + y * b[2] + z * c[2]


@njit(**BARE)
def product(tensor, v):
    """Return the product of a symmetric tensor (xx, yy, zz, xy, xz, yz) and a vector."""
    xx, yy, zz, xy, xz, yz = tensor
    x, y, z = v
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
