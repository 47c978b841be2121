"""The contract between the engine and everything that can be plugged into it.

Signs, written once: the normal points from partner j to body i; `overlap > 0` touches; `v_n > 0` separates; a normal force
is positive when it pushes i away from j; slip and tangential velocity are those of i relative to j, and a tangential force
is the one on i, so friction opposes slip. A law lives in the contact frame: its tangential vectors have two components in a
frame that the engine carries along with the rolling and twisting pair, so history never has to be rotated by a law.

A law is made of *kernels*: plain functions of floats and named tuples, decorated with `kernel`, branch-free where possible.
They see no indices, units, files or scene. SI everywhere.

Stage by stage (`h` only for laws that name a history; then the result is `(answer, (new history...))`):

| stage | kernel | answer |
|---|---|---|
| normal | `(c, p[, h])` | `Normal` |
| adhesion | `(c, n, p[, h])` | `Adhesion` |
| damping | `(c, n, p)` | viscous normal force, N |
| tangential | `(c, load, p[, h])` | `Tangential` |
| tangential_damping | `(c, load, p)` | viscous force opposing slip per unit slip velocity, N s/m |
| rolling | `(c, turn, load, p[, h])` | `Rolling` |

A tangential law may also keep a *field*, a number of floats per contact that its options may decide. Its kernel is
`(c, load, p, h, w, w_new)`: it reads the array `w`, zeros in a virgin contact, and fills all of `w_new`; its tangent is
`(c, load, p, h, w)`. The arrays are for it alone and end with the call.

The engine clips `normal + damping` at zero (a dashpot cannot pull a dry contact back), hands that sum to the tangential stage
as the load that friction may use, adds adhesion to the total force only, and scales the viscous tangential force into what the
friction limit leaves; the same for the viscous part of a rolling moment. It computes the powers of all dashpots from the forces
and moments that really acted, and in explicit runs remembers these, as energies are then those of the mean force. `dissipated`
belongs to the force at the end of the step. A tangential law that remembers its force under the names `force_x, force_y` (a
rolling law its moment, `moment_x, moment_y`) lets the explicit integrator book friction with the mean of the forces at both
ends, which is what bodies exchange there (`kernels.explicit.contact_dissipation`); without these names the ledger of an
explicit run closes to first
order in the step where friction jumps. A tangential or rolling law that remembers what it answers as `stored` names that number
`energy`: if it is the only one with a spring, the engine keeps no column of its own for it. A moment acts on i, and turned round
on j; `turn` is the rotation of i relative to j about the two tangential axes, so that the work of the pair is moment times turn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from numba import njit

from thirdbody.dimensions import DIMENSIONS
from thirdbody.errors import nearest

STAGES = ("normal", "adhesion", "damping", "tangential", "tangential_damping", "rolling")
STIFF = ("normal", "tangential", "rolling")
"""Stages whose tangents bound the time step."""

_LAW: dict[str, Any] = {"error_model": "numpy", "forceinline": True, "no_cfunc_wrapper": True}
kernel = njit(**_LAW)
"""Decorator of every law kernel: IEEE arithmetic, inlined into the generated contact loop, which is all that C calls."""

helper: Any = njit(error_model="numpy")
"""Decorator of functions that only kernels and labellers call. Conformance runs kernels in plain Python, which calls helpers:
without a wrapper for Python that is a segmentation fault."""


class Contact(NamedTuple):
    """What the engine tells a law about one contact, SI."""

    overlap: float
    radius: float  # effective radius of curvature, 1/R = 1/R_i + 1/R_j
    mass: float  # effective mass, 1/m = 1/m_i + 1/m_j
    v_n: float  # separation speed, synchronised with the overlap
    slip_x: float  # slip during the step
    slip_y: float
    v_x: float  # slip velocity, synchronised with the overlap
    v_y: float
    roll_x: float  # way of the patch over the two surfaces during the step (their mean); 0 for a law that does not ask
    roll_y: float


class Normal(NamedTuple):
    """Answer of a normal law."""

    force: float  # N, positive in compression
    contact_radius: float  # m
    stored: float  # J
    dissipated: float  # J, during this step


class Adhesion(NamedTuple):
    """Answer of an adhesion law."""

    force: float  # N, negative where it pulls
    stored: float  # J, zero at first touch, negative in an adhesive well


class Load(NamedTuple):
    """What the normal stages hand to the tangential ones."""

    force: float  # N, the load that friction may use: elastic plus viscous, never negative
    elastic: float  # N, the normal law's force alone
    contact_radius: float  # m
    stiffness: float  # dN/dd, N/m; set only when a tangent is evaluated


class Tangential(NamedTuple):
    """Answer of a tangential law."""

    x: float  # force on i, N
    y: float
    limit: float  # N, the largest tangential force that friction allows
    critical: float  # m, displacement at which a virgin contact under this load slips throughout
    slip: float  # m, irreversible slip during this step
    stored: float  # J
    dissipated: float  # J, during this step


class Turn(NamedTuple):
    """Rotation of i relative to j about the contact frame's tangential axes, for the laws of the rolling stage."""

    x: float  # during the step
    y: float
    w_x: float  # 1/s, synchronised with the overlap
    w_y: float


class Rolling(NamedTuple):
    """Answer of a rolling law."""

    x: float  # moment on i about the frame's axes, N m
    y: float
    limit: float  # N m, the largest moment
    viscosity: float  # N m s, viscous moment per unit rate of rolling; the engine fits it into what the limit leaves
    turn: float  # irreversible rotation during this step
    stored: float  # J
    dissipated: float  # J, during this step


class Body(NamedTuple):
    """What the engine tells a body effect about one body, SI, world axes."""

    mass: float
    x: float
    y: float
    z: float
    v_x: float
    v_y: float
    v_z: float
    w_x: float
    w_y: float
    w_z: float
    inertia: float  # mean principal moment of inertia
    time: float


class Wrench(NamedTuple):
    """Answer of a body effect: force and torque about the centre of mass."""

    f_x: float
    f_y: float
    f_z: float
    t_x: float
    t_y: float
    t_z: float


@dataclass(frozen=True)
class Material:
    """Elastic half of a pair, SI."""

    name: str
    shear_modulus: float
    poisson_ratio: float
    density: float
    yield_strength: float | None = None


@dataclass(frozen=True)
class Pair:
    """Two materials that meet, and what the scene says of them."""

    a: Material
    b: Material
    friction: float
    restitution: float
    rolling: float | None = None  # coefficient of rolling resistance where the scene gives one for the pair


@dataclass(frozen=True)
class Option:
    """One value that a scene may give to a law or an effect.

    `dimension` is a name of `thirdbody.dimensions.DIMENSIONS`, such as "length" or "dimensionless"; `size` > 1 makes it a vector;
    `default=None` makes it required; values outside [low, high] are a fault. An option with `words` is one
    of them, and a number only if `or_number`. Raises ValueError for an unknown dimension.
    """

    name: str
    dimension: str
    default: float | Sequence[float] | str | None
    low: float = -float("inf")
    high: float = float("inf")
    size: int = 1
    doc: str = ""
    words: tuple[str, ...] = ()
    or_number: bool = False

    def __post_init__(self) -> None:
        if self.dimension not in DIMENSIONS:
            hint = nearest(str(self.dimension), DIMENSIONS)
            raise ValueError(f"option '{self.name}': unknown dimension '{self.dimension}', {hint}")


Options = Mapping[str, Any]


def _always(_pairs: Sequence[Pair]) -> bool:
    return True


@dataclass(frozen=True)
class Law:
    """One contact law at one stage.

    `mix(pair, options)` is plain Python, run once per material pair; it returns the kernel's parameter tuple `p`, an instance
    of `parameters`. `tangent` has the kernel's arguments and returns dN/dd (normal, adhesion) or the six numbers
    dTx/dsx, dTx/dsy, dTy/dsx, dTy/dsy, dTx/dd, dTy/dd (tangential; rolling: of moment and turn); a law without one runs in the
    explicit integrator only. `field` is the number of floats of the field, or a function of the options that gives it; a law
    that `rolls` is told the way of the patch, for history that belongs to the material under it. `wanted(pairs)` says whether
    these materials call for the law at all: if not, it is absent from the compiled code. `variant(options)` may give another law
    that stands for this one under these options, one with more history for instance, or None.
    """

    name: str
    stage: str
    kernel: Callable
    parameters: type
    mix: Callable[[Pair, Options], Any]
    source: str
    options: tuple[Option, ...] = ()
    history: tuple[str, ...] = ()
    tangent: Callable | None = None
    wanted: Callable[[Sequence[Pair]], bool] = _always
    field: int | Callable[[Options], int] = 0
    rolls: bool = False
    variant: Callable[[Options], Law | None] | None = None

    def memory(self) -> tuple[str, ...]:
        """Names of all floats that are kept per contact: the history, then the field."""
        if callable(self.field):
            raise ValueError(f"the size of the field of '{self.name}' depends on its options: see `sized`")
        return self.history + tuple(f"field[{i}]" for i in range(self.field))

    def sized(self, options: Options) -> Law:
        """The law, or its variant, with the size of its field for these options."""
        law = (self.variant(options) if self.variant else None) or self
        return replace(law, field=law.field(options)) if callable(law.field) else law


@dataclass(frozen=True)
class BodyEffect:
    """A force and torque on every body: `kernel(body, p) -> Wrench`.

    One that `sees_forces` is `kernel(body, total, p)`, with the force and torque of all contacts and of all effects that do not.
    One that is for `settling` acts until the upper plate is set in motion; a scene without such a phase is refused.
    """

    name: str
    kernel: Callable
    parameters: type
    mix: Callable[[Options], Any]
    source: str
    options: tuple[Option, ...] = ()
    sees_forces: bool = False
    settling: bool = False


@dataclass(frozen=True)
class Labeller:
    """Tags every body with a state, the reason, and margins.

    `observe(contacts, n, body, memory)` runs every `stride` steps and `label(contacts, n, body, memory, out)` at output
    frames, on a copy of the memory, so that output changes nothing. Columns: `loaded_contact` for contacts and `observed_body`
    for the body (`thirdbody.plugin`). `out` holds state, reason, then `margins`, then `extras`. `memory` and `contact_memory`
    name the floats that the engine keeps per body and per contact, zero at the start. `label_without_effects` may be a variant
    of `label` that compiles faster: it is taken where no effect acts on bodies.
    """

    name: str
    observe: Callable
    label: Callable
    states: tuple[str, ...]
    reasons: tuple[str, ...]
    margins: tuple[str, ...]
    extras: tuple[str, ...]
    memory: tuple[str, ...]
    contact_memory: tuple[str, ...]
    source: str
    stride: int = 8
    codes: tuple[str, ...] = ()  # extras that are small whole numbers
    label_without_effects: Callable | None = None


@dataclass(frozen=True)
class LawFamily:
    """A name that a scene can give as `law`, and its levels: which laws stand behind each."""

    name: str
    levels: Mapping[str, tuple[Law, ...]]
    default_level: str
    labeller: Labeller | None = None
    source: str = ""


@dataclass(frozen=True)
class Plugin:
    """Everything that one plug-in brings but its commands, which are entry points of the group `thirdbody.commands`: a
    function for typer, imported only when it is called."""

    name: str
    families: tuple[LawFamily, ...] = ()
    effects: tuple[Law | BodyEffect, ...] = ()
    source: str = ""
