"""The context of the contact kernels that both integrators share, from the implicit tables."""

from typing import Any, NamedTuple

from numba import njit

from thirdbody.jit.options import INNER


class ContactContext(NamedTuple):
    """Fields as in `signatures.Context`."""

    own: Any
    partner: Any
    kind: Any
    S: Any
    P: Any
    H: Any
    R: Any
    n_history: int
    rolling: int
    force: int
    moment: int
    stored: int


@njit(**INNER)
def contact_context(spots, state, known):
    """Return the context of the contacts of a body (`residual`)."""
    own, partner, kind, _, _ = spots
    S, _, P, H, R, _ = state
    return ContactContext(own, partner, kind, S, P, H, R, known[2], known[3], known[8], known[9], known[7])
