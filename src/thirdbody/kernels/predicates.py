"""Predicates for codes in tables: partner of a candidate, contact, presence of effects.

The partner of a candidate is the number of a sphere; -1, the lower plate; or -2 - p, patch p of the upper plate.
"""

from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.columns import body_extra, contact_state, record


@njit(**BARE)
def is_sphere(partner):
    """Return whether the partner is a sphere."""
    return partner >= 0


@njit(**BARE)
def is_plate(partner):
    """Return whether the partner is a plate."""
    return partner < 0


@njit(**BARE)
def is_lower(partner):
    """Return whether the partner is the lower plate."""
    return partner == -1


@njit(**BARE)
def is_upper(partner):
    """Return whether the partner is a patch of the upper plate."""
    return partner < -1


@njit(**BARE)
def patch_of_partner(partner):
    """Return the row of the patch that is the partner; 0 for any other partner, to be read without a branch."""
    return max(-partner - 2, 0)


@njit(**BARE)
def partner_of_patch(p):
    """Return the partner code of patch p of the upper plate."""
    return -2 - p


@njit(**BARE)
def is_closed(k, H):
    """Return whether candidate k touched at the end of the last step."""
    return H[k, contact_state.SLIP] != 0.0


@njit(**BARE)
def is_touching(k, H, R):
    """Return whether candidate k was closed with an overlap at the last record, not only within the reach of a law."""
    return is_closed(k, H) and R[k, record.OVERLAP] >= 0.0


@njit(**BARE)
def has_effect_columns(E):
    """Return whether the scene has body effects, and the table columns for them."""
    return E.shape[1] > body_extra.WIDTH_WITHOUT_EFFECTS
