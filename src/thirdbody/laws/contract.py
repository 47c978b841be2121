"""The contract between the engine and everything that can be plugged into it.

Signs, stated once: the normal points from partner j to body i; `overlap > 0` is contact; `v_n > 0` is separation; a normal force
is positive when it pushes i away from j; slip and tangential velocity are those of i relative to j, and a tangential force is the
one on i, so friction opposes slip. A law works in the contact frame: its tangential vectors have two components in a frame that
the engine rotates with the rolling and twisting pair, so no law ever has to rotate its history.

A law consists of *kernels*: plain functions of floats and named tuples, decorated with `kernel`, branch-free where possible. They
see no indices, units, files or scene. All quantities are in SI units.

Arguments and results of the kernels by stage: README.md of the plug-ins, "A law in one file".

A tangential law may also have a *field*: floats per contact, whose number its options may determine. Its kernel is `(c, load, p,
h, w, w_new)`: it reads the array `w`, zeros in a virgin contact, and fills all of `w_new`; its tangent is `(c, load, p, h, w)`.
The arrays are private to the law and valid during the call only.

Bodies act on each other from first touch on (overlap > 0), unless a normal or adhesion law has a `reach`: its kernel then sees
overlaps down to minus the reach, and returns no force and no energy from there outward; all other laws see an overlap of zero
where it is negative. A time step must resolve the reach. `balance` refuses such laws, and the implicit integrator
on rough plates.

Friction feels the sum of the normal stages, and `added_load(c, n, p)` [N] of a normal or adhesion law, which must not depend on
the overlap: adhesion presses the surfaces together. The engine clips `normal + damping` at zero (a dashpot cannot pull in a dry
contact; where a normal law with a reach attracts, it cannot add to the attraction), passes that sum to the tangential stage, adds
adhesion to the total force only, and returns the sum of spring and dashpot to the friction limit; likewise of moments.

It computes the power of all dashpots from the forces and moments that actually acted. `dissipated` belongs to the force at the
end of the step. If a tangential law stores its force as history `force_x, force_y` (a rolling law its moment as `moment_x,
moment_y`, a twisting law as `moment`), the explicit integrator computes the friction work with the mean of the forces at both
ends of the step, which is the work that the bodies exchange (`kernels.books`); without these names the ledger of an explicit run
closes only to first order in the step where friction jumps. A law whose history contains the value it returns as `stored` names
it `energy`: if no other law has a spring, the engine needs no column for it. A moment acts on i, and with opposite sign on j;
`turn` is the rotation of i relative to j about the two tangential axes, `twist` that about the normal. A normal law that
dissipates names what its contact has dissipated since it closed `plastic_work` or `adhesion_work` in its history: the engine
then keeps that per body, and apart from friction in the ledger.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from numba import njit

from thirdbody.errors import nearest
from thirdbody.kernels.table import Column
from thirdbody.units import DIMENSIONS

STAGES = ("normal", "adhesion", "damping", "tangential", "tangential_damping", "rolling", "twisting")
STIFF = ("normal", "tangential", "rolling", "twisting")  # stages whose tangents bound the time step

_LAW: dict[str, Any] = {"error_model": "numpy", "forceinline": True, "no_cfunc_wrapper": True}
kernel = njit(**_LAW)
"""Decorator of every law kernel: IEEE arithmetic, inlined into the generated contact loop, the only entry point from C."""

helper: Any = njit(error_model="numpy")
"""Decorator of functions called only by kernels and labellers. The conformance suite runs kernels in plain Python, which calls
helpers: without a Python wrapper that would be a segmentation fault."""


@dataclass(frozen=True)
class Material:
    """Elastic material of one side of a contact, SI."""

    name: str
    shear_modulus: float
    poisson_ratio: float
    density: float
    yield_strength: float | None = None
    thermal_conductivity: float | None = None
    heat_capacity: float | None = None


@dataclass(frozen=True)
class Pair:
    """Two materials in contact, and their properties given by the scene."""

    a: Material
    b: Material
    friction: float
    restitution: float
    rolling_friction: float | None = None
    work_of_adhesion: float | None = None


PAIR_KEYS = ("rolling_friction", "work_of_adhesion")
"""Keys of [[pairs]], and fields of `Pair`, that replace an option of an effect for one pair (`Option.pair_key`)."""


@dataclass(frozen=True)
class Option:
    """Option of a law or an effect, set in the scene.

    `dimension` is a name of `thirdbody.units.DIMENSIONS`, such as "length" or "dimensionless"; `size` > 1 makes it a vector;
    `default=None` makes it required; values outside [low, high] are rejected. With `words` the value must be one of them; with
    `or_number` it may be a number, too. `pair_key` is the key of [[pairs]] that replaces it for a pair (PAIR_KEYS); where every
    pair has that key, the option may be left out. Raises ValueError for an unknown dimension or key of pairs."""

    name: str
    dimension: str
    default: float | Sequence[float] | str | None
    low: float = -float("inf")
    high: float = float("inf")
    size: int = 1
    doc: str = ""
    words: tuple[str, ...] = ()
    or_number: bool = False
    pair_key: str = ""

    def __post_init__(self) -> None:
        if self.dimension not in DIMENSIONS:
            hint = nearest(str(self.dimension), DIMENSIONS)
            raise ValueError(f"option '{self.name}': unknown dimension '{self.dimension}', {hint}")
        if self.pair_key and self.pair_key not in PAIR_KEYS:
            raise ValueError(f"option '{self.name}': unknown key of pairs '{self.pair_key}', {nearest(self.pair_key, PAIR_KEYS)}")


Options = Mapping[str, Any]


class Checked:
    """Part of a plug-in: refuses a field that is no tuple of its type, such as `(OPTION)` without its comma."""

    TUPLES: ClassVar[dict[str, type | tuple[type, ...]]] = {}
    name: str

    def __post_init__(self) -> None:
        """Raise TypeError."""
        for field, kinds in self.TUPLES.items():
            value = getattr(self, field)
            if not isinstance(value, tuple):
                raise TypeError(
                    f"{field} of '{self.name}': expected a tuple, as ({field.upper().rstrip('S')},), not {value!r:.80}"
                )
            for wrong in (each for each in value if not isinstance(each, kinds)):
                raise TypeError(f"{field} of '{self.name}': {type(wrong).__name__} {wrong!r:.80} does not belong there")


@dataclass(frozen=True)
class Law(Checked):
    """One contact law at one stage.

    `mix(pair, options)` is plain Python, run once per material pair, with the options of that pair (`options_of`); it returns
    the kernel's parameter tuple `p`, an instance of `parameters`. `tangent` has the kernel's arguments and returns dN/dd
    (normal, adhesion) or the six derivatives dTx/dsx, dTx/dsy, dTy/dsx, dTy/dsy, dTx/dd, dTy/dd (tangential; rolling: of moment
    and turn) or the two dM/d(angle), dM/dd (twisting); a law without one runs in the explicit integrator only. `field` is the
    number of floats of the field, or a function of the options that returns it; a law that `rolls` receives the travel of the
    contact area, for history that belongs to the material under it. `wanted(pairs)` returns whether these materials need the
    law; if not, it is absent from the compiled code. `variant(options)` may return another law that replaces this one under
    these options, one with more history for instance, or None. `assumes` is the name of the normal law that the law is derived
    for; it is refused under another one. `replaces` is the name of the law of a level whose place an effect takes. `reach(pair,
    options, radius)` is the distance [m] before touch where a normal or adhesion law begins to act between bodies of at most
    this effective radius [m]; it must not fall with the radius. `added_load(c, n, p)` is the load [N] that friction feels
    beyond the sum of the normal stages. `pull_off(pair, options, radius)` are the forces [N] that part contacts of effective
    radii (n,) [m]: bodies whose contact pushes with less hang together (`agglomerate`). `remark(pair, options, low, high)` is
    what `check` says of a pair between these effective radii [m], and whether that is a warning. `in_steps(p, integrator)`
    returns the parameters of a pair in explicit or implicit steps, of a normal law whose force jumps: see
    `plugins/effects/adhesion.py`. The engine does what is needed for an adhesion law that acts from touch on (`laws.tile_law`).
    """

    TUPLES = {"options": Option, "history": str}

    name: str
    stage: str
    kernel: Callable
    parameters: type
    mix: Callable[[Pair, Options], Any]
    source: str
    options: tuple[Option, ...] = ()
    history: tuple[str, ...] = ()
    tangent: Callable | None = None
    wanted: Callable[[Sequence[Pair]], bool] = lambda pairs: True
    field: int | Callable[[Options], int] = 0
    rolls: bool = False
    variant: Callable[[Options], Law | None] | None = None
    assumes: str = ""
    replaces: str = ""
    reach: Callable[[Pair, Options, float], float] | None = None
    added_load: Callable | None = None
    pull_off: Callable[[Pair, Options, Any], Any] | None = None
    remark: Callable[[Pair, Options, float, float], tuple[str, bool]] | None = None
    in_steps: Callable[[Any, str], Any] | None = None

    def memory(self) -> tuple[str, ...]:
        """Names of all floats stored per contact: the history, then the field."""
        if callable(self.field):
            raise ValueError(f"the size of the field of '{self.name}' depends on its options: see `sized`")
        return self.history + tuple(f"field[{i}]" for i in range(self.field))

    def sized(self, options: Options) -> Law:
        """Return the law, or its variant, with the size of its field for these options."""
        law = (self.variant(options) if self.variant else None) or self
        return replace(law, field=law.field(options)) if callable(law.field) else law

    def options_of(self, pair: Pair, options: Options) -> Options:
        """Return the options for a pair of materials: values that the pair has of its own replace those of all pairs."""
        own = {option.name: getattr(pair, option.pair_key) for option in self.options if option.pair_key}
        return {**options, **{name: value for name, value in own.items() if value is not None}}


@dataclass(frozen=True)
class BodyEffect(Checked):
    """A force and torque on every body: `kernel(body, p) -> Wrench`.

    With `sees_forces` the kernel is `kernel(body, total, p)`, where `total` is the force and torque of all contacts and of all
    effects without `sees_forces`. With `settling` it acts until the upper plate is set in motion; a scene without such a phase is
    rejected."""

    TUPLES = {"options": Option}

    name: str
    kernel: Callable
    parameters: type
    mix: Callable[[Options], Any]
    source: str
    options: tuple[Option, ...] = ()
    sees_forces: bool = False
    settling: bool = False


@dataclass(frozen=True)
class SpotInteraction(Checked):
    """Elastic interaction through a plate between the spots of a body on it, solved for all of them at once.

    A spot with the normal force N lowers the plate at the distance r by `compliance(material, options)` N/r, with the material of
    the plate [m2/N]; `stiffness(pair, options)` is N/(R d^3)^(1/2) of a spot alone [Pa]. So it holds for Hertz' contact, flat
    plates and chains without adhesion; anything else is refused (`kernels.close_spots`)."""

    TUPLES = {"options": Option}

    name: str
    compliance: Callable[[Material, Options], float]
    stiffness: Callable[[Pair, Options], float]
    source: str
    options: tuple[Option, ...] = ()


SUM, MEAN, MAXIMUM = KINDS = ("sum", "mean", "maximum")
"""How an amount is collected: summed over the steps; its mean over the time of the drag (before it, of settling) in
which its contacts are closed; its maximum."""


@dataclass(frozen=True)
class Amount:
    """One number that a measure returns for each contact and step, with its unit and meaning.

    `kind`: "sum", "mean" or "maximum". `of_plate`: a sum that belongs to the plate at the contact, not to the body: bodies then
    have it as `NAME_lower` and `NAME_upper`, and contacts between bodies do not count. `map`: name and unit of its density over
    the surface of a plate; for sums of a plate only. A maximum is also written per contact, since the contact closed."""

    name: str
    unit: str
    doc: str
    kind: str = SUM
    of_plate: bool = False
    map: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"amount '{self.name}': kind '{self.kind}' is not one of {', '.join(KINDS)}")
        if (self.of_plate or self.map) and self.kind != SUM:
            raise ValueError(f"amount '{self.name}': only a sum can belong to a plate")
        if self.map and not self.of_plate:
            raise ValueError(f"amount '{self.name}': a map is of an amount that belongs to a plate")


@dataclass(frozen=True)
class Measure(Checked):
    """A measure: `kernel(s, p)` returns a tuple of floats, one per amount.

    `mix(pair, options)` is plain Python, run once per material pair; it returns `p`, an instance of `parameters`. `materials`:
    names of the optional keys of materials that it needs, which a scene that names it must give. `warnings(means)` gets the
    largest value of each amount over the bodies at the end of a run, by name, and returns texts for the user."""

    TUPLES = {"amounts": Amount, "options": Option, "materials": str}

    name: str
    kernel: Callable
    parameters: type
    mix: Callable[[Pair, Options], Any]
    amounts: tuple[Amount, ...]
    source: str
    options: tuple[Option, ...] = ()
    materials: tuple[str, ...] = ()
    warnings: Callable[[dict[str, float]], list[str]] | None = None


@dataclass(frozen=True)
class Labeller(Checked):
    """Classifies every body: a state, a reason, and margins.

    `observe(contacts, n, body, memory)` runs every `stride` steps and `label(contacts, n, body, memory, out)` at output frames,
    on a copy of the memory, so that output changes nothing. Columns: `loaded_contact` for contacts and `observed_body` for the
    body (`thirdbody.plugin`). `out` holds state, reason, then `margins`, then `extras`. `memory` and `contact_memory` name the
    floats that the engine stores per body and per contact, initially zero. `label_without_effects` is an optional variant of
    `label` that compiles faster, used where no effect acts on bodies. `label_without_forecasts` is one that leaves out the extras
    `forecasts`, used where a run writes none of them."""

    TUPLES = dict.fromkeys("states reasons margins extras memory contact_memory codes forecasts".split(), str)

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
    codes: tuple[str, ...] = ()  # extras that are small integers
    outputs: Iterable[Column] = ()  # unit and meaning of margins and extras, for `thirdbody keys`
    label_without_effects: Callable | None = None
    label_without_forecasts: Callable | None = None
    forecasts: tuple[str, ...] = ()
    words: Mapping[str, str] | None = None  # what states and reasons mean, for legends of pictures

    def meanings(self) -> dict[str, str]:
        """Return what states, reasons, margins (as `margin_NAME`) and extras mean, as far as the labeller tells it."""
        names = {f"margin_{name}": name for name in self.margins} | {name: name for name in self.extras}
        known = {column.name: column.meaning for column in self.outputs}
        return dict(self.words or {}) | {name: known[column] for name, column in names.items() if column in known}


@dataclass(frozen=True)
class LawFamily:
    """Value of `law` in a scene, and its levels: the laws of each level."""

    name: str
    levels: Mapping[str, tuple[Law, ...]]
    default_level: str
    labeller: Labeller | None = None
    source: str = ""


@dataclass(frozen=True)
class Plugin(Checked):
    """Everything that one plug-in provides except commands, which are entry points of the group `thirdbody.commands`."""

    TUPLES = {"families": LawFamily, "effects": (Law, BodyEffect, SpotInteraction), "measures": Measure}

    name: str
    families: tuple[LawFamily, ...] = ()
    effects: tuple[Law | BodyEffect | SpotInteraction, ...] = ()
    measures: tuple[Measure, ...] = ()
    source: str = ""
