"""Clumps of the populations of a scene."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from thirdbody.bodies.clump import Clump, impossible_moments
from thirdbody.debris.contract import PlacedClumps, PopulationContext, RandomStreams
from thirdbody.errors import InputError, UsageError
from thirdbody.scene.model import Scene
from thirdbody.schema.parts import key_location


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
    """Give faults, which a population reports by its own keys, their places in the scene."""
    try:
        yield
    except InputError as error:
        result = [(key_location(fault.key), fault.message) for fault in error.faults]
        raise InputError(scene.fault(("debris", index, *location), message) for location, message in result) from None
