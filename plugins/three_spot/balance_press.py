"""Steps along the path of one particle: past kinks of the laws, and through contacts that do not hold it, to a stable seat."""

from collections.abc import Sequence

import numpy as np

from thirdbody.plugin import Balance, NoStaticState, QuasiStatic, from_first_touch, in_present_posture, relax, seat

STEPS = 100
"""Steps of the pressing: one for laws that are exact along the straight paths of a weightless particle."""
SEATS = 10
"""Maximum number of seats that a particle may leave again while it is pressed."""
UNDECIDED = 1e-3
"""Unbalanced fraction of the forces below which a failed search is inconclusive: where a particle tips, 2 to 20 % were left,
where a law was too rough for the solver, 1e-6."""


def press(solver: QuasiStatic, given: float) -> tuple[QuasiStatic, Balance]:
    """Return the balance under `given`, a load [N] or an indentation [m], and its solver.

    The solver is a new one, in the posture of the seat, if the particle rotated in between. Raises NoStaticState if it tips over.
    """
    seats = 0
    for k in range(1, STEPS + 1):
        target = (given * k / STEPS, 0.0, 0.0)
        result = None
        while result is None:
            try:
                result = _balance(solver, target)
            except NoStaticState as problem:
                left = problem
            if result is None:
                if seats == SEATS:
                    raise NoStaticState(f"it left {SEATS} seats again", left.plate, left.closest, undecided=True)
                try:
                    solver = from_first_touch(solver, _load(solver, target))
                except NoStaticState as problem:  # found under a load: `plate` is that of the path
                    raise NoStaticState(str(problem), left.plate, problem.closest, problem.undecided) from None
                seats += 1
    assert result is not None
    return solver, result


def drag(solver: QuasiStatic, target: Sequence[float]) -> tuple[QuasiStatic, Balance]:
    """Return the balance at a load or indentation and drag x, y, and the solver for the next step.

    The solver follows the rotation of the particle. Under a load a particle that tips over moves on until its forces balance
    again. Raises NoStaticState where they never do.
    """
    try:
        result = _balance(solver, target)
    except NoStaticState:
        if not solver.under_load:
            raise
        solver = seat(solver, target)
        result = _balance(solver, target)
    return in_present_posture(solver), result


def _balance(solver: QuasiStatic, target: Sequence[float]) -> Balance:
    """Return the balance next to the last one: by Newton's method, else by relaxation."""
    try:
        return solver.move(target)
    except NoStaticState as problem:
        if problem.closest >= UNDECIDED or not relax(solver, target):
            raise
    return solver.move(target)


def _load(solver: QuasiStatic, target: Sequence[float]) -> float:
    """Load [N] for continuing: of the last balance if the indentation is given, else of the upright particle."""
    if solver.under_load:
        return target[0]
    if solver.now is not None:
        return float(solver.now.answer.normal[solver.grip.upper].sum())
    plate = np.array(target)
    return float(solver.trial(solver.upright(plate), plate).answer.normal[solver.grip.upper].sum())
