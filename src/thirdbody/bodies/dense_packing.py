"""Dense beds: rigid bodies grow in a box of given solid fraction while their overlaps are removed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thirdbody.bodies.bed_relaxation import Outcome, Walls
from thirdbody.bodies.clump import Clump
from thirdbody.bodies.overlap_removal import OverlapRemoval
from thirdbody.bodies.random_sequential import refuse_long, scatter
from thirdbody.errors import Fault, InputError

# Target gap over the sum of radii. A state counts as free of overlap at half of it: convergence to exactly zero
# overlap would take forever.
_CLEARANCE = 1e-3
# Solid fraction at the start, by random addition: so dilute that even long bodies are placed at once.
_START = 0.08
# Steps of ln(size): the first, and the one at which growth stops (0.3 % of the solid fraction).
_STEP, _MIN_STEP = 0.08, 1e-3
# Relaxation steps per growth step: states free of overlap mostly take some hundred, nearly jammed ones some thousand.
_LIMIT = 4000


@dataclass(frozen=True)
class Bed:
    """Centroids (n, 3) [m], quaternions (n, 4), solid fraction and height [m] up to the highest point."""

    positions: np.ndarray
    quaternions: np.ndarray
    solid_fraction: float
    height: float


def pack(
    clumps: Sequence[Clump], fraction: float, domain_size: tuple[float, float], periodic: bool, rng: np.random.Generator
) -> Bed:
    """Return a bed of the bodies on z = 0 with this solid fraction, up to the highest point.

    The bodies, scaled down, are scattered in the final box and grow to their true size in steps; after each step FIRE removes the
    overlaps of the rigid bodies (soft repulsion, as O'Hern et al. 2003, who detect jamming this way). A step after which overlaps
    remain is undone and halved. No spheres of different bodies touch at the end: gaps are at least 5e-4 of the sum of radii. In a
    domain that is not periodic the box has walls. The bed ends slightly denser than requested, because of its gaps. InputError:
    the box is lower than the largest sphere, or the bodies jam before their true size; the message gives the fraction reached.
    """
    size = np.array(domain_size, dtype=np.float64)
    refuse_long(clumps, size, periodic)
    volume = sum(body.volume for body in clumps)
    height = volume / (fraction * float(size.prod()))
    _refuse_low(clumps, height)
    unit = float(np.mean([body.radii.mean() for body in clumps]))
    box = np.array([*size, height]) / unit
    growing = _Growing([body.scaled(1.0 / unit) for body in clumps], box, periodic)
    grown = growing.grow(growing.start(fraction, rng))
    if grown < 1.0:
        reached = fraction * grown**3
        raise InputError(
            Fault(
                "solid_fraction",
                f"the bodies jam: a solid fraction of about {reached:.3f} is reached, {fraction:.3f} wanted (a bed "
                f"{height:.3g} m high)",
            )
        )
    bed = growing.bodies
    x, q = bed.X * unit, bed.Q.copy()
    z, r = bed.S[:, 2] * unit, np.concatenate([body.radii for body in clumps])
    floor = float((z - r).min())
    x[:, 2] -= floor
    top = float((z + r).max()) - floor
    x[:, :2] -= np.floor(x[:, :2] / size) * size if periodic else 0.0
    return Bed(x, q, volume / (float(size.prod()) * top), top)


class _Growing:
    """Growing bodies; lengths in units of the mean radius."""

    def __init__(self, clumps: Sequence[Clump], box: np.ndarray, periodic: bool) -> None:
        self.clumps, self.box, self.periodic = clumps, box, periodic
        self.bodies = OverlapRemoval(clumps, Walls(np.zeros(3), box, periodic, _CLEARANCE))

    def start(self, fraction: float, rng: np.random.Generator) -> float:
        """Scatter the bodies, scaled down; return their size over the true one. Raises InputError when no size fits."""
        x, y, _ = self.box
        height, shrunk = float(self.box[2]), min(1.0, (_START / fraction) ** (1.0 / 3.0))
        while True:
            try:
                bodies = [body.scaled(shrunk) for body in self.clumps]
                self.bodies.X, self.bodies.Q = scatter(bodies, height, (float(x), float(y)), self.periodic, rng)
                return shrunk
            except InputError:
                if shrunk < 0.1:
                    raise
                shrunk *= 0.7

    def grow(self, size: float) -> float:
        """Grow from this size on; return 1, or the largest size without overlaps."""
        step = _STEP
        while True:
            x, q = self.bodies.X.copy(), self.bodies.Q.copy()
            trial = min(1.0, size * math.exp(step))
            if self.bodies.relax(trial, _LIMIT)[0] is Outcome.RELAXED:
                if trial == 1.0:
                    return 1.0
                size, step = trial, min(1.5 * step, _STEP)
                continue
            self.bodies.X, self.bodies.Q, step = x, q, 0.5 * step
            if step < _MIN_STEP:
                return size


def _refuse_low(clumps: Sequence[Clump], height: float) -> None:
    largest = 2.0 * max(float(body.radii.max()) for body in clumps)
    if height < largest * (1.0 + 2.0 * _CLEARANCE):
        message = (
            f"the bed would be {height:.3g} m high, lower than its largest sphere, {largest:.3g} m: raise count or lower "
            'solid_fraction or domain.size, or lay the bodies with placement = "layer"'
        )
        raise InputError(Fault("solid_fraction", message))
