"""What kernels may assume of any first body: overlap, normal, effective radius, velocity."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from thirdbody.kernels import first_body
from thirdbody.kernels.bundles import Motion
from thirdbody.kernels.columns import patch, sphere, surface_contact
from thirdbody.kernels.predicates import BASINS

LOWER, UPPER = -1, -1 - 2 * BASINS  # the second patch
CENTRE, RADIUS = (0.3, -0.2, 0.9), 1.0


class Context(NamedTuple):
    """The tables of one candidate."""

    own: np.ndarray
    partner: np.ndarray
    S: np.ndarray
    P: np.ndarray
    Q: np.ndarray


def candidate(partner, x, P, rows=0):
    """A sphere at x and a plate."""
    S = np.zeros((1, sphere.WIDTH))
    S[0, sphere.POSITION3], S[0, sphere.RADIUS] = x, RADIUS
    return Context(np.zeros(1, np.int32), np.full(1, partner, np.int32), S, P, np.zeros((rows, surface_contact.WIDTH)))


@njit
def overlap(k, context):
    """The engine's functions have no wrappers for Python."""
    return first_body.overlap(k, context)


@njit
def normal(k, context):
    return first_body.normal(k, context)


@njit
def normal_before(k, move, context):
    return first_body.normal_before(k, move, context)


@njit
def to_surface(partner, x, P):
    return first_body.to_surface(partner, x, P)


@njit
def velocity(partner, P, motion):
    return first_body.velocity(partner, P, motion)


@njit
def radii(k, context):
    return first_body.effective_radius(k, context), first_body.radius_of_curvature(k, context)


@pytest.fixture
def patches():
    P = np.zeros((2, patch.WIDTH))
    P[:, patch.HEIGHT], P[:, patch.VELOCITY], P[:, patch.DISPLACEMENT2] = (9.0, 1.8), (7.0, 0.5), ((5.0, 6.0), (0.1, 0.4))
    return P


@pytest.mark.parametrize("partner", [LOWER, UPPER])
def test_the_normal_points_where_the_overlap_decreases_fastest(patches, partner):
    h, gradient = 1e-6, []
    for axis in np.eye(3):
        points = [candidate(partner, np.add(CENTRE, sign * h * axis), patches) for sign in (1.0, -1.0)]
        gradient.append((overlap(0, points[0]) - overlap(0, points[1])) / (2.0 * h))
    here = normal(0, candidate(partner, CENTRE, patches))
    # rounding of a difference of lengths of about 1 over 2e-6
    assert np.negative(gradient) == pytest.approx(here, abs=1e-9)
    assert np.linalg.norm(here) == 1.0


def test_a_sphere_between_two_plates_overlaps_with_each(patches):
    assert overlap(0, candidate(LOWER, CENTRE, patches)) == pytest.approx(0.1, rel=1e-12)
    assert overlap(0, candidate(UPPER, CENTRE, patches)) == pytest.approx(0.1, rel=1e-12)


def test_a_surface_moves_with_its_plate_and_has_the_debris_above_it(patches):
    assert to_surface(LOWER, CENTRE, patches) == CENTRE
    assert to_surface(UPPER, CENTRE, patches) == pytest.approx((0.3 - 0.1, -0.2 - 0.4, 1.8 - 0.9))


def test_only_the_upper_plate_moves(patches):
    motion = Motion(1e-9, 3.0, -4.0)
    assert velocity(LOWER, patches, motion) == (0.0, 0.0, 0.0)
    assert velocity(UPPER, patches, motion) == (3.0, -4.0, 0.5)


def test_flat_plates_leave_the_radius_of_the_sphere(patches):
    assert radii(0, candidate(LOWER, CENTRE, patches)) == (RADIUS, 0.0)


def test_rough_plates_answer_from_the_table_of_closest_points(patches):
    """On a sphere of radius 1, 1.9 away from its centre: the normal turns by half of what the distance of the centres does."""
    rough = candidate(LOWER, CENTRE, patches, rows=1)
    row, n = rough.Q[0], np.array([0.6, 0.0, 0.8])
    row[surface_contact.DISTANCE], row[surface_contact.NORMAL3], row[surface_contact.RADIUS] = 0.9, n, 0.5
    turning = (np.eye(3) - np.outer(n, n)) / 1.9
    row[surface_contact.NORMAL_GRADIENT6] = turning[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    assert overlap(0, rough) == pytest.approx(0.1) and normal(0, rough) == tuple(n)
    assert radii(0, rough) == pytest.approx((0.5, 1.0))
    move = np.array([2e-3, -1e-3, 3e-3])
    before = (1.9 * n - move) / np.linalg.norm(1.9 * n - move)
    # to first order: the square of the move over 1.9
    assert normal_before(0, tuple(move), rough) == pytest.approx(before, abs=4e-6)
    assert np.linalg.norm(normal_before(0, tuple(move), rough)) == pytest.approx(1.0, rel=1e-15)
