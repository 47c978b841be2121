"""Mass properties of unions of spheres against closed forms, counting and themselves in other frames."""

import math

import numpy as np
import pytest

import thirdbody.bodies.clump as module
from thirdbody.bodies.clump import clump, clump_with_frame, matrix_from_quaternion
from thirdbody.bodies.union_moments import quadrature
from thirdbody.errors import InputError


def random_rotation(rng):
    q = rng.normal(size=4)
    return matrix_from_quaternion(q / np.linalg.norm(q))


def lumps(rng, n):
    """A connected clump: each sphere overlaps the one before."""
    radii = rng.uniform(0.5, 1.0, n)
    centers = np.zeros((n, 3))
    for i in range(1, n):
        step = rng.normal(size=3)
        j = rng.integers(i)
        centers[i] = centers[j] + step / np.linalg.norm(step) * 0.8 * (radii[i] + radii[j])
    return centers, radii


def revolved_pair(d, r1, r2):
    """Volume, axial and transverse inertia of two spheres at 0 and d on an axis: integrals of a profile.

    The squared profile is a parabola on either side of the plane of intersection: polynomials are exact.
    """
    x = np.polynomial.Polynomial([0.0, 1.0])
    cut = (d * d + r1 * r1 - r2 * r2) / (2.0 * d)
    parts = [(r1**2 - x**2, -r1, cut), (r2**2 - (x - d) ** 2, cut, d + r2)]

    def integral(of):
        return math.pi * sum(of(p).integ()(b) - of(p).integ()(a) for p, a, b in parts)

    volume = integral(lambda p: p)
    middle = integral(lambda p: p * x) / volume
    axial = integral(lambda p: p * p / 2.0)
    return volume, axial, integral(lambda p: p * p / 4.0 + p * (x - middle) ** 2)


def test_sphere_is_exact():
    body, centroid, quaternion = clump_with_frame([[1.0, 2.0, 3.0]], [0.5])
    volume = 4.0 / 3.0 * math.pi * 0.5**3
    assert body.volume == pytest.approx(volume, rel=1e-15)  # closed form: rounding only
    assert body.inertia == pytest.approx([0.4 * volume * 0.25] * 3, rel=1e-15)
    assert body.error == 0.0
    assert centroid == pytest.approx([1.0, 2.0, 3.0], rel=1e-15)
    assert quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert body.diameter == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize("d, r1, r2", [(1.0, 1.0, 1.0), (1.2, 1.0, 0.6), (0.5, 1.0, 0.51), (1.99, 1.0, 1.0)])
@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.48, 0.6, 0.64)])
def test_two_overlapping_spheres(d, r1, r2, axis):
    body = clump([np.zeros(3), d * np.array(axis)], [r1, r2])
    volume, axial, transverse = revolved_pair(d, r1, r2)
    # lens of two spheres, e.g. Weisstein, "Sphere-Sphere Intersection", Eq. 16
    lens = math.pi * (r1 + r2 - d) ** 2 * (d * d + 2 * d * (r1 + r2) - 3 * (r1 - r2) ** 2) / (12 * d)
    assert volume == pytest.approx(4.0 / 3.0 * math.pi * (r1**3 + r2**3) - lens, rel=1e-12)
    # The stated error is that of the order before the last; the result itself is far better (1e-9).
    assert body.error < 1e-5
    assert body.volume == pytest.approx(volume, rel=min(body.error, 1e-9))
    assert body.inertia == pytest.approx([axial, transverse, transverse], rel=min(body.error, 1e-9))


def test_tangent_spheres_add_up():
    body = clump([[0, 0, 0], [0.9, 0, 1.2]], [1.0, 0.5])
    v1, v2 = 4.0 / 3.0 * math.pi, 4.0 / 3.0 * math.pi * 0.125
    axial = 0.4 * (v1 + 0.25 * v2)
    transverse = axial + v1 * v2 / (v1 + v2) * 1.5**2
    assert body.volume == pytest.approx(v1 + v2, rel=1e-12)  # smooth slices: rounding only
    assert body.inertia == pytest.approx([axial, transverse, transverse], rel=1e-12)


def test_coincident_and_swallowed_spheres_count_once():
    centers, radii = lumps(np.random.default_rng(4), 4)
    plain = clump(centers, radii)
    extra = clump(np.vstack([centers, centers[2], centers[1]]), [*radii, radii[2], 0.5 * radii[1]])
    assert extra.volume == pytest.approx(plain.volume, rel=1e-13)  # the same sum over the same slices
    assert extra.inertia == pytest.approx(plain.inertia, rel=1e-13)
    assert len(extra.radii) == 6
    nearly = clump(np.vstack([centers, centers[2] + 1e-10]), [*radii, radii[2]])
    assert nearly.volume == pytest.approx(plain.volume, rel=1e-9)  # the shift times the surface


def test_against_counting_points():
    centers, radii = lumps(np.random.default_rng(7), 6)
    body = clump(centers, radii)
    low, high = (body.centers - body.radii[:, None]).min(0), (body.centers + body.radii[:, None]).max(0)
    n = 120
    axes = [np.linspace(a, b, 2 * n + 1)[1::2] for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = np.zeros(grid.shape[:3], bool)
    for c, r in zip(body.centers, body.radii, strict=True):
        inside |= ((grid - c) ** 2).sum(axis=-1) < r * r
    points = grid[inside]
    cell = ((high - low) / n).prod()
    # About n^2 cells are cut, each counted wrong by half at random: n / n^3 of the box, 3 sigma and edges.
    tolerance = 10.0 / n**2
    assert body.volume == pytest.approx(len(points) * cell, rel=tolerance)
    assert points.mean(axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=tolerance)
    second = np.einsum("pi,pj->ij", points, points) * cell
    tensor = np.trace(second) * np.eye(3) - second
    assert tensor == pytest.approx(np.diag(body.inertia), rel=tolerance, abs=tolerance * body.inertia[0])


@pytest.mark.parametrize("seed", range(4))
def test_the_frame_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    centers, radii = lumps(rng, 5)
    body = clump(centers, radii)
    turned = clump(centers @ random_rotation(rng).T + rng.normal(size=3), radii)
    assert max(body.error, turned.error) < 1e-5
    assert turned.volume == pytest.approx(body.volume, rel=body.error + turned.error)
    assert turned.inertia == pytest.approx(body.inertia, rel=body.error + turned.error)


def test_the_error_estimate_is_honest(monkeypatch):
    rng = np.random.default_rng(11)
    for _ in range(5):
        centers, radii = lumps(rng, int(rng.integers(4, 9)))
        body = clump(centers, radii)
        with monkeypatch.context() as patch:
            patch.setattr(module, "_QUADRATURE", quadrature((40, 80)))
            best = clump(centers, radii)
        assert body.error < 1e-5
        assert abs(body.volume / best.volume - 1.0) <= body.error
        assert np.abs(body.inertia / best.inertia - 1.0).max() <= body.error


def test_the_frame_brings_the_spheres_back():
    rng = np.random.default_rng(3)
    for _ in range(5):
        centers, radii = lumps(rng, 4)
        body, centroid, quaternion = clump_with_frame(centers, radii)
        rotation = matrix_from_quaternion(quaternion)
        assert np.linalg.det(rotation) == pytest.approx(1.0, rel=1e-14)  # right-handed, to rounding
        assert centroid + body.centers @ rotation.T == pytest.approx(centers, abs=1e-14)
        assert (np.diff(body.inertia) >= 0.0).all()
        again, shift, same = clump_with_frame(body.centers, body.radii)
        # A body given in its own principal frame keeps it, to the quadrature's true error.
        assert shift == pytest.approx([0, 0, 0], abs=1e-8)
        assert same == pytest.approx([1, 0, 0, 0], abs=1e-6)


def test_size_scales_out():
    centers, radii = lumps(np.random.default_rng(5), 5)
    large, small = clump(centers, radii), clump(1e-6 * centers, 1e-6 * radii)
    # The same numbers once divided by the largest radius, but for rounding of the division.
    assert small.volume * 1e18 == pytest.approx(large.volume, rel=1e-12)
    assert small.inertia * 1e30 == pytest.approx(large.inertia, rel=1e-12)
    assert small.error == pytest.approx(large.error, rel=1e-3)
    assert large.scaled(1e-6).inertia == pytest.approx(small.inertia, rel=1e-12)
    assert small.centers * 1e6 == pytest.approx(large.centers, abs=1e-9)


def test_parts_are_refused_by_name():
    centers = [[0, 0, 0], [5, 0, 0], [1.5, 0, 0], [6.5, 0, 0]]
    with pytest.raises(InputError) as caught:
        clump(centers, [1.0, 1.0, 1.0, 1.0])
    assert [fault.key for fault in caught.value.faults] == ["spheres[1]", "spheres[3]"]
    assert "not connected" in str(caught.value)


@pytest.mark.parametrize(
    "centers, radii, key",
    [
        ([[0, 0, 0]], [0.0], "spheres[0].radius"),
        ([[0, 0, 0], [0, math.nan, 0]], [1.0, 1.0], "spheres[1].center"),
        ([[0, 0, 0]], [1.0, 1.0], ""),
        (np.zeros((0, 3)), [], ""),
    ],
)
def test_wrong_spheres_are_refused(centers, radii, key):
    with pytest.raises(InputError) as caught:
        clump(centers, radii)
    assert caught.value.faults[0].key == key


def test_many_at_once_are_each_as_one_alone():
    bodies = [lumps(np.random.default_rng(seed), 5) for seed in range(7)]
    # one with a swallowed sphere has fewer that count than the rest of its stack
    bodies[3][0][4], bodies[3][1][4] = bodies[3][0][0], 0.5 * bodies[3][1][0]
    stack = module.clumps(np.array([c for c, _ in bodies]), np.array([r for _, r in bodies]))
    for body, (centers, radii) in zip(stack, bodies, strict=True):
        alone = clump(centers, radii)
        # the same arithmetic; products of matrices may be summed in another order
        assert body.volume == pytest.approx(alone.volume, rel=1e-14)
        assert body.inertia == pytest.approx(alone.inertia, rel=1e-13)
        assert body.centers == pytest.approx(alone.centers, abs=1e-12)
        assert body.error == pytest.approx(alone.error, rel=1e-6)  # a difference of close numbers


def test_a_body_in_parts_is_reported_among_many():
    centers = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]])
    with pytest.raises(InputError, match=r"spheres\[1\]"):
        module.clumps(centers, np.ones((2, 2)))
