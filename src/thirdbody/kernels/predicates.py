"""Predicates for codes in tables: partner of a candidate, contact, presence of effects.

The partner of a candidate is the number of a sphere, or a negative code of a first body and of the basin in which the sphere
touches it: -1 - basin, the lower plate; -1 - (1 + p) BASINS - basin, patch p of the upper plate. A flat plate has basin 0 only.
"""

import numpy as np
from numba import njit

from thirdbody.jit.options import BARE
from thirdbody.kernels.tables import body_extra, contact_state, record

BASINS = 8
"""Most contacts of a sphere with one plate."""


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
    return -1 - BASINS < partner < 0


@njit(**BARE)
def is_upper(partner):
    """Return whether the partner is a patch of the upper plate."""
    return partner < -BASINS


@njit(**BARE)
def patch_of_partner(partner):
    """Return the row of the patch that is the partner; 0 for any other partner, to be read without a branch."""
    return max((-1 - partner) // BASINS - 1, 0)


@njit(**BARE)
def basin_of_partner(partner):
    """Return the basin of a contact with a plate."""
    return (-1 - partner) % BASINS


@njit(**BARE)
def partner_code(p, basin):
    """Return the partner code of a basin of patch p of the upper plate, or with p = -1 of the lower plate."""
    return -1 - (1 + p) * BASINS - basin


@njit(**BARE)
def order_on_sphere(partner):
    """Return the order of a contact with a plate among those of its sphere: by plate, the lower one first, then by basin."""
    return basin_of_partner(partner) + (0 if is_lower(partner) else BASINS)


@njit(**BARE)
def kind_of(k, context):
    """Return the row of the table of material pairs for candidate k: the only one where no list of them is given."""
    return np.int64(context.kind[k]) if context.kind.shape[0] > 0 else np.int64(0)


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
