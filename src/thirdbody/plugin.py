"""Public interface for plug-ins, the only module of `thirdbody` that they import.

A plug-in for laws and effects is a module with `PLUGIN = Plugin(...)`: installed under the entry-point group `thirdbody.plugins`,
or a file given to `--plugin`. `plugins/dmt_adhesion.py` is the template; `thirdbody laws --check FILE` runs the conformance suite
on it.

A measure (`Measure`) reads what contacts do and changes nothing: `plugins/effects/wear.py` is one.

A kind of debris is a class derived from `PlacedDebris`: `DEBRIS_KINDS = (Dumbbell,)` in a file given to `--plugin`, or an entry
point of the group `thirdbody.debris_kinds`, whose name is that of the kind. `thirdbody shapes --list` shows it.

Compiled kernels are cached. They are recompiled when anything changes that they depend on: the source files of the plug-in and of
modules in the same folder, every function that a kernel calls, in whichever package it is installed, and the value of every
global name that these functions use, including a table that was read from a data file. Three changes cannot be detected. Code
that a kernel calls in a shared library (ctypes, cffi): rename the function when it changes. A function compiled with
`cache=True`: numba then watches its own file only, so omit that; kernels and the functions they call are cached anyway. And a
global that is changed after the kernel was compiled: numba has compiled its value in; pass such numbers as options.
"""

from thirdbody.bodies.clump import Clump, clump, clump_with_frame
from thirdbody.debris.contract import DebrisKind, PlacedClumps, PlacedDebris, PopulationContext, RandomStreams
from thirdbody.debris.spots import Spot
from thirdbody.errors import Fault, InputError, OutputError, UsageError, nearest
from thirdbody.jit.arguments import stack_array
from thirdbody.kernels.arguments import ContactStep
from thirdbody.kernels.table import Table, number, skip, vector
from thirdbody.kernels.tables import CAN_SLIDE, CAN_STICK, DEBRIS, LOWER, NO_FORECAST, UPPER, loaded_contact, observed_body
from thirdbody.laws.contract import (
    BodyEffect,
    Labeller,
    Law,
    LawFamily,
    Material,
    Option,
    Options,
    Pair,
    Plugin,
    SpotInteraction,
    helper,
    kernel,
)
from thirdbody.laws.damping import HERTZ_DAMPING, TANGENTIAL_DAMPING
from thirdbody.laws.data import Adhesion, Body, Contact, Load, Normal, Rolling, Tangential, Turn, Twist, Twisting, Wrench
from thirdbody.laws.friction import COULOMB, MINDLIN
from thirdbody.laws.hertz import HERTZ, dundurs_beta, e_star, g_star, yield_limit
from thirdbody.laws.measures import Amount, Measure
from thirdbody.laws.renewal import RENEWAL, Renewal, moved_ground, renewal_rate, renewed
from thirdbody.rotations import matrix_from_quaternion
from thirdbody.scene.solid import Solid
from thirdbody.schema.fields import Length, PositiveLength, Quantity, Whole, listing
from thirdbody.schema.parts import Part, Wrong, one_of
from thirdbody.schema.read import read_part
from thirdbody.schema.sizes import Size
from thirdbody.statics.contacts import Contacts
from thirdbody.statics.labels import StaticLabels
from thirdbody.statics.seat import from_first_touch, in_present_posture, relax, seat
from thirdbody.statics.solver import Balance, Grip, NoStaticState, QuasiStatic
from thirdbody.units import pretty

__all__ = [
    "CAN_SLIDE", "CAN_STICK", "COULOMB", "DEBRIS", "HERTZ", "HERTZ_DAMPING", "LOWER", "MINDLIN", "NO_FORECAST", "RENEWAL",
    "TANGENTIAL_DAMPING", "UPPER", "Adhesion", "Amount", "Balance", "Body", "BodyEffect", "Clump", "Contact", "ContactStep",
    "Contacts", "DebrisKind", "Fault", "Grip", "InputError", "Labeller", "Law", "LawFamily", "Length", "Load", "Material",
    "Measure", "NoStaticState", "Normal", "Option", "Options", "OutputError", "Pair", "Part", "PlacedClumps", "PlacedDebris",
    "Plugin", "PopulationContext", "PositiveLength", "Quantity", "QuasiStatic", "RandomStreams", "Renewal", "Rolling", "Size",
    "Solid", "Spot", "SpotInteraction", "StaticLabels", "Table", "Tangential", "Turn", "Twist", "Twisting", "UsageError",
    "Whole", "Wrench", "Wrong", "clump", "clump_with_frame", "dundurs_beta", "e_star", "from_first_touch", "g_star", "helper",
    "in_present_posture", "kernel", "listing", "loaded_contact", "matrix_from_quaternion", "moved_ground", "nearest", "number",
    "observed_body", "one_of", "pretty", "read_part", "relax", "renewal_rate", "renewed", "seat", "skip", "stack_array",
    "vector", "yield_limit",
]  # fmt: skip
