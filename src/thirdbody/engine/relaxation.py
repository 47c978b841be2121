"""Relaxation of a particle without a nearby equilibrium, with finite rotations.

Where no equilibrium exists near the last one, the particle moves against a resistance proportional to its velocity until its
forces balance again. Each step is implicit Euler, force(y) = resistance (y - y_last), with a resistance that falls from step to
step, so that the last steps are Newton's (pseudo-transient continuation: C. T. Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35,
1998). Contact histories follow this motion. Rotations are finite: after every step the positions of the spots, summits of
spheres that rotate with the particle, are recomputed, and the rotation of linear kinematics restarts from zero.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.quasistatic import ACCEPTED, Grip, NoStaticState, QuasiStatic, Trial, after
from thirdbody.engine.state import Array

MAX_ROTATION = 0.5
"""Rotation [rad] beyond which a particle that still moves has tipped over."""
SMALL_ROTATION = 0.01
"""Rotation [rad] beyond which the particle has left the last equilibrium."""
STEPS, NEWTON_STEPS, HALVINGS = 5000, 20, 6
SOLVED = 1e-6
"""Tolerance of the relative residual, resistance included, of a step."""
SLOWER, FASTER = 4.0, 3.0
"""The resistance is multiplied by SLOWER after a failed step, and divided by FASTER after a successful one."""
BENT, BENT_PATH = 0.5, 0.01
"""Largest deviation of a step, and of a path, from the circular motion of a spot, over the largest overlap."""
CAUTION = 0.8
"""Target rotation of the next step over the largest allowed one."""
STRONGEST, WEAKEST = 1e6, 1e-12
"""Bounds of the resistance over the stiffness."""


def relax(solver: QuasiStatic, plate: Sequence[float]) -> bool:
    """Move a solver to an equilibrium near its last one where Newton's method fails: at the corners of laws of springs.

    Parameters
    ----------
    solver : QuasiStatic
        The solver.
    plate : sequence of float (3,)
        Closing [m] or load [N], and drag x, y [m].

    Returns
    -------
    bool
        False, with `solver` unchanged, if the particle would have to rotate by more than `SMALL_ROTATION`.
    """
    if solver.now is None:
        return False
    last, memory = solver.now, solver.memory
    near = _Relaxation(solver, np.asarray(plate, float), SMALL_ROTATION)
    near.put(solver.now.coordinates, memory)
    if near.comes_to_rest():
        return True
    solver.now, solver.memory = last, memory
    return False


def seat(solver: QuasiStatic, plate: Sequence[float]) -> QuasiStatic:
    """Return a solver under load, in equilibrium where the particle comes to rest.

    Parameters
    ----------
    solver : QuasiStatic
        The particle starts from its last equilibrium, or else upright.
    plate : sequence of float (3,)
        Load [N] and drag x, y [m].

    Returns
    -------
    QuasiStatic

    Raises
    ------
    NoStaticState
        It tips over.
    """
    moving = _TippingRelaxation(solver, np.asarray(plate, float))
    if moving.comes_to_rest():
        return moving.solver
    assert moving.solver.now is not None
    residual = moving.solver.now.residual
    if moving.exhausted:
        raise NoStaticState(
            f"the search ended after a rotation of {moving.rotation:.2g} rad", moving.plate, residual, undecided=True
        )
    raise NoStaticState(f"it rotates by {MAX_ROTATION} rad and reaches no equilibrium", moving.plate, residual)


def from_first_touch(seated: QuasiStatic, solver: QuasiStatic) -> QuasiStatic:
    """Return a solver with motion measured from first touch in another posture.

    Parameters
    ----------
    seated : QuasiStatic
        Its last equilibrium gives the posture.
    solver : QuasiStatic
        Its laws and plates are kept.

    Returns
    -------
    QuasiStatic
    """
    assert seated.now is not None
    grip, y, up = seated.grip, seated.now.coordinates.copy(), seated.grip.upper
    above, below = float(grip.gap[up].min()), float(grip.gap[~up].min())
    y[: seated.vertical] = 0.0
    y[seated.vertical] += below
    y[-1] -= above + below
    result = QuasiStatic(replace(grip, gap=grip.gap - np.where(up, above, below)), solver.contacts, solver.under_load)
    result.seat_rotation = after(solver.seat_rotation, seated.rotation_since_touch)
    plate = seated.now.plate if solver.under_load else np.array([y[-1], 0.0, 0.0])
    result.adopt(y if solver.under_load else y[:-1], plate, seated.memory)
    return result


def in_present_posture(solver: QuasiStatic, minimum: float = BENT_PATH) -> QuasiStatic:
    """Return a solver at the last equilibrium of another, linearised at that orientation.

    Parameters
    ----------
    solver : QuasiStatic
        The solver.
    minimum : float
        Deviation of the circular paths of the spots from straight lines, in overlaps, below which `solver` itself is returned.

    Returns
    -------
    QuasiStatic
    """
    assert solver.now is not None
    rotation_vector = solver.now.coordinates[solver.rotations]
    if float(rotation_vector @ rotation_vector) / solver.grip.arm <= minimum * float(solver.now.overlap.max()):
        return solver
    rotation, coordinates = np.zeros(3), solver.now.coordinates.copy()
    rotation[solver.axes] = rotation_vector / solver.grip.arm
    coordinates[solver.rotations] = 0.0
    position = _rotated_spots(solver.grip, solver.contacts.radius, rotation)
    lift = position[:, 2] - solver.grip.position[:, 2]
    gap = solver.grip.gap + np.where(solver.grip.upper, -lift, lift)
    result = QuasiStatic(replace(solver.grip, position=position, gap=gap), solver.contacts, solver.under_load)
    result.seat_rotation, result.rotation_since_touch = solver.seat_rotation, after(solver.rotation_since_touch, rotation)
    result.adopt(coordinates, solver.now.plate, solver.memory)
    assert result.now is not None
    result.now = replace(result.now, slip=solver.now.slip)
    return result


class _Relaxation:
    """Relaxation of a particle towards equilibrium; the state is that at the end of a step."""

    def __init__(self, solver: QuasiStatic, plate: Array, farthest: float) -> None:
        self.solver, self.plate, self.farthest = solver, plate, farthest
        self.rotation = 0.0  # rotation since the start [rad]
        self.exhausted = False  # whether the search ended undecided
        # change of the coordinates in the last step times its resistance: the prediction for the next step
        self.push = np.zeros(solver.rows.shape[2])

    def put(self, coordinates: Array, memory: Array) -> None:
        """Continue from these coordinates and history, with the accumulated slip."""
        now = self.solver.now
        self.solver.adopt(coordinates, self.plate, memory)
        if now is not None and self.solver.now is not None:
            self.solver.now = replace(self.solver.now, slip=now.slip)

    def comes_to_rest(self) -> bool:
        """Move until the forces balance; return whether they do before the largest rotation is reached."""
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
            if result.residual <= ACCEPTED:
                return True
            if self.rotation > self.farthest:
                return False
            resistance = max(resistance / FASTER, self._min_resistance(result), WEAKEST * stiff)
        self.exhausted = True
        return False

    def accept(self, trial: Trial) -> None:
        """Accept a step: its end is the start of the next one."""
        assert self.solver.now is not None
        part = self.solver.rotations
        self.rotation += float(np.linalg.norm(trial.y[part] - self.solver.now.coordinates[part])) / self.solver.grip.arm
        slip = np.where(trial.overlap > 0.0, self.solver.now.slip + trial.answer.slip, 0.0)
        self.put(trial.y, trial.answer.memory)
        self.solver.now = replace(self.solver.now, slip=slip)

    def _step(self, resistance: float) -> Trial | None:
        """Return the end of one step of implicit Euler; None without solution or with too large a rotation."""
        solver = self.solver
        assert solver.now is not None
        start = solver.now.coordinates
        guesses = [solver.trial(start, self.plate)]
        if self.push.any():
            guesses.append(solver.trial(start + self.push / resistance, self.plate))
        trial = min(guesses, key=lambda guess: float(np.linalg.norm(guess.force - resistance * (guess.y - start))))
        for _ in range(NEWTON_STEPS):
            force = trial.force - resistance * (trial.y - start)
            if float(np.abs(force).max()) <= min(SOLVED, 0.1 * trial.residual) * trial.scale or trial.residual <= ACCEPTED:
                bent = float(np.sum((trial.y[solver.rotations] - start[solver.rotations]) ** 2)) / solver.grip.arm
                return trial if bent <= BENT * float(trial.overlap.max()) else None
            jacobian = solver.jacobian(trial) - resistance * np.eye(len(start))
            step = np.linalg.lstsq(jacobian, -force, rcond=None)[0]
            better = self._search(trial, step, start, resistance)
            if better is None:
                return None
            trial = better
        return None

    def _min_resistance(self, last: Trial) -> float:
        """Return the resistance at which the predicted rotation of the next step is within linear kinematics."""
        allowed = CAUTION * math.sqrt(BENT * max(float(last.overlap.max()), 0.0) * self.solver.grip.arm)
        return float(np.linalg.norm(self.push[self.solver.rotations])) / allowed if allowed > 0.0 else 0.0

    def _search(self, trial: Trial, step: NDArray, start: Array, resistance: float) -> Trial | None:
        """Backtrack from the full step to the first point with a smaller residual."""
        part = self.solver.longest_part(trial, step)
        size = float(np.linalg.norm(trial.force - resistance * (trial.y - start)))
        for _ in range(HALVINGS):
            tried = self.solver.trial(trial.y + part * step, self.plate)
            if float(np.linalg.norm(tried.force - resistance * (tried.y - start))) < (1.0 - 1e-4 * part) * size:
                return tried
            part *= 0.5
        return None


class _TippingRelaxation(_Relaxation):
    """Relaxation under load with finite rotations."""

    def __init__(self, origin: QuasiStatic, plate: Array) -> None:
        solver = QuasiStatic(origin.grip, origin.contacts, True)
        solver.seat_rotation, solver.rotation_since_touch = origin.seat_rotation, origin.rotation_since_touch
        super().__init__(solver, plate, MAX_ROTATION)
        self.start = origin.rotation_since_touch
        start = solver.upright(plate)
        if origin.now is not None:
            start = origin.now.coordinates if origin.under_load else np.append(origin.now.coordinates, origin.now.closing)
        self.put(start, origin.memory)
        if origin.now is not None and solver.now is not None:
            solver.now = replace(solver.now, slip=origin.now.slip)

    def accept(self, trial: Trial) -> None:
        """Accept a step, and linearise at the orientation at its end."""
        super().accept(trial)
        self.solver = in_present_posture(self.solver, 0.0)
        self.rotation = float(np.linalg.norm(after(-self.start, self.solver.rotation_since_touch)))


def _rotated_spots(grip: Grip, radius: Array, rotation: Array) -> Array:
    """Return the spots (n, 3) [m] of a particle after a rotation: summits of spheres that rotate with it."""
    from scipy.spatial.transform import Rotation  # imported here: 0.2 s

    summit = np.zeros_like(grip.position)
    summit[:, 2] = np.where(grip.upper, radius, -radius)
    return Rotation.from_rotvec(rotation).apply(grip.position - summit) + summit
