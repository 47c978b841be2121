"""A run of clumps between plates, and what tests of pictures ask of pixels."""

import numpy as np
import pytest
from thirdbody.errors import MissingLibrary
from thirdbody.palette import STATE_COLORS, rgb
from thirdbody.render import elsewhere
from thirdbody.rotations import to_world
from thirdbody.surfaces.grid import phases, sine_heights
from thirdbody.surfaces.surface import Surface
from thirdbody.trajectory.names import Frame
from thirdbody.trajectory.writer import TrajectoryWriter

R, AMPLITUDE = 11e-6, 2e-6


def clump_layer(count: int, per_clump: int = 6):
    """A jittered layer of clumps: sphere centres, radii, clump of each, body centres, states, domain."""
    rng, nx, pitch = np.random.default_rng(3), int(np.ceil(np.sqrt(count * 1.5))), 2.6 * R
    ny = -(-count // nx)
    grid = np.stack(np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"), -1).reshape(-1, 2)[:count]
    flat = (grid + 0.5) * pitch + rng.normal(0.0, 0.1 * R, (count, 2))
    bodies = np.column_stack([flat, rng.uniform(1.05, 1.3, count) * R])
    direction = rng.normal(size=(count, per_clump, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    offset = direction * rng.uniform(0.25, 0.55, (count, per_clump, 1)) * R
    radii = R * rng.uniform(0.38, 0.62, (count, per_clump))
    wave = np.sin(flat[:, 0] / 95e-6) + np.cos(flat[:, 1] / 120e-6 + 1.0) + rng.normal(0.0, 0.45, count)
    states = (1 + np.digitize(wave, [-0.6, 0.75])).astype(np.uint8)
    states[rng.random(count) < 0.04] = 0
    centers = (bodies[:, None] + offset).reshape(-1, 3)
    return centers, radii.ravel(), np.repeat(np.arange(count), per_clump), bodies, states, np.array([nx, ny]) * pitch


def write_layer(path, count: int, frames: int = 2, distance: float = 1.0, deep: float = 1.0, surfaces=None, spin: float = 0.0):
    """A run of `count` clumps between plates; from frame to frame all slide along x (`path` 1 or -1) and leave the domain. Each
    carries 0.1 mN from the upper plate (a fifth of it as friction, a quarter of what friction can do) to the lower one (three
    quarters). The gap is `deep` times the height of the layer. `surfaces`: those of rough plates. With `spin` [rad] bodies turn
    by so much from frame to frame, about axes of their own; then three more of them roll, and friction is 0.02 less."""
    centers, radii, owner, bodies, states, size = clump_layer(count)
    rng = np.random.default_rng(5)
    gap = deep * float((centers[:, 2] + radii).max())
    header = {
        "scene_text": "scene = 1\n", "title": "Wear debris under a load of 0.1 mN per particle", "units": {"distance": "m"},
        "state_names": list(STATE_COLORS), "reason_names": ["none", "friction_limit", "rotation"],
        "domain": {"size": size, "periodic": True},
    }  # fmt: skip
    static = {"spheres": {"radius": radii, "clump": owner}, "clumps": {"id": np.arange(count)}}
    corners = np.array([[0, 0, 0], [size[0], 0, 0], [size[0], size[1], 0], [0, size[1], 0]], float)
    touching = np.repeat(np.arange(count), 2)
    tops = bodies[touching] + np.tile([[0.0, 0.0, -R], [0.0, 0.0, R]], (count, 1))
    normal = np.tile([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], (count, 1))
    load = np.full(2 * count, 1e-4)
    axes = np.random.default_rng(7).normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    rub = np.tile([[-7.5e-6, 0.0, 0.0], [2.5e-6, 0.0, 0.0]], (count, 1)) * distance
    with TrajectoryWriter(path, header, static, surfaces=surfaces or {}) as writer:
        for number in range(frames):
            shift = np.array([distance * 10e-6 * number, 0.0, 0.0])
            upper = corners + [2 * shift[0], 0.0, gap]
            clumps = {
                "points": bodies + shift, "state": states, "velocity": rng.normal(size=(count, 3)),
                "state_reason": np.where(states == 0, 0, 1 + states % 2).astype(np.uint8),
                "friction_work": np.abs(bodies[:, 0]) * 1e-6,
            }  # fmt: skip
            contacts = {
                "points": tops + shift, "body": touching, "partner": np.tile([-1, -2], count),
                "utilisation": np.tile([0.75, 0.25], count), "normal": normal, "normal_force": load,
                "force": load[:, None] * normal + rub, "contact_radius": np.full(2 * count, 1e-7),
            }  # fmt: skip
            spheres = {"points": centers + shift}
            if spin:
                half = 0.5 * spin * number
                clumps["quaternion"] = np.column_stack((np.full(count, np.cos(half)), np.sin(half) * axes))
                clumps["state"] = np.where(np.arange(count) < 3 * number, 3, states).astype(np.uint8)
                arms = to_world(clumps["quaternion"][owner], centers - bodies[owner])
                spheres = {"points": (bodies + shift)[owner] + arms}
            plates = {"points": np.concatenate([corners, upper])}
            series = {"distance": 20e-6 * number, "friction_coefficient": 0.31 - (0.02 * number if spin else 0.0)}
            writer.append(Frame(10e-6 * number, spheres, clumps, contacts, plates, series))
    return path


def wavy_surfaces(count: int) -> dict[str, Surface]:
    """Surfaces of both plates around such a layer, waves with the height AMPLITUDE over their means."""
    size = tuple(float(length) for length in clump_layer(count)[-1])
    lower = Surface(sine_heights(phases((64, 96), (3, 1), 0.3), AMPLITUDE), size, size[0] / 4, curvature=False, copies=(3, 1))
    return {"lower": lower, "upper": Surface(sine_heights(phases((32, 48), (2, 0), 0.0), AMPLITUDE), size, size[0] / 2)}


def skip_unless_drawable():
    try:
        elsewhere.usable_windows()
    except MissingLibrary as error:
        pytest.skip(str(error))


def hue_share(pixels: np.ndarray, color: str) -> float:
    """Share of the pixels with the hue of `color`, at any brightness: light changes brightness only."""
    direction = pixels.reshape(-1, 3) - pixels.reshape(-1, 3).mean(axis=1, keepdims=True)
    aim = np.array(rgb(color), float) - np.mean(rgb(color))
    strength = np.linalg.norm(direction, axis=1)
    cosine = direction @ aim / np.maximum(strength * np.linalg.norm(aim), 1e-9)
    # 25 grey steps of colour: the bluish plates have less; cosine 0.95 is 18 degrees, the hues lie 90 apart.
    return float(np.mean((strength > 25.0) & (cosine > 0.95)))
