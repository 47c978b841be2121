"""Candidates of a body with the plates that can touch in a step: with rough plates, few of all its rows have a minimum.

Rows that cannot touch are moved behind the others at the start of a step (`context.incidence`), so loops end early.
"""

from numba import njit

from thirdbody.jit.options import BARE, BARE_CHUNK
from thirdbody.kernels import first_body
from thirdbody.kernels.implicit.tables import step_memory
from thirdbody.kernels.predicates import BASINS, is_upper
from thirdbody.kernels.tables import surface_contact


@njit(**BARE)
def rows_of_sphere(k, context):
    """Return the number of rows of a sphere and a plate, of which k is the first."""
    return BASINS if (context.upper if is_upper(context.partner[k]) else context.lower).shape[0] > 0 else 1


@njit(**BARE)
def can_touch(k, row, rows, Q):
    """Return whether the given row of the sphere whose first row is k has a minimum, or had one at the start of the last step."""
    bits = int(Q[k, surface_contact.MINIMA]) | int(Q[k, surface_contact.ENDED])
    return rows == 1 or bits >> row & 1 != 0


@njit(**BARE_CHUNK)
def sort_candidates(b, context):
    """Move the candidates of body b that can touch in this step to the front, and note their number."""
    Q, low, high = context.Q, context.edges[b], context.edges[b + 1]
    e, count = low, 0
    for here in (True, False):
        k = low
        while k < high:
            rows = rows_of_sphere(k, context)
            for row in range(rows):
                if can_touch(k, row, rows, Q) == here:
                    context.incidence[e] = 2 * (k + row)
                    e += 1
            k += rows
        if here:
            count = e - low
    context.memory[b, step_memory.CANDIDATES] = count


@njit(**BARE)
def last_candidate(b, context):
    """Return the end of the candidates of body b in `incidence` that can touch in this step."""
    if first_body.is_rough(context):
        return context.edges[b] + int(context.memory[b, step_memory.CANDIDATES])
    return context.edges[b + 1]
