"""A single particle pressed and dragged quasi-statically: forces, tilt, partial slip, label and forecast along the path.

    result = thirdbody.balance("particle.toml")
    result.points[-1].N, result.points[-1].label

Signs are those of Willert (Eqs. 1, 2, 6, 11): w down, phi about +y (into the page), and for a planar particle u and T positive
toward -x, T_i being the force of the upper body on the particle and of the particle on the lower body. Out of the plane u (2,) is
the displacement of the centre of mass and T_i (2,) the same force, both along world x, y; phi is the rotation vector.

Label and reason are those of a run: `classify` evaluates the balances like the steps of a run. So a side slides when all its
spots are at the limit and have slipped by more than their critical displacement. Margins (positive = satisfied): those of
`classify`, and `friction_spots`, 1 - eta of each spot, eta = |T|/(mu N)."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from thirdbody.plugin import (
    Balance,
    Contacts,
    Material,
    NoStaticState,
    Pair,
    QuasiStatic,
    StaticLabels,
    UsageError,
    dundurs_beta,
    e_star,
    from_first_touch,
    g_star,
    in_present_posture,
    nearest,
    relax,
    seat,
)

from . import LABELLER, THREE_SPOT
from .balance_file import BalanceFile
from .forecast import forecast

NODES = 1024  # size of the history of a spot at level `exact`: a bend for each of some 1000 steps of pressing and drag
PRESSING, SEATS = 100, 10
"""Steps of the pressing: one for laws that are exact along the straight paths of a weightless particle; maximum number of seats
that a particle may leave again meanwhile."""
UNDECIDED = 1e-3
"""Unbalanced fraction of the forces below which a failed search is inconclusive: where a particle tips, 2 to 20 % were left,
where a law was too rough for the solver, 1e-6."""
MISMATCH = 0.01  # Dundurs' beta below which there is no warning of the coupling of normal and tangential contact
TOUCHING = 1e-12  # gap over the size of the particle, and difference of frictions, that count as rounding
LARGE = 0.1  # overlap over radius beyond which Hertz's theory is inaccurate
DEFAULT_LEVEL = "exact"

AT_LIMIT, SPATIAL_LIMIT, ROUNDING = {"mdr": 1e-3}, 0.02, 1e-9
"""Smallest 1 - eta that is not the limit: the springs of `mdr` fall short of mu N by 4e-4; in space, as in `classify`, springs of
a contact that slid along a curved path differ slightly in direction; else rounding."""
RING, ANNULUS = {"mdr": 0.15}, 1e-6
"""Detectable loss of tangential stiffness, the width of the slip ring over a: `mdr` has 16 to 32 springs."""


@dataclass(frozen=True)
class Point:
    """One balance. SI; `N`, `T`, `spots` in the order of the file; signs in the module's docstring."""

    indentation: float
    drag: float
    N: list[float]
    T: list[float] | list[list[float]]
    w: float
    u: float | list[float]
    phi: float | list[float]
    spots: list[str]
    label: str
    reason: str
    margins: dict[str, Any]


@dataclass(frozen=True)
class Forecast:
    """States permitted by geometry and friction of the spots that are loaded after pressing.

    Smallest friction that can hold the particle, the frictions t_min to t_max with which it can slide along the drag (None if it
    never can), and the possible states.
    """

    mu_required: float | None
    t_min: float | None
    t_max: float | None
    possible: list[str]


@dataclass(frozen=True)
class Seat:
    """Posture into which a particle rotated because its first contacts did not hold it.

    Points count from first touch in it. Rotation vector from the given posture [rad] (a number for a planar particle), and the
    spots (n, 3) from the centre of mass [m].
    """

    rotation: float | list[float]
    spots: list[list[float]]


@dataclass(frozen=True)
class EarlyEnd:
    """End of the path before the end of the drag.

    `rolling` if no static state exists and the particle tips or rolls, `undecided` if the solver failed close to a balance.
    """

    indentation: float | None
    load: float | None
    drag: float
    label: str
    message: str


@dataclass(frozen=True)
class Result:
    """End of pressing, then the steps of the drag, as far as they exist; `stopped` is set if they end early.

    `seat` is None for a particle that is held by its first contacts.
    """

    points: list[Point]
    forecast: Forecast
    moduli: dict[str, dict[str, float]]
    level: str
    planar: bool
    stopped: EarlyEnd | None
    warnings: list[str]
    seat: Seat | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain dicts, lists and numbers, as written by `to_json`."""
        return asdict(self)

    def to_json(self) -> str:
        """Return the result as JSON text, SI."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False)


def balance(source: str | os.PathLike[str] | Mapping[str, Any] | BalanceFile, level: str | None = None) -> Result:
    """Compute the quasi-static path of one particle: pressed, then dragged.

    Parameters
    ----------
    source : str, Path, dict or BalanceFile
        A balance file, or its tables built in Python (numbers in SI).
    level : str, optional
        Level of the law `three_spot`; None: "exact".

    Returns
    -------
    Result
        `points` (forces, tilt, state of every spot, label), `forecast`, `stopped` where no static state exists, `warnings`.

    Raises
    ------
    InputError
        With every fault of the input.
    UsageError
        There is no such level.

    Source
    ------
    E. Willert, Self-consistency conditions in static three-body elastic tangential contact, Eqs. 1 to 15.

    Examples
    --------
    >>> result = thirdbody.balance("particle.toml", level="mindlin")
    >>> result.points[-1].label, round(result.forecast.t_max, 6)
    ('sliding', 0.55)
    """
    level = DEFAULT_LEVEL if level is None else level
    if level not in THREE_SPOT.levels:
        raise UsageError(f"level '{level}': {nearest(level, THREE_SPOT.levels)}")
    if isinstance(source, BalanceFile):
        document = source
    else:
        document = BalanceFile(**source) if isinstance(source, Mapping) else BalanceFile.load(source)
    # the particle against either body; a restitution and densities that are irrelevant without impacts and acceleration
    solids = {side: getattr(document.materials, side) for side in ("lower", "upper", "particle")}
    built = {side: Material(side, solid.shear(), solid.poisson_ratio, 1.0) for side, solid in solids.items()}
    lower, upper = (Pair(built["particle"], built[side], getattr(document.friction, side), 1.0) for side in ("lower", "upper"))
    path = _Path(document, (lower, upper), level)
    stopped = path.follow()
    moduli = {
        side: {"e_star": e_star(p.a, p.b), "g_star": g_star(p.a, p.b), "dundurs_beta": dundurs_beta(p.a, p.b)}
        for side, p in (("lower", lower), ("upper", upper))
    }
    warnings = _warnings(document, path, moduli)
    return Result(path.points, _forecast(document, path), moduli, level, path.planar, stopped, warnings, path.seat())


class _Path:
    """The particle along its path: solver, labels and the points so far."""

    def __init__(self, document: BalanceFile, pairs: tuple[Pair, Pair], level: str) -> None:
        grip, radius = document.spots()
        self.path, self.planar = document.path, grip.planar
        self.under_load = document.path.load is not None
        interaction = "close_spots" if document.effects.close_spots is not None else None
        contacts = Contacts(THREE_SPOT.levels[level], pairs, grip.upper.astype(np.int64), radius, {"nodes": NODES}, interaction)
        self.solver = QuasiStatic(grip, contacts, self.under_load)
        self.limit = AT_LIMIT.get(level, ROUNDING) if grip.planar else SPATIAL_LIMIT
        self.ring = RING.get(level, ANNULUS)
        self.balances: list[Balance] = []
        self.pressed = grip  # posture while pressed: the drag may rotate the particle further
        self.points: list[Point] = []

    def seat(self) -> Seat | None:
        """Return the posture into which the particle rotated, or None."""
        rotation = self.solver.seat_rotation
        if not rotation.any():
            return None
        return Seat(float(rotation[1]) if self.planar else rotation.tolist(), self.pressed.position.tolist())

    def follow(self) -> EarlyEnd | None:
        """Press, then drag; return an `EarlyEnd` where no static state exists."""
        given = self.path.load if self.under_load else self.path.indentation
        assert given is not None  # one of the two is given: `Path.rules`
        e_x, e_y = self.path.heading()
        steps = self.path.steps if self.path.drag > 0.0 else 0
        try:
            self.solver, pressed = press(self.solver, given)
            labels = StaticLabels(LABELLER, self.solver.grip, self.solver.contacts.radius, (e_x, e_y))
            self._note(pressed, labels)
            self.pressed = self.solver.grip
            for k in range(1, steps + 1):
                distance = self.path.drag * k / steps
                self.solver, result = drag(self.solver, (given, distance * e_x, distance * e_y))
                self._note(result, labels)
        except NoStaticState as problem:
            return self._stop(problem)
        return None

    def _note(self, result: Balance, labels: StaticLabels) -> None:
        answer, up = result.answer, self.solver.grip.upper
        loaded, size = result.overlap > 0.0, np.hypot(*answer.tangential.T)
        slipped = (result.slip > ROUNDING * answer.contact_radius).astype(float)  # decides without friction
        eta = np.where(loaded, np.where(answer.limit > 0.0, size / np.where(answer.limit > 0.0, answer.limit, 1.0), slipped), 0.0)
        partial = (answer.limit > 0.0) & (result.stiffness_ratio < 1.0 - self.ring)
        spots = np.where(eta >= 1.0 - self.limit, "slide", np.where(partial, "partial", "stick"))
        spots = np.where(loaded, spots, "open").tolist()
        noted = labels.update(result, self.solver.grip)
        margins: dict[str, Any] = {name: noted[name] for name in LABELLER.margins} | {"friction_spots": (1.0 - eta).tolist()}
        label, reason = LABELLER.states[int(noted["state"])], LABELLER.reasons[int(noted["reason"])]
        downwards = np.where(up, 1.0, -1.0)[:, None] * answer.tangential
        dragged = float(np.hypot(*result.plate[1:]))
        t: Any = (-downwards[:, 0]).tolist() if self.planar else downwards.tolist()
        u: Any = -float(result.motion[0]) if self.planar else result.motion[:2].tolist()
        phi: Any = float(result.motion[4]) if self.planar else result.motion[3:].tolist()
        normal, sink = answer.normal.tolist(), -float(result.motion[2])
        self.points.append(Point(result.closing, dragged, normal, t, sink, u, phi, spots, label, reason, margins))
        self.balances.append(result)

    def _stop(self, problem: NoStaticState) -> EarlyEnd:
        pressed, dragged = float(problem.plate[0]), float(np.hypot(*problem.plate[1:]))
        when = f"at a drag of {dragged:.4g} m" if self.points else "while it is pressed"
        failed = problem.closest < UNDECIDED if problem.undecided is None else problem.undecided
        message = f"no static state exists {when}: the particle tips or rolls ({problem})"
        if failed:
            left = f"{problem.closest:.1g} of the forces unbalanced"
            message = f"undecided {when}: the solver failed, {left} ({problem}); try another level"
        label = "undecided" if failed else "rolling"
        return EarlyEnd(None if self.under_load else pressed, pressed if self.under_load else None, dragged, label, message)


def press(solver: QuasiStatic, given: float) -> tuple[QuasiStatic, Balance]:
    """Return the balance under `given`, a load [N] or an indentation [m], and its solver.

    The solver is a new one, in the posture of the seat, if the particle rotated in between. Raises NoStaticState if it tips over.
    """
    seats = 0
    for k in range(1, PRESSING + 1):
        target = (given * k / PRESSING, 0.0, 0.0)
        result = None
        while result is None:
            try:
                result = _balance(solver, target)
            except NoStaticState as problem:
                left = problem
            if result is None:
                if seats == SEATS:
                    raise NoStaticState(f"it left {SEATS} seats again", left.plate, left.closest, undecided=True)
                load = target[0]
                if not solver.under_load:  # continued under that of the last balance, else of the upright particle
                    plate, now = np.array(target), solver.now
                    answer = now.answer if now is not None else solver.trial(solver.upright(plate), plate).answer
                    load = float(answer.normal[solver.grip.upper].sum())
                try:
                    solver = from_first_touch(solver, load)
                except NoStaticState as problem:  # found under a load: `plate` is that of the path
                    raise NoStaticState(str(problem), left.plate, problem.closest, problem.undecided) from None
                seats += 1
    assert result is not None
    return solver, result


def drag(solver: QuasiStatic, target: Sequence[float]) -> tuple[QuasiStatic, Balance]:
    """Return the balance at a load or indentation and drag x, y, and the solver for the next step.

    The solver follows the rotation of the particle. Under a load a particle that tips over moves on until its forces balance
    again. Raises NoStaticState where they never do.
    """
    try:
        result = _balance(solver, target)
    except NoStaticState:
        if not solver.under_load:
            raise
        solver = seat(solver, target)
        result = _balance(solver, target)
    return in_present_posture(solver), result


def _balance(solver: QuasiStatic, target: Sequence[float]) -> Balance:
    """Return the balance next to the last one: by Newton's method, else by relaxation."""
    try:
        return solver.move(target)
    except NoStaticState as problem:
        if problem.closest >= UNDECIDED or not relax(solver, target):
            raise
    return solver.move(target)


def _forecast(document: BalanceFile, path: _Path) -> Forecast:
    """Conditions of self-consistency for the spots loaded after pressing; if it cannot be pressed, for those that touch first."""
    up, position = path.pressed.upper, path.pressed.position
    first = path.balances[0] if path.balances else None
    loaded = first.overlap > 0.0 if first is not None else path.pressed.gap <= TOUCHING * path.pressed.arm
    above, below = position[up & loaded], position[~up & loaded]
    if not len(above) or not len(below):
        return Forecast(None, None, None, [])
    h = float(above[:, 2].mean() - below[:, 2].mean())
    if h <= 0.0:  # spots that cannot all be loaded at once
        return Forecast(None, None, None, [])
    heading, friction = document.path.heading(), document.friction
    load = float(first.answer.normal[up].sum()) if first is not None else 0.0
    ratio = document.particle.weight / load if load > 0.0 else 0.0
    if path.planar:
        # the resultant of a side acts between its outermost spots, wherever elasticity puts it, and the weight at the centre of
        # mass: N p - (N + m g) q = T h (Eqs. 1 and 2, drag toward -x), so T/N lies in an interval
        p, q = -heading[0] * above[:, 0], (1.0 + ratio) * (-heading[0] * below[:, 0])
        low, high = (p.min() - q.max()) / h, (p.max() - q.min()) / h
        required = max(low, -high, 0.0)
    else:
        ratio = 0.0
        p, q = (np.ascontiguousarray(side[:, :2]) for side in (above, below))
        required, low, high = forecast(p, len(p), q, len(q), h, heading[0], heading[1])
    limit = min(friction.upper, friction.lower * (1.0 + ratio))  # both sides slide at equality (Eq. 20)
    slack = TOUCHING * float(np.ptp(position[:, :2], axis=0).max()) / h
    possible = ["sticking"] if required <= limit + slack else []
    possible += ["sliding"] if low - slack <= limit <= high + slack else []
    ever = bool(np.isfinite([low, high]).all())
    return Forecast(float(required), float(low) if ever else None, float(high) if ever else None, possible)


def _warnings(document: BalanceFile, path: _Path, moduli: Mapping[str, Mapping[str, float]]) -> list[str]:
    result = []
    rotation = float(np.linalg.norm(path.solver.seat_rotation))
    if rotation > 0.0:
        result.append(f"the first contacts do not hold the particle: it rotates by {rotation:.3g} rad and is pressed there")
    for side, values in moduli.items():
        beta = values["dundurs_beta"]
        if abs(beta) > MISMATCH:
            result.append(f"{side} side: not elastically similar (Dundurs' beta {beta:.3g}); the coupling is neglected")
    if not path.balances:
        return result
    names, memory = path.solver.contacts.chain.history, path.solver.memory
    if "exact.dropped" in names and (dropped := memory[:, names.index("exact.dropped")]).any():
        spots_text = ", ".join(str(k + 1) for k in np.flatnonzero(dropped))
        result.append(f"spots {spots_text} had more bends in their history than the {NODES} nodes hold: fewer steps keep all")
    overlap = max(float((b.overlap / path.solver.contacts.radius).max()) for b in path.balances)
    if any(b.free for b in path.balances) and any(point.label == "sliding" for point in path.points):
        result.append("where it slides on both sides its place along the drag is undetermined: u is one of many, the rest holds")
    if overlap > LARGE:
        result.append(f"overlaps of {overlap:.3g} radii, beyond Hertz' theory")
    if document.particle.weight > 0.0 and not path.planar:
        result.append("the forecast leaves out the weight")
    if any(point.label == "rolling" for point in path.points) and not path.under_load:
        result.append("a particle that tips at constant indentation wedges: its forces grow without bound; give a load instead")
    return result
