"""State of a run at one instant: the tables used by the kernels, and arguments of steps that both integrators share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thirdbody.engine.candidates import AllRows, Array, Candidates, Ints, empty_slots
from thirdbody.engine.placed import Placed
from thirdbody.engine.upper_plate import PatchedPlate, Schedule, Zone
from thirdbody.jit.arguments import address
from thirdbody.kernels import bodies as body_pass
from thirdbody.kernels import tables
from thirdbody.kernels.arguments import EFFECTS, LAW, MEASURE, OBSERVE, OBSERVE_BODIES
from thirdbody.kernels.labels import observe_bodies
from thirdbody.kernels.rolling_kinematics import MOMENTS, record_width
from thirdbody.kernels.table import Rows
from thirdbody.kernels.tables import body, body_extra, contact_state, domain, orientation, patch, run_totals, search_pose, sphere
from thirdbody.laws.compose import Chain
from thirdbody.laws.contract import Material
from thirdbody.laws.measures import Layout
from thirdbody.rotations import to_body, to_world

Action = Callable[[], None]  # what an integrator calls between steps: it may read the state, save it, or raise
FLAT = np.zeros(0)  # heights of a flat plate

RAYLEIGH_FRACTION = 0.2
"""Time step over Rayleigh time; a Hertz collision at 1 m/s then takes some 30 steps (0.1 to 0.3 is usual in DEM)."""

STABILITY_FRACTION = 0.2
"""Time step over 2/omega: the frequency error of velocity Verlet is then (omega dt)^2/24 = 0.7 %.
Halving it changes the friction curve of the main scene by less than 1e-5 and doubles its time."""

SUMMED = (
    run_totals.FRICTION_WORK, run_totals.DAMPING_WORK, run_totals.PLATE_WORK, run_totals.DRAG_WORK, run_totals.PLATE_WORK_SIZE,
    run_totals.EFFECT_WORK, run_totals.EFFECT_POWER, run_totals.PATCH_POWER, run_totals.LOAD_POWER, run_totals.STORED_NORMAL,
    run_totals.STORED_TANGENTIAL, run_totals.DIRECT_WORK, *(first + k for first in (run_totals.UPPER_IMPULSE,
    run_totals.LOWER_IMPULSE, run_totals.UPPER_FORCE, run_totals.LOWER_FORCE, run_totals.DIRECT_IMPULSE,
    run_totals.DIRECT_FORCE) for k in range(3)),
)  # fmt: skip
"""Totals that are summed over bodies, or groups of them, that are advanced each for itself."""


@dataclass(frozen=True)
class World:
    """Domain and plates. A domain that is not `periodic` is open, or ends at its `size` [m] if `bounded`; along y it may have
    `walls` instead. A periodic one may be open along x (`open_x`)."""

    size: tuple[float, float]
    periodic: bool
    bounded: bool
    lower: int | None
    upper: PatchedPlate | None
    debris_meets: bool
    walls: bool = False
    open_x: bool = False
    lower_surface: Array | None = None  # heights (`kernels.height_field.pack_field`); None: flat
    upper_surface: Array | None = None
    curved: tuple[bool, bool] = (True, True)  # whether the curvature of lower and upper plate enters the effective radius

    @property
    def rough(self) -> bool:
        """Whether contacts with plates are in the table of closest points: those of rough plates, and of side walls."""
        return self.lower_surface is not None or self.upper_surface is not None or self.walls

    @property
    def schedule(self) -> Schedule:
        return Schedule() if self.upper is None else self.upper.schedule

    @property
    def zone(self) -> Zone | None:
        return None if self.upper is None else self.upper.zone


@dataclass(frozen=True)
class CompiledMeasures:
    """Measures of a scene: compiled function, parameters (a row per pair), where numbers are kept, cells of the maps along x and
    y."""

    function: Callable
    parameters: Array
    layout: Layout
    cells: tuple[int, int]

    @property
    def mapped(self) -> bool:
        return bool(self.layout.maps) and self.cells[0] > 0

    def tables(self, bodies: int) -> tuple[Array, Array]:
        """Return at the start: W (bodies, `Layout.bodies`), what bodies have; `maps` (maps, 2 plates, n_y, n_x), on cells."""
        n_x, n_y = self.cells if self.mapped else (1, 1)
        return np.zeros((bodies, len(self.layout.bodies))), np.zeros((len(self.layout.maps) if self.mapped else 0, 2, n_y, n_x))


@dataclass(frozen=True)
class Physics(Chain):
    """Compiled laws and effects with their parameters. `kinds[a, b]`: row of `pairs` for two materials, -1 if none."""

    pairs: Array
    interaction: Array
    kinds: Ints
    effects: Callable
    effect_parameters: Array
    has_effects: bool
    observe: Callable
    label: Callable
    memory: int
    contact_memory: int
    stride: int
    labels: bool
    outputs: int
    measures: CompiledMeasures | None = None
    pull_off: Callable[[Ints, Array], Array] | None = None

    @cached_property
    def stiffness_at(self) -> int:
        return address(self.stiffness, LAW)

    @property
    def moments(self) -> bool:
        return self.rolling & MOMENTS != 0


@dataclass
class State:
    """Tables at one synchronised instant; columns are declared in `kernels.tables`."""

    world: World
    physics: Physics
    B: Array
    E: Array
    orientations: Array
    sphere_table: Array | None  # may be B; None: made anew for each reader of S, from `radii`
    P: Array
    A: Array
    D: Array
    schedule: Array
    first: Ints
    M: Array
    offsets: Array
    X0: Array
    body: Ints
    side: NDArray[np.int8]  # what a sphere can touch (`kernels.tables`)
    start: Ints
    patch: Ints
    material: Ints
    population: Ints
    rayleigh_radius: Array
    slots: Candidates
    skin: float
    order: Ints  # number of each body in the scene and in all outputs
    W: Array = field(default_factory=lambda: np.zeros((0, 0)))  # like `maps` what measures have collected
    maps: Array = field(default_factory=lambda: np.zeros((0, 2, 1, 1)))
    radii: Array = field(default_factory=lambda: np.zeros(0))  # of spheres that are not kept
    drive: Array = field(default_factory=lambda: np.zeros(0))  # row of `tables.drive`; empty: the plate follows its schedule
    wear: Any = None  # `engine.wear.Wear`, where wear changes the plates
    dt: float = 0.0
    searches: int = 0
    summed: bool = False  # whether the integrator sums the elastic energies; otherwise they come from the records
    inertial: bool = True  # whether bodies and patches have inertia, thus kinetic energy

    @property
    def n_bodies(self) -> int:
        return len(self.B)

    @property
    def n_spheres(self) -> int:
        return len(self.offsets)

    @property
    def S(self) -> Array:
        """Spheres: positions and velocities are those of their bodies at the end of the last step."""
        if self.sphere_table is not None:
            return self.sphere_table
        S = table(self.n_spheres, sphere.WIDTH)
        S[:, sphere.RADIUS], S[:, sphere.MASS] = self.radii, np.repeat(self.B[:, body.MASS], np.diff(self.start))
        body_pass.place_all(False, self.start, self.offsets, S, self.B, self.E, self.orientations)
        return S

    @property
    def reach(self) -> float:
        """Distance from touch [m] at which bodies begin to act on each other; 0 unless a law has a reach."""
        return float(self.D[domain.REACH])

    @property
    def lower_surface(self) -> Array:
        """Heights of the lower plate (`kernels.height_field`), empty where it is flat."""
        return FLAT if self.world.lower_surface is None else self.world.lower_surface

    @property
    def upper_surface(self) -> Array:
        return FLAT if self.world.upper_surface is None else self.world.upper_surface

    @property
    def given(self) -> Ints:
        return np.argsort(self.order)

    @property
    def given_spheres(self) -> Ints:
        given = self.given
        counts = np.diff(self.start)[given]
        return np.repeat(self.start[given] - (np.cumsum(counts) - counts), counts) + np.arange(self.n_spheres)

    @property
    def sprung(self) -> bool:
        """Whether springs drive the upper plate."""
        return len(self.drive) > 0

    def plate_displacement(self) -> tuple[float, float]:
        """Return the displacement of the upper plate now, along x and y [m]."""
        return tuple(self.drive[tables.drive.DISPLACEMENT2]) if self.sprung else self.world.schedule.displacement_at(self.time)

    @property
    def bodies(self) -> Rows:
        return Rows((self.B, body), (self.E, body_extra), (self.orientations, orientation))

    @property
    def spheres(self) -> Rows:
        return Rows((self.S, sphere))

    @property
    def patches(self) -> Rows:
        return Rows((self.P, patch))

    @property
    def search_poses(self) -> Rows:
        return Rows((self.X0, search_pose))

    @property
    def time(self) -> float:
        return float(self.A[run_totals.TIME])

    @property
    def distance(self) -> float:
        return float(self.A[run_totals.DISTANCE])


def table(rows: int, columns: int) -> Array:
    """Return cache-line-aligned zeros (rows, columns): no group of columns straddles two lines."""
    line = 64
    margin = np.zeros(rows * columns * 8 + line, np.uint8)
    first = -margin.ctypes.data % line
    return margin[first : first + rows * columns * 8].view(np.float64).reshape(rows, columns)


def assemble(placed: Placed, world: World, physics: Physics, skin: float, order: Ints | None = None, reach: float = 0.0) -> State:
    """Assemble the tables at time zero; forces are evaluated by `Explicit.start`. `order`: see `State`."""
    counts = np.array([len(clump.radii) for clump in placed.clumps], np.int64)
    start = np.concatenate(([0], np.cumsum(counts)))
    n_bodies, n_spheres = len(counts), int(start[-1])
    B = table(n_bodies, body.WIDTH)
    E = table(n_bodies, body_extra.WIDTH if physics.has_effects or physics.loss else body_extra.WIDTH_WITHOUT_EFFECTS)
    volume = np.array([clump.volume for clump in placed.clumps])
    inertia = np.array([clump.inertia for clump in placed.clumps])
    B[:, body.POSITION3] = placed.positions
    B[:, body.VELOCITY3] = placed.velocities
    orientations = table(n_bodies, orientation.WIDTH)
    orientations[:, orientation.QUATERNION4] = placed.quaternions
    B[:, body.MASS] = placed.densities * volume
    E[:, body_extra.INERTIA3] = placed.densities[:, None] * inertia
    offsets = np.ascontiguousarray(np.concatenate([clump.centers for clump in placed.clumps]))
    E[:, body_extra.LONGEST_ARM] = np.maximum.reduceat(np.linalg.norm(offsets, axis=1), start[:-1])
    ball = (E[:, body_extra.LONGEST_ARM] == 0.0) & np.all(inertia == inertia[:, :1], axis=1)
    B[:, body.SPHERE_INERTIA] = np.where(ball, E[:, body_extra.INERTIA], 0.0)
    B[:, body.SPIN3] = placed.angular_velocities
    E[:, body_extra.ANGULAR_MOMENTUM3] = angular_momentum(B, E, orientations)
    S = table(n_spheres, sphere.WIDTH)
    S[:, sphere.RADIUS] = np.concatenate([clump.radii for clump in placed.clumps])
    S[:, sphere.MASS] = np.repeat(B[:, body.MASS], counts)
    D, sign = np.zeros(domain.WIDTH), 1.0 if world.periodic else (-1.0 if world.bounded else 0.0)
    D[domain.LENGTH_X] = 0.0 if world.open_x else sign * world.size[0]
    D[domain.LENGTH_Y] = (-1.0 if world.walls else sign) * world.size[1]
    D[domain.SKIN], D[domain.REACH] = skin, reach
    D[domain.FLOOR] = -np.inf if world.lower is None else 0.0
    D[domain.CURVED2] = world.curved
    upper, (schedule, first) = world.upper, world.schedule.tables()
    # kernels index the patch of every body; without an upper plate no candidate refers to it
    P = np.ones((1, patch.WIDTH)) * (np.arange(patch.WIDTH) == patch.MASS) if upper is None else upper.table()
    # histories: engine's columns, those of the laws, the labeller's memory for the owner and a body as partner, measures
    width = max(contact_state.LAW + len(physics.history), contact_state.MIN_WIDTH)
    width += (2 if world.debris_meets else 1) * physics.contact_memory
    width += physics.measures.layout.width if physics.measures else 0
    state = State(
        world=world, physics=physics, B=B, E=E, orientations=orientations, sphere_table=S, P=P,
        A=np.zeros(run_totals.WIDTH), D=D,
        schedule=schedule, first=first, M=np.zeros((n_bodies, max(physics.memory, 1))), offsets=offsets,
        X0=np.zeros((n_bodies, search_pose.WIDTH)), body=np.repeat(np.arange(n_bodies), counts),
        side=placed.sides().astype(np.int8), start=start,
        patch=np.zeros(n_bodies, np.int64) if upper is None else upper.patch, material=placed.materials,
        population=placed.populations, rayleigh_radius=np.cbrt(3.0 * volume / (4.0 * np.pi)),
        slots=empty_slots(width, record_width(physics.rolling)), skin=skin,
        order=np.arange(n_bodies) if order is None else order,
    )  # fmt: skip
    if world.schedule.sprung:
        state.drive = np.zeros(tables.drive.WIDTH)
        state.drive[tables.drive.STIFFNESS2] = world.schedule.through
        state.drive[tables.drive.MASS] = P[:, patch.MASS].sum()
    if physics.measures:
        state.W, state.maps = physics.measures.tables(n_bodies)
    refresh_spheres(state)
    return state


def rayleigh_times(state: State, materials: Sequence[Material]) -> Array:
    """Return the times (n_bodies,) [s] of a Rayleigh wave around spheres with the volumes of the bodies:
    pi R sqrt(rho/G)/(0.1631 nu + 0.8766)."""
    per_radius = [math.pi * math.sqrt(m.density / m.shear_modulus) / (0.1631 * m.poisson_ratio + 0.8766) for m in materials]
    return np.array(per_radius)[state.material] * state.rayleigh_radius


def angular_momentum(B: Array, E: Array, orientations: Array) -> Array:
    q = orientations[:, orientation.QUATERNION4]
    return to_world(q, to_body(q, B[:, body.SPIN3]) * E[:, body_extra.INERTIA3])


def refresh_spheres(state: State) -> None:
    body_pass.place_all(True, state.start, state.offsets, state.S, state.B, state.E, state.orientations)


def orientations(state: State) -> Array:
    """Return the quaternions of all bodies now (n, 4), a copy; a state may be behind (`kernels.bodies`)."""
    q, behind = state.bodies.quaternion.copy(), state.A[run_totals.BEHIND]
    balls = np.flatnonzero(state.B[:, body.SPHERE_INERTIA]) if behind != 0.0 else np.zeros(0, np.int64)
    half = 0.5 * behind * state.bodies.spin[balls]
    half *= 1.0 + np.sum(half * half, axis=1, keepdims=True) / 3.0  # the tangent
    w, v = q[balls, :1], q[balls, 1:]
    q_new = np.hstack((w - np.sum(half * v, axis=1, keepdims=True), v + w * half + np.cross(half, v)))
    q[balls] = q_new / np.linalg.norm(q_new, axis=1, keepdims=True)
    return q


def constant_arguments(state: State, drag: Array) -> dict[str, Any]:
    """Return those that no step and no search replaces. `drag`: unit vector of the prescribed motion of the upper plate."""
    s, physics, measures = state, state.physics, state.physics.measures
    (begin, size), (force, moment, twist) = physics.field, physics.force_columns
    return {
        "body": s.body, "start": s.start, "patch": s.patch, "offsets": s.offsets, "B": s.B, "E": s.E,
        "orientations": s.orientations, "P": s.P, "M": s.M, "D": s.D, "schedule": s.schedule, "first": s.first,
        "lower": s.lower_surface, "upper": s.upper_surface, "drag": drag, "pairs": physics.pairs,
        "zone": s.world.zone.row if s.world.zone else FLAT, "spring": s.drive,
        "interaction": physics.interaction, "effect_parameters": physics.effect_parameters,
        "n_history": len(physics.history), "field_begin": begin, "field_size": size, "rolling": physics.rolling,
        "force": force, "moment": moment, "twist": twist, "stored": physics.stored, "dashpots": physics.dashpots,
        "loss_column": physics.loss_column, "width": tables.loaded_contact.MEMORY + physics.contact_memory,
        "has_effects": int(physics.has_effects), "labels": int(physics.labels), "law": address(physics.law, LAW),
        "effects": address(physics.effects, EFFECTS), "observe": address(physics.observe, OBSERVE),
        "observe_bodies": address(observe_bodies, OBSERVE_BODIES) if physics.labels else 0,
        "measured": measures.layout.width if measures else 0, "measure": address(measures.function, MEASURE) if measures else 0,
        "measure_parameters": measures.parameters if measures else np.zeros(1),
    }  # fmt: skip


def table_arguments(state: State) -> dict[str, Any]:
    """Return the tables that searches replace: of candidates and spheres; no rows where a body has them while it is advanced."""
    slots, rows = state.slots, state.slots.rows
    H, R = (rows.H, rows.R) if isinstance(rows, AllRows) else (np.zeros((0, width)) for width in rows.widths)
    S = np.zeros((0, sphere.WIDTH)) if state.sphere_table is None else state.sphere_table
    return {
        "own": slots.own, "partner": slots.partner, "edges": slots.edges, "incidence": slots.incidence, "S": S, "Q": slots.Q,
        "H": H, "R": R,
    }  # fmt: skip
