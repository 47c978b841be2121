"""The passes of a step over groups of bodies.

The step loop calls them through a pointer, so that both can be compiled at the same time.
"""

import numpy as np
from numba import njit

from thirdbody.jit.arguments import function_at
from thirdbody.jit.options import BARE, NO_COUNTS, POINTED, entry
from thirdbody.kernels.arguments import (
    EARLY,
    EFFECTS,
    LATE,
    LAW,
    OBSERVATION,
    OBSERVE_BODIES,
    SWEEP,
    WORK,
    as_observed,
    context_of,
)
from thirdbody.kernels.bodies import BODIES, WITH_PLATE, WITH_SPHERE, reset_plate_forces
from thirdbody.kernels.explicit.contact_forces import GROUP, contact_forces
from thirdbody.kernels.explicit.drift import drift_bodies
from thirdbody.kernels.explicit.kick import gather_forces
from thirdbody.kernels.explicit.tiles import reset_forces, shift_of
from thirdbody.kernels.plates import is_rough
from thirdbody.kernels.tables import body_extra

law_at, effects_at, observe_bodies_at = function_at(LAW), function_at(EFFECTS), function_at(OBSERVE_BODIES)


@njit(**BARE)
def end_of(group, context):
    """Return the chunk after the last one of a group."""
    return min((group + 1) * GROUP, context.moves.shape[0])


@njit(**BARE)
def drift_groups(task, group, alone, part, context, step):
    """Drift the bodies that this pass of a group needs, unless they have been drifted in this step.

    `lowest`: the first group whose contacts act on bodies of this group. `needs`: other groups whose bodies must be drifted
    before this group's contacts.
    """
    needs, moved = context.needs, context.moved
    requested = needs[group + 1] if task == SWEEP else needs[group] if task == EARLY and not alone else needs[group] - 1
    for e in range(needs[group] - 1, requested):
        h = np.int64(needs[e]) if e >= needs[group] else group
        if moved[h] != step.number:
            moved[h] = step.number
            for c in range(h * GROUP, end_of(h, context)):
                drift_bodies(c, context, step, context.scratch[part], context.marks[part])
                cuts, E = context.cuts, context.E
                if is_rough(context):  # candidates are many, most of them without a minimum
                    for b in range(c * BODIES, min((c + 1) * BODIES, E.shape[0])):
                        E[b, body_extra.UPPER_PUSH] = 0.0
                else:
                    reset_plate_forces(cuts[WITH_PLATE, c], cuts[WITH_PLATE, c + 1], context.own, context.body, E)


@entry(WORK, **POINTED, **NO_COUNTS)
def work(task, part, begin, end, step, packed):
    """Run one pass of a step over groups begin to end; one call for all, since calling through a pointer costs 1.4 us."""
    context = context_of(packed)
    law, effects = law_at(context.law), effects_at(context.effects)
    for group in range(begin, end):
        alone = context.lowest[group] >= begin
        first, last = group * GROUP * BODIES, min((group + 1) * GROUP * BODIES, context.B.shape[0])
        drift_groups(task, group, alone, part, context, step)
        if task == SWEEP:
            reset_forces(first, last, shift_of(group, context), context)
            for side in range(WITH_PLATE, WITH_SPHERE + 1):
                contact_forces(group, side, part, context, step, law)
        if (task == SWEEP and alone) or (task == LATE and not alone):
            for c in range(group * GROUP, end_of(group, context)):
                gather_forces(c, context, step, effects)
        if task == OBSERVATION:
            scratch, rows = context.scratch[part], context.rows[part]
            observe_bodies_at(context.observe_bodies)(
                first, last, as_observed(context), context.A, context.observe, scratch, rows
            )
