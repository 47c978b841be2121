"""Jacobian of an implicit step against central differences of the residual, for planes at any tilt and for curved surfaces.

The first bodies are made here and put into the place of the flat plates before the kernels are compiled. The law is smooth: what
is checked is geometry, and the tangents of the real laws are checked by the conformance suite.
"""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numba import float64, int64, njit, types

import thirdbody.kernels
from thirdbody.engine.state import rotation_matrices
from thirdbody.jit.function_pointers import address
from thirdbody.jit.options import BARE, OPTIONS
from thirdbody.jit.packed_arguments import argument_specs, pack
from thirdbody.kernels.bundles import Motion
from thirdbody.kernels.columns import (
    body,
    body_extra,
    contact_state,
    contact_tangent,
    domain,
    law_input,
    law_output,
    patch,
    rolling_input,
    rolling_output,
    run_totals,
    sphere,
    step_memory,
    step_settings,
    step_start,
    surface_contact,
)
from thirdbody.kernels.columns.tile import TILE
from thirdbody.kernels.implicit.band_matrix import entry, row_length
from thirdbody.kernels.implicit.bundles import FREEDOMS, KINDS, ImplicitContext, context_of
from thirdbody.kernels.implicit.island_bundles import TABLES, IslandTables, make_pool, tables_of
from thirdbody.kernels.implicit.island_newton import evaluate as evaluate_island
from thirdbody.kernels.implicit.island_step import island_of
from thirdbody.kernels.implicit.pair_jacobian import assemble_island
from thirdbody.kernels.predicates import BASINS
from thirdbody.kernels.rolling_kinematics import MOMENTS
from thirdbody.kernels.signatures import LAW

UNCACHED = OPTIONS | {"cache": False}

NORMAL, POINT, BEND = patch.WIDTH, patch.WIDTH + 3, patch.WIDTH + 6
"""Columns of the table of patches, added here: unit normal, a point of the surface, curvature. The last row is the lower body."""

FLAT = np.zeros((0, surface_contact.WIDTH))

HISTORY = 4
"""Force and moment of a contact at the start of the step."""

STIFF, SHEAR, ROLL = 1.3, 0.9, 0.2


@njit(LAW, **UNCACHED)
def law(I, O, n, _):  # noqa: E741
    """A smooth law: N = STIFF d^1.5, T = T_0 - SHEAR d^.5 slip, M = M_0 - ROLL d turn; slip and turn with a tenth across."""
    for q in range(n):
        d, x, y = I[law_input.OVERLAP * TILE + q], I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q]
        O[law_output.NORMAL_FORCE * TILE + q] = STIFF * d**1.5
        old, k_t = law_input.HISTORY * TILE + q, SHEAR * math.sqrt(d)
        O[law_output.TANGENTIAL_X * TILE + q] = I[old] - k_t * (x + 0.1 * y)
        O[law_output.TANGENTIAL_Y * TILE + q] = I[old + TILE] - k_t * (y - 0.1 * x)
        turn, to = (law_input.HISTORY + HISTORY) * TILE + q, (law_output.HISTORY + HISTORY) * TILE + q
        a, b = I[turn + rolling_input.ROTATION_X * TILE], I[turn + rolling_input.ROTATION_Y * TILE]
        O[to + rolling_output.MOMENT_X * TILE] = I[old + 2 * TILE] - ROLL * d * (a + 0.1 * b)
        O[to + rolling_output.MOMENT_Y * TILE] = I[old + 3 * TILE] - ROLL * d * (b - 0.1 * a)


@njit(LAW, **UNCACHED)
def tangents(I, K, n, _):  # noqa: E741
    """Derivatives of `law` (`contact_tangent`)."""
    for q in range(n):
        d, x, y = I[law_input.OVERLAP * TILE + q], I[law_input.SLIP_X * TILE + q], I[law_input.SLIP_Y * TILE + q]
        k_t, bend = SHEAR * math.sqrt(d), 0.5 * SHEAR / math.sqrt(d)
        turn = (law_input.HISTORY + HISTORY) * TILE + q
        a, b = I[turn + rolling_input.ROTATION_X * TILE], I[turn + rolling_input.ROTATION_Y * TILE]
        values = (
            1.5 * STIFF * math.sqrt(d), -k_t, -0.1 * k_t, 0.1 * k_t, -k_t, -bend * (x + 0.1 * y), -bend * (y - 0.1 * x),
            -ROLL * d, -0.1 * ROLL * d, 0.1 * ROLL * d, -ROLL * d, -ROLL * (a + 0.1 * b), -ROLL * (b - 0.1 * a),
        )  # fmt: skip
        for k in range(contact_tangent.ROLLING_WIDTH):
            K[k * TILE + q] = values[k]


def replace_flat_plates(first_body: ModuleType, jacobian: ModuleType, predicates: ModuleType) -> None:
    """Replace the flat plates by planes or spheres that the table of patches describes."""
    is_upper, patch_of_partner = predicates.is_upper, predicates.patch_of_partner

    @njit(**BARE)
    def row_of(j, P):
        return patch_of_partner(j) if is_upper(j) else P.shape[0] - 1

    @njit(**BARE)
    def from_surface(j, x, P):
        """Distance of x from the surface, and the normal there."""
        p = row_of(j, P)
        lift = P[p, patch.HEIGHT] if is_upper(j) else 0.0
        n_x, n_y, n_z, k = P[p, NORMAL], P[p, NORMAL + 1], P[p, NORMAL + 2], P[p, BEND]
        d_x, d_y, d_z = x[0] - P[p, POINT], x[1] - P[p, POINT + 1], x[2] - P[p, POINT + 2] - lift
        if k == 0.0:
            return d_x * n_x + d_y * n_y + d_z * n_z, (n_x, n_y, n_z)
        d_x, d_y, d_z = d_x + n_x / k, d_y + n_y / k, d_z + n_z / k  # from the centre of the sphere
        far = math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)
        return math.copysign(far, k) - 1.0 / k, (
            d_x / math.copysign(far, k),
            d_y / math.copysign(far, k),
            d_z / math.copysign(far, k),
        )

    @njit(**BARE)
    def from_candidate(k, context):
        i, S = context.own[k], context.S
        return from_surface(context.partner[k], (S[i, sphere.X], S[i, sphere.Y], S[i, sphere.Z]), context.P)

    @njit(**BARE)
    def turning(k, context):
        """Turning of the normal in all directions along the surface."""
        distance, (x, y, z) = from_candidate(k, context)
        bend = context.P[row_of(context.partner[k], context.P), BEND]
        h = bend / (1.0 + bend * distance)
        return h * (1.0 - x * x), h * (1.0 - y * y), h * (1.0 - z * z), -h * x * y, -h * x * z, -h * y * z

    @njit(**BARE)
    def normal_before(k, move, context):
        i, S = context.own[k], context.S
        x = S[i, sphere.X] - move[0], S[i, sphere.Y] - move[1], S[i, sphere.Z] - move[2]
        return from_surface(context.partner[k], x, context.P)[1]

    @njit(**BARE)
    def overlap(k, context):
        return context.S[context.own[k], sphere.RADIUS] - from_candidate(k, context)[0]

    first_body.is_rough = njit(**BARE)(lambda context: True)
    first_body.overlap, first_body.normal_before = overlap, normal_before
    first_body.normal = njit(**BARE)(lambda k, context: from_candidate(k, context)[1])
    first_body.effective_radius = njit(**BARE)(lambda k, context: 1.0)
    jacobian.normal_gradient_at = turning


def fresh_kernels(change: Callable[[ModuleType, ModuleType, ModuleType], None]) -> tuple[ModuleType, ...]:
    """Import the kernels anew, with first bodies changed before others use them: bundles, residual, jacobian."""
    saved = {name: sys.modules.pop(name) for name in list(sys.modules) if name.split(".")[:2] == ["thirdbody", "kernels"]}
    try:
        change(
            *(importlib.import_module(f"thirdbody.kernels.{name}") for name in ("first_body", "implicit.jacobian", "predicates"))
        )
        names = ("bundles", "residual", "jacobian")
        return tuple(importlib.import_module(f"thirdbody.kernels.implicit.{name}") for name in names)
    finally:
        for name in [name for name in sys.modules if name.split(".")[:2] == ["thirdbody", "kernels"]]:
            del sys.modules[name]
        sys.modules.update(saved)
        thirdbody.kernels = saved["thirdbody.kernels"]


def compiled(kernels: tuple[ModuleType, ...]) -> Callable[..., Any]:
    """Return evaluate(packed, y, dt, v_x, v_y, r, J), which writes residual and Jacobian of body 0 and returns its contacts."""
    bundles, residual, jacobian = kernels
    context_of, make_workspace, active_body = bundles.context_of, bundles.make_workspace, bundles.ActiveBody
    set_configuration, active_contacts, write_residual = (
        residual.set_configuration, residual.active_contacts, residual.residual,
    )  # fmt: skip
    assemble_jacobian = jacobian.assemble_jacobian
    row, table, packed_array = (types.Array(kind, n, "C") for kind, n in ((float64, 1), (float64, 2), (int64, 1)))

    @njit(int64(packed_array, row, float64, float64, float64, row, table), **UNCACHED)
    def evaluate(packed, y, dt, v_x, v_y, r, J):
        context = context_of(packed)
        space, motion = make_workspace(context), Motion(dt, v_x, v_y)
        active = active_body(0, 0, context.starts[0], context.memory[0], context.totals[0])
        space.before[:] = context.initial_overlaps
        set_configuration(context, active, y, dt)
        m = active_contacts(context, active, y, motion, space)
        write_residual(context, active, m, y, motion, space)
        assemble_jacobian(context, active, m, dt, False, space)
        r[:], J[:] = space.residual, space.jacobian
        return m

    return evaluate


@pytest.fixture(scope="module")
def on_any_surface():
    return compiled(fresh_kernels(replace_flat_plates))


@pytest.fixture(scope="module")
def on_plates():
    return compiled(fresh_kernels(lambda first_body, jacobian, predicates: None))


# -- a body of four spheres between two surfaces --

OFFSETS = np.array([[1.0, 0.2, -0.5], [-0.7, 0.9, -0.4], [-0.5, -0.8, -0.6], [0.3, 0.1, 0.9]])
RADIUS, OVERLAP, DT = 1.0, 0.05, 10.0


def zeros(kind: Any) -> Any:
    return np.zeros((1,) * kind.ndim, np.dtype(str(kind.dtype))) if isinstance(kind, types.Array) else 0


def unit(*v: float) -> np.ndarray:
    return np.array(v) / np.linalg.norm(v)


def tables(lower: np.ndarray, upper: np.ndarray, bend: float, force: float, closing: bool) -> dict[str, Any]:
    """The tables of a step: each surface, of the curvature `bend`, overlaps the sphere that is farthest towards it by OVERLAP.

    `force`: force and moment of the contacts at the start of the step; `closing`: the contact with the upper surface was open.
    """
    n = len(OFFSETS)
    S, B, E = np.zeros((n, sphere.WIDTH)), np.zeros((1, body.WIDTH)), np.zeros((1, body_extra.WIDTH_WITHOUT_EFFECTS))
    S[:, sphere.RADIUS], S[:, sphere.MASS], B[0, body.MASS], B[0, body.QUATERNION] = RADIUS, 0.7, 0.7, 1.0
    E[0, body_extra.INERTIA3] = 0.3, 0.4, 0.5
    P, Z = np.zeros((2, BEND + 1)), np.zeros((1, step_start.WIDTH))
    P[0, patch.FREE], P[0, patch.MASS], P[0, patch.LOAD] = 1.0, 0.2, 0.01
    Z[0, step_start.QUATERNION], Z[0, step_start.ARM], Z[0, step_start.MASS_FRACTION] = 1.0, 2.3, 1.0
    Z[0, step_start.NOW], Z[0, step_start.BEFORE] = 1.5, 0.5
    H, before = np.zeros((2 * n, contact_state.LAW + HISTORY)), np.full(2 * n, 1.0)
    for p, normal in enumerate((upper, lower)):
        i = int(np.argmin(OFFSETS @ normal))
        P[p, NORMAL : NORMAL + 3], P[p, POINT : POINT + 3], P[p, BEND] = normal, OFFSETS[i] - (RADIUS - OVERLAP) * normal, bend
        k = n * (1 - p) + i
        axis = unit(*np.cross(normal, unit(0.3, -0.5, 0.7)))
        H[k, contact_state.AXIS3], H[k, contact_state.SLIP] = axis, contact_state.CLOSED
        H[k, contact_state.LAW :] = force * np.array([0.6, -0.8, 0.5, 0.3])
        before[k] = -0.3 * OVERLAP if closing and p == 0 else 0.9 * OVERLAP
    partner = np.repeat(np.array([-1, -1 - BASINS], np.int32), n)
    settings = np.zeros(step_settings.WIDTH)
    settings[step_settings.INERTIAL] = 1.0
    return {
        "own": np.tile(np.arange(n, dtype=np.int32), 2), "partner": partner, "kind": np.zeros(2 * n, np.int32),
        "edges": np.array([0, 2 * n], np.int32), "incidence": 2 * np.arange(2 * n, dtype=np.int32),
        "start": np.array([0, n]), "offsets": OFFSETS, "Q": FLAT, "S": S, "B": B, "E": E, "P": P, "H": H, "starts": Z,
        "memory": np.zeros((1, step_memory.WIDTH)), "totals": np.zeros((1, run_totals.WIDTH)), "initial_overlaps": before,
        "settings": settings, "max_per_body": 2 * n, "n_history": HISTORY, "rolling": MOMENTS, "force": 0, "moment": 2,
        "stored": -1,
        "law": address(law, LAW), "tangents": address(tangents, LAW),
    }  # fmt: skip


def jacobian_errors(evaluate: Callable[..., Any], given: dict[str, Any], drag: tuple[float, float], steps: Any) -> np.ndarray:
    """Largest difference of the Jacobian from central differences of each length, by column, over its largest entry."""
    context = ImplicitContext(**({name: zeros(kind) for name, kind in KINDS.items()} | given))
    packed = pack(argument_specs(KINDS), context)
    r, J, ignored = np.zeros(FREEDOMS), np.zeros((FREEDOMS, FREEDOMS)), np.zeros((FREEDOMS, FREEDOMS))

    def residual(y):
        assert evaluate(packed, y, DT, *drag, r, ignored) == 2
        return r.copy()

    evaluate(packed, np.zeros(FREEDOMS), DT, *drag, r, J)
    errors = []
    for h in steps:
        columns = [(residual(h * e) - residual(-h * e)) / (2.0 * h) for e in np.eye(FREEDOMS)]
        errors.append(np.abs(np.array(columns).T - J).max(axis=0) / np.abs(J).max())
    return np.array(errors)


TILTED = unit(0.5, -0.3, 0.8), unit(-0.2, 0.6, -0.7)
CASES = {
    "planes, tilted": (TILTED, 0.0, 0.0, (0.0, 0.0), False),
    "planes, tilted, with friction and drag": (TILTED, 0.0, 0.01, (0.01, -0.02), False),
    "planes, tilted, closing": (TILTED, 0.0, 0.01, (0.01, -0.02), True),
    "bulging": (TILTED, 0.7, 0.01, (0.0, 0.0), False),
    "hollow": (TILTED, -0.05, 0.01, (0.0, 0.0), False),
    "steep": ((unit(1.0, 0.1, 0.0), unit(-1.0, 0.0, -0.1)), 0.4, 0.01, (0.0, 0.0), False),
}
STEPS = np.array([1e-3, 1e-4, 1e-5])


def check_order(errors: np.ndarray) -> None:
    """Differences fall with the square of the step, as those of central differences do, down to rounding.

    Rounding: 1e-16 over the step, of coordinates that are twenty overlaps, with a stiffness that goes as their root.
    """
    for k, rounding in ((1, 3e-11), (2, 3e-10)):
        assert np.all(errors[k] < 1.1 * (STEPS[k] / STEPS[0]) ** 2 * errors[0] + rounding), errors
    # what is left at the second step: (1e-4 of the length over the overlap of 0.05)^2, of the largest entry
    assert np.all(errors[1] < 4e-6), errors


@pytest.mark.parametrize("case", CASES)
def test_jacobian_is_the_derivative_of_the_residual(on_any_surface, case):
    normals, bend, force, drag, closing = CASES[case]
    check_order(jacobian_errors(on_any_surface, tables(*normals, bend, force, closing), drag, STEPS))


def test_on_flat_plates_only_the_turning_of_the_frame_is_left_out(on_plates):
    """It counts where force or slip is there at the start of the step. The plates of every run, as they are compiled."""
    given = tables(unit(0.0, 0.0, 1.0), unit(0.0, 0.0, -1.0), 0.0, 0.0, False)
    z, Z = OFFSETS[:, 2], given["starts"][0]
    Z[step_start.POSITION + 2] = RADIUS - OVERLAP - z.min()
    Z[step_start.PATCH_HEIGHT] = Z[step_start.POSITION + 2] + z.max() + RADIUS - OVERLAP
    check_order(jacobian_errors(on_plates, given, (0.0, 0.0), STEPS))


# -- two bodies that touch --


@pytest.fixture(scope="module")
def of_two_bodies() -> Callable[..., Any]:
    """evaluate(packed, tables, y, dt, r, J): residual and Jacobian of an island of two bodies; returns its contacts."""
    row, table, packed_array = (types.Array(kind, n, "C") for kind, n in ((float64, 1), (float64, 2), (int64, 1)))

    @njit(int64(packed_array, packed_array, row, float64, row, table), **UNCACHED)
    def evaluate(packed, packed_tables, y, dt, r, J):
        context = context_of(packed)
        island = island_of(np.int64(0), context, tables_of(packed_tables))
        pool = make_pool(context, np.int64(2), np.int64(1), 2 * FREEDOMS * row_length(island.half_width))
        for k in range(2 * FREEDOMS):
            pool.coordinates[k // FREEDOMS, 0, k % FREEDOMS] = y[k]
        m = evaluate_island(context, island, 0.0, Motion(dt, 0.0, 0.0), pool)
        assemble_island(context, island, m, dt, False, pool)
        for i in range(2 * FREEDOMS):
            r[i] = pool.coordinates[i // FREEDOMS, 2, i % FREEDOMS]
            for j in range(2 * FREEDOMS):
                J[i, j] = pool.band[entry(i, j, island.half_width)]
        return m

    return evaluate


def two_bodies(rng: np.random.Generator, force: float, closing: bool) -> tuple[np.ndarray, np.ndarray, list[Any]]:
    """Packed tables of two bodies of three spheres in random poses, one sphere of each in contact; and what must stay alive."""
    offsets, q = rng.uniform(-1.0, 1.0, (6, 3)), rng.standard_normal((2, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    radii, normal, body_of = rng.uniform(0.5, 1.5, 6), unit(*rng.standard_normal(3)), np.repeat([0, 1], 3)
    S, B, E = np.zeros((6, sphere.WIDTH)), np.zeros((2, body.WIDTH)), np.zeros((2, body_extra.WIDTH_WITHOUT_EFFECTS))
    S[:, sphere.RADIUS], B[:, body.MASS], E[:, body_extra.INERTIA3] = (
        radii,
        rng.uniform(0.5, 2.0, 2),
        rng.uniform(0.2, 1.0, (2, 3)),
    )
    S[:, sphere.MASS] = B[body_of, body.MASS]
    Z, P = np.zeros((2, step_start.WIDTH)), np.zeros((2, patch.WIDTH))
    Z[:, step_start.QUATERNION : step_start.QUATERNION + 4] = q
    Z[:, step_start.ARM], Z[:, step_start.MASS_FRACTION], Z[:, step_start.NOW], Z[:, step_start.BEFORE] = (
        (2.3, 1.7),
        1.0,
        1.5,
        0.5,
    )
    P[:, patch.FREE], P[:, patch.MASS] = 1.0, 0.2
    centres = np.einsum("nij,nj->ni", rotation_matrices(q)[[0, 1]], offsets[[0, 3]])
    Z[0, :3] = centres[1] - centres[0] + (radii[0] + radii[3] - OVERLAP) * normal
    H = np.zeros((1, contact_state.LAW + HISTORY))
    H[0, contact_state.AXIS3], H[0, contact_state.SLIP] = unit(*np.cross(normal, rng.standard_normal(3))), contact_state.CLOSED
    H[0, contact_state.LAW :] = force * rng.uniform(-1.0, 1.0, HISTORY)
    settings = np.zeros(step_settings.WIDTH)
    settings[step_settings.INERTIAL] = 1.0
    given = {
        "own": np.zeros(1, np.int32), "partner": np.full(1, 3, np.int32), "kind": np.zeros(1, np.int32),
        "edges": np.zeros(3, np.int32), "body": body_of, "start": np.array([0, 3, 6]), "patch": np.arange(2), "offsets": offsets,
        "S": S, "B": B, "E": E, "P": P, "Q": FLAT, "H": H, "starts": Z, "memory": np.zeros((2, step_memory.WIDTH)),
        "totals": np.zeros((2, run_totals.WIDTH)), "D": np.zeros(domain.WIDTH), "settings": settings, "max_per_body": 1,
        "initial_overlaps": np.array([-0.3 * OVERLAP if closing else 0.9 * OVERLAP]), "n_history": HISTORY, "rolling": MOMENTS,
        "force": 0, "moment": 2, "stored": -1, "law": address(law, LAW), "tangents": address(tangents, LAW),
    }  # fmt: skip
    island = {
        "bodies": np.arange(2), "body_edges": np.array([0, 2]), "position": np.arange(2), "widths": np.ones(1, np.int64),
        "pairs": np.zeros(1, np.int64), "pair_edges": np.array([0, 1]),
    }  # fmt: skip
    context = ImplicitContext(**({name: zeros(kind) for name, kind in KINDS.items()} | given))
    tables = IslandTables(**({name: zeros(kind) for name, kind in TABLES.items()} | island))
    return pack(argument_specs(KINDS), context), pack(argument_specs(TABLES), tables), [context, tables]


@pytest.mark.parametrize(("force", "closing"), [(0.0, False), (0.01, False), (0.01, True)], ids=["at rest", "loaded", "closing"])
def test_jacobian_of_two_bodies_that_touch(of_two_bodies, force, closing):
    rng, n = np.random.default_rng(7), 2 * FREEDOMS
    r, J, ignored = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    for _ in range(400):
        packed, tables, _alive = two_bodies(rng, force, closing)

        def residual(y, packed=packed, tables=tables):
            assert of_two_bodies(packed, tables, y, DT, r, ignored) == 1
            return r.copy()

        assert of_two_bodies(packed, tables, np.zeros(n), DT, r, J) == 1
        errors = []
        for h in STEPS[:2]:
            columns = [(residual(h * e) - residual(-h * e)) / (2.0 * h) for e in np.eye(n)]
            errors.append(np.abs(np.array(columns).T - J).max() / np.abs(J).max())
        # central differences: a hundredth at a tenth of the step, down to rounding of 1e-16 over the step, as in `check_order`
        assert errors[1] < 0.011 * errors[0] + 3e-11, errors
