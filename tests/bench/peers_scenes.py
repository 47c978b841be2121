"""The scenes that our engine and its C++ peers run, from the same starting configurations: our side of them.

S: a dense layer of spheres of 18 to 22 um between plates 200 um apart, the upper one moving. C: the same of clumps of 4 to 8
unequal spheres. T: clumps pinched between plates that do not see each other. Steel, Hertz-Mindlin with dashpots, fixed time step.

A configuration is a file `S_16000.npz` of the peers' folder, in um, pg and us: x, rad (spheres), mol (body of each), L, H, dt;
for spheres v, w; for clumps bm, bx, bv, bw, bI (mass, centre, velocities and inertia in space axes)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from thirdbody.assembly import simulation as building
from thirdbody.assembly.simulation import Simulation
from thirdbody.bodies.clump import Clump
from thirdbody.engine.guards import Ledger
from thirdbody.engine.placed import Placed
from thirdbody.engine.units import EXPLICIT, warm_up
from thirdbody.laws.registry import CATALOGUE, Registry
from thirdbody.scene.model import Scene
from thirdbody.trajectory.frame import FrameMaker

LENGTH, MASS, TIME = 1e-6, 1e-15, 1e-6  # um, pg and us in SI; a velocity in um/us is one in m/s
DENSITY = 7850.0
SPEED = {"S": 5.0, "C": 5.0, "T": 0.5}  # velocity of the upper plate, m/s
# duration of the scene, s: longer than any benchmark, which stops by steps; much longer, a million spheres would be refused
FAR = 1e-3

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class Start:
    """A starting configuration in SI: spheres x (n, 3), radii (n,), body (n,), sorted by body; domain size, gap, time step;
    bodies mass (b,), centre, velocity, spin (b, 3), principal moments (b, 3) about axes (b, 3, 3), columns; None: the world's."""

    kind: str
    x: np.ndarray
    radii: np.ndarray
    body: np.ndarray
    size: tuple[float, float]
    gap: float
    step: float
    mass: np.ndarray
    centre: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    moments: np.ndarray
    axes: np.ndarray | None

    @property
    def spheres(self) -> int:
        return len(self.radii)

    @property
    def bodies(self) -> int:
        return len(self.mass)


def read(path: Path) -> Start:
    """The configuration in a file such as `S_16000.npz`. Raises OSError without the file."""
    with np.load(path) as data:
        return start_of(path.name[0], {name: data[name] for name in data.files})


def start_of(kind: str, given: Arrays) -> Start:
    radii, x = LENGTH * given["rad"], LENGTH * given["x"]
    if kind == "S":
        mass = DENSITY * 4.0 / 3.0 * math.pi * radii**3
        moments, axes = np.broadcast_to((0.4 * mass * radii**2)[:, None], x.shape), None
        centre, velocity, spin = x, given["v"], given["w"] / TIME
    else:
        moments, axes = np.linalg.eigh(given["bI"])
        axes[:, :, 2] *= np.linalg.det(axes)[:, None]
        moments, mass = moments * MASS * LENGTH**2, given["bm"] * MASS
        centre, velocity, spin = LENGTH * given["bx"], given["bv"], given["bw"] / TIME
    size = (float(given["L"][0]) * LENGTH, float(given["L"][1]) * LENGTH)
    gap, step = float(given["H"]) * LENGTH, float(given["dt"]) * TIME
    return Start(kind, x, radii, given["mol"], size, gap, step, mass, centre, velocity, spin, moments, axes)


def simulation_of(start: Start) -> Simulation:
    """Our simulation of a configuration at time zero: laws of the catalogue, no labels. A scene refuses bodies that overlap at
    the start, and here a flow goes on; so the bodies take the place of those of the scene."""
    warm_up(EXPLICIT)
    placed = placed_of(start)
    plate = building.upper_plate

    def upper(scene: Scene, choice: Any, bodies: Placed, warnings: list[str], rough: Any) -> Any:
        """The plate is where the file says, although spheres press into it: what is built is that over sunken bodies."""
        sunken = bodies.positions - [0.0, 0.0, start.gap]
        return plate(scene, choice, replace(bodies, positions=sunken), warnings, rough)

    with patch.multiple(building, populate=lambda *_: placed, upper_plate=upper):
        # the step is fixed as the peers' is, also where a contact comes to its bound of stability
        return building.build(scene_of(start), Registry((CATALOGUE,)), force=True)


def scene_of(start: Start) -> Scene:
    width, depth = start.size
    return Scene.model_validate({
        "title": f"{start.kind} of the peers",
        "materials": {"steel": {"youngs_modulus": "210 GPa", "poisson_ratio": 0.3, "density": f"{DENSITY} kg/m3"}},
        "pairs": [{"between": ["steel", "steel"], "friction": 0.3, "restitution": 0.6}],
        "debris": [{"kind": "spheres", "material": "steel", "count": 1, "radius": 1e-6, "positions": [[0.0, 0.0, 1e-6]]}],
        "domain": {"size": [width, depth]},
        "plates": {
            "lower": {"material": "steel"},
            "upper": {"material": "steel", "gap": start.gap, "motion": {"x": {"velocity": SPEED[start.kind]}}},
        },
        "contact": {"law": "hertz_mindlin", "level": "mindlin", "debris_contact": "none" if start.kind == "T" else "auto"},
        "solver": {"integrator": "explicit", "time_step": start.step, "duration": FAR, "settle": 0.0},
        "output": {"every": FAR, "every_kind": "time"},
    })  # fmt: skip


def placed_of(start: Start) -> Placed:
    n, none = start.bodies, np.zeros(start.bodies, np.int64)
    ends = np.searchsorted(start.body, np.arange(n + 1))
    arms = start.x - start.centre[start.body]
    quaternions = np.zeros((n, 4))
    quaternions[:, 0] = 1.0
    if start.axes is not None:
        arms = np.einsum("nj,njk->nk", arms, start.axes[start.body])
        quaternions = np.roll(Rotation.from_matrix(start.axes).as_quat(), 1, axis=1)
    clumps = Shapes(arms, start.radii, ends, start.mass / DENSITY, start.moments / DENSITY)
    moving = start.velocity.copy(), start.spin.copy()
    return Placed(clumps, np.full(n, DENSITY), none, none, start.centre.copy(), quaternions, *moving)


class Shapes(Sequence[Clump]):
    """The shapes of the bodies, each made when it is asked for: a list of them takes 820 bytes per sphere in S."""

    def __init__(self, arms: np.ndarray, radii: np.ndarray, ends: np.ndarray, volume: np.ndarray, inertia: np.ndarray) -> None:
        self.arms, self.radii, self.ends, self.volume, self.inertia = arms, radii, ends, volume, inertia

    def __len__(self) -> int:
        return len(self.volume)

    def __getitem__(self, k: Any) -> Any:
        if isinstance(k, slice):
            return [self[i] for i in range(*k.indices(len(self)))]
        if not -len(self) <= k < len(self):
            raise IndexError(k)
        own = slice(self.ends[k % len(self)], self.ends[k % len(self) + 1])
        return Clump(self.arms[own], self.radii[own], float(self.volume[k]), self.inertia[k], 0.0)


def spheres_of(simulation: Simulation) -> Arrays:
    """points and velocity (n, 3) of the spheres now, as an output would tell them, in the order of the file."""
    state = simulation.state
    return dict(FrameMaker(state, Ledger(state), None, (1.0, 0.0)).frame(None).spheres)


def count_contacts(start: Start, x: np.ndarray) -> tuple[int, int]:
    """Contacts between spheres at x (n, 3), m, of different bodies, and with plates: from places alone, for all engines."""
    radii = start.radii
    plates = int(np.sum(x[:, 2] < radii) + np.sum(start.gap - x[:, 2] < radii))
    if start.kind == "T":
        return 0, plates
    a, b, _ = close_pairs(x, radii, start.size)
    return int(np.sum(start.body[a] != start.body[b])), plates


def kinetic_energy(start: Start, velocity: np.ndarray) -> float:
    """Sum of m v^2/2 over the spheres, each with the mass of its own volume and its own velocity (n, 3), J: what peers tell."""
    return float(0.5 * DENSITY * 4.0 / 3.0 * math.pi * np.sum(start.radii**3 * np.einsum("ij,ij->i", velocity, velocity)))


def generated(spheres: int, seed: int = 1) -> Arrays:
    """A layer as S has it, in the layout of its files, made on the spot: spheres pushed apart from random places, in a uniform
    shear flow. Contacts are few at first and come up to those of S within some thousand steps."""
    rng = np.random.default_rng(seed)
    height, fill, mean = 200.0, 0.588, 10.0
    side = max(50.0, math.sqrt(spheres * 4.0 / 3.0 * math.pi * mean**3 / (fill * height)))  # few: the images must not meet
    rad = rng.uniform(9.0, 11.0, spheres)
    x = pushed_apart(rng.uniform(0.0, 1.0, (spheres, 3)) * (side, side, height), rad, (side, side), height)
    v = np.column_stack((SPEED["S"] * x[:, 2] / height, *rng.normal(0.0, 0.2, (2, spheres))))
    step = 0.18 * math.pi * 9.0 * math.sqrt(7.85 / (2.1e8 / 2.6)) / (0.1631 * 0.3 + 0.8766)  # of the Rayleigh time
    return {
        "x": x, "v": v, "w": np.zeros_like(v), "rad": rad, "mol": np.arange(spheres), "L": np.array([side, side]),
        "H": np.array(height), "dt": np.array(step),
    }  # fmt: skip


def pushed_apart(x: np.ndarray, radii: np.ndarray, size: tuple[float, float], height: float) -> np.ndarray:
    """Places (n, 3) at which no overlap is deeper than .2 % of a radius: every overlapping pair parts by more than it overlaps,
    again and again (1.8 times: 130 rounds for 2000 spheres, 1900 with 1). Raises RuntimeError where there is no room."""
    x, few = x.copy(), 2e-3 * radii.min()
    for _ in range(5000):
        x[:, 2] = np.clip(x[:, 2], radii, height - radii)
        a, b, apart = close_pairs(x, radii, size)
        distance = np.linalg.norm(apart, axis=1)
        overlap = radii[a] + radii[b] - distance
        if not len(a) or overlap.max() < few:
            return x
        push = ((0.9 * overlap + 0.3 * few) / np.maximum(distance, few))[:, None] * apart
        np.add.at(x, a, push)
        np.add.at(x, b, -push)
    raise RuntimeError("spheres could not be pushed apart")


def close_pairs(x: np.ndarray, radii: np.ndarray, size: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Overlapping spheres a and b (m,) and the way from b to a (m, 3), to the nearest image in x and y."""
    lengths = np.array(size)
    box = np.column_stack((x[:, :2] % lengths, x[:, 2] - x[:, 2].min()))
    box[:, :2][box[:, :2] >= lengths] = 0.0  # the remainder of a tiny negative number is rounded to the divisor
    height = box[:, 2].max() + 4.0 * radii.max()  # no images across the layer
    a, b = cKDTree(box, boxsize=[*lengths, height]).query_pairs(2.0 * radii.max(), output_type="ndarray").T
    apart = box[a] - box[b]
    apart[:, :2] -= lengths * np.round(apart[:, :2] / lengths)
    near = np.einsum("ij,ij->i", apart, apart) < (radii[a] + radii[b]) ** 2
    return a[near], b[near], apart[near]
