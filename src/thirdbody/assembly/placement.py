"""Positions and orientations of debris: a resting layer, a dilute cloud, or a dense bed."""

from collections.abc import Sequence

import numpy as np

from thirdbody import units
from thirdbody.bodies.clump import Clump
from thirdbody.bodies.overlap_removal import pack
from thirdbody.bodies.packing import place_layer, scatter
from thirdbody.bodies.resting_poses import headed, settle_all
from thirdbody.debris.contract import CLEARANCE, PopulationContext
from thirdbody.errors import Fault, InputError
from thirdbody.rotations import to_world
from thirdbody.scene.model import Scene

LAYER_STREAM, DILUTE_STREAM, DENSE_STREAM = 1_000_003, 1_000_033, 1_000_037
"""Spawn keys of the random streams of placement, different from those of the populations."""

COVERAGE = 4.0
"""Largest area of equal-volume spheres over that of the domain for bodies in one layer."""

SOLID_FRACTION = {"dilute": 0.05, "dense": 0.5}
"""Default solid fractions of a scene with neither height nor solid_fraction."""


def place_bodies(
    scene: Scene, clumps: list[Clump], populations: np.ndarray, x: np.ndarray, q: np.ndarray, warnings: list[str]
) -> None:
    """Place all bodies whose population (n,) names a placement: fill x (n, 3) [m] and q (n, 4).

    All layers are placed together, each body in a stable pose; then all dilute populations are scattered together, free of the
    bodies placed before; or all dense ones are packed together, mixed. Warnings give the solid fraction. Raises InputError.
    """
    how = np.array([debris.placement_name or "given" for debris in scene.debris])[populations]
    layer, dilute, dense = (np.flatnonzero(how == placement) for placement in ("layer", "dilute", "dense"))
    if len(layer):
        headings = np.array([getattr(debris, "heading", None) for debris in scene.debris], float)[populations]
        _lay(scene, clumps, layer, x, q, headings)
    for placement, members in (("dilute", dilute), ("dense", dense)):
        if len(members):
            _fill(scene, placement, clumps, members, x, q, warnings)


def refuse_placements(scene: Scene, contexts: Sequence[PopulationContext]) -> None:
    """Raise InputError for placements that contradict each other, need a missing plate, or are far too crowded."""
    how = [debris.placement_name for debris in scene.debris]
    for i, placement in enumerate(how):
        if placement in ("layer", "dense") and scene.plates.lower is None:
            verb = "lays" if placement == "layer" else "builds a bed of"
            message = f'placement = "{placement}" {verb} bodies on [plates.lower], which is missing'
            raise InputError(scene.fault(("debris", i), message))
    faults = []
    if "dense" in how:
        for i, placement in enumerate(how):
            if placement in ("layer", "dilute"):
                other = f"debris[{how.index('dense')}]"
                message = f'"{placement}" and the "dense" of {other} would occupy the same space: make all of them "dense"'
                faults.append(scene.fault(("debris", i, "placement"), message))
    for placement in ("dilute", "dense"):
        keys = _volume_keys(scene, placement)
        for i, key, value in keys:
            if (key, value) != keys[0][1:]:
                message = f'all "{placement}" bodies share one volume; debris[{keys[0][0]}] gives a different {keys[0][1]}'
                faults.append(scene.fault(("debris", i, key), message))
    faults = faults or _crowds(scene, contexts)
    if faults:
        raise InputError(faults)


def _volume_keys(scene: Scene, placement: str) -> list[tuple[int, str, float]]:
    """Return population, key and value of all entries on the common volume of dilute or dense bodies."""
    return [
        (i, key, value)
        for i, debris in enumerate(scene.debris)
        if debris.placement_name == placement
        for key in ("height", "solid_fraction")
        if (value := getattr(debris, key, None)) is not None
    ]


def _crowds(scene: Scene, contexts: Sequence[PopulationContext]) -> list[Fault]:
    """Return faults for impossible counts, before hours are spent on making and placing the bodies."""
    faults = []
    width, depth = scene.domain.size
    for i, (debris, context) in enumerate(zip(scene.debris, contexts, strict=True)):
        placement = debris.placement_name
        if placement is None:
            continue
        (diameter, portion), count = debris.typical_diameter(context), debris.number_of_bodies(context)
        cover = portion * count * 0.25 * np.pi * diameter**2 / (width * depth)
        what = f"{count} bodies of {units.pretty(diameter, 'length')} would"
        domain_size = f"({units.pretty(width, 'length')} by {units.pretty(depth, 'length')})"
        volume_keys = _volume_keys(scene, placement)
        if placement == "layer" and cover > COVERAGE:
            less = "a layer covers it less than once: lower count or enlarge domain.size"
            faults.append(scene.fault(("debris", i, "count"), f"{what} cover the domain {domain_size} {cover:.3g} times; {less}"))
        elif volume_keys and volume_keys[0][1] == "height" and (fraction := cover * diameter / 1.5 / volume_keys[0][2]) > 1.0:
            less = "lower count, or raise height or domain.size"
            message = f"{what} fill the domain {domain_size} up to this height {fraction:.3g} times; {less}"
            faults.append(scene.fault(("debris", i, "count"), message))
    return faults


def _lay(scene: Scene, clumps: list[Clump], members: np.ndarray, x: np.ndarray, q: np.ndarray, headings: np.ndarray) -> None:
    rng = np.random.default_rng(np.random.SeedSequence(getattr(scene.debris[0], "seed", 1), spawn_key=(LAYER_STREAM,)))
    laid = [clumps[b] for b in members]
    q[members], heights = settle_all(laid, rng)
    given = members[np.isfinite(headings[members])]
    q[given] = headed(q[given], headings[given])
    x[members, 2] = heights + CLEARANCE * np.array([body.diameter for body in laid])
    try:
        x[members, :2] = place_layer(laid, q[members], scene.domain.size, scene.domain.wraps, rng)
    except InputError as error:
        raise InputError([scene.fault(("domain", "size"), fault.message) for fault in error.faults]) from None


def _fill(
    scene: Scene, placement: str, clumps: list[Clump], members: np.ndarray, x: np.ndarray, q: np.ndarray, warnings: list[str]
) -> None:  # fmt: skip
    """Scatter ("dilute") or pack ("dense") bodies in their common volume."""
    bodies = [clumps[b] for b in members]
    height, fraction = _volume(scene, placement, bodies)
    first = next(i for i, debris in enumerate(scene.debris) if debris.placement_name == placement)
    dilute, domain = placement == "dilute", (scene.domain.size, scene.domain.wraps)
    key = (DILUTE_STREAM if dilute else DENSE_STREAM,)
    rng = np.random.default_rng(np.random.SeedSequence(getattr(scene.debris[first], "seed", 1), spawn_key=key))
    try:
        if dilute:
            # the spots of a given particle touch plates only: no body is in their way
            standing = np.array([b for b, body in enumerate(clumps) if body.sides is None and np.isfinite(x[b]).all()], np.int64)
            spheres = None
            if len(standing):
                centres, radii, _ = spheres_of([clumps[b] for b in standing], x[standing], q[standing])
                spheres = np.column_stack((centres, radii))
            x[members], q[members] = scatter(bodies, height, *domain, rng, spheres)
        else:
            x[members], q[members], fraction, height = pack(bodies, fraction, *domain, rng)
            x[members, 2] += CLEARANCE * max(body.diameter for body in bodies)
    except InputError as error:
        volume_keys = _volume_keys(scene, placement)
        where = volume_keys[0][:2] if volume_keys else (first, "placement")
        raise InputError(
            scene.fault(("domain", "size") if fault.key == "domain.size" else ("debris", *where), fault.message)
            for fault in error.faults
        ) from None
    what, up_to = ("dilute", "") if dilute else ("dense bed", "the highest point at ")
    warnings.append(
        f"{what}: {len(bodies)} bodies fill {fraction:.4g} of the volume up to {up_to}{units.pretty(height, 'length')} (solid "
        "fraction)"
    )


def _volume(scene: Scene, placement: str, bodies: list[Clump]) -> tuple[float, float]:
    """Return the height [m] of the common volume of the bodies and their solid fraction in it. Raises InputError above 1."""
    solid = sum(body.volume for body in bodies) / (scene.domain.size[0] * scene.domain.size[1])
    volume_keys = _volume_keys(scene, placement)
    if not volume_keys:
        return solid / SOLID_FRACTION[placement], SOLID_FRACTION[placement]
    i, key, value = volume_keys[0]
    if key == "solid_fraction":
        return solid / value, value
    if solid / value > 1.0:
        message = f"the bodies would fill {solid / value:.3g} times the volume up to {units.pretty(value, 'length')}"
        raise InputError(scene.fault(("debris", i, key), message))
    return value, solid / value


def spheres_of(clumps: Sequence[Clump], x: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return centres (n, 3) [m], radii (n,) [m], body (n,) of spheres of bodies at x (b, 3), q (b, 4)."""
    body = np.repeat(np.arange(len(clumps)), [len(clump.radii) for clump in clumps])
    offsets = np.concatenate([clump.centers for clump in clumps])
    centres = x[body] + to_world(q[body], offsets)
    return centres, np.concatenate([clump.radii for clump in clumps]), body
