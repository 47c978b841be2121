"""Upper plate of a scene: patches, foundation, schedule, settling time, expected overlaps."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from thirdbody import units
from thirdbody.assembly.direct_contact import direct_contact, narrow_gap_warning
from thirdbody.assembly.initial_relaxation import UNLOADED_OVERLAP
from thirdbody.assembly.load_checks import Pressing, pressing_warnings, refuse_crushing
from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.placement import CLEARANCE
from thirdbody.assembly.populate import sphere_centres
from thirdbody.assembly.rough_start import plate_heights
from thirdbody.assembly.schedule import first_load, schedule
from thirdbody.engine.placed import Placed
from thirdbody.engine.upper_plate import DirectContact, Foundation, UpperPlate
from thirdbody.errors import InputError
from thirdbody.kernels.tables import ONLY_LOWER
from thirdbody.scene.model import Scene
from thirdbody.statics.contacts import overlap_at, response
from thirdbody.surfaces.surface import Surface

HANDFUL = 3
"""Largest number of loaded bodies, of a larger layer, with a warning: a rigid parallel plate rests on few stiff bodies."""

DASHPOT_WARNING = 0.1
"""Threshold of a warning: force of the patches' dashpots at the speed of the drag, over the load.

At 0.07 and friction 0.8, where most bodies roll, friction dissipates 0.79 of the plate's work; at 0.7 it dissipates 0.51."""

RELAXED = 12.0
"""Settling time of a foundation in relaxation times (dashpot over spring of a patch): the plate comes down in the first ones,
and after the others less than 1e-3 of the load is not yet shared."""


@dataclass(frozen=True)
class Upper:
    """Plate, settling time [s], and number of bodies that carry load initially.

    Overlaps over the radius: `overlap` with the whole load on the tallest body, which the plate touches first; `shared_overlap`
    with the load on all bodies that carry it initially.
    """

    plate: UpperPlate | None
    settle: float = 0.0
    overlap: float = 0.0
    loaded: int = 0
    shared_overlap: float = 0.0


@dataclass(frozen=True)
class TopSpheres:
    """Highest points of the bodies, (n,): height [m], sphere radius [m], row of the pair with the plate, body mass [kg]."""

    top: np.ndarray
    radius: np.ndarray
    kind: np.ndarray
    mass: np.ndarray


def upper_plate(
    scene: Scene, choice: CompiledPhysics, placed: Placed, warnings: list[str], surfaces: Mapping[str, Surface]
) -> Upper:
    """Return the upper plate of a scene, if any. Raises InputError for a gap that is too small or a table that is wrong."""
    plate = scene.plates.upper
    if plate is None:
        return Upper(None, 0.0 if isinstance(scene.solver.settle, str) else scene.solver.settle)
    material = list(scene.materials).index(plate.material)
    top, radius = _tops(placed, surfaces.get("upper"))
    masses = placed.densities * np.array([clump.volume for clump in placed.clumps])
    tops = TopSpheres(top, radius, choice.physics.kinds[placed.materials, material], masses)
    direct = direct_contact(scene, choice, surfaces)
    if plate.support == "foundation":
        return _on_foundation(scene, choice, placed, tops, material, warnings, direct)
    if plate.gap is not None:
        return _at_gap(scene, tops, material, plate.gap, warnings)
    if plate.support == "load_per_particle":
        return _each_loaded(scene, choice, placed, tops, material, warnings)
    return _rigid(scene, choice, placed, tops, material, warnings, direct)


def _at_gap(scene: Scene, tops: TopSpheres, material: int, gap: float, warnings: list[str]) -> Upper:
    """Return a rigid plate at a prescribed height."""
    tallest = int(np.argmax(tops.top))
    remaining = UNLOADED_OVERLAP * tops.radius[tallest] if scene.solver.initial_overlap == "relax" else 0.0
    if tops.top[tallest] > gap * (1.0 + 2.0 * CLEARANCE) + remaining:
        message = (
            f"{units.pretty(gap, 'length')} is smaller than body {tallest}, which is "
            f"{units.pretty(float(tops.top[tallest]), 'length')} tall: it would start inside the plate; "
            f"solver.initial_overlap = '{scene.solver.initial_overlap}'"
        )
        raise InputError(scene.fault(("plates", "upper", "gap"), message))
    if scene.plates.moving():
        warnings.append("at constant gap a tipping particle wedges and its normal force has no bound; a load lets it tip")
    settle = 0.0 if isinstance(scene.solver.settle, str) else scene.solver.settle
    patch, zero = np.zeros(len(tops.top), np.int64), np.zeros(1)
    built = UpperPlate(material, np.array([gap]), np.ones(1), zero, zero, False, patch, schedule(scene, settle))
    return Upper(built, settle)


def _each_loaded(
    scene: Scene, choice: CompiledPhysics, placed: Placed, tops: TopSpheres, material: int, warnings: list[str]
) -> Upper:
    """Return a plate with one free patch per body."""
    n, load = len(tops.top), first_load(scene)
    loads = np.full(n, load)
    mass = np.full(n, scene.plates.upper.mass or tops.mass.mean())  # type: ignore[union-attr]
    overlap, dashpot = _pressed(scene, choice, tops, np.arange(n), loads, mass)
    maximum = load * _largest(scene)
    pressing = Pressing(np.full(n, maximum), tops.radius, tops.kind)
    refuse_crushing(scene, choice, pressing, maximum)
    warnings += pressing_warnings(choice, pressing, overlap)
    settle = _settle(scene, placed, tops, mass, dashpot, load)
    _warn_dashpot(scene, settle, dashpot, load, warnings)
    heights = tops.top + CLEARANCE * tops.radius
    built = UpperPlate(material, heights, mass, dashpot, loads, True, np.arange(n), schedule(scene, settle))
    max_overlap = float(np.max(overlap / tops.radius))
    return Upper(built, settle, max_overlap, n, max_overlap)


def _rigid(
    scene: Scene, choice: CompiledPhysics, placed: Placed, tops: TopSpheres, material: int, warnings: list[str],
    direct: DirectContact | None,
) -> Upper:  # fmt: skip
    """Return one free, parallel plate; the tallest body carries the whole load at first, or direct contact of the plates."""
    load, tallest = first_load(scene), np.array([int(np.argmax(tops.top))])
    mass = np.full(1, scene.plates.upper.mass or tops.mass.sum())  # type: ignore[union-attr]
    loads = np.full(1, load)
    overlap, dashpot = _pressed(scene, choice, tops, tallest, loads, mass)
    maximum = load * _largest(scene)
    if direct is None:
        refuse_crushing(scene, choice, Pressing(np.full(len(tops.top), maximum), tops.radius, tops.kind), maximum, len(tops.top))
    # contacts of the bodies that share the load, if the bodies did not move
    level = _level(lambda z: _layer_force(choice, tops, z), tops, maximum, direct)
    force, carried = _layer_force(choice, tops, level), maximum - (direct.force(level) if direct else 0.0)
    on = np.flatnonzero(force > 0.0) if np.any(force > 0.0) else tallest
    fraction = force[on] * (carried / force[on].sum()) if force[on].sum() > 0.0 else np.full(1, max(carried, 0.0))
    pressing = Pressing(fraction, tops.radius[on], tops.kind[on])
    common = pressing.overlap(choice)
    warnings += pressing_warnings(choice, pressing, common) + (narrow_gap_warning(direct, level) if direct else [])
    height = tops.top[tallest] + CLEARANCE * tops.radius[tallest]
    rests = direct is not None and direct.gap(load) > height[0]
    if direct is not None and rests:  # no body touches the plate
        height = np.full(1, direct.gap(load))
        if scene.plates.upper.damping is None:  # type: ignore[union-attr]
            dashpot = 2.0 * np.sqrt(load / direct.length * mass)
    settle = _settle(scene, placed, tops, mass, dashpot, load)
    loaded = 0
    if not rests:
        first = _level(lambda z: _layer_force(choice, tops, z), tops, load, direct)
        loaded = max(1, int(np.count_nonzero(_layer_force(choice, tops, first))))
    if loaded <= HANDFUL < len(tops.top) and direct is None:
        warnings.append(
            f"a rigid flat plate, kept parallel, rests on about {loaded} of {len(tops.top)} bodies: they are stiff and of "
            'different height; support = "foundation" or "load_per_particle" shares the load'
        )
    _warn_dashpot(scene, settle, dashpot, load, warnings)
    patch = np.zeros(len(tops.top), np.int64)
    built = UpperPlate(material, height, mass, dashpot, loads, True, patch, schedule(scene, settle), direct=direct)
    shared_overlap = float(np.max(common / pressing.radius))
    return Upper(built, settle, float(overlap[0] / tops.radius[tallest[0]]), loaded, shared_overlap)


def _on_foundation(
    scene: Scene, choice: CompiledPhysics, placed: Placed, tops: TopSpheres, material: int, warnings: list[str],
    direct: DirectContact | None,
) -> Upper:  # fmt: skip
    """Return a plate of one patch per body, with springs to a common plate under a load or at a height."""
    plate = scene.plates.upper
    assert plate is not None and plate.stiffness is not None
    n, stiffness, preload = len(tops.top), plate.stiffness, plate.preload or 0.0
    load = first_load(scene)
    highest = float(tops.top.max())
    height = plate.gap if plate.gap is not None else highest if direct is None else max(highest, direct.gap(load))
    # a patch without a body hangs preload/stiffness below the plate
    springs = lambda z: np.maximum(stiffness * (tops.top - z) + preload, 0.0)  # noqa: E731
    level = height if plate.gap is not None else _level(springs, tops, load + n * preload, direct)
    carried = springs(level)
    warnings += narrow_gap_warning(direct, level) if direct else []
    loaded = int(np.count_nonzero(carried))
    largest = np.array([int(np.argmax(carried))])
    mass = np.full(n, plate.mass or tops.mass.mean())
    load_fraction = np.maximum(carried[largest], 1e-300)
    overlap, dashpot = _pressed(scene, choice, tops, largest, load_fraction, mass[:1])
    pressing = Pressing(load_fraction * _largest(scene), tops.radius[largest], tops.kind[largest])
    refuse_crushing(scene, choice, pressing, float(pressing.load[0]))
    if loaded:
        on = np.flatnonzero(carried)
        pressing = Pressing(carried[on] * _largest(scene), tops.radius[on], tops.kind[on])
        warnings += pressing_warnings(choice, pressing, pressing.overlap(choice))
    total = float(mass.sum())
    whole = n * stiffness + (load / direct.length if direct else 0.0)
    common = Foundation(stiffness, height, total, 2.0 * math.sqrt(whole * total), load, free=plate.gap is None)
    touches = loaded > 0 and carried[largest[0]] > 0.0
    if not touches and isinstance(scene.solver.settle, str):
        settle = 0.0  # a plate that has not come down yet presses on no body
    else:
        settle = _settle(scene, placed, tops, mass, dashpot, float(load_fraction[0]))
    if isinstance(scene.solver.settle, str) and settle > 0.0:
        settle = max(settle, RELAXED * float(dashpot[0]) / stiffness)
    heights = np.maximum(height, tops.top) + CLEARANCE * tops.radius
    built = UpperPlate(
        material, heights, mass, np.full(n, dashpot[0]), np.full(n, preload), True, np.arange(n), schedule(scene, settle), common,
        direct,
    )  # fmt: skip
    max_overlap = float(overlap[0] / tops.radius[largest[0]])
    return Upper(built, settle, max_overlap, loaded, max_overlap)


def _largest(scene: Scene) -> float:
    """Return the largest load of the run over the first one, at least 1."""
    return max(schedule(scene, 0.0).largest_load(), 1.0)


def _pressed(
    scene: Scene, choice: CompiledPhysics, tops: TopSpheres, who: np.ndarray, loads: np.ndarray, mass: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return overlaps [m] of the highest spheres under the largest load, and the dashpots [kg/s].

    By default a dashpot is critical with the contact stiffness under the first load.
    """
    plate, radius, kind = scene.plates.upper, tops.radius[who], tops.kind[who]
    assert plate is not None
    overlap = overlap_at(choice.physics, loads, radius, kind)
    largest = _largest(scene)
    max_overlap = overlap if largest <= 1.0 else overlap_at(choice.physics, largest * loads, radius, kind)
    if plate.damping is not None:
        return max_overlap, np.full(len(who), plate.damping)
    stiffness = response(choice.physics, overlap, radius, kind).stiffness
    if not np.all(np.isfinite(stiffness)):
        message = "needs a value: the normal law has no tangent to find the critical damping from"
        raise InputError(scene.fault(("plates", "upper", "damping"), message))
    return max_overlap, 2.0 * np.sqrt(stiffness * mass)


def _layer_force(choice: CompiledPhysics, tops: TopSpheres, z: float) -> np.ndarray:
    """Return the normal force (n,) [N] of a plate at height z [m] on bodies that do not move."""
    overlap = np.maximum(tops.top - z, 0.0)
    force = response(choice.physics, overlap, tops.radius, tops.kind).force
    return np.where(overlap > 0.0, force, 0.0)


def _level(force: Callable[[float], np.ndarray], tops: TopSpheres, load: float, direct: DirectContact | None) -> float:
    """Return the height [m] at which a plate carries a load [N] with bodies that did not move and direct contact, by bisection;
    negative for very soft springs."""
    low, high = 0.0, float(tops.top.max())
    if direct is not None and direct.gap(load) >= high:  # no body reaches the plate
        return direct.gap(load)

    def total(z: float) -> float:
        return float(np.sum(force(z) if direct is None else np.append(force(z), direct.force(z))))

    while total(low) < load and low > -1e6 * high:
        low = 2.0 * low - high
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if total(middle) > load else (low, middle)
    return high


def _tops(placed: Placed, surface: Surface | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the height of the upper plate at which it touches each body, and the radius of the body's sphere there, (n,) [m].

    `surface`: of a rough upper plate, whose height is that of its mean plane.
    """
    centres, radii, body = sphere_centres(placed)
    touches_upper = placed.sides() != ONLY_LOWER
    centres, radii, body = centres[touches_upper], radii[touches_upper], body[touches_upper]
    heights = plate_heights(surface, centres, radii)
    order = np.lexsort((heights, body))
    last = np.append(np.flatnonzero(np.diff(body[order])), len(body) - 1)
    highest = order[last]
    return heights[highest], radii[highest]


def _settle(scene: Scene, placed: Placed, tops: TopSpheres, mass: np.ndarray, dashpot: np.ndarray, load: float) -> float:
    """Return the settling time [s]; by default that in which a patch falls by 1/4 of the largest body.

    A body that is loaded off its balance tips into a new position, and its patch comes down by about that distance; a bed of
    several layers is compacted by about a tenth of its height.
    """
    if not isinstance(scene.solver.settle, str):
        return scene.solver.settle
    if not scene.plates.driven():
        return 0.0
    distance = max(0.25 * max(clump.diameter for clump in placed.clumps), 0.1 * float(tops.top.max()))
    return math.sqrt(2.0 * distance * (tops.mass.max() + mass.max()) / load) + float(dashpot.max()) * distance / load


def _warn_dashpot(scene: Scene, settle: float, dashpot: np.ndarray, load: float, warnings: list[str]) -> None:
    fraction = float(dashpot.max()) * schedule(scene, settle).top_speed() / load
    if fraction > 1.0:
        warnings.append(
            f"the patches' dashpot carries up to {fraction:.1f} of the load when they rise or fall at the drag speed: the motion "
            "is not quasi-static, and what bodies that roll should rub the dashpots take; lower plates.upper.damping or the speed"
        )
    elif fraction > DASHPOT_WARNING:
        warnings.append(
            f"the patches' dashpot carries up to {fraction:.2f} of the load when they rise or fall at the drag speed: where "
            "bodies roll, dashpots may take more than a tenth of the plate's work (see the summary of the run), which "
            "friction work then lacks; lower plates.upper.damping or the speed where that matters"
        )
