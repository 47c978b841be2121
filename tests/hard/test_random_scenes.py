"""Random valid scenes end well, or with a word that says why: no raw exception, no NaN, no residual or label left unexplained.

Every key is within its allowed range, from one sphere to needles of 20; at most 12 bodies and short: loads, speeds and times
follow from the overlap that the load should give, 1e-6 to 0.03 of the sphere's radius."""

import math
import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from trajectories import contents
import thirdbody
from thirdbody.errors import GuardStop, InputError, Interrupted
from thirdbody.runner.run_loop import WallTimes
from thirdbody.runner.simulate import execute, prepare
from thirdbody.schema.write import toml_text
from thirdbody.trajectory.names import ACCOMMODATION, BED

SCENES = int(os.environ.get("RANDOM_SCENES", "60"))
WALL_LIMIT = 20.0  # s; a scene takes about one on an idle core; what is cut off must say what limits its steps
LARGEST_RESIDUAL = 1e-3  # of the work: the project's promise for every run without a word


def run_scene(document: dict[str, Any], folder: Path, threads: int = 1, wall_limit: float = math.inf) -> str:
    try:
        scene = thirdbody.Scene.parse(toml_text(document))
        simulation = prepare(scene)
    except InputError as error:
        assert all(fault.key for fault in error.faults), error
        return "refused"
    end = "finished"
    try:
        execute(simulation, folder, threads, times=WallTimes(limit=wall_limit))
    except GuardStop as stop:
        assert " t = " in str(stop), stop  # says when
        end = "guard"
    except Interrupted:
        end = "cut off"
    with thirdbody.open(folder) as run:
        check_numbers(run)
        check_labels(run)
        if end == "finished":
            residual, verdict = (run.summary().get(name) for name in ("energy_residual", "energy_verdict"))
            assert not abs(residual) > LARGEST_RESIDUAL or verdict, f"a residual of {residual:.2g} without a word"
        if end == "cut off" and scene.solver.integrator == "implicit":
            assert run.summary()["steps_limited_by"], "a crawl without a word"
    return end


def check_numbers(run: thirdbody.Run) -> None:
    for name, values in run.series.items():
        assert np.isfinite(values).all() or name in ("friction_coefficient", *ACCOMMODATION, *BED), name
    for frame in range(run.frames):
        bodies, contacts = run.bodies(frame), run.contacts(frame)
        for name in ("position", "velocity", "force", "torque", "friction_work"):
            assert np.isfinite(bodies[name]).all(), (frame, name)
        for name in ("normal_force", "tangential_force", "overlap", "contact_radius"):
            assert np.isfinite(contacts[name]).all(), (frame, name)
        assert (contacts["utilisation"] <= 1.0 + 1e-9).all(), frame  # round-off of the return to the limit


def check_labels(run: thirdbody.Run) -> None:
    free = run.state_names.index("free")
    for frame in range(run.frames):
        contacts, state = run.contacts(frame), run.bodies(frame)["state"]
        touched, loaded = np.zeros((2, len(state)), dtype=bool)
        for name in ("body", "partner"):
            bodies = contacts[name] >= 0
            touched[contacts[name][bodies]] = True
            loaded[contacts[name][bodies & (contacts["normal_force"] > 0.0)]] = True
        assert (state[~touched] == free).all(), f"frame {frame}: a label without a contact"
        assert (state[loaded] != free).all(), f"frame {frame}: free under load"


LEVELS = ("coulomb", "mindlin", "mdr", "exact")
FRICTIONS = (0.0, 0.05, 0.3, 1.0, 10.0, 1000.0)
RESTITUTIONS = (0.01, 0.1, 0.3, 0.6, 0.9, 0.999, 1.0)
POISSON_RATIOS = (-0.9, -0.5, 0.0, 0.3, 0.45, 0.499, 0.5)
MOTIONS = ("none", "velocity", "ramp", "sine", "triangle", "stages", "diagonal")
STIFFNESS_PERIODS = 100.0  # duration of the drag in units of sqrt(mass / normal stiffness): about a thousand explicit steps


@dataclass(frozen=True)
class Scales:
    """Of loads, speeds and times: sphere radius, overlap on the softer plate [m], mass [kg], E* of both plates [Pa]."""

    radius: float
    overlap: float
    mass: float
    e_soft: float
    e_stiff: float

    @property
    def load(self) -> float:
        return 4.0 / 3.0 * self.e_soft * math.sqrt(self.radius) * self.overlap**1.5

    @property
    def contact_radius(self) -> float:
        return math.sqrt(self.radius * self.overlap)

    @property
    def stiffness(self) -> float:
        """Normal stiffness 2 E* a of the stiffer contact under the same load, N/m."""
        return 2.0 * self.contact_radius * (self.e_stiff**2 * self.e_soft) ** (1.0 / 3.0)

    @property
    def duration(self) -> float:
        return STIFFNESS_PERIODS * math.sqrt(self.mass / self.stiffness)


def random_scene(seed: int) -> dict[str, Any]:
    rng = Random(seed)
    materials = {name: _material(rng) for name in ("a", "b")[: rng.choice((1, 2))]}
    radius = 10.0 ** rng.uniform(-7.0, -2.0)
    shape = rng.choice(("ball", "pair", "tripod", "needle", "ring", "ratio", "irregular", "spots"))
    integrator = rng.choice(("explicit", "explicit", "implicit"))
    count = 1 if shape == "spots" else rng.choice((1, 1, 4, 12))
    names = sorted(materials)
    debris, extent, mass = _debris(rng, shape, radius, count, seed, materials)
    soft, stiff = sorted(_e_star(materials[debris["material"]], materials[name]) for name in (names[0], names[-1]))
    scales = Scales(radius, radius * 10.0 ** rng.uniform(-6.0, -1.5), mass, soft, stiff)
    upper = _upper_plate(rng, scales, names[-1], shape)
    side = extent * 1.6 * math.ceil(math.sqrt(count)) + 2.0 * extent
    document = {
        "scene": 1, "title": f"random scene {seed}: {shape}", "materials": materials, "pairs": _pairs(rng, names),
        "debris": [debris],
        "domain": {"size": [f"{side!r} m", f"{side * rng.choice((1.0, 0.8))!r} m"], "periodic": rng.random() < 0.7},
        "plates": {"lower": {"material": names[0]}, "upper": upper},
        "contact": _contact(rng, integrator, count), "effects": _effects(rng, integrator, scales),
        "solver": {"integrator": integrator, "duration": f"{scales.duration!r} s"},
        "output": {"every": f"{scales.duration / 8.0!r} s"},
    }  # fmt: skip
    if rng.random() < 0.8:  # else "auto"
        document["solver"]["settle"] = f"{scales.duration / 3.0!r} s"
    return document


def _material(rng: Random) -> dict[str, Any]:
    stiffness, nu = f"{10.0 ** rng.uniform(4.0, 12.0)!r} Pa", rng.choice(POISSON_RATIOS)
    return {"youngs_modulus": stiffness, "poisson_ratio": nu, "density": f"{10.0 ** rng.uniform(2.3, 4.3)!r} kg/m3"}


def _value(text: str) -> float:
    return float(text.split()[0])


def _e_star(*pair: dict[str, Any]) -> float:
    return 1.0 / sum((1.0 - material["poisson_ratio"] ** 2) / _value(material["youngs_modulus"]) for material in pair)


def _pairs(rng: Random, names: list[str]) -> list[dict[str, Any]]:
    between = [[first, second] for i, first in enumerate(names) for second in names[i:]]
    return [{"between": two, "friction": rng.choice(FRICTIONS), "restitution": rng.choice(RESTITUTIONS)} for two in between]


def _sphere(x: float, y: float, radius: float) -> dict[str, Any]:
    return {"center": [f"{x!r} m", f"{y!r} m", "0 m"], "radius": f"{radius!r} m"}


def _given_spheres(rng: Random, shape: str, radius: float) -> list[dict[str, Any]]:
    pitch = 1.5 * radius
    if shape == "pair":
        return [_sphere(i * pitch * rng.choice((1.0, 1e-4)), 0.0, radius) for i in range(2)]
    if shape == "tripod":
        return [_sphere(0.0, 0.0, radius), _sphere(pitch, 0.0, radius), _sphere(0.5 * pitch, 0.8 * pitch, radius)]
    if shape == "needle":
        return [_sphere(i * pitch, 0.0, radius) for i in range(rng.randint(2, 20))]
    if shape == "ratio":
        return [_sphere(0.0, 0.0, radius), _sphere(radius, 0.0, radius * 10.0 ** rng.uniform(-3.0, 0.0))]
    number = rng.randint(6, 12)  # ring
    turns = [2.0 * math.pi * i / number for i in range(number)]
    across = pitch / (2.0 * math.sin(math.pi / number))
    return [_sphere(across * math.cos(turn), across * math.sin(turn), radius) for turn in turns]


def _debris(rng: Random, shape: str, radius: float, count: int, seed: int, materials: dict) -> tuple[dict, float, float]:
    """A population, the largest extent of one body (m) and the mass of one sphere (kg), on which the time scale rests."""
    material = rng.choice(sorted(materials))
    mass = _value(materials[material]["density"]) * 4.0 / 3.0 * math.pi * radius**3
    table: dict[str, Any] = {"material": material, "kind": "spheres", "count": count, "seed": seed}
    if shape == "spots":
        return _spots(rng, radius, mass, material), 12.0 * radius, mass
    if shape == "irregular":
        least = rng.randint(1, 8)
        table |= {"kind": "irregular", "size": f"{2.0 * radius!r} m", "spheres": [least, rng.randint(least, 12)]}
        table["aspect"] = sorted((1.0, rng.choice((1.0, 0.6, 0.3)), rng.choice((0.8, 0.3))), reverse=True)
        if rng.random() < 0.3:
            table["asperities"] = {"count": rng.randint(1, 8), "radius": rng.choice((0.05, 0.2, 0.5))}
        return table, 5.0 * radius, mass
    if shape == "ball":
        return table | {"radius": f"{radius!r} m"}, 2.0 * radius, mass
    spheres = _given_spheres(rng, shape, radius)
    return table | {"shape": spheres}, 2.0 * radius + 1.5 * radius * len(spheres), mass


def _spots(rng: Random, radius: float, mass: float, material: str) -> dict[str, Any]:
    places = ((-0.5, 0.5, "upper", 2.0), (-3.0, -1.0, "lower", -2.0), (1.0, 3.0, "lower", -2.0))
    spots = []
    for left, right, side, height in places:
        x, r = rng.uniform(left, right) * radius, radius * rng.uniform(0.5, 2.0)
        spots.append({"side": side, "x": f"{x!r} m", "z": f"{height * radius!r} m", "radius": f"{r!r} m"})
    inertia = [f"{8.0 * mass * radius**2!r} kg m2"] * 3
    return {"material": material, "kind": "spots", "spots": spots, "mass": f"{mass!r} kg", "inertia": inertia, "planar": True}


def _upper_plate(rng: Random, scales: Scales, material: str, shape: str) -> dict[str, Any]:
    support = rng.choice(("load_per_particle", "load_per_particle", "rigid", "foundation"))
    plate: dict[str, Any] = {"material": material, "support": support, "load": f"{scales.load!r} N"}
    if support == "foundation":
        plate["stiffness"] = f"{scales.stiffness * 10.0 ** rng.uniform(-3.0, 0.0)!r} N/m"
    if rng.random() < 0.15:
        rise, fall = f"{scales.duration / 2.0!r} s", f"{scales.duration / 4.0!r} s"
        twice, half = {"load": f"{2.0 * scales.load!r} N", "duration": rise}, {"load": f"{scales.load / 2.0!r} N"}
        plate["loading"] = rng.choice(({"load": "0 N"}, twice, [{"pause": fall}, half]))
    motion = _motion(rng, scales, planar=shape == "spots")
    if motion:
        plate["motion"] = motion
    return plate


def _motion(rng: Random, scales: Scales, planar: bool) -> dict[str, Any]:
    kind = rng.choice(MOTIONS[:-1] if planar else MOTIONS)
    distance = scales.contact_radius * 10.0 ** rng.uniform(-0.5, 1.5)
    speed, time = f"{distance / scales.duration!r} m/s", f"{scales.duration / 4.0!r} s"
    stroke = {"stroke": f"{distance / 4.0!r} m", "frequency": f"{2.0 / scales.duration!r} Hz"}
    motions: dict[str, dict[str, Any]] = {
        "none": {}, "velocity": {"x": {"velocity": speed}}, "ramp": {"x": {"ramp": speed, "duration": time}},
        "sine": {"x": stroke}, "triangle": {"x": stroke | {"shape": "triangle"}},
        "diagonal": {"x": {"velocity": speed}, "y": stroke},
        "stages": {"x": [{"velocity": speed, "duration": time}, {"pause": time}, {"velocity": "-" + speed}]},
    }  # fmt: skip
    return motions[kind]


def _contact(rng: Random, integrator: str, count: int) -> dict[str, Any]:
    level = rng.choice(LEVELS)
    table: dict[str, Any] = {"law": "three_spot", "level": level}
    if level == "mdr":
        table["springs"] = rng.choice((4, 16, 32))
    if count > 1 and (integrator == "implicit" or rng.random() < 0.3):
        table["debris_contact"] = "none"
    return table


def _effects(rng: Random, integrator: str, scales: Scales) -> dict[str, Any]:
    effects: dict[str, Any] = {}
    if rng.random() < 0.3:
        effects["gravity"] = ["0 m/s2", "0 m/s2", rng.choice(("-9.81 m/s2", "-1000 m/s2"))]
    if rng.random() < 0.15:
        effects["damping"] = f"{0.1 / math.sqrt(scales.mass / scales.stiffness)!r} 1/s"
    if integrator == "explicit" and rng.random() < 0.15:
        effects["rolling_resistance"] = {"coefficient": 0.05, "damping": 0.3}
    if integrator == "explicit" and rng.random() < 0.1:
        effects["local_damping"] = {"coefficient": 0.3, "until": "settled"}
    return effects


LAYER_RADIUS = 5e-6  # m, of balls; half the median size of clumps


def random_layer(seed: int) -> dict[str, Any]:
    """A small layer for the implicit integrator: 3 to 16 bodies under a load that presses spots in by 1e-4 to 1e-2 of the radius
    slide for 0.05 to 0.5 radii at 0.1 mm/s to 1 m/s, so that neighbours a fraction of a radius apart meet."""
    rng = Random(f"layer {seed}")
    count, fraction = rng.randint(3, 16), rng.uniform(0.1, 0.6)
    side = math.sqrt(count * math.pi * LAYER_RADIUS**2 / fraction)
    load = 4.0 / 3.0 * 115e9 * LAYER_RADIUS**2 * (10.0 ** rng.uniform(-4.0, -2.0)) ** 1.5
    distance, speed = LAYER_RADIUS * rng.uniform(0.05, 0.5), 10.0 ** rng.uniform(-4.0, 0.0)
    surface = {"friction": rng.choice((0.0, 0.05, 0.3, 0.6, 1.0)), "restitution": rng.choice((0.1, 0.3, 0.6, 0.9))}
    return {
        "scene": 1, "title": f"random layer {seed}",
        "materials": {"steel": {"youngs_modulus": "210 GPa", "poisson_ratio": 0.3, "density": "7850 kg/m3"}},
        "pairs": [{"between": ["steel", "steel"]} | surface], "debris": [_layer_debris(rng, count, seed)],
        "domain": {"size": [f"{side!r} m", f"{side!r} m"]},
        "plates": {"lower": {"material": "steel"}, "upper": _layer_plate(rng, load, speed, distance)},
        "contact": {"level": rng.choice(LEVELS)},
        "effects": {"gravity": ["0 m/s2", "0 m/s2", "-9.81 m/s2"]} if rng.random() < 0.3 else {},
        "solver": {"integrator": "implicit", "duration": f"{distance / speed!r} s"},
        "output": {"every": f"{distance / speed / 8.0!r} s"},
    }  # fmt: skip


def _layer_debris(rng: Random, count: int, seed: int) -> dict[str, Any]:
    table: dict[str, Any] = {"material": "steel", "count": count, "seed": seed, "placement": "layer"}
    kind = rng.choice(("ball", "pair", "irregular", "irregular"))
    if kind == "irregular":
        size = {"distribution": "lognormal", "median": f"{2.0 * LAYER_RADIUS!r} m", "sigma": 0.2}
        return table | {"kind": "irregular", "size": size, "spheres": [3, rng.randint(3, 8)], "aspect": [1.0, 0.8, 0.6]}
    if kind == "ball":
        return table | {"kind": "spheres", "radius": f"{LAYER_RADIUS!r} m"}
    radius = f"{0.6 * LAYER_RADIUS!r} m"
    shape = [{"center": [f"{0.9 * LAYER_RADIUS * i!r} m", "0 m", "0 m"], "radius": radius} for i in range(2)]
    return table | {"kind": "spheres", "shape": shape}


def _layer_plate(rng: Random, load: float, speed: float, distance: float) -> dict[str, Any]:
    support = rng.choice(("load_per_particle", "load_per_particle", "rigid", "foundation"))
    plate: dict[str, Any] = {"material": "steel", "support": support, "load": f"{load!r} N"}
    if support == "foundation":
        plate["stiffness"] = f"{load / LAYER_RADIUS * 10.0 ** rng.uniform(0.0, 2.0)!r} N/m"
    drag: dict[str, Any] = {"velocity": f"{speed!r} m/s"}
    if rng.random() < 0.3:
        drag = {"stroke": f"{distance / 4.0!r} m", "frequency": f"{2.0 * speed / distance!r} Hz"}
    return plate | {"motion": {"x": drag}}


@pytest.mark.full(kind="fuzz")
@pytest.mark.parametrize("random", [random_scene, random_layer])
def test_random_scenes_end_well_or_say_why(tmp_path, random):
    """Single bodies and layers that do not meet, by both integrators; layers whose bodies meet, by the implicit one."""
    ends, faults = Counter(), []
    for seed in range(SCENES):
        try:
            end = run_scene(random(seed), tmp_path / f"{seed}", wall_limit=WALL_LIMIT)
            if end == "finished" and seed % 4 == 0:
                run_scene(random(seed), tmp_path / f"{seed}_two", threads=2)
                assert contents(tmp_path / f"{seed}") == contents(tmp_path / f"{seed}_two")
        except Exception as error:  # every one is a fault; all of them are listed
            faults.append(f"{seed}: {type(error).__name__}: {error}")
            end = "fault"
        ends[end] += 1
    print(dict(ends))
    assert not faults, "\n".join(faults)
    assert ends["refused"] + ends["guard"] < 0.2 * SCENES  # else the scenes say little
