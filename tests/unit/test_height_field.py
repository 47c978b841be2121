"""Height fields: the spline against scipy's, closest points against fine grids, derivatives against differences."""

import math

import numpy as np
import pytest
from each import each
from numba import njit
from scipy import ndimage
from thirdbody.kernels import closest_point, height_field

# the engine's functions have no wrappers for Python
PERIOD, CELLS = (2e-5, 1.6e-5), (128, 96)
CENTRE, RADIUS = (5e-6, 6e-6, 1.2e-6), 1e-6


@njit
def jet_at(field, x, y):
    return height_field.jet_at(field, x, y)


@njit
def foot_of(field, centre, x, y):
    foot = closest_point.closest(field, centre, x, y)
    bent = closest_point.bent_jet(field, centre, foot)
    ratio, r_eff = closest_point.ratio_derivatives(bent, RADIUS)[0], closest_point.effective_radius(bent, RADIUS)
    gradient = closest_point.log_radius_gradient(foot, bent, RADIUS)
    return foot, r_eff, RADIUS / math.sqrt(ratio), gradient, closest_point.normal_derivative(foot)


@njit
def minima_of(field, centre, reach, found):
    return closest_point.find_minima(field, centre, reach, found)


def self_affine(seed: int) -> np.ndarray:
    """Heights (128, 96) [m] with a spectrum ~ q^-3.6 from the period to 1 um, 0.3 um high."""
    rng = np.random.default_rng(seed)
    q_x, q_y = (2.0 * math.pi * np.fft.fftfreq(n, length / n) for n, length in zip(CELLS, PERIOD, strict=True))
    q = np.hypot(q_x[:, None], q_y)
    amplitude = np.where((q > 0.0) & (q < 2.0 * math.pi / 1e-6), np.where(q > 0.0, q, 1.0) ** -1.8, 0.0)
    heights = np.fft.ifft2(amplitude * rng.standard_normal(CELLS) * np.exp(2j * math.pi * rng.random(CELLS))).real
    return heights * (0.3e-6 / heights.std())


@pytest.fixture(scope="module")
def coefficients():
    return ndimage.spline_filter(self_affine(1), 3, mode="grid-wrap")


@pytest.fixture(scope="module")
def field(coefficients):
    return height_field.pack_field(coefficients, *PERIOD)


def heights_of(coefficients, x, y):
    u = np.meshgrid(x / PERIOD[0] * CELLS[0], y / PERIOD[1] * CELLS[1], indexing="ij")
    return ndimage.map_coordinates(coefficients, u, order=3, mode="grid-wrap", prefilter=False)


def difference(f, h):
    return np.array([(np.array(f(h * e)) - np.array(f(-h * e))) / (2.0 * h) for e in np.eye(3)])


def test_heights_are_those_of_scipy_in_every_period(field, coefficients):
    x, y = np.random.default_rng(2).uniform(-2.0, 3.0, (2, 20)) * np.array(PERIOD)[:, None]
    expected = heights_of(coefficients, x, y)
    heights = [[jet_at(field, a, b).h for b in y] for a in x]
    # rounding of a coordinate of up to 400 cells
    assert np.abs(heights - expected).max() < 1e-12 * np.abs(expected).max()


DERIVATIVES = {"h": ("x", "y"), "x": ("xx", "xy"), "y": ("xy", "yy")}
DERIVATIVES |= {"xx": ("xxx", "xxy"), "xy": ("xxy", "xyy"), "yy": ("xyy", "yyy")}


@each(DERIVATIVES)
def test_derivatives_are_limits_of_differences(name):
    field = height_field.pack_field(ndimage.spline_filter(self_affine(1), 3, mode="grid-wrap"), *PERIOD)
    x, y = 3.31e-6, 7.77e-6
    jet = jet_at(field, x, y)
    slopes = difference(lambda d: getattr(jet_at(field, x + d[0], y + d[1]), name), 1e-10)[:2]
    # 1e-10 m is a thousandth of a cell: 1e-6 of the next derivative but one; rounding 1e-16/1e-3
    assert slopes == pytest.approx([getattr(jet, along) for along in DERIVATIVES[name]], rel=1e-4)


def test_the_closest_point_is_straight_below_along_the_normal_and_found_in_two_evaluations(field):
    foot, *_ = foot_of(field, CENTRE, 0.0, 0.0)
    to_centre = np.array((-foot.x, -foot.y, CENTRE[2] - jet_at(field, CENTRE[0] + foot.x, CENTRE[1] + foot.y).h))
    # Newton's method converges to rounding: 1e-16 of the period is 2e-21 m
    assert to_centre == pytest.approx(foot.distance * np.array(foot.normal), abs=1e-19)
    assert np.linalg.norm(foot.normal) == pytest.approx(1.0, rel=1e-15)
    # from the foot of the step before, as a run does
    assert foot_of(field, (CENTRE[0] + 1e-10, *CENTRE[1:]), foot.x, foot.y)[0].evaluations <= 3


def test_geometry_moves_with_the_centre_as_its_derivatives_predict(field):
    at = foot_of(field, CENTRE, 0.0, 0.0)[0]

    def moved(d):
        return foot_of(field, tuple(np.add(CENTRE, d)), at.x, at.y)

    _, r_eff, _, gradient, turning = moved(np.zeros(3))
    xx, xy, xz, yy, yz, zz = turning
    # truncation (1e-10/1e-6)^2 and rounding 1e-16/1e-4, times what the third derivatives amplify
    assert difference(lambda d: moved(d)[0].distance, 1e-10) == pytest.approx(at.normal, abs=1e-7)
    expected = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    assert difference(lambda d: moved(d)[0].normal, 1e-10) == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
    found = difference(lambda d: math.log(moved(d)[1]), 1e-10)
    assert found == pytest.approx(gradient, abs=1e-6 * np.abs(gradient).max())
    assert abs(np.dot(gradient, at.normal)) < 1e-12 * np.linalg.norm(gradient)
    assert r_eff == moved(np.zeros(3))[2]


def test_radius_and_gradient_go_smoothly_across_a_border_between_cells(field):
    """The integral of the gradient over both ramps is the change of the radius, to the part along y that is left out."""
    cell, start = PERIOD[0] / CELLS[0], foot_of(field, CENTRE, 0.0, 0.0)[0]
    border = math.floor((CENTRE[0] + start.x) / cell) * cell

    def at(u):  # with the closest point u cells beyond a border
        x = CENTRE[0]
        for _ in range(20):
            foot, r_eff, _, gradient, _ = foot_of(field, (x, *CENTRE[1:]), start.x, start.y)
            x += border + u * cell - (x + foot.x)
        return x, math.log(r_eff), gradient[0]

    ramp = height_field.RAMP
    x, log_radius, gradient = np.array([at(v) for v in 1.1 * ramp * np.linspace(-1.0, 1.0, 200)]).T
    jump, largest = abs(gradient[-1] - gradient[0]), np.abs(gradient).max()
    assert jump > 1e-3 * largest
    # a step is a hundredth of the ramp
    assert np.abs(np.diff(gradient)).max() < 0.02 * jump
    # the rule of trapezoids: kinks of the ramps within a hundredth
    assert np.trapezoid(gradient, x) == pytest.approx(log_radius[-1] - log_radius[0], abs=1e-4 * ramp * cell * largest)


def test_curvature_of_crests_and_valleys_a_plane_of_zeros_and_a_shift_by_a_period():
    length, depth, cells = 8e-6, 0.1e-6, 64
    x = np.arange(cells) * length / cells
    wave = np.repeat(depth * np.cos(2.0 * math.pi * x / length)[:, None], 4, 1)
    field = height_field.pack_field(ndimage.spline_filter(wave, 3, mode="grid-wrap"), length, length)
    k = depth * (2.0 * math.pi / length) ** 2
    for place, sign in ((0.0, 1.0), (0.5 * length, -1.0)):
        foot, r_eff, *_ = foot_of(field, (place, 1e-6, 1e-6), 1e-7, 2e-7)
        assert (foot.x, foot.y) == pytest.approx((0.0, 0.0), abs=1e-18)
        assert foot.distance == pytest.approx(1e-6 - sign * depth, rel=1e-8)  # spline of a wave with 64 nodes
        assert r_eff == pytest.approx(RADIUS / math.sqrt(1.0 + sign * k * RADIUS), rel=1e-4)  # (2 pi/64)^2/12
    field = height_field.pack_field(np.zeros((5, 7)), 3e-6, 4e-6)
    for x, y, z in np.random.default_rng(4).uniform(-1e-5, 1e-5, (20, 3)):
        foot, r_eff, _, gradient, turning = foot_of(field, (x, y, z), 1.3e-6, -1.9e-6)
        assert (foot.x, foot.y, foot.distance, *foot.normal, r_eff) == (0.0, 0.0, z, 0.0, 0.0, 1.0, RADIUS)
        assert not any(gradient) and not any(turning) and not np.signbit(foot.normal).any()
    period = 2.0**-16
    field = height_field.pack_field(ndimage.spline_filter(self_affine(3), 3, mode="grid-wrap"), period, period)
    centre = np.array((3.0, 5.0, 0.0)) * 2.0**-18 + (0.0, 0.0, 1.2e-6)
    far = tuple(centre + (4.0 * period, -8.0 * period, 0.0))
    assert foot_of(field, tuple(centre), 1e-7, 0.0) == foot_of(field, far, 1e-7, 0.0)
    found = np.zeros((2, 8, 3))
    assert minima_of(field, tuple(centre), 1.5e-6, found[0]) == minima_of(field, tuple(centre - (period, 0, 0)), 1.5e-6, found[1])
    assert found[0].any() and np.array_equal(found[0], found[1])


def lowered(field, x, y, radius, found):
    low, high = -1e-6, radius + 2e-6
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if minima_of(field, (x, y, middle), radius, found) else (low, middle)
    return high


def grid_minima(coefficients, centre, reach, fine):
    """Offsets (n, 2) of the local minima on a grid `fine` times as dense as the nodes, and their distances."""
    n = int(2.0 * reach / (PERIOD[0] / CELLS[0] / fine)) + 3
    offset = np.linspace(-1.02 * reach, 1.02 * reach, n)
    heights = heights_of(coefficients, centre[0] + offset, centre[1] + offset)
    distance = np.sqrt(offset[:, None] ** 2 + offset**2 + (heights - centre[2]) ** 2)
    lowest = (distance == ndimage.minimum_filter(distance, 3)) & (distance < reach)
    lowest[[0, -1]], lowest[:, [0, -1]] = False, False
    return offset[np.argwhere(lowest)]


def test_no_minimum_is_missed_and_of_more_than_rows_the_nearest_are_kept(field, coefficients):
    """Of spheres at random, some with two or more."""
    rng, found, misses, several = np.random.default_rng(5), np.zeros((64, 3)), 0, 0
    cell = PERIOD[0] / CELLS[0]
    for _ in range(60):
        radius, (x, y) = rng.choice([0.3e-6, 1e-6, 2e-6, 3e-6]), rng.random(2) * PERIOD
        centre, reach = (x, y, lowered(field, x, y, radius, found)), 1.1 * radius
        n = minima_of(field, centre, reach, found)
        several += n > 1
        assert n <= 64 and (np.diff(found[:n, 2]) >= 0.0).all()
        for o in grid_minima(coefficients, centre, 0.999 * reach, 8):
            if n == 0 or np.hypot(*(found[:n, :2] - o).T).min() > 0.3 * cell:
                # a false minimum between the nodes of the grid leads to a true one
                foot = foot_of(field, centre, *o)[0]
                misses += foot.distance < reach and (n == 0 or np.hypot(*(found[:n, :2] - foot[:2]).T).min() > 1e-3 * cell)
    assert misses == 0 and several > 3
    x = np.arange(64) * 2.0 * math.pi / 64
    wave = 0.2e-6 * np.cos(8.0 * x)[:, None] * np.cos(8.0 * x)
    field = height_field.pack_field(ndimage.spline_filter(wave, 3, mode="grid-wrap"), 8e-6, 8e-6)
    every, few = np.zeros((64, 3)), np.zeros((3, 3))
    assert 8 < minima_of(field, (4.1e-6, 4.2e-6, 3.3e-6), 3.4e-6, every) <= 64
    assert minima_of(field, (4.1e-6, 4.2e-6, 3.3e-6), 3.4e-6, few) == 4
    assert np.array_equal(few, every[:3])
