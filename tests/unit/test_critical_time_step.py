"""The bound of the time step against matrices and eigenvalues by numpy; the damping number alpha(e)."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from thirdbody.engine.explicit import DAMPING_FRACTION, _contact_bounds, bound
from thirdbody.engine.state import STABILITY_FRACTION
from thirdbody.jit.arguments import address
from thirdbody.kernels.arguments import LAW
from thirdbody.kernels.neighbour_search import incidences
from thirdbody.kernels.plates import BASINS
from thirdbody.kernels.tables import body, body_extra, domain, patch, run_totals, sphere, surface_contact
from thirdbody.kernels.tile import TILE, law_input
from thirdbody.laws import damping as law
from thirdbody.laws.contract import Material, Pair
from thirdbody.laws.damping import damping_number, restitution_of
from thirdbody.laws.data import Contact, Load, Normal
from thirdbody.laws.generated import plain
from thirdbody.rotations import matrix_from_quaternion

NEAR = 0.3  # spheres are candidates when they are not farther apart


@njit
def answers(overlap, radius, mass, kind, P):
    """k_n, k_t, k_r, c_n, c_t, c_r, k_w, c_w of a law of no physics: all different functions, some zero."""
    k_n, share, roll, damping = P[4 * kind], P[4 * kind + 1], P[4 * kind + 2], P[4 * kind + 3]
    k_n *= math.sqrt(overlap * radius)
    c_n = damping * math.sqrt(mass * k_n)
    return (k_n, share * k_n, roll * k_n * radius**2, c_n, share**2 * c_n, roll * c_n * radius**2, 0.7 * roll * k_n * radius,
            0.3 * c_n * radius)  # fmt: skip


@njit(LAW)
def stiffness(I, O, n, P):  # noqa: E741
    for q in range(n):
        kind = int(I[q + law_input.PAIR_TYPE * TILE])
        report = answers(I[q + law_input.OVERLAP * TILE], I[q + law_input.RADIUS * TILE], I[q + law_input.MASS * TILE], kind, P)
        for f in range(8):
            O[q + f * TILE] = report[f]


# four kinds of contact: without and with dashpots, without tangential spring, stiffer along than across, rolling
PAIRS = np.array([1.0, 0.8, 0.0, 0.0, 2.0, 0.0, 0.0, 0.5, 0.5, 1.1, 0.3, 1.5, 1.0, 0.7, 0.2, 0.0])
FLAT = np.zeros((0, surface_contact.WIDTH))  # no rough plates


def heap(seed: int, bodies: int, most: int, size: float = 2.0, foundation: bool = False, free: float = 1.0):
    """A state of bodies of up to `most` spheres thrown into a periodic box over a plate and under another; nothing moves."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(1, most + 1, bodies)
    start = np.concatenate(([0], np.cumsum(counts)))
    body_of = np.repeat(np.arange(bodies), counts)
    radii = rng.uniform(0.2, 0.4, len(body_of))
    shapes = (bodies, body.WIDTH), (bodies, body_extra.EFFECT_FORCE), (len(body_of), sphere.WIDTH)
    B, E, S = (np.zeros(shape) for shape in shapes)
    B[:, body.POSITION3] = rng.uniform(0.0, size, (bodies, 3))
    B[:, body.MASS] = np.exp(rng.normal(0.0, 0.5, bodies))
    E[:, body_extra.INERTIA3] = (B[:, body.MASS] * rng.uniform(0.02, 0.08, bodies))[:, None]
    clump = counts > 1
    E[clump, body_extra.INERTIA3] *= rng.uniform(0.7, 1.3, (clump.sum(), 3))
    q = rng.normal(size=(bodies, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    arms = rng.normal(0.0, 0.2, (len(body_of), 3)) * clump[body_of][:, None]
    S[:, :3], S[:, sphere.RADIUS] = B[body_of, :3] + arms, radii
    S[:, sphere.ARM3], S[:, sphere.ARM + 3], S[:, sphere.MASS] = arms, 7.0, B[body_of, body.MASS]
    patch_of = np.arange(bodies) if foundation else np.zeros(bodies, int)
    P = np.zeros((bodies + 1 if foundation else 1, patch.WIDTH))
    P[:, patch.HEIGHT], P[:, patch.MASS], P[:, patch.FREE] = size, rng.uniform(0.5, 2.0, len(P)), free
    P[:-1, patch.SPRING] = rng.uniform(0.0, 20.0, len(P) - 1)
    D = np.zeros(domain.WIDTH)
    D[domain.LENGTH_X] = D[domain.LENGTH_Y] = size
    state = SimpleNamespace(
        n_bodies=bodies, body=body_of, start=start, B=B, E=E, orientations=q, S=S, P=P, D=D, patch=patch_of, dt=0.0,
        time=0.0, A=np.zeros(run_totals.WIDTH),
        order=rng.permutation(bodies), material=np.zeros(bodies, int), rayleigh_radius=np.full(bodies, 1e6),
        physics=SimpleNamespace(stiffness=stiffness, stiffness_at=address(stiffness, LAW), pairs=PAIRS),
        world=SimpleNamespace(upper=None), drive=np.zeros(0), sprung=False,
    )  # fmt: skip
    find(state, rng)
    return state


def find(state, rng) -> None:
    S, body = state.S, state.body
    flat = [(i, -1) for i in range(len(S)) if S[i, 2] - S[i, 3] < NEAR]
    top = state.P[0, patch.HEIGHT] - NEAR
    flat += [(i, -1 - (1 + state.patch[body[i]]) * BASINS) for i in range(len(S)) if S[i, 2] + S[i, 3] > top]
    pairs = [(i, j) for i in range(len(S)) for j in range(i + 1, len(S)) if body[i] != body[j] and gap(state, i, j)[0] < NEAR]
    own, partner = np.array(sorted(flat) + pairs, np.int32).reshape(-1, 2).T.copy()
    spheres, incidence = incidences(len(own), own, partner, len(S))
    state.slots = SimpleNamespace(
        own=own, partner=partner, kind=rng.integers(0, 4, len(own)).astype(np.int32), edges=spheres[state.start],
        incidence=incidence, n_plates=len(flat), count=len(own), Q=FLAT, max_per_body=len(incidence),
    )  # fmt: skip


def patch_of(j: int) -> int:
    return max((-1 - j) // BASINS - 1, 0)


def gap(state, i: int, j: int) -> tuple[float, np.ndarray]:
    """How far sphere i is from sphere j or from a plate, and the normal from there."""
    S = state.S
    if j < 0:
        top = state.P[patch_of(j), patch.HEIGHT]
        return (S[i, 2] if j == -1 else top - S[i, 2]) - S[i, 3], np.array([0.0, 0.0, 1.0 if j == -1 else -1.0])
    apart = S[i, :3] - S[j, :3]
    apart[:2] -= state.D[:2] * np.round(apart[:2] / state.D[:2])
    distance = np.linalg.norm(apart)
    return distance - S[i, 3] - S[j, 3], apart / distance


def everything(state) -> tuple[np.ndarray, np.ndarray]:
    """K and C of all bodies, and of all patches, by definition: sums of J^T k J."""
    sums, patches = np.zeros((state.n_bodies, 2, 6, 6)), np.zeros((len(state.P), 2))
    for i, j, kind in zip(state.slots.own, state.slots.partner, state.slots.kind, strict=True):
        distance, n = gap(state, i, j)
        if distance >= 0.0:
            continue
        radius, mass, twice = state.S[i, sphere.RADIUS], state.S[i, sphere.MASS], 1.0
        if j >= 0:
            other, heavy = state.S[j, sphere.RADIUS], state.S[j, sphere.MASS]
            radius, mass, twice = radius * other / (radius + other), mass * heavy / (mass + heavy), 2.0
        report = answers.py_func(-distance, radius, mass, kind, PAIRS)
        if j < -1 and state.P[patch_of(j), patch.FREE]:
            patches[patch_of(j)] += 2.0 * np.array(report)[[0, 3]] / state.P[patch_of(j), patch.MASS]
            twice = 2.0
        along = np.outer(n, n)
        for number, reach in ((i, -state.S[i, sphere.RADIUS]), *([(j, state.S[j, sphere.RADIUS])] if j >= 0 else [])):
            J = np.hstack((np.eye(3), np.cross(state.S[number, sphere.ARM3] + reach * n, np.eye(3))))
            for w, (normal, across, roll, spin) in enumerate(((*report[:3], report[6]), (*report[3:6], report[7]))):
                sums[state.body[number], w] += twice * J.T @ (across * np.eye(3) + (normal - across) * along) @ J
                sums[state.body[number], w, 3:, 3:] += twice * (roll * (np.eye(3) - along) + spin * along)
    spring = 2.0 * state.P[:-1, patch.SPRING]
    patches[:-1, 0] += spring / state.P[:-1, patch.MASS]
    patches[-1, 0] += spring.sum() / state.P[-1, patch.MASS] * state.P[-1, patch.FREE]
    return sums, patches


def root(values: np.ndarray) -> float:
    largest = max(values.max(), 1e-300)
    return float(largest * np.sum((values.clip(0.0) / largest) ** 16) ** (1.0 / 16.0))


def full(state) -> list[tuple[float, str, int, float]]:
    """Step, mechanism, body and longest stable step of every body and patch, the one that limits first."""
    sums, patches = everything(state)
    turns = matrix_from_quaternion(state.orientations)
    rows = []
    for b in range(state.n_bodies):
        mass = np.diag([state.B[b, body.MASS]] * 6)
        mass[3:, 3:] = turns[b] @ np.diag(state.E[b, body_extra.INERTIA3]) @ turns[b].T
        square, rate = (root(eigh(matrix, mass, eigvals_only=True)) for matrix in sums[b])
        shares = np.diag(np.linalg.solve(mass, sums[b, 0]))
        mechanism = "rotation" if shares[3:].sum() > shares[:3].sum() else "translation"
        rows.append(steps(square, rate, mechanism, state.order[b]))
    for p, (square, rate) in enumerate(patches):
        step, _, *rest = steps(square, rate, "patch", state.order[np.argmax(state.patch == p)])
        rows.append((step, "patch", *rest))
    return sorted(rows)


def steps(square: float, rate: float, mechanism: str, body: int) -> tuple[float, str, int, float]:
    with np.errstate(divide="ignore"):
        alone, both = np.float64(2.0) / math.sqrt(square), np.float64(2.0) / (rate + math.sqrt(rate**2 + square))
    damped = DAMPING_FRACTION * both < STABILITY_FRACTION * alone
    return min(STABILITY_FRACTION * alone, DAMPING_FRACTION * both), "damping" if damped else mechanism, int(body), both


# never limits the step by its Rayleigh time
SOFT = SimpleNamespace(poisson_ratio=0.3, density=1e12, shear_modulus=1.0)


@pytest.mark.parametrize("seeds", [range(30), pytest.param(range(30, 300), marks=pytest.mark.full(kind="slow"))])
def test_few_bodies_report_the_bound_of_all(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        most, size, free = rng.choice([1, 1, 4]), rng.choice([1.2, 2.0, 4.0]), rng.choice([0.0, 1.0])
        state = heap(seed, int(rng.integers(1, 26)), int(most), float(size), bool(rng.integers(2)), float(free))
        rows = full(state)
        if math.isfinite(rows[0][0]) and len(rows) > 1 and rows[1][0] <= rows[0][0] * (1.0 + 1e-9):
            continue  # two that limit alike: rounding decides which
        found = bound(state, [SOFT], 0, 0.3)
        # rounding of a generalised eigenvalue with moments of inertia some fifty times smaller than the masses
        assert found.stability == pytest.approx(min(row[3] for row in rows), rel=1e-10), seed
        if math.isinf(rows[0][0]):
            assert (found.mechanism, found.step) == ("rayleigh", 0.2 * found.rayleigh), seed
        else:
            assert found.step == pytest.approx(rows[0][0], rel=1e-10), seed
            assert (found.mechanism, found.body) == rows[0][1:3], seed


def test_nothing_touches_and_what_is_no_number():
    state = heap(0, 1, 1, size=100.0)
    state.B[:, 2] = state.S[:, 2] = 50.0
    found = bound(state, [SOFT], 0, 0.3)
    assert (found.mechanism, found.stability) == ("rayleigh", math.inf)
    state = heap(3, 20, 1)
    state.B[state.body[state.slots.own[0]], body.MASS] = math.nan
    assert math.isnan(bound(state, [SOFT], 0, 0.3).stability)


def test_a_contact_to_come_counts_as_deep_as_it_gets():
    """A ball that falls onto the plate is bounded as if it were there already, but no deeper than is foreseen."""
    state, horizon, speed = heap(0, 1, 1, size=100.0), 1e-3, 50.0
    height = state.S[0, sphere.RADIUS] + 0.02
    state.S[0, 2], state.S[0, sphere.MID_VELOCITY + 2] = height, -speed
    find(state, np.random.default_rng(0))
    state.slots.kind[:] = 1
    ahead = [_contact_bounds(state, horizon, deepest)[1][0] for deepest in (0.3, 0.01)]
    state.S[0, sphere.MID_VELOCITY + 2] = 0.0
    for found, overlap in zip(ahead, (speed * horizon - 0.02, 0.01 * state.S[0, sphere.RADIUS]), strict=True):
        state.S[0, 2] = state.S[0, sphere.RADIUS] - overlap
        assert found == pytest.approx(_contact_bounds(state, 0.0, 0.0)[1][0], rel=1e-12)  # overlaps as differences


STEEL = Material("steel", 80e9, 0.3, 7850.0)

# clipped contact, seven decimals (root of an impact integrated with 15 digits)
TABLE = {0.98: 0.0144386, 0.9: 0.0766193, 0.8: 0.1662631, 0.7: 0.2732805, 0.5: 0.5708137, 0.3: 1.1118611, 0.1: 2.7798526}


def integrated_restitution(alpha: float) -> float:
    """Impact x'' = -x^1.5 - alpha x^0.25 x' at speed 1, released where the contact would begin to pull."""

    def rates(_t, y):
        x = max(y[0], 0.0)
        return [y[1], -(x**1.5) - alpha * x**0.25 * y[1]]

    def pull(_t, y):
        return max(y[0], 0.0) ** 1.25 + alpha * y[1]  # force over x^0.25, which is regular at x = 0

    pull.terminal, pull.direction = True, -1.0
    # one step of free flight, from which on x^0.25 has a derivative
    impact = solve_ivp(rates, (0.0, 1e4), [1e-12, 1.0], "DOP853", events=pull, rtol=1e-11, atol=1e-16)
    assert impact.status == 1, "the contact never opened"
    return -float(impact.y_events[0][0][1])


def test_damping_numbers_published_and_integrated_and_their_smooth_inverse():
    # half of the last decimal of the table
    assert {e: damping_number(e) for e in TABLE} == pytest.approx(TABLE, abs=0.6e-7)
    for e in (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.99):
        # the integrator's tolerance is 1e-11 a step; the root at x -> 0 costs it some digits
        assert integrated_restitution(damping_number(e)) == pytest.approx(e, rel=1e-7, abs=0.0)
    for restitution in (1e-3, 0.02, math.exp(-2.0), 0.4, 0.999, 1.0 - 1e-9):
        # the bisection ends within two roundings of alpha, and e changes by less than alpha does
        assert restitution_of(damping_number(restitution)) == pytest.approx(restitution, rel=1e-12, abs=0.0)
    # 0 is the lower end of the bracket: the elastic limit costs no damping at all
    assert damping_number(1.0) < 1e-14
    critical = 2.5 * math.sqrt(0.8)
    values = [restitution_of(critical * (1.0 + shift)) for shift in (-1e-6, 0.0, 1e-6)]
    assert values[0] > values[1] > values[2]
    # steps of a millionth: a smooth curve bends by 1e-6 of its slope; the differences keep nine digits
    assert values[0] - values[1] == pytest.approx(values[1] - values[2], rel=1e-5, abs=0.0)
    # the formula for a contact that may pull gives e = .5503 instead of .5 when clipped (four decimals)
    alpha = -math.sqrt(5.0) * math.log(0.5) / math.hypot(math.log(0.5), math.pi)
    assert restitution_of(alpha) == pytest.approx(0.5503, abs=0.6e-4)


def test_force_of_the_dashpots():
    pair = Pair(STEEL, STEEL, 0.3, 0.5)
    radius, mass, overlap, v_n = 5e-6, 3e-12, 2e-9, -0.4
    e, g = 80e9 / 0.7, 2.0 * 80e9 / 1.7  # E* = G/(1 - nu), G* = 2 G/(2 - nu) of like materials
    a = math.sqrt(radius * overlap)
    c = Contact(overlap, radius, mass, v_n, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0)
    force = plain(law.HERTZ_DAMPING.kernel)(c, Normal(1.0, a, 0.0, 0.0, 0.0, 0.0), law.mix_damping(pair, {}))
    # the definition: alpha sqrt(m K) x^(1/4) v with K = 4/3 E* sqrt(R), against the approach
    expected = TABLE[0.5] * math.sqrt(mass * 4.0 / 3.0 * e * math.sqrt(radius)) * overlap**0.25 * 0.4
    assert force == pytest.approx(expected, rel=1e-6, abs=0.0)  # seven decimals of the table
    viscosity = plain(law.TANGENTIAL_DAMPING.kernel)(c, Load(1.0, 1.0, a, 0.0, 0.0), law.mix_tangential_damping(pair, {}))
    # the normal dashpot is alpha sqrt(2/3 m k_n) with k_n = 2 E* a; here with k_t = 2 G* a
    assert viscosity == pytest.approx(TABLE[0.5] * math.sqrt(2.0 / 3.0 * mass * 2.0 * g * a), rel=1e-6, abs=0.0)
    elastic, lossy = Pair(STEEL, STEEL, 0.3, 1.0), Pair(STEEL, STEEL, 0.3, 0.9)
    assert not law.loses_energy([elastic]) and law.loses_energy([elastic, lossy])
    assert law.mix_damping(lossy, {}) > law.DampingParameters(0.0)
