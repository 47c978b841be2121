"""`solver.initial_overlap = "relax"`: bodies that overlap at the start are pushed apart before the run, or refused."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from thirdbody import units
from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.populate import outside, position_key
from thirdbody.assembly.schedule import first_load
from thirdbody.bodies.overlap_removal import CEILING, FLOOR, OverlapRemoval, Overlaps, RemovalOutcome, Walls
from thirdbody.engine.placed import Placed
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene
from thirdbody.statics.contacts import overlap_at

_CLEARANCE = 1e-4
"""Gap over the sum of radii that bodies pushed apart are given; at half of it they count as apart."""

_LIMIT = 20_000
"""Largest number of steps; a bed of ten layers that overlap by 0.6 of the radius takes some hundred."""

_KICKS, _KICK = 3, 0.02
"""Attempts to leave a balance of overlapping bodies, such as a straight row, and the displacement over the mean radius."""

_COINCIDENT = 1e-3
"""Distance of two centres of mass over the smaller radius below which no direction to push the bodies apart is certain."""

UNLOADED_OVERLAP = 1e-4
"""Overlap over the radius to expect where no load is prescribed: at it spheres are as good as rigid (stiffness 1e4 times the
pressure: Roux and Combe, C. R. Physique 3, 2002, 131; da Cruz et al., Phys. Rev. E 72, 2005, 021309)."""

_CROWDED = 0.5
"""Solid fraction below the upper plate from which a jam means too little room: random loose packings begin there."""

_WALLS = {FLOOR: "the lower plate", CEILING: "the upper plate"}


@dataclass(frozen=True)
class RelaxedStart:
    """What the relaxation of the start changed: bodies moved or turned, overlapping pairs of bodies or of a body and a plate.

    Displacements of the centres of mass of moved bodies are over the radius of the sphere of the body's volume, overlaps over the
    smaller radius of two spheres: the deepest ones, and the one that the load leads to expect, up to which overlaps may remain.
    `height_gain`: rise of the highest point of the debris [m].
    """

    bodies_moved: int
    largest_displacement: float
    mean_displacement: float
    pairs_before: int
    pairs_after: int
    overlap_before: float
    overlap_after: float
    expected_overlap: float
    height_gain: float

    def text(self, n_bodies: int) -> str:
        """Describe the change in one line."""
        before = f"{self.pairs_before} pairs overlapped, by {self.overlap_before:.2g} of the radius at most"
        if not self.pairs_before:
            return 'initial_overlap = "relax": nothing overlaps at the start, no body was moved'
        after = f"{self.pairs_after} by {self.overlap_after:.2g}" if self.pairs_after else "none"
        if not self.bodies_moved:
            return f'initial_overlap = "relax": {before}, no more than expected ({self.expected_overlap:.2g}): no body was moved'
        higher = f"; their top is {units.pretty(self.height_gain, 'length')} higher" if self.height_gain > 0.0 else ""
        return (
            f'initial_overlap = "relax": {self.bodies_moved} of {n_bodies} bodies were pushed apart, by '
            f"{self.largest_displacement:.2g} of their radius at most and {self.mean_displacement:.2g} in the mean; before: "
            f"{before}; now: {after} (expected ones: up to {self.expected_overlap:.2g}){higher}"
        )


def relax_start(scene: Scene, choice: CompiledPhysics, placed: Placed) -> tuple[Placed, RelaxedStart | None]:
    """Return the bodies without overlaps that exceed the expected ones, and what was changed; None where none is asked for.

    Bodies are moved before the run (FIRE) and keep their velocities, so overlaps release no energy. Plates are walls: the lower
    one, and an upper one at a gap; a loaded one comes to rest on what is highest. Bodies that reach over the border of a domain
    that is not periodic are pushed inside with the others. Bodies given by spots, bound to a plate, stay. Raises InputError where
    larger overlaps remain.
    """
    if scene.solver.initial_overlap != "relax":
        return placed, None
    members = np.array([k for k, body in enumerate(placed.clumps) if body.sides is None], np.int64)
    if not len(members):
        return placed, RelaxedStart(0, 0.0, 0.0, 0, 0, 0.0, 0.0, UNLOADED_OVERLAP, 0.0)
    start, expected = _Start(scene, placed, members), expected_overlap(scene, choice, placed)
    before = after = start.removal.overlaps()
    x0, q0, top = placed.positions[members], placed.quaternions[members], start.highest()
    displacements, result = np.zeros(0), placed
    if before.largest > expected:
        start.refuse_coincident(before)
        after = start.relax(before, expected)
        # bodies that did not move have the bits of the start
        X, Q = start.removal.X, start.removal.Q
        x = np.where((X == start.first).all(axis=1)[:, None], x0, X * start.unit)
        q = np.where((Q == q0).all(axis=1)[:, None], q0, Q)
        moved = np.flatnonzero((x != x0).any(axis=1) | (q != q0).any(axis=1))
        displacements = np.linalg.norm(x - x0, axis=1)[moved] / [0.5 * placed.clumps[members[k]].diameter for k in moved]
        result = replace(placed, positions=placed.positions.copy(), quaternions=placed.quaternions.copy())
        result.positions[members], result.quaternions[members] = x, q
        if faults := outside(scene, result):
            raise InputError(faults)
    far, mean = (float(displacements.max()), float(displacements.mean())) if len(displacements) else (0.0, 0.0)
    pairs, height_gain = (len(before.depth), len(after.depth)), (start.highest() - top) * start.unit
    return result, RelaxedStart(len(displacements), far, mean, *pairs, before.largest, after.largest, expected, height_gain)


def expected_overlap(scene: Scene, choice: CompiledPhysics, placed: Placed) -> float:
    """Return the overlap over the radius to expect: the least of two equal spheres under the first load.

    A body of diameter d carries the pressure times d^2, or its own load.
    """
    plate = scene.plates.upper
    load = 0.0 if plate is None else first_load(scene)
    if load <= 0.0:
        return UNLOADED_OVERLAP
    assert plate is not None
    diameter = np.array([body.diameter for body in placed.clumps])
    area = scene.domain.size[0] * scene.domain.size[1]
    force = np.full(len(diameter), load) if plate.support == "load_per_particle" else load * diameter**2 / area
    radius = np.array([float(body.radii.mean()) for body in placed.clumps])
    kind = choice.physics.kinds[placed.materials, placed.materials]
    return float(np.min(overlap_at(choice.physics, force, 0.5 * radius, kind) / radius))


class _Start:
    """Bodies of the start in units of their mean radius, with the removal of their overlaps."""

    def __init__(self, scene: Scene, placed: Placed, members: np.ndarray) -> None:
        self.scene, self.placed, self.members = scene, placed, members
        clumps = [placed.clumps[k] for k in members]
        self.unit = float(np.mean([body.radii.mean() for body in clumps]))
        # the space in which bodies are pushed apart: infinite where nothing bounds it
        plate, low, high = scene.plates.upper, np.full(3, -math.inf), np.full(3, math.inf)
        if scene.domain.periodic or scene.plates.lower is not None:
            low[:2], high[:2] = 0.0, scene.domain.size
        if scene.plates.lower is not None:
            low[2] = 0.0
        if plate is not None and plate.support == "rigid" and plate.gap is not None:
            high[2] = plate.gap
        walls = Walls(low / self.unit, high / self.unit, scene.domain.periodic, _CLEARANCE)
        meet = scene.contact.debris_contact != "none"
        self.removal = OverlapRemoval([body.scaled(1.0 / self.unit) for body in clumps], walls, meet)
        self.removal.X, self.removal.Q = placed.positions[members] / self.unit, placed.quaternions[members].copy()
        self.first = self.removal.X.copy()

    def highest(self) -> float:
        """Return the height of the highest point after a search, in units."""
        return float((self.removal.S[:, 2] + self.removal.radii).max())

    def refuse_coincident(self, overlaps: Overlaps) -> None:
        """Raise InputError for bodies whose centres of mass coincide."""
        X, radius = self.removal.X, np.array([0.5 * self.placed.clumps[k].diameter / self.unit for k in self.members])
        a, b = (bodies[overlaps.second >= 0] for bodies in overlaps[:2])
        between = X[a] - X[b]
        if self.removal.walls.periodic:
            period = self.removal.walls.high[:2]
            between[:, :2] -= period * np.round(between[:, :2] / period)
        coincide = np.flatnonzero(np.linalg.norm(between, axis=1) < _COINCIDENT * np.minimum(radius[a], radius[b]))
        if len(coincide):
            more, (one, other) = f" ({len(coincide)} pairs)" if len(coincide) > 1 else "", (a[coincide[0]], b[coincide[0]])
            message = (
                f"bodies {self.members[one]} and {self.members[other]} have the same centre{more}: "
                'initial_overlap = "relax" has no direction to push them apart; is a body given twice?'
            )
            raise self._refused(other, message)

    def relax(self, before: Overlaps, expected: float) -> Overlaps:
        """Remove the overlaps and return what remains. Raises InputError for more than the expected ones."""
        left, rng, removal = _LIMIT, np.random.default_rng(0), self.removal
        for _ in range(1 + _KICKS):
            outcome, done = removal.relax(1.0, left)
            left -= done
            after = removal.overlaps()
            if outcome is RemovalOutcome.RELAXED or after.largest <= expected:
                return after
            if outcome is RemovalOutcome.SPENT:
                break
            pushed = np.unique(np.concatenate((after.first, after.second[after.second >= 0])))
            removal.X[pushed] += _KICK * rng.standard_normal((len(pushed), 3))
        a, b = int(after.first[0]), int(after.second[0])
        who = f"body {self.members[a]} and {_WALLS[b]}" if b < 0 else f"bodies {self.members[a]} and {self.members[b]}"
        bodies, height = [self.placed.clumps[k] for k in self.members], float(removal.walls.high[2]) * self.unit
        fraction = sum(body.volume for body in bodies) / (math.prod(self.scene.domain.size) * height)
        if outcome is RemovalOutcome.SPENT:
            why = f"; the limit of {_LIMIT} steps is reached"
        elif math.isfinite(height) and fraction > _CROWDED:
            filled = f"would fill {fraction:.2g} of the space up to the plate"
            why = f": too little room, the bodies {filled}; raise gap or domain.size, or give a load instead of a gap"
        else:
            single = all(len(bodies[k].radii) == 1 for k in (a, max(a, b)))
            why = ": too little room" if single else ": they are interlocked, or have too little room"
        message = (
            f'initial_overlap = "relax": {who} still overlap by {after.largest:.2g} of the radius '
            f"({len(after.depth)} pairs overlap; at the start {len(before.depth)}, by {before.largest:.2g}){why}"
        )
        raise self._refused(a, message)

    def _refused(self, body: int, message: str) -> InputError:
        return InputError(self.scene.fault(position_key(self.scene, self.placed, int(self.members[body])), message))
