"""A particle that its contacts do not hold moves on until its forces balance: relaxation; and finite rotations.

Where no balance of forces exists near the last one, the particle moves on against a resistance proportional to its velocity
until its forces balance again. A step is one of implicit Euler, force(y) = resistance (y - y_last), and the resistance falls
from step to step, so that the last ones are Newton's (pseudo-transient continuation: C. T. Kelley, D. E. Keyes, SIAM J. Numer.
Anal. 35, 1998). The laws remember what happens on the way. Rotations are finite: after every step the spots, spheres that turn
with the particle, are placed anew, and the rotation of linear kinematics starts from zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.quasistatic import ACCEPTED, Grip, NoStaticState, QuasiStatic, Trial, after
from thirdbody.engine.state import Array

LARGEST_TURN = 0.5
"""Rotation, rad, beyond which a particle that still moves has tipped over."""
SMALL_TURN = 0.01
"""Rotation, rad, beyond which the particle has left the last balance."""
STEPS, NEWTON_STEPS, HALVINGS = 5000, 20, 6
SOLVED = 1e-6
"""Unbalanced share of the forces, resistance included, that ends a step."""
SLOWER, FASTER = 4.0, 3.0
"""Factors of the resistance after a step that failed, and after one that did not."""
BENT, BENT_PATH = 0.5, 0.01
"""Shares of the largest overlap by which a step, and a path, may leave the circle that a spot moves on."""
CAUTION = 0.8
"""Share of the largest rotation of a step that the next one aims at."""
STRONGEST, WEAKEST = 1e6, 1e-12
"""Bounds of the resistance, in parts of the stiffness."""


def relax(walk: QuasiStatic, plate: Sequence[float]) -> bool:
    """Bring `walk` to a balance at `plate` next to its last one, where Newton's method finds none: laws of springs have corners.

    False, with `walk` as it was, if the particle has to turn by more than `SMALL_TURN`.
    """
    if walk.now is None:
        return False
    last, memory = walk.now, walk.memory
    near = _Relaxation(walk, np.asarray(plate, float), SMALL_TURN)
    near.put(walk.now.coordinates, memory)
    if near.comes_to_rest():
        return True
    walk.now, walk.memory = last, memory
    return False


def seat(walk: QuasiStatic, plate: Sequence[float]) -> QuasiStatic:
    """A solver under load, in balance where the particle comes to rest at `plate`, the load, N, and the drag x, y, m.

    The particle starts from the last balance of `walk`, else upright. Raises NoStaticState if it tips over.
    """
    moving = _Turning(walk, np.asarray(plate, float))
    if moving.comes_to_rest():
        return moving.solver
    assert moving.solver.now is not None
    rest = moving.solver.now.rest
    if moving.exhausted:
        raise NoStaticState(f"the search ended after a turn of {moving.turn:.2g} rad", moving.plate, rest, undecided=True)
    raise NoStaticState(f"it turns by {LARGEST_TURN} rad and finds no balance on the way", moving.plate, rest)


def from_first_touch(seated: QuasiStatic, walk: QuasiStatic) -> QuasiStatic:
    """A solver like `walk` in the posture of `seated`: coordinates and rotations count from first touch in it."""
    assert seated.now is not None
    grip, y, up = seated.grip, seated.now.coordinates.copy(), seated.grip.upper
    above, below = float(grip.gap[up].min()), float(grip.gap[~up].min())
    y[: seated.vertical] = 0.0
    y[seated.vertical] += below
    y[-1] -= above + below
    result = QuasiStatic(replace(grip, gap=grip.gap - np.where(up, above, below)), walk.contacts, walk.under_load)
    result.turned = after(walk.turned, seated.gone)
    plate = seated.now.plate if walk.under_load else np.array([y[-1], 0.0, 0.0])
    result.adopt(y if walk.under_load else y[:-1], plate, seated.memory)
    return result


def in_present_posture(walk: QuasiStatic, minimum: float = BENT_PATH) -> QuasiStatic:
    """A solver like `walk`, at its last balance, whose kinematics is linear about the present posture.

    `walk` itself while the circles that the spots move on leave the straight lines by less than `minimum` overlaps.
    """
    assert walk.now is not None
    rotation_vector = walk.now.coordinates[walk.rotations]
    if float(rotation_vector @ rotation_vector) / walk.grip.arm <= minimum * float(walk.now.overlap.max()):
        return walk
    rotation, coordinates = np.zeros(3), walk.now.coordinates.copy()
    rotation[walk.axes] = rotation_vector / walk.grip.arm
    coordinates[walk.rotations] = 0.0
    place = _rotated_spots(walk.grip, walk.contacts.radius, rotation)
    rise = place[:, 2] - walk.grip.place[:, 2]
    gap = walk.grip.gap + np.where(walk.grip.upper, -rise, rise)
    result = QuasiStatic(replace(walk.grip, place=place, gap=gap), walk.contacts, walk.under_load)
    result.turned, result.gone = walk.turned, after(walk.gone, rotation)
    result.adopt(coordinates, walk.now.plate, walk.memory)
    assert result.now is not None
    result.now = replace(result.now, slip=walk.now.slip)
    return result


class _Relaxation:
    """A particle on its way to a balance, at the end of a step."""

    def __init__(self, solver: QuasiStatic, plate: Array, farthest: float) -> None:
        self.solver, self.plate, self.farthest = solver, plate, farthest
        self.turn = 0.0  # rad, from the start
        self.exhausted = False  # whether the search ended without an answer
        # displacement of the coordinates in the last step, times its resistance: what the next step is expected to repeat
        self.push = np.zeros(solver.rows.shape[2])

    def put(self, coordinates: Array, memory: Array) -> None:
        """Go on from here; the slip so far is kept."""
        now = self.solver.now
        self.solver.adopt(coordinates, self.plate, memory)
        if now is not None and self.solver.now is not None:
            self.solver.now = replace(self.solver.now, slip=now.slip)

    def comes_to_rest(self) -> bool:
        """Move until the forces balance; whether they do before the particle has turned too far."""
        assert self.solver.now is not None
        stiff = float(np.linalg.norm(self.solver.jacobian(self.solver.trial(self.solver.now.coordinates, self.plate)), 2))
        resistance = stiff
        for _ in range(STEPS):
            result = self._step(resistance)
            if result is None:
                resistance *= SLOWER
                if resistance > STRONGEST * stiff:
                    break
                continue
            self.push = resistance * (result.y - self.solver.now.coordinates)
            self.accept(result)
            if result.rest <= ACCEPTED:
                return True
            if self.turn > self.farthest:
                return False
            resistance = max(resistance / FASTER, self._least_resistance(result), WEAKEST * stiff)
        self.exhausted = True
        return False

    def accept(self, trial: Trial) -> None:
        """Make the end of a step the start of the next."""
        assert self.solver.now is not None
        part = self.solver.rotations
        self.turn += float(np.linalg.norm(trial.y[part] - self.solver.now.coordinates[part])) / self.solver.grip.arm
        slip = np.where(trial.overlap > 0.0, self.solver.now.slip + trial.answer.slip, 0.0)
        self.put(trial.y, trial.answer.memory)
        self.solver.now = replace(self.solver.now, slip=slip)

    def _step(self, resistance: float) -> Trial | None:
        """The end of one step of implicit Euler; None if none is found, or if it turns too far for linear kinematics."""
        solver = self.solver
        assert solver.now is not None
        start = solver.now.coordinates
        guesses = [solver.trial(start, self.plate)]
        if self.push.any():
            guesses.append(solver.trial(start + self.push / resistance, self.plate))
        trial = min(guesses, key=lambda guess: float(np.linalg.norm(guess.force - resistance * (guess.y - start))))
        for _ in range(NEWTON_STEPS):
            force = trial.force - resistance * (trial.y - start)
            if float(np.abs(force).max()) <= min(SOLVED, 0.1 * trial.rest) * trial.scale or trial.rest <= ACCEPTED:
                bent = float(np.sum((trial.y[solver.rotations] - start[solver.rotations]) ** 2)) / solver.grip.arm
                return trial if bent <= BENT * float(trial.overlap.max()) else None
            jacobian = solver.jacobian(trial) - resistance * np.eye(len(start))
            step = np.linalg.lstsq(jacobian, -force, rcond=None)[0]
            better = self._search(trial, step, start, resistance)
            if better is None:
                return None
            trial = better
        return None

    def _least_resistance(self, last: Trial) -> float:
        """The resistance at which the next step is expected to turn no further than linear kinematics holds."""
        allowed = CAUTION * math.sqrt(BENT * max(float(last.overlap.max()), 0.0) * self.solver.grip.arm)
        return float(np.linalg.norm(self.push[self.solver.rotations])) / allowed if allowed > 0.0 else 0.0

    def _search(self, trial: Trial, step: NDArray, start: Array, resistance: float) -> Trial | None:
        """The first point on the way back from the full step with less unbalanced force."""
        part = self.solver.longest_part(trial, step)
        size = float(np.linalg.norm(trial.force - resistance * (trial.y - start)))
        for _ in range(HALVINGS):
            tried = self.solver.trial(trial.y + part * step, self.plate)
            if float(np.linalg.norm(tried.force - resistance * (tried.y - start))) < (1.0 - 1e-4 * part) * size:
                return tried
            part *= 0.5
        return None


class _Turning(_Relaxation):
    """The same under load, with finite rotations."""

    def __init__(self, walk: QuasiStatic, plate: Array) -> None:
        solver = QuasiStatic(walk.grip, walk.contacts, True)
        solver.turned, solver.gone = walk.turned, walk.gone
        super().__init__(solver, plate, LARGEST_TURN)
        self.start = walk.gone
        start = solver.upright(plate)
        if walk.now is not None:
            start = walk.now.coordinates if walk.under_load else np.append(walk.now.coordinates, walk.now.closing)
        self.put(start, walk.memory)
        if walk.now is not None and solver.now is not None:
            solver.now = replace(solver.now, slip=walk.now.slip)

    def accept(self, trial: Trial) -> None:
        """Go on from the end of a step, in the posture there."""
        super().accept(trial)
        self.solver = in_present_posture(self.solver, 0.0)
        self.turn = float(np.linalg.norm(after(-self.start, self.solver.gone)))


def _rotated_spots(grip: Grip, radius: Array, rotation: Array) -> Array:
    """The spots (n, 3) of a particle turned by a rotation vector: summits of spheres that turn with it."""
    from scipy.spatial.transform import Rotation  # a fifth of a second of imports

    summit = np.zeros_like(grip.place)
    summit[:, 2] = np.where(grip.upper, radius, -radius)
    return Rotation.from_rotvec(rotation).apply(grip.place - summit) + summit
