"""Arguments of kernels that travel together, and signatures of functions that are called through a pointer.

Kernels of both integrators take a `context` (tables and numbers of the run: `arguments.Context`, or the implicit bundle with
fields of the same names), a `motion` (anything with the fields of `Motion`) and a `Tile`. Numba resolves fields by name when it
compiles, so a kernel may get any bundle that has the fields it uses.
"""

from collections import namedtuple
from typing import NamedTuple

import numpy as np
from numba import types

from thirdbody.jit.arguments import Kinds, Unpacked, make_unpacker, make_view


class ContactStep(
    namedtuple("ContactStep", "load force limit slip speed friction_work contact_radius peak_pressure overlap dt plate")
):
    """What a contact did in a step, input of measures.

    Attributes
    ----------
    load : float
        Load that friction feels, at the end of the step [N]; 0 in the step in which the contact opens.
    force, limit : float
        Size of the tangential force, and its limit by friction [N].
    slip, speed : float
        Irreversible slip in the step [m], and that over the length of the step [m/s].
    friction_work : float
        Dissipated by friction in the step, as booked in the energy ledger [J].
    contact_radius : float
        Radius of the contact area [m].
    peak_pressure : float
        Largest pressure in the contact area [Pa].
    overlap : float
        Overlap [m].
    dt : float
        Length of the step [s]; 0 in the step in which the contact opens.
    plate : float
        1 where the partner is a plate, 0 where it is another body.
    """


Motion = namedtuple("Motion", "dt v_x v_y")  # length of a step [s] and mean velocity of the upper plate in it [m/s]


class Step(NamedTuple):
    """A step of the explicit integrator; usable as a `Motion`."""

    number: int | np.int64  # within this call of the step loop
    record: bool  # output or labels need it
    time: float  # at its end [s]
    dt: float
    v_x: float
    v_y: float
    pending: float  # 1: the closing half kick of the last step is pending, 0: it is done
    turn: float  # time for which the spins of single spheres rotate them in this step [s], mostly 0 (`kernels.bodies`)


Tile = namedtuple("Tile", "inputs outputs tangents geometry")
"""Contacts side by side, field by field (stride `tile.TILE`): `law_input`, `law_output`, `contact_tangent` (empty in explicit
steps), `geometry`."""

Box = namedtuple("Box", "length_x length_y inverse_x inverse_y reach")
"""Periodic lengths of the domain [m], 0 where it is not periodic, and their inverses, or 0 (`kernels.vectors`); distance from
touch at which bodies begin to act on each other [m]."""

_TABLE = types.Array(types.float64, 2, "C")
_ROW = types.Array(types.float64, 1, "C")
_I, _I1, _S1 = types.int64, types.Array(types.int64, 1, "C"), types.Array(types.int32, 1, "C")

LAW = types.void(_ROW, _ROW, types.int64, _ROW)
"""law(inputs, outputs, number of contacts in the tile, parameters of all pairs)"""

EFFECTS = types.void(_TABLE, _TABLE, types.int64, types.int64, types.float64, types.float64, _ROW)
"""effects(bodies, body_extra, first, last, time, time step, parameters)"""

OBSERVE = types.void(_TABLE, types.int64, _ROW, _ROW)  # observe(contacts of the body, their number, body, memory)
LABEL = types.void(_TABLE, types.int64, _ROW, _ROW, _ROW)  # label(contacts of the body, their number, body, memory, out)

MEASURE = types.void(types.NamedUniTuple(types.float64, len(ContactStep._fields), ContactStep), _I, _TABLE, _I, _I, _ROW)
"""measure(what the contact did, row of the pair, histories, candidate, first column of the measures, parameters)"""

_S2 = types.Array(types.int32, 2, "C")

OBSERVED: Kinds = {
    **dict.fromkeys(("own", "partner", "edges", "incidence"), _S1),
    **dict.fromkeys(("B", "E", "orientations", "H", "R", "M"), _TABLE), "drag": _ROW, "n_history": _I, "width": _I,
}  # fmt: skip
"""Types of what a labeller sees of bodies and candidates: the first arguments of the steps of both integrators."""

Observed = namedtuple("Observed", tuple(OBSERVED))  # type: ignore[misc]

KINDS: Kinds = {
    **OBSERVED,
    # candidates and their schedule (`engine.state`)
    **dict.fromkeys(("kind", "outer", "near", "beginning"), _S1),
    "remote_body": _S1, "remote_row": _S1, "closed": types.Array(types.int8, 1, "C"),
    "cuts": _S2, "lowest": _S1, "needs": _S1, "force_rows": _S1,
    # spheres and their bodies
    "body": _I1, "start": _I1, "offsets": _TABLE, "X0": _TABLE, "patch": _I1,
    # state (`tables`), parameters, sums of a step
    **dict.fromkeys(("S", "forces", "P", "Q", "F"), _TABLE),
    "pairs": _ROW, "interaction": _ROW,
    "effect_parameters": _ROW, "D": _ROW, "A": _ROW, "ledgers": _TABLE, "sums": _TABLE, "moves": _TABLE,
    # surfaces of the plates (`kernels.height_field`), empty where they are flat
    "lower": _ROW, "upper": _ROW,
    # contact of the first bodies (`kernels.contact_zone`), empty without a pressure profile
    "zone": _ROW,
    # lateral motion of the upper plate (`kernels.drive`), empty where it follows its schedule
    "spring": _ROW,
    # prescribed motion (`kernels.schedule`) and its planned direction; scratch of each part
    "schedule": _TABLE, "first": _I1,
    "scratch": _TABLE, "marks": _S2, "rows": types.Array(types.float64, 3, "C"), "moved": _S1,
    # the threads of this run (`jit.threads`), and the pass that they work on: its number, then the fields of `Step`
    "team": _I1, "announced": _ROW,
    # columns of the laws' history, from `contact_state.LAW` on: the field (`memory`), and what books need, -1 where no law has it
    **dict.fromkeys(("field_begin", "field_size", "force", "moment", "twist", "stored", "dashpots", "loss_column"), _I),
    # numbers, and addresses of functions
    "rolling": _I, "jumps": _I,
    **dict.fromkeys(("has_effects", "stride", "labels", "law", "effects", "observe", "observe_bodies", "run_groups"), _I),
    "update_surfaces": _I,
    # measures: columns of a contact (0: none), address, parameters
    "measured": _I, "measure": _I, "measure_parameters": _ROW,
}  # fmt: skip
"""Types of all arguments of a step, by name."""

Context = namedtuple("Context", tuple(KINDS))  # type: ignore[misc]
"""All arguments of a step; the step loop and its passes unpack it from an array (`jit.arguments`)."""

context_of = make_unpacker(Unpacked(KINDS, Context))  # unpack the array

_F = types.float64
STEP = types.NamedTuple((_I, types.boolean, _F, _F, _F, _F, _F, _F), Step)
OBSERVED_TYPE = Unpacked(OBSERVED, Observed)
observed_of, as_observed = make_unpacker(OBSERVED_TYPE), make_view(OBSERVED_TYPE)
"""observed_of(packed): the `Observed` in an array of int64; as_observed(context): that in the arguments of a step."""

OBSERVE_BODIES = types.void(_I, _I, OBSERVED_TYPE, _ROW, _I, _ROW, _TABLE)
"""observe_bodies(first, last, observed, totals, address of the labeller's function, scratch: row of a body, its contacts)"""

RUN_GROUPS = types.void(_I, _I, _I, _I, STEP, _I1)  # (pass, part, first group, last group + 1, step, the packed `Context`)

EARLY, SWEEP, LATE, OBSERVATION = range(4)
"""Passes of a step. The sweep goes through its groups once and does all that a group needs; with several parts, bodies that
others need are drifted early, and those with remote forces are kicked late. In sampled steps the labeller observes."""
