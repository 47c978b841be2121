"""Initial bodies of a scene, from its debris tables: made, set onto the lower plate, and checked."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from thirdbody import units
from thirdbody.assembly.placement import place_bodies, refuse_placements, spheres_of
from thirdbody.bodies.clump import Clump, impossible_moments
from thirdbody.bodies.packing import overlaps
from thirdbody.debris.contract import UPRIGHT, PlacedClumps, PopulationContext, RandomStreams
from thirdbody.engine.placed import Placed
from thirdbody.errors import Fault, InputError, UsageError
from thirdbody.kernels.tables import EVERYTHING, ONLY_UPPER
from thirdbody.scene.model import Scene
from thirdbody.schema.fields import AT_REST
from thirdbody.schema.parts import key_location
from thirdbody.surfaces.surface import Surface, dilation

UNPLACED = (float("nan"),) * 3
"""Position of a body before its placement."""

_REFUSED = "solver.initial_overlap = 'refuse' ('relax' pushes bodies apart)"

TINY = 1e-11
"""Smallest radius over domain size: overlaps of 1e-3 of the radius then still have two digits."""

CLOSED = 1.01
"""Largest distance over the sum of radii of balls at the seam of a raft: they are packed to touch, a few per mille apart."""

ABOVE = 1e-6
"""Height above the first touch over the diameter: more than the error of `dilation`, so that nothing touches at the start."""

ROUNDS = 100
"""Largest number of rounds that lift neighbours to a common height."""


def population_context(scene: Scene, index: int, warnings: list[str]) -> PopulationContext:
    """Return the context of one population: index, random streams, density, domain, warnings."""
    debris = scene.debris[index]
    random = RandomStreams(getattr(debris, "seed", 1), index)
    density = scene.materials[debris.material].density
    return PopulationContext(index, random, density, scene.domain.size, scene.beside, warnings)


def read_populations(scene: Scene, warnings: list[str]) -> list[PopulationContext]:
    """Return the contexts of all populations, with their file contents. Raises InputError with all faults."""
    contexts, faults = [], []
    for index, debris in enumerate(scene.debris):
        context = population_context(scene, index, warnings)
        try:
            with _faults_of(scene, index):
                context = replace(context, content=debris.read(context))
        except InputError as error:
            faults += error.faults
        contexts.append(context)
    if faults:
        raise InputError(faults)
    return contexts


def make_bodies(scene: Scene, context: PopulationContext) -> PlacedClumps:
    """Make the bodies of one population. Raises InputError for wrong keys, UsageError for a kind that returns no valid bodies."""
    debris = scene.debris[context.index]
    with _faults_of(scene, context.index):
        built = debris.bodies(context)
    clumps, maximum = built.clumps, debris.max_spheres()
    if not clumps or not all(isinstance(body, Clump) for body in clumps):
        raise UsageError(f"the kind of debris '{debris.kind}' gave no list of Clump for debris[{context.index}]")
    if debris.count is not None and len(clumps) != debris.count:
        raise UsageError(f"the kind of debris '{debris.kind}' gave {len(clumps)} bodies for the count {debris.count}")
    if maximum > 1 and (spheres := max(len(body.radii) for body in clumps)) > maximum:
        raise UsageError(f"the kind of debris '{debris.kind}' gave a body of {spheres} spheres, and its max_spheres is {maximum}")
    if odd := impossible_moments([body.inertia for body in clumps]):
        raise InputError(scene.fault(("debris", context.index), f"body {odd[0]}, m5 at unit density: {odd[1]}"))
    context.warnings.extend(f"debris[{context.index}]: {note}" for note in debris.notes())
    return built


def shapes_of(scene: Scene, index: int, warnings: list[str]) -> list[Clump]:
    """Return the bodies of one population, at unit density. Raises InputError."""
    return make_bodies(scene, read_populations(scene, warnings)[index]).clumps


@contextmanager
def _faults_of(scene: Scene, index: int) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        result = [(key_location(fault.key), fault.message) for fault in error.faults]
        raise InputError(scene.fault(("debris", index, *location), message) for location, message in result) from None


def populate(scene: Scene, warnings: list[str], surfaces: Mapping[str, Surface] | None = None) -> Placed:
    """Return all bodies of the scene, in the order of its populations. Raises InputError.

    Bodies without positions in the scene are placed by `place_bodies`; `surfaces`: of rough plates, by side.
    """
    contexts = read_populations(scene, warnings)
    refuse_placements(scene, contexts)
    built = [make_bodies(scene, context) for context in contexts]
    clumps = [body for population in built for body in population.clumps]
    populations = np.repeat(np.arange(len(built)), [len(population.clumps) for population in built])
    names = list(scene.materials)
    materials = np.array([names.index(debris.material) for debris in scene.debris])[populations]
    densities = np.array([material.density for material in scene.materials.values()])
    motions = [(debris.velocity or AT_REST, debris.angular_velocity or AT_REST) for debris in scene.debris]
    each = list(zip(built, motions, strict=True))
    placed = Placed(
        clumps=clumps,
        densities=densities[materials],
        materials=materials,
        populations=populations,
        positions=np.concatenate([_rows(bodies, bodies.positions, UNPLACED) for bodies in built]),
        quaternions=np.concatenate([_rows(bodies, bodies.quaternions, UPRIGHT) for bodies in built]),
        velocities=np.concatenate([_rows(bodies, bodies.velocity, v) for bodies, (v, _) in each]),
        angular_velocities=np.concatenate([_rows(bodies, bodies.angular_velocity, w) for bodies, (_, w) in each]),
    )
    place_bodies(scene, clumps, populations, placed.positions, placed.quaternions, warnings)
    lower = (surfaces or {}).get("lower")
    if lower is not None:  # layers are set onto a rough lower plate, and what else was placed is raised out of it
        how = np.array([debris.placement_name or "given" for debris in scene.debris])[populations]
        lift_bodies(scene, clumps, np.flatnonzero(how == "layer"), placed.positions, placed.quaternions, lower)
        placed.positions[(how == "dilute") | (how == "dense"), 2] += float(lower.heights.max())
    refuse_start(scene, placed, lower)
    return placed


def _rows(bodies: PlacedClumps, given: np.ndarray | None, otherwise: Sequence[float]) -> np.ndarray:
    row = np.asarray(otherwise if given is None else given, float)
    return np.broadcast_to(row, (len(bodies.clumps), row.shape[-1]))


def sphere_centres(placed: Placed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return centres (n, 3) [m], radii (n,) [m] and body (n,) of every sphere."""
    return spheres_of(placed.clumps, placed.positions, placed.quaternions)


def refuse_start(scene: Scene, placed: Placed, lower: Surface | None = None) -> None:
    """Raise InputError for bodies that overlap each other or the lower plate by more than rounding, or start outside.

    `lower`: the surface of a rough lower plate. With initial_overlap = "relax" overlaps are refused for bodies bound to a plate
    only: the others are moved later.
    """
    centres, radii, body = spheres_of(placed.clumps, placed.positions, placed.quaternions)
    sides, relax = placed.sides(), scene.solver.initial_overlap == "relax"
    faults: list[Fault] = []
    small = np.flatnonzero(np.array([clump.radii.min() for clump in placed.clumps]) < TINY * max(scene.domain.size))
    if len(small):  # below the floating-point resolution of the domain: a wrong unit
        size = units.pretty(float(placed.clumps[small[0]].radii.min()), "length")
        of = f"less than {TINY:g} of the domain, {units.pretty(max(scene.domain.size), 'length')}; is the unit right?"
        message = f"a sphere of body {small[0]} has the radius {size}, {of}"
        faults.append(scene.fault(position_key(scene, placed, int(small[0])), message))
    faults += outside(scene, placed) + _own_images(scene, placed, centres, radii, body)
    if scene.contact.debris_contact != "none" and not relax:
        free = sides == EVERYTHING
        length, width = scene.domain.size
        # between walls nothing meets its images along y
        period = length, width + (4.0 * float(radii.max()) if scene.domain.walls else 0.0)
        result = overlaps(centres[free], radii[free], body[free], period, scene.domain.periodic)
        overlapping = [(a, b, depth) for a, b, depth in result if depth > 1e-9 * radii.min()]
        if overlapping:
            a, b, depth = overlapping[0]
            more = f" ({len(overlapping)} pairs overlap)" if len(overlapping) > 1 else ""
            how_much = units.pretty(depth, "length")
            message = f"bodies {a} and {b} overlap by {how_much} at the start{more}; {_REFUSED}"
            faults.append(scene.fault(position_key(scene, placed, b), message))
    if scene.plates.lower is not None:
        excluded = (sides == ONLY_UPPER) | ((sides == EVERYTHING) & relax)
        depth_below = np.where(excluded, -np.inf, depth_in_lower(lower, centres, radii))
        lowest = int(np.argmax(depth_below))
        if depth_below[lowest] > 1e-9 * radii[lowest]:
            how_much = units.pretty(float(depth_below[lowest]), "length")
            message = (
                f"body {body[lowest]} starts {how_much} deep in the lower plate{' (z = 0)' if lower is None else ''}; {_REFUSED}"
            )
            faults.append(scene.fault(position_key(scene, placed, int(body[lowest])), message))
    if scene.domain.walls:
        in_walls = radii - np.minimum(centres[:, 1], scene.domain.size[1] - centres[:, 1])
        deepest = int(np.argmax(np.where(sides == ONLY_UPPER, -np.inf, in_walls)))
        if in_walls[deepest] > 1e-9 * radii[deepest]:
            how_much = units.pretty(float(in_walls[deepest]), "length")
            message = f"body {body[deepest]} starts {how_much} deep in a side wall; {_REFUSED}"
            faults.append(scene.fault(position_key(scene, placed, int(body[deepest])), message))
    if faults:
        raise InputError(faults)


def _own_images(scene: Scene, placed: Placed, centres: np.ndarray, radii: np.ndarray, body: np.ndarray) -> list[Fault]:
    """Return a fault for the first body longer than the period in x or y that overlaps an image of itself.

    Bodies given by spots are left out: radii of curvature are no extents.
    """
    if not scene.domain.periodic:
        return []
    starts, reach, size = np.searchsorted(body, np.arange(len(placed.clumps))), radii[:, None], np.array(scene.domain.size)
    extent = np.maximum.reduceat(centres[:, :2] + reach, starts) - np.minimum.reduceat(centres[:, :2] - reach, starts)
    whole = np.array([clump.sides is None for clump in placed.clumps])
    long = np.argwhere((extent >= size) & whole[:, None])
    meeting = {b: _meets_itself(centres[body == b], radii[body == b], size) for b in set(long[:, 0].tolist())}
    long = long[[meeting[int(b)] for b in long[:, 0]]] if len(long) else long
    if not len(long):
        return []
    b, axis = (int(k) for k in long[0])
    length, period = units.pretty(float(extent[b, axis]), "length"), units.pretty(scene.domain.size[axis], "length")
    more = f", as are {len(np.unique(long[:, 0])) - 1} others" if len(np.unique(long[:, 0])) > 1 else ""
    message = f"body {b} is {length} long in {'xy'[axis]}{more}, and meets its own image in the period of {period}; "
    return [scene.fault(position_key(scene, placed, b), message + "enlarge domain.size, or turn or shorten it")]


def _meets_itself(centres: np.ndarray, radii: np.ndarray, size: np.ndarray) -> bool:
    """Return whether spheres of a body overlap those of its images by more than rounding, unless it is a raft.

    A raft is a flat sheet that closes with its images both in x and in y, to a gap of CLOSED.
    """
    from scipy.spatial import KDTree  # imported here: 0.2 s

    def meets(x: int, y: int, within: float = 1.0 - 1e-9) -> bool:
        image = KDTree(centres + (x * size[0], y * size[1], 0.0))
        near = KDTree(centres).sparse_distance_matrix(image, 2.0 * CLOSED * float(radii.max())).tocoo()
        return bool(np.any(near.data < (radii[near.row] + radii[near.col]) * within))

    height = float((centres[:, 2] + radii).max() - (centres[:, 2] - radii).min())
    raft = height < 0.5 * size.min() and meets(1, 0, CLOSED) and meets(0, 1, CLOSED)
    return not raft and any(meets(x, y) for x, y in ((1, 0), (0, 1), (1, 1), (1, -1)))


def position_key(scene: Scene, placed: Placed, body: int) -> tuple[str | int, ...]:
    """Return the key that gives the position of a body: entry of `positions`, file, or population."""
    population = int(placed.populations[body])
    first = int(np.searchsorted(placed.populations, population))
    return ("debris", population, *scene.debris[population].position_key(body - first))


def outside(scene: Scene, placed: Placed) -> list[Fault]:
    """Return a fault for the first body whose centre is outside a domain that is not periodic."""
    if scene.domain.periodic or scene.plates.lower is None:
        return []
    x = placed.positions[:, :2]
    beyond = np.flatnonzero(((x < 0.0) | (x > np.array(scene.domain.size))).any(axis=1))
    if not len(beyond):
        return []
    where = ", ".join(units.pretty(float(v), "length") for v in x[beyond[0]])
    width, depth = (units.pretty(v, "length") for v in scene.domain.size)
    message = f"body {beyond[0]} starts at x, y = {where}, outside the domain (0 to {width}, 0 to {depth}; not periodic)"
    return [scene.fault(position_key(scene, placed, int(beyond[0])), message)]


def lift_bodies(scene: Scene, clumps: Sequence[Clump], members: np.ndarray, x: np.ndarray, q: np.ndarray, lower: Surface) -> None:
    """Move bodies that rest on the plane z = 0 (rows `members` of x) up or down until they touch the rough lower plate.

    Bodies that would overlap at different heights, one reaching under the other, keep their relative height.
    """
    if not len(members):
        return
    centres, radii, body = spheres_of([clumps[b] for b in members], x[members], q[members])
    lift = np.full(len(members), -np.inf)
    np.maximum.at(lift, body, dilation(lower, centres, radii) - centres[:, 2])
    for _ in range(ROUNDS if scene.contact.debris_contact != "none" else 0):
        raised = centres + np.array([0.0, 0.0, 1.0]) * lift[body][:, None]
        pairs = overlaps(raised, radii, body, scene.domain.size, scene.domain.periodic)
        if not pairs:
            break
        for a, b, _depth in pairs:
            lift[a] = lift[b] = max(lift[a], lift[b])
    x[members, 2] += lift + ABOVE * np.array([clumps[b].diameter for b in members])


def depth_in_lower(lower: Surface | None, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return how deep (n,) [m] spheres reach into the lower plate, rough or flat; negative above it."""
    return (radii if lower is None else dilation(lower, centres, radii)) - centres[:, 2]


def plate_heights(upper: Surface | None, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return the height (n,) [m] of the upper plate's mean plane at which it first touches each sphere."""
    if upper is None:
        return centres[:, 2] + radii
    return centres[:, 2] + dilation(upper, centres, radii)
