"""Arguments of kernels that travel together.

Kernels of both integrators take a `context` (tables and numbers of the run: `signatures.Context`, or the implicit bundle with
fields of the same names), a `motion` (anything with the fields of `Motion`) and a `Tile`. Numba resolves fields by name when it
compiles, so a kernel may get any bundle that has the fields it uses.
"""

from typing import NamedTuple

import numpy as np

Array = np.ndarray


class Motion(NamedTuple):
    """Length of a step [s] and mean velocity of the upper plate in it, along x and y [m/s]."""

    dt: float
    v_x: float
    v_y: float


class Step(NamedTuple):
    """A step of the explicit integrator; usable as a `Motion`."""

    number: int | np.int64
    """Number within this call of the step loop."""
    record: bool
    """Whether output or labels need this step."""
    time: float
    """Time at the end of the step [s]."""
    dt: float
    v_x: float
    v_y: float
    pending: float
    """1: the closing half kick of the last step is pending; 0: it is done."""
    turn: float
    """Time for which the spins of single spheres rotate them in this step [s]; mostly 0 (`kernels.sphere_rotation`)."""


class Tile(NamedTuple):
    """Contacts side by side, field by field (stride `tile.TILE`)."""

    inputs: Array
    """`law_input`"""
    outputs: Array
    """`law_output`"""
    tangents: Array
    """`contact_tangent`; empty in explicit steps."""
    geometry: Array
    """`geometry`"""


class Box(NamedTuple):
    """Periodic lengths of the domain [m], 0 where it is not periodic, and their inverses, or 0 (`kernels.periodic`)."""

    length_x: float
    length_y: float
    inverse_x: float
    inverse_y: float
    reach: float
    """Distance from touch at which bodies begin to act on each other [m]."""
