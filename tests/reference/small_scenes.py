"""Small scenes that between them use every part of the step. The layer of balls is the benchmark's, the others are texts."""

import numpy as np
import peers_scenes
from thirdbody.assembly.simulation import build
from thirdbody.kernels.tables import run_totals
from thirdbody.scene.model import Scene

TEXT = """\
scene = 1
domain = {{size = {size}{domain}}}
contact = {{{contact}}}
solver = {{integrator = "explicit", duration = "1 ms", settle = "{settle}"}}
output = {{every = "1 ms"}}
pairs = [
  {{between = ["steel", "steel"], friction = 0.30, restitution = 0.60}},
  {{between = ["steel", "brass"], friction = 0.20, restitution = 0.70}},
  {{between = ["brass", "brass"], friction = 0.15, restitution = 0.80}},
]
{debris}
[materials]
steel = {{youngs_modulus = "210 GPa", poisson_ratio = 0.30, density = "7850 kg/m3"}}
brass = {{youngs_modulus = "105 GPa", poisson_ratio = 0.30, density = "8500 kg/m3"}}
[plates]
lower = {{material = "steel"}}
[plates.upper]
material = "steel"
{upper}
[effects]
{effects}
"""
CLUMPS = """\
[[debris]]
kind = "irregular"
size = {{distribution = "lognormal", median = "10 um", sigma = 0.2, min = "5 um", max = "20 um"}}
spheres = [3, 6]
aspect = [1.0, 0.8, 0.6]
material = "{material}"
count = {count}
seed = {seed}
{placement}
"""
BALLS = CLUMPS[: CLUMPS.index("kind")] + 'kind = "spheres"\nradius = "{radius}"\n' + CLUMPS[CLUMPS.index("material") :]
LOADED = 'support = "load_per_particle"\nload = "0.1 mN"\ndamping = "7e-5 kg/s"\nmotion = {x = {velocity = "1 m/s"}}'


def scene(debris, size, upper=LOADED, settle="0.02 us", **more):
    parts = {"contact": "", "effects": "", "domain": ""} | more
    return build(Scene.parse(TEXT.format(debris=debris, size=size, upper=upper, settle=settle, **parts)))


def clumps(steel, brass=0, seed=4, placement=""):
    both = (("steel", steel), ("brass", brass))
    return "".join(CLUMPS.format(material=m, count=n, seed=seed + k, placement=placement) for k, (m, n) in enumerate(both) if n)


def balls(steel, brass, velocity=1.0, seed=1, placement=""):
    placement = placement or f'velocity = ["{velocity} m/s", "0 m/s", "0 m/s"]'
    both = (("steel", steel, "5 um"), ("brass", brass, "6 um"))
    return "".join(
        BALLS.format(material=m, count=n, radius=r, seed=seed + k, placement=placement) for k, (m, n, r) in enumerate(both) if n
    )


def heap(seed, speed, level, effects=""):
    """Some clumps of two materials in a small periodic box, dragged under a load: one of many such scenes."""
    bed = clumps(30, 15, seed, f'placement = "dense"\nvelocity = ["{speed} m/s", "0 m/s", "-1 m/s"]')
    upper = f'support = "rigid"\nload = "5 mN"\nmotion = {{x = {{velocity = "{speed} m/s"}}}}'
    return scene(bed, '["52 um", "54 um"]', upper=upper, contact=f'level = "{level}"', effects=effects)


def layer():
    """A dense layer of balls, sheared by a plate at a fixed height: bodies and spheres in one table, several groups."""
    peers_scenes.warm_up = lambda units: None  # type: ignore[attr-defined]  # it would compile what these tests never call
    return peers_scenes.simulation_of(peers_scenes.start_of("S", peers_scenes.generated(1600)))


def crowd():
    """A dense bed of clumps of two materials under a free plate, with labels, gravity and drag."""
    effects = 'gravity = ["0 m/s2", "1 m/s2", "-9.81 m/s2"]\ndamping = {rate = "1e5 1/s"}'
    upper = 'support = "rigid"\nload = "50 mN"\nmotion = {x = {velocity = "3 m/s"}}'
    bed = clumps(36, 36, placement='placement = "dense"\nvelocity = ["0 m/s", "0 m/s", "-2 m/s"]')
    return scene(bed, '["58 um", "64 um"]', upper=upper, contact='law = "three_spot", level = "coulomb"', effects=effects)


torn = crowd


def tear(simulation):
    """Lift the plate and the upper half of the bodies out of contact at once, so that contacts open with their springs loaded."""
    state = simulation.state
    lift = 2.0 * state.slots.records.overlap[state.slots.histories.slip > 0.0].max()
    upper = state.bodies.position[:, 2] > np.median(state.bodies.position[:, 2])
    state.bodies.position[upper, 2] += lift
    state.patches.height[:] += 2.0 * lift
    state.A[run_totals.MAX_DISPLACEMENT] += 2.0 * lift


def swarm():
    """More bodies than three groups: a dense bed of balls and clumps of two materials with moments of rolling under a plate."""
    effects = 'rolling_resistance = {coefficient = 0.05, damping = 0.3}\ngravity = ["0 m/s2", "0 m/s2", "-9.81 m/s2"]'
    upper = 'support = "rigid"\nload = "440 mN"\nmotion = {x = {velocity = "3 m/s"}}'
    dense = 'placement = "dense"\nvelocity = ["1 m/s", "0 m/s", "-3 m/s"]'
    bed = clumps(65, 35, placement=dense) + balls(970, 660, placement=dense)
    return scene(bed, '["205 um", "195 um"]', upper=upper, effects=effects)


def springs():
    """Clumps that meet plates only, in one pass chunk by chunk, with partial slip, which asks for the way of the patch."""
    return scene(clumps(50, 30), '["300 um", "300 um"]', contact='level = "mdr", springs = 8, debris_contact = "none"')


def foundation():
    """Balls under patches that hang on springs from a plate whose load and motion change in time; no period."""
    upper = 'support = "foundation"\nstiffness = "1e5 N/m"\npreload = "0.1 mN"\ndamping = "7e-5 kg/s"\nload = "6 mN"\n'
    upper += 'loading = {load = "9 mN", duration = "0.1 us"}\n'
    upper += 'motion = {x = {stroke = "20 nm", frequency = "2 MHz"}, y = {ramp = "0.2 m/s", duration = "0.1 us"}}'
    alone = 'debris_contact = "none"'
    return scene(balls(45, 30, 0.5), '["200 um", "200 um"]', upper=upper, contact=alone, domain=", periodic = false")


def rolled():
    """Balls and clumps with moments of rolling and pivoting under one free plate; damping that sees forces while they settle."""
    effects = "rolling_resistance = {coefficient = 0.05, damping = 0.3}\npivoting = {damping = 0.2}\n"
    effects += 'local_damping = {coefficient = 0.3}\ngravity = ["0 m/s2", "0 m/s2", "-9.81 m/s2"]'
    upper = 'support = "rigid"\nload = "20 mN"\nmotion = {x = {velocity = "2 m/s"}}'
    return scene(balls(25, 25, 3.0) + clumps(20), '["115 um", "110 um"]', upper=upper, effects=effects, settle="0.08 us")
