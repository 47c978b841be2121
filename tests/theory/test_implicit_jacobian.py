"""Jacobian of an implicit step against central differences of the residual, between flat and rough plates and between bodies.

The law is smooth: what is checked is geometry, and the tangents of the real laws are checked by the conformance suite."""

import math

import numpy as np
import pytest
from numba import types
from scipy.ndimage import spline_filter
from theory.plain import plain
from thirdbody.kernels.arguments import Motion
from thirdbody.kernels.height_field import pack_field
from thirdbody.kernels.implicit import workspace
from thirdbody.kernels.implicit.jacobian import assemble
from thirdbody.kernels.implicit.newton import evaluate as evaluate_island
from thirdbody.kernels.implicit.pairs import pairs_part
from thirdbody.kernels.implicit.rough import rough_part, update_minima
from thirdbody.kernels.implicit.spots_part import spots_part
from thirdbody.kernels.minima import RoughPlates
from thirdbody.kernels.plates import BASINS
from thirdbody.kernels.rolling_kinematics import MOMENTS, TWIST
from thirdbody.kernels.step_tables import step_memory, step_settings, step_start
from thirdbody.kernels.tables import body, body_extra, contact_state, domain, patch, run_totals, sphere, surface_contact
from thirdbody.kernels.tile import TILE, contact_tangent, law_input, law_output
from thirdbody.kernels.tile import rolling_input as turn_in
from thirdbody.kernels.tile import rolling_output as turn_out
from thirdbody.rotations import matrix_from_quaternion

FREEDOMS, FLAT = workspace.FREEDOMS, np.zeros((0, surface_contact.WIDTH))
HISTORY = 5  # force, moment and moment about the normal of a contact at the start of the step
STIFF, SHEAR, ROLL, TORSION = 1.3, 0.9, 0.2, 0.7


def law(I, O, n, _):  # noqa: E741
    """A smooth law: N = STIFF R^.5 d^1.5, U = 0.4 N d, T = T_0 - SHEAR (R^.5 d^1.5)^(1/3) slip, M = M_0 - ROLL d turn; slip and
    turn with a tenth across. About the normal M = M_0 - TORSION d^1.5 twist."""
    for q in range(n):
        d, x, y = I[law_input.OVERLAP * TILE + q], I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q]
        root = math.sqrt(I[law_input.RADIUS * TILE + q])
        O[law_output.NORMAL_FORCE * TILE + q] = STIFF * root * d**1.5
        O[law_output.STORED_NORMAL * TILE + q] = 0.4 * STIFF * root * d**2.5
        old, k_t = law_input.HISTORY * TILE + q, SHEAR * (root * d**1.5) ** (1.0 / 3.0)
        O[law_output.TANGENTIAL_X * TILE + q] = I[old] - k_t * (x + 0.1 * y)
        O[law_output.TANGENTIAL_Y * TILE + q] = I[old + TILE] - k_t * (y - 0.1 * x)
        turn, to = (law_input.HISTORY + HISTORY) * TILE + q, (law_output.HISTORY + HISTORY) * TILE + q
        a, b = I[turn + turn_in.ROTATION_X * TILE], I[turn + turn_in.ROTATION_Y * TILE]
        O[to + turn_out.MOMENT_X * TILE] = I[old + 2 * TILE] - ROLL * d * (a + 0.1 * b)
        O[to + turn_out.MOMENT_Y * TILE] = I[old + 3 * TILE] - ROLL * d * (b - 0.1 * a)
        O[to + turn_out.TWIST_MOMENT * TILE] = I[old + 4 * TILE] - TORSION * d**1.5 * I[turn + turn_in.TWIST * TILE]


def tangents(I, K, n, _):  # noqa: E741
    for q in range(n):
        d, x, y = I[law_input.OVERLAP * TILE + q], I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q]
        root = math.sqrt(I[law_input.RADIUS * TILE + q])
        k_t = SHEAR * (root * d**1.5) ** (1.0 / 3.0)
        bend = 0.5 * k_t / d
        turn = (law_input.HISTORY + HISTORY) * TILE + q
        a, b = I[turn + turn_in.ROTATION_X * TILE], I[turn + turn_in.ROTATION_Y * TILE]
        values = (
            1.5 * STIFF * root * math.sqrt(d), -k_t, -0.1 * k_t, 0.1 * k_t, -k_t, -bend * (x + 0.1 * y), -bend * (y - 0.1 * x),
            -ROLL * d, -0.1 * ROLL * d, 0.1 * ROLL * d, -ROLL * d, -ROLL * (a + 0.1 * b), -ROLL * (b - 0.1 * a),
            -TORSION * d**1.5, -1.5 * TORSION * math.sqrt(d) * I[turn + turn_in.TWIST * TILE],
        )  # fmt: skip
        for k in range(contact_tangent.ROLLING_WIDTH):
            K[k * TILE + q] = values[k]


def evaluate(context, tables, y, r, J):
    n, made = len(tables.bodies), {}
    half_width = FREEDOMS * (int(tables.widths[0]) + 1) - 1
    scratch = workspace.make_scratch(context, n, 1, FREEDOMS * n * (3 * half_width + 1), len(context.start_depths))
    given = scratch._asdict()
    scratch = scratch._replace(**dict(zip(("spaces", "pair_spaces"), workspace.spaces_of(given), strict=True)))
    island, motion = plain(workspace.island_at, made)(0, tables), Motion(DT, 0.0, 0.0)
    scratch.starts[:] = context.starts
    scratch.coordinates[:, 0] = y.reshape(n, FREEDOMS)
    m = plain(evaluate_island, made)(0.0, motion, context, island, scratch)
    plain(assemble, made)(m, False, motion, context, island, scratch)
    r[:] = scratch.coordinates[:, 2].ravel()
    for i, row in enumerate(J):
        for k in range(len(row)):
            row[k] = scratch.jacobian[0, FREEDOMS * i + k] if n == 1 else scratch.band[i * 3 * half_width + k + half_width]
    return int(scratch.counts.sum()) + m


ONE = {
    "bodies": np.zeros(1, np.int64), "body_edges": np.array([0, 1]), "position": np.zeros(1, np.int64),
    "widths": np.zeros(1, np.int64), "pairs": np.zeros(0, np.int64), "pair_edges": np.zeros(2, np.int64),
}  # fmt: skip


OFFSETS = np.array([[1.0, 0.2, -0.5], [-0.7, 0.9, -0.4], [-0.5, -0.8, -0.6], [0.3, 0.1, 0.9]])
RADIUS, OVERLAP, DT = 1.0, 0.05, 10.0


def filled(table, kinds, given):
    """A table of arguments, with arrays of one zero where nothing is given."""
    empty = {
        name: np.zeros((1,) * kind.ndim, np.dtype(str(kind.dtype))) if isinstance(kind, types.Array) else 0
        for name, kind in kinds.items()
    }
    return table(**(empty | given))


def unit(*v):
    return np.array(v) / np.linalg.norm(v)


LAW = {
    "n_history": HISTORY, "field_begin": HISTORY, "interaction": np.zeros(0), "rolling": MOMENTS + TWIST, "force": 0, "moment": 2,
    "twist": 4, "stored": -1, "law": law, "tangents": tangents, "D": np.zeros(domain.WIDTH),
    "settings": np.zeros(step_settings.WIDTH),
}  # fmt: skip
LAW["settings"][step_settings.INERTIAL] = 1.0


def tables(n_plates):
    """The tables of a step of a body with `n_plates` candidates; its spheres are in place at the coordinates 0 only."""
    n = len(OFFSETS)
    S, B, E = np.zeros((n, sphere.WIDTH)), np.zeros((1, body.WIDTH)), np.zeros((1, body_extra.WIDTH_WITHOUT_EFFECTS))
    S[:, sphere.RADIUS], S[:, sphere.MASS], B[0, body.MASS] = RADIUS, 0.7, 0.7
    E[0, body_extra.INERTIA3] = 0.3, 0.4, 0.5
    P, Z = np.zeros((1, patch.WIDTH)), np.zeros((1, step_start.WIDTH))
    P[0, patch.FREE], P[0, patch.MASS], P[0, patch.LOAD] = 1.0, 0.2, 0.01
    Z[0, step_start.QUATERNION], Z[0, step_start.ARM], Z[0, step_start.MASS_FRACTION] = 1.0, 2.3, 1.0
    Z[0, step_start.NOW], Z[0, step_start.LAST] = 1.5, 0.5
    memory = np.zeros((1, step_memory.WIDTH))
    memory[0, step_memory.CANDIDATES] = n_plates
    return LAW | {
        "kind": np.zeros(n_plates, np.int32), "plate_edges": np.array([0, n_plates], np.int32),
        "plate_incidence": 2 * np.arange(n_plates, dtype=np.int32), "start": np.array([0, n]), "offsets": OFFSETS, "S": S, "B": B,
        "E": E, "orientations": np.eye(1, 4), "P": P, "H": np.zeros((n_plates, contact_state.LAW + HISTORY)), "starts": Z,
        "memory": memory, "totals": np.zeros((1, run_totals.WIDTH)), "start_depths": np.full(n_plates, 0.9 * OVERLAP),
        "D": np.zeros(domain.WIDTH),
    }  # fmt: skip


def flat_tables():
    """`tables` between two flat plates, each of which overlaps with one sphere."""
    n, z = len(OFFSETS), OFFSETS[:, 2]
    given = tables(2 * n) | {
        "own": np.tile(np.arange(n, dtype=np.int32), 2), "Q": FLAT,
        "partner": np.repeat(np.array([-1, -1 - BASINS], np.int32), n),
    }  # fmt: skip
    Z = given["starts"][0]
    Z[step_start.POSITION + 2] = RADIUS - OVERLAP - z.min()
    Z[step_start.PATCH_HEIGHT] = Z[step_start.POSITION + 2] + z.max() + RADIUS - OVERLAP
    given["H"][:, contact_state.AXIS], given["H"][:, contact_state.SLIP] = 1.0, contact_state.CLOSED
    return given


def waves(rng):
    """A height field of the period 8 with slopes up to about 0.5, sharp enough for a second contact of a sphere of radius 1."""
    n, k = 64, 2.0 * math.pi / 64.0
    x, y = np.meshgrid(k * np.arange(n), k * np.arange(n), indexing="ij")
    heights = np.zeros((n, n))
    for a, b in ((1, 0), (0, 1), (1, 2), (2, -1), (3, 1)):
        heights += 0.25 / (a * a + b * b) * np.cos(a * x + b * y + rng.uniform(0.0, 2.0 * math.pi))
    return pack_field(spline_filter(heights, 3, mode="grid-wrap"), 8.0, 8.0)


def rough_tables(rng, curved, force, closing):
    """`tables` of a body in a random pose between two rough plates, each of which overlaps with its nearest sphere by OVERLAP.
    `force`: force and moment of the contacts at the start of the step; `closing`: those with the upper plate were open."""
    n, lower, upper, q = len(OFFSETS), waves(rng), waves(rng), rng.standard_normal(4)
    rows = 2 * n * BASINS
    basins, plate = np.arange(rows, dtype=np.int32) % BASINS, np.arange(rows) // BASINS % 2
    given = tables(rows) | {
        "own": np.arange(rows, dtype=np.int32) // (2 * BASINS), "partner": (-1 - BASINS * plate - basins).astype(np.int32),
        "Q": np.zeros((rows, surface_contact.WIDTH)), "lower": lower, "upper": upper,
        "update_minima": update_minima, "rough_part": plain(rough_part),
    }  # fmt: skip
    Q, S, P, H, D, Z = (given[name] for name in ("Q", "S", "P", "H", "D", "starts"))
    Z[0, step_start.QUATERNION : step_start.QUATERNION + 4] = q / np.linalg.norm(q)
    D[domain.CURVED : domain.CURVED + 2] = float(curved)
    arms = OFFSETS @ matrix_from_quaternion(q[None] / np.linalg.norm(q))[0].T
    centre, up = np.append(rng.uniform(0.0, 8.0, 2), 0.0), 0.0

    def overlaps():
        S[:, :3], P[0, patch.HEIGHT], Q[:, surface_contact.SEARCHED] = arms + centre, up, np.inf
        Q[:, surface_contact.DISTANCE], Q[:, surface_contact.MINIMA] = np.inf, 0.0
        update_minima(workspace.STAGE.ACCEPT, 0, rows, RoughPlates(given["own"], given["partner"], S, P, Q, D, lower, upper))
        return RADIUS - np.array([Q[plate == p, surface_contact.DISTANCE].min() for p in (0, 1)])

    bounds = [-2.0, 4.0]
    for _ in range(50):
        centre[2] = np.mean(bounds)
        bounds[0 if overlaps()[0] > OVERLAP else 1] = centre[2]
    bounds = [centre[2] - 2.0, centre[2] + 4.0]
    for _ in range(50):
        up = np.mean(bounds)
        bounds[0 if overlaps()[1] > OVERLAP else 1] = up
    Z[0, :3], Z[0, step_start.PATCH_HEIGHT] = centre, up
    H[:, contact_state.SLIP], H[:, contact_state.LAW :] = contact_state.CLOSED, force * rng.uniform(-1.0, 1.0, HISTORY)
    axes = np.cross(Q[:, surface_contact.NORMAL3], unit(0.3, -0.5, 0.7))
    H[:, contact_state.AXIS3] = axes / np.maximum(np.linalg.norm(axes, axis=1), 1e-300)[:, None]
    given["start_depths"][plate == 1] = -0.3 * OVERLAP if closing else 0.9 * OVERLAP
    return given


@np.errstate(all="ignore")
def errors_of(write, n, steps, least):
    """Largest difference of the Jacobian from central differences of each length, by column, over its largest entry."""
    r, J, ignored = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    contacts = write(np.zeros(n), r, J)
    assert contacts >= least

    def residual(y):
        assert write(y, r, ignored) == contacts
        return r.copy()

    errors = []
    for h in steps:
        columns = [(residual(h * e) - residual(-h * e)) / (2.0 * h) for e in np.eye(n)]
        errors.append(np.abs(np.array(columns).T - J).max(axis=0) / np.abs(J).max())
    return np.array(errors)


def jacobian_errors(given, steps):
    context = filled(workspace.ImplicitContext, workspace.KINDS, given)
    tables = filled(workspace.IslandTables, workspace.ISLANDS, ONE)
    return errors_of(lambda y, r, J: evaluate(context, tables, y, r, J), FREEDOMS, steps, 2)


STEPS = np.array([1e-3, 1e-4, 1e-5])


def test_on_flat_plates_only_the_turning_of_the_frame_is_left_out():
    """It counts where force or slip is there at the start of the step."""
    errors = jacobian_errors(flat_tables(), STEPS)
    # differences fall with the square of the step, as those of central differences do, down to rounding: 1e-16 over the step, of
    # coordinates that are twenty overlaps, with a stiffness that goes as their root
    for k, rounding in ((1, 3e-11), (2, 3e-10)):
        assert np.all(errors[k] < 1.1 * (STEPS[k] / STEPS[0]) ** 2 * errors[0] + rounding), errors
    # what is left at the second step: (1e-4 of the length over the overlap of 0.05)^2, of the largest entry
    assert np.all(errors[1] < 4e-6), errors


@pytest.mark.parametrize(("force", "closing"), [(0.0, False), (0.01, False), (0.01, True)], ids=["at rest", "loaded", "closing"])
def test_on_rough_plates_the_jacobian_is_the_derivative_of_the_residual(force, closing):
    """Without curvature in the effective radius."""
    rng = np.random.default_rng(8)
    for _ in range(2):
        errors = jacobian_errors(rough_tables(rng, False, force, closing), STEPS[1:])
        # as above at the longer step; at the shorter one a hundredth, and where the third derivative jumps a tenth of it
        assert errors[0].max() < 2e-5 and errors[1].max() < 2e-6, errors


def test_spots_that_interact_and_the_gradient_force_have_the_jacobian_of_the_residual():
    """Three spots on the lower plate, one above. Left out is the change of the forces along the plate, N^2 g/r^2 of 3 N/2d."""
    offsets, near = OFFSETS.copy(), 0.05
    offsets[:3, 2] = -0.6, -0.59, -0.6
    given = flat_tables() | {"offsets": offsets, "interaction": np.array([near, near, STIFF]), "spots_part": plain(spots_part),
             "body": np.zeros(len(offsets), np.int32)}  # fmt: skip
    errors = jacobian_errors(given, STEPS[1:2])
    # g N/d is 1.5 % of the overlap: without the interaction in the Jacobian it would be off by that
    assert errors.max() < 1e-4, errors
    # without second derivatives of ln R_eff, about 10, it would be off by 3e-3: they go with U/2 = 0.2 N d, beside 1.5 N/d
    rng, errors = np.random.default_rng(9), []
    for _ in range(5):
        errors.append(jacobian_errors(rough_tables(rng, True, 0.01, False), STEPS[1:2]).max())
    # as without it in the median; the one-sided differences of the gradient add 1e-4 of a cell, and more at borders of cells
    assert np.median(errors) < 1e-6 and max(errors) < 2e-5, errors


def two_bodies(rng, force, closing):
    """Tables of two bodies of three spheres in random poses, one sphere of each in contact."""
    offsets, q = rng.uniform(-1.0, 1.0, (6, 3)), rng.standard_normal((2, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    radii, normal, body_of = rng.uniform(0.5, 1.5, 6), unit(*rng.standard_normal(3)), np.repeat([0, 1], 3)
    S, B, E = np.zeros((6, sphere.WIDTH)), np.zeros((2, body.WIDTH)), np.zeros((2, body_extra.WIDTH_WITHOUT_EFFECTS))
    S[:, sphere.RADIUS], B[:, body.MASS] = radii, rng.uniform(0.5, 2.0, 2)
    E[:, body_extra.INERTIA3] = rng.uniform(0.2, 1.0, (2, 3))
    S[:, sphere.MASS] = B[body_of, body.MASS]
    Z, P = np.zeros((2, step_start.WIDTH)), np.zeros((2, patch.WIDTH))
    Z[:, step_start.QUATERNION : step_start.QUATERNION + 4] = q
    Z[:, step_start.ARM] = 2.3, 1.7
    Z[:, [step_start.MASS_FRACTION, step_start.NOW, step_start.LAST]] = 1.0, 1.5, 0.5
    P[:, patch.FREE], P[:, patch.MASS] = 1.0, 0.2
    centres = np.einsum("nij,nj->ni", matrix_from_quaternion(q)[[0, 1]], offsets[[0, 3]])
    Z[0, :3] = centres[1] - centres[0] + (radii[0] + radii[3] - OVERLAP) * normal
    H = np.zeros((1, contact_state.LAW + HISTORY))
    H[0, contact_state.AXIS3], H[0, contact_state.SLIP] = unit(*np.cross(normal, rng.standard_normal(3))), contact_state.CLOSED
    H[0, contact_state.LAW :] = force * rng.uniform(-1.0, 1.0, HISTORY)
    given = LAW | {
        "own": np.zeros(1, np.int32), "partner": np.full(1, 3, np.int32), "kind": np.zeros(1, np.int32),
        "plate_edges": np.zeros(3, np.int32), "body": body_of, "start": np.array([0, 3, 6]), "patch": np.arange(2),
        "offsets": offsets,
        "S": S, "B": B, "E": E, "orientations": q.copy(), "P": P, "Q": FLAT, "H": H, "starts": Z,
        "memory": np.zeros((2, step_memory.WIDTH)), "totals": np.zeros((2, run_totals.WIDTH)),
        "start_depths": np.array([-0.3 * OVERLAP if closing else 0.9 * OVERLAP]), "pairs_part": plain(pairs_part),
    }  # fmt: skip
    island = {
        "bodies": np.arange(2), "body_edges": np.array([0, 2]), "position": np.arange(2), "widths": np.ones(1, np.int64),
        "pairs": np.zeros(1, np.int64), "pair_edges": np.array([0, 1]),
    }  # fmt: skip
    return filled(workspace.ImplicitContext, workspace.KINDS, given), filled(workspace.IslandTables, workspace.ISLANDS, island)


@pytest.mark.parametrize(("force", "closing"), [(0.0, False), (0.01, False), (0.01, True)], ids=["at rest", "loaded", "closing"])
def test_jacobian_of_two_bodies_that_touch(force, closing):
    rng = np.random.default_rng(7)
    for _ in range(2):
        context, tables = two_bodies(rng, force, closing)
        write = lambda y, r, J, context=context, tables=tables: evaluate(context, tables, y, r, J)  # noqa: E731
        errors = errors_of(write, 2 * FREEDOMS, STEPS[:2], 1).max(axis=1)
        # central differences: a hundredth at a tenth of the step, down to rounding of 1e-16 over the step
        assert errors[1] < 0.011 * errors[0] + 3e-11, errors
