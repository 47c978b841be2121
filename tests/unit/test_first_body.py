"""What kernels may assume of any first body: the normal is that of its surface, the curvature enters the effective radius."""

import numpy as np
import pytest
from numba import njit

from thirdbody.kernels import first_body
from thirdbody.kernels.bundles import Motion
from thirdbody.kernels.columns import patch

LOWER, UPPER = -1, -3  # the second patch
CENTRE, RADIUS = (0.3, -0.2, 0.9), 1.0


@njit
def overlap(partner, x, P):
    """The engine's functions have no wrappers for Python."""
    return first_body.overlap(partner, x, RADIUS, P)


@njit
def normal(partner, x, P):
    return first_body.normal(partner, x, P)


@njit
def to_surface(partner, x, P):
    return first_body.to_surface(partner, x, P)


@njit
def velocity(partner, P, motion):
    return first_body.velocity(partner, P, motion)


@njit
def effective_radius(radius, curvature):
    return first_body.effective_radius(radius, curvature)


@pytest.fixture
def patches():
    P = np.zeros((2, patch.WIDTH))
    P[:, patch.HEIGHT], P[:, patch.VELOCITY], P[:, patch.DISPLACEMENT2] = (9.0, 1.8), (7.0, 0.5), ((5.0, 6.0), (0.1, 0.4))
    return P


@pytest.mark.parametrize("partner", [LOWER, UPPER])
def test_the_normal_points_where_the_overlap_decreases_fastest(patches, partner):
    h, gradient = 1e-6, []
    for axis in np.eye(3):
        ahead, behind = (overlap(partner, tuple(np.add(CENTRE, sign * h * axis)), patches) for sign in (1.0, -1.0))
        gradient.append((ahead - behind) / (2.0 * h))
    # rounding of a difference of lengths of about 1 over 2e-6
    assert np.negative(gradient) == pytest.approx(normal(partner, CENTRE, patches), abs=1e-9)
    assert np.linalg.norm(normal(partner, CENTRE, patches)) == 1.0


def test_a_sphere_between_two_plates_overlaps_with_each(patches):
    assert overlap(LOWER, CENTRE, patches) == pytest.approx(0.1, rel=1e-12)
    assert overlap(UPPER, CENTRE, patches) == pytest.approx(0.1, rel=1e-12)


def test_a_surface_moves_with_its_plate_and_has_the_debris_above_it(patches):
    assert to_surface(LOWER, CENTRE, patches) == CENTRE
    assert to_surface(UPPER, CENTRE, patches) == pytest.approx((0.3 - 0.1, -0.2 - 0.4, 1.8 - 0.9))


def test_only_the_upper_plate_moves(patches):
    motion = Motion(1e-9, 3.0, -4.0)
    assert velocity(LOWER, patches, motion) == (0.0, 0.0, 0.0)
    assert velocity(UPPER, patches, motion) == (3.0, -4.0, 0.5)


def test_curvatures_add():
    assert effective_radius(2.0, 0.0) == 2.0
    assert effective_radius(2.0, 0.5) == pytest.approx(1.0), "on a sphere of the same radius"
    assert effective_radius(2.0, -0.25) == pytest.approx(4.0), "in a hollow of twice the radius"
