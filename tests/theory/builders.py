"""Scenes of one or two bodies for the tests, and what can be read off a running simulation."""

import itertools
import math
from collections import namedtuple
from collections.abc import Sequence
from typing import Any

import numpy as np
from thirdbody.assembly.simulation import Simulation, build
from thirdbody.kernels.tables import body, body_extra, record, run_totals
from thirdbody.scene import model
from thirdbody.scene.model import Material, Scene, Spheres, UpperPlate

RIGID = 1e6  # stiffness of a `rigid` plane over that of the ball: E* is then off by 1e-6, t_c by 4e-7
LONG = 1.0  # duration written into scenes that are stopped by hand, s


def solid(youngs_modulus: float, nu: float, density: float) -> Material:
    return Material(youngs_modulus=youngs_modulus, poisson_ratio=nu, density=density)


def stiffened(material: Material) -> Material:
    return Material(shear_modulus=RIGID * material.shear(), poisson_ratio=material.poisson_ratio, density=material.density)


STEEL = solid(210e9, 0.3, 7850.0)


def ball(radius: float, where: Sequence[float], velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), material="ball") -> Spheres:
    place = {"positions": (tuple(where),), "velocity": tuple(velocity), "angular_velocity": tuple(spin)}
    return Spheres(material=material, radius=radius, **place)


def scene(debris, materials, friction=0.0, restitution=1.0, lower=None, upper=None, time_step="auto", **more) -> Scene:
    """Every pair of materials has the same friction and restitution; `more` may replace whole tables."""
    pairs = tuple(
        model.PairTable(between=names, friction=friction, restitution=restitution)
        for names in itertools.combinations_with_replacement(materials, 2)
    )
    size = more.pop("size", 10.0)
    tables = {
        "domain": model.Domain(size=(size, size), periodic=lower is not None),
        "plates": model.Plates(lower=model.LowerPlate(material=lower) if lower else None, upper=upper),
        "contact": model.Contact(law="three_spot", level="mindlin"),
        "effects": model.Effects(gravity=more.pop("gravity", None)),
        "solver": model.Solver(duration=LONG, time_step=time_step),
        "output": model.Output(every=LONG, every_kind="time"),
        "pairs": pairs,
    }
    return Scene(materials=materials, debris=tuple(debris), **(tables | more))


def ball_on_plane(material: Material, radius: float, velocity, spin=(0.0, 0.0, 0.0), **keys: Any) -> Simulation:
    """At time zero it touches a rigid plane of the same Poisson's ratio, without overlap."""
    materials = {"ball": material, "plane": stiffened(material)}
    return build(scene([ball(radius, (5.0, 5.0, radius), velocity, spin)], materials, lower="plane", **keys))


def two_balls(material: Material, radius: float, velocity, spin=(0.0, 0.0, 0.0), **keys: Any) -> Simulation:
    """Two equal balls that touch at time zero: the left one has `velocity` and `spin`, the right one their opposites."""
    # a gap of one rounding error of the coordinates keeps the start free of overlap
    x = radius * (1.0 + 1e-15)
    pair = [ball(radius, (-x, 0.0, 0.0), velocity, spin), ball(radius, (x, 0.0, 0.0), -np.array(velocity), -np.array(spin))]
    return build(scene(pair, {"ball": material}, **keys))


def velocity(simulation: Simulation, number: int = 0) -> np.ndarray:
    return simulation.state.bodies.velocity[number].copy()


def spin(simulation: Simulation, number: int = 0) -> np.ndarray:
    return simulation.state.bodies.spin[number].copy()


def touching(simulation: Simulation) -> np.ndarray:
    return simulation.state.slots.histories.slip > 0.0


def contact(simulation: Simulation) -> np.ndarray:
    """Record (columns R_*) of the only closed contact; zeros when there is none."""
    closed = touching(simulation)
    assert closed.sum() <= 1
    return simulation.state.slots.R[closed][0].copy() if closed.any() else np.zeros(record.WIDTH)


def advance(simulation: Simulation, steps: int = 1) -> None:
    for _ in range(steps):
        simulation.integrator.advance_to(time=simulation.state.time + 0.5 * simulation.state.dt)


def label(simulation: Simulation, body: int = 0) -> str:
    assert simulation.labeller is not None
    return simulation.labeller.states[int(simulation.integrator.label()[body, 0])]


Impact = namedtuple("Impact", "time overlap normal tangential end")
"""An impact step by step: time s, overlap m, normal and tangential force N; the end is when the gap was zero again."""


def impact(simulation: Simulation, gap_rate) -> Impact:
    """Follow the only contact from its start at time zero until it opens; `gap_rate()` is (gap m, speed m/s) after it."""
    state, rows = simulation.state, []
    while True:
        advance(simulation)
        row = contact(simulation)
        if row[record.CONTACT_RADIUS] == 0.0 and rows:
            break
        rows.append((state.time, row[record.OVERLAP], row[record.NORMAL_FORCE], np.linalg.norm(row[record.TANGENTIAL_FORCE3])))
        assert len(rows) < 100_000
    gap, rate = gap_rate()
    return Impact(*np.array(rows).T, end=state.time - gap / rate)


def plane_impact(simulation: Simulation) -> Impact:
    state = simulation.state
    return impact(simulation, lambda: (state.spheres.position[0, 2] - state.spheres.radius[0], velocity(simulation)[2]))


def leave(simulation: Simulation, period: float) -> None:
    """Run, in parts of `period` (s), until nothing touches any more."""
    for _ in range(100):
        simulation.integrator.advance_to(time=simulation.state.time + period)
        if not touching(simulation).any():
            return
    raise AssertionError("the bodies never part")


def kinetic(simulation: Simulation) -> float:
    B, E = simulation.state.B, simulation.state.E
    spins = np.sum(E[:, body_extra.ANGULAR_MOMENTUM3] * B[:, body.SPIN3])
    return 0.5 * float(np.sum(B[:, body.MASS, None] * B[:, body.VELOCITY3] ** 2) + spins)


def momenta(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
    B, E = simulation.state.B, simulation.state.E
    linear = B[:, body.MASS, None] * B[:, body.VELOCITY3]
    angular = np.cross(B[:, body.POSITION3], linear) + E[:, body_extra.ANGULAR_MOMENTUM3]
    return linear.sum(axis=0), angular.sum(axis=0)


def ball_mass(material: Material, radius: float) -> float:
    return material.density * 4.0 / 3.0 * math.pi * radius**3


def under_patches(debris, materials, load, motion, level="mindlin", patch=None, options=None, **keys) -> Simulation:
    """Bodies that do not see each other, each under a patch of its own of the material `ball`, pressed by a load (N) and
    dragged. `patch`: further keys of the upper plate, `options`: of the law, `keys`: of the solver or of `scene`."""
    solver = {key: keys.pop(key) for key in tuple(keys) if key in model.Solver.model_fields}
    solver = solver if "distance" in solver else {"duration": LONG} | solver
    size, periodic, force = keys.pop("size", 10.0), keys.pop("periodic", True), keys.pop("force", False)
    upper = UpperPlate(material="ball", motion=motion, **{"support": "load_per_particle", "load": load} | (patch or {}))
    tables = {
        "plates": model.Plates(lower=model.LowerPlate(material="ball"), upper=upper),
        "contact": model.Contact(level=level, debris_contact="none", options=options or {}),
        "solver": model.Solver(**solver),
        "domain": model.Domain(size=(size, size), periodic=periodic),
    }
    return build(scene(debris, materials, **(tables | keys)), force=force)


def numerical_share(simulation: Simulation) -> float:
    """What the integrator itself has lost so far, as a part of the plate's work; negative where it made energy."""
    A = simulation.state.A
    return float(A[run_totals.NUMERICAL_LOSS] / A[run_totals.PLATE_WORK_SIZE])


LUMP = tuple(
    {"center": tuple(1e-6 * x for x in center), "radius": 1e-6 * radius}
    for center, radius in (((0.0, 0.0, 0.0), 5.0), ((4.0, 1.0, 0.5), 4.0), ((-3.0, 3.0, -0.7), 4.2), ((-2.5, -3.2, 0.6), 4.1))
)  # an irregular clump that finds a better seat as it is pressed, then slides, turns and settles once more
HEXAGON = tuple(
    {"center": (3e-6 * x, 3e-6 * y, 0.0), "radius": 2e-6}
    for x, y in [(0.0, 0.0)] + [(math.cos(k * math.pi / 3.0), math.sin(k * math.pi / 3.0)) for k in range(6)]
)


def clump(shape: Sequence[dict[str, Any]], x: float = 1e-4, y: float = 1e-4, gap: float = 1e-7) -> Spheres:
    low = min(ball["center"][2] - ball["radius"] for ball in shape)
    return Spheres(material="ball", shape=tuple(shape), positions=((x, y, gap - low),))


def plate_force(simulation: Simulation) -> np.ndarray:
    return simulation.state.A[run_totals.UPPER_FORCE3].copy()


def mean_force(simulation: Simulation, path: float) -> np.ndarray:
    """Mean force (3,) on the upper plate while it moves on by `path` (m), N."""
    A, state = simulation.state.A, simulation.state
    time, impulse = state.time, A[run_totals.UPPER_IMPULSE3].copy()
    simulation.integrator.advance_to(distance=state.distance + path)
    return (A[run_totals.UPPER_IMPULSE3] - impulse) / (state.time - time)
