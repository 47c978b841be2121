"""Finite rotations of a particle: relaxation where no equilibrium is near, and the seat in which it is held.

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

from thirdbody.kernels.table import Array
from thirdbody.statics.solver import ACCEPTED, CONVERGED, NEUTRAL, OVERLAP_GROWTH, Grip, NoStaticState, QuasiStatic, Trial, after

MAX_ROTATION = 0.5  # rotation [rad] beyond which a particle that still moves has tipped over
SMALL_ROTATION = 0.01  # rotation [rad] beyond which the particle has left the last equilibrium
STEPS, NEWTON_STEPS, HALVINGS = 5000, 20, 6
SOLVED = 1e-6  # tolerance of the relative residual, resistance included, of a step
SLOWER, FASTER = 4.0, 3.0
"""The resistance is multiplied by SLOWER after a failed step, and divided by FASTER after a successful one."""
BENT, BENT_PATH = 0.5, 0.01
"""Largest deviation of a step, and of a path, from the circular motion of a spot, over the largest overlap."""
CAUTION = 0.8  # target rotation of the next step over the largest allowed one
STRONGEST, WEAKEST = 1e6, 1e-12  # bounds of the resistance over the stiffness
UNLOADINGS, LIGHTER = 5, 1.0 / 64.0
"""Number of loads, and their ratio: overlaps fall to a sixteenth. After five, rounding of the places is 1e-4 of the overlaps."""
TOUCHING = 1e-12  # gap over the size of the particle that counts as rounding


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
    last, memory, goal = solver.now, solver.memory, np.asarray(plate, float)
    solver.adopt(last.coordinates, goal, memory, last.slip)
    if _Relaxation(solver, goal).comes_to_rest():
        return True
    solver.now, solver.memory = last, memory
    return False


def seat(solver: QuasiStatic, plate: Sequence[float]) -> QuasiStatic:
    """Return a solver under load, in equilibrium where the particle comes to rest; NoStaticState is raised if it tips over.

    Parameters
    ----------
    solver : QuasiStatic
        The particle starts from its last equilibrium, or else upright.
    plate : sequence of float (3,)
        Load [N] and drag x, y [m].

    Returns
    -------
    QuasiStatic
    """
    goal = np.asarray(plate, float)
    loaded = QuasiStatic(solver.grip, solver.contacts, True)
    loaded.seat_rotation, loaded.rotation_since_touch = solver.seat_rotation, solver.rotation_since_touch
    if (now := solver.now) is None:
        loaded.adopt(loaded.upright(goal), goal, solver.memory)
    else:
        start = now.coordinates if solver.under_load else np.append(now.coordinates, now.closing)
        loaded.adopt(start, goal, solver.memory, now.slip)
    moving = _Relaxation(loaded, goal, solver.rotation_since_touch)
    if moving.comes_to_rest():
        return moving.solver
    assert moving.solver.now is not None
    ends = f"it rotates by {MAX_ROTATION} rad and reaches no equilibrium"
    if moving.exhausted:
        ends = f"the search ended after a rotation of {moving.rotation:.2g} rad"
    raise NoStaticState(ends, goal, moving.solver.now.residual, moving.exhausted)


def from_first_touch(solver: QuasiStatic, load: float) -> QuasiStatic:
    """Return a solver in the seat of a particle. Motion counts from first touch there, where all loaded spots touch at once.

    Under a load a seat is off that posture by the overlaps. Its loaded spots are those under `load`, or, where these cannot all
    touch at once, those that stay loaded under ever smaller loads and weights. Their gaps are closed by the smallest rotation.
    Raises NoStaticState where it tips over.

    Parameters
    ----------
    solver : QuasiStatic
        The particle starts from its last equilibrium, or else upright.
    load : float
        Load [N].

    Returns
    -------
    QuasiStatic
    """
    seated = solver
    for _ in range(UNLOADINGS):
        seated = seat(seated, (load, 0.0, 0.0))
        rotation, grip, apart = _first_touch(seated)
        if apart <= TOUCHING * grip.arm:
            break
        load, seated.grip = LIGHTER * load, replace(seated.grip, weight=LIGHTER * seated.grip.weight)
    assert seated.now is not None
    grip = replace(grip, weight=solver.grip.weight)
    # motion from first touch to the seat: the smallest with its overlaps
    y = np.linalg.lstsq(QuasiStatic(grip, solver.contacts, True).rows[0], seated.now.overlap + grip.gap, rcond=NEUTRAL)[0]
    result = QuasiStatic(grip, solver.contacts, solver.under_load)
    result.seat_rotation = after(after(solver.seat_rotation, seated.rotation_since_touch), rotation)
    plate = seated.now.plate if solver.under_load else np.array([y[-1], 0.0, 0.0])
    result.adopt(y if solver.under_load else y[:-1], plate, seated.memory)
    return result


def _first_touch(seated: QuasiStatic) -> tuple[Array, Grip, float]:
    # rotation vector and spots where the loaded spots touch at once, and the largest gap left among them
    assert seated.now is not None
    up, loaded, rotation = seated.grip.upper, seated.now.overlap > 0.0, np.zeros(3)
    for _ in range(NEWTON_STEPS):
        position = _rotated_spots(seated, rotation)
        x, y, z = position.T
        gap = np.where(up, z[up].max() - z, z - z[~up].min())
        # rows of the differences in height within each side
        rows = np.column_stack([z, y, -x, 0.0 * x])
        for side in (up & loaded, ~up & loaded):
            rows[side] -= rows[side].mean(axis=0)
        step = np.zeros(3)
        step[seated.axes] = np.linalg.lstsq(rows[loaded][:, 1:][:, seated.axes], -rows[loaded, 0], rcond=NEUTRAL)[0]
        if np.abs(step).max() < TOUCHING:
            break
        rotation = after(rotation, step)
    return rotation, replace(seated.grip, position=position, gap=gap), float(gap[loaded].max())


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
    position = _rotated_spots(solver, rotation)
    lift = position[:, 2] - solver.grip.position[:, 2]
    gap = solver.grip.gap + np.where(solver.grip.upper, -lift, lift)
    result = QuasiStatic(replace(solver.grip, position=position, gap=gap), solver.contacts, solver.under_load)
    result.seat_rotation, result.rotation_since_touch = solver.seat_rotation, after(solver.rotation_since_touch, rotation)
    result.adopt(coordinates, solver.now.plate, solver.memory, solver.now.slip)
    return result


class _Relaxation:
    """Relaxation of a particle towards equilibrium; the state is that at the end of a step.

    `upright`: rotation vector from which finite rotations count; None: they stay small, and kinematics linear.
    """

    def __init__(self, solver: QuasiStatic, plate: Array, upright: Array | None = None) -> None:
        self.solver, self.plate, self.upright = solver, plate, upright
        self.rotation = 0.0  # rotation since the start [rad]
        self.exhausted = False  # whether the search ended undecided
        # radius of the circles of the spots [m]: a blunt sphere's centre may be farther from the centre of mass than its spot
        self.reach = max(float(np.linalg.norm(solver.grip.position - _radii(solver), axis=1).max()), solver.grip.arm)
        # change of the coordinates in the last step times its resistance: the prediction for the next step
        self.push = np.zeros(solver.rows.shape[2])

    def comes_to_rest(self) -> bool:
        """Move until the forces balance; return whether they do before the largest rotation is reached."""
        assert self.solver.now is not None
        stiff = float(np.linalg.norm(self.solver.jacobian(self.solver.trial(self.solver.now.coordinates, self.plate)), 2))
        resistance, residual = stiff, float("inf")
        for _ in range(STEPS):
            result = self._step(resistance)
            if result is None:
                resistance *= SLOWER
                if resistance > STRONGEST * stiff:
                    break
                continue
            self.push = resistance * (result.y - self.solver.now.coordinates)
            self._accept(result)
            before, residual = residual, self.solver.now.residual
            if residual <= CONVERGED or residual <= ACCEPTED and residual > 0.5 * before:
                return True
            if self.rotation > (SMALL_ROTATION if self.upright is None else MAX_ROTATION):
                return False
            # the predicted rotation of the next step is within linear kinematics
            allowed = CAUTION * self.solver.grip.arm * math.sqrt(BENT * max(float(result.overlap.max()), 0.0) / self.reach)
            smallest = float(np.linalg.norm(self.push[self.solver.rotations])) / allowed if allowed > 0.0 else 0.0
            resistance = max(resistance / FASTER, smallest, WEAKEST * stiff)
        self.exhausted = True
        return False

    def _accept(self, trial: Trial) -> None:
        """Accept a step: its end is the start of the next one; with finite rotations, linearise at the orientation there."""
        solver, turn = self.solver, self.solver.rotations
        assert solver.now is not None
        self.rotation += float(np.linalg.norm(trial.y[turn] - solver.now.coordinates[turn])) / solver.grip.arm
        slip = np.where(trial.overlap > 0.0, solver.now.slip + trial.answer.slip, 0.0)
        solver.adopt(trial.y, self.plate, trial.answer.memory, slip)
        if self.upright is not None:
            self.solver = in_present_posture(solver, 0.0)
            self.rotation = float(np.linalg.norm(after(-self.upright, self.solver.rotation_since_touch)))

    def _step(self, resistance: float) -> Trial | None:
        """Return the end of one step of implicit Euler; None without solution or with too large a rotation."""
        solver = self.solver
        assert solver.now is not None
        start = solver.now.coordinates

        def net_force(trial: Trial) -> Array:  # less the resistance, with the levers at the end of the step
            change = trial.y - start
            return np.asarray(trial.force + self._geometric_stiffness(trial) @ change - resistance * change)

        guesses = [solver.trial(start, self.plate)]
        if self.push.any():
            guesses.append(solver.trial(start + self.push / resistance, self.plate))
        trial = min(guesses, key=lambda guess: float(np.linalg.norm(net_force(guess))))
        for _ in range(NEWTON_STEPS):
            force = net_force(trial)
            if float(np.abs(force).max()) <= min(SOLVED, 0.1 * trial.residual) * trial.scale or trial.residual <= CONVERGED:
                bent = float(np.sum((trial.y[solver.rotations] - start[solver.rotations]) ** 2)) / solver.grip.arm**2
                return trial if bent * self.reach <= BENT * float(trial.overlap.max()) else None
            jacobian = solver.jacobian(trial) + self._geometric_stiffness(trial) - resistance * np.eye(len(start))
            step = np.linalg.lstsq(jacobian, -force, rcond=None)[0]
            # a spot that is open, or opens, counts only while it is loaded: the rotation is bounded otherwise here
            fraction, growth = 1.0, OVERLAP_GROWTH * float(trial.overlap.max())
            if growth > 0.0:
                change = solver.rows[0] @ step
                counted = np.where((change < 0.0) & (trial.overlap <= growth), 0.0, np.abs(change))
                allowed = growth + np.maximum(-trial.overlap, 0.0)
                fraction = float(np.min(allowed / np.maximum(counted, allowed)))
            better = solver.backtrack(trial, step, self.plate, (fraction, HALVINGS), net_force)
            if better is None:
                return None
            trial = better
        return None

    def _geometric_stiffness(self, trial: Trial) -> Array:
        # moments of the forces F on spots that move with the centres c of their spheres, (theta x c) x F; none if linear
        solver, result = self.solver, np.zeros((len(trial.y), len(trial.y)))
        if self.upright is not None:
            centre, normal = solver.grip.position - _radii(solver), np.where(solver.grip.upper, -1.0, 1.0) * trial.answer.normal
            force = np.column_stack([trial.answer.tangential, normal])
            moment = centre.T @ force - np.sum(centre * force) * np.eye(3)
            result[solver.rotations, solver.rotations] = moment[np.ix_(solver.axes, solver.axes)] / solver.grip.arm**2
        return result


def _radii(solver: QuasiStatic) -> Array:  # vectors (n, 3) [m] from the centres of the spheres to their spots
    result = np.zeros_like(solver.grip.position)
    result[:, 2] = np.where(solver.grip.upper, solver.contacts.radius, -solver.contacts.radius)
    return result


def _rotated_spots(solver: QuasiStatic, rotation: Array) -> Array:
    from scipy.spatial.transform import Rotation  # imported here: 0.2 s

    summit = _radii(solver)  # of spheres that rotate with the particle
    return Rotation.from_rotvec(rotation).apply(solver.grip.position - summit) + summit
