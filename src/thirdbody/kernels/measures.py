"""Measures in a step: what a contact did, added to the columns of the measures behind its history.

They are called through a pointer, so the engine is compiled once for all measures. Also here: collecting what contacts have
summed, per body and over the surfaces of the plates (`engine.measures`).
"""

import math
from collections import namedtuple

import numpy as np
from numba import njit, types

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, DIRECT, entry
from thirdbody.kernels import plates
from thirdbody.kernels.arguments import MEASURE, ContactStep
from thirdbody.kernels.books import normal_loss_of
from thirdbody.kernels.plates import is_closed, is_lower, is_plate, is_sphere, kind_of
from thirdbody.kernels.tables import sphere, surface_contact
from thirdbody.kernels.tile import TILE, law_input, law_output

measure_at = function_at(MEASURE)

RADIUS = 0  # column of a contact, counted from the first one of the measures: its radius; then come sums, then maxima
ADD = 0  # code of a sum in the table of targets; all else is a maximum (`laws.measures.Layout`)

BODY, PLATE, POINT, DEPOSIT_RADIUS, AMOUNTS = 0, 1, 2, 4, 5
"""Columns of a deposit: body, plate (0 lower, 1 upper), point of the plate (x, y) [m], contact radius [m], one amount per map."""


@njit(**BARE)
def measure_contact(q, k, dt, context, tile):
    I, O = tile.inputs, tile.outputs  # noqa: E741
    x, y, slip = O[q + law_output.TANGENTIAL_X * TILE], O[q + law_output.TANGENTIAL_Y * TILE], O[q + law_output.SLIP * TILE]
    lost = O[q + law_output.DISSIPATED * TILE]
    if context.loss_column >= 0:
        lost -= normal_loss_of(q, context.loss_column, tile)
    done = ContactStep(
        O[q + law_output.LOAD * TILE], math.sqrt(x * x + y * y), O[q + law_output.FRICTION_LIMIT * TILE], slip,
        slip / dt if dt > 0.0 else 0.0, lost, O[q + law_output.CONTACT_RADIUS * TILE],
        O[q + law_output.PEAK_PRESSURE * TILE], I[q + law_input.OVERLAP * TILE], dt, 1.0 if is_plate(context.partner[k]) else 0.0,
    )  # fmt: skip
    call_measure(k, done, context)


@njit(**BARE)
def call_measure(k, done, context):
    row, at = kind_of(k, context), np.int64(context.H.shape[1] - context.measured)
    measure_at(context.measure)(done, row, context.H, np.int64(k), at, context.measure_parameters)


@njit(**BARE)
def measure_opened(k, lost, context):
    plate = 1.0 if is_plate(context.partner[k]) else 0.0
    call_measure(k, ContactStep(0.0, 0.0, 0.0, 0.0, 0.0, lost, 0.0, 0.0, 0.0, 0.0, plate), context)


Collection = namedtuple("Collection", "own partner body S P Q H W targets sums deposits")
"""Tables from which and to which `collect` works, named as in `arguments.Context`. W: what bodies have of the measures;
`targets`, `sums`: of `laws.measures.Layout`; `deposits` on the plates: room for one per candidate, or no rows."""

_TABLE, _S1, _I1 = types.Array(types.float64, 2, "C"), types.Array(types.int32, 1, "C"), types.Array(types.int64, 1, "C")
_TARGETS, _MAPS = types.Array(types.int64, 2, "C"), types.Array(types.float64, 4, "C")
COLLECTION = types.NamedTuple((_S1, _S1, _I1, _TABLE, _TABLE, _TABLE, _TABLE, _TABLE, _TARGETS, types.int64, _TABLE), Collection)


@njit(**BARE)
def add_to_body(b, k, side, at, tables):
    """Add what candidate k has measured to body b; `side`: 1 lower plate, 2 upper plate, 3 debris."""
    H, W, targets = tables.H, tables.W, tables.targets
    for c in range(targets.shape[0]):
        column, value = targets[c, side], H[k, at + 1 + c]
        if column >= 0:
            W[b, column] = W[b, column] + value if targets[c, 0] == ADD else max(W[b, column], value)


@njit(**BARE)
def write_deposit(n, k, at, tables):
    """Write the amounts of candidate k for the maps into row n of the deposits; return the number of rows then."""
    H, S, P, Q, targets, row = tables.H, tables.S, tables.P, tables.Q, tables.targets, tables.deposits[n]
    i, j = tables.own[k], tables.partner[k]
    any_amount = False
    for c in range(targets.shape[0]):
        if targets[c, 4] >= 0:
            row[AMOUNTS + targets[c, 4]] = H[k, at + 1 + c]
            any_amount = any_amount or H[k, at + 1 + c] != 0.0
    if not any_amount:
        return n
    x, y = S[i, sphere.POSITION], S[i, sphere.POSITION + 1]
    if Q.shape[0] > 0:
        x, y = x + Q[k, surface_contact.OFFSET], y + Q[k, surface_contact.OFFSET + 1]
    x, y, _ = plates.to_surface(j, (x, y, 0.0), P)
    row[BODY], row[PLATE], row[POINT], row[POINT + 1] = tables.body[i], 0.0 if is_lower(j) else 1.0, x, y
    row[DEPOSIT_RADIUS] = H[k, at + RADIUS]
    return n + 1


@entry(types.int64(COLLECTION), **DIRECT)
def collect(tables):
    """Add what contacts have measured to their bodies, in the order of candidates, and clear it but for maxima of closed
    ones; return the number of deposits."""
    H, targets, n = tables.H, tables.targets, np.int64(0)
    width = targets.shape[0] + 1
    at = H.shape[1] - width
    for k in range(tables.own.shape[0]):
        empty = True
        for h in range(at + 1, at + width):
            empty &= H[k, h] == 0.0
        if empty:
            continue
        j = tables.partner[k]
        side = 3 if is_sphere(j) else 1 if is_lower(j) else 2
        add_to_body(tables.body[tables.own[k]], k, side, at, tables)
        if is_sphere(j):
            add_to_body(tables.body[j], k, side, at, tables)
        elif tables.deposits.shape[0] > 0:
            n = write_deposit(n, k, at, tables)
        last = at + 1 + tables.sums if is_closed(k, H) else at + width
        for h in range(at + 1, last):
            H[k, h] = 0.0
    return n


@njit(**BARE)
def weight(i, j, x, y, a, h_x, h_y):
    """Return the part of cell (i, j) in a deposit around (x, y) [m]: Hertz' pressure in its middle, sqrt(1 - r^2/a^2)."""
    d_x, d_y = (i + 0.5) * h_x - x, (j + 0.5) * h_y - y
    inside = 1.0 - (d_x * d_x + d_y * d_y) / (a * a)
    return math.sqrt(inside) if inside > 0.0 else 0.0


@entry(types.void(_TABLE, _MAPS, types.Array(types.float64, 1, "C")), **DIRECT)
def deposit(rows, maps, size):
    """Add deposits, in their order, to the maps (maps, 2 plates, n_y, n_x) of a periodic domain of `size` [m]: in the cell of the
    centre, or spread over the cells whose middles lie in the contact area."""
    n_y, n_x = maps.shape[2], maps.shape[3]
    h_x, h_y = size[0] / n_x, size[1] / n_y
    for n in range(rows.shape[0]):
        row = rows[n]
        x, y, a, plate = row[POINT], row[POINT + 1], row[DEPOSIT_RADIUS], np.int64(row[PLATE])
        low_i, high_i = np.int64(math.floor((x - a) / h_x)), np.int64(math.floor((x + a) / h_x))
        low_j, high_j = np.int64(math.floor((y - a) / h_y)), np.int64(math.floor((y + a) / h_y))
        total = 0.0
        for j in range(low_j, high_j + 1 if a > 0.0 else low_j):
            for i in range(low_i, high_i + 1):
                total += weight(i, j, x, y, a, h_x, h_y)
        if total == 0.0:
            i, j = np.int64(math.floor(x / h_x)) % n_x, np.int64(math.floor(y / h_y)) % n_y
            for m in range(maps.shape[0]):
                maps[m, plate, j, i] += row[AMOUNTS + m]
            continue
        for j in range(low_j, high_j + 1):
            for i in range(low_i, high_i + 1):
                part = weight(i, j, x, y, a, h_x, h_y) / total
                for m in range(maps.shape[0]):
                    maps[m, plate, j % n_y, i % n_x] += part * row[AMOUNTS + m]
