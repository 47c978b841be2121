"""Small scenes of the robustness cases: free spheres, particles and clumps between plates."""

import itertools
from collections.abc import Sequence
from typing import Any

from thirdbody.scene.model import (
    Ball,
    ConstantVelocity,
    Contact,
    Domain,
    LowerPlate,
    Material,
    Motion,
    Output,
    Pair,
    Plates,
    Scene,
    Solver,
    Spheres,
    Spot,
    Spots,
    UpperPlate,
)
from thirdbody.studies.robustness.case import Trial

MICRON = 1e-6
RIGID = 1e6
"""Stiffness of a rigid plane over that of the sphere."""

LONG = 1.0
"""Duration in scenes that are stopped by the case [s]."""

LOAD, SPEED, BOX = 1e-4, 1.0, 2e-4
"""Load on a body [N], speed of the drag [m/s] and side of the domain [m] of the micrometre scenes."""

HEIGHT, SPAN = 4e-6, 2e-6
"""Height h of a particle of three spots and distance L of its lower spots from the middle [m]: t_max = L/h = 0.5 at x_1 = 0."""

TRIPOD = ((-1.9, -1.1, 0.0, 2.0), (1.9, -1.1, 0.0, 2.0), (0.0, 2.2, 0.0, 2.0))
"""Three adjacent spheres (x, y, z, radius; um): three contacts below and three above, a little flatter than wide."""


def solid(youngs_modulus: float, nu: float, density: float) -> Material:
    """Return a material from E [Pa], Poisson's ratio and density [kg/m3]."""
    return Material(youngs_modulus=youngs_modulus, poisson_ratio=nu, density=density)


STEEL = solid(210e9, 0.3, 7850.0)


def stiffened(material: Material) -> Material:
    """Return the same material, `RIGID` times stiffer."""
    return Material(shear_modulus=RIGID * material.shear(), poisson_ratio=material.poisson_ratio, density=material.density)


def ball(radius: float, where: Sequence[float], velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), material="ball") -> Spheres:
    """Return one sphere at `where` [m] with a velocity [m/s] and a spin [rad/s]."""
    centres = (_three(where),)
    return Spheres(
        material=material, count=1, radius=radius, positions=centres, velocity=_three(velocity), angular_velocity=_three(spin)
    )


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def clump(balls: Sequence[Sequence[float]], x: float = 0.5 * BOX, y: float = 0.5 * BOX, gap: float = 1e-8) -> Spheres:
    """Return a clump of spheres (x, y, z, radius) [um], `gap` [m] above the lower plate at x, y [m], up to its centre of mass."""
    shape = tuple(Ball(center=(MICRON * b[0], MICRON * b[1], MICRON * b[2]), radius=MICRON * b[3]) for b in balls)
    low = min(part.center[2] - part.radius for part in shape)
    return Spheres(material="ball", count=1, shape=shape, positions=((x, y, gap - low),))


def particle(upper: Sequence[float], lower: Sequence[float], radius: float = 1.5e-6) -> Spots:
    """Return a planar particle with spots of one radius at these x [m], above and below."""
    spots = [Spot(side="upper", x=x, z=0.5 * HEIGHT, radius=radius) for x in upper]
    spots += [Spot(side="lower", x=x, z=-0.5 * HEIGHT, radius=radius) for x in lower]
    centre = (0.5 * BOX, 0.5 * BOX)
    return Spots(material="ball", planar=True, mass=1e-13, inertia=(2e-25,) * 3, spots=tuple(spots), positions=(centre,))


def scene(
    trial: Trial, debris: Sequence[Any], materials: dict[str, Material], friction: float, restitution: float = 1.0,
    size: float = 10.0, lower: str | None = None, upper: UpperPlate | None = None, **tables: Any,
) -> Scene:  # fmt: skip
    """Return a scene for the integrator, the level and the time step of a trial; all pairs alike, unless given.

    `tables` may replace whole tables.
    """
    pairs = tables.pop("pairs", None) or tuple(
        Pair(between=names, friction=friction, restitution=restitution)
        for names in itertools.combinations_with_replacement(materials, 2)
    )
    settle = tables.pop("settle", "auto")
    result = {
        "domain": Domain(size=(size, size), periodic=lower is not None),
        "plates": Plates(lower=LowerPlate(material=lower) if lower else None, upper=upper),
        "contact": Contact(level=trial.setting.level, debris_contact="auto" if upper is None else "none"),
        "solver": Solver(duration=LONG, settle=settle, **trial.solver()),
        "output": Output(every=LONG, every_kind="time"),
    }
    return Scene(materials=materials, pairs=pairs, debris=tuple(debris), **(result | tables))


def on_plane(trial: Trial, material: Material, radius: float, velocity: Sequence[float], friction: float, **keys: Any) -> Scene:
    """Return a sphere that touches a rigid plane of the same Poisson's ratio at time zero, without overlap."""
    materials = {"ball": material, "plane": stiffened(material)}
    return scene(trial, [ball(radius, (5.0, 5.0, radius), velocity)], materials, friction, lower="plane", **keys)


def drag(speed: float = SPEED) -> Motion:
    """Return the motion of the upper plate at a constant speed along x [m/s]."""
    return Motion(x=(ConstantVelocity(velocity=speed),))


def pressed(
    trial: Trial, debris: Any, friction: float, motion: Motion | None = None, restitution: float = 0.5,
    materials: dict[str, Material] | None = None, plate: dict[str, Any] | None = None, **tables: Any,
) -> Scene:  # fmt: skip
    """Return a body under a separate, loaded patch, dragged; `plate` are further keys of the upper plate."""
    known = materials or {"ball": STEEL}
    last = list(known)[-1]
    plate_table: dict[str, Any] = {"support": "load_per_particle", "load": LOAD, "motion": motion or drag()} | (plate or {})
    upper = UpperPlate(material=last, **{key: value for key, value in plate_table.items() if value is not None})
    return scene(trial, [debris], known, friction, restitution, BOX, last, upper, **tables)
