"""`solver.initial_overlap = "relax"`: bodies that overlap at the start are pushed apart before the run, or refused."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from thirdbody import units
from thirdbody.assembly.physics import CompiledPhysics
from thirdbody.assembly.populate import position_key, refuse_outside
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
    start = _Start(scene, placed, members)
    before = start.removal.overlaps()
    expected = expected_overlap(scene, choice, placed)
    if before.largest <= expected:
        return placed, _change(before, before, expected, np.zeros((0, 4)), 0.0)
    start.refuse_coincident()
    after = start.relax(before, expected)
    # bodies that did not move have the bits of the start
    x0, q0, removal = placed.positions[members], placed.quaternions[members], start.removal
    same_x, same_q = ((new == old).all(axis=1) for new, old in zip((removal.X, removal.Q), start.first, strict=True))
    x, q = np.where(same_x[:, None], x0, removal.X * start.unit), np.where(same_q[:, None], q0, removal.Q)
    moved = np.flatnonzero((x != x0).any(axis=1) | (q != q0).any(axis=1))
    displacements = np.linalg.norm(x - x0, axis=1)[moved] / [0.5 * placed.clumps[members[k]].diameter for k in moved]
    positions, quaternions = placed.positions.copy(), placed.quaternions.copy()
    positions[members], quaternions[members] = x, q
    result = replace(placed, positions=positions, quaternions=quaternions)
    refuse_outside(scene, result)
    return result, _change(before, after, expected, displacements, (start.highest() - start.top) * start.unit)


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


def _change(before: Overlaps, after: Overlaps, expected: float, displacements: np.ndarray, height_gain: float) -> RelaxedStart:
    far, mean = (float(displacements.max()), float(displacements.mean())) if len(displacements) else (0.0, 0.0)
    pairs = len(before.depth), len(after.depth)
    return RelaxedStart(len(displacements), far, mean, *pairs, before.largest, after.largest, expected, height_gain)


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
        self.first = self.removal.X.copy(), self.removal.Q.copy()
        self.volume = sum(body.volume for body in clumps)
        self.top = self.highest()

    def refuse_coincident(self) -> None:
        """Raise InputError for bodies whose centres of mass coincide."""
        X, radius = self.removal.X, np.array([0.5 * self.placed.clumps[k].diameter / self.unit for k in self.members])
        overlaps = self.removal.overlaps()
        pairs = overlaps.second >= 0
        a, b = overlaps.first[pairs], overlaps.second[pairs]
        between = X[a] - X[b]
        if self.removal.walls.periodic:
            period = self.removal.walls.high[:2]
            between[:, :2] -= period * np.round(between[:, :2] / period)
        coincide = np.flatnonzero(np.linalg.norm(between, axis=1) < _COINCIDENT * np.minimum(radius[a], radius[b]))
        if len(coincide):
            more = f" ({len(coincide)} pairs)" if len(coincide) > 1 else ""
            message = (
                f"bodies {self.members[a[coincide[0]]]} and {self.members[b[coincide[0]]]} have the same centre{more}: "
                'initial_overlap = "relax" has no direction to push them apart; is a body given twice?'
            )
            raise self._refused(int(b[coincide[0]]), message)

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
        raise self._refused(int(after.first[0]), self._reason(outcome, before, after))

    def highest(self) -> float:
        """Return the height of the highest point, in units."""
        self.removal.overlaps()  # computes the spheres
        return float((self.removal.S[:, 2] + self.removal.radii).max())

    def _refused(self, body: int, message: str) -> InputError:
        return InputError(self.scene.fault(position_key(self.scene, self.placed, int(self.members[body])), message))

    def _reason(self, outcome: RemovalOutcome, before: Overlaps, after: Overlaps) -> str:
        a, b = int(after.first[0]), int(after.second[0])
        who = f"body {self.members[a]} and {_WALLS[b]}" if b < 0 else f"bodies {self.members[a]} and {self.members[b]}"
        what = (
            f'initial_overlap = "relax": {who} still overlap by {after.largest:.2g} of the radius '
            f"({len(after.depth)} pairs overlap; at the start {len(before.depth)}, by {before.largest:.2g})"
        )
        height = float(self.removal.walls.high[2]) * self.unit
        size = self.scene.domain.size
        fraction = self.volume / (size[0] * size[1] * height)
        if outcome is RemovalOutcome.SPENT:
            return f"{what}; the limit of {_LIMIT} steps is reached"
        if math.isfinite(height) and fraction > _CROWDED:
            filled = f"would fill {fraction:.2g} of the space up to the plate"
            return f"{what}: too little room, the bodies {filled}; raise gap or domain.size, or give a load instead of a gap"
        single = all(len(self.placed.clumps[k].radii) == 1 for k in self.members[[a, max(a, b)]])
        why = "too little room" if single else "they are interlocked, or have too little room"
        return f"{what}: {why}"
