"""The tables of a scene other than the debris: materials, pairs, plates, contact, effects, solver."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from thirdbody.scene.motion import Loading, Motion
from thirdbody.scene.pressure import Pressure, Profile
from thirdbody.scene.solid import Solid
from thirdbody.scene.surfaces import Surface
from thirdbody.schema.fields import (
    THREE,
    Count,
    Flag,
    Force,
    Fraction,
    PositiveLength,
    PositiveMass,
    PositiveNumber,
    PositivePressure,
    PositiveTime,
    Quantity,
    Speed,
    Text,
    TwoPositiveLengths,
    listing,
)
from thirdbody.schema.parts import MISSING, Part, Wrong, entry, one_of


class Material(Solid):
    """An isotropic elastic solid; pressures [Pa], density [kg/m3]."""

    density: Annotated[float, Quantity(dimension="density", gt=0)]
    """Density. Example: "7850 kg/m3"."""
    yield_strength: PositivePressure | None = None
    """Yield strength, for first yield and plastic flow; by default 0.01 of Young's modulus. Example: "250 MPa"."""
    thermal_conductivity: Annotated[float, Quantity(dimension="thermal_conductivity", gt=0)] | None = None
    """Thermal conductivity, for measures of heat. Example: "50 W/m/K"."""
    heat_capacity: Annotated[float, Quantity(dimension="heat_capacity", gt=0)] | None = None
    """Specific heat capacity, for measures of heat. Example: "460 J/kg/K"."""


class PairTable(Part):
    """Contact parameters of two materials, or of one with itself; there is no mixing rule."""

    between: Annotated[tuple[Text, Text], listing("a list of 2 materials", 2)]
    """The two materials in either order, or one name twice. Example: ["steel", "bronze"]."""
    friction: Annotated[float, Quantity(ge=0)]
    """Friction coefficient. Example: 0.3."""
    restitution: Annotated[float, Quantity(ge=1e-6, le=1)]
    """Coefficient of restitution along the normal, the same at every speed. It holds for one contact. On n contacts
    at once damping is sqrt(n) times as large: 0.6 becomes 0.50 on two and 0.31 on seven. Example: 0.6."""
    rolling_friction: Annotated[float, Quantity(ge=0, le=1)] | None = None
    """Coefficient of rolling resistance of this pair, instead of that of the effect. Example: 0.05."""
    work_of_adhesion: Annotated[float, Quantity(dimension="energy_per_area", ge=0)] | None = None
    """Work of adhesion of this pair, instead of that of the effect. Example: "20 mJ/m2"."""


class Domain(Part):
    """Extent in x and y [m]."""

    size: TwoPositiveLengths
    """Extent along x and y. Example: ["600 um", "400 um"]."""
    periodic: Flag = True
    """Whether bodies re-enter at the opposite side; if not, one that leaves the lower plate stops the run. Example: false."""
    walls: Literal["y"] | None = None
    """"y": flat side walls at both ends of y, at rest, of the material of the lower plate. The domain is then periodic in x only.
    Needs the explicit integrator. Example: "y"."""
    ends: Literal["closed", "open", "open_x"] = "closed"
    """"open", with periodic = false: the lower plate goes on beyond the domain. "open_x", with periodic = true: along x only, and
    y stays periodic. Example: "open"."""

    @property
    def wraps(self) -> bool:
        """Whether bodies may be placed across all ends of the domain."""
        return self.periodic and self.walls is None and self.ends == "closed"

    @property
    def bounded(self) -> bool:
        """Whether a body that leaves the domain stops the run."""
        return not self.periodic and self.ends == "closed"

    def checks(self) -> list[Wrong]:
        if self.ends == "open_x" and (not self.periodic or self.walls):
            return [(("ends",), '"open_x" needs periodic = true, and no walls')]
        return [(("ends",), '"open" needs periodic = false')] if self.ends == "open" and self.periodic else []


class LowerPlate(Part):
    """The plate at z = 0, at rest."""

    material: Text
    """Material of the plate. Example: "steel"."""
    surface: Surface | None = None
    """Heights above the plane of the plate: random (`rms`), waves and grooves (`wave`), or measured (`file`).
    Example: {rms = "0.2 um", long = "20 um", short = "2 um"}."""


_LOADINGS = ("load", "pressure", "gap")


class UpperPlate(Part):
    """The upper plate: its support and load [N], pressure on the domain's area [Pa], or gap between the surfaces [m]."""

    material: Text
    """Material of the plate. Example: "steel"."""
    support: Literal["rigid", "foundation", "load_per_particle"] = "rigid"
    """"rigid": one plate; "load_per_particle": one patch per body, each with the load; "foundation": patches on springs below a
    common plate. Example: "foundation"."""
    load: Annotated[float, Quantity(dimension="force", gt=0)] | None = None
    """Load on the plate, or on each patch ("load_per_particle"); give load, pressure or gap. Example: "0.1 mN"."""
    pressure: Pressure | None = None
    """Pressure on the area of the domain; as a table, with "load_per_particle", that of a punch, a ball, a cylinder or a map.
    Example: "2.5 MPa"."""
    gap: PositiveLength | None = None
    """Constant distance between the surfaces of the plates; with a foundation to the common plate. Example: "12 um"."""
    closing: Speed | None = None
    """Speed at which the gap shrinks. Example: "1 mm/s"."""
    loading: Loading | None = None
    """Change of the load after settling, a stage or a list; the last load stays. Example: {load = "1 mN", duration = "1 us"}."""
    stiffness: Annotated[float, Quantity(dimension="stiffness", gt=0)] | None = None
    """Spring stiffness of each patch of a foundation; required there. Example: "200 N/m"."""
    preload: Force | None = None
    """Load on each patch of a foundation beside its spring, in addition to `load`. Example: "10 uN"."""
    motion: Motion = Motion()
    surface: Surface | None = None
    """As for the lower plate, with heights towards the debris; moves with the plate.
    Example: {file = "scan.x3p", short = "2 um"}."""
    mass: PositiveMass | None = None
    """Mass of the plate or of each patch; by default that of all debris, or of the mean body. Example: "1e-11 kg"."""
    damping: Annotated[float, Quantity(dimension="damping", ge=0)] | None = None
    """Dashpot of the plate or of each patch; by default critical damping with the contact stiffness. Example: "7e-5 kg/s"."""

    @property
    def profile(self) -> Profile | None:
        """Pressure profile, of a contact with an edge."""
        return self.pressure if isinstance(self.pressure, Profile) else None

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        faults = one_of(raw, _LOADINGS)
        has_profile = isinstance(raw.get("pressure"), Mapping | Profile)
        if has_profile and raw.get("support") != "load_per_particle":
            faults.append((("support",), "a pressure profile needs support = 'load_per_particle'"))
        if has_profile and "loading" in raw:
            faults.append((("loading",), "a pressure profile does not change with time"))
        if raw.get("support") == "load_per_particle" and not faults and "load" not in raw and not has_profile:
            given = next(key for key in _LOADINGS if key in raw)
            faults.append(((given,), "support = 'load_per_particle' takes a load, not a " + given))
        if "closing" in raw and "gap" not in raw:
            faults.append((("closing",), "needs a gap to start from"))
        if "loading" in raw and "gap" in raw:
            faults.append((("loading",), "changes a load, and a plate at a gap has none"))
        if raw.get("support") == "foundation" and "stiffness" not in raw:
            faults.append((("stiffness",), f'{MISSING}: the stiffness of each particle\'s patch, such as "1e4 N/m"'))
        if raw.get("support") != "foundation":
            faults += [((key,), "belongs to support = 'foundation'") for key in ("stiffness", "preload") if key in raw]
        return faults


class DirectContact(Part):
    """Direct contact of the plates: pressure beta E* exp(-u/u0) at a mean gap u, on the area of the domain, and its friction.

    E* is that of the materials of the two plates. On a foundation u is the gap of the common plate: where bodies push its patches
    up, the plate gives way, and touches elsewhere.
    """

    beta: PositiveNumber | None = None
    """Pressure at zero gap over E*; by default estimated from the surfaces. Example: 0.5."""
    u0: PositiveLength | None = None
    """Gap over which the pressure falls by a factor e; by default estimated from the surfaces. Example: "0.2 um"."""
    friction: Annotated[float, Quantity(ge=0)]
    """Friction coefficient between the plates. Example: 0.1."""

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        given = [key for key in ("beta", "u0") if key in raw]
        other = "u0" if given == ["beta"] else "beta"
        return [((given[0],), f"needs {other} too, or neither, to estimate both from the surfaces")] if len(given) == 1 else []


class PlateWear(Part):
    """Wear that changes the surfaces of both plates: from time to time the depth that `measures.wear` has mapped since the last
    time is taken from their heights. A plate without `surface` gets one of zero height.
    """

    cycles: Count | None = None
    """Number of cycles of the motion after which depth is taken; give it or `distance`. Example: 1."""
    distance: PositiveLength | None = None
    """Sliding distance after which depth is taken. Example: "50 um"."""
    times: PositiveNumber = 1.0
    """Factor of the depth: 1000 lets each cycle wear as much as a thousand. Example: 1000."""

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        return one_of(raw, ("cycles", "distance"))


class Plates(Part):
    """None, the lower plate, or both, their direct contact, and wear that changes them."""

    lower: LowerPlate | None = None
    upper: UpperPlate | None = None
    contact: DirectContact | None = None
    wear: PlateWear | None = None

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        alone = "upper" in raw and "lower" not in raw
        faults: list[Wrong] = [(("upper",), "an upper plate needs a lower one: add [plates.lower]")] if alone else []
        upper = raw.get("upper")
        if raw.get("wear") is not None and upper is None:
            faults.append((("wear",), "counts cycles or sliding of an upper plate: add [plates.upper]"))
        if raw.get("contact") is None:
            return faults
        if upper is None:
            return [*faults, (("contact",), "needs both plates: add [plates.lower] and [plates.upper]")]
        has_profile = isinstance(entry(upper, "pressure"), Mapping | Profile)
        if has_profile and (given := [key for key in ("beta", "u0") if entry(raw["contact"], key) is not None]):
            faults.append(
                (("contact", given[0]), "is of plates at a gap: under a pressure profile the plates carry what debris does not")
            )
        if entry(upper, "support") == "load_per_particle" and not has_profile:
            faults.append((("contact",), "shares the load of one plate: plates.upper.support = 'rigid' or 'foundation'"))
        if entry(upper, "gap") is not None:
            faults.append((("contact",), "shares a load, and a plate at a gap has none: give plates.upper.load or pressure"))
        return faults

    def moving(self) -> bool:
        """Return whether the upper plate slides."""
        return self.upper is not None and self.upper.motion.moving()

    def driven(self) -> bool:
        """Return whether a drive begins after settling: the upper plate slides, or its load changes."""
        return self.moving() or (self.upper is not None and self.upper.loading is not None)


class Contact(Part):
    """The contact law by name, and its options as given in the file: only the law can check them."""

    extra_keys: ClassVar[str] = "options"
    law: Text = "three_spot"
    """Family of contact laws; `thirdbody laws` lists them. Example: "three_spot"."""
    level: Text | None = None
    """Level: the tangential law; by default "mindlin" for "three_spot", else the default of the family. Example: "mdr"."""
    debris_contact: Literal["auto", "none"] = "auto"
    """"none": bodies do not interact with each other (an ensemble). Example: "none"."""
    options: dict[str, Any] = {}

    @classmethod
    def arrange(cls, raw: dict[str, Any]) -> dict[str, Any]:
        """Return the table with the level of the default law; other laws may have no levels."""
        return {"level": "mindlin"} | raw if raw.get("law", "three_spot") == "three_spot" else raw


_Acceleration = Annotated[float, Quantity(dimension="acceleration")]


class Effects(Part):
    """Gravity [m/s2] if any, and further effects by name as given in the file; effects that are not given are off."""

    extra_keys: ClassVar[str] = "named"
    gravity: Annotated[tuple[_Acceleration, _Acceleration, _Acceleration], THREE] | None = None
    """Acceleration of gravity, x, y, z. Example: ["0 m/s2", "0 m/s2", "-9.81 m/s2"]."""
    named: dict[str, Any] = {}


IMPLICIT_KEYS = ("tolerance", "largest_step", "inertia", "on_failure")
"""Keys of the solver for the implicit integrator only."""

OBSOLETE = {
    "rate_test": "there is no rate test any more: `thirdbody cost SCENE` tells what the speed of a bed costs in accuracy, and "
    "`thirdbody sweep scenes/sweeps/mu_of_inertia.toml` measures friction over the inertial number"
}
"""Keys of the solver that older scenes have, and what does their work now."""


class Solver(Part):
    """Integrator, time step and length of a run. Distance and duration count after settling.

    The keys named in IMPLICIT_KEYS (`largest_step`: distance of the drag [m]) are documented in `engine.accuracy`.
    """

    integrator: Literal["auto", "explicit", "implicit"] = "auto"
    """"auto": implicit where at most few bodies meet each other and it should be faster. Example: "implicit"."""
    time_step: Annotated[float | Literal["auto"], Quantity(dimension="time", gt=0, words=("auto",))] = "auto"
    """Time step of the explicit integrator; above the bound it needs `--force`. Example: "0.5 ns"."""
    distance: PositiveLength | None = None
    """Sliding distance after settling; give it or `duration`. Example: "20 um"."""
    duration: PositiveTime | None = None
    """Duration after settling; give it or `distance`. Example: "10 us"."""
    initial_overlap: Literal["refuse", "relax"] = "refuse"
    """"relax" pushes bodies apart that overlap at the start, between flat plates, and reports how far. Example: "relax"."""
    settle: Annotated[float | Literal["auto"], Quantity(dimension="time", ge=0, words=("auto",))] = "auto"
    """Time under load before the drag starts. Example: "20 us"."""
    inertial_number: Annotated[float, Quantity(ge=1e-6, le=0.1)] | None = None
    """Bed: the plate moves at the speed that gives this inertial number. Loads and outputs come after the same distance as
    before; strokes keep their length and change their frequency. Example: 1e-3."""
    tolerance: Fraction | None = None
    """Implicit integrator: error of a step over the radius of the largest contact; by default 5e-4. Example: 1e-4."""
    largest_step: PositiveLength | None = None
    """Implicit integrator: longest drag in one step; by default unlimited. Example: "10 nm"."""
    inertia: Flag | None = None
    """Implicit integrator: true (default): bodies keep their momentum; false: quasi-static. Example: false."""
    on_failure: Literal["stop", "continue"] | None = None
    """Implicit integrator: "continue" goes on without a body that cannot be solved; by default "stop". Example: "continue"."""

    @classmethod
    def suggestion(cls, key: str) -> str:
        """Return what to write instead of an unknown key."""
        return OBSOLETE.get(key) or super().suggestion(key)

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        faults = one_of(raw, ("distance", "duration"))
        other = {"explicit": IMPLICIT_KEYS, "implicit": ("time_step",)}
        kind = raw.get("integrator", "auto")
        for key in other.get(kind, ()) if isinstance(kind, str) else ():
            if raw.get(key, "auto") not in (None, "auto"):
                faults.append(((key,), f'is for the other integrator: this one is "{kind}"'))
        return faults


class Measures(Part):
    """Measures by name as given in the file, and the cells of their maps; they read contacts and change nothing."""

    extra_keys: ClassVar[str] = "named"
    cell: PositiveLength | None = None
    """Side of the cells of the maps on both plates, rounded to fit the domain; without it no maps. Example: "0.5 um"."""
    named: dict[str, Any] = {}
