"""Quasi-static solver: equilibria of one rigid particle between two plates along a path.

There is no inertia and no time. The lower plate is fixed; the upper one is lowered by its closing (or loaded, with the closing
unknown) and displaced laterally. Kinematics is linear, as in Willert's theory (Eqs. 1, 6, 11): a spot at r from the centre of
mass moves by t + theta x r, with translation t and rotation vector theta of the particle since first touch. The normal component
changes the overlap; the tangential one relative to the plate is the slip. This is the theory itself for a planar particle, and
holds in 3-D for small |theta|; for larger rotations `seat` recomputes the positions of the spots and continues from there.

Laws enter only by their compiled `law` and `tangents`. A step starts from the history of the last equilibrium and commits it only
when the new one is solved, so a law that is exact for straight paths of overlap and slip is applied to exactly such paths.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from thirdbody.kernels.table import Array
from thirdbody.statics.contacts import Answer, Contacts

CONVERGED = 1e-12  # tolerance of the residual force, or moment over the arm, over the sum of normal forces, weight and load
ACCEPTED = 1e-9
"""The same where Newton's method stagnates: a law of springs has corners, at which the last digits do not converge."""
NEWTON_STEPS, HALVINGS, CUTS, BISECTIONS = 30, 12, 8, 50
NEUTRAL = 1e-10  # stiffness over the largest stiffness below which a motion counts as free
OVERLAP_GROWTH = 0.5
"""Largest change of an overlap in one Newton step over the largest overlap: Hertz' force is strongly nonlinear."""


class NoStaticState(Exception):
    """No equilibrium on the path from the last point.

    `plate`: closing (or load), and drag (2,), where the solver failed. `closest`: smallest relative residual reached there. It is
    some percent where the particle tips; a much smaller value means that the solver failed close to an equilibrium, perhaps
    because the laws are not smooth enough. `undecided`: whether the search ended before the particle came to rest or tipped
    over; None where the particle was not followed.
    """

    def __init__(self, message: str, plate: Array, closest: float, undecided: bool | None = None):
        super().__init__(message)
        self.plate, self.closest, self.undecided = plate, closest, undecided


@dataclass(frozen=True, eq=False)
class Grip:
    """Spots (points of contact) of one particle, and its `weight` [N].

    `position` (n, 3): from the centre of mass [m]; `gap` (n,): to their plate at first touch [m]; `upper` (n,): upper
    plate; `planar`: only x, z and the rotation about y are free."""

    position: Array
    gap: Array
    upper: NDArray[np.bool_]
    weight: float = 0.0
    planar: bool = False

    @property
    def arm(self) -> float:
        """Largest distance [m] of a spot from the centre of mass; scales rotations; 1 if that is 0."""
        return float(np.linalg.norm(self.position, axis=1).max()) or 1.0


@dataclass(frozen=True, eq=False)
class Balance:
    """An equilibrium.

    `plate`: closing [m] or load [N], drag x, y [m]; `closing` of the upper plate [m]; `motion` (6,): translation [m] and rotation
    vector since first touch; `slip` (n,): accumulated irreversible slip [m]; `stiffness_ratio` (n,): tangential stiffness along
    the tangential force over that without slip; `free`: number of motions without resistance; `residual`: relative residual."""

    plate: Array
    closing: float
    motion: Array
    overlap: Array
    answer: Answer
    slip: Array
    stiffness_ratio: Array
    free: int
    residual: float
    coordinates: Array = field(repr=False)
    shift: Array = field(repr=False)


@dataclass(frozen=True, eq=False)
class Trial:
    """A trial point: coordinates, residual forces, and input and output of the laws."""

    y: Array
    force: Array
    scale: float
    overlap: Array
    shift: Array
    slip: Array
    closed_fraction: Array
    answer: Answer

    @property
    def residual(self) -> float:
        """Largest residual force over the sum of forces; infinite without load."""
        return float(np.abs(self.force).max()) / self.scale if self.scale > 0.0 else float("inf")


Force = Callable[[Trial], Array]


class QuasiStatic:
    """Solver for one particle on a path of the upper plate; `now`: last equilibrium or None."""

    def __init__(self, grip: Grip, contacts: Contacts, under_load: bool = False) -> None:
        self.grip, self.contacts, self.under_load = grip, contacts, under_load
        self.now: Balance | None = None
        self._freedoms = [0, 2, 4] if grip.planar else list(range(6))
        self.vertical = self._freedoms.index(2)  # vertical translation among the coordinates
        self.axes = [k - 3 for k in self._freedoms if k >= 3]  # of the free rotations
        self.rotations = slice(self.vertical + 1, len(self._freedoms))  # rotation vector, times the arm, in the coordinates
        # derivatives (3, n, m) of overlap and displacements by the coordinates, to which a load adds the closing
        (x, y, z), arm = grip.position.T, grip.arm
        one, zero = np.ones_like(x), np.zeros_like(x)
        overlap = np.where(grip.upper, 1.0, -1.0) * np.array([zero, zero, one, y / arm, -x / arm, zero])
        along_x = np.array([one, zero, zero, zero, z / arm, -y / arm])
        along_y = np.array([zero, one, zero, -z / arm, zero, x / arm])
        rows, closing = np.stack([overlap, along_x, along_y]).transpose(0, 2, 1), np.stack([1.0 * grip.upper, zero, zero])
        rows = rows[:, :, self._freedoms]
        self.rows = np.concatenate([rows, closing[:, :, None]], axis=2) if under_load else np.ascontiguousarray(rows)
        self.memory = contacts.virgin()
        self.bending = contacts.bending(grip.position, grip.upper)
        self.seat_rotation = np.zeros(3)  # rotation vector from the initial orientation to that of first touch
        self.rotation_since_touch = np.zeros(3)  # from there to the orientation of `grip`
        self._closest = float("inf")  # smallest `residual` in the search for the present point
        # drag of the last step, and change of the coordinates in it
        self._dragged, self._gained = np.zeros(2), np.zeros(self.rows.shape[2])

    def relieved(self, overlap: Array) -> Array:
        """Return the overlaps (n,) [m] that the laws see: what other spots lower the plate is taken off."""
        return overlap if self.bending is None else self.bending.relieved(overlap)

    def move(self, plate: Sequence[float]) -> Balance:
        """Move the upper plate straight to `plate` and return the equilibrium there. `plate`: closing [m] (or load [N]) and drag
        x, y [m]. A step without solution is halved; raises NoStaticState, with the last equilibrium unchanged, if that fails."""
        target = np.asarray(plate, float)
        start = np.zeros(3) if self.now is None else self.now.plate
        done, size, cuts = 0.0, 1.0, 0
        while done < 1.0:
            size = min(size, 1.0 - done)
            goal = target if done + size >= 1.0 else start + (done + size) * (target - start)
            result = self._solve(goal)
            if result is None and cuts < CUTS:
                cuts, size = cuts + 1, 0.5 * size
                continue
            if result is None:
                raise NoStaticState("no balance of forces and moments was found near the last one", goal, self._closest)
            self._commit(goal, *result)
            done += size
        assert self.now is not None
        return self.now

    def adopt(self, coordinates: Array, plate: Array, memory: Array, slip: Array | None = None) -> None:
        """Continue from these coordinates, history and accumulated slip, whether in equilibrium or not."""
        self.now, self.memory = None, memory
        none = np.zeros(len(self.grip.position))
        for _ in range(2):  # positions and overlaps first, then the forces there, without slip
            self._set(plate, self.trial(coordinates, plate), none if slip is None else slip, none, 0)

    def _set(self, plate: Array, trial: Trial, slip: Array, stiffness_ratio: Array, free: int) -> None:
        motion = np.zeros(6)
        motion[self._freedoms] = trial.y[: len(self._freedoms)]
        motion[3:] /= self.grip.arm
        if self.rotation_since_touch.any():
            motion[3:] = after(self.rotation_since_touch, motion[3:])
        closing, answer = float(trial.y[-1] if self.under_load else plate[0]), trial.answer
        points = (slip, stiffness_ratio, free, trial.residual, trial.y, trial.shift)
        self.now = Balance(plate, closing, motion, trial.overlap, answer, *points)

    def _commit(self, plate: Array, trial: Trial, free: int) -> None:
        now, none = self.now, np.zeros(len(trial.overlap))
        slip = np.where(trial.overlap > 0.0, (0.0 if now is None else now.slip) + trial.answer.slip, 0.0)
        stiffness_ratio = self.contacts.stiffness_ratio(
            self.relieved(none if now is None else now.overlap), self.relieved(trial.overlap),
            trial.slip * trial.closed_fraction[:, None], self.memory, trial.answer,
        )  # fmt: skip
        self.memory = trial.answer.memory
        if now is not None:
            self._dragged, self._gained = plate[1:] - now.plate[1:], trial.y - now.coordinates
        self._set(plate, trial, slip, stiffness_ratio, free)

    def _solve(self, plate: Array) -> tuple[Trial, int] | None:
        """Return the equilibrium at `plate`, and the number of motions without resistance there; None if none is near."""
        self._closest = float("inf")
        # smaller residual first: a sliding particle then stays where it is, although other equilibria exist
        for guess in sorted(self._guesses(plate), key=lambda y: self.trial(y, plate).residual):
            result = self._newton(guess, plate)
            if result is not None:
                _, values, vectors = np.linalg.svd(self.jacobian(result))
                free = int(np.sum(values <= NEUTRAL * values[0]))
                return (self._nearest(result, vectors[-1], plate) if free == 1 else result), free
        return None

    def _guesses(self, plate: Array) -> list[Array]:
        """Return initial guesses: extrapolation of the path and the last point; upright before the first."""
        now = self.now
        if now is None:
            return [self.upright(plate)]
        last, step = now.coordinates, plate[1:] - now.plate[1:]
        if step.any():
            square = float(self._dragged @ self._dragged)
            ratio = float(step @ self._dragged) / square if square > 0.0 else 0.0
            return [last + ratio * self._gained, last] if ratio > 0.0 else [last]
        if now.plate[0] <= 0.0:
            return [last]
        ratio = plate[0] / now.plate[0]
        if self.under_load:
            # d(log overlap)/d(log load) of contacts that grow in proportion: N/(k d), 2/3 for Hertz
            stiffness = self.contacts.stiffness(self.relieved(now.overlap), np.zeros((len(now.overlap), 2)), self.memory)[0]
            work = float((stiffness * now.overlap).sum())
            ratio = ratio ** (float(now.answer.normal.sum()) / work if work > 0.0 else 1.0)
        return [last * ratio, last]

    def upright(self, plate: Array) -> Array:
        """Return the coordinates of the vertical equilibrium without rotation, by bisection."""
        y, up = np.zeros(self.rows.shape[2]), self.grip.upper
        size = float(self.contacts.radius.max() + self.grip.gap.max())

        def pressed(sink: float, closing: float) -> tuple[float, float]:
            overlap = np.where(up, closing - sink, sink) - self.grip.gap
            normal = self.contacts.evaluate(self.relieved(overlap), np.zeros((len(overlap), 2)), self.contacts.virgin()).normal
            return float(normal[up].sum()), float(normal[~up].sum())

        def excess(sink: float) -> float:
            above, below = (plate[0], pressed(sink, 0.0)[1]) if self.under_load else pressed(sink, plate[0])
            return below - above - self.grip.weight

        sink = _root(excess, size)
        if self.under_load:
            y[-1] = sink + _root(lambda d: pressed(0.0, d)[0] - plate[0], size)
        y[self.vertical] = -sink
        return y

    def trial(self, y: Array, plate: Array) -> Trial:
        """Return the forces at the coordinates `y`, after a straight step from the last equilibrium."""
        grip, now = self.grip, self.now
        local = self.rows @ y  # (3, n): overlap, displacement along x and y
        overlap = local[0] - grip.gap + (0.0 if self.under_load else plate[0] * grip.upper)
        shift = (local[1:] - plate[1:, None] * grip.upper).T
        before = np.zeros(len(overlap)) if now is None else now.overlap
        slip = shift - (0.0 if now is None else now.shift)
        # a spot that closes within the step slips only during the rest of the step
        touched = (before < 0.0) & (overlap > 0.0)
        fraction = np.where(touched, overlap / np.where(touched, overlap - before, 1.0), 1.0)
        answer = self.contacts.evaluate(self.relieved(overlap), slip * fraction[:, None], self.memory)
        force = np.einsum("nm,n->m", self.rows[1], answer.tangential[:, 0])
        force += np.einsum("nm,n->m", self.rows[2], answer.tangential[:, 1])
        force -= np.einsum("nm,n->m", self.rows[0], answer.normal)
        force[self.vertical] -= grip.weight
        scale = float(answer.normal.sum()) + grip.weight
        if self.under_load:
            force[-1] += plate[0]
            scale += abs(plate[0])
        return Trial(y, force, scale, overlap, shift, slip, fraction, answer)

    def jacobian(self, trial: Trial) -> Array:
        """Return d(force)/d(coordinates) from the laws' tangents, exact also for spots that close."""
        relieved, fraction = self.relieved(trial.overlap), trial.closed_fraction
        k = self.contacts.stiffness(relieved, trial.slip * fraction[:, None], self.memory)
        before = np.zeros(len(k[0])) if self.now is None else self.now.overlap
        growth = np.where(fraction < 1.0, -before / np.where(fraction < 1.0, trial.overlap - before, 1.0) ** 2, 0.0)
        d, x, y = self.rows
        pressed = d if self.bending is None else self.bending.rates(relieved) @ d
        own = trial.slip * growth[:, None]

        def rates(along_x: Array, along_y: Array, by_overlap: Array) -> Array:  # (n, m) of one component of the tangential forces
            rows = (fraction * along_x)[:, None] * x + (fraction * along_y)[:, None] * y
            rows += by_overlap[:, None] * pressed + (along_x * own[:, 0] + along_y * own[:, 1])[:, None] * d
            return rows

        return x.T @ rates(k[1], k[2], k[5]) + y.T @ rates(k[3], k[4], k[6]) - d.T @ (k[0][:, None] * pressed)

    def _newton(self, y: Array, plate: Array) -> Trial | None:
        """Run Newton's method with a line search, with damping where that fails; None without solution."""
        trial = self.trial(y, plate)
        for _ in range(NEWTON_STEPS):
            if trial.residual <= CONVERGED:
                # without any load the residual vanishes too, but the particle is not between the plates
                return trial if trial.answer.normal.any() else None
            self._closest = min(self._closest, trial.residual)
            jacobian = self.jacobian(trial)
            if not jacobian.any() or not np.isfinite(jacobian).all():
                return None
            better = self._search(trial, np.linalg.lstsq(jacobian, -trial.force, rcond=NEUTRAL)[0], plate)
            for damping in () if better else (1e-6, 1e-4, 1e-2, 1.0):
                size = damping * float(np.linalg.norm(jacobian, 2))
                stack = np.vstack([jacobian, size * np.eye(len(y))])
                target = np.concatenate([-trial.force, np.zeros(len(y))])
                better = self._search(trial, np.linalg.lstsq(stack, target, rcond=None)[0], plate)
                if better:
                    break
            if better is None:
                break
            trial = better
        return trial if trial.residual <= ACCEPTED and trial.answer.normal.any() else None

    def _search(self, trial: Trial, step: NDArray, plate: Array) -> Trial | None:
        change = np.abs(self.rows @ step).max(axis=1)
        growth = OVERLAP_GROWTH * max(float(trial.overlap.max()), 0.0)
        first = min(1.0, growth / change[0]) if change[0] > 0.0 and growth > 0.0 else 1.0
        return self.backtrack(trial, step, plate, (first, HALVINGS), lambda tried: tried.force)

    def backtrack(self, trial: Trial, step: NDArray, plate: Array, halved: tuple[float, int], force: Force) -> Trial | None:
        """Return the first point with a smaller norm of `force`; `halved`: first fraction of the step, and how many are tried."""
        size, (fraction, count) = float(np.linalg.norm(force(trial))), halved
        for _ in range(count):
            tried = self.trial(trial.y + fraction * step, plate)
            if float(np.linalg.norm(force(tried))) < (1.0 - 1e-4 * fraction) * size:
                return tried
            fraction *= 0.5
        return None

    def _nearest(self, trial: Trial, vector: Array, plate: Array) -> Trial:
        """Return the equilibrium nearest to the last point. Where both sides slide, there is a continuous row of equilibria along
        `vector`. The particle then stays where it is when sliding begins; with any weight it does so without this rule, since its
        lower spots carry a higher friction force."""
        if self.now is None:
            return trial
        back = float(vector @ (trial.y - self.now.coordinates)) * vector
        best = self.trial(trial.y - back, plate)
        if best.residual <= CONVERGED:
            return best
        low, high, best = 0.0, 1.0, trial
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            tried = self.trial(trial.y - middle * back, plate)
            if tried.residual <= CONVERGED:
                low, best = middle, tried
            else:
                high = middle
        return best


def after(first: Array, then: Array) -> Array:
    """Return the rotation vector of the rotation `first` followed by `then`."""
    from scipy.spatial.transform import Rotation  # imported here: 0.2 s

    return np.asarray((Rotation.from_rotvec(then) * Rotation.from_rotvec(first)).as_rotvec())


def _root(excess: Callable[[float], float], high: float) -> float:
    """Return the zero in [0, high] of an increasing function; `high` is halved first: overlaps are tiny."""
    low = 0.0
    while high > 0.0 and excess(0.5 * high) > 0.0 and high > 1e-300:
        high *= 0.5
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if excess(middle) > 0.0 else (middle, high)
    return 0.5 * (low + high)
