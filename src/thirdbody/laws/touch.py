"""Steps in which bodies touch or part, of an adhesion law whose force jumps there.

Such a force acts for a part of the step only. Without notice of that its work is off by the force times up to half the way of the
step: a ball that leaves with 1.01 of its energy.
"""

from thirdbody.laws.contract import kernel

FULL, EXPLICIT, IMPLICIT = 0.0, 1.0, 2.0
"""Code of the integrator, the last parameter of each pair: outside steps, in explicit ones, in implicit ones."""


@kernel
def touch_fraction(overlap, moved, ahead, integrator):
    """Fraction of a force that a step applies; `moved`: overlap gained in it, `ahead`: in the next one as far as is known [m].

    Velocity Verlet applies a force on half of the step before it and on half of the one after. Where bodies came into touch
    within the step before, it is the part overlap/moved of that one instead; where they will leave within the next one,
    overlap/-ahead of that. An implicit step applies its last force to all of it, and cannot look ahead: overlap/moved where
    bodies come into touch.
    """
    lands, leaves = overlap < moved, overlap < -ahead
    before, after = overlap / max(moved, 1e-300), overlap / max(-ahead, 1e-300)
    explicit = (before if lands else 0.5) + (after if leaves else 0.5)
    implicit = before if lands else 1.0
    fraction = explicit if integrator == EXPLICIT else (implicit if integrator == IMPLICIT else 1.0)
    return fraction if overlap > 0.0 else 1.0


@kernel
def touch_growth(overlap, moved, integrator):
    """Derivative of the fraction of an implicit step by the overlap at its end [1/m]; 0 in a contact that was there before."""
    lands = integrator == IMPLICIT and 0.0 < overlap < moved
    return (1.0 - overlap / moved) / moved if lands else 0.0
